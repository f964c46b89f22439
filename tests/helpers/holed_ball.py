"""A ball with a hole, as a mesh and in files that hold all that they may, and the ball filled."""

import numpy as np
from shapes import icosphere

import cascadenorm as cn
from cascadenorm.api.filled_files import fill_holes_file
from cascadenorm.geometry.holes.filling import fill_holes
from cascadenorm.mesh import Mesh

BALL = icosphere(3)
HOLED = Mesh(BALL.vertices, BALL.faces[BALL.centroids[:, 2] < 0.9])
COUNT, FACES = len(HOLED.vertices), len(HOLED.faces)
FILLED = fill_holes(HOLED)
HEIGHT = HOLED.vertices[:, 2]
GREEN = np.rint(100 + 50 * HEIGHT).astype(int)
SIDE = (HOLED.centroids[:, 0] > 0).astype(int)


def ply_text(end_of_line: str = "\n", kind: str = "double") -> bytes:
    """The holed ball with all that a PLY file may hold; faces have a list more, another element lies between."""
    lines = [
        *["ply", "format ascii 1.0", "comment element vertex 3", "obj_info by hand", f"element vertex {COUNT}"],
        *[f"property {kind} {axis}" for axis in "xyz"],
        *["property float height", "property uchar green", "property int number", "property list uchar int near"],
        *["element camera 1", "property float angle", f"element face {FACES}", "property uchar side"],
        *["property list uchar int vertex_indices", "property list uchar float texcoord", "element rest 1"],
        *["property int last", "end_header"],
    ]
    vertices = zip(HOLED.vertices.tolist(), HEIGHT.tolist(), GREEN.tolist(), strict=True)
    lines += [f"{x!r} {y!r} {z!r} {h!r} {g} {i} 2 5 6" for i, ((x, y, z), h, g) in enumerate(vertices)]
    faces = zip(HOLED.faces.tolist(), SIDE.tolist(), strict=True)
    lines += ["0.5", *(f"{side} 3 {a} {b} {c} 6 0 0 1 0 0 1" for (a, b, c), side in faces), "77"]
    return (end_of_line.join(lines) + end_of_line).encode()


def ply_binary(byte_order: str) -> bytes:
    """The same in binary, with normals of vertices that point inward, and of faces."""
    name = {"<": "little", ">": "big"}[byte_order]
    header = [
        *["ply", f"format binary_{name}_endian 1.0", f"element vertex {COUNT}", "property list uchar short near"],
        *[f"property float {axis}" for axis in ("x", "y", "z", "nx", "ny", "nz")],
        *["property uchar green", "property ushort number", f"element face {FACES}"],
        *["property list uchar uint vertex_index", "property double side", "element rest 1", "property int last"],
        "end_header\n",
    ]
    near, xyz = np.dtype([("n", "u1"), ("near", byte_order + "i2", 2)]), byte_order + "f4"
    vertices = np.zeros(COUNT, [("l", near), ("x", xyz, 3), ("n", xyz, 3), ("g", "u1"), ("i", byte_order + "u2")])
    vertices["l"]["n"], vertices["x"], vertices["n"], vertices["g"] = 2, HOLED.vertices, -HOLED.vertex_normals, GREEN
    vertices["i"] = np.arange(COUNT)
    faces = np.zeros(FACES, [("n", "u1"), ("corners", byte_order + "u4", 3), ("side", byte_order + "f8")])
    faces["n"], faces["corners"], faces["side"] = 3, HOLED.faces, SIDE
    rest = np.array([77], byte_order + "i4")
    return "\n".join(header).encode() + vertices.tobytes() + faces.tobytes() + rest.tobytes()


def filled(tmp_path, data: bytes, suffix: str, output: str | None = None, **settings):
    """Fill a file; the file that comes out, and what was done."""
    source, target = tmp_path / f"holed{suffix}", tmp_path / f"filled{output or suffix}"
    source.write_bytes(data)
    done = fill_holes_file(source, target, **settings)
    return cn.read(target), done
