"""Generate noisy/clean pairs and write them as a data set.

Each pair depends only on the seed and its index.
"""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.families import SHAPE_FAMILIES, ErrorPart, ShapeFamily
from cascadenorm.data_gen.noise.noise import NoiseKind, displacements, relief
from cascadenorm.data_gen.noise.sensor import LASER_LEVELS
from cascadenorm.data_gen.scanning.measured import Measured
from cascadenorm.data_gen.shapes.placement import log_uniform, random_rotation
from cascadenorm.execution.process_map import parallel_map
from cascadenorm.execution.progress import Progress, no_progress
from cascadenorm.mesh import Mesh, Vectors

PULLED = 0.3  # share of the meshes that are stretched with their triangles
LEAST_FACES = 1200  # with fewer faces, the details of some families would be finer than their triangles
CLEAN_SHARES: dict[ErrorPart, float] = {
    "low-poly": 0.8,
    "decimated": 0.75,
    "structured": 0.5,
    "subdivided": 0.7,
    "modelled": 0.7,
    "isosurface": 0.65,
    "tessellation": 1.0,  # such triangles never come from a measurement
    "terrain": 1.0,  # noise on a grid counts as that of a scanner
}
"""Share of the meshes without noise, as modelling programs export them, if the noise kinds include "none"."""
CLEAN_RELIEF = 0.6  # share of the meshes with relief that have no noise
RELIEF_LEVELS = 0.02, 0.3  # level of the white noise on the other meshes with relief
STRONGEST = 1.5  # largest level of volumes and point clouds, as a multiple of the largest level of noise
ATTEMPTS = 400  # shapes drawn per index before giving up; few faces with a large error rarely give a valid shape

OWN_FAMILY = "own"  # stands for the family of meshes that were not generated

# Separate streams of random numbers, so that the noise settings do not change the shapes.
_SHAPE, _NOISE, _OWN = 0, 1, 2


USUAL_KINDS: tuple[NoiseKind, ...] = (
    "normal", "normal", "gaussian", "uniform", "impulsive", "varying", "mixed", "sensor",
)  # fmt: skip


@dataclass(frozen=True)
class DatasetConfig:
    """Settings of a data set. Equal settings give byte-identical data."""

    count: int = 2000  # of pairs
    seed: int = 0  # of all random numbers
    families: tuple[str, ...] = tuple(SHAPE_FAMILIES)  # families that are not listed are held out
    # bounds on the target number of faces, which is drawn log-uniformly and met within about a third
    min_faces: int = 4000
    max_faces: int = 15000
    # kinds of noise, drawn with equal chance; list one twice to double its chance. `sensor` applies only to the
    # families that cameras see, and to half of their meshes. If it is the only kind, it applies to all meshes
    noise_kinds: tuple[NoiseKind, ...] = USUAL_KINDS
    # share of the meshes whose shape gets a smooth relief a few edges wide. Most of these have no noise if the noise
    # kinds include "none". Shapes that cameras or volumes measure, and parts that never have noise, get no relief
    relief: float = 0.0
    # noise level in mean edge lengths, drawn log-uniformly. The levels of volumes and point clouds have units of their
    # own, and half of them are drawn uniformly, up to STRONGEST times max_level
    min_level: float = 0.02
    max_level: float = 0.9

    def __post_init__(self) -> None:
        if self.count < 1:
            raise ValueError(f"count is {self.count}; it must be at least 1")
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}; it must be at least 0")
        unknown = [name for name in self.families if name not in SHAPE_FAMILIES]
        if unknown or not self.families:
            raise ValueError(f"families are {unknown or 'empty'}; there are {', '.join(SHAPE_FAMILIES)}")
        if not LEAST_FACES <= self.min_faces <= self.max_faces:
            raise ValueError(
                f"faces are {self.min_faces} to {self.max_faces}; at least {LEAST_FACES}, and the larger one last"
            )
        strange = [kind for kind in self.noise_kinds if kind not in get_args(NoiseKind)]
        if strange or not self.noise_kinds:
            raise ValueError(f"noise kinds are {strange or 'empty'}; there are {', '.join(get_args(NoiseKind))}")
        if not 0 <= self.relief <= 1:
            raise ValueError(f"relief is {self.relief}; it must be a share between 0 and 1")
        if not 0 < self.min_level <= self.max_level < math.inf:
            raise ValueError(f"noise levels are {self.min_level} to {self.max_level}; above 0, and the larger one last")

    @property
    def has_clean_meshes(self) -> bool:
        """Whether some meshes have no noise."""
        return "none" in self.noise_kinds


