"""Folders of noisy/clean pairs: found on disk, read for a training, or generated."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from importlib.util import find_spec
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cascadenorm import data_gen
from cascadenorm.data_gen import DatasetConfig, write_dataset
from cascadenorm.data_gen.meshing.patches import patch, patches
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.errors import MissingDependencyError
from cascadenorm.execution.cluster_map import side_by_side_on
from cascadenorm.execution.progress import Progress, silent
from cascadenorm.geometry.orientation import oriented
from cascadenorm.io import OutputError, ReadError, is_mesh_name
from cascadenorm.io.interop import as_mesh, save_mesh
from cascadenorm.learned.config import DATA
from cascadenorm.mesh import Mesh, MeshError, in_frame, scaled_alike

Places = str | PathLike[str] | Iterable[str | PathLike[str]]
"""One path or several."""


class Pair(NamedTuple):
    """Two files of the same surface.

    Parameters
    ----------
    seed : of the noise that was added to the clean mesh; None where the noisy one was given
    """

    name: str
    noisy: Path
    clean: Path
    seed: int | None = None


def find_pairs(folders: Places) -> list[Pair]:
    """List the pairs `noisy.*` + `clean.*` in each folder itself and in the folders in it, by name, each once.

    Raises
    ------
    ReadError : a folder that does not exist or holds no pair, half a pair, two files of one name
    """
    known: dict[Path, Pair] = {}
    for folder in _paths(folders):
        if not folder.is_dir():
            raise ReadError(f"{folder} is not a folder: give one that holds noisy.* and clean.*, or folders that do")
        found = [pair for place in (folder, *sorted(folder.iterdir())) if (pair := _pair(place))]
        if not found:
            raise ReadError(f"{folder} holds no pairs: put noisy.ply and clean.ply into it, or into folders in it")
        for pair in found:
            known.setdefault(pair.noisy.resolve(), pair)
    pairs = list(known.values())
    if len({pair.name for pair in pairs}) < len(pairs):
        pairs = [pair._replace(name=str(pair.noisy.parent)) for pair in pairs]
    return pairs


def with_noise(pairs: Sequence[Pair], folder: Path, *, level: float, seeds: int) -> list[Pair]:
    """Write meshes with Gaussian noise along the normals of each clean mesh, and return the pairs of them.

    Parameters
    ----------
    folder : for the noisy meshes; it is made
    level : standard deviation of the noise, in mean edge lengths of the clean mesh
    seeds : noisy meshes of each clean one, from the seeds 0, 1, …; the same seeds give the same files
    """
    made = []
    for pair in pairs:
        clean = as_mesh(pair.clean)
        place = folder / re.sub(r"[/\\]", "_", pair.name)
        place.mkdir(parents=True, exist_ok=True)
        for seed in range(seeds):
            name = f"{pair.name}-seed{seed}"
            noise = displacements(clean, "normal", level=level, rng=np.random.default_rng(seed))
            file = place / f"noisy-{level:g}-{seed}.ply"
            save_mesh(file, clean.moved(clean.vertices + noise), force=True)
            made.append(Pair(name, file, pair.clean, seed))
    return made


def result_file(folder: Path, pair: Pair) -> Path:
    """Return the mesh `<name of the pair>.*` in a folder of results; raises ReadError unless there is just one."""
    files = sorted(file for file in folder.iterdir() if file.stem == pair.name and is_mesh_name(file))
    if len(files) != 1:
        found = f"{len(files)} meshes" if files else "no mesh"
        raise ReadError(f"{folder} holds {found} {pair.name}.*; it must hold exactly one")
    return files[0]


def training_pairs(shapes: Places, noisy: Places, config: DatasetConfig) -> list[data_gen.Pair]:
    """Read meshes of one's own to train on: oriented, of about unit size, in patches of at most config.max_faces.

    Parameters
    ----------
    shapes : clean meshes, or folders of them; they get noise as `config` says, each again and again until they are
        about a quarter of what is generated, or for the twentieth time
    noisy : folders of pairs, as `find_pairs` takes them, of equal faces
    config : of the generated pairs

    Raises
    ------
    ReadError, MeshError : a file that is missing or no mesh, a folder without one, a pair of different faces
    """
    own = [part for path in _mesh_files(shapes) for part in _patches(oriented(in_frame(as_mesh(path))[0]), config)]
    rounds = max(1, min(20, config.count // (4 * len(own)))) if own else 0
    made = [data_gen.own_pair(config, i, part) for i, part in enumerate(own * rounds)]
    for files in find_pairs(noisy):
        first, true = as_mesh(files.noisy), as_mesh(files.clean)
        if not np.array_equal(first.faces, true.faces):
            raise MeshError(
                f"{files.noisy} and {files.clean} have different faces: training needs the same faces in both"
            )
        first, true = scaled_alike(first, true)
        true = oriented(true)
        first = Mesh(first.vertices, true.faces)
        for chosen in patches(true, faces=config.max_faces):
            clean = patch(true, chosen)
            made.append(data_gen.Pair(patch(first, chosen), clean, clean.face_normals, data_gen.OWN, "none", 0.0))
    return made


def _patches(mesh: Mesh, config: DatasetConfig) -> list[Mesh]:
    return [patch(mesh, chosen) for chosen in patches(mesh, faces=config.max_faces)]


def _mesh_files(places: Places) -> list[Path]:
    """List files as they are, and the mesh files in folders by name."""
    files = []
    for place in _paths(places):
        found = (
            sorted(file for file in place.iterdir() if file.is_file() and is_mesh_name(file))
            if place.is_dir()
            else [place]
        )
        if not found:
            raise ReadError(f"{place} holds no mesh files: put clean meshes into it")
        files += found
    return files


def _paths(places: Places) -> list[Path]:
    return [Path(places)] if isinstance(places, str | PathLike) else [Path(place) for place in places]


def write_pairs(
    folder: Path,
    *,
    count: int,
    seed: int,
    workers: int = 1,
    scheduler: str | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> None:
    """Generate pairs as trainings do, each in a folder of its own, and `dataset.json` beside them.

    Parameters
    ----------
    folder : made if it is not there
    count, seed : how many, and of what; the same numbers give the same files
    workers : processes
    scheduler : address of the scheduler of a Dask cluster, whose workers make the pairs; "local" makes a cluster of so
        many processes on this machine; None starts processes without Dask. Files are written here
    force : write into a folder that is not empty
    progress : called with (task, pairs done, pairs in all) after each pair

    Raises
    ------
    OutputError : the folder is not empty and force is not given, or it is a file or cannot be made
    MissingDependencyError : scikit-image is not installed, or distributed for a scheduler
    ParameterError, WorkerError : as `on_cluster` says
    """
    if find_spec("skimage") is None:
        raise MissingDependencyError("generating data", package="skimage", extra="train")
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder} is a file: give the name of a folder")
    if folder.is_dir() and any(folder.iterdir()) and not force:
        raise OutputError(f"{folder} is not empty", hint="give another folder", remedy=("force", True))
    config = replace(DATA, count=count, seed=seed)
    try:
        with side_by_side_on(scheduler, workers=workers, folder=None):
            write_dataset(folder, config, write=_overwrite, workers=workers, progress=progress)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{folder} cannot be written: {error.strerror or error}") from error


def _overwrite(path: Path, mesh: Mesh) -> None:
    save_mesh(path, mesh, force=True)


def _pair(folder: Path) -> Pair | None:
    """Return the pair in a folder; None where there is neither half of one."""
    if not folder.is_dir():
        return None
    halves = {}
    for half in ("noisy", "clean"):
        files = sorted(file for file in folder.glob(f"{half}.*") if file.is_file())
        files = [file for file in files if is_mesh_name(file)] or files  # beside them may lie what they name
        if len(files) > 1:
            raise ReadError(f"{folder} holds {len(files)} files {half}.*: leave one")
        if files:
            halves[half] = files[0]
    if len(halves) == 1:
        raise ReadError(f"{folder} holds {next(iter(halves.values())).name} only: a pair needs noisy.* and clean.*")
    return Pair(folder.resolve().name, halves["noisy"], halves["clean"]) if halves else None
