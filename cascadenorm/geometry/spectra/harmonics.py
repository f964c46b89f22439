"""Manifold harmonics (Vallet & Lévy 2008) and shape DNA."""

from typing import Literal, NamedTuple

import numpy as np
import scipy

from cascadenorm.errors import ParameterError
from cascadenorm.geometry.laplacians import Laplacian, cotangent_laplacian
from cascadenorm.geometry.sparse_solvers import Factorisation
from cascadenorm.mesh import Floats, Ints, Mesh, in_frame, one_blas_thread, surface_of
from cascadenorm.registry import checked_number

BAND = 60  # eigenpairs around one shift
EIGENVALUE_TOLERANCE = 1e-10  # relative residual of the inverse; the error is of the order of its square
RESTARTS = 60  # Lanczos restarts in one band, at most; 2 to 5 are usual
DENSE = 1200  # vertices up to which a dense solver is used
TOO_ALIKE = (
    "too many eigenvalues of this mesh coincide to compute harmonics exactly: request fewer, or approximate them"
)

Pairs = tuple[Floats, Floats]
BoundaryCondition = Literal["free", "fixed"]
Scale = Literal["keep", "area"]


class Harmonics(NamedTuple):
    """The k lowest eigenpairs of -Δ on n vertices: S φ = λ M φ, φᵀ M φ = 1."""

    values: Floats  # (k,) ascending, in 1 / length²
    vectors: Floats  # (n, k)
    mass: Floats  # (n,)

    def coefficients(self, functions: Floats) -> Floats:
        """Return the (k, c) M-inner products of the columns of `functions`, (n, c), with the eigenvectors."""
        with one_blas_thread():
            return np.asarray(self.vectors.T @ (self.mass[:, None] * functions))

    def combined(self, coefficients: Floats) -> Floats:
        """Return the (n, c) linear combinations of the eigenvectors with (k, c) coefficients."""
        with one_blas_thread():
            return np.asarray(self.vectors @ coefficients)

    def scaled(self, exponent: int) -> "Harmonics":
        """Return the harmonics of the mesh enlarged by 2**exponent."""
        values, vectors = np.ldexp(self.values, -2 * exponent), np.ldexp(self.vectors, -exponent)
        return Harmonics(values, vectors, np.ldexp(self.mass, 2 * exponent))


def manifold_harmonics(mesh: Mesh, count: int, *, boundary: BoundaryCondition = "free") -> Harmonics:
    """Return the lowest eigenpairs of the cotangent Laplacian.

    Shift-invert Lanczos finds 60 pairs around a shift, and the shift then increases. Between bands, the signs of the
    pivots of a factorisation count the eigenvalues below, so that no pair is missed or found twice.

    Parameters
    ----------
    mesh
        Mesh with n vertices.
    count
        Number of eigenpairs k, from 1 to the number of free vertices with a face.
    boundary
        "free" for Neumann boundary conditions, "fixed" for Dirichlet: zero at the boundary of an open mesh.

    Returns
    -------
    k pairs: eigenvalues (k,) ascending in 1 / length², eigenvectors (n, k), and the masses of the vertices, (n,).
    Eigenvectors are 0 at vertices without a face, and their entry of largest absolute value is positive.

    Raises
    ------
    ParameterError
        `count` is out of range, or `boundary` is unknown.
    """
    if boundary not in ("free", "fixed"):
        raise ParameterError(f"is {boundary!r}; it must be free or fixed", parameter="boundary")
    mesh, exponent = in_frame(surface_of(mesh))
    laplacian = cotangent_laplacian(mesh)
    free = laplacian.mass > 0
    if boundary == "fixed":
        free &= ~mesh.topology.boundary_vertices
    count = checked_count(count, int(free.sum()))
    # components are solved separately: identical ones would give multiple eigenvalues
    component = np.where(free, mesh.topology.components, -1)
    order = np.argsort(component, kind="stable")[(~free).sum() :]
    parts = np.split(order, np.flatnonzero(np.diff(component[order])) + 1)
    pairs = [_lowest(laplacian, part, min(count, len(part))) for part in parts]
    all_values = np.concatenate([found for found, _ in pairs])
    owners = np.concatenate([[(i, k) for k in range(len(found))] for i, (found, _) in enumerate(pairs)])
    lowest = np.argsort(all_values, kind="stable")[:count]
    vectors = np.zeros((len(mesh.vertices), count))
    for column, (i, k) in enumerate(owners[lowest]):
        vectors[parts[i], column] = pairs[i][1][:, k]
    vectors *= np.where(vectors[abs(vectors).argmax(axis=0), np.arange(count)] < 0, -1.0, 1.0)
    return Harmonics(np.maximum(all_values[lowest], 0.0), vectors, laplacian.mass).scaled(exponent)


def _lowest(laplacian: Laplacian, inside: Ints, count: int) -> Pairs:
    """Return the lowest eigenpairs among functions that vanish outside some vertices, restricted to these vertices."""
    stiffness, mass = laplacian.stiffness[inside][:, inside], laplacian.mass[inside]
    if len(inside) > DENSE and 3 * count <= len(inside):
        return _in_bands(Laplacian(stiffness, mass, laplacian.positions[inside]), count)
    root = 1 / np.sqrt(mass)
    with one_blas_thread(scipy.linalg):
        values, vectors = scipy.linalg.eigh(root[:, None] * stiffness.toarray() * root, subset_by_index=(0, count - 1))
    return values, root[:, None] * vectors


