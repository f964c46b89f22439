"""Measure how much each change from the published method to the model of `auto` improves the result.

    python -m benchmarks.accuracy.ablation PAIRS [--count 1000] [--max-faces 4000] [--seeds 0 1 2] [--clusters 1 4]
        [--keep FOLDER] [--record]

Trains each rung of the ladder from configs/cascade.toml to configs/surface.toml, once for each seed and number of
clusters, on the data of `auto` with fewer and smaller shapes. Measures on PAIRS and on pairs generated from a seed that
no training has. Trainings of a seed share their generated pairs. Pairs, models and figures stay in FOLDER, so an
interrupted run resumes and ends with the same table; what was measured with the same settings is not trained again.
With the settings above there are 36 trainings, which take several hours on two cores. The table is that of
benchmarks/ablation.md.
"""

import argparse
import json
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import results
from cascadenorm.data_gen import DatasetConfig, pairs
from cascadenorm.execution.process_map import Map, parallel_map
from cascadenorm.io.atomic import write_atomically
from cascadenorm.io.interop import as_mesh
from cascadenorm.io.pairs import find_pairs
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.config import TrainConfig, read_config
from cascadenorm.learned.training import training
from cascadenorm.mesh import Mesh, Vectors, angles_between, thread_count

ROOT = Path(__file__).parents[2]
UNSEEN = 1_000_003  # seed of the generated pairs that are measured on

Sets = dict[str, list[tuple[Mesh, Vectors]]]
"""Noisy meshes and the true normals of their faces (zero if unknown) by kind of mesh."""
KINDS: dict[str, tuple[str, ...]] = {
    "depth cameras": ("view", "fused"),
    "segmentations": ("segmentation", "slices"),
    "tomograms": ("tomogram",),
    "points": ("points",),
}
"""Families of measured surfaces."""


def ladder(paper: TrainConfig, auto: TrainConfig) -> dict[str, TrainConfig]:
    """Return the settings of each rung by what it adds to the previous one. Data and optimiser are those of `auto`."""
    step = replace(
        paper,
        seed=auto.seed,
        faces_per_mesh=auto.faces_per_mesh,
        context=0,  # which the paper lacks
        data=auto.data,
        fit=replace(auto.fit, hidden=paper.fit.hidden),
    )
    rungs = {"the paper": step}
    published = paper.stages[0]
    update = {"weighting": published.weighting, "foldovers": published.foldovers}
    others = {"activation": published.activation, "sweeps": published.sweeps, "pairs": published.pairs}
    filtered, fitted = (tuple(replace(stage, **others, **kept) for stage in auto.stages) for kept in (update, {}))
    changes = {
        "+ iterated filters, smoothed vertices, in place of one pass and guided filters": {"stages": filtered},
        "+ context features": {"context": auto.context},
        "+ fits with cotangent weights, foldovers avoided": {"stages": fitted},
        "+ two hidden layers, fewer sweeps between the stages, 64 pairs of normals": {
            "fit": auto.fit,
            "stages": auto.stages,
        },
    }
    for name, change in changes.items():
        step = replace(step, **change)
        rungs[name] = step
    return rungs


def trained(config: TrainConfig, path: Path, generated: Path) -> Cascade:
    """Train or resume training unless the model exists already. Models with other settings are replaced."""
    if path.exists() and (kept := Cascade.load(path)).card["config"] == json.loads(json.dumps(asdict(config))):
        return kept
    checkpoint = path.with_suffix(".training")
    cascade = training.train_cascade(config, checkpoint, generated=generated)
    write_atomically(path, [cascade.to_bytes()], force=True)
    shutil.rmtree(checkpoint)
    return cascade


def measured(cascade: Cascade, sets: Sets, each: Map) -> dict[str, float]:
    """Return the mean angle of normals over the meshes of each set, in degrees."""
    return {name: float(np.mean(list(each(partial(angle, cascade), meshes)))) for name, meshes in sets.items()}


def angle(cascade: Cascade, pair: tuple[Mesh, Vectors]) -> float:
    """Return the mean angle of the normals of a denoised mesh in degrees. Faster than `measure`."""
    noisy, normals = pair
    known = normals.any(axis=1)
    denoised = noisy.moved(cascade.vertices(noisy))
    return float(np.degrees(angles_between(denoised.face_normals[known], normals[known]).mean()))


