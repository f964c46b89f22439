"""What single formats promise: seams stay closed, normals follow, each spelling is understood."""

import json
import zipfile

import numpy as np
import pytest
from shapes import cube, icosphere
from test_io import OBJ, PLY_TEXT, SIDES, TETRAHEDRON, glb, read, stl_binary, stl_text, written

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run
from cascadenorm.inspection import inspect
from cascadenorm.io.content import Content
from cascadenorm.io.files import FORMATS
from cascadenorm.mesh import Mesh, MeshError, unit
from cascadenorm.mesh.polygons import Polygons, triangulate
from cascadenorm.mesh.welding import PRIME, _find_equal, first_equal, weld

OFF_TETRAHEDRON = b"\n".join(
    [b"OFF", b"4 4 6", *(b"%d %d %d" % p for p in TETRAHEDRON), *(b"3 %d %d %d" % s for s in SIDES), b""]
)


def encoded(mesh: Mesh, format: str) -> io.MeshFile:
    polygons = Polygons.from_rows(mesh.faces.astype(np.int64))
    return FORMATS[format](b"".join(FORMATS[format].encode(Content(mesh.vertices, polygons))[0]))


def ply_of(vertices, faces, normals=None) -> io.MeshFile:
    values = {} if normals is None else dict(zip(("nx", "ny", "nz"), normals.T, strict=True))
    return FORMATS["ply"](b"".join(FORMATS["ply"].encode(Content(vertices, Polygons.from_rows(faces), values))[0]))


@pytest.mark.parametrize("data", [stl_binary(), stl_text()])
def test_stl_is_welded_and_never_opens(data):
    file = read(data)
    assert (len(file.positions), len(file.mesh.vertices)) == (12, 4)
    assert file.mesh.volume == pytest.approx(1 / 6)
    moved = read(written(file.with_vertices(file.mesh.vertices + np.arange(12).reshape(4, 3) / 7)))
    assert len(moved.mesh.vertices) == 4
    assert moved.mesh.topology.interior_edges.size == 6


