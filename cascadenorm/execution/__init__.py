"""Work in several processes or on a Dask cluster, its progress, and the memory that it may use."""
