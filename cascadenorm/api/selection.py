"""Resolve controls that refer to names in a mesh file.

Vertices are selected by attributes, indices and other files, and faces by their labels.
"""

import re
from collections.abc import Iterable, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.controls.creases import renumbered_creases
from cascadenorm.controls.weights import mask_weights, selected_faces, selected_vertices
from cascadenorm.errors import ParameterError
from cascadenorm.io import MeshFile
from cascadenorm.registry.controls import Controls

ARRAY_FILES = (".npy", ".txt")
INDEX_RANGE = re.compile(r"\s*([0-9]{1,18})\s*(?:-\s*([0-9]{1,18})\s*)?")  # matches "5" or "7-20"
MAX_LISTED_NAMES = 20  # listed in a message


def resolve_controls(controls: Controls, file: MeshFile, welded: MeshFile | None = None) -> Controls:
    """Return the controls with names replaced by arrays over the mesh of a file.

    Names and indices, in text or in other files, refer to the vertices of the mesh file, from 0; attributes are named
    like PLY properties. Arrays have one entry per vertex of the file or of its mesh; `only` has one per triangle of the
    file, including those that its mesh leaves out. If the file splits a vertex, the smallest weight of its copies
    applies, and the vertex is fixed if one of its copies is. If `welded` is given, the same file after welding, the
    returned arrays are over its mesh. Raises ParameterError if a name is not in the file, a file cannot be read, or an
    index is out of range.
    """
    given = (controls["mask"], controls["fixed"], controls["creases"])
    mask, fixed, creases = (fspath(one) if isinstance(one, PathLike) else one for one in given)
    found = controls.copy()
    if mask is not None:
        found["mask"] = _mask(mask, file)
    if fixed is not None:
        found["fixed"] = _fixed(fixed, file)
    if isinstance(creases, str):
        found["creases"] = _creases(creases, file)
    if controls["only"] is not None:
        found["only"] = _only(controls["only"], file if welded is None else welded)
    return found if welded is None else weld_controls(found, file.at_vertices(welded.welds))


def weld_controls(controls: Controls, welds: NDArray[np.int32]) -> Controls:
    """Return controls over split vertices as controls over the welded ones, given by their indices `welds`, (k,).

    The smallest weight of the copies applies, and a vertex is fixed if one of its copies is. Raises ParameterError for
    a mask or fixed vertices that do not fit the split vertices.
    """
    found = controls.copy()
    if controls["mask"] is not None:
        found["mask"] = _reduce_copies(mask_weights(controls["mask"], len(welds)), welds, np.minimum)
    if controls["fixed"] is not None:
        found["fixed"] = _reduce_copies(selected_vertices("fixed", controls["fixed"], len(welds)), welds, np.maximum)
    found["creases"] = renumbered_creases(controls["creases"], welds)
    return found


def labelled_faces(names: Sequence[str], file: MeshFile) -> NDArray[np.bool_]:
    """Return (m,) bool, the triangles of the mesh of a file that carry one of the labels.

    A label is a name, such as that of a material, or kind=name, such as material=steel or, for numbers, segment=3.
    Raises ParameterError for a label that no face carries.
    """
    labels = file.face_labels()
    chosen = np.zeros(len(file.polygons), bool)
    for name in names:
        kind, _, value = name.partition("=")
        found = [label.carrying(name) for label in labels if label.values.dtype.kind == "U"]
        found += [label.carrying(value) for label in labels if label.kind == kind]
        carrying = np.any(found, axis=0) if found else chosen
        if not carrying[file.triangle_polygons].any():
            alike = [label for label in labels if label.kind == kind] or labels
            known = dict.fromkeys(f"{label.kind}={v}" for label in alike for v in label.values.tolist() if v != "")
            there = f"there are: {_listed(known)}" if known else "the file has no labels of faces"
            raise ParameterError(f"matches no face with {name!r}; {there}", parameter="only")
        chosen = chosen | carrying
    return chosen[file.triangle_polygons[~file.left_out]]


def _mask(mask: Any, file: MeshFile) -> NDArray[Any]:
    if not isinstance(mask, str):
        return _reduce_copies(np.asarray(mask), file.welds, np.minimum)
    attributes = _attributes(file)
    if mask in attributes:
        values = weights_of_attribute(attributes[mask])
    elif mask.endswith(ARRAY_FILES):
        values = _read_table("mask", mask, 1)[:, 0]
    else:
        raise ParameterError(
            f"is {mask!r}; it must be a file {' or '.join(ARRAY_FILES)}, or a vertex attribute of the mesh; it has: "
            f"{_listed(attributes)}",
            parameter="mask",
        )
    return _reduce_copies(values, file.welds, np.minimum)


def weights_of_attribute(values: NDArray[Any]) -> NDArray[Any]:
    """Return a vertex attribute as weights. Bytes are divided by 255 unless none is above 1, as for bool."""
    return values / 255 if values.dtype == np.uint8 and values.max(initial=0) > 1 else values


