"""Multi-region surfaces: regions of a volume that share walls."""
