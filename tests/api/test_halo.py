"""Patches with a halo: their interiors are those of the whole, to the last bit."""

import numpy as np
import pytest
import trimesh
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.mesh import Mesh
from cascadenorm.registry import registered

BALL = noisy(icosphere(4), 0.2)
SHEET = noisy(grid(40, 30), 0.15, seed=3)
SETTINGS = {
    "taubin": {"iterations": 4},
    "laplacian": {"iterations": 5, "order": 2, "step": 0.3},
    "bilateral-normal": {"iterations": 3, "sweeps": 1},
    "mean-normal": {"iterations": 1, "sweeps": 1},
    "median-normal": {"iterations": 2, "sweeps": 1},
    "unilateral-normal": {"iterations": 3, "sweeps": 1},
    "random-walk-normal": {"iterations": 2, "sweeps": 1},
}
LOCAL = sorted(SETTINGS)


def in_patches(mesh, whole, method, *, dtype=float, mask=None, **settings):
    """Denoise thirds of a mesh by themselves and put them together."""
    parameters = SETTINGS[method]
    rings = whole.receptive_field(method, **parameters)
    third = np.digitize(mesh.vertices[:, 0], np.quantile(mesh.vertices[:, 0], [1 / 3, 2 / 3]))
    out = np.full(mesh.vertices.shape, np.nan, dtype)
    sizes = []
    for number in range(3):
        patch = whole.patch(mesh.faces, third == number, rings)
        part = mesh.vertices[patch.vertices].astype(dtype)
        own = {} if mask is None else {"mask": mask[patch.vertices]}
        moved = cn.denoise(part, patch.faces, method=method, halo=patch.halo, **parameters, **own, **settings)
        assert moved[patch.halo.vertices].tobytes() == part[patch.halo.vertices].tobytes()
        out[patch.inside] = moved[~patch.halo.vertices]
        sizes.append(len(patch.vertices))
    return out, sizes


@pytest.mark.parametrize("method", LOCAL)
@pytest.mark.parametrize("name", ["ball", "sheet"])
def test_patches_make_the_whole(method, name):
    mesh = {"ball": BALL, "sheet": SHEET}[name]
    mesh = Mesh(mesh.vertices * 37 + [1e3, 0, -40], mesh.faces)
    whole = cn.Whole.of(mesh.vertices, mesh.faces)
    out, sizes = in_patches(mesh, whole, method)
    assert out.tobytes() == cn.denoise(mesh, method=method, **SETTINGS[method]).vertices.tobytes()
    assert min(sizes) < 0.9 * len(mesh.vertices)


@pytest.mark.parametrize("method", ["taubin", "bilateral-normal"])
def test_what_is_one_ring_nearer_is_not_the_whole_for_certain(method):
    """The receptive field is no more than is needed for sweeps in few groups: a narrower halo differs."""
    whole = cn.Whole.of(BALL.vertices, BALL.faces)
    parameters = SETTINGS["taubin"] if method == "taubin" else {"iterations": 3, "sweeps": 0}
    parameters = parameters if method == "taubin" else {**parameters, "sweeps": 1}
    expected = cn.denoise(BALL, method=method, **parameters).vertices
    near = 1 if method == "taubin" else whole.groups
    rings = whole.receptive_field(method, **parameters) - near
    patch = whole.patch(BALL.faces, BALL.vertices[:, 0] > 0.9, rings)
    with pytest.raises(cn.ParameterError, match="halo is too narrow: "):
        cn.denoise(BALL.vertices[patch.vertices], patch.faces, method=method, halo=patch.halo, **parameters)
    part = Mesh(BALL.vertices[patch.vertices], patch.faces)
    moved = cn.denoise(part, method=method, **parameters).vertices[~patch.halo.vertices]
    assert np.abs(moved - expected[patch.inside]).max() > 1e-9


def test_flipped_faces_and_controls_are_those_of_the_whole():
    faces = BALL.faces.copy()
    faces[::3] = faces[::3, ::-1]
    mesh = Mesh(BALL.vertices, faces)
    mask = np.linspace(0, 1, len(mesh.vertices))
    controls = {"strength": 0.7, "max_displacement": "0.1 edges", "mask": mask}
    whole = cn.Whole.of(mesh.vertices, mesh.faces)
    for method in ("taubin", "bilateral-normal"):
        expected = cn.denoise(mesh, method=method, **SETTINGS[method], **controls).vertices
        out, _ = in_patches(mesh, whole, method, **controls)
        assert out.tobytes() == expected.tobytes()
    single = mesh.vertices.astype(np.float32)
    expected = cn.denoise(single, faces, method="taubin", **SETTINGS["taubin"])
    rounded = Mesh(single, faces)
    out, _ = in_patches(rounded, cn.Whole.of(single, faces), "taubin", dtype=np.float32)
    assert out.tobytes() == expected.tobytes()


