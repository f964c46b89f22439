"""Inspect meshes: properties, defects and their locations, and noise."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cascadenorm.api.apply import run_with_controls
from cascadenorm.api.inspection.crossings import crossing_faces
from cascadenorm.api.inspection.defects import (
    boundary_loop_count,
    enclosed,
    flipped_edges,
    folded_edges,
    pinched_vertices,
    spikes,
    thin_faces,
)
from cascadenorm.api.inspection.source import Found, GivenMesh, taken
from cascadenorm.api.opened_files import detected_error
from cascadenorm.detection.bumps import Bumps, bumps
from cascadenorm.detection.error_kind import LEAST_ERROR, ErrorKind
from cascadenorm.detection.noise_level import noise_level
from cascadenorm.detection.spikes import outliers
from cascadenorm.detection.steps import Treads, treads
from cascadenorm.geometry.orientation import oriented
from cascadenorm.geometry.small_components import component_count, small_components
from cascadenorm.learned.methods import MeshTreatment
from cascadenorm.mesh import Bools, Mesh, any_in_rows, marked, repeats
from cascadenorm.mesh.frame import in_frame
from cascadenorm.mesh.isolation import bad_faces, bad_vertices, isolated, repeats_vertex, without_repeated_faces
from cascadenorm.mesh.welding import nearly_coincident
from cascadenorm.registry import find
from cascadenorm.registry.controls import checked_controls

MOST_FACES_CROSSED = 200_000  # maximum number of faces of meshes that are checked for self-intersections by default
MOST_FACES_DENOISED = 300_000  # maximum number of faces for which `auto` is run to determine the kind of error
NONE_FOUND = Found(0, ())


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """Properties and defects of a mesh; faces are triangles, and larger polygons are triangulated.

    Vertices that the file splits at seams count once. Bad indices and vertices that are not finite are counted first.
    The other findings concern the remaining faces, and some of them only faces with three different vertices.

    Parameters
    ----------
    source
        Name of the file, or kind of mesh.
    number_type
        Type of the coordinates, float32 or float64.
    counts_from
        Number of the first vertex and face in reported locations.
    vertices, file_vertices, faces
        Counts; `file_vertices` includes copies at seams.
    bad_indices
        Faces that reference a vertex that does not exist.
    not_finite
        Vertices with a coordinate that is not finite.
    repeated_corners
        Faces that repeat a vertex.
    parts
        Number of connected components with a face.
    closed
        Whether every edge has two or more faces.
    boundary_loops, boundary_edges
        Numbers of boundary loops and of edges with a single face.
    non_manifold_edges
        Edges with more than two faces.
    non_manifold_vertices
        Vertices whose faces are not connected there.
    flipped_edges
        Edges whose two faces traverse them in the same direction, so that one of the faces is flipped.
    inside_out
        Closed components with negative volume, given by one face each; these include cavities.
    zero_area, slivers
        Faces without height, and faces with a height below 1 % of their longest edge.
    duplicate_faces
        Faces with the same three vertices as an earlier one.
    unreferenced
        Vertices that no face references.
    duplicate_vertices
        Vertices at the position of an earlier one, but not joined with it.
    nearly_coincident
        Boundary vertices within 0.001 median edge lengths of an earlier one, but not joined with it.
    crossing_faces
        Faces that cross others, without duplicate faces; None if not checked.
    spikes
        Vertices with an angle sum of less than 150°.
    outliers
        Vertices far off the surface around them, which `auto` moves back.
    folded_edges
        Number of edges whose two faces have normals more than 90° apart, such as edges of spikes and folds.
    small_components
        Components with fewer than 1 % of the faces of the largest one, given by one face each.
    euler_characteristic
        Vertices minus edges plus faces.
    genus
        Number of handles of all closed manifold components; None if there are no such components.
    lower, upper
        Corners of the bounding box of the faces.
    mean_edge_length, area, volume
        In mesh units; volume of the closed components, None if there are none.
    resolution
        Spacing of the number type at the largest coordinate, in mean edge lengths.
    noise
        Root mean square of the normal displacement by `auto`, in mean edge lengths; estimated from the mesh alone if
        `error` is None. None if there are too few interior edges for an estimate and `auto` finds no error.
    error
        Kind of error that `auto` would remove; None for more than 300,000 faces, or if all vertices coincide.
    treated_as
        Kind of surface that `auto` chooses for the mesh; None if `error` is None.
    treads
        Wide flat steps, such as those of quantized depths, which may be error or shape; None if there are none.
    bumps
        Wide bumps of one width that cover the mesh, which may be error or shape; None if there are none, or for more
        than 300,000 faces.
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
    # the defaults of what follows describe a mesh without a valid face
    parts: int = 0
    closed: bool = False
    boundary_loops: int = 0
    boundary_edges: int = 0
    non_manifold_edges: Found = NONE_FOUND
    non_manifold_vertices: Found = NONE_FOUND
    flipped_edges: Found = NONE_FOUND
    inside_out: Found = NONE_FOUND
    zero_area: Found = NONE_FOUND
    slivers: Found = NONE_FOUND
    duplicate_faces: Found = NONE_FOUND
    unreferenced: Found
    duplicate_vertices: Found
    nearly_coincident: Found = NONE_FOUND
    crossing_faces: Found | None = NONE_FOUND
    spikes: Found = NONE_FOUND
    outliers: Found = NONE_FOUND
    folded_edges: int = 0
    small_components: Found = NONE_FOUND
    euler_characteristic: int = 0
    genus: int | None = None
    lower: tuple[float, ...] | None = None
    upper: tuple[float, ...] | None = None
    mean_edge_length: float | None = None
    area: float | None = None
    volume: float | None = None
    resolution: float | None = None
    noise: float | None = None
    error: ErrorKind | None = None
    treated_as: MeshTreatment | None = None
    treads: Treads | None = None
    bumps: Bumps | None = None

    @property
    def findings(self) -> dict[str, Found]:
        """Findings with at least one location, by name."""
        found = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in found.items() if isinstance(value, Found) and value.count}


