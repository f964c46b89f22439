"""Methods on pairs of a noisy and a clean mesh."""

import errno
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from evaluated import COPY, SHAPES, python
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.errors import MissingDependencyError, ParameterError
from cascadenorm.evaluation import harness, runs, tables
from cascadenorm.evaluation.harness import NOISY, evaluate
from cascadenorm.geometry.metrics import measure
from cascadenorm.io import ReadError
from cascadenorm.io.interop import save_mesh
from cascadenorm.io.pairs import find_pairs
from cascadenorm.learned.methods import shipped


def test_measures_are_those_of_the_denoised_mesh(folder):
    done = evaluate([folder], methods=["bilateral-normal"], parameters={"iterations": "0", "sweeps": 0})
    assert [(r.pair, r.method) for r in done.results] == [
        (name, method) for name in SHAPES for method in (NOISY, "bilateral-normal")
    ]
    for result in done.results:  # no passes, no sweeps: the method gives back what it got
        assert result.measures == measure(noisy(SHAPES[result.pair], 0.2), SHAPES[result.pair])
    assert done.failures == []


def test_means_are_over_the_pairs(folder):
    done = evaluate([folder], methods=["bilateral-normal"])
    errors = [r.measures.normal_error_deg for r in done.results]
    assert [mean.measures.normal_error_deg for mean in done.means] == [
        pytest.approx((errors[0] + errors[2]) / 2),
        pytest.approx((errors[1] + errors[3]) / 2),
    ]
    assert errors[1] < 0.6 * errors[0] and errors[3] < 0.6 * errors[2]


def test_one_folder_and_one_method_need_no_list(folder):
    done = evaluate(str(folder / "ball"), methods="laplacian")
    assert [(r.pair, r.method) for r in done.results] == [("ball", NOISY), ("ball", "laplacian")]


def test_progress_counts_all_parts_once(folder):
    seen = []
    evaluate([folder, folder / "ball"], methods=["laplacian", "laplacian"], progress=lambda *what: seen.append(what))
    assert seen == [
        ("evaluating", 0, 4, "ball: noisy"),
        ("evaluating", 1, 4, "ball: laplacian"),
        ("evaluating", 2, 4, "cube: noisy"),
        ("evaluating", 3, 4, "cube: laplacian"),
        ("evaluating", 4, 4),
    ]


def test_one_bad_pair_does_not_end_the_evaluation(folder, tmp_path):
    for pair in ("a_bad", "b_good"):
        (tmp_path / pair).mkdir()
        for half in ("noisy.ply", "clean.ply"):
            (tmp_path / pair / half).write_bytes((folder / "ball" / half).read_bytes())
    (tmp_path / "a_bad" / "noisy.ply").write_bytes(b"ply\nrubbish")
    done = evaluate([tmp_path], methods=["laplacian"])
    assert [result.pair for result in done.results] == ["b_good", "b_good"]
    assert [(failure.pair, failure.method) for failure in done.failures] == [("a_bad", None)]
    assert "noisy.ply" in str(done.failures[0].error)


@pytest.mark.parametrize("wrong", [{"strength": -1.0}, {"strength": np.inf}, {"threads": 0}])
def test_wrong_strength_and_threads_are_refused_before_any_work(folder, wrong):
    with pytest.raises(ParameterError, match=next(iter(wrong))):
        evaluate([folder], methods=["laplacian"], **wrong)


def test_unknown_methods_and_parameters_are_refused_before_any_work(folder):
    with pytest.raises(ParameterError, match="there is no method 'magic'"):
        evaluate([folder / "absent"], methods=["magic"])
    with pytest.raises(ParameterError, match="laplacian has no parameter 'wings'"):
        evaluate([folder / "absent"], methods=["laplacian"], parameters={"wings": 1})


def test_weights_are_checked_before_any_work_and_may_be_a_loaded_model(folder, tmp_path):
    for wrong in (tmp_path / "absent", folder / "ball" / "noisy.ply"):
        with pytest.raises(ParameterError, match="weights"):
            evaluate(folder, methods="auto", parameters={"model": wrong}, keep=tmp_path / "kept")
    given = {"model": shipped("cascade")}
    done = [evaluate(folder / "ball", methods="cascade", parameters=given, keep=tmp_path / "kept") for _ in range(2)]
    assert not done[0].failures and done[1].results == done[0].results


def test_results_of_other_programs_are_rows_like_methods(folder, tmp_path):
    for name, clean in SHAPES.items():
        save_mesh(tmp_path / f"{name}.obj", noisy(clean, 0.1, seed=1))
    done = evaluate([folder], methods=[], results={"theirs": tmp_path})
    assert [(r.pair, r.method) for r in done.results] == [(n, m) for n in SHAPES for m in (NOISY, "theirs")]
    for result in done.results[1::2]:
        clean = SHAPES[result.pair]
        expected = measure(noisy(clean, 0.1, seed=1), clean)
        assert result.measures.normal_error_deg == pytest.approx(expected.normal_error_deg)
        assert result.same_faces and result.seconds == 0
    assert [mean.method for mean in done.means] == [NOISY, "theirs"]


