"""Cut large meshes to a size that training can handle."""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Mesh

FaceNumbers = NDArray[np.intp]
"""(k,) face numbers, ascending."""


def training_patches(mesh: Mesh, *, faces: int) -> list[FaceNumbers]:
    """Halve a mesh across its longest side, recursively, until no part has more than `faces` faces."""
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