class Pair(NamedTuple):
    """A noisy and a clean mesh with the same faces."""

    noisy: Mesh
    clean: Mesh  # with the same m faces
    normals: Vectors  # (m, 3) true normal of each face; zero where it is unknown
    family: str  # of shapes
    noise_kind: NoiseKind
    # Noise level in mean edge lengths of the clean mesh; for structured meshes, in edge lengths of equilateral
    # triangles that are as high as its own on average. `fused` defines it for meshes from a volume.
    level: float


def family_of(config: DatasetConfig, index: int) -> str:
    """Return the name of the family that an index draws from."""
    weights = np.array([SHAPE_FAMILIES[name].weight for name in config.families])
    rng = _stream(config, index, _SHAPE)
    return str(rng.choice(config.families, p=weights / weights.sum()))


def clean_mesh(config: DatasetConfig, index: int) -> Mesh:
    """Make the clean mesh of an index. Invalid shapes are drawn again."""
    return _drawn(config, index, level=0.0).clean


def _drawn(config: DatasetConfig, index: int, *, level: float) -> Measured:
    """Make the mesh of an index, including the measurement error if that determines the triangles."""
    family = SHAPE_FAMILIES[family_of(config, index)]
    for attempt in range(ATTEMPTS):
        rng = _stream(config, index, _SHAPE, attempt + 1)
        faces = round(math.exp(rng.uniform(math.log(config.min_faces), math.log(config.max_faces))))
        try:
            made = family.make(rng=rng, faces=faces, level=level)
        except UnfitShapeError:
            continue
        if 0.6 * faces <= len(made.clean.faces) <= 1.6 * faces:
            if not (family.seen or family.measured) and rng.random() < PULLED:
                pulled = _pulled(made.clean, rng=rng)
                return Measured.on_surface(pulled, pulled)
            return made
    raise RuntimeError(f"no fit shape for index {index} of seed {config.seed} in {ATTEMPTS} attempts")


def _pulled(mesh: Mesh, *, rng: np.random.Generator) -> Mesh:
    """Stretch a mesh along three perpendicular directions, by a ratio of at most about three."""
    axes = random_rotation(rng=rng)
    return mesh.moved(mesh.vertices @ (axes * np.exp(rng.uniform(-0.55, 0.55, 3))) @ axes.T)


def _noise(config: DatasetConfig, *, family: ShapeFamily | None, rng: np.random.Generator) -> tuple[NoiseKind, float]:
    """Draw the kind and the level of noise.

    Scenes that cameras see can get the noise of a depth camera. CLEAN_SHARES gives the shares of families without
    noise. Half of the levels of volumes and point clouds are drawn uniformly, since low grain and small point errors
    leave a practically clean surface, and up to STRONGEST times the largest one. All others are drawn log-uniformly.
    """
    kinds = [kind for kind in config.noise_kinds if kind != "sensor"]
    if family is not None and family.measured:  # the level is that of the measurement error
        kinds = [kind for kind in kinds if kind != "none"] or ["normal"]
    if family is not None and rng.random() < CLEAN_SHARES.get(family.part, 0.0) and config.has_clean_meshes:
        kinds = ["none"]
    if family is not None and family.part == "laser":
        return "laser", log_uniform(LASER_LEVELS, rng=rng)
    sensed = not kinds or (family is not None and family.seen and "sensor" in config.noise_kinds and rng.random() < 0.5)
    kind: NoiseKind = "sensor" if sensed else kinds[rng.integers(len(kinds))]
    if family is not None and family.measured and rng.random() < 0.5:
        level = rng.uniform(config.min_level, STRONGEST * config.max_level)
    else:
        level = log_uniform((config.min_level, config.max_level), rng=rng)
    return kind, 0.0 if kind == "none" else level


