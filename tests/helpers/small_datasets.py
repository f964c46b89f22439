"""Settings of data sets that are generated quickly."""

SMALL = {"min_faces": 1200, "max_faces": 1800}
