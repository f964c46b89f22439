"""An inspection tells what a mesh is, what is wrong with it, its noise, and what has become worse."""

import json

import numpy as np
import pytest
from partitions import walls
from shapes import cube, grid, icosphere, noisy, together

import cascadenorm as cn
from cascadenorm.api.inspection import Found, Inspection, inspect, noise_level
from cascadenorm.api.inspection.inspection import new_faults, surface_faults
from cascadenorm.cli import run
from cascadenorm.cli.tables import print_new_faults
from cascadenorm.detection.error_kind import LEAST_ERROR
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh

BALL = icosphere(2)


def without(mesh: Mesh, faces) -> Mesh:
    return Mesh(mesh.vertices, np.delete(mesh.faces, faces, axis=0))


def torus(around: int, across: int) -> Mesh:
    u, v = np.divmod(np.arange(around * across), across)
    phi, psi = 2 * np.pi * u / around, 2 * np.pi * v / across
    arm = 2 + np.cos(psi)
    right, up, both = ((u + i) % around * across + (v + j) % across for i, j in ((1, 0), (0, 1), (1, 1)))
    here = np.arange(around * across)
    faces = np.concatenate([np.stack(t, axis=1) for t in ((here, right, both), (here, both, up))])
    return Mesh(np.stack([arm * np.cos(phi), arm * np.sin(phi), np.sin(psi)], axis=1), faces)


# what a mesh is


def test_a_clean_sphere_is_described_and_nothing_is_found():
    found = inspect(BALL)
    assert (found.vertices, found.faces, found.parts, found.closed) == (162, 320, 1, True)
    assert (found.euler_characteristic, found.genus, found.boundary_loops, found.boundary_edges) == (2, 0, 0, 0)
    assert found.lower == (-1, -1, -1) and found.upper == (1, 1, 1)
    assert found.mean_edge_length == pytest.approx(BALL.mean_edge_length)
    assert found.area == pytest.approx(BALL.area) and found.volume == pytest.approx(BALL.volume)
    assert found.findings == {}


def test_handles_and_parts_are_counted():
    found = inspect(together(torus(12, 8), torus(9, 7).moved(torus(9, 7).vertices + 9), BALL))
    assert (found.parts, found.genus, found.euler_characteristic) == (3, 2, 2)


def test_boundary_loops_of_open_meshes():
    sheet = inspect(without(grid(6, 6), [14, 14 + 36]))  # one square taken out of the middle
    assert (sheet.boundary_loops, sheet.boundary_edges, sheet.closed) == (2, 4 * 6 + 4, False)
    assert sheet.genus is None and sheet.volume is None


@pytest.mark.parametrize("scale", [2.0**1000, 2.0**-1000])
def test_sizes_at_the_ends_of_the_number_range(scale):
    found = inspect(BALL.moved(BALL.vertices * scale))
    assert found.findings == {} and found.mean_edge_length == BALL.mean_edge_length * scale
    assert found.area == (None if scale > 1 else 0.0)
    assert found.noise == pytest.approx(inspect(BALL).noise)


@pytest.mark.parametrize(
    ("offset", "kind", "coarse"), [(5e6, "float32", True), (5e6, "float64", False), (0, "float32", False)]
)
def test_resolution_of_the_number_type(offset, kind, coarse):
    vertices = (BALL.vertices * 3 + offset).astype(kind)
    found = inspect(vertices, BALL.faces)
    step = np.spacing(np.abs(vertices).max())
    assert found.number_type == kind and found.resolution == pytest.approx(step / found.mean_edge_length, rel=0.01)
    assert (found.resolution > 0.01) == coarse


# what is wrong with it


