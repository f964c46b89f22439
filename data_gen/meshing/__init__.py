"""Meshes of shapes, as different programs make them."""
