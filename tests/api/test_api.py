"""The public functions take files, arrays and meshes, and refuse what is wrong with a reason."""

import numpy as np
import pytest
import trimesh
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.errors import ParameterError
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh
from cascadenorm.registry import FAMILIES
from cascadenorm.registry import method as register

BALL = noisy(icosphere(2), 0.2)
METHOD = {"method": "bilateral-normal"}


def shifted(mesh: Mesh) -> np.ndarray:
    """Stand-in for a method: every vertex goes one unit of the frame along x."""
    return mesh.vertices + np.array([1.0, 0.0, 0.0])


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


def test_a_control_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(cn.ParameterError, match=r"no control 'iterations'.*parameters"):
        cn.denoise_file(tmp_path / "scan.ply", iterations=3)


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