def test_bad_indices_vertices_and_corners_are_reported_rather_than_refused():
    vertices = BALL.vertices.copy()
    vertices[[3, 5], [0, 2]] = np.nan, np.inf
    faces = np.concatenate([BALL.faces, [[0, 1, 162], [-1, 0, 1], [7, 7, 8], [9, 9, 9]]])
    found = inspect(vertices, faces)
    assert found.findings["not_finite"] == Found(2, (3, 5))
    assert found.findings["bad_indices"] == Found(2, (320, 321))
    assert found.findings["repeated_corners"] == Found(2, (322, 323))
    assert found.boundary_edges == sum(np.isin(BALL.faces, v).any(axis=1).sum() for v in (3, 5))
    assert np.isfinite([*found.lower, *found.upper, found.noise]).all()


def test_meshes_that_are_none_are_reported():
    for vertices, faces in ((BALL.vertices, []), (np.zeros((0, 3)), []), (np.zeros((0, 3)), [[0, 1, 2]])):
        found = inspect(vertices, faces)
        assert (found.vertices, found.faces, found.parts, found.closed) == (len(vertices), len(faces), 0, False)
        assert found.noise is None and found.mean_edge_length is None and found.lower is None
    assert inspect(np.zeros((2, 3)), []).findings == {
        "unreferenced": Found(2, (0, 1)),
        "duplicate_vertices": Found(1, (1,)),
    }
    with pytest.raises(cn.MeshError, match="vertices have shape"):
        inspect([1.0, 2.0], [[0, 1, 2]])


def test_copies_of_faces_and_vertices():
    faces = np.concatenate([BALL.faces, BALL.faces[4:5, [1, 2, 0]], BALL.faces[9:10, ::-1]])
    assert inspect(BALL.vertices, faces).findings["duplicate_faces"] == Found(2, (320, 321))
    soup = inspect(BALL.vertices[BALL.faces].reshape(-1, 3), np.arange(960).reshape(-1, 3))
    assert soup.findings["duplicate_vertices"].count == 960 - 162
    assert soup.parts == 320 and "crossing_faces" not in soup.findings


def test_crossings_are_looked_for_where_asked_or_where_it_is_quick(monkeypatch):
    monkeypatch.setattr("cascadenorm.api.inspection.inspection.MOST_FACES_CROSSED", 319)
    assert inspect(BALL).crossing_faces is None
    assert inspect(BALL, self_intersections=True).crossing_faces == Found(0, ())
    monkeypatch.undo()
    assert inspect(BALL, self_intersections=False).crossing_faces is None


def test_an_error_that_auto_finds_is_the_noise_of_a_mesh_with_too_few_interior_edges():
    rough = noisy(grid(4, 4), 0.3)
    assert noise_level(rough) is None
    found = inspect(rough)
    assert found.error.kind != "none" and found.noise == found.error.size > LEAST_ERROR


def test_separate_flat_sheets_have_no_steps_and_no_noise():
    sheet = grid(2, 2)
    vertices = [sheet.vertices + np.array([3.0 * number, 0, 0]) * np.ptp(sheet.vertices) for number in range(20)]
    faces = [sheet.faces + len(sheet.vertices) * number for number in range(20)]
    found = inspect(np.concatenate(vertices), np.concatenate(faces))
    assert found.treads is None and found.noise is None and found.error.kind == "none"


# files, kinds of meshes, and the command

OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 5 5 nan\nf 1 2 4 3\nf 1 2 9\nf 1 1 2\n"


def test_the_command_speaks_plainly(tmp_path, capsys):
    (tmp_path / "bad.obj").write_bytes(OBJ)
    assert run(["inspect", str(tmp_path / "bad.obj")]) == 0
    out = capsys.readouterr().out
    assert "1 face references a vertex that does not exist: 2\n" in out and "counted from 1" in out
    assert "open: 1 boundary loop with 4 edges;" in out and "noise along the normal: cannot be estimated" in out
    assert "kind of error" not in out
    save_mesh(tmp_path / "flat.ply", grid(9, 9))
    assert run(["inspect", str(tmp_path / "flat.ply")]) == 0
    assert "noise along the normal: below 0.001 mean edge lengths" in capsys.readouterr().out
    save_mesh(tmp_path / "far.ply", BALL.moved(BALL.vertices + 5e6))
    assert run(["inspect", str(tmp_path / "far.ply"), "--no-self-intersections"]) == 0
    out = capsys.readouterr().out
    assert "no defects" in out and "were not checked" in out and "closed; Euler" in out
    save_mesh(tmp_path / "coarse.stl", BALL.moved(BALL.vertices + 5e6))
    assert run(["inspect", str(tmp_path / "coarse.stl")]) == 0
    out = capsys.readouterr().out
    assert "float32 is too coarse at these coordinates" in out
    assert "the file stores 960 vertices, of which 886 are copies of others" in out
    assert run(["inspect", str(tmp_path / "absent.ply")]) == 3


