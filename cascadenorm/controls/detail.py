"""Keep fine detail up to a width, or remove coarser detail."""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy

from cascadenorm.baselines.rolling_guidance import rolling_guidance_normal
from cascadenorm.baselines.wide_errors import wide_on_components, without_errors_of
from cascadenorm.controls.displacement import clip_lengths
from cascadenorm.detection.steps import enlarged_steps
from cascadenorm.errors import DenoiseError
from cascadenorm.geometry.coarse_copy import CoarseCopy
from cascadenorm.geometry.foldovers import without_flips
from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.geometry.sparse_solvers import solver_of_steps
from cascadenorm.mesh import Mesh, Vectors, as_array, marked
from cascadenorm.registry import REGION, Method

TREAT_AS = "treat_as"  # name of the parameter of `auto`
WIDEST_DETAIL = 10.0  # mesh diagonals; keeping wider detail removes only the mean displacement of components


def high_pass_filter(width: float, mesh: Mesh) -> Callable[[Vectors], Vectors]:
    """Return a linear high-pass filter of displacements, (n, 3), which removes parts as wide as the features to keep.

    A feature is half a wave with wave number q = π/width. The filter applies the residual of one implicit diffusion
    step on the mesh, x - (1 - tΔ)⁻¹ x, twice to the displacement x, which scales a wave with -Δx = q²x by
    (tq²/(1 + tq²))². With t = (1 + √2)(width/π)², this factor is 1/2 at q = π/width. Relative to this width, a wave
    twice as wide keeps 14 % of its displacement, four times as wide 2 %, half as wide 82 %, and a quarter as wide 95 %.
    A width of 0, in mesh units, removes everything, and infinity only the mean displacement of each component. The
    boundary is free, and vertices without a face do not move.
    """
    # M + tL, the matrix of an implicit step, restricted to vertices with a face
    laplacian = cotangent_laplacian(mesh)
    inside = np.flatnonzero(laplacian.mass > 0)
    time = (1 + math.sqrt(2)) * (min(width, WIDEST_DETAIL * mesh.diagonal) / math.pi) ** 2
    stiffness = time * laplacian.stiffness[inside][:, inside]
    matrix = scipy.sparse.csr_array(scipy.sparse.diags_array(laplacian.mass[inside]) + stiffness)
    solve = solver_of_steps(matrix, mesh.vertices[inside])

    def finer(displacement: Vectors) -> Vectors:
        fine = np.zeros_like(displacement)
        fine[inside] = solve(stiffness @ solve(stiffness @ displacement[inside]))  # x - (M + tL)⁻¹ M x, twice
        return fine

    return finer


def apply_method(method: Method, parameters: Mapping[str, Any], width: float | None, mesh: Mesh) -> Vectors:
    """Apply a method with all of its parameters to a mesh or, if its errors are wide, to coarse copies of it.

    The width of the errors is in mesh units. If it is None, learned methods detect the steps of enlarged volumes.
    Returns (n, 3) vertices.
    """
    if width is not None:
        widths = wide_on_components(mesh, width)
    else:
        widths = enlarged_steps(mesh) if method.converges else np.zeros(1)
    if not widths.any():
        return _returned(method, parameters, mesh)
    return without_errors_of(
        mesh, widths, partial(_returned, method, parameters), partial(_on_copy, method, parameters)
    )


def _on_copy(method: Method, parameters: Mapping[str, Any], copy: CoarseCopy) -> Vectors:
    """Apply a method to a coarse copy; a cluster moves only if all of its vertices may move."""
    if REGION in parameters:
        held = marked(copy.labels[~parameters[REGION] & (copy.labels >= 0)], len(copy.mesh.vertices))
        parameters = {**parameters, REGION: ~held}
    if len(copy.mesh.vertices) < len(copy.labels):  # the triangles of a coarse copy do not show the kind of surface
        parameters = as_unknown_surface(method, parameters)
    return _returned(method, parameters, copy.mesh)


def _returned(method: Method, parameters: Mapping[str, Any], mesh: Mesh) -> Vectors:
    """Return the vertices that a method returns for a mesh; raise DenoiseError unless they are (n, 3) numbers."""
    found = method.function(mesh, **parameters)
    must = f"it must return an array of shape {mesh.vertices.shape} of numbers"
    vertices = as_array(found, DenoiseError(f"{method.name} returned rows of different lengths; {must}"))
    if vertices.shape != mesh.vertices.shape or vertices.dtype.kind not in "fiu":
        returned = f"{type(found).__name__} of shape {vertices.shape} and type {vertices.dtype}"
        raise DenoiseError(f"{method.name} returned {returned}; {must}")
    return vertices


def as_unknown_surface(method: Method, parameters: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the parameters with which `auto` does not ask its gate, unless they set the treatment."""
    if TREAT_AS not in method.settings or parameters.get(TREAT_AS) is not None:
        return parameters
    return {**parameters, TREAT_AS: "unknown"}


class DetailRemoval(NamedTuple):
    """Detail to remove from the result of a method."""

    width: float  # of the widest feature to remove, in mesh units
    share: float  # fraction of the removal to apply, from 0 to 1


def without_detail(removal: DetailRemoval, mesh: Mesh, vertices: Vectors) -> Vectors:
    """Remove features up to a width from the result of a method, by rolling guidance of the normals.

    Returns (n, 3) vertices within half a width, the height of a hemisphere, of `vertices`, which are those after the
    method. No face is flipped against the input, except to undo foldovers in it.
    """
    left = mesh.moved(vertices)
    if removal.width == 0 or not left.mean_edge_length > 0:
        return vertices
    width = min(removal.width, WIDEST_DETAIL * mesh.diagonal)
    filtered = rolling_guidance_normal(left, width=width / left.mean_edge_length)
    displacement = clip_lengths(filtered - vertices, 0.5 * width)
    return without_flips(mesh, vertices + removal.share * displacement)
