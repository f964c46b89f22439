"""Geodesic distances by the heat method: the lengths of shortest paths along a surface."""

import numpy as np
import scipy
from numpy.typing import ArrayLike

from cascadenorm.errors import ParameterError
from cascadenorm.geometry.laplacians import cotangent_laplacian_of, face_cotangents
from cascadenorm.geometry.sparse_solvers import Factorisation
from cascadenorm.mesh import (
    Bools,
    Floats,
    Ints,
    Ints32,
    Mesh,
    Vectors,
    in_frame,
    kernel,
    parallel_for,
    scatter_add,
    without_lines,
)

LEAST_HEAT = 1e-300
"""Share of the largest heat below which its gradient is not trusted: then it flows for longer."""


def geodesic_distances(mesh: Mesh, sources: ArrayLike) -> Floats:
    """Return the distance along the surface from each vertex to the nearest source.

    The heat method (Crane, Weischedel, Wardetzky 2013) takes two sparse solves. From one source it is off by 1 to 3 %
    on average, from several by more, most if they are few edges apart.

    Parameters
    ----------
    mesh
        n vertices; an edge may have any number of faces, of any orientation.
    sources
        Number of a vertex, or (s,) of several.

    Returns
    -------
    (n,) float64, in the unit of the vertices; 0 at sources, inf where no source is connected

    Raises
    ------
    MeshError
        All faces lie in one place.
    ParameterError
        There is no source, or one that does not exist.
    """
    chosen = _checked_sources(sources, len(mesh.vertices))
    framed, exponent = in_frame(without_lines(mesh))
    return np.asarray(np.ldexp(heat_distances(framed, chosen), exponent))


def heat_distances(mesh: Mesh, sources: Ints) -> Floats:
    """Return (n,) approximate distances to the nearest source, inf where none is connected.

    Heat flows from the sources for a time of one squared mean edge length; its gradient points along the shortest
    paths. The function whose gradient comes nearest to that direction at unit length is the distance, up to a constant
    for each connected component: distances are 0 at sources on average.

    Parameters
    ----------
    sources
        (s,) different vertices, at least one.
    """
    components = mesh.topology.components
    distances = np.where(np.isin(np.arange(len(mesh.vertices)), sources), 0.0, np.inf)
    near = mesh.topology.used_vertices & np.isin(components, components[sources])
    if not near.any():
        return distances
    cotangents, areas = face_cotangents(mesh)
    laplacian = cotangent_laplacian_of(mesh, cotangents, areas)
    stiffness, positions = laplacian.stiffness[near][:, near], mesh.vertices[near]

    # heat flow, and the divergence of its gradient scaled to unit length
    heat = np.zeros(len(near))
    heat[near] = _heat(stiffness, laplacian.mass[near], positions, (distances == 0)[near], mesh.mean_edge_length**2)
    flux = np.zeros(mesh.faces.shape)
    parallel_for(len(flux), _unit_flux, mesh.faces, cotangents, areas, heat, flux)
    divergence = scatter_add(mesh.faces.ravel(), flux.ravel(), len(near))[near]

    # Poisson equation, with the first source of each component held
    inside = sources[near[sources]]
    held, first = np.unique(components[inside], return_index=True)
    free = near.copy()
    free[inside[first]] = False
    rest = free[near]
    potential = np.zeros(len(near))
    potential[free] = Factorisation(stiffness[rest][:, rest], positions[rest]).solve(divergence[rest])
    for component in held:
        potential[components == component] -= potential[inside[components[inside] == component]].mean()
    distances[near] = np.maximum(potential[near], 0.0)
    distances[sources] = 0.0
    return distances


def _heat(
    stiffness: "scipy.sparse.csr_array",
    mass: Floats,
    positions: Vectors,
    sources: Bools,
    time: float,
) -> Floats:
    """Return the heat of one implicit step, which flows for longer until some has come everywhere."""
    while True:
        step = scipy.sparse.diags_array(mass) + time * stiffness
        heat = Factorisation(step, positions).solve(sources.astype(np.float64))
        if heat.min() > LEAST_HEAT * heat.max():
            return heat
        time *= 4


@kernel
def _unit_flux(
    start: int, stop: int, faces: Ints32, cotangents: Floats, areas: Floats, heat: Floats, flux: Floats
) -> None:
    """What flows out of each corner of a face, (m, 3), down a heat that is scaled to a gradient of length 1.

    A piecewise linear function u has the energy ∫ |∇u|² = Σ ½ cot (u_i - u_j)² over the sides of a face, and its
    derivative by u_i is twice ∫ ∇u · ∇φ_i, with the hat function φ_i of the corner.
    """
    for f in range(start, stop):
        a, b, c = heat[faces[f, 0]], heat[faces[f, 1]], heat[faces[f, 2]]
        largest = max(abs(a), abs(b), abs(c))
        if not largest > 0.0:
            continue
        a, b, c = a / largest, b / largest, c / largest  # squares of far, little heat vanish
        along_ab = 0.5 * cotangents[f, 0] * (a - b)
        along_bc = 0.5 * cotangents[f, 1] * (b - c)
        along_ca = 0.5 * cotangents[f, 2] * (c - a)
        energy = along_ab * (a - b) + along_bc * (b - c) + along_ca * (c - a)
        if energy > 0.0:
            scale = np.sqrt(areas[f] / energy)
            flux[f, 0] = scale * (along_ca - along_ab)
            flux[f, 1] = scale * (along_ab - along_bc)
            flux[f, 2] = scale * (along_bc - along_ca)


def _checked_sources(sources: ArrayLike, count: int) -> Ints:
    """Return the sources, ascending, each once; raises ParameterError where they are no vertices."""
    given = np.atleast_1d(np.asarray(sources))
    if given.ndim != 1 or not len(given) or given.dtype.kind not in "iu":
        raise ParameterError("must be a vertex index or several", parameter="sources")
    wrong = given[(given < 0) | (given >= count)]
    if len(wrong):
        raise ParameterError(f"contains {wrong[0]}; vertex indices go from 0 to {count - 1}", parameter="sources")
    return np.unique(given).astype(np.int64)
