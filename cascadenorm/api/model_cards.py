"""Write model cards for the Hugging Face Hub.

A card has metadata in YAML and text in Markdown, which includes the digest of the file.
"""

import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cascadenorm.api.models import load_model
from cascadenorm.io.digests import file_digest
from cascadenorm.learned.methods import SHIPPED, weights_file

TAGS = ("mesh-denoising", "geometry-processing", "triangle-mesh", "3d", "safetensors")

CARD_TEMPLATE = """\
---
license: {license}
library_name: cascadenorm
tags:
{tags}
---

# {title}

Weights that denoise triangle meshes: {model}.

| file | bytes | SHA-256 | licence |
| --- | ---: | --- | --- |
| `{file}` | {size} | `{digest}` | {licence} |

## Use

```python
import cascadenorm as cn

cn.denoise("scan.ply", model={python_name})
```

or `cascadenorm denoise scan.ply --model {quoted_file}`. The file is read as plain arrays; nothing in it is executed.

{networks}{gate}
The settings are in the file: `cascadenorm models {quoted_file}` prints them.
"""

NETWORK_TEMPLATE = """## Training data{of}

{data}. Faces trained on: {faces}.

## Validation{of}

Mean chord between regressed and true normals of faces that were held out, by stage and cluster:

{losses}

## Limits{of}

{limits}.

## Library versions{of}

{versions}.
"""

GATE_TEMPLATE = """
## Gate

{model}. The gate chooses one of the networks for each connected component.
"""


def hub_card(model: str) -> str:
    """Return the card of a shipped model, given by its name, or of a weights file, given by its path.

    Raises ParameterError if the file is missing or is not a model.
    """
    loaded = load_model(model)
    networks, gate = loaded.model.networks, loaded.card.get("gate")
    card = next(iter(networks.values())).card
    file = weights_file(model) if model in SHIPPED else Path(model)
    return CARD_TEMPLATE.format(
        license=card["licence"].lower(),
        licence=card["licence"],
        tags="\n".join(f"- {tag}" for tag in TAGS),
        title=json.dumps(file.stem)[1:-1],
        model=card["model"],
        file=file.name,
        quoted_file=shlex.quote(file.name),
        python_name=json.dumps(file.name, ensure_ascii=False),
        size=file.stat().st_size,
        digest=file_digest(file),
        networks="\n".join(_network(name, cascade.card) for name, cascade in networks.items()),
        gate=GATE_TEMPLATE.format(model=_sentence(gate["model"])) if gate else "",
    )


def _network(name: str, card: Mapping[str, Any]) -> str:
    return NETWORK_TEMPLATE.format(
        of=f" of the {name} network" if name else "",
        data=_sentence(card["data"]),
        faces=f"{card['faces_trained_on']:,}",
        losses=_losses(card["validation_chord_by_stage_and_cluster"], first=first_trained_stage(card)),
        limits=_sentence(card["limits"]),
        versions=", ".join(f"{library} {version}" for library, version in card["made_with"].items()),
    )


def _sentence(text: Any) -> str:
    return str(text)[:1].upper() + str(text)[1:]


def first_trained_stage(card: Mapping[str, Any]) -> int:
    """Return the number of the first stage whose losses are on a card; a first stage that was given has none."""
    return 2 if "first_stage" in card else 1


def _losses(stages: list[list[float]], *, first: int) -> str:
    clusters = range(1, len(stages[0]) + 1)
    head = [
        f"| stage | {' | '.join(f'cluster {number}' for number in clusters)} |",
        f"| --- |{' ---: |' * len(clusters)}",
    ]
    rows = [
        f"| {number} | {' | '.join(f'{loss:.4f}' for loss in losses)} |" for number, losses in enumerate(stages, first)
    ]
    return "\n".join([*head, *rows])
