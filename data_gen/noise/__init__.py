"""Measurement errors."""
