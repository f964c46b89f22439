"""Names and settings of methods for the accuracy benchmarks."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cascadenorm as cn
from cascadenorm.cli.options import parameter_values
from cascadenorm.mesh import Mesh


def add_methods(parser: argparse.ArgumentParser, default: Sequence[str]) -> None:
    """Add the option `--method`."""
    parser.add_argument(
        "--method",
        action="append",
        metavar="NAME[:KEY=VALUE...]",
        help="method with its parameters, or a weights file; may be given several times. "
        f"Default: {', '.join(default)}",
    )
    parser.set_defaults(default_methods=tuple(default))


def chosen_methods(options: argparse.Namespace) -> list[str]:
    """Return the requested methods, or the default ones."""
    return list(dict.fromkeys(options.method or options.default_methods))


def parsed(method: str) -> tuple[str, dict[str, Any]]:
    """Return the name and parameters of a method given as NAME:KEY=VALUE or as the path of a weights file."""
    if method.endswith(".safetensors"):
        return "auto", {"model": Path(method)}
    name, *settings = method.split(":")
    return name, parameter_values(settings)


def denoised(mesh: Mesh, method: str) -> Mesh:
    """Denoise a mesh by a method given as for `parsed`."""
    name, parameters = parsed(method)
    result: Mesh = cn.denoise(mesh, method=name, **parameters)
    return result
