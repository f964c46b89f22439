"""Meshes for the benchmarks of speed."""

import numpy as np

from cascadenorm.mesh import Mesh

NOISE = 0.2
"""Standard deviation along the normals, in mean edge lengths."""
MILLION = 1000, 500
"""Steps of a torus of a million faces."""


def wavy_torus(around: int, across: int) -> Mesh:
    """Make a closed mesh of 2 · around · across faces, with noise."""
    u, v = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.arange(across) * 2 * np.pi / across, indexing="ij")
    normal = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1)
    middle = np.stack([np.cos(u), np.sin(u), np.zeros_like(u)], axis=-1)
    vertices = (middle + (0.5 + 0.02 * np.sin(9 * u) * np.sin(7 * v))[..., None] * normal).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = i * across + j, (i + 1) % around * across + j
    c, d = (i + 1) % around * across + (j + 1) % across, i * across + (j + 1) % across
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    mesh = Mesh(vertices, faces)
    size = np.random.default_rng(0).normal(scale=NOISE * mesh.mean_edge_length, size=len(vertices))
    return mesh.moved(vertices + size[:, None] * normal.reshape(-1, 3))


def shuffled(mesh: Mesh) -> Mesh:
    """Return a mesh with its vertices and faces in an arbitrary order."""
    random = np.random.default_rng(0)
    order = random.permutation(len(mesh.vertices))
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return Mesh(mesh.vertices[order], rank[random.permutation(mesh.faces)])