def test_missing_results_are_failures_and_other_faces_are_measured_and_said(folder, tmp_path):
    save_mesh(tmp_path / "ball.ply", icosphere(3))
    done = evaluate([folder], methods=[], results={"theirs": tmp_path})
    assert [(failure.pair, failure.method) for failure in done.failures] == [("cube", "theirs")]
    assert "holds no mesh cube.*" in str(done.failures[0].error)
    theirs = done.results[1]
    assert not theirs.same_faces and theirs.measures == measure(icosphere(3), SHAPES["ball"])
    assert not done.means[1].same_faces and done.means[0].same_faces
    save_mesh(tmp_path / "ball.off", icosphere(3))
    done = evaluate([folder / "ball"], methods=[], results={"theirs": tmp_path})
    assert "holds 2 meshes ball.*" in str(done.failures[0].error)


def test_results_without_a_folder_or_a_name_of_their_own_are_refused(folder, tmp_path):
    with pytest.raises(ReadError, match="is not a folder"):
        evaluate([folder], methods=[], results={"theirs": tmp_path / "absent"})
    for name in (NOISY, "laplacian"):
        with pytest.raises(ParameterError, match=f"the results '{name}' have the name of a method"):
            evaluate([folder], methods=["laplacian"], results={name: tmp_path})
    other = shutil.copytree(folder / "ball", tmp_path / "ball")
    with pytest.raises(ReadError, match="several pairs are named ball"):
        evaluate([folder, other], methods=[], results={"theirs": tmp_path})


def test_folders_that_cannot_be_listed_are_named(folder, tmp_path, monkeypatch):
    inside = Path.iterdir

    def locked(place):
        if place == tmp_path:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(place))
        return inside(place)

    monkeypatch.setattr(Path, "iterdir", locked)
    done = evaluate(folder / "ball", methods=[], results={"theirs": tmp_path})
    assert [str(failure.error) for failure in done.failures] == [f"{tmp_path} cannot be listed: Permission denied"]
    with pytest.raises(ReadError, match="cannot be listed: Permission denied"):
        evaluate(tmp_path, methods=[])


def test_pairs_that_would_share_a_row_or_a_folder_are_refused(folder, tmp_path):
    shutil.copytree(folder / "ball", tmp_path / "mean")
    with pytest.raises(ReadError, match="a pair is named mean: rename it"):
        evaluate(tmp_path, methods=[])
    (one,) = find_pairs(folder / "ball")
    with pytest.raises(ReadError, match="the results of the pairs a/b and a_b belong into one folder: rename one"):
        evaluate([one._replace(name="a/b"), one._replace(name="a_b")], methods=[])


def test_pairs_that_cannot_be_read_are_listed_and_the_rest_goes_on(folder, tmp_path, monkeypatch):
    pairs = shutil.copytree(folder, tmp_path / "pairs")
    for name in ("damaged", "foreign"):
        shutil.copytree(pairs / "ball", pairs / name)
    (pairs / "damaged" / "clean.ply").write_bytes(b"ply\nno more")
    read = runs.as_mesh

    def without_package(path):
        if Path(path).parent.name == "foreign":
            raise MissingDependencyError("reading '3mf' files", package="lxml", extra="formats")
        return read(path)

    for module in (runs, harness):
        monkeypatch.setattr(module, "as_mesh", without_package)
    for noise in (None, 0.1):
        done = evaluate(pairs, methods="laplacian", noise=noise)
        failed = {failure.pair.partition("-seed")[0]: str(failure.error) for failure in done.failures}
        assert set(failed) == {"damaged", "foreign"} and "lxml" in failed["foreign"]
        assert {result.pair.partition("-seed")[0] for result in done.results} == set(SHAPES)


@pytest.mark.slow  # two processes load the methods; tests/execution/test_cluster.py evaluates in two as well
def test_processes_measure_the_same(folder):
    settings = {"methods": ["laplacian", "taubin"], "commands": {"copy": python(COPY)}}
    one, two = (evaluate(folder, workers=workers, **settings) for workers in (1, 2))
    key = [(result.pair, result.method, result.measures) for result in one.results]
    assert [(result.pair, result.method, result.measures) for result in two.results] == key


def test_an_evaluation_without_a_process_is_refused(folder):
    with pytest.raises(ParameterError, match="workers is 0"):
        evaluate(folder, methods=[], workers=0)


def test_pairs_from_several_places_that_have_one_name_are_refused(folder):
    (ball, cube) = find_pairs(folder)
    for given in ([cube._replace(name="ball"), ball], [cube._replace(name="ball"), folder]):
        with pytest.raises(ReadError, match="2 pairs are named ball: rename one"):
            evaluate(given, methods=[])


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
