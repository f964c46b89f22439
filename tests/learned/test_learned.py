import json
import sys
from dataclasses import asdict, replace
from itertools import product

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file
from scipy.spatial.transform import Rotation
from shapes import cube, grid, icosphere, noisy

from cascadenorm.baselines.bilateral_normal import bilateral_normals
from cascadenorm.baselines.iterated_bilateral import LANES, _bilateral_range, iterated_bilateral_normals
from cascadenorm.baselines.smoothed_normals import smoothed_normals
from cascadenorm.compute.threads import BLOCK
from cascadenorm.errors import ParameterError
from cascadenorm.geometry.neighborhoods import faces_near
from cascadenorm.learned.cascade import CASCADE_FORMATS, Cascade
from cascadenorm.learned.descriptors import (
    CUTOFF,
    DESCRIPTORS,
    ITERATED_16,
    ITERATED_32,
    ITERATED_64,
    ITERATED_SIGMA_R,
    LATER_SMOOTH_PASSES,
    SIGMA_R,
    SIGMA_S,
    SMOOTH_PASSES,
    SMOOTH_SIGMA_R,
    SMOOTHING_DIRECTION,
    bilateral_descriptor,
    guided_descriptor,
)
from cascadenorm.learned.features import (
    CONTEXT_STEPS,
    FLOOR,
    FeatureScaler,
    all_pairs,
    component_sums,
    context_features,
    openness,
    pairwise_features,
)
from cascadenorm.learned.packed_normals import no_normals, pack, unpacked
from cascadenorm.learned.regression import Regression, stage_stack
from cascadenorm.learned.stage import Stage
from cascadenorm.learned.training.network_training import Network
from cascadenorm.mesh import Mesh, angles_between, in_blocks, limit_threads, unit
from cascadenorm.mesh.averages import averaged_around

MESH = noisy(icosphere(2), 0.2)
TURN = Rotation.from_euler("xyz", [0.4, -1.1, 2.0]).as_matrix()


def reference_descriptor(mesh: Mesh) -> np.ndarray:
    """The descriptors as the paper writes them: B-FND, then G-FND, face by face, with Gaussians that are cut off."""
    n, c, a, l = mesh.face_normals, mesh.centroids, mesh.areas, mesh.mean_edge_length

    def gauss(x, sigma):
        return np.exp(-(x**2) / (2 * sigma**2))

    def filtered(sigma_s, sigma_r, guide):
        rows = []
        for f in range(len(n)):
            distance = np.linalg.norm(c - c[f], axis=1)
            g = np.flatnonzero(distance <= CUTOFF * sigma_s * l)
            w = a[g] * gauss(distance[g], sigma_s * l)
            w *= gauss(np.linalg.norm(guide[g] - guide[f], axis=1), sigma_r)
            rows.append(w @ n[g])
        return unit(np.array(rows))

    plain = [filtered(s, r, n) for s in SIGMA_S for r in SIGMA_R]
    guided = [filtered(s, r, filtered(s, np.inf, n)) for s in SIGMA_S for r in SIGMA_R[:-1]]
    return np.stack([*plain, *guided], axis=1)


def iterated(mesh: Mesh) -> np.ndarray:
    """Iterated bilateral normals as the first stage has them."""
    own = mesh.face_normals.astype(np.float32)[:, None]
    each = iterated_bilateral_normals(mesh, sigma_r=ITERATED_SIGMA_R, passes=ITERATED_64)
    return np.concatenate([own, *(normals.copy() for normals in each)], axis=1)


def smoothed(mesh: Mesh, along: np.ndarray, passes: tuple[int, ...], sigma_r: float = np.inf) -> np.ndarray:
    """Normals between smoothed vertices, (m, p, 3)."""
    return np.stack([normals.copy() for normals in smoothed_normals(mesh, along, passes, sigma_r=sigma_r)], axis=1)


def stage_settings(descriptor: str, *, activation: str = "tanh") -> Stage:
    """Settings of a stage."""
    return Stage(descriptor=descriptor, activation=activation, foldovers="ignore")


