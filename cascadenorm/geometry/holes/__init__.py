"""Holes of a mesh, found and closed."""
