"""Models as files: train one, load one and denoise with it."""

import shutil
from collections.abc import Iterable
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any

from cascadenorm.api import denoise
from cascadenorm.controls import DenoiseError
from cascadenorm.io.atomic import check_output, write_atomically
from cascadenorm.learned.cascade import Cascade, shipped
from cascadenorm.learned.config import TrainConfig
from cascadenorm.learned.progress import Progress, leads, silent, tells
from cascadenorm.mesh import limit_threads
from cascadenorm.pairs import training_pairs

SHIPPED = ("auto", "cascade")


class Denoiser:
    """A trained model, read once and used for many meshes.

    Parameters
    ----------
    cascade : the model; `load` reads one from a file, `shipped` gives one that comes with the package
    """

    def __init__(self, cascade: Cascade) -> None:
        self.cascade = cascade

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "Denoiser":
        """Read a weights file made by `train`.

        Raises
        ------
        ParameterError : the file is missing, or holds no model
        """
        return cls(Cascade.load(path))

    @classmethod
    def shipped(cls, name: str = "auto") -> "Denoiser":
        """Return a model that comes with the package, one of SHIPPED."""
        return cls(shipped(name))

    @property
    def card(self) -> dict[str, Any]:
        """What the model was made of and how."""
        return dict(self.cascade.card)

    def denoise(self, mesh: Any, faces: Any = None, **settings: Any) -> Any:
        """Denoise a mesh of any kind, as `cascadenorm.denoise` does, with this model."""
        return denoise(mesh, faces, method="cascade", model=self.cascade, **settings)


def train(
    config: TrainConfig,
    output: Path,
    *,
    shapes: Iterable[str | PathLike[str]] = (),
    noisy: Iterable[str | PathLike[str]] = (),
    force: bool = False,
    threads: int | None = None,
    progress: Progress = silent,
) -> Denoiser:
    """Train a cascade and write it to a weights file; interrupted and called again, it goes on where it was.

    Where torchrun has started several processes, each calls this, and the first writes.

    Parameters
    ----------
    config : what to train; `read_config` reads one from TOML
    output : the `.safetensors` file; beside it, in `<output>.training`, lies what is finished while it runs
    shapes : clean meshes of one's own, files or folders of them, that get simulated noise as the generated shapes do
    noisy : folders of one's own pairs, `noisy.*` and `clean.*` of equal faces
    force : replace an existing file
    threads : at most this many; the result is the same
    progress : called with (task, parts done, parts in all, note)

    Raises
    ------
    OutputError : the file exists and force is not given, or it cannot be written
    ReadError, MeshError : one of the meshes that are handed in cannot be read or worked on
    ConfigError : an interrupted training of other settings lies beside the output
    DenoiseError : torch or scikit-learn are not installed
    """
    try:
        import_module("skimage")  # which makes the shapes
        from cascadenorm.learned import training
    except ImportError as error:
        raise DenoiseError(f"training needs {error.name}: pip install 'cascadenorm[train]'") from None
    check_output(output, force=force)
    checkpoint = output.with_name(output.name + ".training")
    with limit_threads(threads):
        own = training_pairs(shapes, noisy, config.data)
        cascade = training.train(config, checkpoint, own=own, progress=progress)
    if tells():
        write_atomically(output, [cascade.to_bytes()], force=force)
    if leads():
        shutil.rmtree(checkpoint, ignore_errors=True)  # machines may share a disk
    return Denoiser(cascade)
