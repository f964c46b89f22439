"""The order in which a mesh is worked on: kind to memory, and nothing that the caller has to know."""

import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.api.apply import run_with_controls
from cascadenorm.controls.creases import crease_edges
from cascadenorm.mesh import Mesh, ordered_for_cache, ordering
from cascadenorm.registry import Method
from cascadenorm.registry.controls import checked_controls

BALL = noisy(icosphere(2), 0.15, seed=3)
BOX = noisy(Mesh(cube(5).vertices, cube(5).faces[50:]), 0.1, seed=2)  # without its lid
LARGE = noisy(grid(110, 110), 0.1)
IN_PLACE = ["bilateral", "l0", "laplacian", "mean-curvature-flow", "taubin"]  # without sweeps over the vertices


class Shuffled:
    """A mesh with its vertices and faces in a random order, and corners that begin anywhere."""

    def __init__(self, mesh: Mesh, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.numbers = rng.permutation(len(mesh.vertices))  # of the vertices, as the mesh has them
        self.places = np.argsort(self.numbers)
        self.rows = rng.permutation(len(mesh.faces))
        faces = self.places[mesh.faces[self.rows]]
        turns = (rng.integers(0, 3, len(faces))[:, None] + np.arange(3)) % 3
        self.mesh = Mesh(mesh.vertices[self.numbers], np.take_along_axis(faces, turns, axis=1))


@pytest.fixture
def always(monkeypatch):
    """Renumber small meshes as well, whatever their order."""
    monkeypatch.setattr(ordering, "POOR", 0.0)


@pytest.mark.parametrize("mesh", [BALL, LARGE, Mesh(LARGE.vertices[::-1], len(LARGE.vertices) - 1 - LARGE.faces)])
def test_a_good_order_stays(mesh):
    order = ordered_for_cache(mesh)
    assert order.mesh is mesh
    np.testing.assert_array_equal(order.numbers, np.arange(len(mesh.vertices)))
    np.testing.assert_array_equal(order.places, np.arange(len(mesh.vertices)))


def test_shuffling_either_vertices_or_faces_is_a_poor_order():
    both = Shuffled(LARGE, 0)
    for mesh in (both.mesh, Mesh(LARGE.vertices, LARGE.faces[both.rows])):
        assert ordering.cache_misses(mesh) > ordering.POOR
        assert ordering.cache_misses(ordered_for_cache(mesh).mesh) < 1.3


def test_a_renumbered_mesh_is_the_same_surface():
    given = Shuffled(LARGE, 1).mesh
    order = ordered_for_cache(given)
    np.testing.assert_array_equal(order.mesh.vertices, given.vertices[order.numbers])
    np.testing.assert_array_equal(order.numbers[order.places], np.arange(len(given.vertices)))

    def rotated(faces):
        first = (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3
        return sorted(np.take_along_axis(faces, first, axis=1).tolist())

    assert rotated(order.numbers[order.mesh.faces]) == rotated(given.faces)


def test_poor_orders_of_one_mesh_become_the_same():
    one, two = (ordered_for_cache(Shuffled(LARGE, seed).mesh).mesh for seed in (1, 2))
    assert one.vertices.tobytes() == two.vertices.tobytes()
    assert one.faces.tobytes() == two.faces.tobytes()


def test_vertices_far_out_do_not_hide_the_rest():
    vertices = Shuffled(LARGE, 1).mesh.vertices.copy()
    vertices[:3] *= 1e9
    assert ordering.cache_misses(ordered_for_cache(Mesh(vertices, Shuffled(LARGE, 1).mesh.faces)).mesh) < 1.3


def test_misses_are_those_of_a_direct_mapped_cache():
    mesh = Shuffled(LARGE, 5).mesh
    held, misses = {}, 0
    for vertex in mesh.faces.ravel().tolist():
        line = vertex // ordering.CACHE_LINE
        misses += held.get(line % ordering.LINES) != line
        held[line % ordering.LINES] = line
    assert ordering.cache_misses(mesh) == misses * ordering.CACHE_LINE / len(mesh.vertices)


def test_the_bits_of_the_coordinates_take_turns():
    cells = np.random.default_rng(0).integers(0, 2**ordering.BITS, (50, 3))
    cells[0], cells[1] = 0, 2**ordering.BITS - 1
    points = np.concatenate([(cells + 0.5) / (2**ordering.BITS - 1), np.zeros((1000, 3)), np.ones((1000, 3))])
    expected = [
        sum(((c >> bit) & 1) << (3 * bit + axis) for axis, c in enumerate(cell) for bit in range(ordering.BITS))
        for cell in cells.tolist()
    ]
    assert ordering.morton_codes(points)[:50].tolist() == expected


def test_points_in_one_place_have_one_code():
    assert len(np.unique(ordering.morton_codes(np.ones((5, 3))))) == 1


@pytest.mark.parametrize("name", sorted(cn.methods()))
def test_renumbering_keeps_what_belongs_to_vertices_faces_and_edges(name, always):
    """The same bytes come out for two orders, under all controls with a value for each vertex, face or edge."""
    edges = BOX.topology.edges[crease_edges(BOX, 45)]
    inside, weights = BOX.centroids[:, 1] > -0.9, np.clip(BOX.vertices[:, 0] + 0.5, 0, 1)
    found = []
    for seed in (1, 2):
        order = Shuffled(BOX, seed)
        out = cn.denoise(
            order.mesh,
            method=name,
            mask=weights[order.numbers],
            fixed=order.places[[3, 50]],
            only=inside[order.rows],
            creases=order.places[edges],
            boundary="smooth",
            keep_detail="5 edges",
            volume="keep",
        ).vertices[order.places]
        found.append(out)
        still = weights == 0
        still[[3, 50]] = True
        still[BOX.faces[~inside]] = True
        np.testing.assert_array_equal(out[still], BOX.vertices[still])
    assert (found[0] != BOX.vertices).any()
    assert found[0].tobytes() == found[1].tobytes()


@pytest.mark.parametrize("name", IN_PLACE)
def test_renumbering_changes_nothing_but_rounding_where_no_vertex_waits_for_another(name, monkeypatch):
    given = cn.denoise(BALL, method=name).vertices
    monkeypatch.setattr(ordering, "POOR", 0.0)
    np.testing.assert_allclose(cn.denoise(BALL, method=name).vertices, given, rtol=0, atol=1e-8 * BALL.mean_edge_length)


def test_a_large_mesh_that_was_shuffled_comes_back_in_its_order():
    first, second = (Shuffled(LARGE, seed) for seed in (1, 2))
    one, two = (
        cn.denoise(order.mesh, method="bilateral-normal", iterations=2).vertices[order.places]
        for order in (first, second)
    )
    assert one.tobytes() == two.tobytes()
    assert 0 < np.linalg.norm(one - LARGE.vertices, axis=1).max() < 1


def test_regions_that_share_a_wall_may_come_in_any_order(always):
    box = cube(3)
    regions = [(box.vertices, box.faces), (box.vertices + np.array([2.0, 0, 0]), box.faces)]
    one, two = (cn.denoise_regions(given, method="taubin") for given in (regions, regions[::-1]))
    for moved, same, (vertices, _) in zip(one, two[::-1], regions, strict=True):
        np.testing.assert_allclose(moved, same, rtol=0, atol=1e-12)
        assert np.abs(moved - vertices).max() > 0.01


def test_messages_name_vertices_as_they_were_given(always):
    order = Shuffled(BALL, 4)

    def broken(mesh: Mesh, **_) -> np.ndarray:
        out = mesh.vertices.copy()
        out[np.abs(out - corner).sum(axis=1).argmin()] = np.nan
        return out

    low, high = BALL.vertices.min(axis=0), BALL.vertices.max(axis=0)
    corner = np.ldexp(order.mesh.vertices[17] - 0.5 * (low + high), -1)
    with pytest.raises(cn.DenoiseError, match=r"\(vertices 17\)"):
        run_with_controls(Method("broken", broken, "", {}), order.mesh, {}, checked_controls({}))
    with pytest.raises(cn.ParameterError, match=r"the first is 5-5\)"):
        cn.denoise(order.mesh, method="taubin", creases=[[5, 5]])
    with pytest.raises(cn.ParameterError, match=r"1 of 2 pairs that are not edges .* the first is -1-4\)"):
        cn.denoise(order.mesh, method="taubin", creases=[order.mesh.faces[0, :2], [-1, 4]])
