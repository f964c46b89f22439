"""The studio: denoising in a browser, with a server that only this machine can reach."""

from cascadenorm.studio.launch import studio

__all__ = ["studio"]
