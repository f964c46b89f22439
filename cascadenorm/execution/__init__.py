"""Run work in several processes or on a Dask cluster, with progress reports and memory limits."""
