"""Benchmarks of accuracy: how close results are to the true surface."""
