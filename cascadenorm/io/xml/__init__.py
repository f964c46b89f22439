"""XML formats whose numbers are replaced in place: 3MF and COLLADA."""
