"""Train, load and export models."""
