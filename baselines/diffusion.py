"""Linear diffusion of the vertices, x_t = -(-Δ)^p x, in explicit or implicit steps (Desbrun et al. 1999)."""

import logging
import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
import scipy

from cascadenorm.execution.progress import track
from cascadenorm.geometry.laplacians import (
    MOLLIFICATION,
    Laplacian,
    Order,
    VertexMask,
    Weights,
    cotangent_laplacian,
    laplacian_of,
)
from cascadenorm.geometry.sparse_solvers import solver_of_rings, solver_of_steps
from cascadenorm.mesh import Floats, Ints32, Mesh, Vectors, scatter_add
from cascadenorm.registry import Parameter, ParameterError, method

Scheme = Literal["explicit", "implicit"]
DiffusionStep = Annotated[
    float, Parameter("Step size hλ", "squared mean edge lengths of the input", minimum=0, below=math.inf)
]
Moving = Annotated[VertexMask | None, Parameter("(n,) bool, the vertices that move. The others are fixed")]

LARGEST_EIGENVALUE = 2.0  # eigenvalue of -Δ with uniform weights
LONGEST = 1e6  # areas of the mesh, largest time of an implicit step; even long tubes become points in it
MOST_STEPS = 10_000  # explicit steps that a call may be divided into

logger = logging.getLogger(__name__)


def _rings(given: Mapping[str, Any], _: int) -> int | None:
    """Return the receptive field in edges.

    It is None where a vertex depends on the whole mesh: the mollification of cotangents depends on every triangle, and
    an implicit step solves a system of all vertices.
    """
    if given["weights"] != "uniform" or given["scheme"] != "explicit":
        return None
    order: Order = given["order"]
    iterations = int(given["iterations"])
    return order * iterations * _stable_cuts(LARGEST_EIGENVALUE, given["step"], iterations, order)


@method("laplacian", source="Desbrun, Meyer, Schröder, Barr 1999", family="smoothing", rings=_rings)
def laplacian(
    mesh: Mesh,
    *,
    weights: Annotated[Weights, Parameter("Weights of the Laplacian: uniform, or cotangents")] = "uniform",
    scheme: Annotated[Scheme, Parameter("Type of steps; implicit ones are stable at any size")] = "explicit",
    order: Annotated[Order, Parameter("Order of the flow: 1 Laplacian, 2 bi-Laplacian, 3 tri-Laplacian")] = 1,
    step: Annotated[
        float,
        Parameter(
            "Step size hλ",
            "mean edge lengths to the power 2·order; no unit with uniform weights",
            minimum=0,
            below=math.inf,
        ),
    ] = 0.5,
    iterations: Annotated[int, Parameter("Number of steps", minimum=0)] = 5,
    region: Moving = None,
) -> Vectors:
    """Diffuse the vertices with a fixed Laplacian, of order 1, 2 or 3: x_t = -λ(-Δ)^order x.

    With the same step, cotangent weights smooth more and move vertices along the normal only; uniform weights also even
    out the edge lengths. The boundary of an open mesh shrinks as well. `diffuse` describes the stability of explicit
    steps and the effect of a region.

    Formula
    -------
    explicit: x ← x - t(-Δ)^p x;   implicit: (1 + t(-Δ)^p) x ← x,   p the order

    Limits
    ------
    It shrinks the mesh and rounds edges, less so with order 2 or 3. Explicit steps are stable below a bound that
    decreases with the order; longer ones are divided.
    """
    operator = laplacian_of(mesh, weights)
    unit = mesh.mean_edge_length if weights == "cotan" else 1.0  # uniform weights do not depend on lengths
    time = step * unit ** (2 * order)
    return diffuse(operator, mesh.vertices, time=time, iterations=iterations, scheme=scheme, order=order, region=region)


