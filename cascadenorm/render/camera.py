"""Choose the viewpoint and the frame of a picture."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.mesh import Mesh, box_of, marked, unit

LEAST_COVERAGE = 0.01
"""Ratio of face area to the square of half the picture's diagonal, below which the camera moves closer."""
MARGIN = 1.06  # ratio of the size of a picture to the size of its content
FIELD_OF_VIEW = 30.0  # vertical field of view in degrees for a camera at a given distance, as in reports

Up = Literal["x", "y", "z"]
AROUND = {  # right, up and front components of the direction to the viewer
    "front": (0.0, 0.0, 1.0),
    "back": (0.0, 0.0, -1.0),
    "left": (-1.0, 0.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "top": (0.0, 1.0, 0.0),
    "bottom": (0.0, -1.0, 0.0),
    "three-quarter": (0.45, 0.40, 0.80),
}
"""Named directions for a model with y up."""


@dataclass(frozen=True)
class Camera:
    """Viewpoint of a picture; several meshes can share a camera, which makes their pictures comparable."""

    axes: NDArray[np.float64]  # (3, 3) unit rows: right, up, and toward the viewer
    center: NDArray[np.float64]  # (3,) point in the middle of the picture
    reach: tuple[float, float]  # half of the visible width and height, in mesh units
    perspective: float  # reciprocal of the distance of the viewer, in mesh units; 0 is a parallel projection
    offset: tuple[float, float] = (0.0, 0.0)  # shift of the middle of the picture to the right and up

    @classmethod
    def looking_at(
        cls, mesh: Mesh, *, direction: ArrayLike | None = None, perspective: float = 0.15, up: Up = "y"
    ) -> "Camera":
        """Place a camera that shows the whole mesh, except small far parts that would shrink the rest to a dot.

        The direction is from the mesh toward the viewer; None selects the front of an open surface, and otherwise a
        three-quarter view. `perspective` is half the diagonal of the bounding box divided by the distance of the
        viewer. `up` points up in the picture; if it is the direction of view, the next axis is used.
        """
        if not 0 <= perspective < 1:
            raise ValueError(f"perspective is {perspective}; it must be at least 0 and below 1")
        faces = _framed_faces(mesh)
        axes = _axes(_direction(mesh, faces, up) if direction is None else direction, up)
        points = _points(mesh, faces)
        low, high = box_of(points)
        middle, diagonal = (low + high) / 2, np.linalg.norm(high - low)
        strength = float(2 * perspective / diagonal) if diagonal else 0.0
        framed = (points - middle) @ axes.T
        flat = projected(framed, strength)[:, :2]
        aside = np.add(*box_of(flat)) / 2
        center = middle + aside @ axes[:2]
        framed[:, :2] -= aside
        flat = projected(framed, strength)[:, :2]  # nearer points have moved farther
        width, height = np.maximum(*np.abs(box_of(flat)))
        return cls(axes, center, (float(width), float(height)), strength)

    @classmethod
    def at_distance(cls, direction: ArrayLike, target: ArrayLike, distance: float, *, up: Up = "y") -> "Camera":
        """Place a camera with FIELD_OF_VIEW at a distance, in mesh units, from a point, (3,), in a direction from it.

        `up` is the mesh axis that points up in the picture.
        """
        if not 0 < distance < np.inf:
            raise ValueError(f"distance is {distance}; it must be positive and finite")
        reach = float(distance * np.tan(np.radians(FIELD_OF_VIEW / 2)) / MARGIN)
        return cls(_axes(direction, up), np.asarray(target, float), (reach, reach), 1 / distance)

    def half_size(self, size: tuple[int, int]) -> tuple[float, float]:
        """Return half the width and height shown in a picture of `size` pixels, in mesh units."""
        width, height = size
        pixel = 2 * MARGIN * max(self.reach[0] / width, self.reach[1] / height, 1e-300)
        return width * pixel / 2, height * pixel / 2

    def cropped(self, x: float, y: float, width: float, *, size: tuple[int, int]) -> "Camera":
        """Return the camera of a square part of a picture of `size` pixels, with unchanged perspective.

        x and y are the center of the part, from the upper left, and `width` is its width, as fractions of the picture.
        """
        half_width, half_height = self.half_size(size)
        left, upward = self.offset
        reach = width * half_width / MARGIN
        offset = left + (2 * x - 1) * half_width, upward + (1 - 2 * y) * half_height
        return replace(self, reach=(reach, reach), offset=offset)

    def around(self, mesh: Mesh, *, count: int, up: Up = "y") -> list["Camera"]:
        """Return the cameras of `turned` around the center of a mesh, all with the same reach and showing all of it."""
        points = _points(mesh, _framed_faces(mesh))
        center = (points.min(axis=0) + points.max(axis=0)) / 2
        cameras = replace(self, center=center).turned(count=count, up=up)
        seen = [np.abs(projected(one.framed(points), self.perspective)[:, :2]).max(axis=0) for one in cameras]
        width, height = np.max(seen, axis=0)
        return [replace(one, reach=(float(width), float(height))) for one in cameras]

    def turned(self, *, count: int, up: Up = "y") -> list["Camera"]:
        """Return cameras at equal angles around the up axis through the center."""
        angles = 2 * np.pi * np.arange(count) / count
        return [replace(self, axes=self.axes @ _turn(angle, up).T) for angle in angles]

    def framed(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transform points, (…, 3), to the frame of the camera: right, up, toward the viewer."""
        return (points - self.center) @ self.axes.T

    def shows(self, mesh: Mesh) -> bool:
        """Test whether nearly all referenced vertices of a mesh are within the picture."""
        flat = projected(self.framed(mesh.vertices[mesh.topology.used_vertices]), self.perspective)[:, :2]
        inside = np.abs(flat - self.offset) <= MARGIN * np.array(self.reach)
        return bool(inside.all(axis=1).mean() > 0.9)


def projected(points: NDArray[np.float64], perspective: float) -> NDArray[np.float64]:
    """Project points from the camera frame to the screen; lines stay straight, and nearer points have larger z.

    Points of other meshes beside or behind the viewer are moved to just in front of the viewer.
    """
    return points / np.maximum(1 - perspective * points[..., 2:], 1e-3)


def _framed_faces(mesh: Mesh) -> NDArray[np.intp]:
    """Return the faces that determine the frame: all, unless a few far ones leave most of the picture empty.

    The frame contains the faces within the largest distance of the center at which they cover enough of the picture.
    The center is the median by area, where a needle, such as a spike, counts as a square with the side of its height.
    Meshes from CAD kernels contain such far parts: a degenerate triangle at the origin, or a far vertex from a failed
    intersection.
    """
    seen = np.flatnonzero(mesh.areas > 0)
    if not len(seen):
        return np.arange(len(mesh.faces))
    corners = _points(mesh, seen)
    low, high = box_of(corners)
    if mesh.areas.sum() >= LEAST_COVERAGE * np.sum((high - low) ** 2):
        return seen  # they cover enough at any distance that two of them have
    weights = np.minimum(mesh.areas[seen], mesh.heights[seen] ** 2)
    middle = np.array([_weighted_median(along, weights) for along in mesh.centroids[seen].T])
    distances = np.linalg.norm(mesh.corners[seen] - middle, axis=2).max(axis=1)
    outward = np.argsort(distances, kind="stable")
    covered = np.cumsum(mesh.areas[seen][outward]) >= LEAST_COVERAGE * distances[outward] ** 2
    return seen[outward[: np.flatnonzero(covered)[-1] + 1]] if covered.any() else seen


def _points(mesh: Mesh, faces: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the vertices that the faces reference."""
    used = mesh.topology.used_vertices
    if len(faces) < len(mesh.faces):
        used = marked(mesh.faces[faces], len(mesh.vertices))
    return mesh.vertices[used]


def _weighted_median(values: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """Return the first value, in ascending order, at which the cumulative weight reaches half of the total."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(total, total[-1] / 2)]])


def named_direction(name: str, *, up: Up = "y") -> tuple[float, ...]:
    """Return the direction toward the viewer for a name in AROUND."""
    return _upright(AROUND[name], up)


def direction_of_angles(azimuth: float, elevation: float, *, up: Up = "y") -> tuple[float, ...]:
    """Return the direction toward the viewer for azimuth, from front to right, and elevation, in degrees."""
    around, above = np.radians((azimuth, elevation))
    level = np.cos(above)
    return _upright((float(np.sin(around) * level), float(np.sin(above)), float(np.cos(around) * level)), up)


def _upright(direction: tuple[float, ...], up: Up) -> tuple[float, ...]:
    """Convert a direction for models with y up to another up axis; with z up, the front is -y."""
    right, upward, front = direction
    return {"y": (right, upward, front), "z": (right, -front, upward), "x": (upward, right, -front)}[up]


def _turn(angle: float, up: Up) -> NDArray[np.float64]:
    """Return the rotation matrix about the up axis for an angle in radians."""
    axis = "xyz".index(up)
    plane = np.ix_(*2 * [((axis + 1) % 3, (axis + 2) % 3)])
    turn = np.eye(3)
    turn[plane] = ((np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle)))
    return turn


def _direction(mesh: Mesh, faces: NDArray[np.intp], up: Up) -> ArrayLike:
    """Return the direction to the front of an open surface, or a three-quarter view of other meshes.

    The faces are those that determine the frame.
    """
    facing = mesh.area_vectors[faces].sum(axis=0)
    return facing if np.linalg.norm(facing) > 0.2 * mesh.areas[faces].sum() else named_direction("three-quarter", up=up)


def _axes(direction: ArrayLike, up: Up) -> NDArray[np.float64]:
    """Return camera axes for a direction toward the viewer."""
    toward = np.asarray(direction, float)
    if toward.shape != (3,) or not toward.any():
        raise ValueError(f"direction is {direction!r}; it must be three numbers, not all 0")
    toward, upward = unit(toward), np.eye(3)["xyz".index(up)]
    if abs(toward @ upward) > 0.999:
        upward = np.roll(upward, 1)
    right = unit(np.cross(upward, toward))
    return np.stack([right, np.cross(toward, right), toward])
