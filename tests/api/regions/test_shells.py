"""Shells of regions, told from walls alone, compared with the labels that the walls were made of."""

import numpy as np
import pytest
from partitions import PARTITIONS, walls
from shapes import cube, icosphere, noisy

from cascadenorm.api.regions.shells import _canonical, shells
from cascadenorm.geometry.orientation import oriented
from cascadenorm.mesh import Mesh


def labels_of_sides(found, mesh):
    """(m, 2) labels behind and ahead of the faces of a mesh that may be oriented otherwise than its labels say."""
    turned = (mesh.faces != found.mesh.faces).any(axis=1)
    return np.where(turned[:, None], found.labels[:, ::-1], found.labels)


@pytest.mark.parametrize("level", [0.0, 0.2])
@pytest.mark.parametrize("name", PARTITIONS)
def test_shells_are_the_regions(name, level):
    found = walls(name)
    mesh = oriented(noisy(found.mesh, level))
    parts = shells(mesh)
    labels = labels_of_sides(found, mesh)[parts.faces]
    of_shell = np.where(parts.flipped, labels[:, 1], labels[:, 0])  # a shell is oriented outward: its region is behind
    component = parts.mesh.topology.face_components
    assert sorted(of_shell[np.unique(component, return_index=True)[1]]) == list(range(found.labels.max() + 1))
    for number in np.unique(component):
        assert len(np.unique(of_shell[component == number])) == 1
    assert (parts.mesh.topology.edge_faces.counts % 2 == 0).all()
    assert not parts.mesh.topology.balance.any()


def test_copies_lie_on_their_owners():
    mesh = oriented(walls("four cells").mesh)
    parts = shells(mesh)
    np.testing.assert_array_equal(parts.mesh.vertices, mesh.vertices[parts.owners])
    corners = np.where(parts.flipped[:, None], parts.mesh.faces[:, ::-1], parts.mesh.faces)
    np.testing.assert_array_equal(parts.owners[corners], mesh.faces[parts.faces])


@pytest.mark.parametrize("flipped", [0.3, 1.0])
@pytest.mark.parametrize("name", PARTITIONS)
def test_orientation_and_order_of_faces_do_not_matter(name, flipped):
    mesh = walls(name, voxel=0.2).mesh
    rng = np.random.default_rng(1)
    order = rng.permutation(len(mesh.faces))
    turned = np.where(rng.random((len(order), 1)) < flipped, mesh.faces[:, ::-1], mesh.faces)
    one, other = (shells(oriented(m)) for m in (mesh, Mesh(mesh.vertices, turned[order])))
    np.testing.assert_array_equal(one.owners, other.owners)
    np.testing.assert_array_equal(*(sorted_faces(parts.mesh) for parts in (one, other)))


def sorted_faces(mesh: Mesh) -> np.ndarray:
    """Return the faces in lexicographic order, each from its lowest vertex on."""
    turns = mesh.faces.argmin(axis=1)[:, None] + np.arange(3)
    return np.unique(np.take_along_axis(mesh.faces, turns % 3, axis=1), axis=0)


def test_a_wall_that_is_there_twice_counts_once():
    found = walls("half balls")
    both = Mesh(found.mesh.vertices, np.concatenate([found.region(1).faces, found.region(2).faces]))
    once = shells(oriented(found.mesh))
    twice = shells(oriented(both))
    assert len(once.faces) == len(twice.faces)


def test_surfaces_without_shared_walls_have_none():
    assert shells(icosphere(1)) is None
    first = cube(2)
    touching = Mesh(
        np.concatenate([first.vertices, np.add(first.vertices, (2, 2, 0))]), [*first.faces, *(first.faces + 26)]
    )
    vertices, which = np.unique(touching.vertices, axis=0, return_inverse=True)
    assert shells(Mesh(vertices, which.reshape(-1)[touching.faces])) is None  # they share an edge, not a wall


def test_a_fin_separates_nothing():
    mesh = cube(2)
    edge = mesh.topology.edges[0]
    vertices = np.concatenate([mesh.vertices, [3 * mesh.vertices[edge].mean(axis=0)]])
    assert shells(Mesh(vertices, [*mesh.faces, (*edge, len(vertices) - 1)])) is None


def test_components_without_junctions_stay_as_they_are():
    found = walls("half balls")
    sphere = icosphere(2)
    count = len(found.mesh.vertices)
    mesh = Mesh([*found.mesh.vertices, *(sphere.vertices + 5)], [*found.mesh.faces, *(sphere.faces + count)])
    parts = shells(oriented(mesh))
    assert (np.bincount(parts.faces)[len(found.mesh.faces) :] == 1).all()
    assert (np.bincount(parts.owners)[count:] == 1).all()


def test_patterns_are_the_same_from_every_face_and_either_end_of_the_edge():
    """The truth is the least of all rotations; a pattern of 20,000 faces at one edge takes no square of that."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        pattern = tuple(rng.integers(4, size=rng.integers(1, 9)).tolist())
        against = tuple(token ^ 1 for token in reversed(pattern))
        forms = [form[k:] + form[:k] for form in (pattern, against) for k in range(len(form))]
        assert {_canonical(form) for form in forms} == {min(forms)}
    long = tuple(rng.permutation(20_000).tolist())
    assert _canonical(long)[0] == 0 and sorted(_canonical(long)) == list(range(20_000))
    assert _canonical((2,) * 20_000) == (2,) * 20_000
