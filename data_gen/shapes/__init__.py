"""Shapes: distance fields of machine parts, statues and patterns."""
