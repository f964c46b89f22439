import io
import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from partitions import walls
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.api.inspection import FINDINGS, Found, Inspection, inspect, noise_level
from cascadenorm.api.inspection.crossings import crossing_faces
from cascadenorm.api.inspection.source import taken
from cascadenorm.cli import run
from cascadenorm.cli.tables import counted
from cascadenorm.data_gen.families import SHAPE_FAMILIES
from cascadenorm.detection.error_kind import LEAST_ERROR
from cascadenorm.detection.noise_level import local_noise
from cascadenorm.io import from_arrays
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh

BALL = icosphere(2)
ROUGH = noisy(BALL, 0.2)


def together(*meshes: Mesh) -> Mesh:
    """Join meshes into one of several parts."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


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


def only(mesh: Mesh, name: str) -> Found:
    """The one kind of thing that is found."""
    findings = inspect(mesh).findings
    assert list(findings) == [name]
    return findings[name]


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


def test_an_edge_of_three_faces():
    fin = Mesh(
        np.concatenate([grid(4, 4).vertices, [[1.5, 1.5, 1]]]), np.concatenate([grid(4, 4).faces, [[6, 12, 25]]])
    )
    assert only(fin, "non_manifold_edges") == Found(1, ((6, 12),))


def test_a_vertex_where_two_surfaces_meet():
    two = together(BALL, BALL.moved(BALL.vertices + np.array([2, 0, 0])))
    right, left = np.argmax(BALL.vertices[:, 0]), 162 + np.argmin(BALL.vertices[:, 0])
    pinched = Mesh(two.vertices, np.where(two.faces == left, right, two.faces))
    findings = inspect(pinched).findings
    assert findings["non_manifold_vertices"] == Found(1, (right,))
    assert set(findings) == {"non_manifold_vertices", "unreferenced", "duplicate_vertices"}
    assert inspect(pinched).genus is None


def test_flipped_faces_and_parts_that_are_inside_out():
    faces = BALL.faces.copy()
    faces[40] = faces[40, ::-1]
    found = only(Mesh(BALL.vertices, faces), "flipped_edges")
    assert found.count == 3 and {v for edge in found.first for v in edge} == set(faces[40].tolist())
    two = together(BALL.moved(BALL.vertices * 3), BALL)
    cavity = Mesh(two.vertices, np.concatenate([two.faces[:320], two.faces[320:, ::-1]]))
    assert only(cavity, "inside_out") == Found(1, (320,))
    assert inspect(cavity).volume == pytest.approx(26 * BALL.volume)


def test_faces_without_area_and_slivers():
    vertices = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0.019, 0], [1, 0.021, 0], [1, 1e-14, 1e-14]]
    found = inspect(np.array(vertices), [[0, 2, 3], [0, 2, 4], [0, 1, 2], [0, 2, 5]])
    assert found.findings["slivers"] == Found(1, (0,))
    assert found.findings["zero_area"] == Found(2, (2, 3))


def test_a_file_with_other_positions_shares_the_connectivity():
    mesh = noisy(icosphere(2), 0.1)
    file = from_arrays(mesh.vertices, mesh.faces)
    moved = file.with_vertices(1.5 * file.mesh.vertices)
    before, after = (taken(one, None).mesh for one in (file, moved))
    assert before is not None and after is not None and before.topology is after.topology
    alone = inspect(moved.mesh.vertices, moved.mesh.faces)
    assert replace(inspect(moved), source=alone.source) == alone


def test_copies_of_faces_and_vertices():
    faces = np.concatenate([BALL.faces, BALL.faces[4:5, [1, 2, 0]], BALL.faces[9:10, ::-1]])
    assert inspect(BALL.vertices, faces).findings["duplicate_faces"] == Found(2, (320, 321))
    soup = inspect(BALL.vertices[BALL.faces].reshape(-1, 3), np.arange(960).reshape(-1, 3))
    assert soup.findings["duplicate_vertices"].count == 960 - 162
    assert soup.parts == 320 and "crossing_faces" not in soup.findings


@pytest.mark.parametrize("shift", [(1.0, 0, 0), (0.3, 0.5, 0.7)])
def test_balls_that_overlap_cross_along_a_curve(shift):
    two = together(icosphere(3), icosphere(3).moved(icosphere(3).vertices + shift))
    crossing = crossing_faces(two)
    heights = np.linalg.norm(two.corners - shift, axis=2) * np.linalg.norm(two.corners, axis=2)
    near = (heights.min(axis=1) < 1) & (heights.max(axis=1) > 1)  # on the curve both distances are 1
    assert crossing[:1280].sum() > 30 and crossing[1280:].sum() > 30
    assert not crossing[np.abs(heights - 1).min(axis=1) > 0.4].any()
    assert near[crossing].mean() > 0.9


def test_triangles_cross_or_touch():
    flat = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    cases = {
        "through the middle": ([[0.2, 0.2, -1], [0.3, 0.2, 1], [0.3, 0.3, 1]], True),
        "a side through a side": ([[0.5, 0, -1], [0.5, 0, 1], [0.5, -1, 0]], True),
        "a corner on the face": ([[0.2, 0.2, 0], [0.3, 0.2, 1], [0.3, 0.3, 1]], False),
        "in one plane": ([[0.1, 0.1, 0], [0.9, 0.2, 0], [0.2, 0.9, 0]], False),
        "beside": ([[2, 0, -1], [2, 0, 1], [2, 1, 0]], False),
        "a shared corner only": ([[0, 0, 0], [-1, 0, 1], [0, -1, 1]], False),
        "a shared corner and through": ([[0, 0, 0], [0.5, 0.4, -1], [0.5, 0.4, 1]], True),
    }
    for name, (other, cross) in cases.items():
        mesh = Mesh(np.array(flat + other, float), [[0, 1, 2], [3, 4, 5]])
        for scale in (1.0, 1e-6):
            found = crossing_faces(mesh.moved(mesh.vertices * scale))
            assert found.tolist() == [cross, cross], name


def test_crossings_are_looked_for_where_asked_or_where_it_is_quick(monkeypatch):
    monkeypatch.setattr("cascadenorm.api.inspection.inspection.MOST_FACES_CROSSED", 319)
    assert inspect(BALL).crossing_faces is None
    assert inspect(BALL, self_intersections=True).crossing_faces == Found(0, ())
    monkeypatch.undo()
    assert inspect(BALL, self_intersections=False).crossing_faces is None


# noise

SHAPES = {
    "sphere": lambda: icosphere(4),
    "cube": lambda: cube(20),
    "sheet": lambda: grid(30, 30),
    "creature": lambda: SHAPE_FAMILIES["creature"].make(faces=5000, rng=np.random.default_rng(0)).clean,
    "assembly": lambda: SHAPE_FAMILIES["assembly"].make(faces=5000, rng=np.random.default_rng(0)).clean,
}


@pytest.mark.parametrize("name", SHAPES)
def test_noise_is_estimated_within_a_quarter(name):
    shape = SHAPES[name]()
    assert noise_level(shape) < 0.02
    for level in (0.05, 0.1, 0.2, 0.35, 0.5):
        rough = noisy(shape, level, seed=1)
        estimate = noise_level(rough) * rough.mean_edge_length / shape.mean_edge_length
        assert estimate == pytest.approx(level, rel=0.25)


def test_noise_on_a_plane_is_right_within_its_scatter():
    sheet = grid(100, 100)
    heights = np.zeros_like(sheet.vertices)
    heights[:, 2] = np.random.default_rng(0).normal(scale=0.01, size=len(heights))
    rough = sheet.moved(sheet.vertices + heights)
    assert noise_level(rough) * rough.mean_edge_length == pytest.approx(0.01, rel=0.03)


def test_noise_needs_edges_away_from_the_boundary():
    assert noise_level(grid(3, 3)) is None
    assert inspect([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).noise is None


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


def test_places_are_counted_as_the_file_counts():
    found = inspect(io.BytesIO(OBJ))
    assert (found.vertices, found.faces, found.counts_from) == (5, 4, 1)
    assert found.findings == {
        "bad_indices": Found(1, (2,)),
        "not_finite": Found(1, (5,)),
        "repeated_corners": Found(1, (3,)),
        "unreferenced": Found(1, (5,)),
    }


def test_copies_at_seams_are_joined_and_counted(tmp_path):
    save_mesh(tmp_path / "ball.stl", BALL)
    found = inspect(tmp_path / "ball.stl")
    assert (found.vertices, found.file_vertices, found.number_type) == (162, 960, "float32")
    assert found.closed and found.findings == {}


def test_every_kind_of_mesh_says_the_same(tmp_path):
    save_mesh(tmp_path / "rough.ply", ROUGH)
    own = inspect(ROUGH)
    for other in (
        inspect(ROUGH.vertices, ROUGH.faces),
        inspect(trimesh.Trimesh(ROUGH.vertices, ROUGH.faces, process=False)),
        inspect(tmp_path / "rough.ply"),
    ):
        assert {**vars(other), "source": own.source} == vars(own)


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


def test_every_finding_can_be_said_of_one_and_of_several():
    found = inspect(BALL)
    names = {name for name in Inspection.__dataclass_fields__ if isinstance(getattr(found, name), Found)}
    assert set(FINDINGS) == names
    for one, several in FINDINGS.values():
        assert one != several and counted(1, one, several) == f"1 {one}" and counted(0, one, several) == f"0 {several}"


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


def test_noise_is_that_of_the_mesh_where_a_few_vertices_lie_at_one_place():
    mesh = noisy(icosphere(4), 0.2)
    vertices = mesh.vertices.copy()
    vertices[mesh.topology.vertex_neighbors.row(100)] = vertices[100]
    assert noise_level(mesh.moved(vertices)) == pytest.approx(noise_level(mesh), rel=0.05)


def test_a_length_beyond_all_numbers_is_none_in_json(capsys, tmp_path):
    (tmp_path / "large.obj").write_text(
        "v -1.7e308 -1.7e308 -1.7e308\nv 1.7e308 1.7e308 1.7e308\nv 1.7e308 -1.7e308 1.7e308\nf 1 2 3\n"
    )
    assert run(["inspect", str(tmp_path / "large.obj"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert found["mean_edge_length"] is None and found["resolution"] is None


def test_a_polygon_counts_once(tmp_path):
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nv 3 0 0\nv 0 1 0\nf 1 2 3 4\nf 1 2 5\n")
    assert inspect(tmp_path / "flat.obj").zero_area == Found(1, (1,))


# noise, place by place


def test_local_noise_is_as_strong_as_the_noise_there():
    ball = icosphere(5)
    level = np.where(ball.vertices[:, 2] > 0, 0.05, 0.3)
    heights = np.random.default_rng(0).normal(size=len(level)) * level * ball.mean_edge_length
    local = local_noise(ball.moved(ball.vertices * (1 + heights[:, None])))
    for above, strength in ((ball.vertices[:, 2] > 0.2, 0.05), (ball.vertices[:, 2] < -0.2, 0.3)):
        assert np.sqrt(np.square(local[above]).mean()) == pytest.approx(strength, rel=0.15)


def test_local_noise_is_none_of_a_clean_plane_and_unknown_at_its_boundary():
    local = local_noise(grid(6, 6))
    known = ~np.isnan(local)
    np.testing.assert_allclose(local[known], 0, atol=1e-12)
    assert known.reshape(7, 7)[3, 3] and not known.reshape(7, 7)[0, 6]
    assert np.isnan(local_noise(grid(1, 1))).all()


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