def test_stl_normals_follow_and_attributes_stay():
    file = read(stl_binary())
    data = written(file.with_vertices(file.mesh.vertices * (1, 2, 3)))
    again = read(data)
    records = np.frombuffer(data, [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")], offset=84)
    assert np.allclose(records["n"], again.mesh.face_normals, atol=1e-7)
    assert records["a"].tolist() == [1, 2, 3, 65535]
    assert data[:80] == stl_binary()[:80]


def test_soup_of_a_closed_surface_welds_to_it():
    sphere = icosphere(2)
    corners = sphere.corners.reshape(-1, 3)
    soup = ply_of(corners, np.arange(len(corners)).reshape(-1, 3))
    assert len(soup.mesh.vertices) == len(sphere.vertices)
    assert not soup.mesh.topology.boundary_vertices.any()


def test_surfaces_that_touch_inside_stay_apart():
    box = cube(2)
    twice = ply_of(np.concatenate([box.vertices] * 2), np.concatenate([box.faces, box.faces + len(box.vertices)]))
    assert len(twice.mesh.vertices) == 2 * len(box.vertices)


def rounded_soup(apart: float) -> tuple[Mesh, bytes]:
    """Return a ball, and an STL of it whose corners are up to `apart` mean edge lengths from where they belong."""
    ball = icosphere(3)
    shift = np.random.default_rng(0).uniform(-0.5, 0.5, (*ball.faces.shape, 3)) * apart * ball.mean_edge_length / 3**0.5
    corners = ball.vertices[ball.faces] + shift
    text = ["solid soup"]
    for facet in corners.tolist():
        lines = "\n".join(f"vertex {x!r} {y!r} {z!r}" for x, y, z in facet)
        text.append(f"facet normal 0 0 0\nouter loop\n{lines}\nendloop\nendfacet")
    return ball, "\n".join([*text, "endsolid"]).encode()


def test_corners_that_nearly_coincide_are_reported_and_joined_on_request(tmp_path, capsys):
    ball, data = rounded_soup(1e-6)
    path = tmp_path / "soup.stl"
    path.write_bytes(data)
    found = inspect(path)
    assert (found.boundary_edges, found.nearly_coincident.count) == (3 * 1280, 3 * 1280 - 642)
    assert run(["denoise", str(path), "-o", str(tmp_path / "a.stl"), "--method", "laplacian"]) == 0
    assert "3198 boundary vertices coincide with another one but for 0.001 edges" in capsys.readouterr().err
    for length in "0.001 edges", 1e-4 * ball.mean_edge_length:
        done = cn.denoise_file(path, tmp_path / "b.stl", method="laplacian", weld=length, force=True)
        assert (done.vertices, done.nearly_coincident) == (642, 0)
        made = inspect(tmp_path / "b.stl")
        assert made.closed and made.vertices == 642 and made.nearly_coincident.count == 0
    expected = cn.denoise(ball, method="laplacian").vertices
    moved = cn.read(tmp_path / "b.stl").mesh
    np.testing.assert_allclose(moved.vertices[moved.faces], expected[ball.faces], atol=1e-6)


def test_a_weld_joins_chains_within_a_part_only_and_no_interior():
    triangles = np.arange(12).reshape(-1, 3)
    points = np.random.default_rng(0).uniform(size=(12, 3)) * 10
    for step, corner in enumerate((3, 6, 9), 1):
        points[corner] = points[0] + [0.09 * step, 0, 0]
    welds, first = weld(points, triangles, distance=0.1)
    assert welds[[3, 6, 9]].tolist() == [welds[0]] * 3 and len(first) == 9
    parts = np.repeat([0, 0, 1, 1], 3)
    welds, first = weld(points, triangles, parts, distance=0.1)
    assert welds[3] == welds[0] and welds[9] == welds[6] != welds[0] and len(first) == 10
    assert len(weld(points, triangles, distance=0.05)[1]) == 12


@pytest.mark.parametrize("length", ["1 edges", "-1", "far"])
def test_a_weld_of_half_an_edge_is_refused(length, tmp_path):
    _, data = rounded_soup(1e-6)
    (tmp_path / "a.stl").write_bytes(data)
    with pytest.raises(cn.ParameterError, match=r"weld is .*; it must be"):
        cn.denoise_file(tmp_path / "a.stl", method="laplacian", weld=length)


def test_coordinates_made_for_equal_hashes_are_told_apart_with_few_probes():
    """Both halves of each number differ alike, as the folds of simple hashes cannot tell."""
    high = (0x3FF00000 + 16 * np.arange(3000)).astype(np.uint64)
    crafted = ((high << np.uint64(32)) | (high ^ np.uint64(0x12345678))).view(np.float64)
    rows = np.column_stack([np.full(3000, 0.5), np.full(3000, 0.25), crafted])
    assert first_equal(rows) is None
    same, repeated = first_equal(np.concatenate([rows, rows[::-1]]))
    assert np.array_equal(same, np.concatenate([np.arange(3000), np.arange(3000)[::-1]])) and repeated.all()
    assert longest_run(rows) < 60


def longest_run(rows) -> int:
    """Most neighbouring places of the table that are taken: no search probes more."""
    bits = np.ascontiguousarray(rows).view(np.int64)
    places = np.full(2 << len(rows).bit_length(), -1, np.int32)
    factors = np.random.default_rng(1).integers(1, PRIME, 3 * rows.shape[1])
    _find_equal(bits, factors, places, np.empty(len(rows), np.int64), np.zeros(len(rows), bool))
    free = np.flatnonzero(places < 0)
    return int(np.diff(free).max()) - 1


def test_welding_distinguishes_what_single_precision_does_not():
    vertices = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1e-12, 0, 0), (-1, 0, 0), (-0.0, -1, 0), (0, -1, 0)])
    file = ply_of(vertices, np.array([(0, 1, 2), (3, 4, 5), (0, 4, 6)]))
    assert file.welds.tolist() == [0, 1, 2, 3, 4, 5, 5]


def test_obj_seam_moves_together():
    seam = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 4 6 5\n"
    file = read(seam)
    assert file.welds.tolist() == [0, 1, 2, 1, 2, 3]
    moved = file.with_vertices(file.mesh.vertices + np.arange(12).reshape(4, 3))
    assert np.array_equal(moved.positions[1], moved.positions[3])
    assert np.array_equal(moved.positions[2], moved.positions[4])


