"""Join the meshes that a glTF scene shows into one mesh."""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.content import CHANNELS, Content, channels
from cascadenorm.io.gltf.accessors import Accessors, Primitive
from cascadenorm.io.shown import LARGEST, Matrix, Shown, joined
from cascadenorm.mesh.polygons import Polygons

KEPT_ELSEWHERE = ("materials", "textures", "animations", "skins", "cameras")


def content_of(
    document: dict[str, Any],
    accessors: Accessors,
    shapes: list[Primitive],
    positions_of: Callable[[Primitive], NDArray[Any]],
) -> Content:
    """Return the primitives of all meshes, transformed, once for each time that the scene shows their mesh."""
    filled = [shape for shape in shapes if len(shape.triangles)]
    of_mesh: dict[int, list[Primitive]] = {}
    for shape in _joined(filled):
        of_mesh.setdefault(shape.mesh, []).append(shape)
    meshes = of_mesh.keys()
    places = [(mesh, matrix) for mesh, matrix in _instances(document) if mesh in meshes]
    places = places or [(mesh, np.eye(4)) for mesh in meshes]  # a library of meshes without a scene
    placed = [(shape, matrix) for mesh, matrix in places for shape in of_mesh[mesh]]
    accessors.claim(sum(3 * len(shape.positions.at) + shape.triangles.size for shape, _ in placed))
    shown = [_shown(shape, accessors, positions_of(shape)).placed(matrix) for shape, matrix in placed]
    left_out = [key for key in KEPT_ELSEWHERE if document.get(key)]
    if len(filled) < len(shapes):
        left_out.append("points and lines")
    if meshes - {mesh for mesh, _ in places}:
        left_out.append("meshes that the scene does not show")
    positions, polygons, values, _ = joined(shown)
    names = {name for shape, _ in placed for name in shape.attributes}
    lost = {name for mesh in shown for name in mesh.vertex_values} - values.keys()
    kept = {"COLOR_0"} if "red" in values and not lost & {*CHANNELS} else set()
    kept |= {"TEXCOORD_0"} if "s" in values else set()
    left_out += [f"the attribute {name} of vertices" for name in sorted(names - kept - {"POSITION", "NORMAL"})]
    left_out += ["normals"] if "NORMAL" in names else []
    return Content(positions, polygons, values, left_out=tuple(left_out))


def _joined(shapes: list[Primitive]) -> list[Primitive]:
    """Join primitives of a mesh that share vertices. They usually differ in their materials."""
    alike: dict[tuple[Any, ...], list[Primitive]] = {}
    for shape in shapes:
        alike.setdefault((shape.mesh, *sorted(shape.attributes.items())), []).append(shape)
    return [
        group[0]._replace(triangles=np.concatenate([shape.triangles for shape in group])) for group in alike.values()
    ]


def _shown(shape: Primitive, accessors: Accessors, positions: NDArray[Any]) -> Shown:
    """Return a primitive with its colours and texture coordinates."""
    values, count = dict[str, NDArray[Any]](), len(positions)
    if "COLOR_0" in shape.attributes and len(colors := accessors.values(shape.attributes["COLOR_0"])) == count:
        values |= channels(dict(zip(CHANNELS, colors.T, strict=False)))
    texture = accessors.fractions(shape.attributes["TEXCOORD_0"]) if "TEXCOORD_0" in shape.attributes else None
    if texture is not None and len(texture) == count:
        values |= {"s": texture[:, 0], "t": 1 - texture[:, 1]}  # glTF counts from the top
    return Shown(positions, Polygons.from_rows(shape.triangles), values)


def _instances(document: dict[str, Any]) -> list[tuple[int, Matrix]]:
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
        if not (np.abs(matrix) < LARGEST).all():
            raise ReadError(f"the transform of node {number} is not finite: export the file again")
        if "mesh" in node:
            found.append((node["mesh"], np.eye(4) if "skin" in node else matrix))  # a skin places its mesh
        waiting += [(child, matrix) for child in reversed(node.get("children", []))]
    return found


def _matrix(node: dict[str, Any]) -> Matrix:
    """Return the transform of a node."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    turn = scipy.spatial.transform.Rotation.from_quat(node.get("rotation", (0.0, 0.0, 0.0, 1.0))).as_matrix()
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)), float)
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix
