"""Components of several sizes, side by side in one mesh."""

from shapes import cube, icosphere, together

LARGE, MIDDLE, SMALL = icosphere(4), icosphere(1), cube(1)  # 5120, 80 and 12 faces
PARTS = (SMALL, LARGE, MIDDLE, SMALL)


def in_a_row(*meshes):
    """The meshes side by side as one."""
    return together(*(mesh.moved(mesh.vertices + 5.0 * number) for number, mesh in enumerate(meshes)))