def random_regression(descriptor: str, *, seed: int = 0, activation: str = "tanh") -> Regression:
    """A stage with random weights."""
    rng = np.random.default_rng(seed)
    k, hidden, clusters, p = DESCRIPTORS[descriptor].size, 7, 3, 5
    d, context = k * (k - 1) // 2, p * (len(CONTEXT_STEPS) + 1) + 1

    def random(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    return Regression(
        settings=stage_settings(descriptor, activation=activation),
        scaler=FeatureScaler(
            pairs=all_pairs(k), mean=random(d), scale=np.full(d, 0.3, np.float32), projection=random(d, p) / d,
            context_mean=random(context), context_scale=np.ones(context, np.float32),
        ),
        centers=random(clusters, d + context),
        layers=(
            (random(clusters, d + context, hidden) / 20, random(clusters, hidden)),
            (random(clusters, hidden, 5), random(clusters, 5)),
            (random(clusters, 5, k), random(clusters, k)),
        ),
    )  # fmt: skip


def test_descriptors_equal_their_formula():
    guided = guided_descriptor(MESH)
    np.testing.assert_allclose(guided, reference_descriptor(MESH), atol=3e-6)
    plain = bilateral_descriptor(MESH)
    np.testing.assert_array_equal(plain, guided[:, : len(SIGMA_S) * len(SIGMA_R)])


def test_the_faces_of_a_filter_hold_the_gaussian():
    """On an even triangulation, where Σ A exp(-d²/2σ²) of all faces is 2πσ²."""
    ball = icosphere(4)
    sigma_s, every = 2 * ball.mean_edge_length, np.arange(len(ball.faces), dtype=np.int32)
    near = faces_near(ball, every, CUTOFF * sigma_s)
    distance = np.linalg.norm(ball.centroids[near.indices] - ball.centroids[near.rows], axis=1)
    weights = np.bincount(near.rows, ball.areas[near.indices] * np.exp(-0.5 * (distance / sigma_s) ** 2))
    assert weights.mean() / (2 * np.pi * sigma_s**2) > 0.94


def test_the_own_normal_stands_before_the_filtered_ones():
    before = MESH.moved(1.1 * MESH.vertices + 0.1 * icosphere(2).vertices)
    plain = unpacked(stage_stack(stage_settings("B"), before, MESH))
    np.testing.assert_allclose(plain, bilateral_descriptor(before), atol=3e-7)
    both = unpacked(stage_stack(stage_settings("n+B"), before, MESH))
    np.testing.assert_array_equal(both[:, 1:], plain)
    np.testing.assert_allclose(both[:, 0], before.face_normals, atol=3e-7)


def test_packed_normals_differ_by_the_rounding_of_single_precision():
    rng = np.random.default_rng(0)
    some = unit(rng.normal(size=(2000, 3)))
    axes = np.concatenate(
        [np.eye(3), -np.eye(3), unit(np.array(list(product((-1, 0, 1), (-1, 0, 1), (-1, 1))), float))]
    )
    close = unit(axes + 1e-6 * rng.normal(size=axes.shape))
    normals = np.concatenate([some, axes, close, np.zeros((1, 3))]).astype(np.float32)
    packed = no_normals(len(normals), 2)
    pack(np.stack([normals, -normals], axis=1), packed)
    np.testing.assert_allclose(unpacked(packed), np.stack([normals, -normals], axis=1), atol=3e-7, rtol=0)
    np.testing.assert_array_equal(unpacked(packed)[-1], 0)


def test_descriptors_of_a_plane_are_its_normal_and_their_angles_vanish():
    side = cube(14)
    every = np.arange(len(side.faces), dtype=np.int32)
    near = faces_near(side, every, CUTOFF * max(SIGMA_S) * side.mean_edge_length)
    inside = [f for f in every if np.ptp(side.face_normals[near.row(f)], axis=0).max() == 0]
    assert len(inside) > 10
    stack = guided_descriptor(side)[inside]
    np.testing.assert_allclose(stack, np.broadcast_to(side.face_normals[inside][:, None], stack.shape), atol=1e-6)
    np.testing.assert_allclose(pairwise_features(stack, all_pairs(18)), np.log(FLOOR), atol=2e-2)


def test_pairwise_features_do_not_see_rotation_scale_or_place():
    turned = Mesh(3 * MESH.vertices @ TURN.T + (5, -2, 9), MESH.faces)
    np.testing.assert_allclose(
        *(np.exp(pairwise_features(guided_descriptor(mesh), all_pairs(18))) for mesh in (turned, MESH)),
        atol=2e-6,
    )


def test_pairwise_features_are_in_order_of_pairs():
    angles = np.array([0.0, 0.3, 1.0])
    stack = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)[None].astype(np.float32)
    np.testing.assert_allclose(
        np.exp(pairwise_features(stack, all_pairs(3)))[0] - FLOOR, 1 - np.cos([0.3, 1.0, 0.7]), atol=1e-6
    )


