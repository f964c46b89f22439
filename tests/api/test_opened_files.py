"""Files keep what is bad in them byte for byte, and say what was left out."""

import io

import numpy as np
import pytest
import trimesh
from spoiled import BALL, COUNT, ply, spoiled

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh, isolated

METHOD = {"method": "bilateral-normal"}


def test_only_by_a_material_among_bad_faces(tmp_path):
    vertices, faces, touched = spoiled()
    steel = np.arange(len(faces)) % 40 < 30
    rows, *lines = obj(vertices, faces).split(b"\nf ")
    for line, of_steel in zip(lines, steel, strict=True):
        rows += (b"\nusemtl steel\nf " if of_steel else b"\nusemtl wood\nf ") + line
    (tmp_path / "bad.obj").write_bytes(rows)
    cn.denoise_file(tmp_path / "bad.obj", tmp_path / "out.obj", on_bad="isolate", only="steel", **METHOD)
    before = cn.read(tmp_path / "bad.obj").positions
    expected = cn.denoise(isolated(before, faces), only=steel[~touched], **METHOD).vertices
    good = np.isfinite(before).all(axis=1)
    assert cn.read(tmp_path / "out.obj").positions[good].tobytes() == expected[good].tobytes()
    assert (expected[good] != before[good]).any()


