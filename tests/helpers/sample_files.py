"""A small mesh file of each format, and reading and writing files in memory."""

import io as streams
import json
import re
import struct
from base64 import b64encode

import numpy as np
import pytest

from cascadenorm import io

TETRAHEDRON = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
SIDES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]

PLY_TEXT = """ply
format ascii 1.0
comment caf\xe9, made by  hand
obj_info num_cols 4
element vertex 5
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
property double quality
element face 3
property list uchar int vertex_indices
property int material
element edge 1
property int vertex1
property int vertex2
end_header
0 0.10 0 255 0 0 0.5
1.000 0 0 0 255 0 0.25
1 1 1e-3 0 0 255 -1
0   1\t0 1 2 3 4
0.5 0.5 1 9 9 9 9
4 0 1 2 3 7
3 0 1 4 8
3 1 2 4 9
0 1
""".encode("latin-1")


def ply_binary(order: str) -> bytes:
    """Return a binary PLY with normals, a quad between triangles, a list per vertex and an element after the faces."""
    name = {"<": "little", ">": "big"}[order]
    header = f"""ply
format binary_{name}_endian 1.0
comment keep me
element camera 1
property float fov
element vertex 4
property double x
property double y
property double z
property float nx
property float ny
property float nz
property list uchar short views
element face 4
property uchar flags
property list uchar uint vertex_index
property list uchar float texcoord
element range_grid 2
property list uchar int vertex_indices
end_header
"""
    body = struct.pack(order + "f", 0.7)
    for i, p in enumerate(TETRAHEDRON):
        body += struct.pack(order + "3d3f", *p, 0, 0, 1) + struct.pack(order + "B" + "h" * i, i, *range(i))
    for f in [*SIDES[:3], (0, 3, 2, 1)]:
        uv = np.arange(2 * len(f)) / 8
        body += struct.pack(f"{order}BB{len(f)}I", 1, len(f), *f) + struct.pack(f"{order}B{len(uv)}f", len(uv), *uv)
    return header.encode() + body + struct.pack(order + "BBi", 0, 1, 3)


OBJ = b"""# exported by nobody # twice
mtllib some materials.mtl
o first part
v 0 0 0 1.0 0.5 0.25
v 1.0  0 0 1.0 0.5 0.25
v\t1 1 0 1.0 0.5 0.25 # remark
v 0 1 0 1.0 0.5 0.25
v 0 0 1 1.0 0.5 0.25
vt 0 0
vt 1 0
vt 0.5 1
vn 0 0 1
vn 0 0 -1
g base
usemtl steel # shiny
s 1
f 1/1/1 2/2/1 3/3/1 4/1/1
s off
f -5//2 -4//2 \\
  -1//2
f 2 3 5
l 1 2
"""

MATERIALS = b"""newmtl steel\r
Kd 0.5 0.5 0.5\r
map_Kd -s 1 1 1 -o 0 0 -mm 0 1 maps/rust and dust.png\r
  bump -bm 0.2 maps\\bumps.png\r
map_Ks ../gloss.png
# map_Ka old.png
"""