def test_obj_indices_and_continuations():
    file = read(OBJ)
    polygons = np.split(file.polygons.corners, file.polygons.indptr[1:-1])
    assert [polygon.tolist() for polygon in polygons] == [[0, 1, 2, 3], [0, 1, 4], [1, 2, 4]]


def test_obj_normals_follow_the_faces_that_use_them():
    file = read(OBJ)
    turn = np.array([(1, 0, 0), (0, 0, 1), (0, -1, 0)])  # z becomes y
    text = written(file.with_vertices(file.mesh.vertices @ turn.T)).decode()
    assert "vn 0.0 -1.0 0.0" in text.replace("-0.0", "0.0").replace("0.0 1.0 0.0", "0.0 -1.0 0.0")
    assert "vt 0.5 1\n" in text
    assert "v 1.0  0" in text


@pytest.mark.parametrize("sign", [1, -1])
def test_vertex_normals_of_the_sphere_stay_radial(sign):
    sphere = icosphere(3)
    file = ply_of(sphere.vertices, sphere.faces.astype(np.int64), sign * sphere.vertices)
    stretched = sphere.vertices * (1, 1, 2)
    again = read(written(file.with_vertices(stretched))).content().vertex_values
    found = np.stack([again[n] for n in ("nx", "ny", "nz")], axis=1)
    assert np.allclose(np.linalg.norm(found, axis=1), 1)
    assert (np.einsum("ij,ij->i", found, sign * unit(stretched / (1, 1, 4))) > 0.99).all()


def test_equal_normals_at_a_seam_stay_equal_and_creases_stay():
    soup = cube(2).corners.reshape(-1, 3)
    faces = np.arange(len(soup)).reshape(-1, 3)
    flat = np.repeat(cube(2).face_normals, 3, axis=0)
    bent = ply_of(soup, faces, flat)
    moved = bent.with_vertices(bent.mesh.vertices * (1, 1, 2))
    again = moved.content().vertex_values
    found = np.stack([again[n] for n in ("nx", "ny", "nz")], axis=1)
    assert np.allclose(found, flat)
    smooth = ply_of(soup, faces, unit(soup))
    noise = np.random.default_rng(0).normal(size=smooth.mesh.vertices.shape) / 20
    moved = smooth.with_vertices(smooth.mesh.vertices + noise)
    again = moved.content().vertex_values
    found = np.stack([again[n] for n in ("nx", "ny", "nz")], axis=1)
    assert len(np.unique(np.column_stack([moved.welds, found]), axis=0)) == len(smooth.mesh.vertices)


def test_normals_that_are_not_a_number_at_a_seam_are_renewed_each_from_its_own_faces():
    soup = cube(2).corners.reshape(-1, 3)
    file = ply_of(soup, np.arange(len(soup)).reshape(-1, 3), np.full(soup.shape, np.nan))
    again = file.with_vertices(file.mesh.vertices * (1, 1, 2)).content().vertex_values
    found = np.stack([again[n] for n in ("nx", "ny", "nz")], axis=1)
    assert np.allclose(found, np.repeat(cube(2).face_normals, 3, axis=0))


@pytest.mark.parametrize("scale", [1e300, 1.0, 1e-250])
def test_normals_of_any_size_are_right(scale):
    sphere = icosphere(2)
    file = ply_of(sphere.vertices * scale, sphere.faces.astype(np.int64), sphere.vertices[:, [1, 2, 0]])
    again = file.with_vertices(sphere.vertices * scale / 2).content().vertex_values
    found = np.stack([again[n] for n in ("nx", "ny", "nz")], axis=1)
    assert (np.abs(np.einsum("ij,ij->i", found, sphere.vertices)) > 0.99).all()


@pytest.mark.filterwarnings("error")
def test_vertices_that_are_signalling_nans_are_isolated_in_silence(tmp_path):
    data = bytearray(stl_binary())
    data[84 + 12 : 84 + 16] = b"\x01\x00\xa0\x7f"
    (tmp_path / "a.stl").write_bytes(data)
    done = cn.denoise_file(tmp_path / "a.stl", method="laplacian", on_bad="isolate")
    assert (done.isolated_vertices, done.isolated_faces) == (1, 1)
    assert inspect(tmp_path / "a.stl").not_finite.count == 1


