"""Plain numpy twins of the kernels, written from the papers, slow."""

import numpy as np

from cascadenorm.mesh import Csr, Mesh, unit


def gauss(distance, spread):
    return np.exp(-0.5 * (distance / spread) ** 2)


def length(vectors):
    return np.linalg.norm(vectors, axis=-1)


def joint_bilateral_pass(mesh: Mesh, guide, neighbors: Csr, *, sigma_s, sigma_r, count_self):
    n, c, a = mesh.normals, mesh.centroids, mesh.areas
    out = n.copy()
    for f in range(len(n)):
        g = np.append(neighbors.row(f), f) if count_self else neighbors.row(f)
        w = (
            a[g]
            * gauss(length(c[g] - c[f]), sigma_s * mesh.mean_edge_length)
            * gauss(length(guide[g] - guide[f]), sigma_r)
        )
        out[f] = unit(w @ n[g], otherwise=n[f])
    return out


def patch_statistics(mesh: Mesh, rings: Csr):
    n, a = mesh.normals, mesh.areas
    pairs = [faces for faces in map(mesh.topology.edge_faces.row, range(len(mesh.topology.edges))) if len(faces) == 2]
    inconsistency, means = np.empty(len(n)), np.empty_like(n)
    for f in range(len(n)):
        patch = np.append(rings.row(f), f)
        inside = [length(n[g] - n[h]) for g, h in pairs if g in patch and h in patch]
        widest = length(n[patch][:, None] - n[patch]).max()
        inconsistency[f] = widest * max(inside, default=0) / (1e-9 + sum(inside))
        means[f] = unit(a[patch] @ n[patch])
    return inconsistency, means


def cotangent_edge_operator(p1, p2, p3, p4):
    """The coefficients of He & Schaefer (2013), equation 5."""

    def cot(a, b, c):  # at b
        u, v = a - b, c - b
        return u @ v / length(np.cross(u, v))

    return np.array(
        [
            -cot(p2, p3, p1) - cot(p1, p3, p4),
            cot(p2, p3, p1) + cot(p3, p1, p2),
            -cot(p3, p1, p2) - cot(p4, p1, p3),
            cot(p1, p3, p4) + cot(p4, p1, p3),
        ]
    )


def area_edge_operator(p1, p2, p3, p4):
    """The coefficients of He & Schaefer (2013), equation 7, as they are printed."""

    def area(a, b, c):
        return 0.5 * length(np.cross(b - a, c - a))

    a123, a134 = area(p1, p2, p3), area(p1, p3, p4)
    squared, total = (p3 - p1) @ (p3 - p1), a123 + a134
    return np.array(
        [
            (a123 * (p4 - p3) @ (p3 - p1) + a134 * (p1 - p3) @ (p3 - p2)) / (squared * total),
            a134 / total,
            (a123 * (p3 - p1) @ (p1 - p4) + a134 * (p2 - p1) @ (p1 - p3)) / (squared * total),
            a123 / total,
        ]
    )


def l0_system(noisy, vertices, quads, coefficients, *, alpha, beta, price):
    """Dense I + αRᵀR + βDᵀD, and x* + βDᵀδ."""
    difference, evenness = np.zeros((2, len(quads), len(vertices)))
    for e, quad in enumerate(quads):
        difference[e, quad] = coefficients[e]
        evenness[e, quad] = 1, -1, 1, -1
    bend = difference @ vertices
    bend[beta * (bend**2).sum(axis=1) <= price] = 0
    matrix = np.eye(len(vertices)) + alpha * evenness.T @ evenness + beta * difference.T @ difference
    return matrix, noisy + beta * difference.T @ bend
