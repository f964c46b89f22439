"""glTF documents that several files of tests read."""

import json

import numpy as np
import trimesh
from shapes import icosphere, noisy

FAST = ["--method", "laplacian"]
BALL = noisy(icosphere(2), 0.2)
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
