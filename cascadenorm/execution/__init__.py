"""Run work in several processes or on a Dask cluster.

This includes progress reports and memory limits.
"""
