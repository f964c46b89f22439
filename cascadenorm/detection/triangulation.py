"""Features of a triangulation that reveal how a mesh was generated.

Marching cubes, camera grids, octrees and fused volumes have characteristic valences, lengths and angles. So do
decimation, subdivision and tessellation.
"""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Floats, Mesh, angles_between, any_in_rows

SAMPLED_FACES = 20_000  # largest number of faces evaluated; larger components are sampled
VALENCES = range(3, 9)
COPLANAR_DEGREES = 0.02, 0.2  # angles in degrees below which adjacent faces count as coplanar and as nearly coplanar
FREQUENT_SHAPES = 4, 16  # numbers of most frequent triangle shapes whose share is measured; lattices repeat few shapes
SAME = 0.01  # bin width in mean lengths for the sides of triangles of the same shape
LENGTH_BINS = 1 << 21  # bins of side lengths; longer sides share the last bin, so that three sides form one 64-bit key
FIGURES = (
    "open sides",
    *("deviation of lengths", *(f"length at {share:.0%}" for share in (0.02, 0.1, 0.5, 0.9, 0.98))),
    *(f"valence {valence}" for valence in VALENCES),
    "valence above 8",
    *(f"smallest angle at {share:.0%}" for share in (0.05, 0.25, 0.5, 0.75)),
    *(f"largest angle at {share:.0%}" for share in (0.25, 0.5, 0.75, 0.95)),
    *(f"most frequent {count} shapes" for count in FREQUENT_SHAPES),
    *(f"bends below {bend}°" for bend in COPLANAR_DEGREES),
    "faces inside planes",
    *(f"bend at {share:.0%}" for share in (0.1, 0.25, 0.5, 0.75, 0.9)),
)
"""Names of the features that `triangulation_figures` returns, in order."""


def triangulation_figures(mesh: Mesh, faces: NDArray[np.intp]) -> Floats:
    """Measure valences, lengths, angles and bends of some faces of a mesh, given by at least one index.

    The features, (32,) in the order of FIGURES, are invariant to scale, rotation and translation. Lengths are relative
    to their mean; angles and bends are in degrees. Of more than SAMPLED_FACES faces, a random sample is used.
    """
    if len(faces) > SAMPLED_FACES:
        faces = np.sort(np.random.default_rng(0).choice(faces, SAMPLED_FACES, replace=False))
    corners = mesh.vertices[mesh.faces[faces]]
    sides = np.roll(corners, -1, axis=1) - corners
    lengths = np.linalg.norm(sides, axis=2)
    of_sides, of_valences = _side_figures(mesh, faces, lengths), _valence_figures(mesh, faces)
    of_angles, of_shapes = _angle_figures(sides, lengths), _shape_figures(lengths)
    return np.concatenate([of_sides, of_valences, of_angles, of_shapes, _bend_figures(mesh, faces)])


def _side_figures(mesh: Mesh, faces: NDArray[np.intp], lengths: Floats) -> Floats:
    relative = lengths / max(float(lengths.mean()), np.finfo(float).tiny)
    single = mesh.topology.edge_faces.counts[mesh.topology.face_edges[faces]] == 1
    return np.array([single.mean(), relative.std(), *np.quantile(relative, [0.02, 0.1, 0.5, 0.9, 0.98])])


def _valence_figures(mesh: Mesh, faces: NDArray[np.intp]) -> Floats:
    """Return the fractions of the corners at vertices of each valence."""
    valences = mesh.topology.vertex_neighbors.counts[mesh.faces[faces]]
    return np.array([*((valences == valence).mean() for valence in VALENCES), (valences > VALENCES[-1]).mean()])


def _angle_figures(sides: Floats, lengths: Floats) -> Floats:
    ahead, back = sides, -np.roll(sides, 1, axis=1)
    products = np.maximum(lengths * np.roll(lengths, 1, axis=1), np.finfo(float).tiny)
    cosines = np.einsum("ijk,ijk->ij", ahead, back) / products
    angles = np.sort(np.degrees(np.arccos(np.clip(cosines, -1, 1))), axis=1)
    smallest = np.quantile(angles[:, 0], [0.05, 0.25, 0.5, 0.75])
    return np.concatenate([smallest, np.quantile(angles[:, 2], [0.25, 0.5, 0.75, 0.95])])


def _shape_figures(lengths: Floats) -> Floats:
    """Return the fractions of the triangles with the most frequent shapes."""
    mean = max(float(lengths.mean()), np.finfo(float).tiny)
    shapes = np.minimum(np.round(np.sort(lengths, axis=1) / (SAME * mean)), LENGTH_BINS - 1).astype(np.int64)
    keys = (shapes[:, 0] * LENGTH_BINS + shapes[:, 1]) * LENGTH_BINS + shapes[:, 2]
    counts = np.sort(np.unique(keys, return_counts=True)[1])[::-1]
    return np.array([counts[:count].sum() / len(lengths) for count in FREQUENT_SHAPES])


def _bend_figures(mesh: Mesh, faces: NDArray[np.intp]) -> Floats:
    """Measure the angles between faces across manifold edges; a surface without such edges counts as flat."""
    across = mesh.topology.faces_across[faces]
    normals = mesh.face_normals
    has_normal = any_in_rows(normals != 0)
    known = (across >= 0) & has_normal[across] & has_normal[faces][:, None]
    if not known.any():
        return np.array([*np.ones(len(COPLANAR_DEGREES)), 1.0, *np.zeros(5)])
    rows, columns = np.nonzero(known)
    bends = np.zeros(across.shape)
    bends[known] = np.degrees(angles_between(normals[faces[rows]], normals[across[rows, columns]]))
    inside = (bends < COPLANAR_DEGREES[1]).all(axis=1).mean()
    bends = bends[known]
    shares = [(bends < limit).mean() for limit in COPLANAR_DEGREES]
    return np.array([*shares, inside, *np.quantile(bends, [0.1, 0.25, 0.5, 0.75, 0.9])])
