"""Methods in patches of a mesh in memory give the result of the whole mesh."""

import numpy as np
import pytest
from partitions import walls
from patched import AGREES, BALL, EXACT, RIBBON, shuffled
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.geometry.patches.work import Patching, face_rows, working_in_patches
from cascadenorm.learned import stage_normals
from cascadenorm.mesh import Mesh


def in_a_row(*meshes: Mesh) -> Mesh:
    """Return meshes as the components of one, in a row along x."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    places = np.cumsum([0, *(np.ptp(mesh.vertices[:, 0]) + 5 for mesh in meshes)])
    vertices = [mesh.vertices - mesh.vertices.min(axis=0) + [x, 0, 0] for mesh, x in zip(meshes, places, strict=False)]
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def many() -> Mesh:
    """Components of many kinds: open, closed, inward, exact, of one face; and a vertex without a face."""
    face = Mesh([[0, 0, 9], [1, 0, 9], [0, 1, 9.5]], [[0, 1, 2]])
    inward = Mesh(BALL.vertices * 8, BALL.faces[:, ::-1])
    mesh = in_a_row(RIBBON, inward, noisy(icosphere(2), 0.2), cube(6), face)
    return Mesh(np.append(mesh.vertices * 3 + [70, 0, 0], [[900.0, 0, 0]], axis=0), mesh.faces)


def with_fin() -> Mesh:
    """Return a ribbon of which some edges have three faces."""
    middle = np.flatnonzero(grid(400, 6).vertices[:, 0] == 3)[100:200]
    tips = len(RIBBON.vertices) + np.arange(len(middle))
    fin = [np.stack([middle[:-1], middle[1:], tips[:-1]], axis=1), np.stack([middle[1:], tips[1:], tips[:-1]], axis=1)]
    vertices = np.concatenate([RIBBON.vertices, RIBBON.vertices[middle] + [0, 0, 1]])
    return Mesh(vertices, np.concatenate([RIBBON.faces, *fin]))


MESHES = {
    "open": lambda: RIBBON,
    "non-manifold": with_fin,
    "many components": many,
    "shuffled": lambda: shuffled(noisy(grid(700, 6), 0.1, seed=1)),
}


def in_patches(mesh: Mesh, faces: int, *, spare: int = 0, each=map, **settings) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices of a mesh denoised as a whole, and in patches of so many faces."""
    whole = cn.denoise(mesh, **settings).vertices
    with working_in_patches(Patching(faces, each, spare)):
        return whole, cn.denoise(mesh, **settings).vertices


@pytest.mark.parametrize(
    ("method", "name"),
    [
        *((method, "open") for method in EXACT),
        *((method, name) for method in ("taubin", "bilateral-normal", "guided-normal") for name in [*MESHES][1:]),
    ],
)
def test_filters_give_the_bits_of_the_whole(method, name):
    whole, patches = in_patches(MESHES[name](), 1000, method=method, **EXACT[method])
    assert patches.tobytes() == whole.tobytes()


@pytest.mark.parametrize("name", MESHES)
def test_auto_agrees_with_the_whole(name):
    mesh = MESHES[name]()
    spare = 500_000 if name == "open" else 0  # some of the filtered normals are kept, others filtered twice
    whole, patches = in_patches(mesh, 4000, spare=spare, method="auto")
    assert np.abs(patches - whole).max() < AGREES * mesh.mean_edge_length
    assert np.abs(whole - mesh.vertices).max() > 0.1 * mesh.mean_edge_length


def test_auto_leaves_components_without_noise_in_patches_as_well():
    clean = icosphere(4)
    mesh = in_a_row(clean, RIBBON)
    whole, patches = in_patches(mesh, 1500)
    np.testing.assert_array_equal(patches[: len(clean.vertices)], mesh.vertices[: len(clean.vertices)])
    assert np.abs(patches - whole).max() < AGREES * mesh.mean_edge_length


def test_auto_works_on_patches_that_own_no_face():
    mesh = noisy(cube(3), 0.1)
    whole, patches = in_patches(mesh, 30)  # some patches have a single vertex inside, the first corner of no face
    assert np.abs(patches - whole).max() < AGREES * mesh.mean_edge_length


def test_filtered_normals_are_kept_or_made_again(monkeypatch):
    made = []
    stage_stack = stage_normals.stage_stack
    monkeypatch.setattr(stage_normals, "stage_stack", lambda *given: made.append(1) or stage_stack(*given))
    counts = []
    for spare in (0, 500_000, 10**9):
        made.clear()
        with working_in_patches(Patching(4000, spare=spare)):
            cn.denoise(RIBBON, method="auto")
        counts.append(len(made))
    assert counts[0] == 2 * counts[2] and counts[2] < counts[1] < counts[0]


def test_cascade_agrees_with_the_whole_and_widens_halos(monkeypatch):
    monkeypatch.setattr(stage_normals, "BY_DISTANCE", 3)
    mesh = in_a_row(RIBBON, noisy(icosphere(2), 0.2))
    whole, patches = in_patches(mesh, 1500, method="cascade")
    assert np.abs(patches - whole).max() < AGREES * mesh.mean_edge_length


@pytest.mark.parametrize("guidance", ["patch", "gaussian"])
def test_guided_filter_widens_a_halo_that_is_too_narrow(guidance, monkeypatch):
    from cascadenorm.baselines import guided_normal

    monkeypatch.setattr(guided_normal, "FIRST_REACH", 0)
    given = {"guidance": guidance, "iterations": 2, "sweeps": 2, "radius": 4.0}
    whole, patches = in_patches(RIBBON, 800, method="guided-normal", **given)
    assert patches.tobytes() == whole.tobytes()


@pytest.mark.parametrize(
    "controls",
    [
        {"mask": np.linspace(0, 1, len(BALL.vertices)), "fixed": [3, 5], "volume": "keep"},
        {"creases": 40.0, "max_displacement": "0.1 edges"},
        {"strength": 2.5, "only": np.arange(900)},
        {"keep_detail": "4 edges"},
    ],
    ids=["mask", "creases", "strength", "keep_detail"],
)
def test_controls_see_the_whole_mesh(controls):
    whole, patches = in_patches(BALL, 900, method="bilateral-normal", iterations=3, **controls)
    assert patches.tobytes() == whole.tobytes()


def test_boundaries_are_smoothed_as_those_of_the_whole():
    whole, patches = in_patches(RIBBON, 800, method="mean-normal", boundary="smooth")
    assert patches.tobytes() == whole.tobytes()


def test_walls_that_regions_share_stay_shared():
    mesh = walls("half balls").mesh
    whole, patches = in_patches(mesh, 600, method="bilateral-normal", iterations=2)
    assert patches.tobytes() == whole.tobytes()


def counted(patch):
    """Number of faces that can be reached within 6 rings, three times, which needs a halo as wide."""
    rings = patch.mesh.topology.face_rings(6)
    seen = patch.own.copy()
    seen[rings.indices[patch.own[rings.rows]]] = True
    patch.check_complete(seen)
    return np.tile(rings.counts[:, None], 3)


def test_work_is_repeated_until_the_halo_is_wide_enough():
    with working_in_patches(Patching(700)):
        found = face_rows(BALL, counted, receptive_field=0)
    assert (found == BALL.topology.face_rings(6).counts[:, None]).all()
