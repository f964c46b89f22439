"""JSON output of the commands, as specified in docs/json.md."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TextIO

from cascadenorm.api.inspection.inspection import surface_faults
from cascadenorm.cli.tables import allowed_values
from cascadenorm.io.json_text import json_text

if TYPE_CHECKING:  # imported for type checking only, because each command would load what others need
    from cascadenorm.mesh import Mesh
    from cascadenorm.registry import Method

SCHEMA_VERSION = 1
"""Version of the schema; it changes if a key is renamed, removed or redefined, but not if one is added."""


def print_json(command: str, content: Mapping[str, Any], *, file: TextIO | None = None) -> None:
    """Print the JSON object of a command to stdout or another file."""
    print(json_text({"version": SCHEMA_VERSION, "command": command, **content}, indent=2), file=file)


def faults_json(before: "Mesh", after: "Mesh") -> dict[str, Any]:
    """Return the numbers of intersecting faces, spikes and folded edges before and after denoising."""
    first, last = surface_faults(before), surface_faults(after)
    return {name: {"before": first[name], "after": last[name]} for name in first}


def method_json(method: "Method") -> dict[str, Any]:
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
