import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.api.apply import run_with_controls, step_key
from cascadenorm.errors import ParameterError
from cascadenorm.geometry.volume import closed_parts, is_closed, with_volume_of
from cascadenorm.io.interop import adapter, save_mesh
from cascadenorm.mesh import Mesh
from cascadenorm.registry import FAMILIES, Method
from cascadenorm.registry import method as register
from cascadenorm.registry.controls import checked_controls

BALL = noisy(icosphere(2), 0.2)
METHOD = {"method": "bilateral-normal"}


def shifted(mesh: Mesh) -> np.ndarray:
    """Stand-in for a method: every vertex goes one unit of the frame along x."""
    return mesh.vertices + np.array([1.0, 0.0, 0.0])


def apply(function, mesh=BALL, **controls):
    return run_with_controls(Method("stand-in", function, "", {}), mesh, {}, checked_controls(controls)).vertices


@given(st.floats(0, 4), st.floats(0, 1))
@settings(max_examples=30)
def test_strength_times_weight_counts_applications(strength, weight):
    out = apply(shifted, strength=strength, mask=np.full(len(BALL.vertices), weight))
    once = apply(shifted)[:, 0] - BALL.vertices[:, 0]
    np.testing.assert_allclose(out[:, 0] - BALL.vertices[:, 0], strength * weight * once, atol=1e-12)
    np.testing.assert_array_equal(out[:, 1:], BALL.vertices[:, 1:])


def test_no_method_is_applied_again_to_a_mesh_that_it_has_moved_to_one_place():
    def collapsed(mesh):
        assert mesh.mean_edge_length > 0
        return np.zeros_like(mesh.vertices)

    np.testing.assert_array_equal(apply(collapsed, strength=3), apply(collapsed))


@pytest.mark.parametrize("converges", [False, True])
def test_another_strength_of_the_same_key_blends_what_is_known_and_gives_the_same_bytes(converges):
    calls = []

    def halved(mesh):
        calls.append(mesh)
        return 0.5 * mesh.vertices

    method = Method("stand-in", halved, "", {}, converges)
    steps = {}
    for strength in (1.0, 0.3, 0.8, 2.5, 2.0, 1.5):
        controls = checked_controls({"strength": strength})
        known = steps.setdefault(step_key(method, strength), [])
        made = len(calls) + max(0, int(np.ceil(min(strength, 1.0) if converges else strength)) - len(known))
        out = run_with_controls(method, BALL, {}, controls, steps=known).vertices
        assert len(calls) == made
        assert out.tobytes() == run_with_controls(method, BALL, {}, controls).vertices.tobytes()
        del calls[made:]
    assert len(steps) == (4 if converges else 1)