def test_the_whole_may_be_a_mesh_of_any_kind(tmp_path):
    path = tmp_path / "ball.ply"
    cn.write(BALL, path)
    expected, faces = cn.Whole.of(BALL.vertices, BALL.faces), BALL.faces
    for mesh in (BALL, (BALL.vertices, faces), trimesh.Trimesh(BALL.vertices, faces, process=False), path):
        found = cn.Whole.of(mesh)
        assert found.receptive_field("taubin") == expected.receptive_field("taubin")
        assert found.mean_edge_length == expected.mean_edge_length
        assert found.group.tobytes() == expected.group.tobytes()


def test_a_shuffled_mesh_agrees_to_rounding():
    mesh = noisy(icosphere(5), 0.2)
    rng = np.random.default_rng(0)
    numbers = rng.permutation(len(mesh.vertices))
    shuffled = Mesh(mesh.vertices[numbers], rng.permutation(np.argsort(numbers)[mesh.faces]))
    whole = cn.Whole.of(shuffled.vertices, shuffled.faces)
    for method in ("taubin", "bilateral-normal"):
        out, _ = in_patches(shuffled, whole, method)
        expected = cn.denoise(shuffled, method=method, **SETTINGS[method]).vertices
        assert np.abs(out - expected).max() < 1e-9 * mesh.mean_edge_length


def test_methods_that_see_all_of_the_mesh_are_refused():
    whole = cn.Whole.of(BALL.vertices, BALL.faces)
    for name in set(registered()) - set(LOCAL):
        with pytest.raises(cn.ParameterError, match=f"{name} depends on the whole mesh"):
            whole.receptive_field(name)
    for given in ({"scheme": "implicit"}, {"weights": "cotan"}):
        with pytest.raises(cn.ParameterError, match="laplacian depends on the whole mesh"):
            whole.receptive_field("laplacian", **given)
    with pytest.raises(cn.ParameterError, match="bilateral-normal depends on the whole mesh"):
        whole.receptive_field("bilateral-normal", fit="least-squares")
    assert whole.receptive_field("taubin", iterations=7) == 14
    assert whole.receptive_field("bilateral-normal", iterations=2, sweeps=3) == 2 + 3 * whole.groups


def test_controls_that_see_all_of_the_mesh_are_refused():
    whole = cn.Whole.of(BALL.vertices, BALL.faces)
    patch = whole.patch(BALL.faces, BALL.vertices[:, 0] > 0.5, 8)
    part = BALL.vertices[patch.vertices]
    given = {"volume": "keep", "boundary": "smooth", "creases": 40, "keep_detail": 0.1, "strength": 1.5}
    for name, value in given.items():
        with pytest.raises(cn.ParameterError, match=f"^{name} "):
            cn.denoise(part, patch.faces, method="taubin", iterations=4, halo=patch.halo, **{name: value})
    with pytest.raises(cn.ParameterError, match=r"^halo belongs to a patch of \d+ vertices"):
        cn.denoise(BALL, method="taubin", halo=patch.halo)
    with pytest.raises(cn.ParameterError, match=r"^halo is of type list"):
        cn.denoise(BALL, method="taubin", halo=[0, 1])


def test_meshes_whose_parts_see_one_another_are_refused():
    with pytest.raises(cn.MeshError, match="repeat a vertex"):
        cn.Whole.of(BALL.vertices, np.append(BALL.faces, [[0, 0, 1]], axis=0))
    box = cube(2)
    wall = np.append(box.faces, [[0, 1, 2]], axis=0)
    assert cn.Whole.of(box.vertices, wall).around.sum() == wall.size


def test_faces_that_repeat_others_are_refused():
    with pytest.raises(cn.MeshError, match="7 faces repeat earlier ones: drop them first"):
        cn.Whole.of(BALL.vertices, np.append(BALL.faces, BALL.faces[:7, ::-1], axis=0))


def test_patches_of_other_faces_and_vertices_are_refused():
    whole = cn.Whole.of(BALL)
    for faces, message in (
        (BALL.faces[:10], f"there are 10 faces; the whole mesh has {len(BALL.faces)}: pass all"),
        (BALL.faces.astype(float), r"must be \(m, 3\) integers"),
        (BALL.faces + 1, "vertices that do not exist"),
    ):
        with pytest.raises(cn.MeshError, match=message):
            whole.patch(faces, [0], 1)
    for inside in ([10**6], [-1], np.ones(3, bool), [0.5]):
        with pytest.raises(cn.ParameterError, match=r"^inside "):
            whole.patch(BALL.faces, inside, 1)
    assert len(whole.patch(BALL.faces, [], 1).vertices) == 0