def test_iterated_normals_hold_the_bilateral_filter_after_its_passes():
    stack = iterated(MESH)
    assert stack.shape == (len(MESH.faces), 1 + len(ITERATED_64) * len(ITERATED_SIGMA_R), 3)
    for p, passes in enumerate(ITERATED_64):
        got = stack[:, (p + 1) * len(ITERATED_SIGMA_R)]
        expected = bilateral_normals(MESH, sigma_s=1.0, sigma_r=np.inf, iterations=passes, center="count")
        np.testing.assert_allclose(got, expected, atol=5e-6)
    twin = MESH.face_normals
    for _ in range(4):
        twin = unit((ring_weights(MESH) * compact(twin, 0.35)) @ twin)
    at = 1 + ITERATED_64.index(4) * len(ITERATED_SIGMA_R) + ITERATED_SIGMA_R.index(0.35)
    np.testing.assert_allclose(stack[:, at], twin, atol=1e-5)


def test_filters_side_by_side_are_what_the_plain_code_says():
    rng, rings = np.random.default_rng(0), MESH.topology.face_rings(1)
    normals = unit(rng.normal(size=(len(MESH.faces), LANES, 3))).transpose(0, 2, 1).astype(np.float32)
    given = (np.ascontiguousarray(normals), MESH.areas.astype(np.float32), rings)
    weights, steepness = rng.random(len(rings.indices), np.float32), np.float32([0, 0.1, 1, 10])
    vectors, plain = np.empty((2, *normals.shape), np.float32)
    _bilateral_range(0, len(normals), *given, weights, steepness, vectors)
    getattr(_bilateral_range, "py_func", _bilateral_range)(0, len(normals), *given, weights, steepness, plain)
    np.testing.assert_allclose(vectors, plain, atol=1e-6)


def ring_weights(mesh: Mesh) -> np.ndarray:
    """Area of a face times the Gaussian of its distance, where it is the row's own or touches it, (m, m)."""
    distances = np.linalg.norm(mesh.centroids[:, None] - mesh.centroids, axis=2) / mesh.mean_edge_length
    near = np.eye(len(mesh.faces), dtype=bool)
    near[mesh.topology.face_rings(1).rows, mesh.topology.face_rings(1).indices] = True
    return near * mesh.areas * np.exp(-0.5 * distances**2)


def compact(guide: np.ndarray, sigma_r: float) -> np.ndarray:
    """The weight (1 - u/8)^8 that stands for e^-u, (m, m)."""
    u = 0.5 * ((guide[:, None] - guide) ** 2).sum(axis=2) / sigma_r**2
    return np.maximum(1 - u / 8, 0) ** 8