def test_progress_goes_from_nothing_to_all_and_can_end_the_work():
    shares = []
    apply(shifted, strength=3, progress=shares.append)
    assert shares == [0, 1 / 3, 2 / 3, 1]

    def stop(share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        apply(shifted, progress=stop)


def test_limit_counts_mean_edge_lengths_where_it_says_so():
    limit = 0.25 * BALL.mean_edge_length
    by_edges = apply(shifted, max_displacement="0.25 edges")
    np.testing.assert_array_equal(by_edges, apply(shifted, max_displacement=limit))
    np.testing.assert_allclose(by_edges[:, 0] - BALL.vertices[:, 0], limit, rtol=1e-12)


def test_limit_holds_where_rounding_is_coarser_than_the_limit():
    far = (BALL.vertices * 4 + 3e6).astype(np.float32)
    out = cn.denoise(far, BALL.faces, max_displacement=0.1, **METHOD)
    assert np.linalg.norm(out.astype(float) - far.astype(float), axis=1).max() <= 0.1


def test_vertices_that_are_not_finite_are_an_error_and_not_a_result():
    with pytest.raises(cn.DenoiseError, match=r"1 vertices that are not finite \(vertices 3\)"):
        apply(lambda mesh: np.where(np.arange(len(mesh.vertices))[:, None] == 3, np.nan, mesh.vertices))


def test_enormous_and_tiny_coordinates_are_framed():
    for exponent in (1020, -1040):
        out = cn.denoise(BALL.moved(np.ldexp(BALL.vertices, exponent)), **METHOD).vertices
        assert np.isfinite(out).all()
        np.testing.assert_allclose(np.ldexp(out, -exponent), cn.denoise(BALL, **METHOD).vertices, rtol=0, atol=1e-6)


def test_a_mesh_of_one_point_stays():
    point = Mesh(np.ones((3, 3)), [[0, 1, 2]])
    assert cn.denoise(point, **METHOD).vertices.tobytes() == point.vertices.tobytes()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"strength": -1}, "strength is -1; it must be at least 0, finite"),
        ({"strength": float("nan")}, "strength is nan"),
        ({"mask": [True]}, r"mask has shape \(1,\)"),
        ({"mask": np.full(162, 1.5)}, r"mask has 162 weights that are not within 0 … 1 \(vertices 0, 1, 2, …\)"),
        ({"mask": np.full(162, np.nan)}, r"mask has 162 weights that are not within 0 … 1"),
        ({"fixed": [3, 500]}, "fixed references vertex 500; there are 162 vertices"),
        ({"fixed": [0.5]}, "fixed has shape"),
        ({"max_displacement": -0.1}, "max_displacement is -0.1"),
        ({"max_displacement": "1 mile"}, "max_displacement is '1 mile'"),
        ({"volume": "double"}, "volume is 'double'; it must be one of keep, none"),
        ({"threads": 0}, "threads is 0"),
        ({"threads": "two"}, "threads is 'two'; it must be a whole number"),
        ({"fixed": {1, 2}}, "fixed is a set; it must be a list or an array"),
        *(
            ({name: [[0, 1], [2]]}, f"{name} is a list whose rows have different lengths")
            for name in ("mask", "fixed", "only", "creases")
        ),
        ({"progress": 3}, "progress is 3; it must be a function"),
        ({"method": "magic"}, "there is no method 'magic'; there are: "),
        ({"method": ["auto"]}, r"there is no method \['auto'\]; did you mean 'auto'"),
        ({"method": "Bilatral-normal"}, "no method 'Bilatral-normal'; did you mean 'bilateral-normal'"),
        ({"iterations": -1}, "iterations is -1; it must be at least 0"),
        ({"wings": 2}, "bilateral-normal has no parameter 'wings'; it has: "),
    ],
)
def test_wrong_settings_are_refused_with_a_reason(wrong, message):
    with pytest.raises(ParameterError, match=message):
        cn.denoise(BALL, **{**METHOD, **wrong})


def test_a_region_is_given_by_the_mask():
    with pytest.raises(ParameterError, match="pass mask"):
        cn.denoise(BALL, method="laplacian", region=None)
    half = BALL.vertices[:, 2] > 0
    out = cn.denoise(BALL, method="laplacian", iterations=50, mask=half).vertices
    held = cn.methods()["laplacian"].function(BALL, iterations=50, region=half)
    np.testing.assert_allclose(out, held, atol=1e-9)


# volume


def test_volume_of_closed_parts_is_kept_each_by_itself():
    parts = [noisy(icosphere(3), 0.1), noisy(cube(6), 0.1)]
    vertices = np.concatenate([parts[0].vertices, parts[1].vertices * 0.3 + 5])
    mesh = Mesh(vertices, np.concatenate([parts[0].faces, parts[1].faces + len(parts[0].vertices)]))
    out = cn.denoise(mesh, method="laplacian", volume="keep").vertices
    cut = len(parts[0].vertices)
    for part, before, after in ((parts[0], vertices[:cut], out[:cut]), (parts[1], vertices[cut:], out[cut:])):
        assert part.moved(after).volume == pytest.approx(part.moved(before).volume, rel=1e-10)
    plain = cn.denoise(mesh, method="laplacian").vertices
    assert parts[0].moved(plain[:cut]).volume < 0.99 * parts[0].volume


def test_keeping_the_volume_is_a_scaling_about_the_centroid():
    plain = cn.denoise(BALL, method="laplacian").vertices
    kept = cn.denoise(BALL, method="laplacian", volume="keep").vertices
    factor = (BALL.volume / BALL.moved(plain).volume) ** (1 / 3)
    center = plain.mean(axis=0)
    np.testing.assert_allclose(kept, center + factor * (plain - center), atol=1e-12)


def test_volume_is_kept_by_the_vertices_that_may_move():
    mask = BALL.vertices[:, 0] > -0.5
    out = cn.denoise(BALL, method="laplacian", volume="keep", mask=mask, fixed=[7]).vertices
    assert BALL.moved(out).volume == pytest.approx(BALL.volume, rel=1e-10)
    assert out[~mask].tobytes() == BALL.vertices[~mask].tobytes()
    assert (out[7] == BALL.vertices[7]).all()


