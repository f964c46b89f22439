"""Error metrics of a mesh against the ground truth."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cascadenorm.geometry.nearest import SurfaceTree
from cascadenorm.geometry.volume import is_closed
from cascadenorm.mesh import Floats, Mesh, MeshError, Vectors, angles_between, scaled_alike, surface_of

APART = 0.5  # mean distance to the ground truth, in diagonals of the smaller mesh, above which meshes are unrelated
LEAST_SIZE = 1e-90  # smallest ratio of the sizes of two meshes; the cube of a smaller ratio would underflow
SYMBOLS = (
    "E_a is the mean angle between the face normals and those of the true mesh, and E_v the mean distance of the "
    "vertices to its surface. Distances are in mean edge lengths of the true mesh or in diagonals of its bounding box."
)
"""What the symbols and units of the errors mean."""


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Errors of a mesh against the ground truth; a perfect result has 0 everywhere and a volume ratio of 1.

    Parameters
    ----------
    normal_error_deg
        E_a, mean angle between the face normals, in degrees.
    normal_error_rms_deg
        Root mean square of that angle, in degrees.
    normal_error_p95_deg
        95th percentile of that angle, in degrees.
    normal_error_area_deg
        Area-weighted mean of that angle, in degrees. Areas are those of the ground truth, or of the mesh itself if the
        faces differ.
    flipped_percent
        Percentage of faces with an angle above 90°.
    vertex_error_edges
        E_v, mean distance of the vertices to the true surface, in mean edge lengths of the ground truth.
    vertex_rms_edges
        Root mean square of that distance, in the same unit.
    hausdorff_diagonal
        Largest distance of a vertex of either mesh to the other surface, divided by the diagonal of the bounding box of
        the ground truth.
    volume_ratio
        Enclosed volume divided by the true one; None unless both meshes are closed.
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

    def formatted(self) -> dict[str, str]:
        """Format the measures for printing.

        Returns
        -------
        Formatted numbers by their descriptions, which end with the units.
        """
        return {
            "mean angle E_a (°)": f"{self.normal_error_deg:.3f}",
            "root mean square angle (°)": f"{self.normal_error_rms_deg:.3f}",
            "95th percentile of the angle (°)": f"{self.normal_error_p95_deg:.3f}",
            "mean angle by area (°)": f"{self.normal_error_area_deg:.3f}",
            "flipped faces (%)": f"{self.flipped_percent:.3f}",
            "mean distance E_v (mean edge lengths)": f"{self.vertex_error_edges:.4f}",
            "root mean square distance (mean edge lengths)": f"{self.vertex_rms_edges:.4f}",
            "Hausdorff distance (diagonals)": f"{self.hausdorff_diagonal:.5f}",
            "volume ratio": "open" if self.volume_ratio is None else f"{self.volume_ratio:.6f}",
        }


def measure(mesh: Mesh, reference: Mesh) -> Measures:
    """Measure the errors of a mesh against the ground truth.

    If both meshes have the same faces, these are compared one by one. Otherwise each face is compared with the face of
    `reference` nearest to its centroid. Faces without area in either mesh, vertices without a face, the edges of faces
    that repeat a vertex, and faces that repeat another one are ignored. Raises MeshError if no pair of compared faces
    has two normals, the ground truth has no extent, the sizes of the meshes differ too much, or the meshes are so far
    apart that no measure would mean anything.
    """
    mesh, reference = scaled_alike(surface_of(mesh), surface_of(reference))  # scale changes no measure
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
    _check_related(mesh, reference, float(there.mean()))
    enclose = is_closed(mesh) and is_closed(reference)
    back = SurfaceTree(mesh).nearest(reference.vertices[reference.topology.used_vertices]).distances
    return Measures(
        normal_error_deg=float(angles.mean()),
        normal_error_rms_deg=float(np.sqrt(np.square(angles).mean())),
        normal_error_p95_deg=float(np.percentile(angles, 95)),
        normal_error_area_deg=float(np.average(angles, weights=areas)),
        flipped_percent=float(100 * (angles > 90).mean()),
        vertex_error_edges=float(there.mean() / reference.mean_edge_length),
        vertex_rms_edges=float(np.sqrt(np.square(there).mean()) / reference.mean_edge_length),
        hausdorff_diagonal=float(max(there.max(), back.max()) / reference.diagonal),
        volume_ratio=mesh.volume / reference.volume if enclose and reference.volume else None,
    )


class Errors(NamedTuple):
    """Errors of the faces and vertices of a mesh against the ground truth."""

    # (m,) angle between the normal of each face and the true one, in degrees; NaN if either face has no area
    angles: Floats
    distances: Floats  # (n,) distance of each vertex to the true surface; NaN for a vertex without a face


def errors(mesh: Mesh, reference: Mesh) -> Errors:
    """Return the error of each face and vertex, compared as in `measure`; both meshes must be of about unit size."""
    surface = SurfaceTree(reference)
    distances = np.full(len(mesh.vertices), np.nan)
    used = mesh.topology.used_vertices
    distances[used] = surface.nearest(mesh.vertices[used]).distances
    ours, theirs = mesh.face_normals, reference.face_normals
    if not np.array_equal(mesh.faces, reference.faces):
        theirs = theirs[surface.nearest(mesh.centroids).faces]
    return Errors(angles_at_faces(ours, theirs), distances)


def angles_at_faces(ours: Vectors, theirs: Vectors) -> Floats:
    """Return the (m,) angles between two normals of each face in degrees; NaN if either is zero."""
    return np.degrees(angles_between(ours, theirs, undefined=np.nan))


def _check_related(mesh: Mesh, reference: Mesh, distance: float) -> None:
    """Raise MeshError if the mean distance of the vertices to the ground truth shows that the meshes are unrelated."""
    if distance <= APART * min(mesh.diagonal, reference.diagonal):
        return
    sizes = mesh.diagonal / reference.diagonal
    units = f", and it is {sizes:.3g} times as large" if not 0.1 < sizes < 10 else ""
    raise MeshError(
        f"the mesh is {distance / reference.diagonal:.3g} diagonals of the reference away from it on average{units}: "
        "bring both to one unit and one place, and check that they show the same object"
    )
