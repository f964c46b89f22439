"""The cascade: regress normals, recover vertices, and again from what came out (Wang, Liu, Tong 2016)."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib import resources
from os import PathLike, fspath
from pathlib import Path
from typing import Annotated, Any

from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.geometry.safeguards import safeguarded
from cascadenorm.geometry.segmentation_steps import without_voxel_faces
from cascadenorm.learned.descriptors import (
    CUTOFF,
    ITERATED_PASSES,
    ITERATED_SIGMA_R,
    LATER_ITERATED_PASSES,
    LATER_SMOOTH_PASSES,
    RINGS,
    SIGMA_R,
    SIGMA_S,
    SMOOTH_PASSES,
    SMOOTH_SIGMA_R,
)
from cascadenorm.learned.drift import without_drift
from cascadenorm.learned.features import CONTEXT_STEPS, FLOOR
from cascadenorm.learned.regression import Regression, stage_stack
from cascadenorm.learned.stage_settings import CHOICES, StageSettings
from cascadenorm.mesh import Mesh, Vectors
from cascadenorm.progress import track
from cascadenorm.registry import Parameter, ParameterError, method

FORMAT = "cascadenorm/6"
CONSTANTS = {
    "sigma_s": SIGMA_S,
    "sigma_r": SIGMA_R,
    "spreads": CUTOFF,
    "rings": RINGS,
    "context_steps": CONTEXT_STEPS,
    "iterated_sigma_r": ITERATED_SIGMA_R,
    "iterated_64_passes": ITERATED_PASSES,
    "iterated_16_passes": LATER_ITERATED_PASSES,
    "smooth_passes": SMOOTH_PASSES,
    "later_smooth_passes": LATER_SMOOTH_PASSES,
    "smooth_sigma_r": SMOOTH_SIGMA_R,
    "floor": FLOOR,
}
"""What stands behind the names of a stage's settings: weights serve these numbers alone."""


@dataclass(frozen=True)
class Cascade:
    """Regressions applied in turn, each to the vertices recovered from the normals of the one before.

    Parameters
    ----------
    stages : the regressions, in order
    card : how it was made and what it reaches: configuration, seed, results; anything that JSON can hold
    """

    stages: tuple[Regression, ...]
    card: Mapping[str, Any]

    def steps(self, mesh: Mesh) -> Iterator[Mesh]:
        """Yield the mesh after each stage."""
        noisy = mesh
        for number in track(len(self.stages)):
            mesh = apply_stage(self.stages[number], mesh, noisy)
            yield mesh

    def vertices(self, mesh: Mesh) -> Vectors:
        """Return the vertices of the mesh after the last stage, (n, 3)."""
        for last in self.steps(mesh):  # none is kept once the next one is there
            mesh = last
        return mesh.vertices

    def to_bytes(self) -> bytes:
        """Return the content of a weights file: the same bytes for the same cascade."""
        tensors = {f"stage{s}.{name}": a for s, stage in enumerate(self.stages) for name, a in stage.arrays().items()}
        settings = [asdict(stage.settings) for stage in self.stages]
        header = {"format": FORMAT, "constants": CONSTANTS, "stages": settings, "card": self.card}
        return save(tensors, {"cascadenorm": json.dumps(header, sort_keys=True)})

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "Cascade":
        """Read a weights file.

        Raises
        ------
        ParameterError : the file is missing, or is not a cascade of this format, for the filters of this version
        """
        try:
            with safe_open(fspath(path), framework="numpy") as file:
                header = json.loads((file.metadata() or {}).get("cascadenorm", "{}"))
                if header.get("format") != FORMAT:
                    found = header.get("format")
                    raise ParameterError(f"{fspath(path)} holds weights of format {found!r}; here {FORMAT!r} is read")
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a mapping
                for tensor in tensors.values():  # one model serves many
                    tensor.flags.writeable = False
        except OSError as error:
            raise ParameterError(f"the weights {fspath(path)} cannot be read: {error.strerror or error}") from None
        except (SafetensorError, json.JSONDecodeError):
            raise ParameterError(f"{fspath(path)} is not a weights file: train one with `cascadenorm train`") from None
        if header["constants"] != json.loads(json.dumps(CONSTANTS)):
            raise ParameterError(f"{fspath(path)} was trained with other filters than this version has: train it again")
        stages = []
        for s, stage in enumerate(header["stages"]):
            for name, known in CHOICES.items():
                if stage[name] not in known:
                    raise ParameterError(f"{fspath(path)} needs the {name} {stage[name]!r}, which this version lacks")
            mine = {name.split(".", 1)[1]: a for name, a in tensors.items() if name.startswith(f"stage{s}.")}
            try:
                stages.append(Regression.from_arrays(StageSettings(**stage), mine))
            except KeyError as error:
                raise ParameterError(f"{fspath(path)} lacks {error} of stage {s + 1}: train it again") from None
        return cls(tuple(stages), header["card"])