def test_limit_comes_after_the_volume():
    out = cn.denoise(BALL, method="laplacian", volume="keep", max_displacement=1e-3).vertices
    assert np.linalg.norm(out - BALL.vertices, axis=1).max() <= 1e-3


def test_open_flipped_and_flat_parts_are_not_scaled():
    sheet = noisy(grid(4, 4), 0.1)
    flipped = BALL.faces.copy()
    flipped[3] = flipped[3, ::-1]
    for mesh in (sheet, Mesh(BALL.vertices, flipped)):
        assert not is_closed(mesh)
        assert closed_parts(mesh).total == 0
        kept = with_volume_of(mesh, mesh.vertices * 0.9, weights=np.ones(len(mesh.vertices)))
        np.testing.assert_array_equal(kept, mesh.vertices * 0.9)
    flat = icosphere(1).moved(icosphere(1).vertices * (1, 1, 0))
    assert is_closed(flat)
    np.testing.assert_array_equal(with_volume_of(flat, flat.vertices * 2, weights=np.ones(42)), flat.vertices * 2)


def test_volume_is_kept_where_faces_are_flipped_and_where_all_are():
    kept = cn.denoise(BALL, method="laplacian", volume="keep").vertices
    for which in ([3, 50], slice(None)):
        faces = BALL.faces.copy()
        faces[which] = faces[which, ::-1]
        out = cn.denoise(BALL.vertices, faces, method="laplacian", volume="keep")
        assert out.tobytes() == kept.tobytes()


# kinds of meshes


def test_arrays_come_back_as_a_copy_in_their_type():
    for vertices in (BALL.vertices, BALL.vertices.astype(np.float32), BALL.vertices.astype(">f8")):
        out = cn.denoise(vertices, BALL.faces, strength=0, **METHOD)
        assert out.dtype == vertices.dtype
        assert not np.shares_memory(out, vertices)
        np.testing.assert_array_equal(out, vertices)
    whole = np.round(BALL.vertices * 100).astype(int)
    out = cn.denoise(whole.tolist(), BALL.faces.tolist(), **METHOD)
    assert out.dtype == np.float64 and (out != whole).any()


def test_single_precision_is_worked_on_in_double():
    vertices = BALL.vertices.astype(np.float32)
    out = cn.denoise(vertices, BALL.faces, **METHOD)
    np.testing.assert_array_equal(out, cn.denoise(vertices.astype(float), BALL.faces, **METHOD).astype(np.float32))


def test_a_primitive_of_trimesh_comes_back_as_a_mesh_with_its_attributes():
    ball = trimesh.primitives.Sphere(subdivisions=2)
    ball.visual.face_colors, ball.metadata["unit"] = np.arange(320)[:, None] % 256 * np.ones(4, np.uint8), "mm"
    ball.vertex_attributes["heat"], ball.face_attributes["part"] = np.arange(162.0), np.arange(320)
    out = cn.denoise(ball, method="laplacian")
    np.testing.assert_array_equal(out.vertices, cn.denoise(ball.vertices, ball.faces, method="laplacian"))
    np.testing.assert_array_equal(out.visual.face_colors, ball.visual.face_colors)
    np.testing.assert_array_equal(out.vertex_attributes["heat"], np.arange(162.0))
    np.testing.assert_array_equal(out.face_attributes["part"], np.arange(320))
    assert out.metadata["unit"] == "mm" and ball.metadata is not out.metadata


def test_trimesh_comes_back_with_its_attributes():
    mesh = trimesh.Trimesh(BALL.vertices, BALL.faces, process=False, metadata={"unit": "mm"})
    mesh.vertex_attributes["heat"] = np.arange(162.0)
    mesh.visual.face_colors = np.tile([10, 20, 30, 255], (320, 1))
    before = mesh.vertices.tobytes()
    out = cn.denoise(mesh, **METHOD)
    assert type(out) is trimesh.Trimesh and out is not mesh
    assert mesh.vertices.tobytes() == before
    np.testing.assert_array_equal(out.vertices, cn.denoise(BALL, **METHOD).vertices)
    np.testing.assert_array_equal(out.faces, mesh.faces)
    np.testing.assert_array_equal(out.vertex_attributes["heat"], np.arange(162.0))
    np.testing.assert_array_equal(out.visual.face_colors, mesh.visual.face_colors)
    assert out.metadata["unit"] == "mm"


