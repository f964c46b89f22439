"""Regions of a volume that share walls."""
