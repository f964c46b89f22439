"""The model cards of the shipped weights, made from the weights."""

import json
from collections import Counter
from typing import Any

from command_pages import table

from cascadenorm.models.models import named

MODELS = ("auto", "cascade")


def card_page() -> str:
    """Return the page of all model cards, as Markdown."""
    head = """\
# Model cards

What the weights say of themselves; `cascadenorm models NAME` prints it. [The shipped models](../models.md) has their
accuracy, what decided on their settings, and their limits.
"""
    return "\n".join([head, *map(_card, MODELS)])


def _card(model: str) -> str:
    card = named(model).card
    config = card["config"]
    losses = [
        (f"{stage}", *(f"{loss:.4f}" for loss in stages))
        for stage, stages in enumerate(card["validation_chord_by_stage_and_cluster"], 1)
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
            f"## `{model}`\n",
            table(("entry", "value"), about),
            "Validation loss, the mean chord between regressed and true normals:\n",
            table(titles, losses),
            "Shapes and noise of the training data, with how often each is named in the configuration:\n",
            table(("setting", "drawn from"), drawn),
            "All other settings, as [training](../training.md#settings) explains them:\n",
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
