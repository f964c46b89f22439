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


def cylinder(sides: int, height: float = 2.0) -> Mesh:
    """A closed cylinder as CAD kernels triangulate one: long strips around, fans at both ends."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    vertices = np.concatenate([ring, ring + np.array([0, 0, height])])
    a, b = np.arange(sides), np.roll(np.arange(sides), -1)
    strips = [np.stack([a, b, b + sides], axis=1), np.stack([a, b + sides, a + sides], axis=1)]
    fan = np.stack([np.zeros(sides - 2, int), a[1:-1], a[2:]], axis=1)
    return Mesh(vertices, np.concatenate([*strips, fan[:, ::-1], fan + sides]))


def torus(rows: int, columns: int, *, waves: float = 0.0) -> Mesh:
    """A torus, its tube of a radius that may vary along it."""
    u, v = np.meshgrid(*(2 * np.pi * np.arange(k) / k for k in (rows, columns)), indexing="ij")
    tube = 0.3 * (1 + waves * np.sin(4 * u) * np.sin(3 * v))
    reach = 1 + tube * np.cos(v)
    vertices = np.stack([reach * np.cos(u), reach * np.sin(u), tube * np.sin(v)], axis=-1).reshape(-1, 3)
    i, k = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a, b = i * columns + k, (i + 1) % rows * columns + k
    c, d = (i + 1) % rows * columns + (k + 1) % columns, i * columns + (k + 1) % columns
    return Mesh(vertices, np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))]))


def coil(turns: float, steps: int) -> Mesh:
    """A square bar along a helix: all its vertices are on sharp edges."""
    s = np.linspace(0, 2 * np.pi * turns, steps)[:, None]
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * 0.1
    reach, rise = 1 + corners[:, 0], corners[:, 1] + 0.08 * s
    vertices = np.stack([reach * np.cos(s), reach * np.sin(s), rise], axis=-1).reshape(-1, 3)
    a = (4 * np.arange(steps - 1)[:, None] + np.arange(4)).ravel()
    b = (4 * np.arange(steps - 1)[:, None] + np.roll(np.arange(4), -1)).ravel()
    walls = np.concatenate([np.stack([a, a + 4, b + 4], axis=1), np.stack([a, b + 4, b], axis=1)])
    last = 4 * (steps - 1)
    ends = np.array([(0, 1, 2), (0, 2, 3), (last, last + 2, last + 1), (last, last + 3, last + 2)])
    return Mesh(vertices, np.concatenate([walls, ends]))


def ball_of_voxels(radius: float, *, stretch: float = 1.0) -> np.ndarray:
    nodes = np.stack(np.meshgrid(*[np.arange(30) - 14.7] * 3, indexing="ij"), axis=-1)
    return np.linalg.norm(nodes * (1, 1, stretch), axis=-1) < radius


def cubes(inside: np.ndarray) -> Mesh:
    """The squares between voxels inside and outside, two triangles each."""
    padded, corners = np.pad(inside, 1).astype(np.int8), []
    for axis in range(3):
        u, v = (np.eye(3)[(axis + k) % 3] for k in (1, 2))
        for sign in (1, -1):
            low = np.argwhere(np.diff(padded, axis=axis) == -sign) + np.eye(3)[axis]
            square = np.stack([low, low + u, low + u + v, low + v], axis=1)
            corners.append(square if sign > 0 else square[:, ::-1])
    square = np.concatenate(corners)
    vertices, which = np.unique(square.reshape(-1, 3), axis=0, return_inverse=True)
    a, b, c, d = which.reshape(-1, 4).T
    return Mesh(vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]))


def noisy(mesh: Mesh, level: float, *, seed: int = 0) -> Mesh:
    """Return the mesh with Gaussian noise in all directions, `level` mean edge lengths strong."""
    noise = np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    return mesh.moved(mesh.vertices + level * mesh.mean_edge_length * noise)


def mean_angle(mesh: Mesh, true: Mesh) -> float:
    """Mean angle between the normals of the same faces of two meshes, in degrees."""
    return float(np.degrees(np.arccos(np.clip((mesh.face_normals * true.face_normals).sum(axis=1), -1, 1))).mean())


def signed_area(points: np.ndarray) -> float:
    x, y = points.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def signed_volume(mesh: Mesh) -> float:
    """What a closed mesh encloses, positive where its normals point outward (divergence theorem)."""
    return float(np.einsum("ij,ij->", mesh.centroids, mesh.area_vectors) / 3)


def side_by_side(*meshes: Mesh) -> Mesh:
    """Return meshes as the components of one, a hundred units apart."""
    return together(*(mesh.moved(mesh.vertices + 100.0 * i) for i, mesh in enumerate(meshes)))


def together(*meshes: Mesh) -> Mesh:
    """Join meshes into one of several parts."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


def flipped(before: Mesh, vertices: np.ndarray) -> np.ndarray:
    """Faces whose normal is 90° or more from what it was; a face without area has none."""
    turn = np.einsum("ij,ij->i", before.moved(vertices).area_vectors, before.area_vectors)
    return (turn <= 0) & (before.areas > 0)
