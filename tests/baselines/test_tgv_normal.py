"""Total generalised variation of normals is minimised as its formulas say, and leaves no stairs on round surfaces."""

import numpy as np
import pytest
from shapes import cube, icosphere, mean_angle, noisy

import cascadenorm as cn
from cascadenorm.baselines import tgv_normal
from cascadenorm.baselines.tgv_normal import corner_sums, least_variation
from cascadenorm.baselines.tv_normal import difference_operator
from cascadenorm.data_gen.meshing.surface import extent_of
from cascadenorm.data_gen.meshing.tessellation import tessellate
from cascadenorm.data_gen.shapes import fields
from cascadenorm.mesh import Mesh, unit

ROUGH = noisy(icosphere(1), 0.2)


def second_differences(mesh, values):
    sums, _ = corner_sums(mesh)
    return sums @ (difference_operator(mesh.topology.face_pairs, len(mesh.faces)) @ values)


def strip(count):
    """A strip of triangles, each of which has the one before and the one after it as its neighbors."""
    i = np.arange(count + 2)
    faces = np.stack([i[:-2], i[1:-1], i[2:]], axis=1)
    faces[::2] = faces[::2, [1, 0, 2]]
    return Mesh(np.stack([i / 2, (i % 2) * 3**0.5 / 2, 0 * i], axis=1), faces)


def dense(mesh):
    """D, l, E, l_c, A as in the formula, in mean edge lengths."""
    pairs, edge, topology = mesh.topology.face_pairs, mesh.mean_edge_length, mesh.topology
    ends = mesh.vertices[topology.edges[topology.interior_edges]]
    sums, corner_lengths = corner_sums(mesh)
    differences = difference_operator(pairs, len(mesh.faces)).toarray()
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / edge
    return differences, lengths, sums.toarray(), corner_lengths / edge, mesh.areas / edge**2


def energy(mesh, found, fidelity, second_order):
    differences, lengths, sums, corner_lengths, areas = dense(mesh)
    jumps = differences @ found.normals
    weights = np.exp(-(np.linalg.norm(jumps, axis=1) ** 4))
    first = (weights * lengths) @ np.linalg.norm(jumps - found.jumps, axis=1)
    second = corner_lengths @ np.linalg.norm(sums @ found.jumps, axis=1)
    given = ((found.normals - mesh.face_normals) ** 2).sum(axis=1)
    return first + second_order * second + fidelity * areas @ given


def test_corners_compare_a_face_with_its_neighbors_beside_them():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(len(ROUGH.faces), 3))
    across = {}
    for f, face in enumerate(ROUGH.faces):
        for a, b in zip(face, np.roll(face, -1), strict=True):
            across[b, a] = f  # the neighbor runs along it the other way
    expected = []
    for f, (a, b, c) in enumerate(ROUGH.faces):
        sides = {edge: values[across[edge]] for edge in ((a, b), (b, c), (c, a))}
        expected += [2 * values[f] - sides[a, b] - sides[c, a]]
        expected += [2 * values[f] - sides[b, c] - sides[a, b]]
        expected += [2 * values[f] - sides[c, a] - sides[b, c]]
    np.testing.assert_allclose(second_differences(ROUGH, values), expected, rtol=0, atol=1e-12)
    middle = ROUGH.vertices[ROUGH.faces].mean(axis=1, keepdims=True)
    lines = np.linalg.norm(ROUGH.vertices[ROUGH.faces] - middle, axis=2).ravel()
    np.testing.assert_allclose(corner_sums(ROUGH)[1], lines, rtol=1e-12)


def test_along_a_strip_an_even_slope_costs_nothing_and_a_bend_costs_its_second_difference():
    mesh, k = strip(12), np.arange(12.0)[:, None]
    assert len(mesh.topology.face_pairs) == 11 and (mesh.face_normals[:, 2] > 0).all()
    np.testing.assert_allclose(second_differences(mesh, 3 - 2 * k), 0, atol=1e-12)
    np.testing.assert_allclose(second_differences(mesh, k**2), -2)
    assert second_differences(mesh, k).shape == (10, 1)


def test_rounds_equal_their_formula(monkeypatch):
    monkeypatch.setattr(tgv_normal, "TOLERANCE", 1e-13)
    fidelity, second_order, given = 0.8, 0.3, ROUGH.face_normals
    found = least_variation(ROUGH, fidelity=fidelity, second_order=second_order, rounds=4)
    differences, lengths, sums, corner_lengths, areas = dense(ROUGH)
    gaps, corner_gaps = np.diag(lengths), np.diag(corner_lengths)
    normal_matrix = np.diag(2 * fidelity * areas) + differences.T @ gaps @ differences
    jump_matrix = gaps + sums.T @ corner_gaps @ sums

    def shrunk(rows, by):
        size = np.linalg.norm(rows, axis=1, keepdims=True)
        return rows * np.maximum(0, 1 - np.reshape(by, (-1, 1)) / size)

    v = p = y = np.zeros((len(lengths), 3))
    q = z = np.zeros((len(corner_lengths), 3))
    for _ in range(4):
        right = 2 * fidelity * areas[:, None] * given + differences.T @ gaps @ (v + p - y)
        n = unit(np.linalg.solve(normal_matrix, right))
        right = gaps @ (differences @ n - p + y) + sums.T @ corner_gaps @ (q - z)
        v = np.linalg.solve(jump_matrix, right)
        w = np.exp(-(np.linalg.norm(differences @ n, axis=1) ** 4))
        p, q = shrunk(differences @ n - v + y, w), shrunk(sums @ v + z, second_order)
        y, z = y + differences @ n - v - p, z + sums @ v - q
    np.testing.assert_allclose(found.normals, n, atol=1e-10)
    np.testing.assert_allclose(found.jumps, v, atol=1e-10)
    np.testing.assert_allclose(found.duals, y, atol=1e-10)
    np.testing.assert_allclose(found.corner_duals, z, atol=1e-10)


