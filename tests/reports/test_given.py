"""A true mesh is read and checked before any other work."""

import pytest

from cascadenorm.cli import run


@pytest.mark.parametrize("truth", ["lost.ply", "points.obj"])
def test_a_true_mesh_that_cannot_be_used_is_refused_before_any_work(place, capsys, truth):
    (place / "points.obj").write_text("v 0 0 0\nv 1 0 0\n")
    words = ["denoise", "rough.ply", "-o", "out.ply", "--method", "laplacian", "--report", "r.html", "--truth", truth]
    assert run(words) == (3 if truth == "lost.ply" else 4)
    assert truth in capsys.readouterr().err
    assert not (place / "out.ply").exists() and not (place / "r.html").exists()
