"""Precompiled kernels, shipped in wheels for one platform and Python version.

Each file name encodes everything that the machine code depends on: source, numba, Python and processor. If no matching
file exists, the kernel is compiled. release/platform_wheel.py builds such wheels.
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
"""Supported machines: LLVM's name of the target processor, and the features needed to run its code."""


def shipped_file(function: Callable[..., Any], signature: object, target: tuple[str, str, str]) -> Path | None:
    """Return the file of a shipped kernel, whether it exists or not; None if its processor is not supported.

    The signature has the types of the arguments in numba's notation; the target is the triple, the processor and the
    features that numba compiles for.
    """
    triple, processor, features = target
    shipped = shipped_processor(triple, processor, features)
    if shipped is None or function.__closure__:  # the source does not determine closure variables
        return None
    system = re.sub(r"[\d.]+$", "", triple)  # on macOS it ends with the kernel version
    python = sys.implementation.cache_tag, getattr(sys, "abiflags", "")
    versions = numba.__version__, llvmlite.__version__, np.__version__.partition(".")[0]
    name = f"{function.__module__}.{function.__qualname__}"
    key = name, kernel_digest(function.__module__), str(signature), python, versions, system, shipped
    return KERNELS_FOLDER / f"{name}-{sha256(repr(key).encode()).hexdigest()[:32]}.nbc"


def shipped_processor(triple: str, processor: str, features: str) -> str | None:
    """Return the supported processor whose code runs on the given one, or None."""
    name, needed = PROCESSORS.get(triple.partition("-")[0], ("", frozenset()))
    runs = name and (processor == name or needed <= {word[1:] for word in features.split(",") if word.startswith("+")})
    return name if runs else None


@cache
def kernel_digest(module: str) -> str:
    """Return a digest of the sources and constants that the kernels of a module and those they call depend on.

    The module must be completely imported. The digest is cached for the lifetime of the process.
    """
    modules = [module]
    constants = []
    for name in modules:
        for key, value in sorted(vars(sys.modules[name]).items()):
            if key.isupper() and type(value) in (int, float, bool):  # including constants of modules without kernels
                constants.append((name, key, value))
            called = getattr(getattr(value, "py_func", None), "__module__", name)
            if called not in modules:
                modules.append(called)
    sources = [Path(inspect.getfile(sys.modules[name])).read_bytes() for name in modules]
    return sha256(repr((constants, [sha256(source).digest() for source in sources])).encode()).hexdigest()