@pytest.mark.parametrize("fidelity", [0.75, 2.0])
def test_the_energy_falls_with_the_rounds(fidelity):
    rounds = [least_variation(ROUGH, fidelity=fidelity, second_order=0.4, rounds=k) for k in (5, 20, 40, 400)]
    energies = [energy(ROUGH, found, fidelity, 0.4) for found in rounds]
    assert energies[0] > energies[1] > energies[2] and abs(energies[3] / energies[2] - 1) < 0.05
    for found in rounds:
        np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1)


def test_jumps_are_best_for_the_normals():
    """Multipliers prove it: they are within bounds, aligned with what they weigh, and in balance at each edge."""
    second_order = 0.35
    found = least_variation(ROUGH, fidelity=2.0, second_order=second_order, rounds=2000)
    differences, lengths, sums, corner_lengths, _ = dense(ROUGH)
    jumps = differences @ found.normals
    rest, weights = jumps - found.jumps, np.exp(-(np.linalg.norm(jumps, axis=1) ** 4))
    assert (np.linalg.norm(found.duals, axis=1) <= weights + 1e-6).all()
    assert (np.linalg.norm(found.corner_duals, axis=1) <= second_order + 1e-9).all()
    gap = weights * np.linalg.norm(rest, axis=1) - (found.duals * rest).sum(axis=1)
    turns = sums @ found.jumps
    corner_gap = second_order * np.linalg.norm(turns, axis=1) - (found.corner_duals * turns).sum(axis=1)
    assert gap.max() < 1e-3 and corner_gap.max() < 1e-3
    balance = lengths[:, None] * found.duals - sums.T @ (corner_lengths[:, None] * found.corner_duals)
    np.testing.assert_allclose(balance, 0, atol=2e-3)


def test_without_a_second_order_nothing_changes_and_with_much_of_it_jumps_vanish():
    mesh = noisy(icosphere(1), 0.05)
    free, stiff = (least_variation(mesh, fidelity=1.0, second_order=s, rounds=300) for s in (0, 50))
    np.testing.assert_allclose(free.normals, mesh.face_normals, atol=1e-3)
    differences = difference_operator(mesh.topology.face_pairs, len(mesh.faces))
    np.testing.assert_allclose(free.jumps, differences @ free.normals, atol=1e-3)
    assert (
        np.linalg.norm(stiff.jumps, axis=1).mean() < 0.05 * np.linalg.norm(differences @ stiff.normals, axis=1).mean()
    )


def part():
    """A pipe: sharp edges between flat ends and round walls."""
    pipe = fields.difference(fields.cylinder(radius=0.5, half_height=0.6), fields.cylinder(radius=0.3, half_height=0.8))
    rng = np.random.default_rng(7)
    return tessellate(pipe, extent_of(pipe, rng=rng), faces=4000, sharp=True, rng=rng)


@pytest.mark.parametrize("shape", [lambda: cube(14), part], ids=["cube", "pipe"])
def test_it_recovers_noisy_parts_better_than_total_variation(shape):
    clean = shape()
    rough = noisy(clean, 0.2, seed=1)
    ours, first_order = (
        mean_angle(rough.moved(cn.denoise(rough, method=name).vertices), clean) for name in ("tgv-normal", "tv-normal")
    )
    assert ours < 0.9 * first_order < 0.5 * mean_angle(rough, clean)


def test_the_second_order_takes_the_stairs_off_a_sphere():
    """Stairs are flat treads between steep steps; first-order variation, the limit of much second order, makes them."""
    clean = icosphere(4)
    rough = noisy(clean, 0.1, seed=2)

    def stairs(second_order):
        mesh = rough.moved(cn.denoise(rough, method="tgv-normal", second_order=second_order).vertices)
        first, second = mesh.face_normals[mesh.topology.face_pairs.T]
        chords = np.linalg.norm(first - second, axis=1)
        return (chords > 2.5 * chords.mean()).mean(), (chords < 0.2 * chords.mean()).mean(), mean_angle(mesh, clean)

    (steps, treads, angle), (steps_of_first, treads_of_first, angle_of_first) = stairs(0.4), stairs(50.0)
    assert steps < 0.2 * steps_of_first and treads < 0.6 * treads_of_first and angle < angle_of_first
