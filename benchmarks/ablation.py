"""What each part of the model `auto` brings: python benchmarks/ablation.py DIR

    python benchmarks/ablation.py DIR [--count 60] [--seeds 0 1 2] [--keep FOLDER]

Trains the settings of configs/auto.toml on fewer shapes, whole and with one part changed at a time, once a seed, and
measures on the pairs in DIR and on generated ones from a seed that no training has. Writes docs/ablation.md. Models
stay in the folder, so that an interrupted run goes on where it was.
"""

import argparse
import json
from collections.abc import Iterable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np

from cascadenorm import models
from cascadenorm.data_gen import DatasetConfig, pairs
from cascadenorm.evaluation.pairs import find_pairs
from cascadenorm.interop import as_mesh
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.config import TrainConfig, read_config
from cascadenorm.mesh import Mesh, angles_between, thread_count
from cascadenorm.workers import Map, side_by_side

ROOT = Path(__file__).parents[1]
UNSEEN = 1_000_003  # seed of the generated pairs that are measured on
WHOLE = "all of it"

Meshes = list[tuple[Mesh, Mesh]]
"""Noisy and clean meshes."""


def variants(config: TrainConfig) -> dict[str, TrainConfig]:
    """Return the settings with one part changed at a time, by what is changed."""
    data, fit = config.data, config.fit
    return {
        WHOLE: config,
        "without what surrounds a face": replace(config, context=0),
        "one hidden layer": replace(config, fit=replace(fit, hidden=fit.hidden[:1])),
        "a network for each of four clusters": replace(config, clusters=4),
        "without smoothed vertices": replace(config, descriptors=("reach", "near", "near")),
        "the filters of the first stage in every stage": replace(config, descriptors=config.descriptors[:1] * 3),
        "the filters of the paper": replace(config, descriptors=TrainConfig().descriptors),
        "half the shapes": replace(config, data=replace(data, count=data.count // 2)),
        "no fused scans": replace(config, data=without(data, "fused")),
        "no scans at all": replace(config, data=without(data, "fused", "view")),
    }


def without(data: DatasetConfig, *left_out: str) -> DatasetConfig:
    """Return the data but for some families."""
    return replace(data, families=tuple(name for name in data.families if name not in left_out))


def trained(config: TrainConfig, path: Path) -> Cascade:
    """Train, unless the model lies there already."""
    if path.exists() and (kept := Cascade.load(path)).card["config"] == json.loads(json.dumps(asdict(config))):
        return kept
    return models.train(config, path, force=True).cascade


def angles(cascade: Cascade, sets: list[Meshes], each: Map) -> list[float]:
    """Mean angle of normals over the meshes of each set, in degrees."""
    return [float(np.mean(list(each(partial(angle, cascade), meshes)))) for meshes in sets]


def angle(cascade: Cascade, meshes: tuple[Mesh, Mesh]) -> float:
    """Mean angle of the normals of a denoised mesh, in degrees; `measure` takes longer, since it knows more."""
    noisy, clean = meshes
    return float(np.degrees(angles_between(noisy.moved(cascade.vertices(noisy)).normals, clean.normals).mean()))


def generated(data: DatasetConfig, **changes: object) -> Meshes:
    """Make pairs that no training has seen."""
    unseen = replace(data, seed=UNSEEN, count=24, **changes)
    return [(pair.noisy, pair.clean) for pair in pairs(unseen, workers=thread_count())]


def cell(values: Iterable[float]) -> str:
    """Mean over the seeds, and half of what lies between the least and the greatest."""
    found = np.array(list(values))
    return f"{found.mean():.2f} ± {np.ptp(found) / 2:.2f}"


def write_table(rows: dict[str, list[list[float]]], count: int, seeds: int, shipped: int) -> None:
    """Write what is known so far."""
    lines = [
        "# What each part of `auto` brings",
        "",
        "Mean angle between the normals of faces and the true ones, in degrees, and half the spread over "
        f"{seeds} seeds. Each model was trained with `configs/auto.toml` on {count} shapes in "
        f"place of {shipped}, with one part changed. Public models are "
        "those of the validation set of the standard synthetic benchmark; shapes, views of one depth camera and scans "
        "fused from several are generated from a seed that no training has. "
        "Made by `python benchmarks/ablation.py DIR`.",
        "",
        "| | public models | generated shapes | depth views | fused scans |",
        "| --- | ---: | ---: | ---: | ---: |",
        *(
            f"| {name} | {' | '.join(cell(values) for values in zip(*found, strict=True))} |"
            for name, found in rows.items()
        ),
    ]
    (ROOT / "docs" / "ablation.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Train, measure, write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR", help="pairs: */noisy.* and */clean.*")
    parser.add_argument("--count", type=int, default=60, help="shapes to train on")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--keep", type=Path, default=ROOT / "runs" / "ablation")
    options = parser.parse_args()
    options.keep.mkdir(parents=True, exist_ok=True)
    shipped = read_config(ROOT / "configs" / "auto.toml")
    config = replace(shipped, data=replace(shipped.data, count=options.count))
    sets: list[Meshes] = [
        [(as_mesh(pair.noisy), as_mesh(pair.clean)) for pair in find_pairs([options.folder])],
        generated(without(config.data, "fused", "view")),
        *(generated(config.data, families=(seen,), noise_kinds=("sensor",)) for seen in ("view", "fused")),
    ]
    rows: dict[str, list[list[float]]] = {}
    with side_by_side(thread_count()) as each:
        for name, changed in variants(config).items():
            for seed in options.seeds:
                path = options.keep / f"{name.replace(' ', '-')}-{options.count}-{seed}.safetensors"
                seeded = replace(changed, seed=seed, data=replace(changed.data, seed=seed))
                cascade = trained(seeded, path)
                if name == WHOLE:
                    for count in range(1, len(cascade.stages)):
                        shorter = Cascade(cascade.stages[:count], cascade.card)
                        title = "stage 1 alone" if count == 1 else f"stages 1 to {count}"
                        rows.setdefault(title, []).append(angles(shorter, sets, each))
                rows.setdefault(name, []).append(angles(cascade, sets, each))
                print(name, seed, rows[name][-1], flush=True)
            write_table(rows, options.count, len(options.seeds), shipped.data.count)


if __name__ == "__main__":
    main()
