"""Public sets of pairs."""

import json
from dataclasses import replace

import numpy as np
import pytest
from evaluated import SHAPES
from shapes import noisy

from cascadenorm.cli import run
from cascadenorm.errors import ParameterError
from cascadenorm.evaluation import public_sets
from cascadenorm.evaluation.harness import evaluate
from cascadenorm.evaluation.public_sets import public_pairs
from cascadenorm.io import ReadError
from cascadenorm.io.interop import save_mesh


@pytest.fixture
def archive(tmp_path):
    """A copy of a set that has many files, with one clean mesh for tests and one for a training."""
    for split, name in (("test", "ball"), ("train", "cube")):
        for kind in ("noisy", "original"):
            (tmp_path / "Synthetic" / split / kind).mkdir(parents=True)
        save_mesh(tmp_path / "Synthetic" / split / "original" / f"{name}.obj", SHAPES[name])
        for level in (1, 2):
            mesh = noisy(SHAPES[name], level / 10)
            save_mesh(tmp_path / "Synthetic" / split / "noisy" / f"{name}_n{level}.obj", mesh)
    return tmp_path


def test_pairs_of_a_public_set_are_split_as_in_its_paper(archive):
    pairs = public_pairs("synthetic", archive)
    assert [pair.name for pair in pairs] == ["ball_n1", "ball_n2"]
    assert {pair.clean.name for pair in pairs} == {"ball.obj"}
    assert [pair.name for pair in public_pairs("synthetic", archive / "Synthetic", split="train")] == [
        "cube_n1",
        "cube_n2",
    ]
    done = evaluate(pairs, methods="bilateral-normal")
    assert [one.pair for one in done.results] == ["ball_n1", "ball_n1", "ball_n2", "ball_n2"]
    with pytest.raises(ReadError, match=r"has no folder Kinect_v1/test: get the set: https://github\.com/"):
        public_pairs("kinect-v1", archive)
    (archive / "Synthetic" / "test" / "original" / "ball.obj").unlink()
    with pytest.raises(ReadError, match=r"has no clean mesh original/ball\.obj"):
        public_pairs("synthetic", archive)


def test_listed_pairs_are_checked_by_digests_that_no_format_changes(tmp_path, monkeypatch):
    for name, mesh in (("n", noisy(SHAPES["ball"], 0.2)), ("c", SHAPES["ball"])):
        single = mesh.moved(mesh.vertices.astype(np.float32).astype(float))
        for suffix in ("obj", "ply", "off"):
            save_mesh(tmp_path / f"{name}.{suffix}", single)
    digests = tuple(public_sets.geometry_digest(tmp_path / f"{name}.obj") for name in "nc")
    assert (
        digests == tuple(public_sets.geometry_digest(tmp_path / f"{name}.ply") for name in "nc")
        and len(set(digests)) == 2
    )
    guided = replace(
        public_sets.PUBLIC_SETS["guided"], listed={"ball": public_sets.KnownPair("n.off", "c.ply", digests)}
    )
    monkeypatch.setitem(public_sets.PUBLIC_SETS, "guided", guided)
    assert [pair.name for pair in public_pairs("guided", tmp_path)] == ["ball"]
    with pytest.raises(ParameterError, match="the set guided has only a test split"):
        public_pairs("guided", tmp_path, split="train")
    save_mesh(tmp_path / "n.off", SHAPES["ball"], force=True)
    with pytest.raises(ReadError, match=r"n\.off differs from the published mesh"):
        public_pairs("guided", tmp_path)
    (tmp_path / "n.off").unlink()
    with pytest.raises(ReadError, match=r"n\.off is missing: get the set: git clone"):
        public_pairs("guided", tmp_path)


def test_the_command_says_where_public_sets_are_and_evaluates_a_copy(archive, capsys):
    assert run(["evaluate", "--dataset", "list"]) == 0
    text = capsys.readouterr().out
    assert all(f"{name}: " in text and one.place in text for name, one in public_sets.PUBLIC_SETS.items())
    assert run(["evaluate", "--dataset", "synthetic"]) == 2
    assert "to get one: https://github.com/zhangyk18/GeoBi-GNN" in capsys.readouterr().err
    assert run(["evaluate", "--dataset", "sintetic", "--from", str(archive)]) == 2
    assert run(["evaluate", "--from", str(archive)]) == 2 and run(["evaluate"]) == 2
    words = ["evaluate", "--dataset", "synthetic", "--from", str(archive), "--method", "bilateral-normal", "--json"]
    capsys.readouterr()
    assert run(words) == 0
    assert {row["pair"] for row in json.loads(capsys.readouterr().out)["results"]} == {"ball_n1", "ball_n2"}
