"""Scaling of meshes to about unit size, against overflow and underflow."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.compute.arrays import Vectors, box_of
from cascadenorm.mesh.mesh import Mesh


class Frame(NamedTuple):
    """A local coordinate frame with an origin and a unit of length."""

    center: Vectors  # (3,) point that becomes the origin
    exponent: int  # 2**exponent becomes the unit

    def points(self, positions: NDArray[Any]) -> Vectors:
        """Return positions, (k, 3), in this frame; the scaling is exact."""
        return np.asarray(np.ldexp(positions.astype(np.float64, copy=False) - self.center, -self.exponent))

    def of(self, mesh: Mesh) -> Mesh:
        """Return the mesh in this frame; vertices without a face are placed at the origin."""
        used = mesh.topology.used_vertices
        vertices = mesh.vertices if used.all() else np.where(used[:, None], mesh.vertices, self.center)
        return mesh.moved(self.points(vertices))


def frame_of(mesh: Mesh) -> Frame:
    """Return the frame of the bounding box of the used vertices."""
    used = mesh.topology.used_vertices
    lower, upper = box_of(mesh.vertices if used.all() else mesh.vertices[used])
    exponent = int(np.frexp((0.5 * upper - 0.5 * lower).max())[1])  # halved first: 1e308 would overflow
    return Frame(0.5 * upper + 0.5 * lower, exponent)


def in_frame(mesh: Mesh) -> tuple[Mesh, int]:
    """Return the mesh centred and scaled by 2**-exponent, and the exponent.

    Vertices without a face are placed at the origin.
    """
    frame = frame_of(mesh)
    return frame.of(mesh), frame.exponent


def scaled_alike(*meshes: Mesh) -> list[Mesh]:
    """Scale all meshes by the same power of two so that their largest coordinate is about 1.

    Vertices without a face are moved to a vertex that has one.
    """
    exponent = max(_exponent(mesh) for mesh in meshes)
    return [_scaled(mesh, exponent) for mesh in meshes]


def scale_between(mesh: Mesh, scaled: Mesh) -> float:
    """Return the unit length of a scaled mesh in the unit of the original mesh, a power of two."""
    used = mesh.topology.used_vertices
    large = np.abs(scaled.vertices[used]).argmax()
    return float(mesh.vertices[used].flat[large] / scaled.vertices[used].flat[large])


def _exponent(mesh: Mesh) -> int:
    return int(np.frexp(np.abs(mesh.vertices[mesh.topology.used_vertices]).max())[1])


def _scaled(mesh: Mesh, exponent: int) -> Mesh:
    used = mesh.topology.used_vertices[:, None]
    return mesh.moved(np.ldexp(np.where(used, mesh.vertices, mesh.vertices[mesh.faces[0, 0]]), -exponent))
