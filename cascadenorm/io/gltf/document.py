"""The JSON document of glTF: parse, check and encode it, and convert its scene to one mesh and a mesh to a document."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.content import CHANNELS, Content, Look, as_bytes, channels
from cascadenorm.io.gltf.accessors import Accessors, NewAccessors, Primitive
from cascadenorm.io.shown import LARGEST_ENTRY, Matrix, joined, placed
from cascadenorm.mesh.polygons import Polygons, triangulate

KEPT_ELSEWHERE = ("materials", "textures", "animations", "skins", "cameras")
INSTANCES = "EXT_mesh_gpu_instancing"
LISTS = ("accessors", "buffers", "bufferViews", "images", "materials", "meshes", "nodes", "scenes")
"""Names in a document with lists of objects."""


def parsed(data: bytes) -> Any:
    """Parse a document, keeping bytes that are not UTF-8. Raises ValueError or RecursionError for invalid JSON."""
    return json.loads(data.decode("utf-8", "surrogateescape").removeprefix("\ufeff"))


def json_bytes(document: dict[str, Any]) -> bytes:
    """Return the text of a document. Non-ASCII characters are escaped, so that any text can be written."""
    return json.dumps(document, separators=(",", ":")).encode()


def check_lists(document: dict[str, Any]) -> None:
    """Raise ReadError if a document needs another version, or if an entry that must be a list has other content."""
    asset = document.get("asset")
    given = asset if isinstance(asset, dict) else {}
    version, needed = (str(given.get(name) or "2.0") for name in ("version", "minVersion"))
    if not version.startswith("2"):  # in version 1, entries are objects by name
        raise ReadError(f"this glTF file has version {version}; only version 2 is supported: export it again")
    if needed > "2.0":
        raise ReadError(f"this glTF file needs version {needed}; only version 2.0 is supported: export it again")
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


def document_content(
    document: dict[str, Any],
    accessors: Accessors,
    shapes: list[Primitive],
    positions_of: Callable[[Primitive], NDArray[Any]],
) -> Content:
    """Return the primitives of all meshes, transformed, once for each time that the scene shows their mesh."""
    of_mesh: dict[int, list[Primitive]] = {}
    for shape in joined_primitives(shapes):
        of_mesh.setdefault(shape.mesh, []).append(shape)
    meshes = of_mesh.keys()
    places = [(mesh, matrix) for mesh, matrix in instances(document) if mesh in meshes]
    places = places or [(mesh, np.eye(4)) for mesh in meshes]  # a library of meshes without a scene
    uses = [(shape, matrix) for mesh, matrix in places for shape in of_mesh[mesh]]
    accessors.claim(sum(3 * len(shape.positions.at) + shape.triangles.size for shape, _ in uses))
    shown = [placed(shape_content(shape, accessors, positions_of(shape)), matrix) for shape, matrix in uses]
    left_out = [key for key in KEPT_ELSEWHERE if document.get(key)]
    filled = [shape for shape in shapes if len(shape.triangles)]
    if any(document["meshes"][shape.mesh]["primitives"][shape.number].get("targets") for shape in filled):
        left_out.append("morph targets")
    if any(INSTANCES in node.get("extensions", {}) for node in document.get("nodes", [])):
        left_out.append(f"instances of meshes ({INSTANCES})")
    if len(filled) < len(shapes):
        left_out.append("points and lines")
    if meshes - {mesh for mesh, _ in places}:
        left_out.append("meshes that the scene does not show")
    whole = joined(shown)
    values = whole.vertex_values
    names = {name for shape, _ in uses for name in shape.attributes}
    lost = {name for mesh in shown for name in mesh.vertex_values} - values.keys()
    kept = {"COLOR_0"} if "red" in values and not lost & {*CHANNELS} else set()
    kept |= {"TEXCOORD_0"} if "s" in values else set()
    left_out += [f"the attribute {name} of vertices" for name in sorted(names - kept - {"POSITION", "NORMAL"})]
    left_out += ["normals"] if "NORMAL" in names else []
    return replace(whole, left_out=tuple(left_out))


def joined_primitives(shapes: list[Primitive]) -> list[Primitive]:
    """Join primitives of a mesh that share vertices, which usually differ in their materials; omit points and lines."""
    alike: dict[tuple[Any, ...], list[Primitive]] = {}
    for shape in shapes:
        if len(shape.triangles):
            alike.setdefault((shape.mesh, *sorted(shape.attributes.items())), []).append(shape)
    return [
        group[0]._replace(triangles=np.concatenate([shape.triangles for shape in group])) for group in alike.values()
    ]


def shape_content(shape: Primitive, accessors: Accessors, positions: NDArray[Any]) -> Content:
    """Return a primitive with its colours and texture coordinates."""
    values, count = dict[str, NDArray[Any]](), len(positions)
    if "COLOR_0" in shape.attributes and len(colors := accessors.values(shape.attributes["COLOR_0"])) == count:
        largest = 1 if colors.dtype.kind == "f" else np.iinfo(colors.dtype).max
        values |= dict(zip(CHANNELS, as_bytes(colors, largest).T, strict=False))
    texture = accessors.fractions(shape.attributes["TEXCOORD_0"]) if "TEXCOORD_0" in shape.attributes else None
    if texture is not None and len(texture) == count:
        values |= {"s": texture[:, 0], "t": 1 - texture[:, 1]}  # glTF counts from the top
    return Content(positions, Polygons.from_rows(shape.triangles), values)


def instances(document: dict[str, Any]) -> list[tuple[int, Matrix]]:
    """Return the meshes that the scene shows, with the transforms of their nodes."""
    nodes = document.get("nodes", [])
    if not nodes:
        return []
    inner = {child for node in nodes for child in node.get("children", [])}
    roots = [number for number in range(len(nodes)) if number not in inner]
    if document.get("scenes"):
        roots = document["scenes"][document.get("scene", 0)].get("nodes", [])
    found, waiting, seen = [], [(root, np.eye(4)) for root in reversed(roots)], set()
    while waiting:
        number, outer = waiting.pop()
        if number in seen:  # a node has only one parent
            continue
        seen.add(number)
        node = nodes[number]
        with np.errstate(all="ignore"):
            matrix = outer @ _matrix(node)
        if not (np.abs(matrix) < LARGEST_ENTRY).all():
            raise ReadError(f"the transform of node {number} is not finite: export the file again")
        if "mesh" in node:
            found.append((node["mesh"], np.eye(4) if "skin" in node else matrix))  # a skin places its mesh
        waiting += [(child, matrix) for child in reversed(node.get("children", []))]
    return found


def _matrix(node: dict[str, Any]) -> Matrix:
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    turn = scipy.spatial.transform.Rotation.from_quat(node.get("rotation", (0.0, 0.0, 0.0, 1.0))).as_matrix()
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)), float)
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix
