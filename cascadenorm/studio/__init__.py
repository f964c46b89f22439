"""The studio: denoising in a browser, served by this machine to itself alone."""

from cascadenorm.studio.launch import studio

__all__ = ["studio"]
