"""Train the gate, which predicts the better of two networks from the triangulation."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.model_selection import KFold

from cascadenorm.data_gen import SHAPE_FAMILIES, DatasetConfig, pair
from cascadenorm.detection.gate import THRESHOLD, Gate
from cascadenorm.detection.spikes import impulsive, without_outliers
from cascadenorm.detection.triangulation import triangulation_figures
from cascadenorm.execution.process_map import parallel_map
from cascadenorm.execution.progress import Progress, no_progress
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.gated import ChosenNetworks, GatedCascades
from cascadenorm.learned.methods import denoised
from cascadenorm.learned.training import checkpoints
from cascadenorm.mesh import Bools, Floats, angles_between, thread_count

MOST_WEIGHT = 15.0  # largest weight of a mesh: the difference between the results of the networks, in degrees
LEAST_WEIGHT = 0.02
FOLDS = 5


GATE_DATA = DatasetConfig(
    seed=1_000_099,
    count=6000,
    families=(
        "assembly", "bracket", "wheel", "turned", "plate", "polyhedron", "engraved", "fan", "creature", "statue",
        "mounted", "bust", "bumpy", "smooth", "rock", "machined_piece", "grown_piece", "low_poly", "low_poly",
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


@dataclass(frozen=True, kw_only=True)
class GateConfig:
    """Settings that determine a trained gate."""

    seed: int = 0  # of the trees; `data.seed` is the seed of the meshes
    trees: int = 150  # number of trees
    least: int = 6  # minimum number of meshes in a leaf
    data: DatasetConfig = field(default_factory=lambda: GATE_DATA)  # noisy meshes


class Compared(NamedTuple):
    """Features of the triangulation of a mesh, the error of `auto` with each network in degrees, and the family."""

    figures: Floats
    vertex: float
    surface: float
    family: str


def compare_networks(vertex: Cascade, surface: Cascade, config: DatasetConfig, index: int) -> Compared:
    """Denoise a generated mesh with each of the networks."""
    made = pair(config, index)
    mesh, known = without_outliers(made.noisy), np.flatnonzero(made.normals.any(axis=1))
    components, outliers = mesh.topology.component_count, impulsive(made.noisy, mesh)

    def angle(measured: bool) -> float:
        network = ChosenNetworks(vertex, surface, np.full(components, measured), outliers)
        result = made.noisy.moved(denoised(mesh, network))
        return float(np.degrees(angles_between(result.face_normals[known], made.normals[known]).mean()))

    return Compared(triangulation_figures(mesh, np.arange(len(mesh.faces))), angle(False), angle(True), made.family)


def trained_gate(
    vertex: Cascade,
    surface: Cascade,
    config: GateConfig,
    *,
    strong: Cascade | None = None,
    progress: Progress = no_progress,
) -> GatedCascades:
    """Train a gate that chooses the better of two networks for a mesh, and combine them with it.

    `strong` is the network for strong noise, which begins with the first stage of the vertex network. The gate is
    trained without it. The card of the model has, for each family, the mean angles of both networks, of the gate's
    choice in cross-validation, and of the better network. `progress` is called as meshes are compared.
    """
    rows: list[Compared] = []
    with parallel_map(thread_count()) as each:
        for row in each(partial(compare_networks, vertex, surface, config.data), range(config.data.count)):
            rows.append(row)
            progress("meshes for the gate", len(rows), config.data.count)
    figures = np.array([row.figures for row in rows])
    angles = np.array([(row.vertex, row.surface) for row in rows])
    better = angles[:, 1] < angles[:, 0]
    weights = np.minimum(np.abs(angles[:, 0] - angles[:, 1]), MOST_WEIGHT) + LEAST_WEIGHT
    chosen = np.empty(len(rows), bool)
    for learned, tested in KFold(FOLDS, shuffle=True, random_state=config.seed).split(figures):
        part = fitted_gate(config, figures[learned], better[learned], weights[learned])
        chosen[tested] = [part.probability(row) >= THRESHOLD for row in figures[tested]]
    families = np.array([row.family for row in rows])
    card = {
        "model": "extremely randomised trees over figures of the triangulation (Geurts, Ernst, Wehenkel 2006)",
        "made_with": checkpoints.versions(),
        "threshold": THRESHOLD,
        "mean_angles_deg": _mean_angles(families, angles, chosen),
        "config": asdict(config),
    }
    return GatedCascades(vertex, surface, fitted_gate(config, figures, better, weights), card, strong)


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
    """Fit the trees and convert them from scikit-learn."""
    forest = ExtraTreesClassifier(
        config.trees, min_samples_leaf=config.least, max_features=0.2, random_state=config.seed
    )
    forest.fit(figures.astype(np.float32), measured, sample_weight=weights)
    roots: list[int] = []
    parts: list[tuple[NDArray[Any], ...]] = []
    first = 0
    for tree in (estimator.tree_ for estimator in forest.estimators_):
        leaf = tree.children_left < 0
        children = np.stack([tree.children_left, tree.children_right], axis=1) + first
        shares = tree.value[:, 0, :] / tree.value[:, 0, :].sum(axis=1, keepdims=True)
        roots.append(first)
        first += len(leaf)
        parts.append(
            (
                np.where(leaf, -1, tree.feature).astype(np.int32),
                np.where(leaf, 0, tree.threshold).astype(np.float32),
                np.where(leaf[:, None], 0, children).astype(np.int32),
                shares[:, -1].astype(np.float32),
            )
        )
    return Gate(np.array(roots, np.int32), *(np.concatenate(column) for column in zip(*parts, strict=True)))
