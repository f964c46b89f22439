"""Plain numpy twins of the kernels, written from the papers, slow."""

import numpy as np
from scipy.sparse.csgraph import dijkstra

from cascadenorm.mesh import Csr, Mesh, unit


def gauss(distance, spread):
    return np.exp(-0.5 * (distance / spread) ** 2)


def length(vectors):
    return np.linalg.norm(vectors, axis=-1)


def joint_bilateral_pass(mesh: Mesh, guide, neighbors: Csr, *, sigma_s, sigma_r, count_self):
    n, c, a = mesh.face_normals, mesh.centroids, mesh.areas
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
    n, a = mesh.face_normals, mesh.areas
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


def pairs_within(mesh: Mesh, radius):
    """Which faces reach each other by steps over shared vertices within `radius` mean edge lengths, from both sides."""
    near = length(mesh.centroids[:, None] - mesh.centroids) <= radius * mesh.mean_edge_length
    touching = (mesh.faces[:, None, :, None] == mesh.faces[None, :, None, :]).any(axis=(2, 3))
    reached = np.eye(len(near), dtype=bool)
    for f in range(len(near)):
        while (grown := near[f] & touching[reached[f]].any(axis=0)).sum() > reached[f].sum():
            reached[f] = grown
    return reached & reached.T & ~np.eye(len(near), dtype=bool)


def static_dynamic_weights(mesh: Mesh, guide, *, smoothness, sigma_s, sigma_g):
    """Dense λ' (A_f + A_g) φ(distance) φ(guidance) of Zhang et al. (2018)."""
    a, spread = mesh.areas, sigma_s * mesh.mean_edge_length
    spatial = pairs_within(mesh, 3 * sigma_s) * (a[:, None] + a)
    spatial = spatial * gauss(length(mesh.centroids[:, None] - mesh.centroids), spread)
    scale = smoothness * a.sum() / (0.5 * spatial.sum())
    return scale * spatial * gauss(length(guide[:, None] - guide), sigma_g)


def static_dynamic_pass(mesh: Mesh, guide, normals, *, smoothness, sigma_s, sigma_g, sigma_r):
    weights = static_dynamic_weights(mesh, guide, smoothness=smoothness, sigma_s=sigma_s, sigma_g=sigma_g)
    weights = weights * gauss(length(normals[:, None] - normals), sigma_r) / (2 * sigma_r**2)
    return unit(mesh.areas[:, None] * mesh.face_normals + weights @ normals)


def static_dynamic_energy(mesh: Mesh, guide, normals, *, smoothness, sigma_s, sigma_g, sigma_r):
    weights = static_dynamic_weights(mesh, guide, smoothness=smoothness, sigma_s=sigma_s, sigma_g=sigma_g)
    robust = 0.5 * (weights * (1 - gauss(length(normals[:, None] - normals), sigma_r))).sum()
    return mesh.areas @ length(normals - mesh.face_normals) ** 2 + robust


def unilateral_pass(n, rings: Csr, threshold):
    out = np.empty_like(n)
    for f in range(len(n)):
        g = np.append(rings.row(f), f)
        out[f] = unit(np.maximum(n[g] @ n[f] - threshold, 0) ** 2 @ n[g])
    return out


def walk_matrix(n, rings: Csr, sigma_r):
    matrix = np.zeros((len(n), len(n)))
    for f in range(len(n)):
        g = np.append(rings.row(f), f)
        matrix[f, g] = gauss(length(n[g] - n[f]), sigma_r)
    return matrix / matrix.sum(axis=1, keepdims=True)


def median_pass(mesh: Mesh, rings: Csr, median):
    n, a = mesh.face_normals, mesh.areas
    out = np.empty_like(n)
    for f in range(len(n)):
        g = np.append(f, rings.row(f))
        if median == "vector":
            totals = length(n[g][:, None] - n[g]) @ a[g]
            out[f] = n[g[np.argmin(totals)]]
        else:
            g = g[np.argsort(length(n[g] - n[f]), kind="stable")]
            out[f] = n[g[np.searchsorted(np.cumsum(a[g]), 0.5 * a[g].sum())]]
    return out


def bilateral_difference(mesh: Mesh, rings: Csr, *, sigma_s, sigma_r):
    n, c, a = mesh.face_normals, mesh.centroids, mesh.areas
    matrix = np.eye(len(n))
    for f in range(len(n)):
        g = rings.row(f)
        w = a[g] * gauss(length(c[g] - c[f]), sigma_s * mesh.mean_edge_length) * gauss(length(n[g] - n[f]), sigma_r)
        matrix[f, g] = -w / w.sum()
    return matrix