def test_one_is_said_otherwise_than_several(tmp_path, capsys):
    sliver, stray = "v 0 {0} 0\nv 2 {0} 0\nv 1 {0}.001 0\nf -3 -2 -1\n", "v nan 0 0\n"
    for count, said in (
        (
            1,
            (
                "4 vertices, 1 face, ",
                "open: 1 boundary loop with 3 edges",
                "1 vertex is not finite: 4",
                "1 face is a sliver, ",
            ),
        ),
        (
            2,
            (
                "8 vertices, 2 faces, ",
                "open: 2 boundary loops with 6 edges",
                "2 vertices are not finite",
                "2 faces are slivers, ",
            ),
        ),
    ):
        (tmp_path / "slivers.obj").write_text("".join(sliver.format(place) + stray for place in range(count)))
        assert run(["inspect", str(tmp_path / "slivers.obj")]) == 0
        out = capsys.readouterr().out
        assert [text for text in said if text not in out] == [], out


@pytest.mark.parametrize("flipped", [[], slice(0, 900)])
@pytest.mark.parametrize("scale", [1e-150, 1.0])
def test_an_outlier_that_auto_removes_is_a_finding_though_the_error_is_insignificant(flipped, scale):
    ball = icosphere(5)
    vertices, faces = ball.vertices.copy(), ball.faces.copy()
    vertices[4321] *= 1 + 0.4 * ball.mean_edge_length
    faces[flipped] = faces[flipped, ::-1]
    found = inspect(vertices * scale, faces)
    assert found.outliers == Found(1, (4321,)) and found.error.kind == "none"
    moved = np.linalg.norm(cn.denoise((vertices, faces)) - vertices, axis=1)
    assert moved.argmax() == 4321 and moved.max() > 0.3 * ball.mean_edge_length


