"""The public functions that denoise, compare, inspect and repair meshes, files and regions, and train models."""