def measured_on(folder: Path, data: DatasetConfig, unseen: int) -> Sets:
    """Return the pairs of a folder and generated pairs that were not used for training, `unseen` of each kind."""
    measured = {family for families in KINDS.values() for family in families}
    shapes = tuple(family for family in data.families if family not in measured)
    return {
        "public models": [(as_mesh(pair.noisy), as_mesh(pair.clean).face_normals) for pair in find_pairs([folder])],
        "independent noise": generated(data, unseen, families=shapes, noise_kinds=("normal", "gaussian", "uniform")),
        "correlated error": generated(data, unseen, families=shapes, noise_kinds=("correlated",)),
        **{
            kind: generated(data, unseen, families=families, noise_kinds=("sensor",))
            for kind, families in KINDS.items()
        },
    }


def generated(data: DatasetConfig, count: int, **changes: object) -> list[tuple[Mesh, Vectors]]:
    """Generate pairs that were not used for training."""
    unseen = replace(data, seed=UNSEEN, count=count, **changes)
    return [(pair.noisy, pair.normals) for pair in pairs(unseen, workers=thread_count())]


def cell(values: Iterable[float]) -> str:
    """Return the mean over the seeds and half the difference of the largest and the smallest value."""
    found = np.array(list(values))
    return f"{found.mean():.2f} ± {np.ptp(found) / 2:.2f}"


def table(figures: results.Figures) -> str:
    """Return a row for each rung and number of clusters: the means over the seeds and half their range."""
    rows: dict[tuple[str, int], list[dict[str, float]]] = {}
    for one in figures["trainings"]:
        rows.setdefault((one["rung"], one["clusters"]), []).append(one["degrees"])
    sets = list(figures["trainings"][0]["degrees"])
    cells = [
        [rung, f"{clusters}", f"{len(found)}", *(cell(degrees[name] for degrees in found) for name in sets)]
        for (rung, clusters), found in rows.items()
    ]
    caption = f"Trained on {figures['count']:,} shapes of at most {figures['max_faces']:,} faces."
    return f"{caption}\n\n{results.markdown(['', 'clusters', 'seeds', *sets], cells)}"


def run(
    rungs: dict[str, TrainConfig],
    sets: Sets,
    keep: Path,
    *,
    seeds: Sequence[int],
    clusters: Sequence[int],
) -> dict[str, Any]:
    """Train and measure every rung with each seed. The figures are written after each training."""
    keep.mkdir(parents=True, exist_ok=True)
    file = keep / "figures.json"
    known = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    trainings = []
    with parallel_map(thread_count()) as each:
        for seed in seeds:
            for rung, (name, settings) in enumerate(rungs.items()):
                data = replace(settings.data, seed=seed)
                for k in clusters:
                    config = replace(settings, seed=seed, clusters=k, data=data)
                    digest = _digest(config)
                    if digest not in known or known[digest].keys() != sets.keys():
                        path = keep / f"rung{rung}-clusters{k}-seed{seed}.safetensors"
                        cascade = trained(config, path, keep / f"pairs-{_digest(data)}")
                        known[digest] = measured(cascade, sets, each)
                        write_atomically(file, [json.dumps(known, indent=1).encode()], force=True)
                    trainings.append({"rung": name, "clusters": k, "seed": seed, "degrees": known[digest]})
                    print(trainings[-1], flush=True)
    data = next(iter(rungs.values())).data
    return {"count": data.count, "max_faces": data.max_faces, "trainings": trainings}


def _digest(settings: TrainConfig | DatasetConfig) -> str:
    return sha256(repr(settings).encode()).hexdigest()[:12]


def main(arguments: Sequence[str] | None = None) -> None:
    """Train and measure all rungs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="PAIRS", help="folder of */noisy.* and */clean.*")
    parser.add_argument("--count", type=int, default=1000, help="shapes to train on")
    parser.add_argument("--max-faces", type=int, default=4000, help="of each of them")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--clusters", type=int, nargs="+", default=[1, 4])
    parser.add_argument("--keep", type=Path, default=ROOT / "runs" / "ablation", metavar="FOLDER")
    results.add_option(parser, "ablation")
    options = parser.parse_args(arguments)
    paper, auto = (read_config(ROOT / "configs" / f"{name}.toml") for name in ("cascade", "surface"))
    auto = replace(auto, data=replace(auto.data, count=options.count, max_faces=options.max_faces))
    sets = measured_on(options.folder, auto.data, unseen=24)
    figures = run(ladder(paper, auto), sets, options.keep, seeds=options.seeds, clusters=options.clusters)
    results.report(options.record, figures, table)


if __name__ == "__main__":
    main()
