import numpy as np
import pytest
from shapes import grid, icosphere, noisy

from cascadenorm.baselines.tgv_normal import GeneralizedVariation, edge_differences
from cascadenorm.baselines.tv_normal import TotalVariation
from cascadenorm.mesh import Mesh

ROUGH = noisy(icosphere(1), 0.15)


def unknowns(values, gradients):
    return np.concatenate([values[:, None], gradients.reshape(len(values), 2, -1)], axis=1).reshape(3 * len(values), -1)


def terms(mesh, variation, values, gradients, given):
    """Σ w l |Dn - KG|, Σ w l |TG| and ½ Σ pull |n - n*|²."""
    x, pairs = unknowns(values, gradients), mesh.topology.face_pairs
    weights = np.exp(-(np.linalg.norm(given[pairs[:, 0]] - given[pairs[:, 1]], axis=1) ** 4)) * variation.lengths
    jumps = weights @ np.linalg.norm(variation.jumps @ x, axis=1)
    bends = weights @ np.linalg.norm((variation.bends @ x).reshape(len(pairs), -1), axis=1)
    return jumps, bends, 0.5 * variation.pull @ ((values - given) ** 2).sum(axis=1)


def energy(mesh, variation, values, gradients):
    jumps, bends, fidelity = terms(mesh, variation, values, gradients, mesh.face_normals)
    return jumps + variation.curving * bends + fidelity


def jittered(rows, columns):
    sheet = grid(rows, columns)
    return sheet.moved(sheet.vertices + np.random.default_rng(0).uniform(-0.1, 0.1, sheet.vertices.shape) * (1, 1, 0))


def circumcenters(mesh):
    """Solve |x - a|² = |x - b|² = |x - c|² in the plane z = 0."""
    a, b, c = np.moveaxis(mesh.corners[:, :, :2], 1, 0)
    matrix = 2 * np.stack([b - a, c - a], axis=1)
    right = np.stack([(b**2).sum(1) - (a**2).sum(1), (c**2).sum(1) - (a**2).sum(1)], axis=1)
    return np.linalg.solve(matrix, right[:, :, None])[:, :, 0]


def axes(mesh):
    """The longest side of each face, and across it."""
    sides = np.roll(mesh.corners, -1, axis=1) - mesh.corners
    longest = np.array([side[np.argmax(np.linalg.norm(side, axis=1))] for side in sides])
    longest /= np.linalg.norm(longest, axis=1)[:, None]
    return np.stack([longest, np.cross(mesh.face_normals, longest)], axis=1)


def test_a_linear_field_on_any_flat_triangulation_costs_nothing():
    mesh = jittered(6, 7)
    jumps, bends = edge_differences(mesh)
    slope = np.array([[0.3, -0.7, 0.1], [0.2, 0.5, -0.4]])  # of three fields along x and y
    values = circumcenters(mesh) @ slope + (1.0, 2.0, 3.0)
    gradients = (axes(mesh)[:, :, :2] @ slope * mesh.mean_edge_length).reshape(-1, 3)
    x = unknowns(values, gradients)
    np.testing.assert_allclose(jumps @ x, 0, atol=1e-12)
    np.testing.assert_allclose(bends @ x, 0, atol=1e-12)
    assert np.abs(jumps @ unknowns(values, 0 * gradients)).max() > 0.5  # which total variation pays


def test_differences_know_the_surface_only_by_unfolding():
    flat = jittered(6, 6)
    x, y, _ = flat.vertices.T
    fold = np.abs(flat.vertices[:, 0] - 3) < 0.3
    x = np.where(fold, 3.0, x)
    flat = flat.moved(np.stack([x, y, 0 * x], axis=1))
    bent = flat.moved(np.stack([np.minimum(x, 3), y, np.maximum(x - 3, 0)], axis=1))
    for ours, expected in zip(edge_differences(bent), edge_differences(flat), strict=True):
        np.testing.assert_allclose(ours.toarray(), expected.toarray(), atol=1e-12)


def band(segments, *, cone):
    """A band of nearly square quads around the z axis: of a cylinder, or of a cone."""
    rows = segments // 6
    sheet = grid(rows, segments)
    angle, height = 2 * np.pi * sheet.vertices[:, 0] / segments, sheet.vertices[:, 1] / rows
    radius = 1 - 0.2 * height if cone else np.ones_like(height)
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    first = np.arange((rows + 1) * (segments + 1))
    seam = first % (segments + 1) == segments
    return Mesh(vertices, np.where(seam, first - segments, first)[sheet.faces])