def obj(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    lines = ["# kept", *("v " + " ".join(map(repr, row.tolist())) for row in vertices), "vn 0 0 1"]
    return "\n".join([*lines, *("f " + " ".join(f"{i}//1" for i in face + 1) for face in faces), ""]).encode()


def off(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    rows = [" ".join(map(repr, row.tolist())) for row in vertices]
    return "\n".join(
        ["OFF", f"{len(rows)} {len(faces)} 0", *rows, *("3 " + " ".join(map(str, f)) for f in faces), ""]
    ).encode()


BY_FORMAT = {
    "ply": lambda v, f: ply("binary_little_endian", v, f),
    "ascii.ply": lambda v, f: ply("ascii", v, f),
    "obj": obj,
    "off": off,
}


@pytest.mark.parametrize("name", BY_FORMAT)
def test_files_keep_what_is_bad_byte_for_byte(tmp_path, name):
    vertices, faces, touched = spoiled()
    if name == "obj":
        faces[51, 0] = COUNT + 5  # a negative number counts backwards in OBJ
    source, output = tmp_path / f"bad.{name}", tmp_path / f"out.{name}"
    source.write_bytes(BY_FORMAT[name](vertices, faces))
    with pytest.raises(cn.MeshError, match="isolate"):
        cn.denoise_file(source, output, **METHOD)
    done = cn.denoise_file(source, output, on_bad="isolate", **METHOD)
    assert (done.isolated_vertices, done.isolated_faces) == (2, touched.sum())
    assert (done.vertices, done.faces, done.moved) == (COUNT, (~touched).sum(), 160)
    read = cn.read(output)
    wanted = cn.denoise(vertices, faces, on_bad="isolate", **METHOD)
    np.testing.assert_array_equal(read.positions, wanted)
    np.testing.assert_array_equal(read.polygons.corners.reshape(-1, 3), faces)
    if name == "ply":
        before, after = (
            np.frombuffer(path.read_bytes()[-len(faces) * 13 - COUNT * 49 :], np.uint8) for path in (source, output)
        )
        rows = [data[: COUNT * 49].reshape(-1, 49) for data in (before, after)]
        np.testing.assert_array_equal(rows[0][[7, 30]][:, :24], rows[1][[7, 30]][:, :24])
        np.testing.assert_array_equal(before[COUNT * 49 :], after[COUNT * 49 :])
        normals = rows[1][:, 24:48].copy().view(np.float64)
        assert np.isfinite(normals).all()
        np.testing.assert_allclose(np.linalg.norm(np.delete(normals, [7, 30], axis=0), axis=1), 1)
    else:
        lines = [path.read_bytes().split(b"\n") for path in (source, output)]
        assert len(lines[0]) == len(lines[1])
        same = [a == b for a, b in zip(*lines, strict=True)]
        first = lines[0].index(next(line for line in lines[0] if b"nan" in line)) - 7
        assert same[first + 7] and same[first + 30] and all(same[-len(faces) - 1 :])


def stl(corners: np.ndarray) -> bytes:
    record = np.zeros(len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    record["corners"], record["normal"], record["attribute"] = corners, (0, 0, 1), 77
    return bytes(80) + len(record).to_bytes(4, "little") + record.tobytes()


def test_in_stl_a_seam_beside_a_bad_facet_does_not_open(tmp_path):
    corners = BALL.vertices.astype(np.float32)[BALL.faces]
    corners[5, 1, 2] = np.nan
    source, output = tmp_path / "bad.stl", tmp_path / "out.stl"
    source.write_bytes(stl(corners))
    done = cn.denoise_file(source, output, on_bad="isolate", **METHOD)
    assert done.isolated_faces == 1 and done.isolated_vertices == 1
    before, after = cn.read(source), cn.read(output)
    assert after.positions[16].tobytes() == before.positions[16].tobytes()
    assert after._records["normal"][5].tolist() == [0, 0, 1]
    np.testing.assert_array_equal(after.isolating().welds, before.isolating().welds)
    assert np.isfinite(after._records["normal"]).all()


def test_the_bounds_in_a_glb_stay_finite(tmp_path):
    data = bytearray(trimesh.Trimesh(BALL.vertices, BALL.faces, process=False).export(file_type="glb"))
    place = data.index(BALL.vertices.astype("<f4")[7].tobytes())
    data[place : place + 4] = np.float32(np.nan).tobytes()
    source, output = tmp_path / "bad.glb", tmp_path / "out.glb"
    source.write_bytes(data)
    assert cn.denoise_file(source, output, on_bad="isolate", **METHOD).isolated_vertices == 1
    file = cn.read(output)
    assert file.positions[7].tobytes() == cn.read(source).positions[7].tobytes()
    (accessor,) = [a for a in file._document["accessors"] if a["type"] == "VEC3"]
    good = np.delete(file.positions, 7, axis=0).astype(float)
    assert (accessor["min"], accessor["max"]) == (good.min(axis=0).tolist(), good.max(axis=0).tolist())


@pytest.mark.parametrize(
    ("spoil", "unchanged", "lost"),
    [
        ("v 9 9 nan\n", "left unchanged: 1 vertex that is not finite\n", None),
        ("f 1 2 99\n", "left unchanged: 1 bad face\n", "1 face that references a vertex that does not exist"),
    ],
)
def test_only_what_is_bad_is_counted(tmp_path, capsys, spoil, unchanged, lost):
    rows = ["v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 1", "f 1 3 2", "f 1 2 4", "f 2 3 4", "f 1 4 3"]
    (tmp_path / "a.obj").write_text("\n".join(rows) + "\n" + spoil, encoding="ascii")
    words = ["denoise", str(tmp_path / "a.obj"), "-o", str(tmp_path / "a.ply"), "--method", "laplacian"]
    assert run([*words, "--on-bad", "isolate"]) == 0
    err = capsys.readouterr().err
    assert unchanged in err and (lost is None or lost in err)


def test_conversion_leaves_out_faces_that_name_nothing_and_says_so(tmp_path, capsys):
    vertices, faces, touched = spoiled()
    source = tmp_path / "bad.ply"
    source.write_bytes(ply("binary_little_endian", vertices, faces))
    for suffix in ("off", "obj", "stl"):
        output = tmp_path / f"out.{suffix}"
        assert run(["denoise", str(source), "-o", str(output), "--method", "laplacian", "--on-bad", "isolate"]) == 0
        err = capsys.readouterr().err
        assert f"left unchanged: 2 vertices that are not finite, {touched.sum()} bad faces" in err
        assert "2 faces that reference vertices that do not exist" in err
        assert len(cn.read(output).polygons) == len(faces) - 2


def test_the_command_names_the_choice(tmp_path, capsys):
    save_mesh(tmp_path / "ball.ply", BALL)
    assert run(["denoise", str(tmp_path / "ball.ply"), "--on-bad", "drop"]) == 2
    assert "--on-bad is 'drop'" in capsys.readouterr().err


def test_the_way_out_is_spelled_as_where_it_is_asked_for(tmp_path, capsys):
    vertices, faces, _ = spoiled()
    not_finite, out_of_range = tmp_path / "bad.ply", tmp_path / "named.ply"
    not_finite.write_bytes(ply("ascii", vertices, BALL.faces))
    out_of_range.write_bytes(ply("ascii", BALL.vertices, faces))
    for source in (not_finite, out_of_range):
        with pytest.raises(cn.MeshError, match="or denoise with on_bad='isolate'"):
            cn.denoise(source)
        assert run(["denoise", str(source)]) == 4
        err = capsys.readouterr().err
        assert "or denoise with --on-bad isolate" in err and "on_bad" not in err
        assert run(["compare", str(source), str(source)]) == 4  # it has no such option
        err = capsys.readouterr().err
        assert "on-bad" not in err and "on_bad" not in err


def test_what_is_left_out_depends_on_the_settings_of_the_file():
    file = cn.read(io.BytesIO(b"OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\nnan 0 0\n3 0 1 2\n3 0 1 3\n"))
    assert file.left_out.tolist() == [False, False]
    assert file.isolating().left_out.tolist() == [False, True]


def test_a_file_without_vertices_is_refused():
    with pytest.raises(cn.MeshError, match="none of the 2 faces"):
        _ = cn.read(io.BytesIO(b"OFF\n0 1 0\n4 0 1 2 3\n")).isolating().mesh


def test_a_file_that_is_sound_is_written_as_ever(tmp_path):
    save_mesh(tmp_path / "ball.ply", Mesh(BALL.vertices, BALL.faces))
    cn.denoise_file(tmp_path / "ball.ply", tmp_path / "a.ply", **METHOD)
    done = cn.denoise_file(tmp_path / "ball.ply", tmp_path / "b.ply", on_bad="isolate", **METHOD)
    assert (done.isolated_vertices, done.isolated_faces) == (0, 0)
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()
