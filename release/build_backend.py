"""Build the package with setuptools, and compile the kernels of `cascadenorm denoise` while pip installs it.

A wheel built here ships them, for this platform and this Python. An editable installation gets them into the cache of
kernels. If they cannot be compiled, or numba or the processor differ at run time, the first run compiles them.
`--config-settings kernels=none` builds the universal wheel.
"""

import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import platform_wheel
from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403 - the hooks that are not defined here

ROOT = Path(__file__).resolve().parents[1]
NOT_NEEDED = {"matplotlib", "pillow", "trimesh"}
"""Dependencies that denoising does not import."""

Settings = Mapping[str, Any] | None


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    """Return what building a wheel needs: to compile kernels, also what they run with."""
    return [*build_meta.get_requires_for_build_wheel(config_settings), *needed_to_compile(config_settings)]


def get_requires_for_build_editable(config_settings: Settings = None) -> list[str]:
    """Return what an editable installation needs, as for a wheel."""
    return [*build_meta.get_requires_for_build_editable(config_settings), *needed_to_compile(config_settings)]


def build_wheel(wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None) -> str:
    """Build a wheel with compiled kernels, or the universal one; return its name."""
    name = build_meta.build_wheel(wheel_directory, config_settings, metadata_directory)
    if kernels_wanted(config_settings):
        universal = Path(wheel_directory, name)
        with failure_allowed():
            name = platform_wheel.local_wheel(universal).name
            universal.unlink()
    return name


def build_editable(
    wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None
) -> str:
    """Build the wheel of an editable installation, and compile kernels into their cache; return the wheel's name."""
    name = build_meta.build_editable(wheel_directory, config_settings, metadata_directory)
    if kernels_wanted(config_settings):
        with failure_allowed():
            platform_wheel.compile_kernels(ROOT, "--common", "--cache")
    return name


@contextmanager
def failure_allowed() -> Iterator[None]:
    """Print why kernels cannot be compiled, whatever it is; the package installs without them."""
    try:
        yield
    except Exception as error:
        print(f"The first run compiles kernels, because compiling them now failed: {error}")


def kernels_wanted(config_settings: Settings) -> bool:
    """Return whether kernels are compiled."""
    return (config_settings or {}).get("kernels") != "none"


def needed_to_compile(config_settings: Settings) -> list[str]:
    """Return the dependencies of the package that compiling its kernels needs."""
    if not kernels_wanted(config_settings):
        return []
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [text for text in project["dependencies"] if re.split(r"[<>=!~; ]", text)[0] not in NOT_NEEDED]
