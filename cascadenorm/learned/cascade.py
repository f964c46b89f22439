"""The cascade: regress normals, recover vertices, and again from what came out (Wang, Liu, Tong 2016)."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from os import PathLike, fspath
from typing import Any

from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.errors import ParameterError
from cascadenorm.execution.progress import track
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
from cascadenorm.learned.features import CONTEXT_STEPS, FLOOR
from cascadenorm.learned.regression import Regression
from cascadenorm.learned.stage_normals import stage_normals
from cascadenorm.learned.stage_settings import CHOICES, StageSettings
from cascadenorm.learned.weights import Arrays, packed, unpacked
from cascadenorm.mesh import Mesh, Vectors
from cascadenorm.patches.work import free_derived

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
    stages
        The regressions, in order.
    card
        How it was made and what it reaches: configuration, seed, results; anything that JSON can hold.
    """

    stages: tuple[Regression, ...]
    card: Mapping[str, Any]

    @property
    def networks(self) -> dict[str, "Cascade"]:
        """The only network, without a name; a model with a gate has two."""
        return {"": self}

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
        return packed({"format": FORMAT, **self.header()}, self.tensors())

    def header(self) -> dict[str, Any]:
        """Return everything but the arrays, as JSON can hold it."""
        settings = [asdict(stage.settings) for stage in self.stages]
        return {"constants": CONSTANTS, "stages": settings, "card": self.card}

    def tensors(self) -> Arrays:
        """Return the arrays of all stages by name."""
        return {f"stage{s}.{name}": a for s, stage in enumerate(self.stages) for name, a in stage.arrays().items()}

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "Cascade":
        """Read a weights file.

        Raises
        ------
        ParameterError
            The file is missing, or is not a cascade of this format, for the filters of this version.
        """
        header, tensors = unpacked(path)
        if header.get("format") != FORMAT:
            raise ParameterError(
                f"{fspath(path)} holds weights of format {header.get('format')!r}; here {FORMAT!r} is read"
            )
        return cls.from_parts(header, tensors, fspath(path))

    @classmethod
    def from_parts(cls, header: Mapping[str, Any], tensors: Arrays, source: str) -> "Cascade":
        """Rebuild a cascade from its header and its arrays.

        Parameters
        ----------
        source
            Name of the file, for messages.

        Raises
        ------
        ParameterError
            The cascade needs something that this version lacks, or an array is missing.
        """
        if header["constants"] != json.loads(json.dumps(CONSTANTS)):
            raise ParameterError(f"{source} was trained with other filters than this version has: train it again")
        stages = []
        for s, stage in enumerate(header["stages"]):
            for name, known in CHOICES.items():
                if stage[name] not in known:
                    raise ParameterError(f"{source} needs the {name} {stage[name]!r}, which this version lacks")
            mine = {name.split(".", 1)[1]: a for name, a in tensors.items() if name.startswith(f"stage{s}.")}
            try:
                stages.append(Regression.from_arrays(StageSettings(**stage), mine))
            except KeyError as error:
                raise ParameterError(f"{source} lacks {error} of stage {s + 1}: train it again") from None
        return cls(tuple(stages), header["card"])


def apply_stage(stage: Regression, mesh: Mesh, noisy: Mesh) -> Mesh:
    """Return a mesh after one more stage: its normals regressed from the filtered ones, its vertices moved to them."""
    settings = stage.settings
    normals = stage_normals(stage, mesh, noisy)
    vertices = recover_vertices(
        mesh, normals, sweeps=settings.sweeps, weighting=settings.weighting, foldovers=settings.foldovers
    )
    free_derived(mesh, noisy)
    return mesh.moved(vertices)
