"""Folders with noisy/clean pairs of mesh files."""

import os
from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import NamedTuple

from cascadenorm.io import ReadError, is_mesh_name

Paths = str | PathLike[str] | Iterable[str | PathLike[str]]  # one path or several


class FilePair(NamedTuple):
    """A noisy and a clean file of the same surface."""

    name: str
    noisy: Path
    clean: Path
    seed: int | None = None  # seed of the noise that was added to the clean mesh; None if the noisy mesh was given


def find_pairs(folders: Paths) -> list[FilePair]:
    """List each pair `noisy.*` + `clean.*` in folders and their direct subfolders. Raises ReadError."""
    known: dict[Path, FilePair] = {}
    for folder in paths_of(folders):
        if not os.path.isdir(folder):
            raise ReadError(f"{folder} is not a folder: give one that holds noisy.* and clean.*, or folders that do")
        found = [pair for place in (folder, *listed(folder)) if (pair := _pair(place))]
        if not found:
            raise ReadError(f"{folder} holds no pairs: put noisy.ply and clean.ply into it, or into folders in it")
        for pair in found:
            known.setdefault(pair.noisy.resolve(), pair)
    pairs = list(known.values())
    if len({pair.name for pair in pairs}) < len(pairs):
        pairs = [pair._replace(name=str(pair.noisy.parent)) for pair in pairs]
    return pairs


def result_file(folder: Path, pair: FilePair) -> Path:
    """Return the mesh `<name of the pair>.*` in a folder of results. Raises ReadError unless there is exactly one."""
    files = [file for file in listed(folder) if file.stem == pair.name and is_mesh_name(file)]
    if len(files) != 1:
        found = f"{len(files)} meshes" if files else "no mesh"
        raise ReadError(f"{folder} holds {found} {pair.name}.*; it must hold exactly one")
    return files[0]


def listed(folder: Path) -> list[Path]:
    """Return the files and folders in a folder, sorted. Raises ReadError if it cannot be listed."""
    try:
        return sorted(folder.iterdir())
    except OSError as error:
        raise ReadError(f"{folder} cannot be listed: {error.strerror or error}") from error


def paths_of(places: Paths) -> list[Path]:
    return [Path(places)] if isinstance(places, str | PathLike) else [Path(place) for place in places]


def _pair(folder: Path) -> FilePair | None:
    """Return the pair in a folder, or None if it contains neither mesh."""
    if not os.path.isdir(folder):
        return None
    halves = {}
    for half in ("noisy", "clean"):
        files = sorted(file for file in folder.glob(f"{half}.*") if os.path.isfile(file))
        files = [file for file in files if is_mesh_name(file)] or files  # the others may be referenced files
        if len(files) > 1:
            raise ReadError(f"{folder} holds {len(files)} files {half}.*: leave one")
        if files:
            halves[half] = files[0]
    if len(halves) == 1:
        raise ReadError(f"{folder} holds {next(iter(halves.values())).name} only: a pair needs noisy.* and clean.*")
    return FilePair(folder.resolve().name, halves["noisy"], halves["clean"]) if halves else None
