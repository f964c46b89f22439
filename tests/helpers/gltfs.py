"""glTF documents that several files of tests read."""

import json
from base64 import b64encode

import numpy as np
import trimesh
from sample_files import gltf, read
from shapes import icosphere, noisy

from cascadenorm import io
from cascadenorm.io.gltf.gltf import GlbFile

FAST = ["--method", "laplacian"]
BALL = noisy(icosphere(2), 0.2)
COARSE = noisy(icosphere(3), 0.3)
VEC3 = {"componentType": 5126, "type": "VEC3"}
TEXT = """{ "asset":{"version" : "2.0"}, "extras":{"x":1e-07,"name":"caf\u00e9 \\u00e9 \\/"},
  "images":[{"uri":"maps/a%20colour.png"},{"uri":"data:image/png;base64,AAAA"}],
  "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2}]}],
  "accessors": [
    {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 162, "max": [ 9, 9, 9.0 ], "min": [-9,-9,-9]},
    {"bufferView": 1, "componentType": 5126, "type": "VEC3", "count": 162},
    {"bufferView": 2, "componentType": 5123, "type": "SCALAR", "count": 960, "max": [161]} ],
  "bufferViews": [{"buffer": 1, "byteLength": 1944}, {"buffer": 1, "byteOffset": 1944, "byteLength": 1944},
                  {"buffer": 0, "byteLength": 1920}],
  "buffers": [{"uri": "faces.bin", "byteLength": 1920}, {"byteLength": 3888, "uri": "the%20points.bin"}] }
"""
TWO_MESHES = {
    "asset": {"version": "2.0"},
    "meshes": [
        {"name": name, "primitives": [{"attributes": {"POSITION": i}, "indices": 2}]} for i, name in enumerate("ab")
    ],
    "accessors": [
        *({"bufferView": i, **VEC3, "count": len(BALL.vertices)} for i in range(2)),
        {"bufferView": 2, "componentType": 5123, "type": "SCALAR", "count": BALL.faces.size},
    ],
    "bufferViews": [{"buffer": i, "byteLength": size} for i, size in enumerate((1944, 1944, 1920))],
    "buffers": [{"uri": f"{name}.bin", "byteLength": size} for name, size in (("p", 1944), ("q", 1944), ("out", 1920))],
}


def document(data: bytes) -> dict:
    """Return the JSON of either container."""
    start = 20 if data[:4] == b"glTF" else 0
    return json.loads(data[start : start + int.from_bytes(data[12:16], "little")] if start else data)


def seen_by_trimesh(path) -> np.ndarray:
    """Return the positions as another reader finds them."""
    return np.concatenate([mesh.vertices for mesh in trimesh.load_scene(path, process=False).geometry.values()])


def beside_what_moves(document: dict) -> dict:
    """Return a document without bounds of accessors and names of buffers."""
    accessors = [{k: v for k, v in part.items() if k not in ("min", "max")} for part in document["accessors"]]
    buffers = [{k: v for k, v in part.items() if k != "uri"} for part in document["buffers"]]
    return document | {"accessors": accessors, "buffers": buffers}


def single(accessors: list, views: list[bytes], primitive: dict) -> bytes:
    """Return a document of one primitive, each view in a buffer of its own."""
    buffers = [{"byteLength": len(v), "uri": "data:;base64," + b64encode(v).decode()} for v in views]
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "meshes": [{"primitives": [primitive]}],
            "accessors": accessors,
            "bufferViews": [{"buffer": i, "byteLength": len(v)} for i, v in enumerate(views)],
            "buffers": buffers,
        }
    ).encode()


def changed(change) -> io.MeshFile:
    """Return the sample document after a change of its JSON."""
    found = json.loads(gltf())
    change(found)
    return read(json.dumps(found).encode())


def quantized(kind: str = "<u2", *, normalized: bool = False, faces: np.ndarray = COARSE.faces) -> bytes:
    """A GLB file whose positions are whole numbers and whose normals are bytes; a node scales it back."""
    largest = np.iinfo(kind).max
    lower = np.zeros(3) if kind[1] == "u" else np.full(3, -largest)
    size = np.ptp(COARSE.vertices, axis=0).max()
    whole = np.rint((COARSE.vertices - COARSE.vertices.min(axis=0)) / size * (largest - lower) + lower).astype(kind)
    cells = np.zeros((len(whole), -(-3 * whole.itemsize // 4) * 4), np.uint8)
    cells[:, : 3 * whole.itemsize] = whole.view(np.uint8).reshape(len(whole), -1)
    normals = np.zeros((len(whole), 4), np.int8)
    normals[:, :3] = np.rint(COARSE.vertex_normals * 127)
    parts = [cells.tobytes(), normals.tobytes(), faces.astype("<u2").tobytes()]
    starts = np.cumsum([0, *map(len, parts)]).tolist()
    strides = [cells.shape[1], 4, None]
    code = {"<u2": 5123, "<i2": 5122, "<u1": 5121, "<i1": 5120}[kind]
    described = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_mesh_quantization"],
        "extensionsRequired": ["KHR_mesh_quantization"],
        "nodes": [{"mesh": 0, "scale": [2.0, 2.0, 2.0], "translation": [1, 2, 3]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2}]}],
        "accessors": [
            {"bufferView": 0, "componentType": code, "type": "VEC3", "count": len(whole), "normalized": normalized}
            | {"min": whole.min(axis=0).tolist(), "max": whole.max(axis=0).tolist()},
            {"bufferView": 1, "componentType": 5120, "type": "VEC3", "count": len(whole), "normalized": True},
            {"bufferView": 2, "componentType": 5123, "type": "SCALAR", "count": faces.size},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": len(part)} | ({"byteStride": stride} if stride else {})
            for start, part, stride in zip(starts, parts, strides, strict=False)
        ],
        "buffers": [{"byteLength": starts[-1]}],
    }
    return b"".join(GlbFile._made(described, b"".join(parts)))


def with_attribute(name: str, values: np.ndarray, **described_too: object) -> bytes:
    """The quantised ball with one more attribute of its vertices."""
    data = quantized()
    described = document(data)
    size, kind = described["buffers"][0]["byteLength"], {"f": 5126, "u": 5123}[values.dtype.kind]
    described["meshes"][0]["primitives"][0]["attributes"][name] = len(described["accessors"])
    described["accessors"].append({"bufferView": 3, "componentType": kind, "count": len(values), **described_too})
    described["bufferViews"].append({"buffer": 0, "byteOffset": size, "byteLength": values.nbytes})
    described["buffers"][0]["byteLength"] += values.nbytes
    return b"".join(GlbFile._made(described, data[-size:] + values.tobytes()))
