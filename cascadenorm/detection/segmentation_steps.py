"""Steps of a binary mask, told from the shape of a mesh where its voxels are not known any more."""

import numpy as np

from cascadenorm.detection.chords import rises
from cascadenorm.detection.parts import Found, Part, Surface, added, in_parts
from cascadenorm.detection.rounding import rounding
from cascadenorm.detection.voxel_lattice import lattice_share
from cascadenorm.mesh import (
    Bools,
    Floats,
    Mesh,
    Vectors,
    angles_between,
    any_in_rows,
    kernel,
    row_distances,
    scatter_add,
    sums_in_blocks,
)
from cascadenorm.mesh.averages import averaged
from cascadenorm.mesh.vectors import dot, row

LATTICE = 0.5
"""Share of the edges that the most frequent vectors hold (see `lattice_share`), from which a mesh lies on a lattice.

Decimated meshes and surface nets have fewer than those of marching cubes, which have 0.95."""
STEPS = 0.2
"""Share of the bends that cancel within two rings, from which a mesh has steps: a step has an edge of either sign."""
IN_PLANES = 0.03
"""Share of the vertices whose faces all lie in one plane, as on the treads of steps; CAD kernels make none."""
ALL_STEPS = 0.65
"""The share of bends from which the vertices do not matter, which a decimation may have removed from the planes."""
ALONG_AXES = 0.98
"""Share of the area whose normals lie along three perpendicular directions, from which faces are those of voxels."""


def is_segmentation(mesh: Mesh | Surface) -> bool:
    """Whether the edges are few vectors repeated and bend to and fro, and vertices lie inside of planes."""
    surface = in_parts(mesh)
    if lattice_share(surface) < LATTICE:
        return False
    sums = added(surface.each("steps", 5, _steps))
    if sums["total"] == 0:  # nothing bends
        return False
    steps = 1 - sums["left"] / sums["total"]
    return bool(steps >= ALL_STEPS or (steps >= STEPS and sums["in planes"] / sums["vertices"] >= IN_PLANES))


def has_voxel_faces(mesh: Mesh | Surface) -> bool:
    """Whether a mesh consists of the faces of the voxels of a segmentation (cuberille; Herman, Liu 1979)."""
    surface = in_parts(mesh)
    first = _normal_of_largest(surface, "first axis", np.zeros(3))
    second = None if first is None else _normal_of_largest(surface, "second axis", first)
    if first is None or second is None:
        return False
    axes = np.stack([first, second, np.cross(first, second)])

    def along_axes(part: Part) -> Found:
        own, areas, normals = part.faces, part.mesh.areas, part.mesh.face_normals

        def add(start: int, stop: int, sums: Floats) -> None:
            _along_range(start, stop, own, areas, normals, axes, sums)

        return dict(zip(("area", "along"), sums_in_blocks(len(own), (2,), add), strict=True))

    sums = added(surface.each("along axes", 1, along_axes))
    return bool(sums["along"] >= ALONG_AXES * sums["area"]) and is_segmentation(surface)


def without_voxel_faces(mesh: Mesh) -> Mesh:
    """Move each vertex of a mesh of voxel faces to the mean of the centroids around it; any other stays as it is.

    The normals of voxel faces have three directions, whatever the shape; after one average they tell where it leads.
    """
    return mesh.moved(mean_centroids(mesh)) if has_voxel_faces(mesh) else mesh


def mean_centroids(mesh: Mesh) -> Vectors:
    """Return the mean of the centroids around each vertex, (n, 3); a vertex without a face stays."""
    around = mesh.topology.vertex_faces
    sums = scatter_add(mesh.faces.ravel(), np.repeat(mesh.centroids, 3, axis=0), len(mesh.vertices))
    used = mesh.topology.used_vertices[:, None]
    return np.where(used, sums / np.maximum(around.counts, 1)[:, None], mesh.vertices)


def _normal_of_largest(surface: Surface, name: str, across: Vectors) -> Vectors | None:
    """Return the normal of the largest of the faces that are perpendicular to a vector; None where none has area."""

    def largest(part: Part) -> Found:
        areas, normals = part.mesh.areas, part.mesh.face_normals
        one = _largest(part.faces, areas, normals, across)
        return {"area": areas[one] if one >= 0 else np.array(0.0), "normal": normals[one]}

    found = max((found for _, found in surface.each(name, 1, largest)), key=lambda found: float(found["area"]))
    return found["normal"] if found["area"] > 0 else None


def _steps(part: Part) -> Found:
    """Sum over the vertices of a part what tells of steps.

    Returns
    -------
    total, left : bends, angles times lengths of edges, and what is left of them where those of the other sign within
        two rings cancel them
    vertices, in planes : how many vertices have faces, and of how many these all lie in one plane, to 0.03 degrees
    """
    mesh, topology = part.mesh, part.mesh.topology
    has_area = any_in_rows(mesh.face_normals != 0)
    bends = has_area[topology.face_pairs].all(axis=1)
    pairs, ends = topology.face_pairs[bends], topology.edges[topology.interior_edges[bends]]
    rise = rises(mesh, pairs)
    length, angle = row_distances(mesh.vertices, ends), angles_between(*mesh.face_normals[pairs.T])
    bend = length * angle * (np.abs(rise) > rounding(mesh))
    signed = np.stack([np.copysign(bend, rise), bend], axis=1)
    at_vertices = scatter_add(ends.ravel(), np.repeat(signed, 2, axis=0), len(mesh.vertices))
    left, total = np.abs(averaged(at_vertices, topology.vertex_neighbors, 2)[part.vertices]).T

    least = np.ones(len(mesh.vertices))
    cosines = np.einsum("ijk,ik->ij", mesh.vertex_normals[mesh.faces], mesh.face_normals)
    np.minimum.at(least, mesh.faces, cosines)
    used = part.vertices & topology.used_vertices
    return {
        "left": left.sum(),
        "total": total.sum(),
        "vertices": np.count_nonzero(used),
        "in planes": np.count_nonzero(least[used] > 1 - 1e-7),
    }


@kernel
def _largest(own: Bools, areas: Floats, normals: Vectors, across: Vectors) -> int:
    """Number of the largest of a part's own faces whose normal is perpendicular to a vector; -1 where none has area."""
    found, most = -1, 0.0
    for f in range(len(own)):
        if own[f] and areas[f] > most and abs(dot(row(normals, f), across)) < 1e-3:
            found, most = f, areas[f]
    return found


@kernel
def _along_range(
    start: int, stop: int, own: Bools, areas: Floats, normals: Vectors, axes: Vectors, sums: Floats
) -> None:
    """Add to the sums the area of a part's own faces, and that of those whose normals lie along an axis."""
    for f in range(start, stop):
        if own[f]:
            sums[0] += areas[f]
            for axis in range(3):
                if abs(dot(row(normals, f), axes[axis])) > 1 - 1e-4:
                    sums[1] += areas[f]
                    break
