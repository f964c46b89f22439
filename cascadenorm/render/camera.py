"""Where a picture is taken from."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.mesh import Mesh, unit

LEAST_COVERAGE = 0.01
"""Area of the faces in a picture over the square of half its diagonal, below which the camera goes nearer."""
MARGIN = 1.06
"""What a picture shows over what is to be seen."""
FIELD_OF_VIEW = 30.0
"""Angle between the upper and the lower end of a picture from a given distance, in degrees, as in reports."""

Up = Literal["x", "y", "z"]
AROUND = {  # toward the viewer: to the right, upward, out of the front
    "front": (0.0, 0.0, 1.0),
    "back": (0.0, 0.0, -1.0),
    "left": (-1.0, 0.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "top": (0.0, 1.0, 0.0),
    "bottom": (0.0, -1.0, 0.0),
    "three-quarter": (0.45, 0.40, 0.80),
}
"""Directions that have a name, for a model that stands upright in y."""


@dataclass(frozen=True)
class Camera:
    """Where a picture is taken from; one camera serves several meshes, so that their pictures can be compared.

    Parameters
    ----------
    axes
        (3, 3) unit rows: to the right, upward, toward the viewer.
    center
        (3,) the point in the middle of the picture.
    reach
        Half of the width and of the height to be seen, in the units of the mesh.
    perspective
        One over the distance of the viewer in mesh units; 0 is a parallel projection.
    offset
        The middle of the picture, to the right and upward of the center on the screen.
    """

    axes: NDArray[np.float64]
    center: NDArray[np.float64]
    reach: tuple[float, float]
    perspective: float
    offset: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def looking_at(
        cls,
        mesh: Mesh,
        *,
        direction: ArrayLike | None = None,
        perspective: float = 0.15,
        up: Up = "y",
    ) -> "Camera":
        """Place a camera so that the whole mesh is seen, but for far parts so small that the rest would be a dot.

        Parameters
        ----------
        mesh
            What is to be seen.
        direction
            From the mesh toward the viewer; None is the front of a surface that is open, else a three-quarter view.
        perspective
            Half the diagonal of the bounding box over the distance of the viewer; 0 is a parallel projection.
        up
            Axis of the mesh that is upward in the picture; where one looks along it, the next one is.
        """
        if not 0 <= perspective < 1:
            raise ValueError(f"perspective is {perspective}; it must be at least 0 and below 1")
        faces = _framed_faces(mesh)
        axes = _axes(_direction(mesh, faces, up) if direction is None else direction, up)
        points = _points(mesh, faces)
        low, high = points.min(axis=0), points.max(axis=0)
        middle, diagonal = (low + high) / 2, np.linalg.norm(high - low)
        strength = float(2 * perspective / diagonal) if diagonal else 0.0
        framed = (points - middle) @ axes.T
        flat = projected(framed, strength)[:, :2]
        aside = (flat.min(axis=0) + flat.max(axis=0)) / 2
        center = middle + aside @ axes[:2]
        framed[:, :2] -= aside
        flat = projected(framed, strength)[:, :2]  # nearer points have gone farther
        width, height = np.abs(flat).max(axis=0)
        return cls(axes, center, (float(width), float(height)), strength)

    @classmethod
    def at_distance(cls, direction: ArrayLike, target: ArrayLike, distance: float, *, up: Up = "y") -> "Camera":
        """Place a camera at a distance from a point that it looks at, with FIELD_OF_VIEW.

        Parameters
        ----------
        direction
            From the point toward the viewer.
        target
            (3,) the point.
        distance
            In the unit of the mesh.
        up
            Axis of the mesh that is upward in the picture.
        """
        if not 0 < distance < np.inf:
            raise ValueError(f"distance is {distance}; it must be positive and finite")
        reach = float(distance * np.tan(np.radians(FIELD_OF_VIEW / 2)) / MARGIN)
        return cls(_axes(direction, up), np.asarray(target, float), (reach, reach), 1 / distance)

    def half_size(self, size: tuple[int, int]) -> tuple[float, float]:
        """Return half the width and height of what a picture of `size` pixels shows, in the units of the mesh."""
        width, height = size
        pixel = 2 * MARGIN * max(self.reach[0] / width, self.reach[1] / height, 1e-300)
        return width * pixel / 2, height * pixel / 2

    def cropped(self, x: float, y: float, width: float, *, size: tuple[int, int]) -> "Camera":
        """Return the camera of a square part of a picture, seen in the same perspective.

        Parameters
        ----------
        x, y
            Middle of the part, as shares of the width and height from the upper left.
        width
            Of the part, as a share of the width of the picture.
        size
            Of the picture in pixels.
        """
        half_width, half_height = self.half_size(size)
        left, upward = self.offset
        reach = width * half_width / MARGIN
        offset = left + (2 * x - 1) * half_width, upward + (1 - 2 * y) * half_height
        return replace(self, reach=(reach, reach), offset=offset)

    def around(self, mesh: Mesh, *, count: int, up: Up = "y") -> list["Camera"]:
        """Return cameras on a walk around the whole mesh, at equal angles about the upward axis, of one reach."""
        points = _points(mesh, _framed_faces(mesh))
        center = (points.min(axis=0) + points.max(axis=0)) / 2
        angles = 2 * np.pi * np.arange(count) / count
        cameras = [replace(self, center=center, axes=self.axes @ _turn(angle, up).T) for angle in angles]
        seen = [np.abs(projected(one.framed(points), self.perspective)[:, :2]).max(axis=0) for one in cameras]
        width, height = np.max(seen, axis=0)
        return [replace(one, reach=(float(width), float(height))) for one in cameras]

    def framed(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Bring points, (…, 3), into the frame of the camera: to the right, upward, toward the viewer."""
        return (points - self.center) @ self.axes.T

    def shows(self, mesh: Mesh) -> bool:
        """Tell whether nearly all vertices of the faces of a mesh are in the picture."""
        flat = projected(self.framed(mesh.vertices[mesh.topology.used_vertices]), self.perspective)[:, :2]
        inside = np.abs(flat - self.offset) <= MARGIN * np.array(self.reach)
        return bool(inside.all(axis=1).mean() > 0.9)


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
    corners = _points(mesh, seen)
    if mesh.areas.sum() >= LEAST_COVERAGE * np.sum(np.ptp(corners, axis=0) ** 2):
        return seen  # they cover enough at any distance that two of them have
    weights = np.minimum(mesh.areas[seen], mesh.heights[seen] ** 2)
    middle = np.array([_weighted_median(along, weights) for along in mesh.centroids[seen].T])
    distances = np.linalg.norm(mesh.corners[seen] - middle, axis=2).max(axis=1)
    outward = np.argsort(distances, kind="stable")
    covered = np.cumsum(mesh.areas[seen][outward]) >= LEAST_COVERAGE * distances[outward] ** 2
    return seen[outward[: np.flatnonzero(covered)[-1] + 1]] if covered.any() else seen


