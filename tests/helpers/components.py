"""Components of several sizes, side by side in one mesh."""

import numpy as np
from shapes import cube, icosphere

from cascadenorm.mesh import Mesh

LARGE, MIDDLE, SMALL = icosphere(4), icosphere(1), cube(1)  # 5120, 80 and 12 faces
PARTS = (SMALL, LARGE, MIDDLE, SMALL)


def together(*meshes):
    """The meshes side by side as one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = [mesh.vertices + 5 * number for number, mesh in enumerate(meshes)]
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.vstack(vertices), np.vstack(faces))
