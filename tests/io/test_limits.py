"""Files that announce more than they hold are refused before memory is taken for it."""

import json
import re
import zlib
from base64 import b64encode

import numpy as np
import pytest
from shapes import icosphere
from xml_files import MODEL, archive

import cascadenorm as cn
from cascadenorm.io import ReadError
from cascadenorm.io.limits import ALWAYS, VARIABLE, check_expansion, expansion_limit

COLLADA = (
    '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>'
    "<created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified></asset><library_geometries>"
    '<geometry id="g"><mesh><source id="p"><float_array id="pa" count="9">0 0 0 1 0 0 0 1 0</float_array>'
    '<technique_common><accessor source="#pa" count="3" stride="3"><param name="X" type="float"/>'
    '<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>'
    '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices><polylist count="1">'
    '<input semantic="VERTEX" source="#v" offset="0"/><vcount>%s</vcount><p>0 1 2</p></polylist></mesh></geometry>'
    '</library_geometries><library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node>'
    '</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>'
)


def instances(count: int) -> bytes:
    """Return a GLB of one ball that many primitives share."""
    ball = icosphere(4)
    parts = ball.vertices.astype("<f4").tobytes(), ball.faces.astype("<u4").tobytes()
    document = {
        "asset": {"version": "2.0"},
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}] * count}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": len(ball.vertices)},
            {"bufferView": 1, "componentType": 5125, "type": "SCALAR", "count": ball.faces.size},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(parts[0])},
            {"buffer": 0, "byteOffset": len(parts[0]), "byteLength": len(parts[1])},
        ],
        "buffers": [
            {
                "byteLength": sum(map(len, parts)),
                "uri": "data:application/octet-stream;base64," + b64encode(b"".join(parts)).decode(),
            }
        ],
    }
    return json.dumps(document).encode()


def grid(count: int) -> bytes:
    """Return a VTU file with a compressed array of zeros beside a triangle."""

    def packed(values) -> str:
        raw = values.tobytes()
        block = zlib.compress(raw)
        head = np.array([1, len(raw), len(raw), len(block)], "<u4").tobytes()
        return b64encode(head).decode() + b64encode(block).decode()

    def array(name: str, values, extra: str = "") -> str:
        kind = {"f8": "Float64", "i8": "Int64", "u1": "UInt8"}[values.dtype.str[1:]]
        return f'<DataArray type="{kind}" Name="{name}" format="binary" {extra}>{packed(values)}</DataArray>'

    points = array("Points", np.array([0, 0, 0, 1, 0, 0, 0, 1, 0], "<f8"), 'NumberOfComponents="3"')
    cells = [
        array("connectivity", np.arange(3, dtype="<i8")),
        array("offsets", np.array([3], "<i8")),
        array("types", np.array([5], "u1")),
    ]
    return (
        '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian" header_type="UInt32" '
        'compressor="vtkZLibDataCompressor"><UnstructuredGrid>'
        "<FieldData>" + array("zeros", np.zeros(count)) + '</FieldData><Piece NumberOfPoints="3" NumberOfCells="1">'
        f"<Points>{points}</Points><Cells>{''.join(cells)}</Cells></Piece></UnstructuredGrid></VTKFile>"
    ).encode()


CASES = {
    "a count of corners": ("dae", (COLLADA % "999999999").encode()),
    "counts in an archive": ("3mf", archive(MODEL % "", padding=150_000_000)),
    "a compressed array": ("vtu", grid(20_000_000)),
    "a shared accessor": ("gltf", instances(2000)),
    "the sides of a grid": (
        "vtk",
        b"# vtk DataFile Version 4.2\nt\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 9999 9999 1\nORIGIN 0 0 0\n"
        b"SPACING 1 1 1\n",
    ),
    "the range of a set": (
        "inp",
        b"*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n*ELEMENT, TYPE=S3\n1, 1, 2, 3\n"
        b"*ELSET, ELSET=all, GENERATE\n1, 5000000, 1\n",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_what_is_announced_is_held_against_the_size_of_the_file(name, tmp_path):
    extension, data = CASES[name]
    assert len(data) < 1_000_000
    path = tmp_path / f"a.{extension}"
    path.write_bytes(data)
    with pytest.raises(
        ReadError, match=f"more than 200 times the size of the file: if it can be trusted, set .*{VARIABLE}"
    ):
        cn.read(path)


def test_the_same_files_are_read_where_they_announce_what_they_hold(tmp_path):
    item = '<item objectid="1"/>'
    sound = {"dae": COLLADA % "3", "3mf": archive(MODEL % item), "vtu": grid(10), "gltf": instances(3)}
    sound["inp"] = CASES["the range of a set"][1].replace(b"5000000", b"1")
    for extension, data in sound.items():
        path = tmp_path / f"a.{extension}"
        path.write_bytes(data if isinstance(data, bytes) else data.encode())
        assert len(cn.read(path).mesh.faces) == (5120 * 3 if extension == "gltf" else 1)


def test_the_limit_can_be_raised(tmp_path, monkeypatch):
    path = tmp_path / "a.3mf"
    path.write_bytes(archive(MODEL % '<item objectid="1"/>', padding=150_000_000))
    monkeypatch.setenv(VARIABLE, "10000")
    assert len(cn.read(path).mesh.faces) == 1


def test_small_files_may_expand_to_a_fixed_size_and_large_ones_by_a_factor(monkeypatch):
    assert expansion_limit(10) == ALWAYS and expansion_limit(ALWAYS) == 200 * ALWAYS
    check_expansion(ALWAYS, 10, "they")
    with pytest.raises(ReadError, match="they need 100 MB"):
        check_expansion(ALWAYS + 1, 10, "they")
    monkeypatch.setenv(VARIABLE, "many")
    with pytest.raises(cn.ParameterError, match=re.escape(f"{VARIABLE} is 'many'; it must be a number of at least 1")):
        expansion_limit(10)