@pytest.mark.parametrize("sigma_r", [np.inf, 0.35])
def test_smoothed_vertices_take_the_mean_height_of_themselves_and_their_neighbours(sigma_r):
    along = iterated(MESH)[:, SMOOTHING_DIRECTION]
    found = smoothed(MESH, along, (1, 3), sigma_r)
    around = np.zeros((len(MESH.vertices), 3))
    np.add.at(around, MESH.faces.ravel(), np.repeat(MESH.areas[:, None] * along, 3, axis=0))
    directions = unit(around)
    weights = np.eye(len(directions))
    a, b = MESH.topology.edges.T
    weights[a, b] = weights[b, a] = compact(directions, sigma_r)[a, b]
    weights /= weights.sum(axis=1, keepdims=True)
    vertices = MESH.vertices
    for done in range(1, 4):
        heights = ((weights @ vertices - vertices) * directions).sum(axis=1, keepdims=True)
        vertices = vertices + heights * directions
        if done in (1, 3):
            np.testing.assert_allclose(found[:, done // 2], MESH.moved(vertices).face_normals, atol=1e-6)


def test_smoothed_vertices_know_the_shape_of_triangles_and_averaged_normals_do_not():
    """On a bent surface a face has not the normal at its middle, but that of the plane through its corners."""
    points = grid(30, 30).vertices - (15, 15, 0)
    bowl = Mesh(points + 0.02 * (points**2).sum(axis=1)[:, None] * (0, 0, 1), grid(30, 30).faces)
    averaged = iterated(bowl)[:, SMOOTHING_DIRECTION].astype(float)
    between = smoothed(bowl, averaged, (4,))[:, 0].astype(float)
    inner = np.abs(bowl.centroids[:, :2]).max(axis=1) < 5
    error = [angles_between(found[inner], bowl.face_normals[inner]).mean() for found in (between, averaged)]
    assert error[0] < 0.1 * error[1]


def test_faces_without_area_keep_their_normals_between_smoothed_vertices():
    flat = Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 1, 3]])
    found = smoothed(flat, flat.face_normals, (1, 2))
    np.testing.assert_array_equal(found, [[[0, 0, 0]] * 2, [[0, 0, 1]] * 2])


def test_context_features_are_means_around_vertices_and_over_the_connected_component():
    two = Mesh(
        np.concatenate([MESH.vertices, MESH.vertices + 5]),
        np.concatenate([MESH.faces, MESH.faces[:200] + len(MESH.vertices)]),
    )
    values = np.random.default_rng(0).normal(size=(len(two.faces), 3)).astype(np.float32)
    means = averaged_around(values, two.topology.vertex_faces)
    found = context_features(means, two, component_sums(values, two))

    # after no round the means of the faces around, then of the neighbours, brought to the faces by their corners
    topology = two.topology
    around = [values[topology.vertex_faces.row(i)] for i in range(len(two.vertices))]
    at = np.array([rows.mean(axis=0) if len(rows) else np.zeros(3) for rows in around])
    columns = []
    for rounds in np.diff(CONTEXT_STEPS, prepend=0):
        for _ in range(rounds):
            at = np.array([at[[i, *topology.vertex_neighbors.row(i)]].mean(axis=0) for i in range(len(at))])
        columns.append(at[two.faces].mean(axis=1))
    cut = len(MESH.faces)
    columns.append(np.concatenate([np.broadcast_to(v.mean(axis=0), v.shape) for v in (values[:cut], values[cut:])]))
    rows = np.arange(0, len(values), 7)
    np.testing.assert_allclose(found.of(rows)[:, :-1], np.concatenate(columns, axis=1)[rows], atol=1e-6)
    np.testing.assert_array_equal(found.of(slice(3, 90)), found.of(np.arange(3, 90)))


def test_openness_is_zero_for_a_closed_component_and_one_for_a_flat_sheet():
    closed, sheet = cube(4), Mesh([[0, 0, 3], [9, 0, 3], [9, 9, 3], [0, 9, 3]], [[0, 1, 2], [0, 2, 3]])
    roof = Mesh([[0, 0, 5], [1, 0, 5], [0, 1, 5], [0, 0, 6]], [[0, 2, 1], [0, 1, 3]])  # two unit triangles, upright
    vertices, faces = [closed.vertices], [closed.faces]
    for part in (sheet, roof):
        faces.append(part.faces + sum(len(v) for v in vertices))
        vertices.append(part.vertices)
    mesh = Mesh(np.concatenate(vertices), np.concatenate(faces))
    found = openness(component_sums(np.empty((len(mesh.faces), 0), np.float32), mesh))
    found = found[mesh.topology.face_components]
    expected = [*np.zeros(len(closed.faces)), 1, 1, np.sqrt(0.5), np.sqrt(0.5)]
    np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize("activation", ["tanh", "silu"])
