"""Train models, load them from files and denoise with them."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from copy import deepcopy
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any

from cascadenorm.api.api import denoise
from cascadenorm.api.training_pairs import training_pairs
from cascadenorm.errors import MissingDependencyError, ParameterError
from cascadenorm.execution.progress import Progress, no_progress
from cascadenorm.io.atomic import check_output, make_folder, write_atomically, write_together
from cascadenorm.io.pairs import Paths
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.config import TrainConfig
from cascadenorm.learned.gated import read_model
from cascadenorm.learned.methods import SHIPPED, Learned, shipped
from cascadenorm.learned.training.launch import is_local_main, is_main
from cascadenorm.learned.training.training_log import checked_log, recording, unrecorded
from cascadenorm.mesh import limit_threads
from cascadenorm.registry.controls import CONTROLS


class Denoiser:
    """A trained model, loaded once and used for many meshes.

    Parameters
    ----------
    model
        Networks; `load` reads them from a file, and `shipped` returns those of the package.
    method
        Method that uses them, "auto" or "cascade".
    """

    def __init__(self, model: Learned, *, method: str = "auto") -> None:
        self.model, self.method = model, method

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "Denoiser":
        """Read a weights file made by `train` or by the command `train-gate`.

        Parameters
        ----------
        path
            Weights file, `.safetensors`.

        Returns
        -------
        The model, for the method "auto", which also runs single cascades.

        Raises
        ------
        ParameterError
            The file is missing or is not a weights file of this version.
        """
        return cls(read_model(path))

    @classmethod
    def shipped(cls, name: str = "auto") -> "Denoiser":
        """Return a model that ships with the package.

        Parameters
        ----------
        name
            "auto" or "cascade".

        Returns
        -------
        The model, used by the method of the same name.

        Raises
        ------
        ParameterError
            No model of this name ships with the package.
        """
        if name not in SHIPPED:
            raise ParameterError(f"there is no shipped model {name!r}; there are: {', '.join(SHIPPED)}")
        return cls(shipped(name), method=name)

    @property
    def card(self) -> dict[str, Any]:
        """Model card, which describes how the model was trained."""
        return deepcopy(dict(self.model.card))

    def denoise(self, mesh: Any, faces: Any = None, **settings: Any) -> Any:
        """Denoise a mesh, like `cascadenorm.denoise(mesh, faces, method=…, model=…)` with this model.

        Parameters
        ----------
        mesh, faces
            As in `cascadenorm.denoise`.
        settings
            Controls, and parameters of the method such as `treat_as`, but neither `method` nor `model`.

        Returns
        -------
        As in `cascadenorm.denoise`: the new vertices for arrays, a copy for objects, the path of a new file for a path.

        Raises
        ------
        ParameterError
            `method` or `model` is given, or another setting is invalid.
        MeshError
            The mesh is invalid.
        OutputError
            The mesh is a path, and the new file already exists or cannot be written.
        """
        if given := settings.keys() & {"method", "model"}:
            raise ParameterError(f"{given.pop()} is set by the Denoiser: leave it out")
        return denoise(mesh, faces, method=self.method, model=self.model, **settings)


def load_model(model: str) -> Denoiser:
    """Return a shipped model by its name, or load one from a file by its path."""
    return Denoiser.shipped(model) if model in SHIPPED else Denoiser.load(model)


def export_onnx(model: Denoiser, folder: str | PathLike[str], *, force: bool = False) -> list[Path]:
    """Write the networks of a model as ONNX files to a folder, one per stage, and return their paths.

    A single cascade becomes stage1.onnx and so on; the two networks of `auto` become vertex-stage1.onnx,
    surface-stage1.onnx and so on. The files do not contain the filters, the context features and the vertex update. The
    inputs and outputs are described in `cascadenorm.learned.onnx_export.stage_model`. Raises OutputError if a file
    exists and `force` is False, or if it cannot be written, and MissingDependencyError if onnx is not installed.
    """
    from cascadenorm.learned.onnx_export import stage_model

    folder = Path(folder)
    stages = {
        folder / f"{name}-stage{number}.onnx".removeprefix("-"): stage
        for name, cascade in model.model.networks.items()
        for number, stage in enumerate(cascade.stages, 1)
    }
    make_folder(folder)
    write_together([(path, map(stage_model, [stage])) for path, stage in stages.items()], force=force)
    return list(stages)


def train(
    config: TrainConfig,
    output: str | PathLike[str],
    *,
    shapes: Paths = (),
    noisy: Paths = (),
    first_stage: str | PathLike[str] | None = None,
    force: bool = False,
    threads: int | None = None,
    log: str | PathLike[str] | None = None,
    tensorboard: str | PathLike[str] | None = None,
    progress: Progress = no_progress,
) -> Denoiser:
    """Train a cascade and write it to a weights file; if interrupted, the next call resumes the training.

    If torchrun has started several processes, each calls this function, and rank 0 writes the file. In a script, call
    it below `if __name__ == "__main__":`, because worker processes import the script.

    Parameters
    ----------
    config
        Training configuration; `read_config` reads one from TOML.
    output
        Output file, `.safetensors`. Checkpoints are stored in the folder `<output>.training` during the training.
    shapes
        Additional clean meshes, as files or folders, which receive simulated noise like the generated shapes.
    noisy
        Folders of additional pairs, `noisy.*` and `clean.*` with the same faces.
    first_stage
        Weights file of a cascade whose first stage is kept; those of the config are trained to follow it.
    force
        Replace an existing file.
    threads
        Maximum number of threads; does not affect the result.
    log
        `.csv` or `.jsonl` file that receives the losses and the validation error in degrees after each epoch of a
        network; `cascadenorm models --curves` shows it. A resumed training appends to it.
    tensorboard
        Folder for the same values in the format of TensorBoard.
    progress
        Called with (task, parts done, total parts, note); if there are several clusters, from several threads.

    Returns
    -------
    The model, as `Denoiser.load` reads it from the file

    Raises
    ------
    OutputError
        The file exists and `force` is False, or it cannot be written.
    ReadError, MeshError
        One of the given meshes cannot be read or used.
    ParameterError
        `first_stage` is missing or is not a single cascade.
    ConfigError
        The checkpoint beside the output belongs to a training with other settings.
    MissingDependencyError
        Torch, scikit-learn or scikit-image is not installed, or tensorboard is requested and not installed.
    WorkerError
        A process that shares the work ended early.
    """
    if not isinstance(config, TrainConfig):
        problem = f"is of type {type(config).__name__}; it must be a TrainConfig, which read_config reads from a file"
        raise ParameterError(problem, parameter="config")
    threads = CONTROLS["threads"].checked(threads)
    output = Path(output)
    first = None if first_stage is None else Cascade.load(first_stage).stages[0]
    with _libraries_of_training():
        from cascadenorm.learned.training import training
    check_output(output, force=force)
    checkpoint = output.with_name(output.name + ".training")
    resumed, lines, events = checkpoint.exists(), *(None if one is None else Path(one) for one in (log, tensorboard))
    if lines is not None and is_main():  # rank 0 may have created the file before the other processes get here
        check_output(checked_log(lines), force=force or resumed)
    with limit_threads(threads):
        own = training_pairs(shapes, noisy, config.data)
        with recording(lines, events, resumed=resumed) if is_main() else nullcontext(unrecorded) as record:
            cascade = training.train_cascade(config, checkpoint, own=own, first=first, progress=progress, record=record)
    if is_main():
        write_atomically(output, [cascade.to_bytes()], force=force)
    if is_local_main():
        shutil.rmtree(checkpoint, ignore_errors=True)  # machines may share a disk
    return Denoiser(cascade)


def train_gate(
    vertex: str | PathLike[str],
    surface: str | PathLike[str],
    output: str | PathLike[str],
    *,
    strong: str | PathLike[str] | None = None,
    seed: int | None = None,
    force: bool = False,
    threads: int | None = None,
    progress: Progress = no_progress,
) -> Denoiser:
    """Train the gates that choose between two trained cascades, and write all of them to a weights file.

    Parameters
    ----------
    vertex
        Weights file of the network for noise on vertices, see `configs/vertex.toml`.
    surface
        Weights file of the network for measured surfaces, see `configs/surface.toml`.
    output
        Output file, `.safetensors`.
    strong
        Weights file of the network for strong noise, which follows the first stage of the vertex network, see
        `configs/strong.toml`.
    seed
        Random seed for the trees of the gates.
    force
        Replace an existing file.
    threads
        Maximum number of threads; does not affect the result.
    progress
        Called with (task, parts done, total parts).

    Returns
    -------
    The model, as `Denoiser.load` reads it from the file.

    Raises
    ------
    OutputError
        The file exists and `force` is False, or it cannot be written.
    ParameterError
        An input is missing or is not a single cascade, or the network for strong noise has another first stage.
    MissingDependencyError
        Torch, scikit-learn or scikit-image is not installed.
    """
    threads = CONTROLS["threads"].checked(threads)
    output = Path(output)
    check_output(output, force=force)
    cascades = [Cascade.load(path) for path in (vertex, surface)]
    strong_cascade = None if strong is None else Cascade.load(strong)
    if strong_cascade is not None and not strong_cascade.begins_like(cascades[0]):
        raise ParameterError(f"{strong} does not begin with the first stage of {vertex}: train it with --first-stage")
    with _libraries_of_training():
        from cascadenorm.learned.training import gate_training
    config = gate_training.GateConfig() if seed is None else gate_training.GateConfig(seed=seed)
    with limit_threads(threads):
        model = gate_training.trained_gate(cascades[0], cascades[1], config, strong=strong_cascade, progress=progress)
    write_atomically(output, [model.to_bytes()], force=force)
    return Denoiser(model)


@contextmanager
def _libraries_of_training() -> Iterator[None]:
    """Name the library that an import for training lacks."""
    try:
        import_module("skimage")  # generates the shapes
        yield
    except ImportError as error:
        raise MissingDependencyError("training", package=error.name or "torch", extra="train") from None
