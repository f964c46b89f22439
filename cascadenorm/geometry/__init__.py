"""Geometry processing: Laplacians, solvers, spectra, neighbourhoods, nearest points, holes, metrics, patches."""