def test_array_path_equals_torch(activation):
    stage = random_regression("B+G", activation=activation)
    packed = stage_stack(stage.settings, MESH, MESH)
    stack = unpacked(packed)
    x = stage.scaler.features(stack, stage.scaler.context(packed, MESH).of())
    stage = replace(stage, centers=x[[0, 9, 99]])
    distances = np.linalg.norm(x[:, None] - stage.centers, axis=2)
    expected = np.empty((len(x), 3))
    for c in range(len(stage.centers)):
        network = Network([x.shape[1], 7, 5, stack.shape[1]], activation, torch.Generator())
        with torch.no_grad():
            for layer, (weight, bias) in zip(network.layers, stage.layers, strict=True):
                layer.weight.copy_(torch.from_numpy(weight[c].T))
                layer.bias.copy_(torch.from_numpy(bias[c]))
            mine = distances.argmin(axis=1) == c
            expected[mine] = network(torch.from_numpy(x[mine]), torch.from_numpy(stack[mine])).numpy()
    assert len(np.unique(distances.argmin(axis=1))) > 1
    np.testing.assert_allclose(stage.normals(MESH, packed), expected, atol=1e-5)


@pytest.mark.parametrize("descriptor", ["B", "iterated-16+smoothed"])
def test_regression_turns_with_the_mesh(descriptor):
    stage = random_regression(descriptor)
    before = MESH.moved(0.9 * MESH.vertices + 0.1 * icosphere(2).vertices)
    turned, turned_before = (Mesh(m.vertices @ TURN.T, m.faces) for m in (MESH, before))
    expected = stage.normals(before, stage_stack(stage.settings, before, MESH)) @ TURN.T
    found = stage.normals(turned_before, stage_stack(stage.settings, turned_before, turned))
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_same_bytes_for_any_number_of_threads():
    mesh = noisy(icosphere(5), 0.2)
    cascade = Cascade((random_regression("B+G"), random_regression("iterated-16+smoothed")), {})
    with limit_threads(1):
        one = cascade.vertices(mesh)
    with limit_threads(5):
        assert cascade.vertices(mesh.moved(mesh.vertices)).tobytes() == one.tobytes()


def test_blocks_cover_all_and_do_not_depend_on_the_threads():
    count = 2 * BLOCK + 3
    ends = [683, 1367, 2051]  # a block of three rows would be so small that BLAS rounds otherwise
    wanted = [[row, ends[np.searchsorted(ends, row, "right")]] for row in range(count)]
    for threads in (1, 3):
        with limit_threads(threads):
            found = in_blocks(count, lambda start, stop: np.array([[row, stop] for row in range(start, stop)]))
            assert found.tolist() == wanted


def test_weights_file_gives_the_same_cascade_back(tmp_path):
    cascade = Cascade((random_regression("B+G"), random_regression("B")), {"seed": 3, "note": "für Täler"})
    path = tmp_path / "model.safetensors"
    path.write_bytes(cascade.to_bytes())
    again = Cascade.load(path)
    assert again.to_bytes() == cascade.to_bytes()
    assert again.card == cascade.card
    assert again.vertices(MESH).tobytes() == cascade.vertices(MESH).tobytes()


CONSTANTS = {
    "sigma_s": (1.0, 2.0),
    "sigma_r": (0.1, 0.2, 0.35, 0.5, np.inf),
    "spreads": 2.5,
    "context_steps": (0, 1, 3, 7),
    "iterated_sigma_r": (0.2, 0.35, 0.55, np.inf),
    "iterated_64_passes": (1, 4, 16, 64),
    "iterated_32_passes": (1, 4, 16, 32),
    "iterated_16_passes": (1, 4, 16),
    "smooth_passes": (1, 4, 16, 64),
    "later_smooth_passes": (1, 2, 8),
    "smooth_sigma_r": 0.35,
    "floor": 1e-4,
}
"""What the names of descriptors stand for in the first of CASCADE_FORMATS; files of the last one say so."""


def test_another_constant_needs_another_format():
    found = {
        "sigma_s": SIGMA_S, "sigma_r": SIGMA_R, "spreads": CUTOFF, "context_steps": CONTEXT_STEPS,
        "iterated_sigma_r": ITERATED_SIGMA_R, "iterated_64_passes": ITERATED_64,
        "iterated_32_passes": ITERATED_32,
        "iterated_16_passes": ITERATED_16, "smooth_passes": SMOOTH_PASSES,
        "later_smooth_passes": LATER_SMOOTH_PASSES, "smooth_sigma_r": SMOOTH_SIGMA_R, "floor": FLOOR,
    }  # fmt: skip
    assert found == CONSTANTS and CASCADE_FORMATS[0] == "cascadenorm/8"


