"""Models as files: train one, load one and denoise with it."""

import shutil
from contextlib import nullcontext
from copy import deepcopy
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any

from cascadenorm.api.api import denoise
from cascadenorm.errors import MissingDependencyError, ParameterError
from cascadenorm.execution.progress import Progress, silent
from cascadenorm.io.atomic import check_output, make_folder, write_atomically
from cascadenorm.io.pairs import Paths
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.config import TrainConfig
from cascadenorm.learned.gated import read_model
from cascadenorm.learned.methods import Learned, shipped
from cascadenorm.learned.training.launch import is_local_main, is_main
from cascadenorm.learned.training.training_log import checked_log, recording, unrecorded
from cascadenorm.mesh import limit_threads
from cascadenorm.models.training_pairs import training_pairs

SHIPPED = ("auto", "cascade")


class Denoiser:
    """A trained model, read once and used for many meshes.

    Parameters
    ----------
    model
        The networks; `load` reads them from a file, `shipped` gives those that come with the package.
    method
        What denoises with them, "auto" or "cascade".
    """

    def __init__(self, model: Learned, *, method: str = "auto") -> None:
        self.model, self.method = model, method

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "Denoiser":
        """Read a weights file made by `train_cascade` or `trained_gate`.

        Raises
        ------
        ParameterError
            The file is missing, or holds no model.
        """
        return cls(read_model(path))

    @classmethod
    def shipped(cls, name: str = "auto") -> "Denoiser":
        """Return a model that comes with the package, one of SHIPPED."""
        return cls(shipped(name), method=name)

    @property
    def card(self) -> dict[str, Any]:
        """What the model was made of and how."""
        return deepcopy(dict(self.model.card))

    def denoise(self, mesh: Any, faces: Any = None, **settings: Any) -> Any:
        """Denoise a mesh, as `cascadenorm.denoise(mesh, faces, method=…, model=…)` does with this model.

        Settings are those of `cascadenorm.denoise` and of the method, such as `sweeps`; method and model are given.
        """
        if given := settings.keys() & {"method", "model"}:
            raise ParameterError(f"{given.pop()} is set by the Denoiser: leave it out")
        return denoise(mesh, faces, method=self.method, model=self.model, **settings)


def named(model: str) -> Denoiser:
    """Return a model that comes with the package by its name, or one in a file by its path."""
    return Denoiser.shipped(model) if model in SHIPPED else Denoiser.load(model)


def export_onnx(model: Denoiser, folder: str | PathLike[str], *, force: bool = False) -> list[Path]:
    """Write the networks of a model as ONNX files, one for each stage.

    A single cascade becomes stage1.onnx and so on, the two of `auto` vertex-stage1.onnx, surface-stage1.onnx and so on.

    Filters, context features and the vertex update are not in them: `cascadenorm.learned.onnx_export.stage_model` says
    what goes in and comes out.

    Parameters
    ----------
    model
        `Denoiser.shipped` or `Denoiser.load`.
    folder
        It is made.
    force
        Replace existing files.

    Returns
    -------
    The files

    Raises
    ------
    OutputError
        A file exists and force is not given, or it cannot be written.
    MissingDependencyError
        Onnx is not installed.
    """
    from cascadenorm.learned.onnx_export import stage_model

    folder = Path(folder)
    stages = {
        folder / f"{name}-stage{number}.onnx".removeprefix("-"): stage
        for name, cascade in model.model.networks.items()
        for number, stage in enumerate(cascade.stages, 1)
    }
    make_folder(folder)
    for path in stages:
        check_output(path, force=force)
    for path, stage in stages.items():
        write_atomically(path, [stage_model(stage)], force=force)
    return list(stages)


