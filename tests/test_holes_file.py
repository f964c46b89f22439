import pytest
from shapes import icosphere

import cascadenorm as cn
from cascadenorm.api import as_mesh, save_mesh
from cascadenorm.cli import run


def test_a_holed_file_comes_back_closed(tmp_path, capsys):
    sphere = icosphere(3)
    source = tmp_path / "holed.ply"
    save_mesh(source, cn.Mesh(sphere.vertices, sphere.faces[sphere.centroids[:, 2] < 0.9]))
    assert run(["fill-holes", str(source)]) == 0
    filled = as_mesh(tmp_path / "holed_filled.ply")
    assert filled.topology.edge_faces.counts.min() == filled.topology.edge_faces.counts.max() == 2
    assert filled.volume == pytest.approx(sphere.volume, rel=0.01)
    assert "faces added" in capsys.readouterr().out


def test_an_existing_output_stays(tmp_path, capsys):
    source = tmp_path / "mesh.obj"
    save_mesh(source, icosphere(1))
    before = source.read_bytes()
    assert run(["fill-holes", str(source), "-o", str(source)]) == 5
    assert source.read_bytes() == before
    assert "exists already" in capsys.readouterr().err