def test_normals_that_are_signalling_nans_are_renewed():
    sphere = icosphere(1)
    signalling = np.full(sphere.vertices.shape, 0x7F800001, np.uint32).view(np.float32)
    file = ply_of(sphere.vertices, sphere.faces.astype(np.int64), signalling)
    again = file.with_vertices(sphere.vertices * 2).content().vertex_values
    assert np.allclose([again[n] for n in ("nx", "ny", "nz")], sphere.vertices.T, atol=0.1)


def test_normals_far_from_what_moved_stay():
    sphere = icosphere(2)
    tilted = unit(sphere.vertices + np.array((0.3, 0, 0)))
    file = ply_of(sphere.vertices, sphere.faces.astype(np.int64), tilted)
    vertices = sphere.vertices.copy()
    vertices[0] *= 1.1
    again = file.with_vertices(vertices).content().vertex_values
    changed = np.any([again[n] != tilted[:, i] for i, n in enumerate(("nx", "ny", "nz"))], axis=0)
    ring = np.unique(sphere.faces[(sphere.faces == 0).any(axis=1)])
    assert np.flatnonzero(changed).tolist() == ring.tolist()


@pytest.mark.parametrize("format", ["stl", "glb", "gltf"])
def test_single_precision_is_never_exceeded(format):
    sphere = icosphere(1)
    with pytest.raises(io.OutputError, match=r"1 vertices exceed .* \(vertices 7\)"):
        encoded(sphere.moved(np.where(np.arange(len(sphere.vertices))[:, None] == 7, 1e39, sphere.vertices)), format)
    largest = float(np.finfo(np.float32).max)
    file = encoded(sphere.moved(sphere.vertices / np.abs(sphere.vertices).max() * largest), format)
    assert np.isfinite(file.positions).all()


def test_ply_strips_alternate():
    header = b"ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
    header += b"element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    points = b"0 0 0\n0 1 0\n1 0 0\n1 1 0\n2 0 0\n2 1 0\n"
    file = read(header + points + b"10 0 2 1 3 -1 2 4 3 5 -1\n")
    assert file.mesh.faces.tolist() == [[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]]
    assert np.allclose(file.mesh.face_normals, (0, 0, 1))


def test_polygon_fans_do_not_fold():
    arrow = np.array([(0, 0, 0), (2, -1, 0), (1, 0, 0), (2, 1, 0)], float)  # concave at its third corner
    for turn in range(4):
        corners = np.roll(np.arange(4), turn)
        triangles, owners = triangulate(arrow, Polygons.from_rows(corners[None]))
        assert owners.tolist() == [0, 0]
        assert (Mesh(arrow, triangles).face_normals[:, 2] > 0).all()


def test_short_polygons_have_no_triangle():
    polygons = Polygons.from_counts(np.array([2, 3, 1, 4, 0]), np.array([0, 1, 0, 1, 2, 3, 0, 1, 2, 3]))
    triangles, owners = triangulate(np.eye(4)[:, :3], polygons)
    assert owners.tolist() == [1, 3, 3]
    assert triangles[0].tolist() == [0, 1, 2]


def test_off_without_its_keyword_and_with_counts_beside_it():
    rows = OFF_TETRAHEDRON.removeprefix(b"OFF\n4 4 6\n")
    for head in (b"OFF 4 4 6\n", b"OFF\n4 4 6\n", b"4 4 6\n", b"OFF4 4 0\n", b"# first\nOFF\n4 4\n"):
        assert read(head + rows, "off").mesh.volume == pytest.approx(1 / 6)


def test_text_keeps_the_digits_of_far_coordinates():
    file = read(PLY_TEXT.replace(b"1.000 0 0", b"5000000.123456 0 0"))
    moved = read(written(file.with_vertices(file.mesh.vertices + 0.001)))
    assert moved.mesh.vertices[1, 0] == 5000000.123456 + 0.001