def _points(mesh: Mesh, faces: NDArray[np.intp]) -> NDArray[np.float64]:
    """Vertices of faces."""
    used = np.zeros(len(mesh.vertices), bool)
    used[mesh.faces[faces]] = True
    return mesh.vertices[used]


def _weighted_median(values: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """The first of the ascending values up to which lies half of the weight."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(total, total[-1] / 2)]])


def named_direction(name: str, *, up: Up = "y") -> tuple[float, ...]:
    """Return the direction toward the viewer that one of AROUND names."""
    return _upright(AROUND[name], up)


def direction_of_angles(azimuth: float, elevation: float, *, up: Up = "y") -> tuple[float, ...]:
    """Return the direction toward a viewer who went around from the front to the right, and upward, in degrees."""
    around, above = np.radians((azimuth, elevation))
    level = np.cos(above)
    return _upright((float(np.sin(around) * level), float(np.sin(above)), float(np.cos(around) * level)), up)


def _upright(direction: tuple[float, ...], up: Up) -> tuple[float, ...]:
    """Turn a direction for models that stand upright in y to another axis; the front of z upward is -y."""
    right, upward, front = direction
    return {"y": (right, upward, front), "z": (right, -front, upward), "x": (upward, right, -front)}[up]


def _turn(angle: float, up: Up) -> NDArray[np.float64]:
    """Matrix of a turn about the upward axis by an angle in radians."""
    axis = "xyz".index(up)
    plane = np.ix_(*2 * [((axis + 1) % 3, (axis + 2) % 3)])
    turn = np.eye(3)
    turn[plane] = ((np.cos(angle), -np.sin(angle)), (np.sin(angle), np.cos(angle)))
    return turn


def _direction(mesh: Mesh, faces: NDArray[np.intp], up: Up) -> ArrayLike:
    """Toward the front of an open surface, else over the right shoulder of a model that stands upright.

    The faces are those that decide on the frame.
    """
    facing = mesh.area_vectors[faces].sum(axis=0)
    return facing if np.linalg.norm(facing) > 0.2 * mesh.areas[faces].sum() else named_direction("three-quarter", up=up)


def _axes(direction: ArrayLike, up: Up) -> NDArray[np.float64]:
    """Camera axes for a direction toward the viewer."""
    toward = np.asarray(direction, float)
    if toward.shape != (3,) or not toward.any():
        raise ValueError(f"direction is {direction!r}; it must be three numbers, not all 0")
    toward, upward = unit(toward), np.eye(3)["xyz".index(up)]
    if abs(toward @ upward) > 0.999:
        upward = np.roll(upward, 1)
    right = unit(np.cross(upward, toward))
    return np.stack([right, np.cross(toward, right), toward])
