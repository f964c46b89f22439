"""Docstrings of public functions have numpydoc's sections, and these name what the signature has."""

import inspect
import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest

import cascadenorm as cn
from cascadenorm.api.api import methods

FUNCTION_KINDS = (classmethod, staticmethod)


def public_functions() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Each public function, and each public method of a public class, with its name."""
    for name in cn.__all__:
        value = getattr(cn, name)
        if inspect.isfunction(value):
            yield name, value
        elif inspect.isclass(value):
            for inner, own in vars(value).items():
                own = own.__func__ if isinstance(own, FUNCTION_KINDS) else own
                if inspect.isfunction(own) and not inner.startswith("_"):
                    yield f"{name}.{inner}", own


PUBLIC = dict(public_functions())


def sections(text: str) -> dict[str, str]:
    """The sections of a docstring by their headings; the summary has the heading ""."""
    parts = re.split(r"^(\w[\w ]*)\n-+\n", f"{text}\n", flags=re.MULTILINE)
    return {"": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


def entries(section: str) -> list[str]:
    """The names in a section, which stand on lines of their own before indented descriptions."""
    found = re.findall(r"^(\w[\w, ]*)\n {4}", section, re.MULTILINE)
    return [name.strip() for names in found for name in names.split(",")]


def missing(function: Callable[..., Any]) -> list[str]:
    """What the docstring of a function lacks, or has too much."""
    found = sections(inspect.getdoc(function) or "")
    summary, _, rest = found[""].strip().partition("\n")
    faults = [] if re.fullmatch(r"[A-Z].*\.", summary) and rest[:1] in ("", "\n") else ["a summary"]
    signature = inspect.signature(function)
    expected = [name for name in signature.parameters if name not in ("self", "cls")]
    named = entries(found.get("Parameters", "")) + entries(found.get("Controls", ""))
    faults += [f"the parameter {name}" for name in expected if name not in named]
    faults += [f"no parameter {name}" for name in named if name not in expected]
    if signature.return_annotation not in (None, "None") and not found.keys() & {"Returns", "Yields"}:
        faults.append("what is returned")
    if re.search(r"^\s+raise ", inspect.getsource(function), re.MULTILINE) and not entries(found.get("Raises", "")):
        faults.append("what is raised")
    return faults


@pytest.mark.parametrize("name", PUBLIC)
def test_public_functions_document_parameters_results_and_errors(name):
    assert missing(PUBLIC[name]) == []


def test_what_a_docstring_lacks_is_found():
    def bare(mesh: int) -> int:
        if mesh < 0:
            raise ValueError
        return mesh

    bare.__doc__ = "Not a sentence\n\nParameters\n----------\nmash\n    Mesh."
    names = ["the parameter mesh", "no parameter mash"]
    assert missing(bare) == ["a summary", *names, "what is returned", "what is raised"]


@pytest.mark.parametrize("name", methods())
def test_methods_document_formula_limits_and_source(name):
    method = methods()[name]
    found = sections(inspect.getdoc(method.function) or "")
    assert found.keys() >= {"Formula", "Limits"}
    assert re.search(r"[A-Z]\w+.* \d{4}", method.source), "the paper: authors and year"
    assert all(setting.about.help for setting in method.settings.values())
