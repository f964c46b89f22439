"""Read training pairs from files, or generate them and write them to files."""

import os
from functools import partial
from importlib.util import find_spec
from os import PathLike
from pathlib import Path

import numpy as np

from cascadenorm.data_gen import OWN_FAMILY, DatasetConfig, Pair, own_pair, write_dataset
from cascadenorm.data_gen.dataset import training_patches
from cascadenorm.errors import MissingDependencyError
from cascadenorm.execution.cluster import use_cluster
from cascadenorm.execution.progress import Progress, no_progress
from cascadenorm.geometry.orientation import oriented
from cascadenorm.io import OutputError, ReadError, is_mesh_name, read
from cascadenorm.io.atomic import explained_writing, make_folder
from cascadenorm.io.interop import as_mesh, mesh_of_file, save_mesh
from cascadenorm.io.pairs import FilePair, Paths, find_pairs, listed, paths_of
from cascadenorm.mesh import Mesh, MeshError, in_frame, part_of, scaled_alike


def training_pairs(shapes: Paths, noisy: Paths, config: DatasetConfig) -> list[Pair]:
    """Read additional meshes for training, oriented, of about unit size, in patches of at most config.max_faces.

    The shapes are clean meshes, or folders of them. They receive noise as set by `config`, repeatedly until they make
    up about a quarter of the number of generated pairs, at most 20 times. `noisy` are folders of pairs with equal
    faces, as accepted by `find_pairs`. Raises ReadError or MeshError if a file is missing or is not a mesh, a folder
    has none, or the faces of a pair differ.
    """
    own = [part for path in _mesh_files(shapes) for part in _patches(oriented(in_frame(as_mesh(path))[0]), config)]
    rounds = max(1, min(20, config.count // (4 * len(own)))) if own else 0
    made = [own_pair(config, i, part) for i, part in enumerate(own * rounds)]
    for files in find_pairs(noisy):
        first, true = _cut_alike(files)
        if not np.array_equal(first.faces, true.faces):
            raise MeshError(
                f"{files.noisy} and {files.clean} have different faces: training needs the same faces in both"
            )
        first, true = scaled_alike(first, true)
        true = oriented(true)
        first = Mesh(first.vertices, true.faces)
        for chosen in training_patches(true, faces=config.max_faces):
            clean, _ = part_of(true, chosen)
            made.append(Pair(part_of(first, chosen)[0], clean, clean.face_normals, OWN_FAMILY, "none", 0.0))
    return made


def _cut_alike(files: FilePair) -> tuple[Mesh, Mesh]:
    """Return the noisy and the clean mesh. Polygons that both have are cut into the triangles of the clean mesh.

    How a polygon is cut depends on the positions, which noise changes.
    """
    noisy, clean = read(files.noisy), read(files.clean)
    first, true = mesh_of_file(noisy, str(files.noisy)), mesh_of_file(clean, str(files.clean))
    (counts, corners), (of_clean, corners_of_clean) = (
        (file.polygons.counts, file.welds[file.polygons.corners]) for file in (noisy, clean)
    )
    same = np.array_equal(counts, of_clean) and np.array_equal(corners, corners_of_clean)
    return (Mesh(first.vertices, true.faces) if same else first), true


def _patches(mesh: Mesh, config: DatasetConfig) -> list[Mesh]:
    return [part_of(mesh, chosen)[0] for chosen in training_patches(mesh, faces=config.max_faces)]


def _mesh_files(places: Paths) -> list[Path]:
    """List the given files, and the mesh files in the given folders by name."""
    files = []
    for place in paths_of(places):
        found = [place]
        if os.path.isdir(place):
            found = [file for file in listed(place) if os.path.isfile(file) and is_mesh_name(file)]
        if not found:
            raise ReadError(f"{place} holds no mesh files: put clean meshes into it")
        files += found
    return files


def write_pairs(
    folder: str | PathLike[str],
    *,
    count: int,
    seed: int,
    workers: int = 1,
    scheduler: str | None = None,
    force: bool = False,
    progress: Progress = no_progress,
) -> None:
    """Generate pairs of shapes of all families, each in its own folder, and write `dataset.json` beside them.

    The same count and seed give the same files. `workers` processes generate the pairs, or a Dask cluster with the
    address `scheduler`, or a local one if that is "local"; this process writes the files. `force` writes to a folder
    that is not empty. `progress` is called with (task, pairs done, total pairs) after each pair.

    Raises OutputError if the folder cannot be used, MissingDependencyError if scikit-image or distributed is needed and
    not installed, and the errors of `use_cluster`.
    """
    if find_spec("skimage") is None:
        raise MissingDependencyError("generating data", package="skimage", extra="train")
    folder = Path(folder)
    with explained_writing(folder):
        if folder.is_dir() and any(folder.iterdir()) and not force:
            raise OutputError(f"{folder} is not empty", hint="give another folder", remedy=("force", True))
    config = DatasetConfig(count=count, seed=seed)
    with explained_writing(folder), use_cluster(scheduler, workers=workers, folder=None):
        make_folder(folder)
        write_dataset(folder, config, write=partial(save_mesh, force=True), workers=workers, progress=progress)