def inspect(mesh: Any, faces: ArrayLike | None = None, *, self_intersections: bool | None = None) -> Inspection:
    """Inspect a mesh; defects that prevent denoising are reported here instead of raising errors.

    Parameters
    ----------
    mesh
        Vertices as an (n, 3) array, together with `faces`; or a path, a binary stream, a file that was read, a
        `cascadenorm.Mesh`, or a mesh of trimesh, pyvista, vtk, open3d or meshio.
    faces
        (m, 3) integers.
    self_intersections
        Whether to look for faces that cross each other. None does so for up to 200,000 faces.

    Returns
    -------
    Counts, locations of the defects, sizes in mesh units, and the estimated noise in mean edge lengths.

    Raises
    ------
    ReadError
        A file cannot be read.
    MeshError
        Arrays have the wrong shape or type.
    """
    given = taken(mesh, faces)
    corners, count = given.faces, len(given.vertices)
    outside = np.asarray((corners < 0) | (corners >= count))
    out_of_range, not_finite = any_in_rows(outside), bad_vertices(given.vertices)
    bad = bad_faces(given.vertices, corners)
    used = marked(np.where(outside, count, corners), count + 1)
    whole = None if bad.any() else given.mesh
    report = {} if bad.all() else _shape(given, whole or isolated(given.vertices, corners), ~bad, self_intersections)
    return Inspection(
        source=given.source,
        number_type=given.number_type,
        counts_from=given.counts_from,
        vertices=count,
        file_vertices=given.file_vertices,
        faces=len(corners),
        bad_indices=given.at_faces(out_of_range),
        not_finite=given.at_vertices(not_finite),
        repeated_corners=given.at_faces(~out_of_range & repeats_vertex(corners)),
        unreferenced=given.at_vertices(~used[:-1]),
        duplicate_vertices=given.at_vertices(repeats(given.vertices)[0] & ~not_finite),
        **report,
    )


