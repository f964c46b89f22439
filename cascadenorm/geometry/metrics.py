"""How far a denoised mesh is from the true one: in the directions of its faces, in its vertices, in its volume."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.geometry.nearest import SurfaceTree
from cascadenorm.geometry.volume import is_closed
from cascadenorm.mesh import Mesh, MeshError, Vectors, angles_between, scaled_alike

LEAST_SIZE = 1e-90
"""Size of a mesh, as a share of the other's, whose cube is still a number."""


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Errors of a mesh against the true one; 0 is perfect, and 1 for the volume ratio.

    Parameters
    ----------
    normal_error_deg
        E_a, mean angle between the face normals, in degrees.
    normal_error_rms_deg
        Root of the mean square of that angle.
    normal_error_p95_deg
        95 % of the faces are at most that far off.
    normal_error_area_deg
        Mean angle, faces weighted by their true area; by their own where the faces differ.
    flipped_percent
        Share of the faces that are off by more than 90°.
    vertex_error_edges
        E_v, mean distance of the vertices to the true surface, in mean edge lengths of the true mesh.
    vertex_rms_edges
        Root of the mean square of that distance.
    hausdorff_diagonal
        Largest distance of a vertex of either mesh to the other surface, over the diagonal of the true mesh's bounding
        box.
    volume_ratio
        Enclosed volume over the true one; None unless both meshes are closed.
    """

    normal_error_deg: float
    normal_error_rms_deg: float
    normal_error_p95_deg: float
    normal_error_area_deg: float
    flipped_percent: float
    vertex_error_edges: float
    vertex_rms_edges: float
    hausdorff_diagonal: float
    volume_ratio: float | None

    def in_words(self) -> dict[str, str]:
        """Each measure by what it is, with its unit."""
        return {
            "normal error E_a, mean": f"{self.normal_error_deg:.3f} deg",
            "normal error, root mean square": f"{self.normal_error_rms_deg:.3f} deg",
            "normal error, 95 % of the faces": f"{self.normal_error_p95_deg:.3f} deg",
            "normal error, mean by area": f"{self.normal_error_area_deg:.3f} deg",
            "faces flipped (off by more than 90 deg)": f"{self.flipped_percent:.3f} %",
            "vertex error E_v, mean": f"{self.vertex_error_edges:.4f} mean edge lengths",
            "vertex error, root mean square": f"{self.vertex_rms_edges:.4f} mean edge lengths",
            "Hausdorff distance": f"{self.hausdorff_diagonal:.5f} diagonals",
            "volume ratio": "open" if self.volume_ratio is None else f"{self.volume_ratio:.6f}",
        }


def measure(mesh: Mesh, reference: Mesh) -> Measures:
    """Measure a mesh against the true one.

    Parameters
    ----------
    mesh
        The one to judge; vertices that no face uses do not count.
    reference
        The true one. If its faces are the same, they are compared one by one; otherwise each face is compared with the
        true face nearest to its centroid. Faces without area, in either mesh, have no angle.

    Raises
    ------
    MeshError
        No face has a normal on both sides, the true mesh has no extent, or they differ in size beyond measure.
    """
    mesh, reference = scaled_alike(mesh, reference)  # which changes no measure
    sizes = sorted([mesh.diagonal, reference.diagonal])
    if 0 < sizes[0] < LEAST_SIZE * sizes[1]:
        raise MeshError(f"one mesh is over {1 / LEAST_SIZE:.0e} times as large as the other: bring them to one unit")
    if reference.diagonal == 0 or reference.mean_edge_length == 0:
        raise MeshError("all vertices of the reference mesh are at one place: give a mesh that has an extent")
    away = errors(mesh, reference)
    known = ~np.isnan(away.angles)
    angles = away.angles[known]
    if not len(angles):
        raise MeshError("no face has an area in both meshes: there are no normals to compare")
    areas = (reference if np.array_equal(mesh.faces, reference.faces) else mesh).areas[known]
    there = away.distances[mesh.topology.used_vertices]
    back = SurfaceTree(mesh).nearest(_used_vertices(reference)).distances
    return Measures(
        normal_error_deg=float(angles.mean()),
        normal_error_rms_deg=float(np.sqrt(np.square(angles).mean())),
        normal_error_p95_deg=float(np.percentile(angles, 95)),
        normal_error_area_deg=float(np.average(angles, weights=areas)),
        flipped_percent=float(100 * (angles > 90).mean()),
        vertex_error_edges=float(there.mean() / reference.mean_edge_length),
        vertex_rms_edges=float(np.sqrt(np.square(there).mean()) / reference.mean_edge_length),
        hausdorff_diagonal=float(max(there.max(), back.max()) / reference.diagonal),
        volume_ratio=_volume_ratio(mesh, reference),
    )


class Errors(NamedTuple):
    """Errors of a mesh against the true one, place by place.

    Parameters
    ----------
    angles
        (m,) between the normal of each face and the true one, in degrees; NaN where one of them has no area.
    distances
        (n,) of each vertex to the true surface; NaN for a vertex without a face.
    """

    angles: NDArray[np.float64]
    distances: NDArray[np.float64]


def errors(mesh: Mesh, reference: Mesh) -> Errors:
    """Measure each face and vertex of a mesh against the true one, as `measure` does; both of about unit size."""
    surface = SurfaceTree(reference)
    distances = np.full(len(mesh.vertices), np.nan)
    distances[mesh.topology.used_vertices] = surface.nearest(_used_vertices(mesh)).distances
    ours, theirs = mesh.face_normals, reference.face_normals
    if not np.array_equal(mesh.faces, reference.faces):
        theirs = theirs[surface.nearest(mesh.centroids).faces]
    return Errors(angles_at_faces(ours, theirs), distances)


def angles_at_faces(ours: Vectors, theirs: Vectors) -> NDArray[np.float64]:
    """Return the angle between the normals of each face, (m,) in degrees; NaN where one of them is zero."""
    angles = np.full(len(ours), np.nan)
    angles[ours.any(axis=1) & theirs.any(axis=1)] = np.degrees(angles_between(ours, theirs))
    return angles


def _used_vertices(mesh: Mesh) -> NDArray[np.float64]:
    return mesh.vertices[mesh.topology.used_vertices]


def _volume_ratio(mesh: Mesh, reference: Mesh) -> float | None:
    if not (is_closed(mesh) and is_closed(reference)) or reference.volume == 0:
        return None
    return mesh.volume / reference.volume
