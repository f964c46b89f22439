"""The scene graph of a COLLADA document: nodes with geometries, other nodes, and skinned geometries."""

from collections.abc import Callable

import numpy as np
import scipy

from cascadenorm.errors import ReadError
from cascadenorm.io.shown import Matrix
from cascadenorm.io.xml.documents import Element
from cascadenorm.mesh import unit

Placed = list[tuple[Element, Matrix]]
INSTANCES = ("instance_geometry", "instance_node", "instance_controller")
SIZES = {"matrix": 16, "translate": 3, "rotate": 4, "scale": 3}


def instances(root: Element, by_id: dict[str, Element]) -> tuple[Placed, Callable[[Element], Placed]]:
    """Return the nodes of the scene, and a function that returns the contents of an element in its own frame."""

    def target(element: Element, name: str = "url") -> Element | None:
        return by_id.get(element.attributes.get(name, "").removeprefix("#"))

    def inner(element: Element) -> Placed:
        if element.name == "controller":  # the deformation applies before its frame
            source = next((part for part in element.children if part.name in ("skin", "morph")), None)
            found = target(source, "source") if source is not None else None
            return [] if found is None else [(found, np.eye(4))]
        if element.name != "node":
            return []
        shown = [
            child if child.name == "node" else target(child)
            for child in element.children
            if child.name in ("node", *INSTANCES)
        ]
        matrix = _matrix(element) if shown else np.eye(4)  # those of cameras and lights do not matter
        return [(found, matrix) for found in shown if found is not None]

    scene = root.first("scene", "instance_visual_scene")
    chosen = target(scene) if scene is not None else root.first("library_visual_scenes", "visual_scene")
    nodes = [] if chosen is None else chosen.all("node")
    return [(node, np.eye(4)) for node in nodes], inner


def _matrix(node: Element) -> Matrix:
    """Return the product of the transforms of a node."""
    matrix = np.eye(4)
    with np.errstate(all="ignore"):
        for element in node.children:
            if element.name in ("lookat", "skew"):
                raise ReadError(f"a node of this COLLADA file has a transform {element.name!r}, which is not supported")
            if element.name in SIZES:
                matrix = matrix @ _transform(element)
    return matrix


def _transform(element: Element) -> Matrix:
    try:
        numbers = np.array([float(word) for word in element.numbers.split()])
    except ValueError:
        numbers = np.zeros(0)
    if len(numbers) != SIZES[element.name]:
        raise ReadError(
            f"a transform {element.name!r} of this COLLADA file has not {SIZES[element.name]} numbers: export it again"
        )
    if element.name == "matrix":
        return numbers.reshape(4, 4)
    matrix = np.eye(4)
    if element.name == "translate":
        matrix[:3, 3] = numbers
    elif element.name == "scale":
        matrix[:3, :3] = np.diag(numbers)
    else:
        turn = scipy.spatial.transform.Rotation.from_rotvec(numbers[3] * unit(numbers[:3]), degrees=True)
        matrix[:3, :3] = turn.as_matrix()
    return matrix
