"""Errors of measurement."""
