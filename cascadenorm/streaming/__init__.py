"""Meshes larger than memory, denoised in patches that lie on disk."""
