"""The width of the smallest feature to keep, and of the largest to remove."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from cascadenorm.baselines.rolling_guidance import rolling_guidance_normal
from cascadenorm.controls.displacement import limited
from cascadenorm.geometry.foldovers import without_flips
from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.geometry.sparse_solvers import solver_of_steps
from cascadenorm.mesh import Mesh, Vectors

WIDEST = 10.0
"""In diagonals of the mesh; a larger width to keep takes away the mean displacement of a component, and no more."""


def finer_than(width: float, mesh: Mesh) -> Callable[[Vectors], Vectors]:
    """Return a high-pass filter of displacements, which takes away what is as wide as the features to keep.

    A feature is half a wave, of wave number q = π/width. The displacement x passes twice through the remainder of one
    implicit step of diffusion, x - (1 - tΔ)⁻¹ x, so that a wave with -Δx = q²x is scaled by (tq²/(1 + tq²))²; with
    t = (1 + √2)(width/π)² this is a half at q = π/width. A wave twice as wide keeps 14 % of its displacement, one four
    times as wide 2 %; half as wide 82 %, a quarter as wide 95 %.

    Parameters
    ----------
    width : in the unit of the mesh; 0 takes away everything, infinity the mean displacement of each component alone
    mesh : n vertices, over which the displacement is smoothed; the boundary is free

    Returns
    -------
    A linear function of (n, 3) displacements; vertices without a face do not move
    """
    # M + tL, the matrix of an implicit step, over the vertices that have a face
    laplacian = cotangent_laplacian(mesh)
    inside = np.flatnonzero(laplacian.mass > 0)
    time = (1 + math.sqrt(2)) * (min(width, WIDEST * mesh.diagonal) / math.pi) ** 2
    stiffness = time * laplacian.stiffness[inside][:, inside]
    matrix = scipy.sparse.csr_array(scipy.sparse.diags_array(laplacian.mass[inside]) + stiffness)
    solve = solver_of_steps(matrix, mesh.vertices[inside])

    def finer(displacement: Vectors) -> Vectors:
        fine = np.zeros_like(displacement)
        fine[inside] = solve(stiffness @ solve(stiffness @ displacement[inside]))  # x - (M + tL)⁻¹ M x, twice
        return fine

    return finer


class Removal(NamedTuple):
    """Detail to remove from what a method left.

    width : of the widest feature that goes, in the unit of the mesh
    share : of the way, from 0 to 1
    everywhere : False keeps the vertices that the method left where they are
    """

    width: float
    share: float
    everywhere: bool


def without_finer(removal: Removal, mesh: Mesh, vertices: Vectors) -> Vectors:
    """Remove features up to a width from what a method left, by rolling guidance of the normals.

    Parameters
    ----------
    mesh : the input, n vertices
    vertices : (n, 3), where a method wants them

    Returns
    -------
    (n, 3), at most half a width from `vertices`, which is the height of a half sphere; no face is flipped against the
    input but its foldovers
    """
    left = mesh.moved(vertices)
    if removal.width == 0 or not left.mean_edge_length > 0:
        return vertices
    width = min(removal.width, WIDEST * mesh.diagonal)
    filtered = rolling_guidance_normal(left, width=width / left.mean_edge_length)
    kept = np.zeros(len(vertices), bool) if removal.everywhere else (vertices == mesh.vertices).all(axis=1)
    displacement = limited(np.where(kept[:, None], 0.0, filtered - vertices), 0.5 * width)
    return without_flips(mesh, vertices + removal.share * displacement)
