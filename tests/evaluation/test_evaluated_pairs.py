"""Pairs, found in folders or made from seeds."""

import shutil

import numpy as np
import pytest
from evaluated import SHAPES

import cascadenorm as cn
from cascadenorm.api.training_pairs import write_pairs
from cascadenorm.errors import ParameterError
from cascadenorm.evaluation import tables
from cascadenorm.evaluation.harness import evaluate
from cascadenorm.io import OutputError, ReadError
from cascadenorm.io.pairs import find_pairs


def test_pairs_are_found_in_a_folder_and_in_the_folders_in_it(folder, tmp_path):
    assert [pair.name for pair in find_pairs([folder])] == ["ball", "cube"]
    assert [pair.name for pair in find_pairs([folder / "cube", folder / "ball"])] == ["cube", "ball"]
    assert [pair.name for pair in find_pairs([folder, folder / "ball"])] == ["ball", "cube"]
    other = shutil.copytree(folder / "ball", tmp_path / "ball")
    both = [pair.name for pair in find_pairs([folder, other])]
    assert both == [str(folder / "ball"), str(folder / "cube"), str(other)]


def test_pairs_from_several_places_that_have_one_name_are_refused(folder):
    (ball, cube) = find_pairs(folder)
    for given in ([cube._replace(name="ball"), ball], [cube._replace(name="ball"), folder]):
        with pytest.raises(ReadError, match="2 pairs are named ball: rename one"):
            evaluate(given, methods=[])


def test_folders_without_pairs_are_refused(folder, tmp_path):
    with pytest.raises(ReadError, match="is not a folder"):
        find_pairs([folder / "absent"])
    with pytest.raises(ReadError, match="holds no pairs"):
        find_pairs([folder / "notes"])
    with pytest.raises(ReadError, match="there are no pairs"):
        evaluate([])
    (tmp_path / "noisy.ply").touch()
    with pytest.raises(ReadError, match=r"holds noisy\.ply only"):
        find_pairs([tmp_path])
    (tmp_path / "clean.gltf").touch()
    for beside in ("noisy.mtl", "clean.bin", "clean.png"):  # what a mesh file names is none itself
        (tmp_path / beside).touch()
    assert [(pair.noisy.name, pair.clean.name) for pair in find_pairs([tmp_path])] == [("noisy.ply", "clean.gltf")]
    (tmp_path / "noisy.obj").touch()
    with pytest.raises(ReadError, match=r"holds 2 files noisy\.\*"):
        find_pairs([tmp_path])


def test_generated_pairs_can_be_evaluated_and_repeat(tmp_path):
    for name in ("one", "two"):
        write_pairs(str(tmp_path / name), count=1, seed=3)
    (pair,), (again,) = find_pairs([tmp_path / "one"]), find_pairs([tmp_path / "two"])
    assert pair.noisy.read_bytes() == again.noisy.read_bytes()
    done = evaluate([tmp_path / "one"], methods=[])
    assert done.results[0].measures.normal_error_deg > 0
    with pytest.raises(OutputError, match="is not empty"):
        write_pairs(tmp_path / "one", count=1, seed=3)
    with pytest.raises(OutputError, match="is a file"):
        write_pairs(pair.noisy, count=1, seed=3)
    assert np.isfinite(done.means[0].measures.vertex_error_edges)


def test_noise_from_seeds_replaces_the_noisy_meshes_and_the_spread_is_told(folder, tmp_path):
    done = evaluate(folder, methods="bilateral-normal", noise=0.2, seeds=3, keep=tmp_path)
    assert [pair.name for pair in done.pairs][:3] == ["ball-seed0", "ball-seed1", "ball-seed2"]
    clean = SHAPES["ball"]
    made = [cn.read(pair.noisy).mesh for pair in done.pairs[:3]]
    offsets = [np.einsum("ij,ij->i", mesh.vertices - clean.vertices, clean.vertex_normals) for mesh in made]
    for offset in offsets:
        assert offset.std() == pytest.approx(0.2 * clean.mean_edge_length, rel=0.15)
    assert abs(np.corrcoef(offsets)[0, 1]) < 0.3
    means = [
        np.mean([one.measures.normal_error_deg for one in done.results if one.method == "bilateral-normal"
                 and done.seeds[one.pair] == seed])
        for seed in range(3)
    ]  # fmt: skip
    table = tables.all_tables(done)[-1]
    assert table.title == "Mean ± standard deviation over 3 seeds"
    assert table.rows[1][:2] == (
        ("bilateral-normal", False),
        (f"{np.mean(means):.3f} ± {np.std(means, ddof=1):.3f}", False),
    )
    assert "$\\pm$" in tables.latex([table])
    again = evaluate(folder, methods="bilateral-normal", noise=0.2, seeds=1)
    assert again.results[1].measures == done.results[1].measures
    assert len(tables.all_tables(again)) == 2


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"noise": -1.0}, "noise is -1.0; it must be at least 0"),
        ({"noise": float("nan")}, "noise is nan; it must be at least 0"),
        ({"seeds": 3}, "seeds is 3; it must be 1 without noise"),
        ({"noise": 0.1, "seeds": 0}, "seeds is 0; it must be at least 1"),
    ],
)
def test_noise_and_seeds_out_of_range_are_refused(folder, wrong, words):
    with pytest.raises(ParameterError, match=words):
        evaluate(folder, methods="bilateral-normal", **wrong)
