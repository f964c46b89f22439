"""Detection of the kind of surface and the kind of error."""