def diffuse(
    laplacian: Laplacian,
    values: Floats,
    *,
    time: float,
    iterations: int,
    scheme: Scheme = "implicit",
    order: Order = 1,
    region: VertexMask | None = None,
) -> Floats:
    """Take steps of x_t = -(-Δ)^order x: an eigenvector of -Δ with value k is scaled by 1 - tk^p, or by 1/(1 + tk^p).

    The values, (n, c), are the vertices or at most three other columns. The time t of one step is in the unit of the
    Laplacian to the power `order`. An explicit step t ≤ 2 / k_max^order is stable, where k_max is `laplacian.largest`.
    Longer ones are divided into equal stable ones, which is logged at level INFO. Implicit steps longer than
    (LONGEST areas)^order act as that long. Only vertices in the region, (n,), move; None selects all that have mass.
    Where they meet fixed vertices, the limit of the flow has order - 1 continuous derivatives. Returns (n, c). Raises
    ParameterError if all explicit steps together take more than 10,000 stable ones.
    """
    free = laplacian.mass > 0 if region is None else region & (laplacian.mass > 0)
    if time == 0 or iterations == 0 or not free.any():
        return values.copy()
    if scheme == "explicit":
        cuts = _stable_cuts(laplacian.largest, time, iterations, order)
        for _ in track(iterations * cuts):
            values = values - np.where(free[:, None], (time / cuts) * laplacian.apply(values, order), 0.0)
        return values
    # (M + tP) d = -tPx for the displacement d, with P = M(-Δ)^p; rows and columns of values that stay are left out
    time = min(time, (LONGEST * float(laplacian.mass.sum())) ** order)
    power = laplacian.power(order)
    inside = np.flatnonzero(free)
    mass = scipy.sparse.diags_array(laplacian.mass[inside])
    matrix = scipy.sparse.csr_array(mass + time * power[inside][:, inside])
    if order == 1:
        solve = solver_of_steps(matrix, laplacian.positions[inside])
    else:
        root = mass + time ** (1 / order) * laplacian.stiffness[inside][:, inside]  # (1 + sk)^p is near 1 + tk^p
        solve = solver_of_rings(matrix, root, laplacian.mass[inside], laplacian.positions[inside], order=order)
    # the mean over a component does not change; long steps would multiply its rounding error
    component = scipy.sparse.csgraph.connected_components(laplacian.stiffness)[1]
    values = values.copy()
    for _ in track(iterations):
        moves = np.zeros_like(values)
        moves[inside] = solve(-time * (power @ values)[inside])
        values += moves - component_means(component, laplacian.mass, moves, free)
    return values


def flowed(
    mesh: Mesh, laplacian: Laplacian, *, time: float, scheme: Scheme = "implicit", region: VertexMask | None = None
) -> Vectors:
    """Take one step of x_t = Δx, in which boundary vertices move perpendicular to the surface only.

    On a closed mesh, this is a step of `diffuse`, which describes the parameters. Vertices outside the region and those
    without a face do not move.
    """
    held = laplacian.mass == 0 if region is None else ~region | (laplacian.mass == 0)
    boundary = np.flatnonzero(mesh.topology.boundary_vertices)
    normals = mesh.vertex_normals[boundary]

    def velocity(vertices: Vectors) -> Vectors:
        towards = -laplacian.apply(vertices - component_means(mesh.topology.components, laplacian.mass, vertices))
        towards[boundary] = np.einsum("ij,ij->i", towards[boundary], normals)[:, None] * normals
        towards[held] = 0
        return towards

    if scheme == "implicit":
        return mesh.vertices + implicit_moves(mesh, laplacian, velocity(mesh.vertices), time=time, region=region)
    cuts, vertices = _stable_cuts(laplacian.largest, time, 1, 1) if time else 0, mesh.vertices
    for _ in track(cuts):
        vertices = vertices + time / cuts * velocity(vertices)
    return vertices


