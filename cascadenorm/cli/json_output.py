"""JSON output of the commands, as specified in docs/json.md."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, TextIO

from cascadenorm.api.inspection.inspection import surface_faults
from cascadenorm.cli.errors import worded
from cascadenorm.cli.tables import allowed_values
from cascadenorm.io.json_text import json_text

if TYPE_CHECKING:  # imported for type checking only, because each command would load what others need
    from cascadenorm.api.spectra import Spectrum
    from cascadenorm.batch.batch import Batch
    from cascadenorm.evaluation.harness import Evaluation
    from cascadenorm.geometry.metrics import Measures
    from cascadenorm.mesh import Mesh
    from cascadenorm.registry import Method

VERSION = 1
"""Version of the schema; it changes if a key is renamed, removed or redefined, but not if one is added."""


def print_json(command: str, content: Mapping[str, Any], *, file: TextIO | None = None) -> None:
    """Print the JSON object of a command to stdout or another file."""
    print(json_text({"version": VERSION, "command": command, **content}, indent=2), file=file)


def faults_json(before: "Mesh", after: "Mesh") -> dict[str, Any]:
    """Return the numbers of intersecting faces, spikes and folded edges before and after denoising."""
    first, last = surface_faults(before), surface_faults(after)
    return {name: {"before": first[name], "after": last[name]} for name in first}


def batch_json(done: "Batch") -> dict[str, Any]:
    """Return the outcome of the files of a batch."""
    failures = [{"input": failure.source, "message": worded(failure.error)} for failure in done.failures]
    return {"files": done.lines, "kept": done.kept, "skipped": done.skipped, "failures": failures}


def compared_json(mesh: str, reference: str, measures: "Measures") -> dict[str, Any]:
    """Return the measures of a mesh against a reference, with both names."""
    return {"mesh": mesh, "reference": reference, "measures": asdict(measures)}


def spectrum_json(mesh: str, other: str | None, found: "Spectrum") -> dict[str, Any]:
    """Return the eigenvalues of one or two meshes, and the distance of their spectra."""
    return {
        "mesh": mesh,
        "other": other,
        "scale": found.scale,
        "eigenvalues": found.values.tolist(),
        "other_eigenvalues": None if found.other is None else found.other.tolist(),
        "distance": found.distance,
    }


def evaluated_json(done: "Evaluation") -> dict[str, Any]:
    """Return the rows of an evaluation, their means, and the failures."""
    return {
        "results": [result.row() for result in done.results],
        "means": [result.row() for result in done.means],
        "failures": [{"pair": f.pair, "method": f.method, "message": worded(f.error)} for f in done.failures],
    }


def methods_json(listed: "Iterable[Method]") -> dict[str, Any]:
    """Return methods with their parameters."""
    return {"methods": [_method(method) for method in listed]}


def _method(method: "Method") -> dict[str, Any]:
    return {
        "name": method.name,
        "summary": method.summary,
        "source": method.source,
        "parameters": [
            {
                "name": setting.name,
                "default": setting.default,
                "unit": setting.about.unit,
                "allowed": allowed_values(setting),
                "help": setting.about.help,
            }
            for setting in method.given_by_name
        ],
    }
