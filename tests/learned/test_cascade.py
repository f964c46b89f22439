"""A cascade gives the same vertices on any number of threads and out of its weights file, old ones included."""

import json
import sys
from dataclasses import asdict, replace

import numpy as np
import pytest
from safetensors.numpy import save_file
from shapes import icosphere, noisy
from stages import random_regression, stage_settings

from cascadenorm.errors import ParameterError
from cascadenorm.learned.cascade import CASCADE_FORMATS, Cascade
from cascadenorm.learned.descriptors import (
    CUTOFF,
    ITERATED_16,
    ITERATED_32,
    ITERATED_64,
    ITERATED_SIGMA_R,
    LATER_SMOOTH_PASSES,
    SIGMA_R,
    SIGMA_S,
    SMOOTH_PASSES,
    SMOOTH_SIGMA_R,
)
from cascadenorm.learned.features import CONTEXT_STEPS, FLOOR
from cascadenorm.mesh import limit_threads

MESH = noisy(icosphere(2), 0.2)


def test_same_bytes_for_any_number_of_threads():
    mesh = noisy(icosphere(5), 0.2)
    cascade = Cascade((random_regression("B+G"), random_regression("iterated-16+smoothed")), {})
    with limit_threads(1):
        one = cascade.vertices(mesh)
    with limit_threads(5):
        assert cascade.vertices(mesh.moved(mesh.vertices)).tobytes() == one.tobytes()


def test_weights_file_gives_the_same_cascade_back(tmp_path):
    cascade = Cascade((random_regression("B+G"), random_regression("B")), {"seed": 3, "note": "für Täler"})
    path = tmp_path / "model.safetensors"
    path.write_bytes(cascade.to_bytes())
    again = Cascade.load(path)
    assert again.to_bytes() == cascade.to_bytes()
    assert again.card == cascade.card
    assert again.vertices(MESH).tobytes() == cascade.vertices(MESH).tobytes()


CONSTANTS = {
    "sigma_s": (1.0, 2.0),
    "sigma_r": (0.1, 0.2, 0.35, 0.5, np.inf),
    "spreads": 2.5,
    "context_steps": (0, 1, 3, 7),
    "iterated_sigma_r": (0.2, 0.35, 0.55, np.inf),
    "iterated_64_passes": (1, 4, 16, 64),
    "iterated_32_passes": (1, 4, 16, 32),
    "iterated_16_passes": (1, 4, 16),
    "smooth_passes": (1, 4, 16, 64),
    "later_smooth_passes": (1, 2, 8),
    "smooth_sigma_r": 0.35,
    "floor": 1e-4,
}
"""What the names of descriptors stand for in the first of CASCADE_FORMATS; files of the last one say so."""


def test_another_constant_needs_another_format():
    found = {
        "sigma_s": SIGMA_S, "sigma_r": SIGMA_R, "spreads": CUTOFF, "context_steps": CONTEXT_STEPS,
        "iterated_sigma_r": ITERATED_SIGMA_R, "iterated_64_passes": ITERATED_64,
        "iterated_32_passes": ITERATED_32,
        "iterated_16_passes": ITERATED_16, "smooth_passes": SMOOTH_PASSES,
        "later_smooth_passes": LATER_SMOOTH_PASSES, "smooth_sigma_r": SMOOTH_SIGMA_R, "floor": FLOOR,
    }  # fmt: skip
    assert found == CONSTANTS and CASCADE_FORMATS[0] == "cascadenorm/8"


def test_weights_with_the_header_of_an_older_version_give_the_same_vertices(tmp_path):
    first, last = random_regression("B+G"), random_regression("B")
    first = replace(first, settings=replace(first.settings, sweeps=10))
    last = replace(last, settings=replace(last.settings, weighting="cotangent"))
    cascade = Cascade((first, last), {"config": {"last_weighting": "angles"}})
    old = {"activation": "tanh", "foldovers": "ignore", "neighborhood": "distance"}
    header = {
        "format": "cascadenorm/6",
        "card": cascade.card,
        "constants": CONSTANTS,
        "stages": [
            {**old, "descriptor": "B+G", "sweeps": 10, "weighting": "heights"},
            {**old, "descriptor": "B", "sweeps": 20, "weighting": "angles"},
        ],
    }
    path = tmp_path / "old.safetensors"
    tensors = {name: array for name, array in cascade.tensors().items() if not name.endswith(".pairs")}
    save_file(tensors, path, {"cascadenorm": json.dumps(header)})
    read = Cascade.load(path)
    assert [stage.settings for stage in read.stages] == [first.settings, last.settings]
    assert read.to_bytes() == cascade.to_bytes()
    assert read.vertices(MESH).tobytes() == cascade.vertices(MESH).tobytes()


def test_weights_for_filters_over_rings_are_refused(tmp_path):
    cascade = Cascade((random_regression("B"),), {})
    old = [asdict(stage.settings) | {"neighborhood": "rings"} for stage in cascade.stages]
    header = {"format": "cascadenorm/7", "card": {}, "stages": old}
    save_file(cascade.tensors(), tmp_path / "old.safetensors", {"cascadenorm": json.dumps(header)})
    with pytest.raises(ParameterError, match="needs what this version lacks: filters over rings of faces"):
        Cascade.load(tmp_path / "old.safetensors")


def test_files_that_hold_no_cascade_are_refused(tmp_path):
    with pytest.raises(ParameterError, match="cannot be read: No such file"):
        Cascade.load(tmp_path / "missing.safetensors")
    if sys.platform != "win32":
        with pytest.raises(ParameterError, match="cannot be read: Is a directory"):
            Cascade.load(tmp_path)
    text = tmp_path / "text.safetensors"
    text.write_text("no weights")
    with pytest.raises(ParameterError, match="is not a weights file"):
        Cascade.load(text)
    other = tmp_path / "other.safetensors"
    content = json.dumps({"a": {"dtype": "BF16", "shape": [1], "data_offsets": [0, 2]}})
    other.write_bytes(len(content).to_bytes(8, "little") + content.encode() + bytes(2))  # numpy lacks this type
    with pytest.raises(ParameterError, match="is not a weights file"):
        Cascade.load(other)
    save_file({"a": np.zeros(2)}, other, {"cascadenorm": json.dumps({"format": "cascadenorm/99"})})
    with pytest.raises(ParameterError, match="format 'cascadenorm/99'"):
        Cascade.load(other)
    partial = tmp_path / "partial.safetensors"
    arrays = {f"stage0.{name}": a for name, a in random_regression("B").arrays().items() if name != "projection"}
    stage = asdict(stage_settings("B"))
    header = {"format": CASCADE_FORMATS[0], "stages": [stage], "card": {}}
    save_file(arrays, partial, {"cascadenorm": json.dumps(header)})
    with pytest.raises(ParameterError, match="lacks 'projection' of stage 1"):
        Cascade.load(partial)
    for name, value in (("descriptor", "C"), ("activation", "relu"), ("foldovers", "mend")):
        later = header | {"stages": [stage | {name: value}]}
        save_file(arrays, partial, {"cascadenorm": json.dumps(later)})
        with pytest.raises(ParameterError, match=f"needs what this version lacks: {name} is '{value}'"):
            Cascade.load(partial)
    truncated = tmp_path / "truncated.safetensors"
    truncated.write_bytes(Cascade((random_regression("B"),), {}).to_bytes()[:-5])
    with pytest.raises(ParameterError, match="is not a weights file"):
        Cascade.load(truncated)
