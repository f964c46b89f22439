"""Remove errors that are many edges wide on coarse copies of the mesh.

On the copies, the errors are only a few edges wide.
"""

import math
from collections.abc import Callable

import numpy as np

from cascadenorm.baselines.bilateral_normal import bilateral_normal
from cascadenorm.execution.progress import track
from cascadenorm.geometry.coarse_copy import CoarseCopy, coarse_copy
from cascadenorm.geometry.foldovers import unfolded
from cascadenorm.mesh import Bools, Floats, Mesh, Vectors, marked, pair_products, row_distances

SHARES = 0.6, 0.525, 0.675
"""Edge lengths of the copies, relative to the width of the error. The clusters of each copy are located differently,
so the facets of a copy, and steps that it mistakes for shape, contribute only a third to the mean."""
FINISHING_PASSES = 10  # passes of the bilateral filter at the end, which smooths the facets of the copies
UNFOLDED_COSINE = math.cos(math.radians(95))  # between the normals of adjacent faces; few shapes have sharper edges
BLADE_COSINE = math.cos(math.radians(130))  # of edges that are not steps: those of binary masks fold by at most 125°
UNFOLDING_ROUNDS = 20


def without_wide_errors(mesh: Mesh, width: float, denoise: Callable[[CoarseCopy], Vectors]) -> Vectors:
    """Remove errors up to a width, in mesh units: denoise coarse copies, transfer the result, and smooth the facets.

    The width is that of errors that are wide on all components (see `wide_on_components`). `denoise` returns new
    vertices of a copy. Returns the mean over the copies, (n, 3). Vertices without a face do not move.
    """
    sums = np.zeros_like(mesh.vertices)
    for number in track(len(SHARES)):
        copy = coarse_copy(mesh, SHARES[number] * width)
        sums += mesh.vertices if copy is None else copy.carried_over(mesh.vertices, denoise(copy))
    carried = np.where(mesh.topology.used_vertices[:, None], sums / len(SHARES), mesh.vertices)
    moved = mesh.moved(carried)
    if not moved.mean_edge_length**2 > 0:  # the method moved all vertices to one place
        return carried
    return without_folds(mesh, bilateral_normal(moved, iterations=FINISHING_PASSES))


def wide_on_components(mesh: Mesh, width: float) -> Floats:
    """Return the width of errors, in mesh units, on each of c components; 0 where no copy would have longer edges."""
    edges, count = mesh.topology.edges, mesh.topology.component_count
    of_edges = mesh.topology.components[edges[:, 0]]
    sums = np.bincount(of_edges, row_distances(mesh.vertices, edges), minlength=count)
    counts = np.bincount(of_edges, minlength=count)
    return np.where((counts > 0) & (max(SHARES) * width > sums / np.maximum(counts, 1)), width, 0.0)


def without_folds(mesh: Mesh, vertices: Vectors) -> Vectors:
    """Unfold edges of the input mesh with new vertices, (n, 3); returns (n, 3).

    Where steps are closer to each other than the edges of a copy, all of their vertices are carried over from the same
    place. Edges that are sharper than those of steps in the input stay: they belong to thin sheets, or join faces of
    opposite orientation.
    """
    pairs = mesh.topology.face_pairs
    pairs = pairs[pair_products(mesh.face_normals, pairs) >= BLADE_COSINE]

    def folded(moved: Mesh) -> Bools:
        return marked(pairs[pair_products(moved.face_normals, pairs) < UNFOLDED_COSINE], len(mesh.faces))

    return unfolded(mesh, vertices, folded, rounds=UNFOLDING_ROUNDS)


def without_errors_of(
    mesh: Mesh, widths: Floats, denoise: Callable[[Mesh], Vectors], denoise_copy: Callable[[CoarseCopy], Vectors]
) -> Vectors:
    """Denoise a mesh in which some connected components have errors, such as steps, of a known width.

    The widths, (c,), are those from `enlarged_steps` or `wide_on_components`; 0 for components without such errors.
    `denoise` returns new vertices of these, and `denoise_copy` those of a copy of the others.
    """
    vertices, of_faces = mesh.vertices.copy(), widths[mesh.topology.face_components]
    for width in np.unique(of_faces):
        here = of_faces == width
        part = mesh if here.all() else Mesh(mesh.vertices, mesh.faces[here])
        moved = without_wide_errors(part, float(width), denoise_copy) if width else denoise(part)
        used = part.topology.used_vertices
        vertices[used] = moved[used]
    return vertices