def test_text_beyond_single_precision_is_read_in_double():
    file = read(PLY_TEXT.replace(b"1.000 0 0", b"1e300 0 0"))
    assert file.mesh.vertices[1, 0] == 1e300
    infinite = read(PLY_TEXT.replace(b"1.000 0 0", b"inf 0 0"))
    with pytest.raises(MeshError, match="1 of 5 vertices are not finite"):
        _ = infinite.mesh


def test_colours_beyond_all_bounds_are_cut():
    file = read(OBJ.replace(b"1.0 0.5 0.25", b"1e308 -1e308 nan"))
    colors = file.content().vertex_values
    assert [colors[name][0] for name in ("red", "green", "blue")] == [255, 0, 0]


def test_text_beyond_the_type_in_its_header_can_be_converted():
    for word in (b"nan", b"-inf", b"1e300"):
        file = read(PLY_TEXT.replace(b"0 0.10 0 255", b"0 0.10 0 " + word))
        assert len(file.content().vertex_values["red"]) == 5


def test_whole_number_positions_can_move_between_whole_numbers():
    for order in ("ascii", "binary_little_endian"):
        header = f"ply\nformat {order} 1.0\nelement vertex 3\nproperty short x\nproperty short y\nproperty int z\n"
        header += "property uchar tag\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        rows = [(0, 0, 0, 7), (10, 0, 0, 8), (0, 10, 0, 9)]
        if order == "ascii":
            body = "\n".join(" ".join(map(str, row)) for row in rows).encode() + b"\n3 0 1 2\n"
        else:
            table = np.array(rows, [("x", "<i2"), ("y", "<i2"), ("z", "<i4"), ("tag", "u1")])
            body = table.tobytes() + b"\3" + np.array([0, 1, 2], "<i4").tobytes()
        file = read(header.encode() + body)
        assert written(file) == header.encode() + body
        moved = read(written(file.with_vertices(file.mesh.vertices + 0.25)))
        assert np.array_equal(moved.positions, file.positions + 0.25)
        assert moved.content().vertex_values["tag"].tolist() == [7, 8, 9]


def chunks(data: bytes) -> dict[bytes, bytes]:
    found, at = {}, 12
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "little")
        found[data[at + 4 : at + 8]] = data[at + 8 : at + 8 + size]
        at += 8 + size
    return found


def test_glb_keeps_all_but_positions_normals_and_their_bounds():
    file = read(glb())
    moved = written(file.with_vertices(file.mesh.vertices * (1, 2, 3) + (0, 0, 0.5)))
    before, after = chunks(glb()), chunks(moved)
    old, new = json.loads(before[b"JSON"]), json.loads(after[b"JSON"])
    assert new["accessors"][0]["max"] == [1, 2, 0.5]
    assert new["accessors"][4]["min"] == [0, 0, 0.5]
    for document in (old, new):
        for accessor in document["accessors"]:
            accessor.pop("min", None)
            accessor.pop("max", None)
    assert old == new
    assert after[b"EXTR"] == before[b"EXTR"]
    assert after[b"BIN\0"][144:204] == before[b"BIN\0"][144:204]
    assert int.from_bytes(moved[8:12], "little") == len(moved)


def test_glb_closes_seams_and_keeps_meshes_apart():
    file = read(glb())
    assert file.welds.tolist() == [0, 1, 2, 1, 2, 3, 4, 5, 6, 7]
    assert np.allclose(file.mesh.face_normals[:, 2], (1, 1, -1, -1))
    assert file.parts.tolist() == [0] * 6 + [1] * 4


def test_glb_converts_with_its_transforms():
    content = read(glb()).content()
    assert content.positions.max(axis=0) == pytest.approx([6, 2, 0.1])
    assert len(content.polygons) == 6


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((b'"count": 4', b'"count": 9'), "past the 252 bytes"),
        ((b'"byteOffset": 12', b'"byteOffset": 8 '), "overlap"),
        ((b'"POSITION": 4', b'"POSITION": 8'), "IndexError"),
        ((b'"type": "VEC3"', b'"type": "VEC4"'), "is not VEC3"),
        ((b'"scene": 0,', b'"scene" 0, '), "not valid glTF"),
        ((b"glTF\2", b"glTF\1"), "version 1"),
    ],
)
def test_damaged_glb_is_explained(change, words):
    with pytest.raises(io.ReadError, match=words):
        read(glb().replace(*change), "glb")


