"""Scaling of meshes to about unit size, against overflow and underflow."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.compute.arrays import Vectors
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
        return mesh.moved(self.points(_with_unused_at(self.center, mesh)))


def frame_of(mesh: Mesh) -> Frame:
    """Return the frame of the bounding box of the used vertices."""
    lower, upper = mesh.box
    exponent = int(np.frexp((0.5 * upper - 0.5 * lower).max())[1])  # halved first: 1e308 would overflow
    return Frame(0.5 * upper + 0.5 * lower, exponent)


def in_frame(mesh: Mesh) -> tuple[Mesh, int]:
    """Return the mesh centred and scaled by 2**-exponent, and the exponent; unused vertices are at the origin."""
    frame = frame_of(mesh)
    return frame.of(mesh), frame.exponent


def scaled_alike(*meshes: Mesh) -> list[Mesh]:
    """Scale meshes by one power of two to a largest coordinate of about 1; unused vertices move to a used one."""
    largest = max(np.abs(mesh.box).max() for mesh in meshes)
    exponent = int(np.frexp(largest)[1])
    return [_scaled(mesh, exponent) for mesh in meshes]


def scale_between(mesh: Mesh, scaled: Mesh) -> float:
    """Return the unit length of a scaled mesh in the unit of the original mesh, a power of two."""
    used = mesh.topology.used_vertices
    large = np.abs(scaled.vertices[used]).argmax()
    largest = scaled.vertices[used].flat[large]
    return float(mesh.vertices[used].flat[large] / largest) if largest else 1.0  # all vertices are at the origin


def _scaled(mesh: Mesh, exponent: int) -> Mesh:
    return mesh.moved(np.ldexp(_with_unused_at(mesh.vertices[mesh.faces[0, 0]], mesh), -exponent))


def _with_unused_at(place: Vectors, mesh: Mesh) -> Vectors:
    """Return the vertices, (n, 3), with those without a face at a place, (3,)."""
    used = mesh.topology.used_vertices
    return mesh.vertices if used.all() else np.where(used[:, None], mesh.vertices, place)