def test_seams_of_trimesh_stay_closed():
    trimesh = pytest.importorskip("trimesh")
    beyond = BALL.vertices[BALL.faces].mean(axis=1)[:, 0] > 0.1
    own = np.intersect1d(BALL.faces[beyond], BALL.faces[~beyond])  # on the seam: the faces beyond it have copies
    number = np.arange(len(BALL.vertices))
    number[own] = len(BALL.vertices) + np.arange(len(own))
    faces = np.where(beyond[:, None], number[BALL.faces], BALL.faces)
    source = np.concatenate([np.arange(len(BALL.vertices)), own])
    split = trimesh.Trimesh(BALL.vertices[source], faces, process=False)
    np.testing.assert_array_equal(cn.denoise(split, **METHOD).vertices, cn.denoise(BALL, **METHOD).vertices[source])
    for name, one, several in (
        ("fixed", [number[own[3]]], [own[3]]),
        ("fixed", np.arange(len(source)) == number[own[3]], [own[3]]),
        ("mask", np.arange(len(source)) != number[own[3]], np.arange(162) != own[3]),
        ("creases", number[BALL.faces[beyond][0, :2]][None], BALL.faces[beyond][0, :2][None]),
    ):
        out = cn.denoise(split, **METHOD, **{name: one}).vertices
        expected = cn.denoise(BALL, **METHOD, **{name: several}).vertices
        np.testing.assert_array_equal(out, expected[source])
    for name, wrong, message in (
        ("fixed", [len(source) - 1, 1000], f"references vertex 1000; there are {len(source)} vertices"),
        ("fixed", np.zeros(162, bool), rf"must be \({len(source)},\) bool"),
        ("mask", np.ones(162), rf"must be \({len(source)},\) bool"),
        ("creases", [number[BALL.faces[beyond][0, :2]], [0, 1000]], "has 1 of 2 pairs that are not edges"),
    ):
        with pytest.raises(cn.ParameterError, match=message):
            cn.denoise(split, **METHOD, **{name: wrong})


def test_pyvista_comes_back_with_its_arrays():
    pyvista = pytest.importorskip("pyvista")
    mesh = pyvista.PolyData.from_regular_faces(BALL.vertices.astype(np.float32), BALL.faces)
    mesh.point_data["heat"] = np.arange(162.0)
    mesh.point_data["Normals"] = np.zeros((162, 3), np.float32)
    out = cn.denoise(mesh, **METHOD)
    expected = cn.denoise(BALL.vertices.astype(np.float32), BALL.faces, **METHOD)
    np.testing.assert_array_equal(out.points, expected)
    np.testing.assert_array_equal(mesh.points, BALL.vertices.astype(np.float32))
    np.testing.assert_array_equal(out.point_data["heat"], np.arange(162.0))
    np.testing.assert_allclose(np.linalg.norm(out.point_data["Normals"], axis=1), 1, rtol=1e-6)
    with pytest.raises(cn.MeshError, match="triangulate"):
        cn.denoise(pyvista.Plane(), **METHOD)


def test_datasets_without_faces_are_refused_as_arrays_without_faces_are():
    pyvista = pytest.importorskip("pyvista")
    for data in (pyvista.PolyData(BALL.vertices), pyvista.Line()):
        with pytest.raises(cn.MeshError, match="the mesh has no faces: reconstruct a surface from the points first"):
            cn.denoise(data)
    with pytest.raises(cn.MeshError, match="the mesh has no vertices and no faces: there is nothing to denoise"):
        cn.denoise(pyvista.PolyData())


def test_meshio_comes_back_with_its_data():
    meshio = pytest.importorskip("meshio")
    mesh = meshio.Mesh(BALL.vertices, [("triangle", BALL.faces)], point_data={"heat": np.arange(162.0)})
    out = cn.denoise(mesh, **METHOD)
    np.testing.assert_array_equal(out.points, cn.denoise(BALL, **METHOD).vertices)
    np.testing.assert_array_equal(mesh.points, BALL.vertices)
    np.testing.assert_array_equal(out.point_data["heat"], np.arange(162.0))
    with pytest.raises(cn.MeshError, match="quad"):
        cn.denoise(meshio.Mesh(BALL.vertices, [("quad", [[0, 1, 2, 3]])]), **METHOD)


