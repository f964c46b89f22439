"""Compiled, multithreaded loops over arrays, independent of meshes."""
