"""What is true of any surface: Laplacians, sparse systems, spectra, neighbourhoods, nearest points, holes, metrics."""