def test_weights_with_the_header_of_an_older_version_give_the_same_vertices(tmp_path):
    first, last = random_regression("B+G"), random_regression("B")
    first = replace(first, settings=replace(first.settings, sweeps=10))
    last = replace(last, settings=replace(last.settings, weighting="cotangent"))
    cascade = Cascade((first, last), {"config": {"last_weighting": "angles"}})
    old = {"activation": "tanh", "foldovers": "ignore", "neighborhood": "distance"}
    header = {
        "format": "cascadenorm/6",
        "card": cascade.card,
        "constants": CONSTANTS,
        "stages": [
            {**old, "descriptor": "B+G", "sweeps": 10, "weighting": "heights"},
            {**old, "descriptor": "B", "sweeps": 20, "weighting": "angles"},
        ],
    }
    path = tmp_path / "old.safetensors"
    tensors = {name: array for name, array in cascade.tensors().items() if not name.endswith(".pairs")}
    save_file(tensors, path, {"cascadenorm": json.dumps(header)})
    read = Cascade.load(path)
    assert [stage.settings for stage in read.stages] == [first.settings, last.settings]
    assert read.to_bytes() == cascade.to_bytes()
    assert read.vertices(MESH).tobytes() == cascade.vertices(MESH).tobytes()


def test_weights_for_filters_over_rings_are_refused(tmp_path):
    cascade = Cascade((random_regression("B"),), {})
    old = [asdict(stage.settings) | {"neighborhood": "rings"} for stage in cascade.stages]
    header = {"format": "cascadenorm/7", "card": {}, "stages": old}
    save_file(cascade.tensors(), tmp_path / "old.safetensors", {"cascadenorm": json.dumps(header)})
    with pytest.raises(ParameterError, match="needs what this version lacks: filters over rings of faces"):
        Cascade.load(tmp_path / "old.safetensors")


def test_files_that_hold_no_cascade_are_refused(tmp_path):
    with pytest.raises(ParameterError, match="cannot be read: No such file"):
        Cascade.load(tmp_path / "missing.safetensors")
    if sys.platform != "win32":
        with pytest.raises(ParameterError, match="cannot be read: Is a directory"):
            Cascade.load(tmp_path)
    text = tmp_path / "text.safetensors"
    text.write_text("no weights")
    with pytest.raises(ParameterError, match="is not a weights file"):
        Cascade.load(text)
    other = tmp_path / "other.safetensors"
    content = json.dumps({"a": {"dtype": "BF16", "shape": [1], "data_offsets": [0, 2]}})
    other.write_bytes(len(content).to_bytes(8, "little") + content.encode() + bytes(2))  # numpy lacks this type
    with pytest.raises(ParameterError, match="is not a weights file"):
        Cascade.load(other)
    save_file({"a": np.zeros(2)}, other, {"cascadenorm": json.dumps({"format": "cascadenorm/99"})})
    with pytest.raises(ParameterError, match="format 'cascadenorm/99'"):
        Cascade.load(other)
    partial = tmp_path / "partial.safetensors"
    arrays = {f"stage0.{name}": a for name, a in random_regression("B").arrays().items() if name != "projection"}
    stage = asdict(stage_settings("B"))
    header = {"format": CASCADE_FORMATS[0], "stages": [stage], "card": {}}
    save_file(arrays, partial, {"cascadenorm": json.dumps(header)})
    with pytest.raises(ParameterError, match="lacks 'projection' of stage 1"):
        Cascade.load(partial)
    for name, value in (("descriptor", "C"), ("activation", "relu"), ("foldovers", "mend")):
        later = header | {"stages": [stage | {name: value}]}
        save_file(arrays, partial, {"cascadenorm": json.dumps(later)})
        with pytest.raises(ParameterError, match=f"needs what this version lacks: {name} is '{value}'"):
            Cascade.load(partial)
    truncated = tmp_path / "truncated.safetensors"
    truncated.write_bytes(Cascade((random_regression("B"),), {}).to_bytes()[:-5])
    with pytest.raises(ParameterError, match="is not a weights file"):
        Cascade.load(truncated)
