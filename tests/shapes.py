"""Analytic meshes for the tests."""

import numpy as np

from cascadenorm.mesh import Mesh, unit


def icosphere(level: int) -> Mesh:
    """Return the unit sphere as an icosahedron with each face split in four `level` times."""
    phi = (1 + 5**0.5) / 2
    vertices = np.array([(s, t * phi, 0) for s in (-1, 1) for t in (-1, 1)])
    vertices = np.concatenate([vertices, np.roll(vertices, 1, axis=1), np.roll(vertices, 2, axis=1)])
    near = np.linalg.norm(vertices[:, None] - vertices, axis=2) < 2.1
    faces = np.array(
        [(a, b, c) for a in range(12) for b in range(a) for c in range(b) if near[a, b] and near[b, c] and near[a, c]]
    )
    inward = np.einsum("ij,ij->i", np.cross(*np.moveaxis(vertices[faces], 1, 0)[:2]), vertices[faces[:, 2]]) < 0
    faces[inward] = faces[inward, ::-1]
    for _ in range(level):
        sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        edges, which = np.unique(sides, axis=0, return_inverse=True)
        middle = which.reshape(-1, 3) + len(vertices)
        vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
        (a, b, c), (ab, bc, ca) = faces.T, middle.T
        faces = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return Mesh(unit(vertices), faces)


def grid(rows: int, columns: int) -> Mesh:
    """Return a flat rectangle of unit squares in the plane z = 0, each split along one diagonal, normals upward."""
    y, x = np.mgrid[: rows + 1, : columns + 1]
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    a, b, c, d = corner, corner + 1, corner + columns + 2, corner + columns + 1
    return Mesh(vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]))


def cube(steps: int) -> Mesh:
    """Return the cube from -1 to 1, each side `steps` × `steps` squares of two triangles."""
    side = grid(steps, steps)
    u = side.vertices * 2 / steps - (1, 1, -1)
    turns = [np.roll(np.eye(3), k, axis=1) for k in range(3)]
    parts = [u @ turn for turn in turns] + [(u * (-1, 1, -1)) @ turn for turn in turns]
    vertices, which = np.unique(np.round(np.concatenate(parts), 12), axis=0, return_inverse=True)
    faces = np.concatenate([side.faces + i * len(u) for i in range(6)])
    return Mesh(vertices, which.reshape(-1)[faces])


def noisy(mesh: Mesh, level: float, *, seed: int = 0) -> Mesh:
    """Return the mesh with Gaussian noise in all directions, `level` mean edge lengths strong."""
    noise = np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    return mesh.moved(mesh.vertices + level * mesh.mean_edge_length * noise)


def mean_angle(mesh: Mesh, true: Mesh) -> float:
    """Mean angle between the normals of the same faces of two meshes, in degrees."""
    return float(np.degrees(np.arccos(np.clip((mesh.face_normals * true.face_normals).sum(axis=1), -1, 1))).mean())


def signed_volume(mesh: Mesh) -> float:
    """What a closed mesh encloses, positive where its normals point outward (divergence theorem)."""
    return float(np.einsum("ij,ij->", mesh.centroids, mesh.area_vectors) / 3)