def fleishman_step(mesh: Mesh):
    """One step of Fleishman et al. (2003), figure 3, with spreads chosen at each vertex."""
    p = mesh.vertices
    out = p.copy()
    for i in range(len(p)):
        n = unit(mesh.face_normals[mesh.topology.vertex_faces.row(i)].sum(axis=0))
        spread = length(p[mesh.topology.vertex_neighbors.row(i)] - p[i]).min()
        near, queue = {i}, [i]
        while queue:
            fresh = [j for j in mesh.topology.vertex_neighbors.row(queue.pop()) if length(p[j] - p[i]) <= 2 * spread]
            queue += [j for j in fresh if j not in near]
            near |= set(fresh)
        q = p[sorted(near)] - p[i]
        h = q @ n
        w = gauss(length(q), spread) * gauss(h, np.abs(h).std())
        out[i] += n * (w @ h) / w.sum()
    return out


def jones(mesh: Mesh, *, sigma_f, sigma_g):
    """Jones et al. (2003), equations 3 and 4; reach of all faces within two spreads, wherever they are."""
    p, c, a, edge = mesh.vertices, mesh.centroids, mesh.areas, mesh.mean_edge_length
    distance = length(p[:, None] - c)
    near = distance <= 2 * sigma_f * edge
    w = near * a * gauss(distance, 0.5 * sigma_f * edge)
    n = mesh.moved(w @ c / w.sum(axis=1, keepdims=True)).face_normals
    height = np.einsum("ifd,fd->if", c - p[:, None], n)
    w = near * a * gauss(distance, sigma_f * edge) * gauss(height, sigma_g * edge)
    return p + (w * height) @ n / w.sum(axis=1, keepdims=True)


def shortest_paths(mesh: Mesh):
    """All pairs of distances along a surface: straight lines through every unfolding, joined at any vertices."""
    size = len(mesh.vertices)
    straight = np.full((size, size), np.inf)
    for i, j in mesh.topology.edges:
        straight[i, j] = straight[j, i] = length(mesh.vertices[i] - mesh.vertices[j])
    limit = dijkstra(straight).max()

    def cross(u, v):
        return u[0] * v[1] - u[1] * v[0]

    def unfold(source, face, ends, places, right, left):
        """Go on through faces at an edge, which lies at two places seen from the source, between two directions."""
        across = [g for g in around[tuple(sorted(ends))] if g != face]
        for g in across:
            (c,) = set(mesh.faces[g]) - set(ends)
            (p, q), (a, b) = places, mesh.vertices[list(ends)]
            along, to = b - a, mesh.vertices[c] - a
            x = to @ along / (along @ along)
            off = np.sqrt(max(to @ to - x * x * (along @ along), 0)) * (q - p)[[1, 0]] * (1, -1) / length(along)
            r = p + x * (q - p) + off
            if cross(right, r) >= -1e-9 and cross(r, left) >= -1e-9:
                straight[source, c] = min(straight[source, c], length(r))
            for new, spots in (((ends[0], c), (p, r)), ((c, ends[1]), (r, q))):
                low = right if cross(right, spots[0]) < 0 else spots[0]
                high = left if cross(left, spots[1]) > 0 else spots[1]
                toward = spots[1] - spots[0]
                nearest = spots[0] - toward * np.clip(spots[0] @ toward / (toward @ toward), -1, 0)
                if cross(low, high) > 1e-12 and length(nearest) < limit:
                    unfold(source, g, new, spots, low, high)

    around = {}
    for f, corners in enumerate(mesh.faces):
        for k in range(3):
            around.setdefault(tuple(sorted((corners[k], corners[k - 1]))), []).append(f)
    for f, corners in enumerate(mesh.faces):
        for k in range(3):
            v, a, b = corners[k - 2], corners[k - 1], corners[k]
            to_a, to_b = mesh.vertices[a] - mesh.vertices[v], mesh.vertices[b] - mesh.vertices[v]
            p = np.array([length(to_a), 0])
            q = np.array([to_a @ to_b, length(np.cross(to_a, to_b))]) / p[0]
            unfold(v, f, (a, b), (p, q), p, q)
    return dijkstra(np.minimum(straight, straight.T))
