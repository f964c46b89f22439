"""Parts of meshes: some faces over the vertices that they use, and large meshes cut to a size to train on."""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Mesh, Vectors

Faces = NDArray[np.intp]
"""(k,) numbers of faces, ascending."""


def patches(mesh: Mesh, *, faces: int) -> list[Faces]:
    """Halve a mesh across its longest side, and its halves, until none has more than so many faces."""
    done, waiting = [], [np.arange(len(mesh.faces))]
    while waiting:
        chosen = waiting.pop()
        if len(chosen) <= faces:
            done.append(chosen)
            continue
        centroids = mesh.centroids[chosen]
        along = np.argsort(centroids[:, np.argmax(np.ptp(centroids, axis=0))], kind="stable")
        middle = len(chosen) // 2
        waiting += [np.sort(chosen[along[middle:]]), np.sort(chosen[along[:middle]])]
    return done


def patch(mesh: Mesh, chosen: Faces) -> Mesh:
    """Return some of the faces of a mesh, over the vertices that they use."""
    return compact(mesh.vertices, mesh.faces[chosen])


def compact(vertices: Vectors, faces: NDArray[np.int32]) -> Mesh:
    """Keep the vertices that have faces."""
    names, packed = np.unique(faces, return_inverse=True)
    return Mesh(vertices[names], packed.reshape(-1, 3))