def apply_stage(stage: Regression, mesh: Mesh, noisy: Mesh) -> Mesh:
    """Return a mesh after one more stage: its normals regressed from the filtered ones, its vertices moved to them."""
    settings = stage.settings
    normals = stage.normals(mesh, stage_stack(settings, mesh, noisy))
    vertices = recover_vertices(
        mesh, normals, sweeps=settings.sweeps, weighting=settings.weighting, foldovers=settings.foldovers
    )
    return mesh.moved(vertices)


def weights_file(name: str, model: str | Path | None = None) -> Path:
    """Return the file that a learned method takes its weights from: a model of one's own, else the shipped one."""
    if model is not None:
        return Path(model)
    return Path(str(resources.files("cascadenorm"))) / "weights" / f"{name}.safetensors"


@cache
def shipped(name: str) -> Cascade:
    """Return a cascade that comes with the package, "auto" or "cascade"."""
    with resources.as_file(resources.files("cascadenorm") / "weights" / f"{name}.safetensors") as path:
        return Cascade.load(path)


Model = Annotated[Cascade | Path | None, Parameter("weights that `cascadenorm train` made; none: ours")]


@method("auto", source="after Wang, Liu, Tong 2016", family="learned", converges=True)
def auto(mesh: Mesh, *, model: Model = None) -> Vectors:
    """Regress face normals from iterated bilateral filters and smoothed vertices, fit the vertices, in three stages.

    Formula
    -------
    n_f ← unit Σ_i c_i(d_f) n_i,f;   n_i: iterated bilateral filters and normals of smoothed vertices
    d_f: log(1 - <n_i, n_j> + 1e-4) for all pairs, and context;   c: a network for each stage
    then the vertices follow, and the next stage starts from them

    Limits
    ------
    Detail about as small as the edges is partly lost. Segmentations with thick slices, and noise that folds faces over,
    stay hard. It learned from generated shapes: an error of a kind that none of them has may be left.
    """
    start = without_voxel_faces(mesh)
    vertices = loaded(model, "auto").vertices(start)
    return safeguarded(mesh, without_drift(mesh, vertices))


@method("cascade", source="Wang, Liu, Tong 2016", family="learned")
def cascade(mesh: Mesh, *, model: Model = None) -> Vectors:
    """Regress the true normal of each face from its filtered normals, move the vertices, and again, in three stages.

    Formula
    -------
    n_f ← unit Σ_i c_i(d_f) n_i,f;   n_i: B-FND, G-FND, σ_s = 1, 2 and σ_r = 0.1, 0.2, 0.35, 0.5, ∞
    d_f: log(1 - <n_i, n_j> + 1e-4) for all pairs;   c: a network for each of four clusters
    then the vertices follow, and the next stage starts from them

    Limits
    ------
    Its filters reach five mean edge lengths far: heavy noise, and errors that are correlated over many edges, are left
    in part. The vertex update may fold faces over.
    """
    return loaded(model, "cascade").vertices(mesh)


def loaded(model: Cascade | Path | None, name: str) -> Cascade:
    """Return the networks of a learned method: a model of one's own, else the shipped one."""
    if isinstance(model, Cascade):
        return model
    if not isinstance(model, str | PathLike | None):
        raise ParameterError(f"model is a {type(model).__name__}; it must be the path of a file that `train` made")
    return shipped(name) if model is None else Cascade.load(model)
