"""Meshes are cut along creases, and their sides meet again where their planes do."""

import numpy as np
import pytest
from shapes import cube, grid, icosphere, mean_angle, noisy

import cascadenorm as cn
from cascadenorm.controls.creases import crease_edges, cut_along, renumbered_creases
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh

BOX = cube(6)
EDGES = BOX.topology.edges
SHARP = crease_edges(BOX, 45)
METHODS = ["laplacian", "bilateral-normal", "auto"]


def roof(rows: int, angle: float) -> Mesh:
    """Two planes that meet along x = 0 at an angle in degrees between their normals."""
    sheet = grid(rows, 2 * rows)
    x, y = sheet.vertices[:, 0] - rows, sheet.vertices[:, 1]
    half = np.radians(angle) / 2
    return sheet.moved(np.stack([x * np.cos(half), y, -np.abs(x) * np.sin(half)], axis=1))


def test_an_angle_finds_the_sharper_edges():
    assert SHARP.sum() == 12 * 6
    ends = np.abs(BOX.vertices[EDGES[SHARP]])
    assert ((ends == 1).sum(axis=2) >= 2).all()
    assert np.array_equal(crease_edges(BOX, np.array(45)), SHARP)  # as numpy loads a single number
    assert not crease_edges(BOX, 91).any() and not crease_edges(grid(3, 3), 0).any()
    for angle in (20, 70, 130):
        mesh = roof(4, angle)
        assert crease_edges(mesh, angle - 0.1).sum() == 4 and not crease_edges(mesh, angle + 0.1).any()


def test_angles_do_not_depend_on_how_faces_run_and_faces_without_area_have_none():
    flip = np.random.default_rng(0).random(len(BOX.faces)) < 0.5
    mixed = Mesh(BOX.vertices, np.where(flip[:, None], BOX.faces[:, ::-1], BOX.faces))
    np.testing.assert_array_equal(crease_edges(mixed, 45), SHARP)
    flat = Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    assert not crease_edges(flat, 0).any()


def test_pairs_of_vertices_are_edges_in_either_order():
    rng = np.random.default_rng(1)
    pairs = rng.permuted(rng.permutation(EDGES[SHARP]), axis=1)
    np.testing.assert_array_equal(crease_edges(BOX, pairs), SHARP)
    assert not crease_edges(BOX, np.zeros((0, 2), int)).any()


def test_listed_edges_are_found_on_large_meshes():
    roof = grid(220, 220)  # the square of its number of vertices exceeds 32 bits
    heights = np.abs(roof.vertices[:, 0] - 110)
    mesh = roof.moved(roof.vertices + np.stack([0 * heights, 0 * heights, heights], axis=1))
    ridge = np.flatnonzero(heights == 0)
    pairs = np.stack([ridge[:-1], ridge[1:]], axis=1)
    by_list, by_angle = (cn.denoise(mesh, method="laplacian", creases=one, iterations=1) for one in (pairs, 80))
    assert by_list.vertices.tobytes() == by_angle.vertices.tobytes()


def test_cutting_a_box_along_its_edges_leaves_six_sheets():
    sides = cut_along(BOX, SHARP)
    assert len(np.unique(sides.mesh.topology.components)) == 6
    assert len(sides.owners) == 6 * 7 * 7
    np.testing.assert_array_equal(sides.owners[sides.mesh.faces], BOX.faces)
    np.testing.assert_array_equal(sides.owners[: len(BOX.vertices)], np.arange(len(BOX.vertices)))
    np.testing.assert_array_equal(sides.mesh.corners, BOX.corners)
    single = sides.mesh.topology.edge_faces.counts == 1
    assert single.sum() == 2 * SHARP.sum()


def test_a_crease_that_ends_leaves_its_ends_whole():
    sheet = grid(4, 4)
    slit = sheet.topology.edges[np.isin(sheet.topology.edges, [7, 12, 17]).all(axis=1)]
    assert len(slit) == 2
    sides = cut_along(sheet, crease_edges(sheet, slit))
    np.testing.assert_array_equal(sides.owners[25:], [12])
    one = cut_along(sheet, crease_edges(sheet, slit[:1]))
    assert one.mesh is sheet and len(one.owners) == 25


