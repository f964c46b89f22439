"""Denoise many files in parallel processes, with a memory limit and resumption."""
