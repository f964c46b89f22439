"""Errors many edges wide, removed on coarse copies of the mesh where they are a few edges wide."""

from collections.abc import Callable

import numpy as np

from cascadenorm.baselines.bilateral_normal import bilateral_normal
from cascadenorm.execution.progress import track
from cascadenorm.geometry.coarse_copy import CoarseCopy, coarse_copy
from cascadenorm.mesh import Floats, Mesh, Vectors

SHARES = 0.6, 0.525, 0.675
"""Lengths of the edges of the copies, in widths of the error. The clusters of each lie elsewhere, so that its facets,
and steps that it takes for shape, are a third of the mean."""
FINISHING_PASSES = 10
"""Of the bilateral filter over the mesh at the end, which evens out the facets of the copies."""


def without_wide_errors(mesh: Mesh, width: float, denoise: Callable[[CoarseCopy], Vectors]) -> Vectors:
    """Remove errors up to a width: denoise coarse copies, carry the vertices over, and even out the facets.

    Parameters
    ----------
    mesh
        Mesh with n vertices, of any kind.
    width
        Of the error, in the unit of the mesh. Where copies would have no longer edges than the mesh, it is denoised
        itself.
    denoise
        Gives new vertices of a copy.

    Returns
    -------
    (n, 3), the mean over the copies; vertices without a face stay.
    """
    if max(SHARES) * width <= mesh.mean_edge_length:
        return denoise(CoarseCopy(mesh, np.arange(len(mesh.vertices), dtype=np.int32)))
    sums = np.zeros_like(mesh.vertices)
    for number in track(len(SHARES)):
        copy = coarse_copy(mesh, SHARES[number] * width)
        sums += mesh.vertices if copy is None else copy.carried_over(mesh.vertices, denoise(copy))
    carried = np.where(mesh.topology.used_vertices[:, None], sums / len(SHARES), mesh.vertices)
    return bilateral_normal(mesh.moved(carried), iterations=FINISHING_PASSES)


def without_steps(
    mesh: Mesh, widths: Floats, denoise: Callable[[Mesh], Vectors], denoise_copy: Callable[[CoarseCopy], Vectors]
) -> Vectors:
    """Denoise a mesh of which some connected components have steps of a known width.

    Parameters
    ----------
    mesh
        Mesh with n vertices.
    widths
        (c,) width of the steps of each connected component, as `enlarged_steps` finds them; 0 where there are none.
    denoise
        Gives new vertices of the components without steps.
    denoise_copy
        Gives new vertices of a copy of the others.

    Returns
    -------
    (n, 3)
    """
    vertices, of_faces = mesh.vertices.copy(), widths[mesh.topology.face_components]
    for width in np.unique(of_faces):
        part = Mesh(mesh.vertices, mesh.faces[of_faces == width]) if len(widths) > 1 else mesh
        moved = without_wide_errors(part, float(width), denoise_copy) if width else denoise(part)
        used = part.topology.used_vertices
        vertices[used] = moved[used]
    return vertices