def test_edges_of_three_faces_can_be_cut():
    fan = Mesh([[0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 1, 0], [-1, -1, 0]], [[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    assert not crease_edges(fan, 0).any()
    sides = cut_along(fan, crease_edges(fan, [[1, 0]]))
    assert len(sides.owners) == 9 and len(np.unique(sides.mesh.topology.components)) == 3


def test_copies_that_move_alike_keep_their_move():
    sides = cut_along(BOX, SHARP)
    moves = np.random.default_rng(2).normal(size=BOX.vertices.shape)
    out = sides.joined(BOX, (BOX.vertices + moves)[sides.owners])
    np.testing.assert_allclose(out, BOX.vertices + moves, rtol=0, atol=1e-14)


@pytest.mark.parametrize("angle", [60, 90, 120])
def test_sides_meet_where_their_planes_do(angle):
    """Either plane moves along its own normal; what a copy moves within its plane says nothing about the edge."""
    mesh = roof(4, angle)
    sides = cut_along(mesh, crease_edges(mesh, angle - 1))
    half = np.radians(angle) / 2
    left = sides.mesh.centroids[:, 0] < 0
    on_left = np.zeros(len(sides.owners), bool)
    on_left[sides.mesh.faces[left]] = True
    normals = np.where(on_left[:, None], [-np.sin(half), 0, np.cos(half)], [np.sin(half), 0, np.cos(half)])
    offsets = np.where(on_left, 0.1, 0.05)[:, None]
    out = sides.joined(mesh, sides.mesh.vertices + offsets * normals)
    ridge = np.flatnonzero(mesh.vertices[:, 0] == 0)
    for offset, sign in ((0.1, -1), (0.05, 1)):
        reached = out[ridge] @ [sign * np.sin(half), 0, np.cos(half)]
        np.testing.assert_allclose(reached, offset, atol=0.003)


@pytest.mark.parametrize("wrong", [True, False])
def test_a_truth_is_no_angle(wrong):
    with pytest.raises(cn.ParameterError, match="it must be an angle in degrees"):
        cn.denoise(cube(4), method="laplacian", creases=wrong)


def test_no_creases_are_none():
    expected = cn.denoise(cube(4), method="laplacian").vertices
    for none in ([], (), np.zeros((0, 2), int)):
        np.testing.assert_array_equal(cn.denoise(cube(4), method="laplacian", creases=none).vertices, expected)


@pytest.mark.parametrize("method", METHODS)
def test_off_the_creases_the_method_gives_what_it_gives_for_the_sides_alone(method):
    rough = noisy(BOX, 0.1, seed=3)
    sides = cut_along(rough, SHARP)
    whole = np.bincount(sides.owners) == 1
    out = cn.denoise(rough, method=method, creases=EDGES[SHARP]).vertices
    treatment = {"treat_as": "unknown"} if method == "auto" else {}  # as a cut mesh
    alone = cn.denoise(sides.mesh, method=method, **treatment).vertices[: len(whole)]
    np.testing.assert_allclose(out[whole], alone[whole], rtol=0, atol=1e-9)
    assert np.abs(out - cn.denoise(rough, method=method).vertices)[whole].max() > 1e-3


def test_a_region_goes_with_the_copies():
    rough, inside = noisy(BOX, 0.1, seed=3), BOX.vertices[:, 0] > 0.5
    out = cn.denoise(rough, method="laplacian", iterations=50, mask=inside, creases=45).vertices
    sides = cut_along(rough, crease_edges(rough, 45))
    moved = cn.methods()["laplacian"].function(sides.mesh, iterations=50, region=inside[sides.owners])
    whole = np.bincount(sides.owners) == 1
    np.testing.assert_allclose(out[whole], moved[: len(whole)][whole], rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", ["laplacian", "taubin", "bilateral-normal"])
def test_sharp_edges_that_are_given_survive(method):
    rough = noisy(BOX, 0.1, seed=5)
    on = np.unique(EDGES[SHARP])

    def off_the_edges(mesh: Mesh) -> float:
        return float(np.sqrt(((np.sort(np.abs(mesh.vertices[on]), axis=1)[:, 1:] - 1) ** 2).sum(axis=1).mean()))

    plain, creased = (cn.denoise(rough, method=method, creases=c) for c in (None, EDGES[SHARP]))
    assert off_the_edges(creased) < min(off_the_edges(plain), 0.8 * off_the_edges(rough))


@pytest.mark.parametrize("method", METHODS)
def test_the_order_of_the_faces_does_not_matter(method):
    rough = noisy(icosphere(3), 0.15, seed=1)
    order = np.random.default_rng(2).permutation(len(rough.faces))
    edges = rough.topology.edges[::4]
    out = cn.denoise(rough.vertices, rough.faces, method=method, creases=edges)
    other = cn.denoise(rough.vertices, np.roll(rough.faces[order], 1, axis=1), method=method, creases=edges)
    np.testing.assert_allclose(other, out, rtol=0, atol=1e-5 * rough.mean_edge_length)


def test_no_creases_change_nothing():
    ball = noisy(icosphere(2), 0.1)
    for none in (180, np.zeros((0, 2), int)):
        out = cn.denoise(ball, method="laplacian", creases=none).vertices
        assert out.tobytes() == cn.denoise(ball, method="laplacian").vertices.tobytes()


@pytest.mark.parametrize(
    ("creases", "message"),
    [
        (200, r"creases is 200; an angle in degrees must be within 0 … 180"),
        (float("nan"), "creases is nan"),
        ([0, 1], r"creases has shape \(2,\)"),
        ([[0.5, 1]], "creases has shape"),
        ([[0, 1], [0, 100], [3, 3], [-1, 4]], r"of 4 pairs that are not edges of the mesh \(rows"),
    ],
)
def test_wrong_creases_are_refused_with_a_reason(creases, message):
    with pytest.raises(cn.ParameterError, match=message):
        cn.denoise(BOX, method="laplacian", creases=creases)


def test_creases_do_not_harm_auto_on_a_cube():
    box = cube(30)
    normals = box.face_normals[box.topology.edge_faces.indices.reshape(-1, 2)]
    edges = box.topology.edges[np.einsum("ij,ij->i", normals[:, 0], normals[:, 1]) < 0.5]
    rough = noisy(box, 0.1)
    angles = [mean_angle(cn.denoise(rough, creases=given), box) for given in (None, edges)]
    assert angles[1] < 1.3 * angles[0] < 0.5


@pytest.mark.parametrize("kind", [np.int32, np.uint64])
def test_vertices_of_creases_are_integers_of_any_type(kind):
    ball = noisy(icosphere(2), 0.2)
    edges = ball.topology.edges[:20]
    results = [cn.denoise(ball, method="laplacian", creases=edges.astype(one)).vertices for one in (np.int64, kind)]
    np.testing.assert_array_equal(*results)


def test_creases_are_renumbered_without_those_of_vertices_that_are_left_out():
    pairs, numbers = np.array([[0, 1], [1, 2], [2, 3], [9, 1]]), np.array([5, 0, -1, 1])
    assert renumbered_creases(pairs, numbers).tolist() == [[5, 0], [9, 0]]
    assert renumbered_creases(30.0, numbers) == 30.0


@pytest.mark.parametrize("creases", [180, [], np.zeros((0, 2), int)])
def test_creases_without_an_edge_change_nothing(creases):
    ball = noisy(icosphere(3), 0.2)
    np.testing.assert_array_equal(cn.denoise(ball, creases=creases).vertices, cn.denoise(ball).vertices)


@pytest.mark.parametrize(
    ("settings", "treatment"),
    [
        ({}, "vertex-noise"),
        ({"creases": 180}, "vertex-noise"),
        ({"creases": 40}, "unknown"),
        ({"creases": 40, "parameters": {"treat_as": "measured-surface"}}, "measured-surface"),
        ({"remove_detail": "0.1 edges"}, "vertex-noise"),
        ({"remove_detail": "4 edges"}, "unknown"),
    ],
)
def test_a_cut_mesh_and_coarse_copies_are_said_to_be_treated_as_unknown(tmp_path, settings, treatment):
    save_mesh(tmp_path / "ball.ply", noisy(icosphere(3), 0.2))
    done = cn.denoise_file(tmp_path / "ball.ply", tmp_path / "out.ply", **settings)
    assert done.treated_as is not None
    assert (done.treated_as.treatment, done.treated_as.given) == (treatment, treatment != "vertex-noise")