def implicit_moves(
    mesh: Mesh, laplacian: Laplacian, velocity: Vectors, *, time: float, region: VertexMask | None
) -> Vectors:
    """Return the displacement (M + tS)⁻¹ tMv, (n, 3), of an implicit step from the velocity v, (n, 3), before it.

    The velocity is zero outside the region and at vertices without a face. Steps longer than LONGEST act as LONGEST.
    The mean displacement of a component is its mean velocity times the time, which is limited to the area of the mesh,
    because the velocity falls to zero in about this time. It is set explicitly, since rounding errors would move
    components far away that are tiny compared with the step.
    """
    area = float(laplacian.mass.sum())
    time = min(time, LONGEST * area)
    inside = np.flatnonzero(laplacian.mass > 0 if region is None else region & (laplacian.mass > 0))
    mass, moves = laplacian.mass[inside], np.zeros_like(velocity)
    matrix = scipy.sparse.csr_array(scipy.sparse.diags_array(mass) + time * laplacian.stiffness[inside][:, inside])
    moves[inside] = solver_of_steps(matrix, laplacian.positions[inside])(time * mass[:, None] * velocity[inside])
    drift = min(time, area) * velocity - moves
    return moves + component_means(mesh.topology.components, laplacian.mass, drift, region)


def component_means(component: Ints32, mass: Floats, values: Floats, region: VertexMask | None = None) -> Floats:
    """Return the means of values, (n, c), by mass over the component of each vertex, numbered in (n,).

    They are 0 for components with a vertex outside the region.
    """
    sums = scatter_add(component, np.column_stack([mass, mass[:, None] * values]), int(component.max()) + 1)
    masses, totals = sums[:, :1], sums[:, 1:]
    held = masses == 0
    if region is not None:
        held[component[~region]] = True
    return np.asarray(np.where(held, 0.0, totals / np.where(held, 1.0, masses))[component])


def _stable_cuts(largest: float, time: float, iterations: int, order: Order) -> int:
    """Return the number of stable steps into which an explicit step is divided."""
    longest = 2.0 / largest**order
    cuts = max(1.0, float(np.ceil(time / longest * (1 - 1e-12))))
    if cuts * iterations > MOST_STEPS:
        raise ParameterError(
            f"{iterations} explicit steps of this size need {cuts * iterations:.6g} stable ones; {MOST_STEPS} are "
            f"allowed: make step or iterations at least {cuts * iterations / MOST_STEPS:.3g} times smaller, or use "
            "scheme='implicit'"
        )
    if cuts > 1:
        logger.info("each explicit step is cut into %d stable ones", cuts)
    return int(cuts)


@method("mean-curvature-flow", source="Desbrun, Meyer, Schröder, Barr 1999", family="smoothing")
def mean_curvature_flow(
    mesh: Mesh,
    *,
    scheme: Annotated[Scheme, Parameter("Type of steps; implicit ones are stable at any size")] = "implicit",
    step: DiffusionStep = 0.25,
    iterations: Annotated[int, Parameter("Number of steps, each with a new Laplacian", minimum=0)] = 3,
    region: Moving = None,
) -> Vectors:
    """Move the vertices by λΔx = -2λHn, with the cotangent Laplacian rebuilt before every step.

    A sphere of radius r0 has r(t)² = r0² - 4λt. Explicit steps that are too long are divided as in `diffuse`. Boundary
    vertices move perpendicular to the surface only (see `flowed`). Vertices outside the region and those without a face
    do not move.

    Formula
    -------
    x_t = λΔx = -2λHn;   implicit: (M + tS) x ← M x,   M masses, S stiffness of cotangents, both of the moving mesh

    Limits
    ------
    It shrinks the mesh and rounds every edge. Thin necks pinch off.
    """
    edge = mesh.mean_edge_length
    for _ in track(iterations):
        slack = MOLLIFICATION * edge / (mesh.mean_edge_length or 1.0)  # a component that is a point stays one
        laplacian = cotangent_laplacian(mesh, mollification=slack)
        mesh = mesh.moved(flowed(mesh, laplacian, time=step * edge**2, scheme=scheme, region=region))
    return mesh.vertices.copy()
