"""The cascade of stages (Wang, Liu, Tong 2016).

Each stage regresses normals and moves the vertices to fit them. The next stage starts from the result.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from os import PathLike, fspath
from typing import Any

import numpy as np

from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.errors import ConfigError, ParameterError
from cascadenorm.execution.progress import track
from cascadenorm.geometry.patches.work import free_derived
from cascadenorm.learned.descriptors import DESCRIPTORS
from cascadenorm.learned.regression import Regression
from cascadenorm.learned.stage import Stage
from cascadenorm.learned.stage_normals import stage_normals
from cascadenorm.learned.weights import Arrays, packed, unpacked
from cascadenorm.mesh import Mesh, Vectors

CASCADE_FORMATS = ("cascadenorm/8", "cascadenorm/7", "cascadenorm/6")
"""Formats of weights files. The first one is written. A format also identifies the constants in `descriptors` and
`features`: add a format when a constant changes. In the older formats, networks read all pairs of filtered normals, and
stages have a setting `neighborhood`; in the oldest one, weightings also have other names."""
OLD_WEIGHTINGS = {"heights": "uniform", "angles": "cotangent", "inverse-height": "cotangent"}


@dataclass(frozen=True)
class Cascade:
    """Regressions applied in turn. Each starts from the vertices that the previous one recovered."""

    stages: tuple[Regression, ...]  # in order
    card: Mapping[str, Any]  # model card with configuration, seed and results; any JSON value

    @property
    def networks(self) -> dict[str, "Cascade"]:
        """This network under an empty name; `GatedCascades.networks` has several by name."""
        return {"": self}

    def steps(self, mesh: Mesh, known: list[Vectors] | None = None) -> Iterator[Mesh]:
        """Yield the mesh after each stage.

        If the normals of the first stages, (m, 3), are known, they are removed from the list `known` and used.
        """
        noisy = mesh
        for number in track(len(self.stages)):
            mesh = apply_stage(self.stages[number], mesh, noisy, known.pop(0) if known else None)
            yield mesh

    def vertices(self, mesh: Mesh, known: list[Vectors] | None = None) -> Vectors:
        """Return the vertices of the mesh after the last stage, (n, 3). For `known`, see `steps`."""
        for last in self.steps(mesh, known):  # previous meshes are released
            mesh = last
        return mesh.vertices

    def begins_like(self, other: "Cascade") -> bool:
        """Return whether the first stages of two cascades are equal."""
        ours, theirs = self.stages[0], other.stages[0]
        arrays, others = ours.arrays(), theirs.arrays()
        return ours.settings == theirs.settings and all(
            np.array_equal(array, others[name]) for name, array in arrays.items()
        )

    def to_bytes(self) -> bytes:
        """Return the content of a weights file. Equal cascades have equal bytes."""
        return packed({"format": CASCADE_FORMATS[0], **self.header()}, self.tensors())

    def header(self) -> dict[str, Any]:
        """Return everything except the arrays, as JSON values."""
        settings = [asdict(stage.settings) for stage in self.stages]
        return {"stages": settings, "card": self.card}

    def tensors(self) -> Arrays:
        """Return the arrays of all stages by name."""
        return {f"stage{s}.{name}": a for s, stage in enumerate(self.stages) for name, a in stage.arrays().items()}

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "Cascade":
        """Read a weights file; raise ParameterError if it is missing, or is not a cascade of a known format."""
        header, tensors = unpacked(path)
        if header.get("format") not in CASCADE_FORMATS:
            raise ParameterError(
                f"{fspath(path)} holds weights of format {header.get('format')!r}; here {CASCADE_FORMATS[0]!r} is read"
            )
        return cls.from_parts(header, tensors, fspath(path))

    @classmethod
    def from_parts(cls, header: Mapping[str, Any], tensors: Arrays, source: str) -> "Cascade":
        """Rebuild a cascade from its header and its arrays; messages name the file `source`.

        Raises ParameterError if the cascade has settings that this version does not support, or an array is missing.
        """
        stages = []
        for s, stage in enumerate(header["stages"]):
            given = dict(stage)
            neighborhood = given.pop("neighborhood", "distance")
            given["weighting"] = OLD_WEIGHTINGS.get(given["weighting"], given["weighting"])
            mine = {name.split(".", 1)[1]: a for name, a in tensors.items() if name.startswith(f"stage{s}.")}
            try:
                settings = Stage(**given)
                if neighborhood == "rings" and DESCRIPTORS[settings.descriptor].filters:
                    raise ConfigError("filters over rings of faces")
                stages.append(Regression.from_arrays(settings, mine))
            except ConfigError as error:
                raise ParameterError(f"{source} needs what this version lacks: {error}") from None
            except KeyError as error:
                raise ParameterError(f"{source} lacks {error} of stage {s + 1}: train it again") from None
        return cls(tuple(stages), header["card"])


def apply_stage(stage: Regression, mesh: Mesh, noisy: Mesh, normals: Vectors | None = None) -> Mesh:
    """Return a mesh after one more stage: regress its normals, unless given, and move its vertices to fit them."""
    settings = stage.settings
    if normals is None:
        normals = stage_normals(stage, mesh, noisy)
    vertices = recover_vertices(
        mesh, normals, sweeps=settings.sweeps, weighting=settings.weighting, foldovers=settings.foldovers
    )
    free_derived(mesh, noisy)
    return mesh.moved(vertices)
