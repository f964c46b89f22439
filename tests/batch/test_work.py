"""The settings of a batch have a digest of all that a result depends on; the work on a file checks it first."""

import numpy as np
import pytest
from batches import BALL, scans
from shapes import noisy

from cascadenorm.batch.inputs import Job
from cascadenorm.batch.work import Task, batch_settings, work
from cascadenorm.errors import ParameterError
from cascadenorm.io.interop import save_mesh
from cascadenorm.registry import find


def test_a_file_that_changes_while_it_is_read_is_tried_again(place):
    scans(place, 1)
    settings = batch_settings("laplacian", {}, {}, None, force=False)[0]
    task = Task(Job("a/0.ply", "out/a/0.ply", 0, 0), None)
    checked = work(settings, task)
    assert checked.status == "new"
    save_mesh(place / "a" / "0.ply", noisy(BALL, 0.1), force=True)
    found = work(settings, task._replace(checked=True, digest=checked.input_digest))
    assert (found.status, found.then) == ("failed", "retry") and "changed while it was read" in str(found.error)
    assert not (place / "out" / "a" / "0.ply").exists()
    missing = work(settings, Task(Job("a/1.ply", "out/a/1.ply", 0, None), None))
    assert (missing.status, missing.then) == ("failed", "continue")
    gone = work(settings, Task(Job("a/1.ply", "out/a/1.ply", 10, 5), None))  # since it was listed
    assert (gone.status, gone.then) == ("failed", "retry")
    assert str(missing.error) == "a/1.ply does not exist: check the name"


def test_the_digest_of_the_settings_is_of_all_that_a_result_depends_on(tmp_path):
    mask = tmp_path / "mask.npy"
    np.save(mask, np.ones(4))

    usual = find("laplacian").settings["iterations"].default

    def key(method="laplacian", parameters=None, **controls):
        return batch_settings(method, parameters or {}, controls, None, force=False)[0].key

    assert key() == key(threads=1) == key(strength=1.0) == key(parameters={"iterations": usual})
    first = key(mask=str(mask))
    np.save(mask, np.zeros(4))
    others = [key("taubin"), key(parameters={"iterations": usual + 1}), key(strength=0.5), first, key(mask=str(mask))]
    assert len({key(), *others}) == 6
    with pytest.raises(ParameterError, match="cannot be read"):
        key("auto", {"model": tmp_path / "none.safetensors"})


def test_a_list_of_vertices_may_be_longer_than_a_file_name():
    fixed = ",".join(map(str, range(100)))
    settings, *_ = batch_settings("laplacian", {}, {"fixed": fixed}, None, force=False)
    assert settings.controls["fixed"] == fixed
