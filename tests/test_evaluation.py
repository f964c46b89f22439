import shutil

import numpy as np
import pytest
from shapes import cube, icosphere, noisy

from cascadenorm import registry
from cascadenorm.evaluation.harness import NOISY, evaluate
from cascadenorm.evaluation.metrics import measure
from cascadenorm.evaluation.pairs import find_pairs, write_pairs
from cascadenorm.interop import save_mesh
from cascadenorm.io import OutputError, ReadError
from cascadenorm.registry import ParameterError

SHAPES = {"ball": icosphere(2), "cube": cube(4)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("pairs")
    for name, clean in SHAPES.items():
        (root / name).mkdir()
        save_mesh(root / name / "noisy.ply", noisy(clean, 0.2))
        save_mesh(root / name / "clean.ply", clean)
    (root / "notes").mkdir()
    return root


def test_pairs_are_found_in_a_folder_and_in_the_folders_in_it(folder, tmp_path):
    assert [pair.name for pair in find_pairs([folder])] == ["ball", "cube"]
    assert [pair.name for pair in find_pairs([folder / "cube", folder / "ball"])] == ["cube", "ball"]
    assert [pair.name for pair in find_pairs([folder, folder / "ball"])] == ["ball", "cube"]
    other = shutil.copytree(folder / "ball", tmp_path / "ball")
    both = [pair.name for pair in find_pairs([folder, other])]
    assert both == [str(folder / "ball"), str(folder / "cube"), str(other)]


def test_folders_without_pairs_are_refused(folder, tmp_path):
    with pytest.raises(ReadError, match="is not a folder"):
        find_pairs([folder / "absent"])
    with pytest.raises(ReadError, match="holds no pairs"):
        find_pairs([folder / "notes"])
    (tmp_path / "noisy.ply").touch()
    with pytest.raises(ReadError, match=r"holds noisy\.ply alone"):
        find_pairs([tmp_path])
    (tmp_path / "clean.gltf").touch()
    for beside in ("noisy.mtl", "clean.bin", "clean.png"):  # what a mesh file names is none itself
        (tmp_path / beside).touch()
    assert [(pair.noisy.name, pair.clean.name) for pair in find_pairs([tmp_path])] == [("noisy.ply", "clean.gltf")]
    (tmp_path / "noisy.obj").touch()
    with pytest.raises(ReadError, match=r"holds 2 files noisy\.\*"):
        find_pairs([tmp_path])


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


def test_a_method_without_memory_is_listed_and_the_rest_goes_on(folder, monkeypatch):
    def hungry(mesh):
        np.empty(2**60)

    monkeypatch.setitem(registry._methods, "hungry", registry.Method("hungry", hungry, "", {}))
    done = evaluate(folder, methods=["hungry", "laplacian"])
    assert [r.method for r in done.results] == [NOISY, "laplacian"] * 2
    assert [(f.pair, f.method) for f in done.failures] == [("ball", "hungry"), ("cube", "hungry")]


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


def test_generated_pairs_can_be_evaluated_and_repeat(tmp_path):
    for name in ("one", "two"):
        write_pairs(tmp_path / name, count=1, seed=3)
    (pair,), (again,) = find_pairs([tmp_path / "one"]), find_pairs([tmp_path / "two"])
    assert pair.noisy.read_bytes() == again.noisy.read_bytes()
    done = evaluate([tmp_path / "one"], methods=[])
    assert done.results[0].measures.normal_error_deg > 0
    with pytest.raises(OutputError, match="is not empty"):
        write_pairs(tmp_path / "one", count=1, seed=3)
    with pytest.raises(OutputError, match="is a file"):
        write_pairs(pair.noisy, count=1, seed=3)
    assert np.isfinite(done.means[0].measures.vertex_error_edges)


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
        with pytest.raises(ParameterError, match=f"results are called {name}"):
            evaluate([folder], methods=["laplacian"], results={name: tmp_path})
    other = shutil.copytree(folder / "ball", tmp_path / "ball")
    with pytest.raises(ReadError, match="several pairs are called ball"):
        evaluate([folder, other], methods=[], results={"theirs": tmp_path})
