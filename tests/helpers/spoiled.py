"""A mesh with bad vertices and faces, and files of such meshes."""

import numpy as np
from shapes import icosphere, noisy

BALL = noisy(icosphere(2), 0.2, seed=3)
COUNT = len(BALL.vertices)
NAN = np.array([0x7FF8DEADBEEF0001, 0xFFF0000000000000, 0x3FF0000000000000], np.uint64).view(np.float64)  # odd, -inf, 1


def spoiled() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The ball with two bad vertices and three bad faces more; and which of its faces are left."""
    vertices = BALL.vertices.copy()
    vertices[[7, 30]] = NAN
    bad = np.array([[0, 1, COUNT], [-1, 2, 3], [4, 4, 5]])
    faces = np.insert(BALL.faces, [0, 50, 320], bad, axis=0)
    touched = np.isin(faces, [7, 30]).any(axis=1)
    touched[[0, 51, 322]] = True
    return vertices, faces, touched


def ply(kind: str, vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """A PLY file in the given format, with normals and colours."""
    header = (
        f"ply\nformat {kind} 1.0\nelement vertex {len(vertices)}\n"
        + "".join(f"property double {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
        + f"property uchar red\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    if kind == "ascii":
        rows = [" ".join(map(repr, row.tolist())) + " 0.0 0.0 1.0 9" for row in vertices]
        return (header + "\n".join([*rows, *("3 " + " ".join(map(str, f)) for f in faces)]) + "\n").encode()
    table = np.zeros(len(vertices), [("x", "<f8", 3), ("n", "<f8", 3), ("red", "u1")])
    table["x"], table["n"], table["red"] = vertices, (0, 0, 1), 9
    rows = np.zeros(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    return header.encode() + table.tobytes() + rows.tobytes()
