"""Loops over arrays, compiled and on all threads; nothing here knows of meshes."""
