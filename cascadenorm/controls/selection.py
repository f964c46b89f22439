"""What users name of a mesh file in words: vertices by attributes, numbers and other files, faces by their labels."""

import re
from collections.abc import Sequence
from dataclasses import replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.controls import Controls, faces_within
from cascadenorm.io import MeshFile
from cascadenorm.registry import ParameterError

FILES = (".npy", ".txt")
RUN = re.compile(r"\s*([0-9]{1,18})\s*(?:-\s*([0-9]{1,18})\s*)?")  # 5 or 7-20
MOST_NAMES = 20  # in a message


def selected(controls: Controls, file: MeshFile) -> Controls:
    """Return the controls with what they name in words as arrays over the mesh of a file.

    What is said in words, or stands in a file, counts the vertices of the mesh file from 0. Where that splits a vertex,
    the smallest weight of its copies counts, and it is fixed if one of them is.

    Parameters
    ----------
    controls : with, in words,
        mask: a vertex attribute of the file, in 0 … 255 where it is uint8, else in 0 … 1; or the name of a file .npy
        or .txt with one such number for each vertex
        fixed: numbers of vertices such as "0,5,7-20"; or an attribute that is not 0 where they are fixed; or the name
        of a file with numbers of vertices
        only: one or several labels of faces, each a name, or kind=name such as material=steel; numbers and arrays
        count all triangles of the file, those besides its mesh as well
        creases: an angle, or the name of a file with the two vertices of an edge in each row
    file : its attributes carry the names that PLY gives them; arrays of controls may have a value for each of its
        vertices, as well as for each of its mesh

    Raises
    ------
    ParameterError : names that the file does not have, files that cannot be read, numbers out of range
    """
    given = {name: getattr(controls, name) for name in ("mask", "fixed", "creases")}
    controls = replace(controls, **{name: fspath(at) for name, at in given.items() if isinstance(at, PathLike)})
    changed: dict[str, Any] = {}
    if controls.mask is not None:
        changed["mask"] = _mask(controls.mask, file)
    if controls.fixed is not None:
        changed["fixed"] = _fixed(controls.fixed, file)
    names = [controls.only] if isinstance(controls.only, str) else controls.only
    if isinstance(names, Sequence) and names and all(isinstance(name, str) for name in names):
        changed["only"] = faces_labelled(names, file)
    elif controls.only is not None:  # counts the triangles that the mesh of the file is without as well
        changed["only"] = faces_within(controls.only, len(file.triangles))[~file.left_out]
    if isinstance(controls.creases, str):
        changed["creases"] = _creases(controls.creases, file)
    return replace(controls, **changed)


def welded(controls: Controls, welds: NDArray[np.int32]) -> Controls:
    """Return controls over vertices of which some are copies of each other as controls over the welded ones.

    Parameters
    ----------
    controls : as arrays; of the copies of a vertex the smallest weight counts, and it is fixed if one of them is
    welds : (k,) the welded vertex of each
    """

    def renumbered(numbers: ArrayLike) -> NDArray[Any]:
        given = np.asarray(numbers)
        within = given.dtype.kind in "iu" and ((given >= 0) & (given < len(welds))).all()
        return welds[given] if within else given  # the controls say what is wrong

    changed: dict[str, Any] = {}
    if controls.mask is not None:
        changed["mask"] = _joined(np.asarray(controls.mask), welds, np.minimum)
    if controls.fixed is not None:
        fixed = np.asarray(controls.fixed)
        changed["fixed"] = _joined(fixed, welds, np.maximum) if fixed.dtype == bool else renumbered(fixed)
    if np.ndim(controls.creases) == 2:  # type: ignore[arg-type]
        changed["creases"] = renumbered(controls.creases)  # type: ignore[arg-type]
    return replace(controls, **changed)


def faces_labelled(names: Sequence[str], file: MeshFile) -> NDArray[np.bool_]:
    """Return (m,) which triangles of the mesh of a file carry one of the labels.

    Parameters
    ----------
    names : each a name, such as that of a material, or kind=name, such as material=steel or, for numbers, segment=3
    file : of its kinds of labels, see `MeshFile.face_labels`

    Raises
    ------
    ParameterError : no face carries a label of that name
    """
    labels = file.face_labels()
    chosen = np.zeros(len(file.polygons), bool)
    for name in names:
        kind, _, value = name.partition("=")
        found = [label.carrying(name) for label in labels if label.values.dtype.kind == "U"]
        found += [label.carrying(value) for label in labels if label.kind == kind]
        carrying = np.any(found, axis=0) if found else chosen
        if not carrying[file.triangle_polygons].any():
            known = dict.fromkeys(f"{label.kind}={v}" for label in labels for v in label.values.tolist() if v != "")
            there = f"there are: {_listed(known)}" if known else "the file has no labels of faces"
            raise ParameterError(f"no face is labelled {name!r}; {there}")
        chosen = chosen | carrying
    return chosen[file.triangle_polygons[~file.left_out]]