def test_the_json_holds_every_field(tmp_path, capsys):
    (tmp_path / "bad.obj").write_bytes(OBJ)
    assert run(["inspect", str(tmp_path / "bad.obj"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["version"], found["command"]) == (1, "inspect")
    assert set(found) - {"version", "command"} == set(Inspection.__dataclass_fields__)
    assert found["bad_indices"] == {"count": 1, "first": [2]} and found["genus"] is None


def test_a_mesh_at_one_point_has_no_noise_to_tell():
    ball = icosphere(2)
    found = cn.inspect(ball.vertices * 0, ball.faces)
    assert found.noise is None and found.mean_edge_length == 0


def test_a_length_beyond_all_numbers_is_none_in_json(capsys, tmp_path):
    (tmp_path / "large.obj").write_text(
        "v -1.7e308 -1.7e308 -1.7e308\nv 1.7e308 1.7e308 1.7e308\nv 1.7e308 -1.7e308 1.7e308\nf 1 2 3\n"
    )
    assert run(["inspect", str(tmp_path / "large.obj"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert found["mean_edge_length"] is None and found["resolution"] is None


@pytest.fixture(scope="module")
def rough(tmp_path_factory):
    """A noisy hemisphere with a flipped face, and what `inspect` finds in it."""
    ball = icosphere(3)
    faces = ball.faces[ball.centroids[:, 2] > -0.1]
    faces = np.vstack([faces[:1, ::-1], faces[1:]])
    file = tmp_path_factory.mktemp("rough") / "rough.ply"
    save_mesh(file, noisy(Mesh(ball.vertices, faces), 0.1))
    return file, inspect(file)


@pytest.mark.parametrize(
    "controls",
    [
        {},
        {"strength": 0.3},
        {"strength": 2.5},
        {"max_displacement": 0.01},
        {"boundary": "fixed"},
        {"only": range(400)},
        {"volume": "keep"},
    ],
    ids=str,
)
def test_denoise_tells_the_error_that_inspect_tells_whatever_the_strength_and_the_limits(rough, tmp_path, controls):
    file, found = rough
    done = cn.denoise_file(file, tmp_path / "out.ply", **controls)
    assert found.error is not None and found.noise == found.error.size
    assert (done.error, done.treated_as) == (found.error, found.treated_as)


def test_inspect_and_denoise_tell_the_same_error_where_regions_share_walls(tmp_path):
    save_mesh(tmp_path / "walls.ply", walls("four cells", voxel=0.15).mesh)
    done = cn.denoise_file(tmp_path / "walls.ply", tmp_path / "out.ply")
    told = inspect(tmp_path / "walls.ply")
    assert done.error is not None and done.error.size > 0.05
    assert (told.error, told.noise, told.treated_as) == (done.error, done.error.size, done.treated_as)


def test_regions_that_share_walls_are_treated_as_their_surfaces_are():
    found = walls("cube in cube", voxel=0.25)
    mesh = noisy(found.mesh, 0.01)
    each = [inspect(found._replace(mesh=mesh).region(label)) for label in range(3)]
    kinds, faces = [one.treated_as.treatment for one in each], [one.faces for one in each]
    told = inspect(mesh).treated_as
    share = np.average([kind == told.treatment for kind in kinds], weights=faces)
    assert 0.5 < share < 1 and told.share == pytest.approx(share)


def test_denoise_tells_no_error_if_nothing_is_to_move(rough, tmp_path):
    assert cn.denoise_file(rough[0], tmp_path / "out.ply", strength=0).error is None


# what has become worse

FINE = icosphere(3)


def test_smooth_surfaces_and_corners_have_none():
    for mesh in (FINE, cube(4), noisy(FINE, 0.1)):
        assert surface_faults(mesh) == {"crossing_faces": 0, "spikes": 0, "folded_edges": 0}


def test_the_report_counts_faces_that_cross_although_nothing_folds(tmp_path, monkeypatch, capsys):
    """Of two balls, one inside the other, the coarse outer one shrinks faster and cuts through the inner one."""
    monkeypatch.chdir(tmp_path)
    outer, inner = icosphere(1), icosphere(3)
    faces = np.concatenate([outer.faces, inner.faces + len(outer.vertices)])
    save_mesh(tmp_path / "balls.ply", Mesh(np.concatenate([outer.vertices, 0.9 * inner.vertices]), faces))
    words = ["denoise", "balls.ply", "--method", "laplacian", "--set", "iterations=1", "--force"]
    assert run([*words, "--report", "report.html"]) == 0
    assert "the result has" not in capsys.readouterr().err  # the search takes too long for every mesh
    after = cn.inspect("balls_denoised.ply").crossing_faces.count
    assert after > 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    tile = page[page.index("Self-intersecting faces") :][:400]
    assert f"{after}<" in tile
    assert "vertices; folded edges: 0\N{NO-BREAK SPACE}→\N{NO-BREAK SPACE}0" in page
    assert "edges folded by more than 90°" in page


def test_only_what_became_more_is_said(capsys, monkeypatch):
    def folded(angle: float) -> Mesh:
        turn = np.radians(angle)
        return Mesh([(0, 0, 0), (0, 1, 0), (-1, 0, 0), (np.cos(turn), 0, np.sin(turn))], [(0, 1, 2), (3, 1, 0)])

    assert new_faults(folded(10), folded(120)) == {"folded_edges": (0, 1)}
    print_new_faults({"spikes": (0, 1), "folded_edges": (3, 5)})
    assert "the result has 1 spike (0 before), 5 edges folded by more than 90° (3 before)\n" in capsys.readouterr().err
    for before, after in ((folded(120), folded(130)), (folded(120), folded(10))):
        assert new_faults(before, after) == {}
    print_new_faults({})
    assert capsys.readouterr().err == ""


def test_faces_that_cross_are_counted_where_the_result_has_new_folds(monkeypatch):
    def with_fin(angle: float) -> Mesh:
        """A sheet, and a triangle above it that turns about an edge of another one until it cuts the sheet."""
        turn = np.radians(angle)
        sheet = [(-2, -1, -0.5), (2, -1, -0.5), (0, 3, -0.5)]
        hinge = [(0, 0, 0), (0, 1, 0), (-1, 0, 0), (np.cos(turn), 0, -np.sin(turn))]
        return Mesh(np.array(sheet + hinge, float), [(0, 1, 2), (3, 4, 5), (6, 4, 3)])

    assert new_faults(with_fin(10), with_fin(100)) == {"crossing_faces": (0, 2), "folded_edges": (0, 1)}
    monkeypatch.setattr("cascadenorm.api.inspection.inspection.MOST_FACES_CROSSED", 1)
    assert new_faults(with_fin(10), with_fin(100)) == {"folded_edges": (0, 1)}


def test_denoise_counts_them_before_and_after(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    vertices = FINE.vertices.copy()
    vertices[7] *= 1.6
    vertices[100] *= -1.5  # through the other side
    save_mesh(tmp_path / "ball.ply", Mesh(vertices, FINE.faces))
    words = [
        "denoise",
        "ball.ply",
        "-o",
        "out.ply",
        "--method",
        "laplacian",
        "--set",
        "iterations=100",
        "--json",
        "--force",
    ]
    assert run(words) == 0
    told = json.loads(capsys.readouterr().out)
    found = cn.inspect("ball.ply")
    assert told["spikes"] == {"before": 2, "after": 0} and found.spikes.count == 2
    assert told["crossing_faces"]["before"] == found.crossing_faces.count > 0 == told["crossing_faces"]["after"]
    monkeypatch.setattr("cascadenorm.api.inspection.inspection.MOST_FACES_CROSSED", 10)
    assert run(words) == 0
    assert json.loads(capsys.readouterr().out)["crossing_faces"] == {"before": None, "after": None}


def test_faults_are_those_of_the_mesh_that_is_denoised(tmp_path, monkeypatch, capsys):
    """Back faces are no further faces that cross, and faces that repeat a vertex hide no spike."""
    monkeypatch.chdir(tmp_path)
    vertices = FINE.vertices.copy()
    vertices[100] *= -1.5  # through the other side
    ring = FINE.faces[(FINE.faces == 100).any(axis=1)]
    expected = surface_faults(Mesh(vertices, FINE.faces))
    assert expected["crossing_faces"] > 0 and expected["spikes"] > 0
    lines = [(face[0], face[1], face[1]) for face in ring]
    save_mesh(tmp_path / "ball.ply", Mesh(vertices, [*FINE.faces, *ring[:, ::-1], *lines]))
    words = ["denoise", "ball.ply", "-o", "out.ply", "--on-bad", "isolate", "--strength", "0", "--json", "--force"]
    assert run(words) == 0
    told = json.loads(capsys.readouterr().out)
    assert {name: told[name] for name in expected} == {n: {"before": k, "after": k} for n, k in expected.items()}
    assert cn.inspect("ball.ply").crossing_faces.count == expected["crossing_faces"]


def test_spikes_and_folds_of_a_mesh_with_back_faces_are_those_of_its_front():
    front = noisy(FINE, 0.7)
    both = Mesh(front.vertices, [*front.faces, *front.faces[:, ::-1]])
    found, expected = cn.inspect(both), cn.inspect(front)
    assert expected.spikes.count > 0 and expected.folded_edges > 0
    assert (found.spikes, found.folded_edges) == (expected.spikes, expected.folded_edges)
    faults = surface_faults(both)
    assert (faults["spikes"], faults["folded_edges"]) == (expected.spikes.count, expected.folded_edges)
