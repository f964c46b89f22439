"""Parse, check, create and encode the JSON document of glTF."""

import json
from typing import Any

import numpy as np

from cascadenorm.errors import ReadError
from cascadenorm.io.content import CHANNELS, Content, Look, channels
from cascadenorm.io.gltf.accessors import NewAccessors
from cascadenorm.mesh.polygons import triangulate

LISTS = ("accessors", "buffers", "bufferViews", "images", "materials", "meshes", "nodes", "scenes")
"""Names in a document with lists of objects."""


def parsed(data: bytes) -> Any:
    """Parse a document, keeping bytes that are not UTF-8. Raises ValueError or RecursionError for invalid JSON."""
    return json.loads(data.decode("utf-8", "surrogateescape").removeprefix("\ufeff"))


def encoded(document: dict[str, Any]) -> bytes:
    """Return the text of a document. Non-ASCII characters are escaped, so that any text can be written."""
    return json.dumps(document, separators=(",", ":")).encode()


def check_lists(document: dict[str, Any]) -> None:
    """Raise ReadError if an entry of a document that must be a list of objects or names is something else."""
    for name in LISTS:
        parts = document.get(name, [])
        if not (isinstance(parts, list) and all(isinstance(part, dict) for part in parts)):
            raise ReadError(f"{name!r} in the glTF document is not a list of objects: export the file again")
    for name in ("extensionsRequired", "extensionsUsed"):
        if not isinstance(document.get(name, []), list):
            raise ReadError(f"{name!r} in the glTF document is not a list: export the file again")
    for name in ("buffers", "images"):
        for number, part in enumerate(document.get(name, [])):
            if not isinstance(part.get("uri"), str | None):
                raise ReadError(f"the URI of {name}[{number}] in the glTF document is not text: export the file again")


def document_of(content: Content) -> tuple[dict[str, Any], bytes, list[str]]:
    """Return a document of one mesh with vertex colours and texture coordinates, its buffer, and what is lost."""
    triangles, _ = triangulate(content.positions, content.polygons)
    positions = content.single_positions().astype("<f4", copy=False)
    added = NewAccessors({})
    attributes = {"POSITION": added.add(positions, bounds=True)}
    colors = channels(content.vertex_values)
    if colors:
        opaque = np.full(len(positions), 255, np.uint8)
        rgba = np.stack([colors.get(name, opaque) for name in CHANNELS], axis=1)
        attributes["COLOR_0"] = added.add(rgba, normalized=True)
    look = Look.of(content.vertex_values)
    if look.texture is not None:
        s, t = look.texture.T
        attributes["TEXCOORD_0"] = added.add(np.stack([s, 1 - t], axis=1).astype("<f4"))  # glTF counts from the top
    indices = added.add(triangles.astype("<u4").reshape(-1, 1), indices=True)
    document = {
        "asset": {"version": "2.0", "generator": "cascadenorm"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices}]}],
        "accessors": added.accessors,
        "bufferViews": added.views,
        "buffers": [{"byteLength": len(added.data)}],
    }
    return document, bytes(added.data), content.lost_as_triangles((*colors, *look.names))
