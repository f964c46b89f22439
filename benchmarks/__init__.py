"""Measurements that are run by hand, from the root of a checkout: python -m benchmarks.accuracy.pairs PAIRS."""