def test_other_formats_go_through_trimesh(tmp_path):
    """A ZAE file is an archive with a COLLADA file in it; pycollada reads what is written as DAE."""
    pytest.importorskip("collada")
    ball = icosphere(1)
    io.write(io.from_arrays(ball.vertices, ball.faces), tmp_path / "ball.dae")
    with zipfile.ZipFile(tmp_path / "ball.zae", "w") as archive:
        archive.write(tmp_path / "ball.dae", "ball.dae")
    file = io.read(tmp_path / "ball.zae")
    assert written(file) == (tmp_path / "ball.zae").read_bytes()
    assert file.mesh.area == pytest.approx(ball.area)
    moved = file.with_vertices(file.mesh.vertices * 2)
    io.write(moved, tmp_path / "moved.ply")
    assert io.read(tmp_path / "moved.ply").mesh.area == pytest.approx(4 * ball.area)
    with pytest.raises(cn.OutputError, match="'zae' cannot be written"):
        io.write(moved, tmp_path / "moved.zae")
    with pytest.raises(io.ReadError, match="this zae file is a damaged archive"):
        read((tmp_path / "ball.zae").read_bytes()[:100], "zae")
    with pytest.raises(io.ReadError, match="no triangle mesh"):
        read(b"0 0 0\n1 0 0\n", "xyz")


def test_an_stl_without_facets_has_no_faces():
    with pytest.raises(MeshError, match="no faces"):
        _ = read(b"solid nothing\nendsolid nothing\n").mesh


def test_no_format_takes_a_vertex_beyond_its_limit():
    """Of positions that are single in some coordinates only, these are rounded."""
    far = 3000 + np.random.default_rng(0).normal(size=(300, 3))
    rows = np.zeros(300, [("x", "<f4"), ("y", "<f8"), ("z", "<f4")])
    for axis, name in enumerate(rows.dtype.names):
        rows[name] = far[:, axis]
    faces = np.zeros(100, [("n", "u1"), ("corners", "<i4", (3,))])
    faces["n"], faces["corners"] = 3, np.arange(300).reshape(-1, 3)
    header = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 300\nproperty float x\nproperty double y\n"
        "property float z\nelement face 100\nproperty list uchar int vertex_indices\nend_header\n"
    )
    file = read(header.encode() + rows.tobytes() + faces.tobytes())
    step = np.random.default_rng(1).normal(size=(300, 3))
    step *= 1e-4 / np.linalg.norm(step, axis=1, keepdims=True)
    after = written(file.with_vertices(file.mesh.vertices + step, limit=1e-4))
    moved = read(after).positions - file.positions
    assert moved.any() and np.linalg.norm(moved, axis=1).max() <= 1e-4


def test_what_obj_vertices_say_beyond_colours_is_named_when_it_is_left_out():
    faces = b"f 1 2 3\n"
    for rows, named in (
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", False),
        (b"v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\n", False),
        (b"v 0 0 0 2\nv 1 0 0 2\nv 0 1 0 2\n", True),
        (b"v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0\n", True),
    ):
        left_out = read(rows + faces).content().left_out
        assert any("further numbers of vertices" in what for what in left_out) == named


def test_runs_of_hashes_take_no_time():
    for line in (b"#" * 200, b"##\n" * 200):
        assert len(read(line + b"\n" + OBJ, "obj").positions) == len(read(OBJ).positions)
        assert read(line + b"\n" + OBJ).format == "obj"


@pytest.mark.parametrize("start", [b"OFF ", b"ply\n", b"glTF", b'{"asset"', b"# vtk DataFile", b"###", b"solid "])
def test_a_binary_stl_may_begin_as_any_other_file(start):
    data = stl_binary()
    assert read(start.ljust(80) + data[80:]).format == "stl"


@pytest.mark.parametrize("change", [(b"\nv ", b"\n\tv\t"), (b"\nv ", b"\n  V "), (b"\n", b"\r")])
def test_an_obj_is_known_however_it_is_spaced(change):
    data = b"\n" + b"\n".join(b"v %d %d %d" % p for p in TETRAHEDRON) + b"\nf 1 3 2\n"
    assert read(data.replace(*change)).format == "obj"