def stl_binary() -> bytes:
    """Return the tetrahedron with a coloured header and an attribute for each face."""
    records = np.zeros(4, [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    records["c"], records["a"] = np.array(TETRAHEDRON)[np.array(SIDES)], [1, 2, 3, 65535]
    return b"solid COLOR=\xff\x00\x7f\xff".ljust(80, b" ") + struct.pack("<I", 4) + records.tobytes()


def stl_text() -> bytes:
    """Return the tetrahedron as two solids."""
    out = ""
    for name, sides in ("first vertex", SIDES[:2]), ("zweites St\xfcck", SIDES[2:]):
        out += f"solid {name}\r\n"
        for side in sides:
            out += "  facet normal 0 0 0\r\n    outer loop\r\n"
            out += "".join("      vertex {:.1f} {} {:e}\r\n".format(*TETRAHEDRON[v]) for v in side)
            out += "    endloop\r\n  endfacet\r\n"
        out += f"endsolid {name}\r\n"
    return out.encode("latin-1")


OFF = b"""OFF # a comment
# another
5 4 0

0 0 0
1 0 0
1.50 1 0 # here too
0 1 0
0.5 0.5 1
4 0 1 2 3 255 0 0
3 0 1 4 0 255 0
3 1 2 4 0 0 255
3 2 3 4 1 1 1
"""
COFF = b"COFF 4 2 0\n0 0 0 1 2 3 255\n1 0 0 4 5 6 255\n1 1 0 7 8 9 255\n0 1 0 0 0 0 255\n3 0 1 2\n3 0 2 3\n"
NOFF = b"NOFF\n4 2 0\n0 0 0 0 0 1\n1 0 0 0 0 1\n1 1 0 0 0 1\n0 1 0 0 0 1\n3 0 1 2\n3 0 2 3"

OFF_TETRAHEDRON = b"\n".join(
    [b"OFF", b"4 4 6", *(b"%d %d %d" % p for p in TETRAHEDRON), *(b"3 %d %d %d" % s for s in SIDES), b""]
)


def glb() -> bytes:
    """Return two meshes in interleaved and packed vectors: a quad with a cut across it, and a strip shown twice."""
    cut = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], "<f4")
    up = np.tile(np.array([(0, 0, 1)], "<f4"), (6, 1))
    strip = np.array([(0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, 0)], "<f4")
    parts = [np.hstack([cut, up]).tobytes(), bytes(range(48)), struct.pack("<6H", 0, 1, 2, 3, 5, 4), strip.tobytes()]
    starts = np.cumsum([0, *map(len, parts)]).tolist()
    views = [{"buffer": 0, "byteOffset": s, "byteLength": len(p)} for s, p in zip(starts, parts, strict=False)]
    views[0]["byteStride"] = 24
    vec3 = {"componentType": 5126, "type": "VEC3"}
    document = {
        "asset": {"version": "2.0", "generator": "caf\xe9 3.10"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [{"mesh": 0, "scale": [2, 2, 2]}, {"mesh": 1}, {"mesh": 1, "translation": [5.0, 0, 0.1]}],
        "materials": [{"name": "steel", "extras": {"id": 12345678901234567890, "x": 1e-07}}],
        "meshes": [
            {
                "name": "cut",
                "primitives": [
                    {"attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}, "indices": 3, "material": 0},
                    {"attributes": {"POSITION": 0}, "mode": 0},
                ],
            },
            {"primitives": [{"attributes": {"POSITION": 4}, "mode": 5}]},
        ],
        "accessors": [
            {"bufferView": 0, "count": 6, **vec3, "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 0, "byteOffset": 12, "count": 6, **vec3},
            {"bufferView": 1, "componentType": 5126, "count": 6, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
            {"bufferView": 3, "count": 4, **vec3, "min": [0, 0, 0], "max": [1, 1, 0]},
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": starts[-1]}],
    }
    text = json.dumps(document, ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    chunks = [(b"JSON", text), (b"BIN\0", b"".join(parts)), (b"EXTR", b"1234")]
    body = b"".join(struct.pack("<I4s", len(chunk), name) + chunk for name, chunk in chunks)
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def gltf() -> bytes:
    """Return the same document as text, spaced by hand, with its buffer in it."""
    data = glb()
    size = int.from_bytes(data[12:16], "little")
    document = json.loads(data[20 : 20 + size])
    start = 28 + size
    (buffer,) = document["buffers"]
    buffer["uri"] = "data:application/gltf-buffer;base64," + b64encode(data[start : start + 252]).decode()
    return json.dumps(document, ensure_ascii=False, indent=1).replace("0.1", "1.0E-1 ").encode()


SAMPLES = {
    "ply text": PLY_TEXT,
    "ply text, crlf": PLY_TEXT.replace(b"\n", b"\r\n"),
    "ply little": ply_binary("<"),
    "ply big": ply_binary(">"),
    "obj": OBJ,
    "obj, crlf": OBJ.replace(b"\n", b"\r\n"),
    "stl binary": stl_binary(),
    "stl text": stl_text(),
    "off": OFF,
    "off, colours": COFF,
    "off, normals": NOFF,
    "glb": glb(),
    "gltf": gltf(),
}


SAMPLES_FORMAT = {name: re.match(r"\w+", name)[0] for name in SAMPLES}
NATIVE = ("ply", "obj", "stl", "off")
every_sample = pytest.mark.parametrize("data", SAMPLES.values(), ids=SAMPLES.keys())


def read(data: bytes, format: str | None = None) -> io.MeshFile:
    return io.read(streams.BytesIO(data), format)


def written(file: io.MeshFile) -> bytes:
    return b"".join(file.pieces())
