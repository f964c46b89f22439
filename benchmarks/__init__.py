"""Measurements that are run by hand from the root of the checkout: python -m benchmarks.accuracy.results PAIRS."""
