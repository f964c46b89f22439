"""Processing of a mesh patch by patch to limit memory use."""
