"""The log of a training goes on after an interruption, and logs of another kind are refused."""

import json

import pytest

from cascadenorm.cli import run
from cascadenorm.learned.training.training_log import Pass, read_passes, recording


@pytest.mark.parametrize("suffix", ["csv", "jsonl"])
def test_a_log_goes_on_after_an_interruption_and_the_later_of_two_passes_counts(tmp_path, suffix):
    log = tmp_path / f"log.{suffix}"
    first, again = Pass(1, 1, 1, 0.5, 0.4, 30.0), Pass(1, 1, 1, 0.3, 0.2, 20.0)
    with recording(log, None, resumed=False) as record:
        record(first)
        line = log.read_text().splitlines()[-1]  # it is there at once
        assert line == "1,1,1,0.5,0.4,30.0" if suffix == "csv" else json.loads(line) == first._asdict()
    with recording(log, None, resumed=True) as record:
        record(again)
        record(Pass(1, 2, 1, 0.9, 0.8, 50.0))
    assert read_passes(log) == [again, Pass(1, 2, 1, 0.9, 0.8, 50.0)]
    with recording(log, None, resumed=False) as record:
        record(first)
    assert read_passes(log) == [first]


def test_logs_of_another_kind_are_refused(tmp_path, capsys):
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    assert run(["models", "--curves", str(tmp_path / "other.csv")]) == 3
    assert "other.csv is not a log of `cascadenorm train`" in capsys.readouterr().err
    assert run(["models", "--curves", str(tmp_path / "none.csv")]) == 3
    assert "none.csv cannot be read: No such file or directory\n" in capsys.readouterr().err
    assert run(["train", "--quick", "-o", str(tmp_path / "w.safetensors"), "--log", str(tmp_path / "log.txt")]) == 2
    assert "must end in .csv or .jsonl" in capsys.readouterr().err
