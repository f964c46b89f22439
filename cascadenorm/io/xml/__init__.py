"""Formats in XML whose numbers are replaced where they are: 3MF and COLLADA."""
