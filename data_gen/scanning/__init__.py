"""Surfaces as measurements produce them, with or without errors."""