def shape_dna(mesh: Mesh, count: int, *, scale: Scale = "keep") -> Floats:
    """Return the lowest eigenvalues of the Laplacian (Reuter, Wolter, Peinecke 2006), invariant under isometries.

    Parameters
    ----------
    mesh
        Mesh with n vertices.
    count
        Number of eigenvalues, at most the number of vertices with a face.
    scale
        "keep" returns values in 1 / length²; "area" multiplies them by the area, which makes them independent of size.

    Returns
    -------
    (count,) eigenvalues, ascending, with a 0 for each connected component.

    Raises
    ------
    ParameterError
        `count` is out of range, or `scale` is unknown.
    """
    if scale not in ("keep", "area"):
        raise ParameterError(f"is {scale!r}; it must be keep or area", parameter="scale")
    framed, exponent = in_frame(surface_of(mesh))
    values = manifold_harmonics(framed, count).values
    return values * framed.area if scale == "area" else np.asarray(np.ldexp(values, -2 * exponent))


def checked_count(count: int, available: int) -> int:
    """Return a number of harmonics; raise ParameterError unless it is between 1 and `available`."""
    count = checked_number("count", int, count)
    if not 1 <= count <= available:
        raise ParameterError(f"{count} harmonics were requested; this mesh has {available}: ask for 1 to {available}")
    return count


def _in_bands(laplacian: Laplacian, count: int) -> Pairs:
    """Return the lowest `count` eigenpairs, computed in overlapping bands."""
    n = len(laplacian.mass)
    values, vectors = np.empty(count), np.empty((n, count))
    weyl = 4 * np.pi / laplacian.mass.sum()  # mean spacing of the eigenvalues of a surface
    have, floor, shift = 0, -np.inf, -0.01 * weyl
    for _ in range(20 + 4 * count // BAND):
        found, parts = _band(laplacian, shift, min(BAND, n - 1))
        if have > 0 and found[0] > floor:  # pairs may be missing in between: reduce the shift
            shift = 0.5 * (shift + floor)
            continue
        # end at the widest gap near the top, so that no cluster of equal eigenvalues is split between bands
        gaps = np.diff(found[-BAND // 6 :])
        end = len(found) - len(gaps) + int(gaps.argmax())
        ceiling = 0.5 * (found[end - 1] + found[end])
        pivots = _shifted(laplacian, ceiling).factors.U.diagonal()
        expected = int((pivots < 0).sum()) - have  # as many eigenvalues are below (Sylvester's law of inertia)
        inside = (found > floor) & (found < ceiling)
        if inside.sum() < expected:
            found, parts = _completed(laplacian, shift, found, parts, expected - int(inside.sum()))
            inside = (found > floor) & (found < ceiling)
        if inside.sum() != expected:
            shift = 0.5 * (shift + max(floor, 0.0))
            continue
        taken = min(expected, count - have)
        values[have : have + taken] = found[inside][:taken]
        vectors[:, have : have + taken] = parts[:, inside][:, :taken]
        have += taken
        if have == count:
            return values, vectors
        floor, shift = ceiling, ceiling + 0.4 * BAND * max((found[-1] - found[0]) / len(found), 0.01 * weyl)
    raise ParameterError(TOO_ALIKE)


def _band(laplacian: Laplacian, shift: float, count: int, known: Floats | None = None) -> Pairs:
    """Return the eigenpairs nearest to a shift, ascending, except those with the eigenvectors `known`."""
    factorisation = _shifted(laplacian, shift)
    root, n = np.sqrt(laplacian.mass), len(laplacian.mass)
    others = np.empty((n, 0)) if known is None else root[:, None] * known

    def apply(x: Floats) -> Floats:
        x = x.ravel() - others @ (others.T @ x.ravel())
        x = root * factorisation.solve(root * x)
        return np.asarray(x - others @ (others.T @ x))

    start = np.cos((1 + others.shape[1]) * np.arange(n))
    try:
        with one_blas_thread(scipy.sparse.linalg):
            operator = scipy.sparse.linalg.LinearOperator((n, n), apply, dtype=np.float64)
            inverse, vectors = scipy.sparse.linalg.eigsh(
                operator, count, v0=start, maxiter=RESTARTS, tol=EIGENVALUE_TOLERANCE
            )
    except scipy.sparse.linalg.ArpackError as error:
        raise ParameterError(TOO_ALIKE) from error
    values = shift + 1 / inverse
    order = np.argsort(values)
    return values[order], vectors[:, order] / root[:, None]


def _shifted(laplacian: Laplacian, shift: float) -> Factorisation:
    matrix = laplacian.stiffness - shift * scipy.sparse.diags_array(laplacian.mass)
    return Factorisation(matrix, laplacian.positions)


def _completed(laplacian: Laplacian, shift: float, values: Floats, vectors: Floats, missing: int) -> Pairs:
    """Add missing eigenpairs of multiple eigenvalues, which Lanczos may find incompletely, as on symmetric meshes."""
    more, parts = _band(laplacian, shift, missing + 5, vectors)
    values, vectors = np.concatenate([values, more]), np.concatenate([vectors, parts], axis=1)
    order = np.argsort(values)
    return values[order], vectors[:, order]
