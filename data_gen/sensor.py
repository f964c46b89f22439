"""Error of a depth camera: noise that reaches over several pixels, and depths rounded in disparity."""

import numpy as np
from scipy import sparse
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import KDTree

from cascadenorm.data_gen.fields import Values
from cascadenorm.mesh import Mesh, Vectors, unit

WIDEST = 60  # passes of neighbour means that spread noise: over about six pixels
LONGEST = 5.0  # rounding steps are up to so many times as high as for terraces of a pixel
SHORT = 0.4  # edges so much shorter than the mean one: vertices are not pixels, but crossings of a lattice


def sensor_displacements(mesh: Mesh, deviation: float, *, rng: np.random.Generator) -> Vectors:
    """Displace vertices along the direction of view, which is taken to be the mean normal of the sheet.

    Neighbours err alike, since a camera matches windows of pixels, and where a surface is steep against the view,
    rounding of the disparity makes terraces (Khoshelham, Elberink 2012; Barron, Malik 2013). So the whole error may be
    several times larger than it is from one pixel to the next.

    Vertices are pixels; where many edges are far shorter than others, as of marching cubes in a volume of fused depths,
    the error is that of an image, and linear between its pixels.

    Parameters
    ----------
    mesh : a sheet seen from one side
    deviation : about that of the error from one vertex to the next, a length; white noise of this standard deviation
        differs as much between neighbours

    Returns
    -------
    (n, 3) float64, parallel rows
    """
    toward = unit(mesh.area_vectors.sum(axis=0)[None])[0]
    depth = -mesh.vertices @ toward
    distance = depth + float(rng.uniform(1.5, 6)) * mesh.diagonal - depth.mean()
    ends = mesh.vertices[mesh.topology.edges]
    if np.quantile(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1), 0.05) > SHORT * mesh.mean_edge_length:
        error = _camera_errors(distance, mesh, deviation, rng=rng)
    else:
        image, across = _image(mesh, toward, pitch=float(rng.uniform(1, 2)) * mesh.mean_edge_length)
        nearest = KDTree(across).query(image.vertices[:, :2])[1]
        error = _camera_errors(distance[nearest], image, deviation, rng=rng)
        error = LinearNDInterpolator(image.vertices[:, :2], error)(across)
    return np.asarray(error[:, None] * toward)


def _image(mesh: Mesh, toward: Vectors, *, pitch: float) -> tuple[Mesh, Values]:
    """Return a flat grid of pixels that covers a mesh, and where in it the vertices are, (n, 2)."""
    side = unit(np.cross(toward, np.eye(3)[np.abs(toward).argmin()])[None])[0]
    across = mesh.vertices @ np.stack([side, np.cross(toward, side)], axis=1)
    across -= across.min(axis=0) - pitch
    columns, rows = np.ceil(across.max(axis=0) / pitch).astype(int) + 1
    x, y = np.meshgrid(pitch * np.arange(columns + 1), pitch * np.arange(rows + 1), indexing="ij")
    index = np.arange(x.size).reshape(x.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    return Mesh(np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1), faces), across


def _camera_errors(distance: Values, pixels: Mesh, deviation: float, *, rng: np.random.Generator) -> Values:
    """Errors toward the camera of the distances that the pixels see, which are the vertices of a mesh."""
    blur = _neighbour_means(pixels)
    white, spread, rounding = deviation * np.sqrt(rng.dirichlet((1, 1, 1)))
    wide = _blurred(rng.normal(size=len(distance)), blur, round(WIDEST ** rng.uniform()))
    ends = wide[pixels.topology.edges]
    wide /= np.sqrt(0.5 * np.mean((ends[:, 0] - ends[:, 1]) ** 2))
    seen = _blurred(distance, blur, int(rng.integers(0, 3))) + white * rng.normal(size=len(distance)) + spread * wide
    step = np.sqrt(12) * rounding * LONGEST ** rng.uniform() / np.mean(distance) ** 2  # of the disparity 1 / distance
    phase = float(rng.random())
    rounded = 1 / (step * (np.round(1 / (seen * step) + phase) - phase))
    return distance - _blurred(rounded, blur, int(rng.integers(0, 3)))


def _blurred(values: Values, means: sparse.csr_matrix, passes: int) -> Values:
    for _ in range(passes):
        values = means @ values
    return values


def _neighbour_means(mesh: Mesh) -> sparse.csr_matrix:
    """Matrix that averages each vertex with its neighbours."""
    neighbors = mesh.topology.vertex_neighbors
    count = len(mesh.vertices)
    matrix = sparse.csr_matrix((np.ones(len(neighbors.indices)), neighbors.indices, neighbors.indptr), (count, count))
    matrix = matrix + sparse.identity(count, format="csr")
    return sparse.diags(1 / np.asarray(matrix.sum(axis=1)).ravel()) @ matrix
