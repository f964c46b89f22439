"""Benchmarks with malformed input and with meshes of other libraries."""