def _mask(mask: Any, file: MeshFile) -> NDArray[Any]:
    if not isinstance(mask, str):
        return _joined(np.asarray(mask), file.welds, np.minimum)
    values = _of_vertices("mask", mask, file)
    return _joined(values / 255 if values.dtype == np.uint8 else values, file.welds, np.minimum)


def _fixed(fixed: Any, file: MeshFile) -> NDArray[Any]:
    if not isinstance(fixed, str):
        given = np.asarray(fixed)
        return _joined(given, file.welds, np.maximum) if given.dtype == bool else given
    count, attributes = len(file.positions), _attributes(file)
    if fixed in attributes:
        return _joined(np.asarray(attributes[fixed] != 0), file.welds, np.maximum)
    if fixed.endswith(FILES):
        column = _table("fixed", fixed, 1)[:, 0]
        if column.dtype == bool:
            return _joined(column, file.welds, np.maximum)
        return file.welds[_vertex_numbers("fixed", column, count)]
    runs = [RUN.fullmatch(run) for run in fixed.split(",")]
    if not all(runs):
        raise ParameterError(
            f'fixed is {fixed!r}; it must be numbers of vertices such as "0,5,7-20", a file {" or ".join(FILES)} of '
            f"them, or a vertex attribute; the file has: {_listed(attributes)}"
        )
    ends = np.array([sorted((int(run[1]), int(run[2] or run[1]))) for run in runs if run])
    within = _vertex_numbers("fixed", ends, count)
    numbers: NDArray[np.int64] = np.concatenate([np.arange(first, last + 1) for first, last in within])
    return file.welds[numbers]


def _creases(creases: str, file: MeshFile) -> float | NDArray[Any]:
    try:
        return float(creases)
    except ValueError:
        if not creases.endswith(FILES):
            raise ParameterError(
                f"creases is {creases!r}; it must be an angle in degrees, or a file {' or '.join(FILES)} with the two "
                "vertices of an edge in each row"
            ) from None
    return file.welds[_vertex_numbers("creases", _table("creases", creases, 2), len(file.positions))]


def _of_vertices(name: str, text: str, file: MeshFile) -> NDArray[Any]:
    """Return a value for each vertex of the file, from its attribute or from another file."""
    attributes = _attributes(file)
    if text in attributes:
        return attributes[text]
    if not text.endswith(FILES):
        raise ParameterError(
            f"{name} is {text!r}; it must be a file {' or '.join(FILES)}, or a vertex attribute of the mesh; it has: "
            f"{_listed(attributes)}"
        )
    return _table(name, text, 1)[:, 0]


def _attributes(file: MeshFile) -> dict[str, NDArray[Any]]:
    values = file.content().vertex_values
    return {name: value for name, value in values.items() if value.shape == (len(file.positions),)}


def _joined(values: NDArray[Any], welds: NDArray[np.int32], smallest_or_largest: np.ufunc) -> NDArray[Any]:
    """Bring values at the vertices of the file to those of its mesh; others are left for the controls to judge."""
    if values.shape != welds.shape or values.dtype.kind not in "biuf":
        return values
    joined = np.empty(welds.max(initial=-1) + 1, values.dtype)
    joined[welds] = values
    smallest_or_largest.at(joined, welds, values)
    return joined


def _vertex_numbers(name: str, numbers: NDArray[Any], count: int) -> NDArray[np.int64]:
    bad = ~np.asarray((numbers >= 0) & (numbers < count) & (numbers % 1 == 0), bool)
    if bad.any():
        raise ParameterError(
            f"{name} names vertex {numbers[bad][0]:.15g}; the file has {count} vertices, counted from 0 as whole "
            "numbers"
        )
    return numbers.astype(np.int64)


def _table(name: str, path: str, columns: int) -> NDArray[Any]:
    """Read the numbers of a file into rows of so many columns."""
    try:
        if path.endswith(".npy"):
            table = np.asarray(np.load(path, allow_pickle=False))
        else:
            lines = (re.split(r"[\s,;]+", line.partition("#")[0].strip()) for line in _lines(path))
            table = np.array([line for line in lines if line != [""]], np.float64)
    except (OSError, EOFError, ValueError) as error:
        raise ParameterError(f"{name}: {path} cannot be read as numbers: {error}") from None
    rows = table.reshape(-1, 1) if table.ndim == 1 and columns == 1 else table
    if (rows.ndim != 2 or rows.shape[1] != columns or rows.dtype.kind not in "biuf") and rows.size:
        raise ParameterError(f"{name}: {path} has shape {table.shape}; it must have {columns} numbers in each row")
    return rows.reshape(-1, columns)


def _lines(path: str) -> list[str]:
    return Path(path).read_text(encoding="utf-8-sig").splitlines()


def _listed(names: Any) -> str:
    listed = list(names)
    return ", ".join(listed[:MOST_NAMES]) + (", …" if len(listed) > MOST_NAMES else "") or "none"