def test_normals_of_meshio_are_renewed():
    meshio = pytest.importorskip("meshio")
    names, normals = ("nx", "ny", "nz"), BALL.vertex_normals.astype(np.float32)
    mesh = meshio.Mesh(
        BALL.vertices,
        [("triangle", BALL.faces[:100]), ("vertex", [[3]]), ("triangle", BALL.faces[100:])],
        point_data={"Normals": -normals, **dict(zip(names, normals.T, strict=True))},
        cell_data={"Normals": [BALL.face_normals[:100], np.ones((1, 3)), BALL.face_normals[100:]]},
    )
    out = cn.denoise(mesh, **METHOD)
    expected = cn.denoise(BALL, **METHOD)
    np.testing.assert_allclose(out.point_data["Normals"], -expected.vertex_normals, atol=1e-6)
    np.testing.assert_allclose(np.stack([out.point_data[n] for n in names], 1), expected.vertex_normals, atol=1e-6)
    first, other, last = out.cell_data["Normals"]
    np.testing.assert_allclose(np.concatenate([first, last]), expected.face_normals, atol=1e-12)
    np.testing.assert_array_equal(other, np.ones((1, 3)))
    np.testing.assert_array_equal(mesh.point_data["nx"], normals[:, 0])


def test_a_tensor_mesh_of_open3d_is_refused_with_the_way_out():
    tensor = type("TriangleMesh", (), {"__module__": "open3d.cpu.pybind.t.geometry"})
    with pytest.raises(cn.MeshError, match="to_legacy"):
        cn.denoise(tensor())


def test_a_control_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(cn.ParameterError, match=r"no control 'iterations'.*parameters"):
        cn.denoise_file(tmp_path / "scan.ply", iterations=3)


def test_an_unused_vertex_at_the_other_end_of_all_numbers_does_no_harm():
    vertices = np.vstack([np.ldexp(BALL.vertices, 1020), np.full((1, 3), -1.7e308)])
    out = cn.denoise(vertices, BALL.faces, **METHOD)
    np.testing.assert_allclose(np.ldexp(out[:-1], -1020), cn.denoise(BALL, **METHOD).vertices, atol=1e-12)
    np.testing.assert_array_equal(out[-1], vertices[-1])


def test_open3d_comes_back_with_its_colors():
    open3d = pytest.importorskip("open3d", exc_type=ImportError)
    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(BALL.vertices.copy()), open3d.utility.Vector3iVector(BALL.faces.copy())
    )
    mesh.paint_uniform_color([0.1, 0.2, 0.3])
    out = cn.denoise(mesh, **METHOD)
    np.testing.assert_array_equal(np.asarray(out.vertices), cn.denoise(BALL, **METHOD).vertices)
    np.testing.assert_array_equal(np.asarray(mesh.vertices), BALL.vertices)
    assert out.has_vertex_colors()


def test_other_objects_are_refused():
    with pytest.raises(cn.MeshError, match=r"builtins\.dict is not a supported kind of mesh"):
        adapter({})
    with pytest.raises(cn.MeshError, match=r"ndarray is not a supported kind of mesh: pass the faces too"):
        cn.denoise(BALL.vertices)
    with pytest.raises(cn.MeshError, match=r"Scene is not a supported kind of mesh: pass scene\.to_mesh\(\)"):
        cn.denoise(trimesh.Scene(trimesh.creation.box()))
    with pytest.raises(cn.MeshError, match=r"Grid is not a supported kind of mesh: pass .*\.extract_surface\(\)"):
        cn.denoise(pytest.importorskip("pyvista").Sphere().cast_to_unstructured_grid())


def test_meshes_of_several_blocks_are_refused_with_what_to_do():
    pyvista = pytest.importorskip("pyvista")
    from vtkmodules.vtkCommonDataModel import vtkMultiBlockDataSet

    blocks = r"MultiBlock is not a supported kind of mesh: pass its surface, blocks\.combine.* or denoise its blocks"
    with pytest.raises(cn.MeshError, match=blocks):
        cn.denoise(pyvista.MultiBlock([pyvista.Sphere()]))
    with pytest.raises(cn.MeshError, match=r"Set is not .* by vtkCompositeDataGeometryFilter .* or denoise its blocks"):
        cn.denoise(vtkMultiBlockDataSet())


