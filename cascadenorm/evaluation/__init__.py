"""Methods measured: the harness that runs them on pairs of noisy and clean meshes, records, and tables."""
