"""Errors name the setting at fault and the way out, in every spelling."""

import copy
import inspect
import pickle

import numpy as np
import pytest
from shapes import icosphere

import cascadenorm as cn
from cascadenorm import errors
from cascadenorm.cli.errors import EXIT_CODES, exit_code, worded

CLASSES = [kind for _, kind in inspect.getmembers(errors, inspect.isclass) if issubclass(kind, Exception)]
BALL = icosphere(1)


def raised(call, *arguments, **settings) -> errors.CascadenormError:
    with pytest.raises(errors.CascadenormError) as caught:
        call(*arguments, **settings)
    return caught.value


def test_an_error_names_the_control_at_fault_in_every_spelling():
    error = raised(cn.denoise, BALL, keep_detail="far")
    assert error.parameter == "keep_detail"
    assert str(error).startswith("keep_detail is 'far'; it must be")
    assert worded(error) == str(error).replace("keep_detail", "--keep-detail")


def test_parameters_of_a_method_keep_their_name_on_the_command_line():
    error = raised(cn.denoise, BALL, method="laplacian", iterations=-1)
    assert error.parameter == "iterations"
    assert worded(error) == str(error) == "iterations is -1; it must be at least 0"


def test_a_way_out_is_a_setting_and_not_a_text():
    vertices = BALL.vertices.copy()
    vertices[3] = np.nan
    error = raised(cn.denoise, vertices, BALL.faces)
    assert error.remedy == ("on_bad", "isolate")
    assert str(error).endswith("or denoise with on_bad='isolate'")
    assert worded(error).endswith("or denoise with --on-bad isolate")


@pytest.mark.parametrize("use", [lambda mesh: cn.compare(mesh, BALL), cn.fill_holes])
def test_functions_that_cannot_isolate_do_not_suggest_it(use):
    vertices = BALL.vertices.copy()
    vertices[3] = np.nan
    error = raised(use, (vertices, BALL.faces))
    assert error.remedy is None and "give them a position" in str(error) and "isolate" not in str(error)


def test_a_file_that_exists_may_be_replaced_by_force(tmp_path):
    (tmp_path / "ball.ply").touch()
    error = raised(cn.write, cn.from_arrays(BALL.vertices, BALL.faces), tmp_path / "ball.ply")
    assert error.remedy == ("force", True)
    assert str(error).endswith("or pass force=True") and worded(error).endswith("or pass --force")


def test_a_missing_package_says_what_installs_it():
    error = errors.MissingDependencyError("training", package="torch", extra="train")
    assert (error.package, error.extra, error.command) == ("torch", "train", 'pip install "cascadenorm[train]"')
    assert str(error) == 'training needs torch, which is not installed: pip install "cascadenorm[train]"'
    assert isinstance(error, ImportError)
    assert errors.MissingDependencyError("reading", package="cascadio").command == "pip install cascadio"


@pytest.mark.parametrize("kind", CLASSES)
def test_errors_survive_copies_between_processes(kind):
    error = kind("something").within("scan.ply")
    error.remedy = ("force", True)
    for other in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(other) is kind and vars(other) == vars(error) and str(other) == str(error)
    assert str(error).startswith("scan.ply: something")


def test_every_class_has_an_exit_code_and_comes_before_its_bases():
    assert set(EXIT_CODES) == set(CLASSES) - {errors.CascadenormError}
    for kind, code in EXIT_CODES.items():
        assert exit_code(kind("")) == code
    assert exit_code(KeyError("")) == 1


def test_errors_are_still_found_where_they_were():
    from cascadenorm.controls import DenoiseError
    from cascadenorm.execution.process_map import WorkerError
    from cascadenorm.io import OutputError, ReadError
    from cascadenorm.learned.config import ConfigError
    from cascadenorm.mesh import MeshError
    from cascadenorm.registry import ParameterError

    for kind in (DenoiseError, OutputError, ReadError, ConfigError, MeshError, ParameterError, WorkerError):
        assert kind is getattr(errors, kind.__name__) is getattr(cn, kind.__name__)


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("count", lambda number: cn.manifold_harmonics(BALL, number)),
        ("count", lambda number: cn.fast_harmonics(BALL, number)),
        ("samples", lambda number: cn.fast_harmonics(BALL, 1, samples=number)),
        ("count", lambda number: cn.shape_dna(BALL, number)),
        ("count", lambda number: cn.spectrum(BALL, count=number)),
        ("count", lambda number: cn.farthest_points(BALL, number)),
        ("first", lambda number: cn.farthest_points(BALL, 1, first=number)),
        ("max_edges", lambda number: cn.fill_holes(BALL, max_edges=number)),
        ("workers", lambda number: cn.evaluate("absent", workers=number)),
        ("seeds", lambda number: cn.evaluate("absent", noise=0.1, seeds=number)),
        ("workers", lambda number: cn.denoise_files("absent", "out", workers=number)),
        ("retries", lambda number: cn.denoise_files("absent", "out", retries=number)),
    ],
)
@pytest.mark.parametrize("number", [5.5, "five", [5], np.nan, np.inf])
def test_numbers_that_are_not_whole_are_refused_by_name(name, call, number):
    assert str(raised(call, number)) == f"{name} is {number!r}; it must be a whole number"


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("timeout", lambda number: cn.evaluate("absent", timeout=number)),
        ("noise", lambda number: cn.evaluate("absent", noise=number)),
        ("timeout", lambda number: cn.denoise_files("absent", "out", timeout=number)),
        ("watch", lambda number: cn.denoise_files("absent", "out", watch=number)),
    ],
)
def test_other_types_in_place_of_numbers_are_refused_by_name(name, call):
    assert str(raised(call, "soon")) == f"{name} is 'soon'; it must be a number"
    assert str(raised(call, [1])) == f"{name} is [1]; it must be a number"


@pytest.mark.parametrize("given", [[1], "iterations=3", {1: 2}])
@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("parameters", lambda given: cn.denoise_file("absent.ply", parameters=given)),
        ("parameters", lambda given: cn.denoise_files("absent", "out", parameters=given)),
        ("parameters", lambda given: cn.denoise_region_files("absent.ply", parameters=given)),
        ("parameters", lambda given: cn.evaluate("absent", parameters=given)),
        ("results", lambda given: cn.evaluate("absent", results=given)),
        ("commands", lambda given: cn.evaluate("absent", commands=given)),
    ],
)
def test_names_and_values_are_given_in_a_dictionary(name, call, given):
    assert str(raised(call, given)) == f"{name} is {given!r}; it must be a dictionary of names and values"
