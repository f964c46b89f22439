"""Join the meshes that a glTF scene shows into one mesh."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.colors import CHANNELS, channels
from cascadenorm.io.content import Content
from cascadenorm.io.gltf.accessors import Accessors
from cascadenorm.mesh.polygons import Polygons

KEPT_ELSEWHERE = ("materials", "textures", "animations", "skins", "cameras")
LARGEST_TRANSFORM = 1e30  # upper bound on the numbers of a transform

Matrix = NDArray[np.float64]


class ShownPrimitive(NamedTuple):
    """A primitive: the number of its mesh, its accessors by name, its positions, and (m, 3) rows of them."""

    mesh: int
    attributes: dict[str, int]
    positions: NDArray[Any]
    triangles: NDArray[np.int64]


def content_of(document: dict[str, Any], accessors: Accessors, shapes: list[ShownPrimitive]) -> Content:
    """Return the shapes, transformed, once for each time that the scene shows their mesh.

    Parameters
    ----------
    document
        Document from JSON, unchecked.
    accessors
        Accessors of the document, for colours and texture coordinates.
    shapes
        Primitives of all meshes.
    """
    filled = [shape for shape in shapes if len(shape.triangles)]
    of_mesh: dict[int, list[ShownPrimitive]] = {}
    for shape in _joined(filled):
        of_mesh.setdefault(shape.mesh, []).append(shape)
    meshes = of_mesh.keys()
    places = [(mesh, matrix) for mesh, matrix in _shown(document) if mesh in meshes]
    places = places or [(mesh, np.eye(4)) for mesh in meshes]  # a library of meshes without a scene
    accessors.claim(sum(shape.positions.size + shape.triangles.size for mesh, _ in places for shape in of_mesh[mesh]))
    shown = [_placed(shape, matrix) for mesh, matrix in places for shape in of_mesh[mesh]]
    left_out = [key for key in KEPT_ELSEWHERE if document.get(key)]
    if len(filled) < len(shapes):
        left_out.append("points and lines")
    if meshes - {mesh for mesh, _ in places}:
        left_out.append("meshes that the scene does not show")
    sizes = [len(shape.positions) for shape in shown]
    first = np.cumsum([0, *sizes])[:-1]
    triangles = [shape.triangles + start for shape, start in zip(shown, first, strict=True)]
    colors = _values(shown, "COLOR_0", accessors.values)
    texture = _values(shown, "TEXCOORD_0", accessors.fractions)
    values = {} if colors is None else channels(dict(zip(CHANNELS, colors.T, strict=False)))
    if texture is not None:
        values |= {"s": texture[:, 0], "t": 1 - texture[:, 1]}  # glTF counts from the top
    names = {name for shape in shown for name in shape.attributes} - {"POSITION", "NORMAL"}
    names -= {name for name, found in (("COLOR_0", colors), ("TEXCOORD_0", texture)) if found is not None}
    left_out += [f"the attribute {name} of vertices" for name in sorted(names)]
    if any("NORMAL" in shape.attributes for shape in shown):
        left_out.append("normals")
    return Content(
        np.concatenate([np.zeros((0, 3), np.float32), *(shape.positions for shape in shown)]),
        Polygons.from_rows(np.concatenate([np.zeros((0, 3), np.int64), *triangles])),
        values,
        left_out=tuple(left_out),
    )


def _joined(shapes: list[ShownPrimitive]) -> list[ShownPrimitive]:
    """Join primitives of a mesh that share vertices. They usually differ in their materials."""
    alike: dict[tuple[Any, ...], list[ShownPrimitive]] = {}
    for shape in shapes:
        alike.setdefault((shape.mesh, *sorted(shape.attributes.items())), []).append(shape)
    return [
        group[0]._replace(triangles=np.concatenate([shape.triangles for shape in group])) for group in alike.values()
    ]


def _placed(shape: ShownPrimitive, matrix: Matrix) -> ShownPrimitive:
    """Return a shape with the transform of the scene applied."""
    if np.array_equal(matrix, np.eye(4)):
        return shape
    mirrored = np.linalg.det(matrix[:3, :3]) < 0
    return shape._replace(
        positions=shape.positions @ matrix[:3, :3].T + matrix[:3, 3],
        triangles=shape.triangles[:, ::-1] if mirrored else shape.triangles,
    )


def _values(shown: list[ShownPrimitive], name: str, read: Callable[[int], NDArray[Any] | None]) -> NDArray[Any] | None:
    """Return an attribute of all shapes, one vector per row; None if one lacks it or stores another type."""
    if not shown or any(name not in shape.attributes for shape in shown):
        return None
    parts = [part for shape in shown if (part := read(shape.attributes[name])) is not None]
    if len(parts) < len(shown) or any(
        len(part) != len(shape.positions) for part, shape in zip(parts, shown, strict=True)
    ):
        return None
    if len({part.dtype for part in parts}) > 1 or len({part.shape[1] for part in parts}) > 1:
        return None
    return np.concatenate(parts)


def _shown(document: dict[str, Any]) -> list[tuple[int, Matrix]]:
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
        if not (np.abs(matrix) < LARGEST_TRANSFORM).all():
            raise ReadError(f"the transform of node {number} is not finite: export the file again")
        if "mesh" in node:
            found.append((node["mesh"], np.eye(4) if "skin" in node else matrix))  # a skin places its mesh
        waiting += [(child, matrix) for child in reversed(node.get("children", []))]
    return found


def _matrix(node: dict[str, Any]) -> Matrix:
    """Return the transform of a node."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    turn = np.array(
        [
            (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
            (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
            (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)), float)
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix
