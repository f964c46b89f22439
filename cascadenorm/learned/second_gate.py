"""The second gate, for surfaces on which the vertex network finds hardly any noise.

Decimation and remeshing remove the traces by which the first gate recognises a measured surface, and the vertex network
takes an error that is smooth at the scale of the edges for shape. The first stage of the surface network knows such
errors. The second gate compares what it would remove with what it removes from clean meshes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from cascadenorm.detection.gate import Gate
from cascadenorm.detection.noise_level import noise_level
from cascadenorm.learned.noise_evidence import LITTLE, explained_angles, turning_angles
from cascadenorm.learned.regression import Regression
from cascadenorm.learned.stage_normals import FACTS, stage_normals
from cascadenorm.mesh import Floats, Mesh, Vectors, angles_between, part_of
from cascadenorm.mesh.averages import averaged, averaged_around

SAMPLED_FACES = 20_000  # largest number of faces evaluated; of larger surfaces, that many are sampled
SMALLEST_SAMPLE = 2_000  # of many surfaces, at least that many faces each, or all
SAMPLES = 4  # connected parts of a sample
AVERAGES = 0, 1, 2, 4, 8  # passes of averaging after which the size of what the stage removes is measured
SHARES = 0.1, 0.5, 0.9
LEAST = 1e-6  # smallest mean angle in degrees that others are compared with; smaller ones are rounding


@dataclass(frozen=True)
class SecondGate:
    """A forest with the first stages of both networks."""

    forest: Gate
    vertex: Regression
    surface: Regression

    def __call__(self, mesh: Mesh, groups: Sequence[NDArray[np.intp]]) -> Floats:
        """Return the probability that each group of faces, given by their indices, is a measured surface.

        It is 0 if the vertex network finds noise.
        """
        found = unnoticed_figures(self.vertex, self.surface, mesh, groups)
        return np.array([0.0 if figures is None else self.forest.probability(figures) for figures in found])


def unnoticed_figures(
    vertex: Regression, surface: Regression, mesh: Mesh, groups: Sequence[NDArray[np.intp]]
) -> list[Floats | None]:
    """Measure what the first stage of the surface network removes from each group of faces; see `removed_figures`.

    It is None if the first stage of the vertex network turns them by 3 degrees or more, that is, finds noise.
    """
    most = max(SAMPLED_FACES // len(groups), SMALLEST_SAMPLE)
    samples = [_sampled(mesh, faces, most) for faces in groups]
    every = np.sort(np.concatenate(samples))
    whole = len(every) == len(mesh.faces)
    part = mesh if whole else part_of(mesh, every)[0].with_facts(**{fact: getattr(mesh, fact) for fact in FACTS})
    places = samples if whole else [np.searchsorted(every, sample) for sample in samples]
    angles = turning_angles(part, first_normals(vertex, part))
    quiet = [float(angles[place].mean()) < LITTLE[1] for place in places]
    normals = first_normals(surface, part) if any(quiet) else None
    return [
        None if normals is None or not unnoticed else removed_figures(_own(part, place), normals[place])
        for place, unnoticed in zip(places, quiet, strict=True)
    ]


def _own(mesh: Mesh, faces: NDArray[np.intp]) -> Mesh:
    return mesh if len(faces) == len(mesh.faces) else part_of(mesh, faces)[0]


def removed_figures(mesh: Mesh, normals: Vectors) -> Floats:
    """Measure the difference between the face normals of a mesh and the normals of a stage, (m, 3).

    The features, (16,), are the correlation of the differences between adjacent faces, their mean square after each
    number of AVERAGES over the vertices, the mean angle and its quantiles, the angles between adjacent normals of the
    stage and their mean relative to that before it, the noise level, and the mean angle that it explains.
    """
    topology, before = mesh.topology, mesh.face_normals
    rows, sides = np.nonzero(topology.faces_across >= 0)
    others = topology.faces_across[rows, sides]
    removed = before - normals
    square = max(float(np.einsum("ij,ij->", removed, removed)) / len(removed), np.radians(LEAST) ** 2)
    sizes, means, done = [], averaged_around(removed, topology.vertex_faces), 0
    for passes in AVERAGES:
        if passes > done:
            means, done = averaged(means, topology.vertex_neighbors, passes - done), passes
        sizes.append(float(np.einsum("ij,ij->", means, means)) / len(means) / square)
    correlation = float(np.einsum("ij,ij->", removed[rows], removed[others])) / max(len(rows), 1) / square

    angles = np.degrees(angles_between(before, normals, undefined=0.0))
    mean = max(float(angles.mean()), LEAST)
    bends = np.degrees(angles_between(normals[rows], normals[others], undefined=0.0)) if len(rows) else np.zeros(1)
    bends_before = np.degrees(angles_between(before[rows], before[others], undefined=0.0)) if len(rows) else np.ones(1)
    noise = noise_level(mesh) or 0.0
    explained = np.degrees(explained_angles(mesh, np.full(len(mesh.faces), noise * mesh.mean_edge_length)))
    return np.array(
        [
            correlation, *sizes, mean, *(np.quantile(angles, SHARES) / mean), *np.quantile(bends, SHARES),
            bends.mean() / max(float(bends_before.mean()), LEAST), noise, explained.mean() / mean,
        ]
    )  # fmt: skip


_first: WeakKeyDictionary[Mesh, list[tuple[Regression, Vectors]]] = WeakKeyDictionary()
"""Normals after first stages for small meshes, which both the second gate and the denoising need."""


def first_normals(stage: Regression, mesh: Mesh) -> Vectors:
    """Return the normals, (m, 3), of the first stage of a network; those of small meshes are kept."""
    if len(mesh.faces) > SAMPLED_FACES:
        return stage_normals(stage, mesh, mesh)
    known = _first.setdefault(mesh, [])
    for other, normals in known:
        if other is stage:
            return normals
    known.append((stage, stage_normals(stage, mesh, mesh)))
    return known[-1][1]


def _sampled(mesh: Mesh, faces: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Return some faces in ascending order, or if there are too many, those nearest to a few random ones of them."""
    if len(faces) <= most:
        return faces
    centroids, count = mesh.centroids[faces], most // SAMPLES
    reach = np.sqrt(count * mesh.areas[faces].mean())
    chosen = []
    for middle in centroids[np.random.default_rng(0).choice(len(faces), SAMPLES, replace=False)]:
        near = np.flatnonzero((np.abs(centroids - middle) < reach).all(axis=1))
        if len(near) > count:
            distances = np.einsum("ij,ij->i", centroids[near] - middle, centroids[near] - middle)
            near = near[np.argpartition(distances, count)[:count]]
        chosen.append(near)
    return np.asarray(faces[np.unique(np.concatenate(chosen))])
