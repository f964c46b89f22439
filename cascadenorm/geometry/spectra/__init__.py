"""Eigenfunctions of the Laplacian of a mesh."""
