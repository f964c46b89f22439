"""Vertices that fit given face normals (Sun et al. 2007; Zheng et al. 2011), without folding a face over."""

from typing import Annotated, Literal

import numpy as np

from cascadenorm.mesh import Mesh, Vectors, kernel, over
from cascadenorm.registry import Parameter

Sweeps = Annotated[int, Parameter("Gauss-Seidel sweeps of the vertex update", minimum=0)]


def recover_vertices(
    mesh: Mesh, normals: Vectors, *, sweeps: int = 20, folds: Literal["avoid", "ignore"] = "avoid"
) -> Vectors:
    """Move vertices until the faces take the given normals: x_i += (1/N_i) Σ_{f∋i} <n_f, c_f - x_i> n_f.

    Parameters
    ----------
    mesh : n vertices, m faces
    normals : (m, 3), unit; a face with a zero row does not pull
    sweeps : Gauss-Seidel sweeps, over one group of vertices that share no face after the other; 0 returns a copy of
        the vertices
    folds : "ignore" is the plain update; "avoid" shortens a step that would turn a face against its normal, and
        pulls the vertices of a face that is turned already toward the middle of their neighbours until it lies right

    Returns
    -------
    (n, 3) float64; a vertex without a face stays
    """
    vertices = mesh.vertices.copy()
    around, colors = mesh.topology.vertex_faces, mesh.topology.vertex_colors
    for _ in range(sweeps):
        for color in range(len(colors.counts)):
            mine = colors.row(color)
            over(len(mine), _sweep_range, mine, vertices, mesh.faces, normals, *around, folds == "avoid")
    return vertices


@kernel
def _sweep_range(start, stop, movable, vertices, faces, normals, vf_indptr, vf_indices, avoid_folds):  # type: ignore[no-untyped-def]
    """Move vertices that share no face, in place; those moved later see where these went."""
    step, target = np.empty(3), np.empty(3)
    for i in movable[start:stop]:
        first, last = vf_indptr[i], vf_indptr[i + 1]
        step[:] = 0.0
        for k in range(first, last):
            f = vf_indices[k]
            a, b, c = faces[f]
            pull = 0.0
            for d in range(3):
                center = (vertices[a, d] + vertices[b, d] + vertices[c, d]) / 3.0
                pull += normals[f, d] * (center - vertices[i, d])
            for d in range(3):
                step[d] += pull * normals[f, d]
        step /= last - first
        if not avoid_folds:
            vertices[i] += step
            continue
        turned = _turned(vertices, faces, normals, vf_indices[first:last], i, vertices[i])
        if turned > 0:
            _add_tangential_pull(vertices, faces, normals, vf_indices[first:last], i, step)
        for _ in range(4):
            target[:] = vertices[i] + step
            if _turned(vertices, faces, normals, vf_indices[first:last], i, target) <= turned:
                vertices[i] = target
                break
            step *= 0.5


@kernel
def _turned(vertices, faces, normals, around, i, position):  # type: ignore[no-untyped-def]
    """Count the faces around vertex i that would lie against their normal if it were at `position`."""
    count = 0
    for f in around:
        a, b, c = faces[f]
        while a != i:
            a, b, c = b, c, a
        ux, uy, uz = vertices[b, 0] - position[0], vertices[b, 1] - position[1], vertices[b, 2] - position[2]
        vx, vy, vz = vertices[c, 0] - position[0], vertices[c, 1] - position[1], vertices[c, 2] - position[2]
        signed = (
            normals[f, 0] * (uy * vz - uz * vy)
            + normals[f, 1] * (uz * vx - ux * vz)
            + normals[f, 2] * (ux * vy - uy * vx)
        )
        count += signed < 0
    return count


@kernel
def _add_tangential_pull(vertices, faces, normals, around, i, step):  # type: ignore[no-untyped-def]
    """Add half the way to the mean of the neighbours, less its part along the mean normal."""
    mean, normal = np.zeros(3), np.zeros(3)
    for f in around:
        normal += normals[f]
        for corner in range(3):
            if faces[f, corner] != i:
                mean += vertices[faces[f, corner]]
    mean /= 2.0 * len(around)
    pull = mean - vertices[i]
    squared = (normal * normal).sum()
    if squared > 0:
        pull -= normal * ((pull * normal).sum() / squared)
    step += 0.5 * pull
