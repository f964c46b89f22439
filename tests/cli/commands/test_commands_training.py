"""The commands for training data and models write what others read."""

import json

from commands import FAST, refused

from cascadenorm.cli import run


def test_generate_makes_pairs_that_evaluate_reads(tmp_path, capsys):
    folder = str(tmp_path / "set")
    assert run(["generate", folder, "--count", "1", "--seed", "3"]) == 0
    assert "1 pair in" in capsys.readouterr().out
    assert run(["evaluate", folder, *FAST, "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["results"]) == 2
    code, message = refused(capsys, "generate", folder, "--count", "1")
    assert code == 5 and "is not empty" in message
