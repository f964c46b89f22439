"""A mesh of triangles and quads for the formats of VTK."""

import numpy as np
from shapes import grid

SHEET = grid(2, 3)
QUADS = np.array([(0, 1, 5, 4), (1, 2, 6, 5)])


def surface(pyvista):
    """Return PolyData of triangles, quads and a line, with values and normals of points and cells."""
    rng = np.random.default_rng(0)
    faces = [*([3, *face] for face in SHEET.faces.tolist()), *([4, *face] for face in QUADS.tolist())]
    made = pyvista.PolyData(SHEET.vertices, faces=np.concatenate(faces), lines=[2, 0, 1])
    made.point_data["heat"] = rng.normal(size=made.n_points)
    made.point_data["Normals"] = np.tile([0.0, 0, 1], (made.n_points, 1))
    made.cell_data["part"] = np.arange(made.n_cells, dtype=np.int32)
    return made
