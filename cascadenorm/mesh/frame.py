"""Meshes scaled to about unit size, so that no square overflows or vanishes."""

import numpy as np

from cascadenorm.mesh.mesh import Mesh


def in_frame(mesh: Mesh) -> tuple[Mesh, int]:
    """Return the mesh centred and scaled by 2**-exponent, exactly; vertices without a face are at the origin."""
    used = mesh.topology.used_vertices
    lower, upper = mesh.vertices[used].min(axis=0), mesh.vertices[used].max(axis=0)
    exponent = int(np.frexp((0.5 * upper - 0.5 * lower).max())[1])  # halved first: 1e308 would overflow
    center = 0.5 * upper + 0.5 * lower
    centered = np.where(used[:, None], mesh.vertices, center) - center
    return mesh.moved(np.ldexp(centered, -exponent)), exponent


def scaled_alike(*meshes: Mesh) -> list[Mesh]:
    """Return the meshes scaled by one power of two, so that the largest coordinate of all is about 1.

    Vertices without a face go where one with a face is.
    """
    exponent = max(_exponent(mesh) for mesh in meshes)
    return [_scaled(mesh, exponent) for mesh in meshes]


def scale_between(mesh: Mesh, scaled: Mesh) -> float:
    """Return the length of 1 of a scaled mesh in the unit of the mesh, a power of two."""
    used = mesh.topology.used_vertices
    large = np.abs(scaled.vertices[used]).argmax()
    return float(mesh.vertices[used].flat[large] / scaled.vertices[used].flat[large])


def _exponent(mesh: Mesh) -> int:
    return int(np.frexp(np.abs(mesh.vertices[mesh.topology.used_vertices]).max())[1])


def _scaled(mesh: Mesh, exponent: int) -> Mesh:
    used = mesh.topology.used_vertices[:, None]
    return mesh.moved(np.ldexp(np.where(used, mesh.vertices, mesh.vertices[mesh.faces[0, 0]]), -exponent))
