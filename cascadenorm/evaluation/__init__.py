"""Evaluate methods on pairs of noisy and clean meshes."""
