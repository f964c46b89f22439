"""Parse, check, create and encode the JSON document of glTF."""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.colors import CHANNELS, Look, channels
from cascadenorm.io.content import Content
from cascadenorm.io.gltf.accessors import COMPONENT_COUNTS, COMPONENT_TYPES
from cascadenorm.mesh import box_of
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
    arrays = {"POSITION": positions}
    colors = channels(content.vertex_values)
    if colors:
        opaque = np.full(len(positions), 255, np.uint8)
        arrays["COLOR_0"] = np.stack([colors.get(name, opaque) for name in CHANNELS], axis=1)
    look = Look.of(content.vertex_values)
    if look.texture is not None:
        s, t = look.texture.T
        arrays["TEXCOORD_0"] = np.stack([s, 1 - t], axis=1).astype("<f4")  # glTF counts from the top
    document, buffer = _assembled(arrays, triangles.astype("<u4").reshape(-1, 1))
    return document, buffer, content.lost_as_triangles((*colors, *look.names))


def _assembled(arrays: dict[str, NDArray[Any]], indices: NDArray[Any]) -> tuple[dict[str, Any], bytes]:
    """Return a document with one mesh of these attributes, and its buffer."""
    parts = [*arrays.values(), indices]
    numbers = {np.dtype(kind): number for number, kind in COMPONENT_TYPES.items()}
    types = {count: name for name, count in COMPONENT_COUNTS.items()}
    starts = np.cumsum([0, *(part.nbytes for part in parts)]).tolist()
    accessors = [
        {"bufferView": i, "componentType": numbers[part.dtype], "count": len(part), "type": types[part.shape[1]]}
        for i, part in enumerate(parts)
    ]
    position = next(iter(arrays.values()))
    if len(position):
        lower, upper = box_of(position)
        accessors[0] |= {"min": lower.tolist(), "max": upper.tolist()}
    if "COLOR_0" in arrays:
        accessors[list(arrays).index("COLOR_0")]["normalized"] = True
    primitive = {"attributes": {name: i for i, name in enumerate(arrays)}, "indices": len(arrays)}
    views = [{"buffer": 0, "byteOffset": a, "byteLength": part.nbytes} for a, part in zip(starts, parts, strict=False)]
    document = {
        "asset": {"version": "2.0", "generator": "cascadenorm"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": starts[-1]}],
    }
    return document, b"".join(np.ascontiguousarray(part).view(np.uint8).data for part in parts)
