"""Where a picture is taken from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.mesh import Mesh, unit

LEAST_COVERAGE = 0.01
"""Area of the faces in a picture over the square of half its diagonal, below which the camera goes nearer."""


@dataclass(frozen=True)
class Camera:
    """Where a picture is taken from; one camera serves several meshes, so that their pictures can be compared.

    Parameters
    ----------
    axes : (3, 3) unit rows: to the right, upward, toward the viewer
    center : (3,) the point in the middle of the picture
    reach : half of the width and of the height to be seen, in the units of the mesh
    perspective : one over the distance of the viewer in mesh units; 0 is a parallel projection
    """

    axes: NDArray[np.float64]
    center: NDArray[np.float64]
    reach: tuple[float, float]
    perspective: float

    @classmethod
    def looking_at(
        cls,
        mesh: Mesh,
        *,
        direction: ArrayLike | None = None,
        perspective: float = 0.15,
    ) -> "Camera":
        """Place a camera so that the whole mesh is seen, but for far parts so small that the rest would be a dot.

        Parameters
        ----------
        mesh : what is to be seen
        direction : from the mesh toward the viewer, y upward in the picture, or z where one looks along y; None is the
            front of a surface that is open, else a three-quarter view
        perspective : half the diagonal of the bounding box over the distance of the viewer; 0 is a parallel projection
        """
        if not 0 <= perspective < 1:
            raise ValueError(f"perspective is {perspective}; it must be at least 0 and below 1")
        axes = _axes(_direction(mesh) if direction is None else direction)
        points = mesh.vertices[np.unique(mesh.faces[_framed_faces(mesh)])]
        low, high = points.min(axis=0), points.max(axis=0)
        middle, diagonal = (low + high) / 2, np.linalg.norm(high - low)
        strength = float(2 * perspective / diagonal) if diagonal else 0.0
        flat = projected((points - middle) @ axes.T, strength)[:, :2]
        center = middle + (flat.min(axis=0) + flat.max(axis=0)) / 2 @ axes[:2]
        flat = projected((points - center) @ axes.T, strength)[:, :2]  # nearer points have gone farther
        width, height = np.abs(flat).max(axis=0)
        return cls(axes, center, (float(width), float(height)), strength)

    def framed(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Bring points, (…, 3), into the frame of the camera: to the right, upward, toward the viewer."""
        return (points - self.center) @ self.axes.T

    def shows(self, mesh: Mesh) -> bool:
        """Tell whether most vertices of the faces of a mesh are in the picture."""
        flat = projected(self.framed(mesh.vertices[mesh.topology.used_vertices]), self.perspective)[:, :2]
        return bool((np.abs(flat) <= self.reach).all(axis=1).mean() > 0.5)


def projected(points: NDArray[np.float64], perspective: float) -> NDArray[np.float64]:
    """Map points of the camera's frame to the screen; straight lines stay straight, nearer stays larger z.

    What another mesh's camera finds beside or behind the viewer is moved to just in front.
    """
    return points / np.maximum(1 - perspective * points[..., 2:], 1e-3)


def _framed_faces(mesh: Mesh) -> NDArray[np.intp]:
    """Return the faces that decide on the frame: all, unless a few far ones leave most of the picture empty.

    The faces within a distance of the middle count, for the largest distance at which they cover enough. The middle is
    the median by area; a needle, such as a spike makes, has the area of a square over its height there. Files of CAD
    kernels have such parts: a triangle of no size at the origin, a vertex that a failed intersection left far outside.
    """
    seen = np.flatnonzero(mesh.areas > 0)
    if not len(seen):
        return np.arange(len(mesh.faces))
    weights = np.minimum(mesh.areas[seen], mesh.heights[seen] ** 2)
    middle = np.array([_weighted_median(along, weights) for along in mesh.centroids[seen].T])
    distances = np.linalg.norm(mesh.corners[seen] - middle, axis=2).max(axis=1)
    outward = np.argsort(distances, kind="stable")
    covered = np.cumsum(mesh.areas[seen][outward]) >= LEAST_COVERAGE * distances[outward] ** 2
    return seen[outward[: np.flatnonzero(covered)[-1] + 1]] if covered.any() else seen


def _weighted_median(values: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """The first of the ascending values up to which lies half of the weight."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(total, total[-1] / 2)]])


def _direction(mesh: Mesh) -> ArrayLike:
    """Toward the front of an open surface, else over the right shoulder of a model that stands upright in y."""
    faces = _framed_faces(mesh)
    facing = mesh.area_vectors[faces].sum(axis=0)
    return facing if np.linalg.norm(facing) > 0.2 * mesh.areas[faces].sum() else (0.45, 0.40, 0.80)


def _axes(direction: ArrayLike) -> NDArray[np.float64]:
    """Camera axes for a direction toward the viewer."""
    toward = np.asarray(direction, float)
    if toward.shape != (3,) or not toward.any():
        raise ValueError(f"direction is {direction!r}; it must be three numbers, not all 0")
    toward, upward = unit(toward), np.array([0.0, 1.0, 0.0])
    if abs(toward @ upward) > 0.999:
        upward = np.roll(upward, 1)
    right = unit(np.cross(upward, toward))
    return np.stack([right, np.cross(toward, right), toward])
