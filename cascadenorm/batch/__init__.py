"""Denoising many files in parallel processes, within a memory limit, with resumption."""
