"""Train the gates, which predict the better of two networks from the triangulation and from their first stages."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.model_selection import KFold

from cascadenorm.data_gen import SHAPE_FAMILIES, DatasetConfig, Pair, pair
from cascadenorm.detection.gate import SECOND_THRESHOLD, THRESHOLD, Gate
from cascadenorm.detection.spikes import impulsive, without_outliers
from cascadenorm.detection.triangulation import triangulation_figures
from cascadenorm.execution.process_map import parallel_map
from cascadenorm.execution.progress import Progress, no_progress
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.gated import ChosenNetworks, GatedCascades
from cascadenorm.learned.methods import denoised
from cascadenorm.learned.second_gate import unnoticed_figures
from cascadenorm.learned.training import checkpoints
from cascadenorm.mesh import Bools, Floats, Mesh, angles_between, thread_count

MOST_WEIGHT = 15.0  # largest weight of a mesh: the difference between the results of the networks, in degrees
LEAST_WEIGHT = 0.02
LEAST_GAIN = 0.5  # smallest gain by the surface network, in degrees, for which the second gate should choose it
SECOND_LEAST_WEIGHT = 0.3  # large, so that clean meshes count that neither network changes
FOLDS = 5


SHAPES = (
    "assembly", "bracket", "wheel", "turned", "plate", "polyhedron", "engraved", "fan", "creature", "statue", "mounted",
    "bust", "bumpy", "smooth", "rock", "machined_piece", "grown_piece", "low_poly", "low_poly",
)  # fmt: skip
"""Families of the meshes for both gates that are not measured; others follow."""
GATE_DATA = DatasetConfig(
    seed=1_000_099,
    count=6000,
    families=(
        *SHAPES,
        "decimated", "decimated", "decimated", "subdivided", "subdivided", "structured", "structured", "structured",
        "terrain", "terrain", "terrain", "terrain", "modelled", "modelled", "modelled", "modelled",
        "cad_tessellation", "cad_tessellation", "cad_tessellation", "view", "view", "view", "view", "view", "laser",
        "laser", "laser", "laser", "laser", "laser", "fused", "fused", "segmentation", "segmentation", "segmentation",
        "slices", "slices", "slices", "tomogram", "tomogram", "tomogram", "tetrahedra", "tetrahedra", "points",
        "points", "points",
    ),
    min_faces=1200,
    max_faces=12_000,
    noise_kinds=(
        "normal", "normal", "gaussian", "uniform", "impulsive", "varying", "mixed", "correlated", "correlated",
        "quantised", "sensor", "none", "none", "none",
    ),
    relief=0.15,
)  # fmt: skip
"""Noisy meshes of all kinds, from a seed that no network is trained with."""


ALL_KINDS = DatasetConfig(
    seed=1_000_199,
    count=2200,
    families=(
        *SHAPES,
        "decimated", "decimated", "decimated", "decimated", "decimated", "subdivided", "subdivided", "structured",
        "structured", "terrain", "terrain", "terrain", "modelled", "modelled", "modelled", "modelled",
        "cad_tessellation", "cad_tessellation", "cad_tessellation", "segmentation", "slices", "tomogram", "points",
        "points", "view", "fused", *(10 * ("retriangulated_scan",)),
    ),
    min_faces=1200,
    max_faces=9000,
    noise_kinds=(
        "normal", "gaussian", "uniform", "impulsive", "varying", "mixed", "correlated", "correlated", "quantised",
        "sensor", *(8 * ("none",)),
    ),
    relief=0.25,
)  # fmt: skip
"""Meshes of all kinds, most of them without noise, from a seed of their own."""
WITHOUT_NOISE = replace(
    ALL_KINDS,
    seed=1_000_399,
    count=1000,
    families=(
        "decimated", "decimated", "decimated", "decimated", "modelled", "modelled", "low_poly", "statue", "creature",
        "bust", "bumpy", "rock", "grown_piece",
    ),
    noise_kinds=("none",),
)  # fmt: skip
"""Organic shapes with detail as small as their edges, which the surface network would remove."""
RETRIANGULATED = replace(ALL_KINDS, seed=1_000_499, count=500, families=("retriangulated_scan",), min_level=0.05)
"""Decimated and remeshed scans, whose triangles tell the first gate nothing."""


@dataclass(frozen=True, kw_only=True)
class GateConfig:
    """Settings that determine trained gates."""

    seed: int = 0  # of the trees; `data.seed` is the seed of the meshes
    trees: int = 150  # number of trees
    least: int = 6  # minimum number of meshes in a leaf
    data: DatasetConfig = field(default_factory=lambda: GATE_DATA)  # noisy meshes
    # meshes for the second gate
    second_data: tuple[DatasetConfig, ...] = (ALL_KINDS, WITHOUT_NOISE, RETRIANGULATED)


class Compared(NamedTuple):
    """Features of a mesh for a gate, the error of `auto` with each network in degrees, and the family."""

    figures: Floats
    vertex: float
    surface: float
    family: str


def compare_networks(vertex: Cascade, surface: Cascade, config: DatasetConfig, index: int) -> Compared:
    """Denoise a generated mesh with each of the networks."""
    made = pair(config, index)
    mesh = without_outliers(made.noisy)
    return _compared(vertex, surface, made, mesh, triangulation_figures(mesh, np.arange(len(mesh.faces))))


def compare_unnoticed(model: GatedCascades, place: tuple[DatasetConfig, int]) -> Compared | None:
    """Denoise a mesh with each network if the gate does not recognise it, and the vertex network finds no noise.

    The mesh is given by its data set and index. The features are those of the second gate.
    """
    made = pair(*place)
    mesh = without_outliers(made.noisy)
    faces = np.arange(len(mesh.faces))
    if model.gate.probability(triangulation_figures(mesh, faces)) >= THRESHOLD:
        return None
    (figures,) = unnoticed_figures(model.vertex.stages[0], model.surface.stages[0], mesh, [faces])
    return None if figures is None else _compared(model.vertex, model.surface, made, mesh, figures)


def _compared(vertex: Cascade, surface: Cascade, made: Pair, mesh: Mesh, figures: Floats) -> Compared:
    known, outliers = np.flatnonzero(made.normals.any(axis=1)), impulsive(made.noisy, mesh)

    def angle(measured: bool) -> float:
        network = ChosenNetworks(vertex, surface, np.full(mesh.topology.component_count, measured), outliers)
        result = made.noisy.moved(denoised(mesh, network))
        return float(np.degrees(angles_between(result.face_normals[known], made.normals[known]).mean()))

    return Compared(figures, angle(False), angle(True), made.family)


def trained_gate(
    vertex: Cascade,
    surface: Cascade,
    config: GateConfig,
    *,
    strong: Cascade | None = None,
    progress: Progress = no_progress,
) -> GatedCascades:
    """Train gates that choose the better of two networks for a mesh, and combine them with it.

    `strong` is the network for strong noise, which begins with the first stage of the vertex network. The gates are
    trained without it. The card of the model has, for each gate and family, the mean angles of both networks, of the
    gate's choice in cross-validation, and of the better network. `progress` is called as meshes are compared.
    """
    rows: list[Compared] = []
    with parallel_map(thread_count()) as each:
        for row in each(partial(compare_networks, vertex, surface, config.data), range(config.data.count)):
            rows.append(row)
            progress("meshes for the gate", len(rows), config.data.count)
    gate, angles = _fitted(config, rows, THRESHOLD, least_gain=0.0, least_weight=LEAST_WEIGHT)
    card = {
        "model": "extremely randomised trees over figures of the triangulation (Geurts, Ernst, Wehenkel 2006)",
        "made_with": checkpoints.versions(),
        "threshold": THRESHOLD,
        "mean_angles_deg": angles,
        "config": asdict(config),
    }
    return with_second_gate(GatedCascades(vertex, surface, gate, card, strong), config, progress=progress)


def with_second_gate(model: GatedCascades, config: GateConfig, *, progress: Progress = no_progress) -> GatedCascades:
    """Train the second gate of a model on the meshes that the first one does not recognise."""
    rows: list[Compared] = []
    meshes = [(data, index) for data in config.second_data for index in range(data.count)]
    with parallel_map(thread_count()) as each:
        for done, row in enumerate(each(partial(compare_unnoticed, model), meshes), 1):
            if row is not None:
                rows.append(row)
            progress("meshes for the second gate", done, len(meshes))
    second_gate, angles = _fitted(
        config, rows, SECOND_THRESHOLD, least_gain=LEAST_GAIN, least_weight=SECOND_LEAST_WEIGHT
    )
    card = {"threshold": SECOND_THRESHOLD, "meshes": len(rows), "mean_angles_deg": angles}
    return replace(model, gate_card={**model.gate_card, "second_gate": card}, second_gate=second_gate)


def _fitted(
    config: GateConfig, rows: Sequence[Compared], threshold: float, *, least_gain: float, least_weight: float
) -> tuple[Gate, Mapping[str, dict[str, float]]]:
    """Fit a gate to rows, and return it with the mean angles of its choices in cross-validation."""
    figures = np.array([row.figures for row in rows])
    angles = np.array([(row.vertex, row.surface) for row in rows])
    gains = angles[:, 0] - angles[:, 1]
    better = gains > least_gain
    weights = np.minimum(np.abs(gains), MOST_WEIGHT) + least_weight
    chosen = np.empty(len(rows), bool)
    for learned, tested in KFold(FOLDS, shuffle=True, random_state=config.seed).split(figures):
        part = fitted_gate(config, figures[learned], better[learned], weights[learned])
        chosen[tested] = [part.probability(row) >= threshold for row in figures[tested]]
    families = np.array([row.family for row in rows])
    return fitted_gate(config, figures, better, weights), _mean_angles(families, angles, chosen)


def _mean_angles(families: NDArray[Any], angles: Floats, chosen: Bools) -> Mapping[str, dict[str, float]]:
    columns = {
        "vertex": angles[:, 0],
        "surface": angles[:, 1],
        "chosen": np.where(chosen, angles[:, 1], angles[:, 0]),
        "better": angles.min(axis=1),
    }
    means = {}
    for name in (*(family for family in SHAPE_FAMILIES if family in families), "all"):
        mine = (families == name) | (name == "all")
        means[name] = {column: round(float(values[mine].mean()), 2) for column, values in columns.items()}
    return means


def fitted_gate(config: GateConfig, figures: Floats, measured: Bools, weights: Floats) -> Gate:
    """Fit the trees and convert them from scikit-learn, which lists the lower child of a node next to it."""
    forest = ExtraTreesClassifier(
        config.trees, min_samples_leaf=config.least, max_features=0.2, random_state=config.seed
    )
    forest.fit(figures.astype(np.float32), measured, sample_weight=weights)
    roots: list[int] = []
    parts: list[tuple[NDArray[Any], ...]] = []
    first = 0
    for tree in (estimator.tree_ for estimator in forest.estimators_):
        leaf = tree.children_left < 0
        shares = tree.value[:, 0, :] / tree.value[:, 0, :].sum(axis=1, keepdims=True)
        roots.append(first)
        parts.append(
            (
                np.where(leaf, -1, tree.feature).astype(np.int8),
                np.where(leaf, shares[:, -1], tree.threshold).astype(np.float32),
                np.where(leaf, 0, tree.children_right + first).astype(np.int32),
            )
        )
        first += len(leaf)
    return Gate(np.array(roots, np.int32), *(np.concatenate(column) for column in zip(*parts, strict=True)))