def pair(config: DatasetConfig, index: int) -> Pair:
    """Make one noisy/clean pair, which depends only on the config and the index."""
    name = family_of(config, index)
    rng = _stream(config, index, _NOISE)
    family = SHAPE_FAMILIES[name]
    kind, level = _noise(config, family=family, rng=rng)
    if family.measured or (family.part == "fused" and kind == "sensor"):
        made = _drawn(config, index, level=level)
        return Pair(*made, name, "none" if family.measured else kind, level)
    clean = clean_mesh(config, index)
    modelled = not family.seen and CLEAN_SHARES.get(family.part) != 1
    if modelled and rng.random() < config.relief:
        clean = clean.moved(clean.vertices + relief(clean, rng=rng))
        if config.has_clean_meshes:
            clean_relief = rng.random() < CLEAN_RELIEF
            kind, level = ("none", 0.0) if clean_relief else ("normal", log_uniform(RELIEF_LEVELS, rng=rng))
    return _disturbed(clean, name, kind, level, rng=rng)


def own_pair(config: DatasetConfig, index: int, clean: Mesh) -> Pair:
    """Add noise as the config describes it to a given clean mesh. Each index gives another draw."""
    rng = _stream(config, index, _OWN)
    return _disturbed(clean, OWN_FAMILY, *_noise(config, family=None, rng=rng), rng=rng)


def _disturbed(clean: Mesh, family: str, kind: NoiseKind, level: float, *, rng: np.random.Generator) -> Pair:
    # Noise relative to the mean edge length would exceed the height of most elongated triangles
    size = level * _narrowness(clean) if family == "structured" else level
    noisy = clean.moved(clean.vertices + displacements(clean, kind, level=size, rng=rng))
    return Pair(noisy, clean, clean.face_normals, family, kind, level)


def _narrowness(mesh: Mesh) -> float:
    """Return the mean height of the triangles, relative to that of an equilateral one with the mean edge length."""
    return float(mesh.heights.mean() / mesh.mean_edge_length) * 2 / math.sqrt(3)


def pairs(config: DatasetConfig, indices: Sequence[int] | None = None, *, workers: int = 1) -> Iterator[Pair]:
    """Make the pairs of the given indices, or all pairs, in order. The result does not depend on `workers`."""
    if workers < 1:
        raise ValueError(f"workers is {workers}; it must be at least 1")
    chosen = range(config.count) if indices is None else indices
    with parallel_map(workers) as each:
        yield from each(partial(pair, config), chosen)


def write_dataset(
    folder: Path,
    config: DatasetConfig,
    *,
    write: Callable[[Path, Mesh], None],
    workers: int = 1,
    progress: Progress = no_progress,
) -> None:
    """Write `<index>_<family>/noisy.ply` and `clean.ply` for each pair, and `dataset.json`, which describes them.

    The folder is created if it does not exist; existing files are overwritten. `progress` is called with (task, number
    of finished pairs, total number of pairs) after each pair.
    """
    folder.mkdir(parents=True, exist_ok=True)
    entries = []
    for index, made in enumerate(pairs(config, workers=workers)):
        name = f"{index:05d}_{made.family}"
        (folder / name).mkdir(exist_ok=True)
        write(folder / name / "noisy.ply", made.noisy)
        write(folder / name / "clean.ply", made.clean)
        sizes = {"vertices": len(made.clean.vertices), "faces": len(made.clean.faces)}
        about = {"family": made.family, "noise_kind": made.noise_kind, "level": made.level}
        entries.append({"name": name, **about, **sizes})
        progress("generating", len(entries), config.count)
    text = json.dumps({"config": asdict(config), "pairs": entries}, indent=1)
    (folder / "dataset.json").write_text(text + "\n", encoding="utf-8")


def training_patches(mesh: Mesh, *, faces: int) -> list[NDArray[np.intp]]:
    """Halve a mesh across its longest side until no part has more than `faces` faces; return their face numbers."""
    done, waiting = [], [np.arange(len(mesh.faces))]
    while waiting:
        chosen = waiting.pop()
        if len(chosen) <= faces:
            done.append(chosen)
            continue
        centroids = mesh.centroids[chosen]
        along = np.argsort(centroids[:, np.argmax(np.ptp(centroids, axis=0))], kind="stable")
        middle = len(chosen) // 2
        waiting += [np.sort(chosen[along[middle:]]), np.sort(chosen[along[:middle]])]
    return done


def _stream(config: DatasetConfig, index: int, *key: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(index, *key)))