def _fixed(fixed: Any, file: MeshFile) -> NDArray[Any]:
    """Return fixed vertices as indices or bool over the mesh of the file."""
    # An array of bool, or of indices into the mesh
    if not isinstance(fixed, str):
        given = np.asarray(fixed)
        return _reduce_copies(given, file.welds, np.maximum) if given.dtype == bool else given

    # An attribute or another file
    count, attributes = len(file.positions), _attributes(file)
    if fixed in attributes:
        return _reduce_copies(np.asarray(attributes[fixed] != 0), file.welds, np.maximum)
    if fixed.endswith(ARRAY_FILES):
        column = _read_table("fixed", fixed, 1)[:, 0]
        if column.dtype == bool:
            return _reduce_copies(column, file.welds, np.maximum)
        return file.welds[_vertex_indices("fixed", column, count)]

    # Indices and ranges
    ranges = [INDEX_RANGE.fullmatch(part) for part in fixed.split(",")]
    if not all(ranges):
        raise ParameterError(
            f'is {fixed!r}; it must be vertex indices such as "0,5,7-20", a file {" or ".join(ARRAY_FILES)} of them, '
            f"or a vertex attribute; the file has: {_listed(attributes)}",
            parameter="fixed",
        )
    ends = np.array([sorted((int(part[1]), int(part[2] or part[1]))) for part in ranges if part])
    within = _vertex_indices("fixed", ends, count)
    indices: NDArray[np.int64] = np.concatenate([np.arange(first, last + 1) for first, last in within])
    return file.welds[indices]


def _only(only: Any, file: MeshFile) -> NDArray[np.bool_]:
    """Return (m,) bool, the faces of the mesh selected by labels or among all triangles of the file."""
    names = [only] if isinstance(only, str) else only
    if isinstance(names, Sequence) and names and all(isinstance(name, str) for name in names):
        return labelled_faces(names, file)
    return selected_faces(only, len(file.triangles))[~file.left_out]


def _creases(creases: str, file: MeshFile) -> float | NDArray[Any]:
    try:
        return float(creases)
    except ValueError:
        if not creases.endswith(ARRAY_FILES):
            raise ParameterError(
                f"is {creases!r}; it must be an angle in degrees, or a file {' or '.join(ARRAY_FILES)} with the two "
                "vertex indices of an edge in each row",
                parameter="creases",
            ) from None
    return file.welds[_vertex_indices("creases", _read_table("creases", creases, 2), len(file.positions))]


def _attributes(file: MeshFile) -> dict[str, NDArray[Any]]:
    return {name: value for name, value in file.vertex_values.items() if value.shape == (len(file.positions),)}


def _reduce_copies(values: NDArray[Any], welds: NDArray[np.int32], smallest_or_largest: np.ufunc) -> NDArray[Any]:
    """Reduce values at the vertices of a file to those of its mesh; other arrays are checked where they are used."""
    if values.shape != welds.shape or values.dtype.kind not in "biuf":
        return values
    joined = np.empty(welds.max(initial=-1) + 1, values.dtype)
    joined[welds] = values
    with np.errstate(invalid="ignore"):  # NaN, which is rejected where the values are used
        smallest_or_largest.at(joined, welds, values)
    return joined


def _vertex_indices(name: str, indices: NDArray[Any], count: int) -> NDArray[np.int64]:
    bad = ~np.asarray((indices >= 0) & (indices < count) & (indices % 1 == 0), bool)
    if bad.any():
        raise ParameterError(
            f"references vertex {indices[bad][0]:.15g}; the file has {count} vertices, counted from 0 in whole numbers",
            parameter=name,
        )
    return indices.astype(np.int64)


def _read_table(name: str, path: str, columns: int) -> NDArray[Any]:
    """Read the numbers of a file into rows of `columns` values."""
    try:
        if path.endswith(".npy"):
            table = np.asarray(np.load(path, allow_pickle=False))
        else:
            text = Path(path).read_text(encoding="utf-8-sig")
            lines = (re.split(r"[\s,;]+", line.partition("#")[0].strip()) for line in text.splitlines())
            table = np.array([line for line in lines if line != [""]], np.float64)
    except FileNotFoundError:
        raise ParameterError(f"is {path!r}, a file that does not exist", parameter=name) from None
    except (OSError, EOFError, ValueError) as error:
        raise ParameterError(f"is {path!r}, which cannot be read as numbers: {error}", parameter=name) from None
    rows = table.reshape(-1, 1) if table.ndim == 1 and columns == 1 else table
    if (rows.ndim != 2 or rows.shape[1] != columns or rows.dtype.kind not in "biuf") and rows.size:
        raise ParameterError(
            f"is {path!r}, which has shape {table.shape}; it must have {columns} numbers in each row", parameter=name
        )
    return rows.reshape(-1, columns)


def _listed(names: Iterable[str]) -> str:
    listed = list(names)
    return ", ".join(listed[:MAX_LISTED_NAMES]) + (", …" if len(listed) > MAX_LISTED_NAMES else "") or "none"
