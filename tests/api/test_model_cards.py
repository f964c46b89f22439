"""A card for the Hub has the digest, the licence and the losses of the model."""

import hashlib
from pathlib import Path

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.learned.methods import shipped


def test_the_card_for_the_hub_has_the_digest_and_the_licence_of_the_file(tmp_path):
    own, card = tmp_path / "my own.safetensors", tmp_path / "README.md"
    own.write_bytes(shipped("cascade").to_bytes())
    assert run(["models", str(own), "--hub", str(card)]) == 0
    _, metadata, text = card.read_text(encoding="utf-8").split("---\n", 2)
    assert metadata.startswith("license: mit\nlibrary_name: cascadenorm\ntags:\n- mesh-denoising\n")
    digest = hashlib.sha256(own.read_bytes()).hexdigest()
    assert f"| `my own.safetensors` | {own.stat().st_size} | `{digest}` | MIT |" in text
    assert "scan.ply --model 'my own.safetensors'`" in text and 'model="my own.safetensors")' in text
    losses = shipped("cascade").card["validation_chord_by_stage_and_cluster"]
    assert f"| 2 | {' | '.join(f'{loss:.4f}' for loss in losses[1])} |" in text
    assert run(["models", "auto", "--hub", str(card)]) == 5  # it exists
    assert run(["models", "auto", "--hub", str(card), "--force"]) == 0
    shipped_file = Path(cn.__file__).parent / "weights" / "auto.safetensors"
    text = card.read_text(encoding="utf-8")
    assert hashlib.sha256(shipped_file.read_bytes()).hexdigest() in text
    assert "## Library versions of the surface network" in text and "## Gate\n\nExtremely randomised trees" in text