def train(
    config: TrainConfig,
    output: str | PathLike[str],
    *,
    shapes: Paths = (),
    noisy: Paths = (),
    force: bool = False,
    threads: int | None = None,
    log: str | PathLike[str] | None = None,
    tensorboard: str | PathLike[str] | None = None,
    progress: Progress = silent,
) -> Denoiser:
    """Train a cascade and write it to a weights file; interrupted and called again, it goes on where it was.

    Where torchrun has started several processes, each calls this, and the first writes. A script calls it below
    `if __name__ == "__main__":`, since the processes that share the work read the script as well.

    Parameters
    ----------
    config
        What to train; `read_config` reads one from TOML.
    output
        The `.safetensors` file; beside it, in `<output>.training`, lies what is finished while it runs.
    shapes
        Clean meshes of one's own, files or folders of them, that get simulated noise as the generated shapes do.
    noisy
        Folders of one's own pairs, `noisy.*` and `clean.*` of equal faces.
    force
        Replace an existing file.
    threads
        At most this many; the result is the same.
    log
        `.csv` or `.jsonl` file that gets a line after each pass of a network: losses, and the validation error in
        degrees; `cascadenorm models --curves` shows it. An interrupted training goes on with it.
    tensorboard
        Folder of the same for TensorBoard.
    progress
        Called with (task, parts done, parts in all, note); of several clusters from several threads.

    Returns
    -------
    The model, as `Denoiser.load` reads it from the file

    Raises
    ------
    OutputError
        The file exists and force is not given, or it cannot be written.
    ReadError, MeshError
        One of the meshes that are handed in cannot be read or worked on.
    ConfigError
        An interrupted training of other settings lies beside the output.
    MissingDependencyError
        Torch, scikit-learn or scikit-image are not installed, or tensorboard, if it is asked for.
    WorkerError
        One of the processes that share the work ended early.
    """
    output = Path(output)
    try:
        import_module("skimage")  # which makes the shapes
        from cascadenorm.learned.training import training
    except ImportError as error:
        raise MissingDependencyError("training", package=error.name or "torch", extra="train") from None
    check_output(output, force=force)
    checkpoint = output.with_name(output.name + ".training")
    resumed, lines, events = checkpoint.exists(), *(None if one is None else Path(one) for one in (log, tensorboard))
    if lines is not None and not resumed:
        check_output(checked_log(lines), force=force)
    with limit_threads(threads):
        own = training_pairs(shapes, noisy, config.data)
        with recording(lines, events, resumed=resumed) if is_main() else nullcontext(unrecorded) as record:
            cascade = training.train_cascade(config, checkpoint, own=own, progress=progress, record=record)
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
    seed: int | None = None,
    force: bool = False,
    threads: int | None = None,
    progress: Progress = silent,
) -> Denoiser:
    """Learn when to use which of two trained cascades, and write both with the gate to a weights file.

    Parameters
    ----------
    vertex
        Weights file of the network for noise on vertices, see `configs/vertex.toml`.
    surface
        Weights file of the network for measured surfaces, see `configs/surface.toml`.
    output
        The `.safetensors` file.
    seed
        Of the trees of the gate.
    force
        Replace an existing file.
    threads
        Most threads; the result is the same.
    progress
        Called with (task, parts done, parts in all).

    Returns
    -------
    The model, as `Denoiser.load` reads it from the file.

    Raises
    ------
    OutputError
        The file exists and force is not given, or it cannot be written.
    ParameterError
        An input is missing or is not a single cascade.
    MissingDependencyError
        torch, scikit-learn or scikit-image are not installed.
    """
    output = Path(output)
    check_output(output, force=force)
    cascades = [Cascade.load(path) for path in (vertex, surface)]
    try:
        import_module("skimage")  # which makes the shapes
        from cascadenorm.learned.training import gate_training
    except ImportError as error:
        raise MissingDependencyError("training", package=error.name or "torch", extra="train") from None
    config = gate_training.GateConfig() if seed is None else gate_training.GateConfig(seed=seed)
    with limit_threads(threads):
        model = gate_training.trained_gate(cascades[0], cascades[1], config, progress=progress)
    write_atomically(output, [model.to_bytes()], force=force)
    return Denoiser(model)
