"""Digests of files and of code, used to detect changes."""

import ast
import hashlib
import inspect
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib.machinery import ModuleSpec
from importlib.util import find_spec, resolve_name
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

CHUNK_BYTES = 1 << 20


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal."""
    found = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(CHUNK_BYTES):
            found.update(block)
    return found.hexdigest()


def source_digest(function: Callable[..., Any]) -> str:
    """Return a digest of the code that a function runs, or an empty string for functions of this package.

    The version identifies the code of this package. The digest covers the function's module and the modules that it
    imports, directly or indirectly, within its folder and subfolders. For a function without a file, as in a notebook,
    it covers the function and those that it references.
    """
    own: Any = inspect.unwrap(function)
    own = getattr(own, "py_func", own)  # the Python function of a kernel
    module = sys.modules.get(getattr(own, "__module__", None) or "")
    if module is None or module.__name__.partition(".")[0] == __name__.partition(".")[0]:
        return "" if module is not None else _digest_of_code(own)
    file = getattr(module, "__file__", None)
    if file is None or not Path(file).is_file():
        return _digest_of_code(own)
    files = _imported_files(Path(file).resolve(), module.__package__ or "")
    digests = [file_digest(path) for path in sorted(files)]
    return hashlib.sha256(repr((digests, _values_within(own))).encode()).hexdigest()


def _imported_files(file: Path, package: str) -> set[Path]:
    """Return the source file of a module, and of those that it imports, directly or indirectly, in its folder tree."""
    found = {file}
    left = [(file, package)]
    while left:
        source, package = left.pop()
        for name in _imported_names(source, package):
            spec: ModuleSpec | None = None
            with suppress(Exception):  # the package is missing or fails to import, and the method does without it
                spec = find_spec(name)
            if spec is None or spec.origin is None:
                continue
            path = Path(spec.origin).resolve()
            if path.suffix == ".py" and file.parent in path.parents and path not in found:
                found.add(path)
                left.append((path, spec.parent or ""))
    return found


def _imported_names(source: Path, package: str) -> Iterator[str]:
    """Yield the modules that a source file imports at any level, and names that may be modules."""
    for node in ast.walk(ast.parse(source.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            home = resolve_name("." * node.level + (node.module or ""), package) if node.level else str(node.module)
            yield home
            yield from (f"{home}.{alias.name}" for alias in node.names)


def _digest_of_code(function: Any) -> str:
    """Return a digest of the compiled code of a function and of the functions in its module that it references."""
    parts: list[str] = []
    seen: set[int] = set()
    left = [function]
    while left:
        one = left.pop()
        if not isinstance(one, FunctionType) or id(one) in seen:
            continue
        seen.add(id(one))
        parts += [*map(repr, _instructions(one.__code__)), repr(_values_within(one))]
        named = (one.__globals__.get(name) for name in one.__code__.co_names)
        left += [value for value in named if getattr(value, "__module__", None) == one.__module__]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _instructions(code: CodeType) -> Iterator[object]:
    """Yield the instructions, names and constants of a function, without its position in a file."""
    yield code.co_code, code.co_names, code.co_varnames
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _instructions(constant)
        else:
            yield constant


def _values_within(function: Any) -> list[str]:
    """Return the plain values in the closure of a function."""
    cells = [cell.cell_contents for cell in getattr(function, "__closure__", None) or ()]
    return [repr(value) for value in cells if isinstance(value, bool | int | float | str | bytes | None)]
