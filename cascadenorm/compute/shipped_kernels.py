"""Kernels that were compiled before they came here: wheels of one platform and one Python carry them in a folder.

A file is named after all that its machine code depends on, so a kernel of another source, numba, Python or processor
finds none, and is compiled. release/platform_wheel.py makes such wheels.
"""

import inspect
import re
import sys
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np

KERNELS_FOLDER = Path(__file__).parents[1] / "compiled_kernels"
PROCESSORS: dict[str, tuple[str, frozenset[str]]] = {
    "x86_64": ("x86-64-v3", frozenset({"avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"})),  # Haswell, 2013
    "aarch64": ("generic", frozenset()),
    "arm64": ("generic", frozenset()),
}
"""What kernels are shipped for, by the machine: LLVM's name, and what a processor must have to run them."""


def shipped_file(function: Callable[..., Any], signature: object, target: tuple[str, str, str]) -> Path | None:
    """Return where the machine code of a kernel is, or would be; None if none is shipped for the processor.

    Parameters
    ----------
    signature
        Types of the arguments, in numba's text.
    target
        Triple, processor and features of what numba compiles for.
    """
    triple, processor, features = target
    shipped = shipped_processor(triple, processor, features)
    if shipped is None or function.__closure__:  # whose variables the source does not tell
        return None
    system = re.sub(r"[\d.]+$", "", triple)  # that of macOS ends in the version of its kernel
    python = sys.implementation.cache_tag, getattr(sys, "abiflags", "")
    versions = numba.__version__, llvmlite.__version__, np.__version__.partition(".")[0]
    name = f"{function.__module__}.{function.__qualname__}"
    key = name, kernel_digest(function.__module__), str(signature), python, versions, system, shipped
    return KERNELS_FOLDER / f"{name}-{sha256(repr(key).encode()).hexdigest()[:32]}.nbc"


def shipped_processor(triple: str, processor: str, features: str) -> str | None:
    """Name the processor that kernels are shipped for and whose code runs on the given one; None if there is none."""
    name, needed = PROCESSORS.get(triple.partition("-")[0], ("", frozenset()))
    runs = name and (processor == name or needed <= {word[1:] for word in features.split(",") if word.startswith("+")})
    return name if runs else None


@cache
def kernel_digest(module: str) -> str:
    """Return a digest of what the kernels of a module are compiled from: its source, and that of kernels they call.

    The module must have been imported to its end; the digest is then that of the process.
    """
    modules = [module]
    constants = []
    for name in modules:
        for key, value in sorted(vars(sys.modules[name]).items()):
            if key.isupper() and type(value) in (int, float, bool):  # also those of modules without kernels
                constants.append((name, key, value))
            called = getattr(getattr(value, "py_func", None), "__module__", name)
            if called not in modules:
                modules.append(called)
    sources = [Path(inspect.getfile(sys.modules[name])).read_bytes() for name in modules]
    return sha256(repr((constants, [sha256(source).digest() for source in sources])).encode()).hexdigest()
