"""Detection and filling of holes."""
