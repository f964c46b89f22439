"""Inspect a mesh of any kind: what it is, what is wrong with it, where, and how noisy it is."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.detection.error_kind import ErrorKind, error_kind
from cascadenorm.detection.noise_level import noise_level
from cascadenorm.detection.treads import Treads, treads
from cascadenorm.geometry.orientation import oriented
from cascadenorm.geometry.small_components import small_components
from cascadenorm.inspection.crossings import crossing_faces
from cascadenorm.inspection.defects import (
    boundary_loop_count,
    flipped_edges,
    pinched_vertices,
    repeats,
    spikes,
    thin_faces,
)
from cascadenorm.inspection.enclosed import enclosed
from cascadenorm.inspection.faults import MOST_FACES_CROSSED
from cascadenorm.inspection.source import Found, GivenMesh, taken
from cascadenorm.learned.methods import Treated, auto, treated
from cascadenorm.mesh import (
    Mesh,
    bad_faces,
    bad_vertices,
    in_frame,
    isolated,
    ordered_for_cache,
    without_repeated_faces,
)
from cascadenorm.mesh.welding import nearly_coincident

MOST_FACES_DENOISED = 300_000
"""Faces up to which the kind of error is told, from what `auto` would take away; it takes seconds for 100,000."""


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """What a mesh is and what is wrong with it; faces are triangles, larger polygons being cut.

    Vertices that the file splits at seams count once. Bad indices and vertices that are not finite are counted first;
    what follows is about the faces besides, and about those with three different corners.

    Parameters
    ----------
    source
        Name of the file, or of the kind of mesh.
    number_type
        Of the coordinates, float32 or float64.
    counts_from
        Number of the first vertex and face in the places named.
    vertices, file_vertices, faces
        Their numbers; the file's vertices include copies at seams.
    bad_indices
        Faces that reference a vertex that does not exist.
    not_finite
        Vertices with a coordinate that is not finite.
    repeated_corners
        Faces that repeat a vertex.
    parts
        Connected components that have a face.
    closed
        Whether every edge has two faces or more.
    boundary_loops, boundary_edges
        Chains of edges with a single face, and those edges.
    non_manifold_edges
        With more than two faces.
    non_manifold_vertices
        Where faces meet that do not are connected there.
    flipped_edges
        Whose two faces run along them the same way, so that one of them is flipped.
    inside_out
        Closed parts with a negative volume, by a face of each; cavities are such parts as well.
    zero_area, slivers
        Faces without height, and those with one below 1 % of their longest side.
    duplicate_faces
        Faces on the same three vertices as an earlier one.
    unreferenced
        Vertices that no face names.
    duplicate_vertices
        Vertices at the place of an earlier one, but not joined with it.
    nearly_coincident
        Boundary vertices within 0.001 median edge lengths of an earlier one, but not joined with it.
    crossing_faces
        Faces that pass through others; None where that was not looked for.
    spikes
        Vertices whose faces' angles add up to less than 150°.
    small_components
        With fewer than 1 % of the faces of the largest one, by a face of each.
    euler_characteristic
        Vertices less edges plus faces.
    genus
        Handles of all closed parts that are manifolds; None where there is none.
    lower, upper
        Corners of the bounding box of the faces.
    mean_edge_length, area, volume
        In the unit of the mesh; the volume of the closed parts, None without one.
    resolution
        Step from one number to the next at the largest coordinate, in mean edge lengths.
    noise
        Root mean square of what `auto` removes along the normals, in mean edge lengths; estimated from the mesh alone
        where `error` is None. None where edges away from the boundary are too few.
    error
        The kind of error, told from what `auto` would take away; None for more than MOST_FACES_DENOISED faces, and
        where all are at one point.
    treated_as
        What `auto` treats the mesh as; None where `error` is None.
    treads
        Wide flat steps, such as those of rounded depths, which may be error or shape; None where there are none.
    """

    source: str
    number_type: str
    counts_from: int
    vertices: int
    file_vertices: int
    faces: int
    bad_indices: Found
    not_finite: Found
    repeated_corners: Found
    parts: int
    closed: bool
    boundary_loops: int
    boundary_edges: int
    non_manifold_edges: Found
    non_manifold_vertices: Found
    flipped_edges: Found
    inside_out: Found
    zero_area: Found
    slivers: Found
    duplicate_faces: Found
    unreferenced: Found
    duplicate_vertices: Found
    nearly_coincident: Found
    crossing_faces: Found | None
    spikes: Found
    small_components: Found
    euler_characteristic: int
    genus: int | None
    lower: tuple[float, ...] | None
    upper: tuple[float, ...] | None
    mean_edge_length: float | None
    area: float | None
    volume: float | None
    resolution: float | None
    noise: float | None
    error: ErrorKind | None
    treated_as: Treated | None
    treads: Treads | None

    @property
    def findings(self) -> dict[str, Found]:
        """What was found at least once, by its name."""
        found = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in found.items() if isinstance(value, Found) and value.count}


def inspect(mesh: Any, faces: ArrayLike | None = None, *, self_intersections: bool | None = None) -> Inspection:
    """Look a mesh over; what cannot be denoised is reported here rather than refused.

    Parameters
    ----------
    mesh
        Vertices as an (n, 3) array, with `faces`; or alone a path, a stream of bytes, a file that was read, a
        `cascadenorm.Mesh`, or a mesh of trimesh, pyvista, vtk, open3d or meshio.
    faces
        (m, 3) integers.
    self_intersections
        Whether to look for faces that cross each other; None: up to MOST_FACES_CROSSED faces.

    Raises
    ------
    ReadError
        A file that cannot be read.
    MeshError
        Arrays of the wrong shape or type.
    """
    given = taken(mesh, faces)
    corners, count = given.faces, len(given.vertices)
    outside = np.asarray((corners < 0) | (corners >= count))
    out_of_range, not_finite = np.asarray(outside.any(axis=1)), bad_vertices(given.vertices)
    a, b, c = corners.T
    bad = bad_faces(given.vertices, corners)
    used = np.zeros(count + 1, bool)
    used[np.where(outside, count, corners)] = True
    report = _shape(given, isolated(given.vertices, corners), ~bad, self_intersections) if not bad.all() else NOTHING
    return Inspection(
        source=given.source,
        number_type=given.number_type,
        counts_from=given.counts_from,
        vertices=count,
        file_vertices=given.file_vertices,
        faces=len(corners),
        bad_indices=given.at_faces(out_of_range),
        not_finite=given.at_vertices(not_finite),
        repeated_corners=given.at_faces(~out_of_range & np.asarray((a == b) | (b == c) | (c == a))),
        unreferenced=given.at_vertices(~used[:-1]),
        duplicate_vertices=given.at_vertices(repeats(given.vertices)[0] & ~not_finite),
        **report,
    )


def _shape(given: GivenMesh, mesh: Mesh, good: NDArray[np.bool_], self_intersections: bool | None) -> dict[str, Any]:
    """Everything about the good faces, of which `mesh` is made."""
    small, exponent = in_frame(mesh)
    topology, around = mesh.topology, mesh.topology.edge_faces.counts
    numbered = given._replace(face_numbers=given.face_numbers[good])
    pinched = pinched_vertices(topology)
    parts = enclosed(small, pinched)
    flat, thin = thin_faces(small)
    looks = len(mesh.faces) <= MOST_FACES_CROSSED if self_intersections is None else self_intersections
    crossing = crossing_faces(small, repeats(small.vertices)[1]) if looks else None
    inside_out = np.zeros(len(mesh.faces), bool)
    inside_out[parts.faces[parts.volumes < 0]] = True
    floating = np.zeros(len(mesh.faces), bool)
    floating[small_components(mesh)[1]] = True
    corners = mesh.vertices[mesh.faces.ravel()]
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    step = float(np.spacing(np.abs([lower, upper]).max().astype(given.number_type)))
    edge, facing = _scaled(small.mean_edge_length, exponent), oriented(without_repeated_faces(small))
    return {
        "parts": len(np.unique(topology.face_components)),
        "closed": bool((around > 1).all()),
        "boundary_loops": boundary_loop_count(topology),
        "boundary_edges": int((around == 1).sum()),
        "non_manifold_edges": numbered.at_edges(topology.edges[around > 2]),
        "non_manifold_vertices": numbered.at_vertices(pinched),
        "flipped_edges": numbered.at_edges(topology.edges[flipped_edges(topology)]),
        "inside_out": numbered.at_faces(inside_out),
        "zero_area": numbered.at_faces(flat),
        "slivers": numbered.at_faces(thin),
        "nearly_coincident": numbered.at_vertices(nearly_coincident(small)),
        "duplicate_faces": numbered.at_faces(repeats(np.sort(mesh.faces, axis=1))[0]),
        "crossing_faces": None if crossing is None else numbered.at_faces(crossing),
        "spikes": numbered.at_vertices(spikes(small)),
        "small_components": numbered.at_faces(floating),
        "euler_characteristic": len(np.unique(mesh.faces)) - len(topology.edges) + len(mesh.faces),
        "genus": int((2 - parts.characteristics[parts.manifold]).sum() // 2) if parts.manifold.any() else None,
        "lower": tuple(lower.tolist()),
        "upper": tuple(upper.tolist()),
        "mean_edge_length": edge,
        "area": _scaled(small.area, 2 * exponent),
        "volume": _scaled(float(parts.volumes.sum()), 3 * exponent) if len(parts.volumes) else None,
        "resolution": step / edge if edge and np.isfinite(step / edge) else None,
        "treads": treads(facing),
        **_noise_and_error(facing, exponent),
    }


def _noise_and_error(mesh: Mesh, exponent: int) -> dict[str, Any]:
    """Return the noise, the kind of error and what `auto` treats the mesh as, told as `denoise` tells them."""
    noise = noise_level(mesh)
    if len(mesh.faces) > MOST_FACES_DENOISED or not mesh.mean_edge_length > 0:
        return {"noise": noise, "error": None, "treated_as": None}
    mesh = ordered_for_cache(mesh).mesh
    error = error_kind(mesh, auto(mesh), exponent=exponent)
    return {"noise": None if noise is None else error.size, "error": error, "treated_as": treated(mesh)}


NONE_FOUND = Found(0, ())

NOTHING: dict[str, Any] = {
    **dict.fromkeys(("parts", "boundary_loops", "boundary_edges", "euler_characteristic"), 0),
    **dict.fromkeys(("non_manifold_edges", "non_manifold_vertices", "flipped_edges", "inside_out"), NONE_FOUND),
    **dict.fromkeys(("zero_area", "slivers", "duplicate_faces", "nearly_coincident", "crossing_faces"), NONE_FOUND),
    **dict.fromkeys(("spikes", "small_components"), NONE_FOUND),
    **dict.fromkeys(("genus", "lower", "upper", "mean_edge_length", "area", "volume", "resolution", "noise")),
    **dict.fromkeys(("error", "treated_as", "treads")),
    "closed": False,
}
"""What `_shape` says where no face is good."""


def _scaled(value: float, exponent: int) -> float | None:
    """Return value · 2**exponent; None where that is too large for a number."""
    with np.errstate(over="ignore"):
        scaled = float(np.ldexp(value, exponent))
    return scaled if np.isfinite(scaled) else None