@pytest.mark.parametrize("content", [b"<!DOCTYPE html>\n<p>v 1 2 3</p>\n", b"\x1f\x8b\x08\x00", b"hello\n", b"# v\n"])
def test_what_is_no_obj_is_refused(content):
    with pytest.raises(io.ReadError, match="not an OBJ file"):
        read(content, "obj")


def test_colours_are_fractions_where_none_reaches_2():
    points = [b"0 0 0", b"1 0 0", b"0 1 0"]
    white_first = [b"1 1 1", b"1 1 1", b"0.5 0.25 5e-01"]
    for colors, expected in (
        (white_first, [[255, 255, 255], [255, 255, 255], [128, 64, 128]]),
        ([b"1 1 1"] * 3, [[255] * 3] * 3),
        ([b"255 128.0 2", b"1 0 0", b"0 0 1"], [[255, 128, 2], [1, 0, 0], [0, 0, 1]]),
    ):
        rows = [point + b" " + color for point, color in zip(points, colors, strict=True)]
        for data in (
            b"".join(b"v " + row + b"\n" for row in rows) + b"f 1 2 3\n",
            b"COFF\n3 1 0\n" + b"\n".join(rows) + b"\n3 0 1 2\n",
            b"STCOFF\n3 1 0\n" + b" 0.5 0.5\n".join(rows) + b" 0.5 0.5\n3 0 1 2\n",
        ):
            values = read(data).content().vertex_values
            assert np.stack([values[name] for name in ("red", "green", "blue")], axis=1).tolist() == expected
            assert "alpha" not in values


@pytest.mark.parametrize("word", [b"nan(ind)", b"-nan(ind)", b"1.#QNAN", b"-1.#INF", b"1.#IND00"])
def test_numbers_that_c_spells_as_none_are_vertices_that_are_not_finite(word):
    with pytest.raises(MeshError, match="1 of 4 vertices are not finite"):
        _ = read(OFF_TETRAHEDRON.replace(b"1 0 0", word + b" 0 0", 1)).mesh


def test_off_may_be_lower_case_and_speak_of_what_it_is_not():
    for head in (b"off", b"OFF # not BINARY"):
        assert read(OFF_TETRAHEDRON.replace(b"OFF", head)).mesh.volume == pytest.approx(1 / 6)


def test_polygons_that_no_corner_sees_whole_are_cut_into_ears():
    letter = np.array([(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)], float)  # U
    frame = np.array([(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)], float)  # a hole
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    for flat, area in ((letter, 7), (frame, 12), (letter[::-1], 7)):
        points = np.column_stack([flat, np.zeros(len(flat))]) @ turn.T
        for first in range(len(points)):
            triangles, owners = triangulate(points, Polygons.from_rows(np.roll(np.arange(len(points)), first)[None]))
            mesh = Mesh(points, triangles)
            assert len(owners) == len(points) - 2
            assert mesh.area == pytest.approx(area)
            assert np.linalg.norm(mesh.area_vectors.sum(axis=0)) == pytest.approx(area)  # none against another


def test_a_spiral_is_cut_whole():
    """The area is that of the shoelace formula; as many comparisons as corners squared take well below a second."""
    turn = np.linspace(0, 40 * np.pi, 2000)
    arm = np.column_stack([np.cos(turn), np.sin(turn)]) * turn[:, None]
    flat = np.concatenate([arm * (1 + 1 / (1 + turn[:, None])), arm[::-1]])
    (x, y), (u, v) = flat.T, np.roll(flat, -1, axis=0).T
    triangles, _ = triangulate(np.column_stack([flat, np.zeros(len(flat))]), Polygons.from_rows(np.arange(4000)[None]))
    (a, b), (c, d), (e, f) = (flat[triangles[:, k]].T for k in range(3))
    areas = ((c - a) * (f - b) - (e - a) * (d - b)) / 2
    assert areas.min() >= -1e-9 * areas.max()
    assert areas.sum() == pytest.approx((x * v - u * y).sum() / 2)
    assert len(np.unique(np.sort(triangles, axis=1), axis=0)) == 3998


