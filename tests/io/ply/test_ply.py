"""PLY files keep all that they hold in the types that their headers declare."""

from io import BytesIO

import numpy as np
import pytest
import trimesh
from sample_files import PLY_TEXT, read, written
from shapes import icosphere

from cascadenorm import io


def test_only_coordinates_that_differ_are_written_anew():
    file = read(PLY_TEXT)
    vertices = file.mesh.vertices.copy()
    vertices[0, 0] = 0.1
    assert written(file.with_vertices(vertices)) == PLY_TEXT.replace(b"\n0 0.10 0", b"\n0.1 0.10 0")


def test_ply_strips_alternate():
    header = b"ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
    header += b"element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    points = b"0 0 0\n0 1 0\n1 0 0\n1 1 0\n2 0 0\n2 1 0\n"
    file = read(header + points + b"10 0 2 1 3 -1 2 4 3 5 -1\n")
    assert file.mesh.faces.tolist() == [[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]]
    assert np.allclose(file.mesh.face_normals, (0, 0, 1))


def test_strips_of_a_ply_count_where_its_faces_are_empty():
    header = b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    header += b"element face 0\nproperty list int int vertex_indices\n"
    header += b"element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    file = read(header + b"0 0 0\n0 1 0\n1 0 0\n1 1 0\n7 0 2 1 3 3 3 1\n")
    assert file.mesh.faces.tolist() == [[0, 2, 1], [1, 2, 3]]  # without what stitches strips together


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


@pytest.mark.parametrize(("kind", "one", "new"), [("char", 127, 90), ("short", 32767, 23170), ("uchar", 255, None)])
@pytest.mark.parametrize("encoding", ["ascii", "binary_big_endian"])
def test_normals_in_whole_numbers_keep_their_scale(kind, one, new, encoding):
    properties = "".join(f"property {kind} n{axis}\n" for axis in "xyz")
    header = f"ply\nformat {encoding} 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    header += f"{properties}element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], float)
    if encoding == "ascii":
        body = b"".join(b"%d %d %d 0 0 %d\n" % (*row, one) for row in corners.tolist()) + b"3 0 1 2\n"
    else:
        table = np.zeros(3, [("place", ">f4", 3), ("normal", {"char": ">i1", "short": ">i2", "uchar": ">u1"}[kind], 3)])
        table["place"], table["normal"][:, 2] = corners, one
        body = table.tobytes() + b"\3" + np.arange(3, dtype=">i4").tobytes()
    corners[1, 2] = 1  # the normal is now (-1, 0, 1) / sqrt(2)
    moved = written(read(header.encode() + body).with_vertices(corners))
    values = read(moved).content().vertex_values
    normals = np.stack([values[name] for name in ("nx", "ny", "nz")], axis=1)
    assert normals.tolist() == [[0, 0, one] if new is None else [-new, 0, new]] * 3
    if encoding == "ascii":
        assert [list(map(int, row.split()[3:])) for row in moved.splitlines()[-4:-1]] == normals.tolist()


@pytest.mark.parametrize("encoding", ["binary", "ascii"])
def test_integers_of_eight_bytes_as_trimesh_writes_them_are_kept(encoding):
    ball = icosphere(1)
    mesh = trimesh.Trimesh(ball.vertices, ball.faces, process=False)
    mesh.vertex_attributes["label"] = 2**40 + np.arange(len(ball.vertices))
    mesh.face_attributes["part"] = np.arange(len(ball.faces), dtype=np.uint64)
    data = mesh.export(file_type="ply", encoding=encoding)
    assert b"property int64 label" in data and b"property uint64 part" in data
    file = read(data)
    assert file.content().vertex_values["label"].tolist() == mesh.vertex_attributes["label"].tolist()
    moved = trimesh.load(BytesIO(written(file.with_vertices(2 * file.mesh.vertices))), "ply", process=False)
    np.testing.assert_array_equal(moved.vertices, 2 * file.positions)
    raw = moved.metadata["_ply_raw"]
    assert raw["vertex"]["data"]["label"].ravel().tolist() == mesh.vertex_attributes["label"].tolist()
    assert raw["face"]["data"]["part"].ravel().tolist() == mesh.face_attributes["part"].tolist()


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
