"""What a method fails with is listed, and the rest goes on."""

import numpy as np

from cascadenorm.evaluation.harness import NOISY, evaluate
from cascadenorm.registry import methods as registry


def test_a_method_without_memory_is_listed_and_the_rest_goes_on(folder, monkeypatch):
    def hungry(mesh):
        np.empty(2**60)

    monkeypatch.setitem(registry._methods, "hungry", registry.Method("hungry", hungry, "", {}))
    done = evaluate(folder, methods=["hungry", "laplacian"])
    assert [r.method for r in done.results] == [NOISY, "laplacian"] * 2
    assert [(f.pair, f.method) for f in done.failures] == [("ball", "hungry"), ("cube", "hungry")]


def test_whatever_a_method_ends_in_is_listed(folder, monkeypatch):
    def broken(mesh):
        return mesh.vertices[len(mesh.vertices)]

    monkeypatch.setitem(registry._methods, "broken", registry.Method("broken", broken, "", {}))
    done = evaluate(folder / "ball", methods=["broken", "laplacian"])
    assert [(f.method, type(f.error)) for f in done.failures] == [("broken", IndexError)]
    assert [result.method for result in done.results] == [NOISY, "laplacian"]