@pytest.mark.parametrize("mesh", [BALL, trimesh.creation.box(), "scan.ply", cn.from_arrays(BALL.vertices, BALL.faces)])
def test_a_mesh_beside_faces_is_refused(mesh):
    with pytest.raises(cn.MeshError, match=f"vertices are of type {type(mesh).__name__}; .* without faces"):
        cn.denoise(mesh, BALL.faces)
    with pytest.raises(cn.MeshError, match=f"vertices are of type {type(mesh).__name__}; .* without faces"):
        cn.inspect(mesh, BALL.faces)


def test_bad_arrays_are_refused():
    vertices = BALL.vertices.copy()
    vertices[5, 1] = np.nan
    with pytest.raises(cn.MeshError, match="vertices 5"):
        cn.denoise(vertices, BALL.faces, **METHOD)
    with pytest.raises(cn.MeshError, match="do not exist"):
        cn.denoise(BALL.vertices, BALL.faces + 1, **METHOD)


def test_a_path_gives_the_path_of_a_new_file(tmp_path):
    source = tmp_path / "ball.ply"
    cn.write(cn.from_arrays(BALL.vertices, BALL.faces), source)
    out = cn.denoise(source, **METHOD)
    assert out == tmp_path / "ball_denoised.ply"
    np.testing.assert_array_equal(cn.read(out).mesh.vertices, cn.denoise(BALL, **METHOD).vertices)
    with pytest.raises(cn.OutputError, match=r"exists already: call denoise_file\(.*\), with force=True to overwrite"):
        cn.denoise(source, **METHOD)


def test_compare_takes_meshes_paths_and_arrays(tmp_path):
    clean = icosphere(2)
    path = tmp_path / "clean.ply"
    cn.write(cn.from_arrays(clean.vertices, clean.faces), path)
    expected = cn.compare(BALL, clean)
    assert expected.normal_error_deg > 5
    assert cn.compare((BALL.vertices, BALL.faces), (clean.vertices, clean.faces)) == expected
    assert cn.compare(BALL, path) == expected


def test_methods_list_parameters_with_ranges_and_sources():
    sigma = cn.methods()["bilateral-normal"].settings["sigma_s"]
    assert sigma.about.unit == "mean edge lengths" and sigma.about.admits(1) and not sigma.about.admits(0)
    for method in cn.methods().values():
        assert method.summary.endswith(".") and method.source and method.family in FAMILIES
    with pytest.raises(cn.ParameterError, match="there is no family 'magic'; there are: learned"):
        register("never", source="", family="magic")(shifted)
    assert "never" not in cn.methods()


def test_public_names_all_load():
    for name in cn.__all__:
        assert getattr(cn, name) is not None
    assert [name for name in dir(cn) if not name.startswith("__")] == sorted(cn.__all__)
    assert "__version__" in dir(cn)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        cn.nonsense  # noqa: B018 - the access is the test


def test_a_misspelled_name_is_answered_with_the_one_that_is_meant(tmp_path):
    mesh = icosphere(1)
    for wrong, right in ({"strenght": 1}, "strength"), ({"iteration": 2}, "iterations"):
        with pytest.raises(ParameterError, match=f"did you mean '{right}'"):
            cn.denoise(mesh, method="laplacian", **wrong)
    save_mesh(tmp_path / "ball.ply", mesh)
    with pytest.raises(ParameterError, match="did you mean 'strength'"):
        cn.denoise_file(tmp_path / "ball.ply", method="laplacian", strenght=1)


def test_two_paths_are_answered_with_the_function_that_takes_them():
    with pytest.raises(ParameterError, match=r"faces is 'b\.ply', a path.* call denoise_file"):
        cn.denoise("a.ply", "b.ply")


def test_a_file_that_was_read_is_denoised_with_all_that_it_holds(tmp_path):
    save_mesh(tmp_path / "ball.ply", noisy(icosphere(2), 0.2))
    file = cn.read(tmp_path / "ball.ply")
    cn.denoise_file(tmp_path / "ball.ply", tmp_path / "out.ply", method="laplacian")
    moved = cn.denoise(file, method="laplacian")
    assert b"".join(map(bytes, moved.pieces())) == (tmp_path / "out.ply").read_bytes()
    assert not file.has_moved
    assert cn.compare(moved, file).normal_error_deg > 0
