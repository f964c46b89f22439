"""What is true of any surface: Laplacians, sparse systems, eigenproblems, neighbourhoods, nearest points, holes."""