def test_of_many_concave_polygons_each_is_cut():
    letter = np.array([(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)], float)
    points = np.concatenate([np.column_stack([letter + 4 * i, np.zeros(8)]) for i in range(300)])
    triangles, owners = triangulate(points, Polygons.from_rows(np.arange(len(points)).reshape(-1, 8)))
    areas = np.bincount(owners, Mesh(points, triangles).areas)
    np.testing.assert_allclose(areas, 7)


def test_a_polygon_that_crosses_itself_is_cut_somehow():
    star = np.array([(np.cos(2.4 * np.pi * i / 3), np.sin(2.4 * np.pi * i / 3), 0.0) for i in range(5)])
    for points in (star, np.full((5, 3), np.nan), np.zeros((5, 3))):
        triangles, _ = triangulate(points, Polygons.from_rows(np.arange(5)[None]))
        assert triangles.shape == (3, 3)


def test_strips_of_a_ply_count_where_its_faces_are_empty():
    header = b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    header += b"element face 0\nproperty list int int vertex_indices\n"
    header += b"element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    file = read(header + b"0 0 0\n0 1 0\n1 0 0\n1 1 0\n7 0 2 1 3 3 3 1\n")
    assert file.mesh.faces.tolist() == [[0, 2, 1], [1, 2, 3]]  # without what stitches strips together


@pytest.mark.parametrize("rest", [b"", b"\0\0", b"x" * 51])
def test_a_binary_stl_with_facet_in_its_header_and_bytes_behind_is_binary(rest):
    data = b"solid made by a facet".ljust(80) + stl_binary()[80:] + rest
    file = read(data)
    assert len(file.polygons) == 4
    moved = written(file.with_vertices(file.mesh.vertices + 1))
    assert moved[:80] == data[:80] and moved.endswith(rest) and len(moved) == len(data)


EXTRA = b"""ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
0 0 1
3 0 2 1
3 0 1 3
3 1 2 3
3 0 3 2
"""


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (b"1 0 0\n", b"1 0 0 9\n", "line 11 has 4 values, more than the header declares for a row of 'vertex'"),
        (b"3 0 1 3\n", b"3 0 1 3 0\n", "line 15 has 5 values, more than the header declares for a row of 'face'"),
        (b"3 0 2 1\n", b"3 0 2 1 255 0 0\n", "line 14 has 7 values"),
    ],
)
def test_a_ply_text_with_more_numbers_than_declared_is_refused_with_the_line(old, new, line):
    """Else the numbers of the next rows would be taken for others."""
    with pytest.raises(io.ReadError, match=line):
        read(EXTRA.replace(old, new))


def test_the_rows_of_a_ply_text_may_be_laid_out_in_any_way():
    expected = read(EXTRA).mesh
    head, end, rows = EXTRA.partition(b"end_header\n")
    for body in (rows.replace(b"\n", b" "), rows.replace(b" ", b"\n"), rows.replace(b"0\n1", b"0 1")):
        mesh = read(head + end + body).mesh
        assert np.array_equal(mesh.vertices, expected.vertices) and np.array_equal(mesh.faces, expected.faces)


def test_an_obj_whose_textured_faces_reference_missing_vertices_converts_isolated(tmp_path):
    """The corners of the other faces keep their texture coordinates and their normals."""
    text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0.1\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\nvn 0 0 1\nvn 0 1 0\n"
    faces = b"f 2/4/2 9/1/2 3/2/2 1/1/2\nf 1/1/1 2/2/1 3/3/1\nf 2/2/1 4/4/1 3/3/1\n"
    (tmp_path / "a.obj").write_bytes(text + faces)
    assert run(["denoise", str(tmp_path / "a.obj"), "-o", str(tmp_path / "b.ply"), "--on-bad", "isolate"]) == 0
    made = io.read(tmp_path / "b.ply")
    assert made.polygons.corners.tolist() == [0, 1, 2, 1, 3, 2]
    assert made.content().vertex_values["s"].tolist() == [0, 1, 0, 1]
    file = read(text + faces).isolating()
    moved = written(file.with_vertices(file.mesh.vertices * 2)).split(b"\n")
    assert b"vn 0 1 0" in moved  # of the face that is left as it is