def _shape(given: GivenMesh, mesh: Mesh, good: Bools, self_intersections: bool | None) -> dict[str, Any]:
    """Return the properties that depend on the good faces, of which `mesh` consists."""
    small, exponent = in_frame(mesh)
    topology, around = mesh.topology, mesh.topology.edge_faces.counts
    numbered = given._replace(face_numbers=given.face_numbers[good])
    pinched = pinched_vertices(topology)
    parts = enclosed(small, pinched)
    flat, thin = thin_faces(small)
    looks = len(mesh.faces) <= MOST_FACES_CROSSED if self_intersections is None else self_intersections
    crossing = crossing_faces(small) if looks else None
    every, repeated = np.arange(len(mesh.faces)), repeats(np.sort(mesh.faces, axis=1))[0]
    lower, upper = mesh.box
    step = float(np.spacing(np.abs([lower, upper]).max().astype(given.number_type)))
    edge, facing = _scaled(small.mean_edge_length, exponent), oriented(without_repeated_faces(small))
    return {
        "parts": component_count(mesh),
        "closed": bool((around > 1).all()),
        "boundary_loops": boundary_loop_count(topology),
        "boundary_edges": int((around == 1).sum()),
        "non_manifold_edges": numbered.at_edges(topology.edges[around > 2]),
        "non_manifold_vertices": numbered.at_vertices(pinched),
        "flipped_edges": numbered.at_edges(topology.edges[flipped_edges(topology)]),
        "inside_out": numbered.at_faces(np.isin(every, parts.faces[parts.volumes < 0])),
        "zero_area": numbered.at_faces(flat),
        "slivers": numbered.at_faces(thin),
        "nearly_coincident": numbered.at_vertices(nearly_coincident(small)),
        "duplicate_faces": numbered.at_faces(repeated),
        "crossing_faces": None if crossing is None else numbered.at_faces(crossing & ~repeated),
        "spikes": numbered.at_vertices(spikes(facing)),
        "outliers": numbered.at_vertices(outliers(facing)),
        "folded_edges": int(folded_edges(facing).sum()),
        "small_components": numbered.at_faces(np.isin(every, small_components(mesh)[1])),
        "euler_characteristic": int(topology.used_vertices.sum()) - len(topology.edges) + len(mesh.faces),
        "genus": int((2 - parts.characteristics[parts.manifold]).sum() // 2) if parts.manifold.any() else None,
        "lower": tuple(lower.tolist()),
        "upper": tuple(upper.tolist()),
        "mean_edge_length": edge,
        "area": _scaled(small.area, 2 * exponent),
        "volume": _scaled(float(parts.volumes.sum()), 3 * exponent) if len(parts.volumes) else None,
        "resolution": step / edge if edge and np.isfinite(step / edge) else None,
        "treads": treads(facing),
        "bumps": bumps(facing) if len(mesh.faces) <= MOST_FACES_DENOISED else None,
        **_noise_and_error(mesh, small, noise_level(facing)),
    }


def _noise_and_error(mesh: Mesh, small: Mesh, noise: float | None) -> dict[str, Any]:
    """Return noise, kind of error and kind of surface, determined as in `denoise`.

    `small` is the mesh in its frame, and `noise` is estimated from the mesh alone.
    """
    if len(mesh.faces) > MOST_FACES_DENOISED or not small.mean_edge_length**2 > 0:
        return {"noise": noise, "error": None, "treated_as": None}
    auto = find("auto")
    found = detected_error(auto, run_with_controls(auto, mesh, {}, checked_controls({})), {})
    # Without enough interior edges for an estimate, an error that `auto` finds is still the noise.
    known = noise is not None or found["error"].size >= LEAST_ERROR
    return {"noise": found["error"].size if known else None, **found}


def _scaled(value: float, exponent: int) -> float | None:
    """Return value · 2**exponent, or None if it overflows."""
    with np.errstate(over="ignore"):
        scaled = float(np.ldexp(value, exponent))
    return scaled if np.isfinite(scaled) else None


def new_faults(before: Mesh, after: Mesh) -> dict[str, tuple[int, int]]:
    """Return the counts of `surface_faults` that a result has more of, before and after.

    Crossing faces are only searched for if there are more spikes or folded edges, since the search takes a quarter of
    the time of a denoising.
    """

    def increased(*, crossings: bool) -> dict[str, tuple[int, int]]:
        first, last = (surface_faults(mesh, crossings=crossings) for mesh in (before, after))
        counts = {name: (first[name] or 0, last[name] or 0) for name in last}
        return {name: (old, new) for name, (old, new) in counts.items() if new > old}

    return increased(crossings=True) if increased(crossings=False) else {}


def surface_faults(mesh: Mesh, *, crossings: bool = True) -> dict[str, int | None]:
    """Count the crossing faces, spikes and folded edges of the mesh without repeated faces.

    Crossing faces are None if they are not wanted or the mesh has more than MOST_FACES_CROSSED faces.
    """
    small, _ = in_frame(mesh)
    surface = without_repeated_faces(small)
    searched = crossings and len(surface.faces) <= MOST_FACES_CROSSED
    return {
        "crossing_faces": int(crossing_faces(surface).sum()) if searched else None,
        "spikes": int(spikes(surface).sum()),
        "folded_edges": int(folded_edges(surface).sum()),
    }
