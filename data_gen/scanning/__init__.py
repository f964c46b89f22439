"""Surfaces as they come out of measurements, before errors are added or with them."""
