"""The public functions that denoise, compare and repair meshes, files and regions."""
