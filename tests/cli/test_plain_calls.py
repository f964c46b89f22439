"""Plain calls reach a command as typer makes them; all others are left to typer."""

import inspect
import shlex
from functools import wraps

import pytest

from cascadenorm.cli.commands import app
from cascadenorm.cli.plain_calls import plain_call

PLAIN = [
    "denoise scan.ply",
    "denoise - -o - --format stl",
    "denoise scan.ply --output=out.ply --force --json --method taubin --set iterations=3 --set step=0.5",
    "denoise --strength 0.5 scan.ply --truth clean.ply --report r.html --keep-detail '2 edges' --model my.safetensors",
    "denoise scan.ply --force --force --strength 1e0 --strength 2 --output a=b.ply",
    "inspect scan.ply --json",
    "fill-holes scan.ply --force",
    "methods",
]
OTHERS = [
    "",
    "--version",
    "denoise",
    "denoise --help",
    "denoise a.ply b.ply",
    "denoise scan.ply --strength much",
    "denoise scan.ply --output",
    "denoise scan.ply --no-such-option",
    "denoise scan.ply --force=yes",
    "denoise -- -scan.ply",
    "denoise scan.ply -oout.ply",
    "batch scans --output out",
    "batch scans",
    "fill-holes scan.ply --order 7",
    "fill-holes scan.ply --outer keep",
    "inspect scan.ply --no-self-intersections",
    "nothing scan.ply",
]


def by_typer(monkeypatch: pytest.MonkeyPatch, line: list[str]) -> dict:
    """What typer passes to the command."""
    passed = []
    for registered in app.registered_commands:

        def keep(registered=registered):
            @wraps(registered.callback)
            def run(**values):
                passed.append(values)

            run.__signature__ = inspect.signature(registered.callback)
            return run

        monkeypatch.setattr(registered, "callback", keep())
    app(line, standalone_mode=False)
    (values,) = passed
    return values


@pytest.mark.parametrize("line", PLAIN)
def test_a_plain_call_has_the_values_that_typer_finds(line, monkeypatch):
    words = shlex.split(line)
    call = plain_call(words)
    assert call is not None
    expected = by_typer(monkeypatch, words)
    assert {name: value or None for name, value in call.keywords.items()} == {
        name: value or None
        for name, value in expected.items()  # some versions of typer pass an empty list
    }
    assert {name: type(value) for name, value in call.keywords.items() if value} == {
        name: type(value) for name, value in expected.items() if value
    }


@pytest.mark.parametrize("line", OTHERS)
def test_calls_that_are_not_plain_are_left_to_typer(line):
    assert plain_call(line.split()) is None
