"""The page of model cards, from the shipped weights."""

import json
from collections import Counter
from typing import Any

from markdown_table import table

from cascadenorm.api.model_cards import first_trained_stage
from cascadenorm.api.models import load_model

MODELS = ("auto", "cascade")


def card_page() -> str:
    """Return the page of all model cards, as Markdown."""
    head = """\
# Model cards

Each weights file contains a model card, which `cascadenorm models NAME` prints. [The shipped models](../models.md)
describes their limits and their accuracy.
"""
    networks = {
        f"`{model}`, {name} network" if name else f"`{model}`": dict(cascade.card)
        for model in MODELS
        for name, cascade in load_model(model).model.networks.items()
    }
    return "\n".join(
        [head, *(_card(title, card) for title, card in networks.items()), _gate(load_model("auto").card["gate"])]
    )


def _gate(card: dict[str, Any]) -> str:
    """Return the section of the gate, with its accuracy on the meshes of its training."""
    columns = ("vertex", "surface", "chosen", "better")
    rows = [(name, *(f"{angles[key]:.2f}" for key in columns)) for name, angles in card["mean_angles_deg"].items()]
    return "\n".join(
        [
            "## `auto`, gate\n",
            f"{card['model'].capitalize()}. A component is treated as a measured surface if its probability is at "
            f"least {card['threshold']}. The table shows mean angles to the truth on generated meshes, in degrees: "
            "with each network, with the one that the gate chooses in cross-validation, and with the better one.\n",
            table(("family", *columns), rows),
        ]
    )


def _card(title: str, card: dict[str, Any]) -> str:
    config = card["config"]
    losses = [
        (f"{stage}", *(f"{loss:.4f}" for loss in stages))
        for stage, stages in enumerate(card["validation_chord_by_stage_and_cluster"], first_trained_stage(card))
    ]
    titles = ("stage", *(f"cluster {number}" for number in range(1, len(losses[0]))))
    about = [
        (name.replace("_", " "), _text(card[name])) for name in ("model", "data", "limits", "licence", "made_with")
    ]
    about.append(("faces trained on", f"{card['faces_trained_on']:,}"))
    drawn = [(key, _shares(config["data"][key])) for key in ("families", "noise_kinds")]
    settings = [(f"`{key}`", f"`{json.dumps(value)}`") for key, value in _flat(config) if key not in SHARES]
    return "\n".join(
        [
            f"## {title}\n",
            table(("entry", "value"), about),
            "Validation loss, the mean chord between regressed and true normals:\n",
            table(titles, losses),
            "Shapes and noise of the training data; a number in brackets is a relative frequency:\n",
            table(("setting", "drawn from"), drawn),
            "All other settings, which [training](../training.md#settings) explains:\n",
            table(("setting", "value"), settings),
        ]
    )


SHARES = ("data.families", "data.noise_kinds")


def _shares(names: list[str]) -> str:
    return ", ".join(f"{name} ({count})" if count > 1 else name for name, count in Counter(names).items())


def _text(value: Any) -> str:
    return ", ".join(f"{name} {version}" for name, version in value.items()) if isinstance(value, dict) else str(value)


def _flat(config: dict[str, Any]) -> list[tuple[str, Any]]:
    return [
        (f"{key}.{name}" if name else key, inner)
        for key, value in config.items()
        for name, inner in (value.items() if isinstance(value, dict) else [("", value)])
    ]