@pytest.mark.parametrize("cone", [False, True], ids=["cylinder", "cone"])
def test_on_developable_surfaces_the_cost_vanishes_with_the_edge_length_against_total_variation(cone):
    angles, ratios = [], []
    for segments in (12, 24, 48):
        mesh = band(segments, cone=cone)
        variation = GeneralizedVariation(mesh, fidelity=100.0, curving=1.0)
        found = variation.least(mesh.face_normals, rounds=600)
        cost = energy(mesh, variation, found.values, found.gradients)
        total = terms(mesh, variation, mesh.face_normals, 0 * found.gradients, mesh.face_normals)[0]
        angles.append(1 / segments)
        ratios.append(cost / total)
    assert np.polyfit(np.log(angles), np.log(ratios), 1)[0] > 0.8 and ratios[-1] < 0.2


@pytest.mark.parametrize(("fidelity", "curving"), [(1.0, 0.5), (5.0, 1.0)])
def test_solution_is_optimal(fidelity, curving):
    variation = GeneralizedVariation(ROUGH, fidelity=fidelity, curving=curving)
    values, gradients, duals, bending = variation.least(ROUGH.face_normals, rounds=2000)
    pairs, given = ROUGH.topology.face_pairs, ROUGH.face_normals
    weights = np.exp(-(np.linalg.norm(given[pairs[:, 0]] - given[pairs[:, 1]], axis=1) ** 4))
    assert (np.linalg.norm(duals, axis=1) <= weights * (1 + 1e-9)).all()
    assert (np.linalg.norm(bending.reshape(len(pairs), -1), axis=1) <= curving * weights * (1 + 1e-9)).all()
    lengths = variation.lengths[:, None]
    slope = variation.jumps.T @ (lengths * duals) + variation.bends.T @ (np.repeat(lengths, 2, axis=0) * bending)
    slope[::3] += variation.pull[:, None] * (values - given)
    np.testing.assert_allclose(slope, 0, atol=2e-3)  # with the above, nearly: no other field has less energy
    least, rng = energy(ROUGH, variation, values, gradients), np.random.default_rng(0)
    for _ in range(20):
        others = values + 0.02 * rng.normal(size=values.shape), gradients + 0.02 * rng.normal(size=gradients.shape)
        assert energy(ROUGH, variation, *others) > least


def test_the_energy_falls_with_the_rounds():
    variation = GeneralizedVariation(ROUGH, fidelity=4.0, curving=1.0)
    found = [energy(ROUGH, variation, *variation.least(ROUGH.face_normals, rounds=k)[:2]) for k in (1, 5, 10, 20, 200)]
    assert (np.diff(found) < 0).all() and found[-2] < 1.05 * found[-1]


def test_a_round_equals_its_formula():
    variation, given = GeneralizedVariation(ROUGH, fidelity=4.0, curving=0.7), ROUGH.face_normals
    ours = variation.least(given, rounds=1)
    jumps, bends = (operator.toarray() for operator in (variation.jumps, variation.bends))
    mass = np.full(jumps.shape[1], 1e-6)
    mass[::3] = variation.pull
    length, twice = np.diag(variation.lengths), np.diag(np.repeat(variation.lengths, 2))
    matrix = np.diag(mass) + jumps.T @ length @ jumps + 0.7 * bends.T @ twice @ bends
    right = np.zeros((len(mass), 3))
    right[::3] = variation.pull[:, None] * given
    x = np.linalg.solve(matrix, right)
    np.testing.assert_allclose(ours.values, x[::3], atol=1e-3)
    np.testing.assert_allclose(ours.gradients, np.delete(x, np.s_[::3], axis=0), atol=3e-3)
    pairs = ROUGH.topology.face_pairs
    weights = np.exp(-(np.linalg.norm(given[pairs[:, 0]] - given[pairs[:, 1]], axis=1) ** 4))
    wanted = jumps @ x
    size = np.linalg.norm(wanted, axis=1)
    expected = wanted * np.minimum(1, weights / size)[:, None]  # what shrinking leaves over is the multiplier
    np.testing.assert_allclose(ours.duals, expected, atol=3e-3)


def test_with_stiff_gradients_it_is_total_variation():
    """On a closed surface no gradient but zero is the same everywhere."""
    values = GeneralizedVariation(ROUGH, fidelity=4.0, curving=1e4).least(ROUGH.face_normals, rounds=1500).values
    expected = TotalVariation(ROUGH, fidelity=4.0).least(ROUGH.face_normals, rounds=1500).values
    np.testing.assert_allclose(values, expected, atol=5e-3)


def test_free_gradients_or_high_fidelity_keep_the_normals():
    for fidelity, curving in ((4.0, 0.0), (1e6, 1.0)):
        variation = GeneralizedVariation(ROUGH, fidelity=fidelity, curving=curving)
        values = variation.least(ROUGH.face_normals, rounds=300).values
        np.testing.assert_allclose(values, ROUGH.face_normals, atol=1e-3)


def test_gradients_do_not_depend_on_where_faces_begin():
    rolled = Mesh(ROUGH.vertices, np.roll(ROUGH.faces, 1, axis=1))
    for ours, expected in zip(edge_differences(rolled), edge_differences(ROUGH), strict=True):
        np.testing.assert_allclose(ours.toarray(), expected.toarray(), atol=1e-12)
