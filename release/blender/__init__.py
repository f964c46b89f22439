"""Denoise triangle meshes in Blender: the panel is in the sidebar of the 3-D view, tab Denoise."""

from cascadenorm.frontends.blender import register, unregister

__all__ = ["register", "unregister"]
