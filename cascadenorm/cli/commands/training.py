"""Commands for training data and models."""

import shlex
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from cascadenorm.cli.options import Force, Scheduler, app, control_options
from cascadenorm.errors import counted


@app.command()
def generate(
    folder: Annotated[Path, Argument(metavar="OUT", help="Folder to create for the data set.")],
    *,
    count: Annotated[int, Option(min=1, help="Number of pairs.")] = 100,
    seed: Annotated[int, Option(min=0, help="Seed of the random numbers. The same seed generates the same files.")] = 0,
    workers: Annotated[int, Option(min=1, help="Number of processes. The files do not depend on it.")] = 1,
    scheduler: Scheduler = None,
    force: Annotated[bool, Option("--force", help="Write into a folder that is not empty.")] = False,
) -> None:
    """Generate pairs of noisy and clean meshes from random shapes with many kinds of noise."""
    from cascadenorm.api.training_pairs import write_pairs
    from cascadenorm.cli import progress_bars

    with progress_bars.progress_tasks() as progress:
        write_pairs(
            folder, count=count, seed=seed, workers=workers, scheduler=scheduler, force=force, progress=progress
        )
    print(f"{counted(count, 'pair')} in {folder}")


@app.command()
@control_options("threads")
def train(
    *,
    output: Annotated[Path, Option("-o", "--output", help="Weights file to write.")] = Path("cascade.safetensors"),
    config: Annotated[
        Path | None, Option(help="TOML file of settings. Missing settings have their default values.")
    ] = None,
    shapes: Annotated[
        list[Path] | None,
        Option(metavar="PATH", help="File or folder of your own clean meshes. Repeat the option to add several."),
    ] = None,
    noisy: Annotated[
        list[Path] | None,
        Option(
            metavar="DIR", help="Folder of your own pairs of noisy.* and clean.*. Repeat the option to add several."
        ),
    ] = None,
    first_stage: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="Weights file whose first stage is kept. The stages of the settings are trained to follow it.",
        ),
    ] = None,
    quick: Annotated[bool, Option("--quick", help="Train for about a minute to check that training works.")] = False,
    seed: Annotated[
        int | None, Option(min=0, help="Seed of the random numbers. The same seed produces the same file.")
    ] = None,
    log: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="Write the losses and the validation error in degrees after each epoch to this .csv or .jsonl file. "
            "A resumed training appends to it.",
        ),
    ] = None,
    tensorboard: Annotated[
        Path | None, Option(metavar="DIR", help="Write the same values for TensorBoard, which must be installed.")
    ] = None,
    force: Force = False,
    **controls: Any,
) -> None:
    """Train a cascade on generated shapes. An interrupted training resumes when it is started again."""
    from dataclasses import replace

    from cascadenorm.api import models
    from cascadenorm.cli import progress_bars
    from cascadenorm.learned.config import QUICK, TrainConfig, read_config
    from cascadenorm.learned.training.launch import is_main

    if config is not None and quick:
        raise typer.BadParameter("--quick and --config exclude each other, since --quick has its own settings")
    settings = QUICK if quick else TrainConfig() if config is None else read_config(config)
    if seed is not None:
        settings = replace(settings, seed=seed, data=replace(settings.data, seed=seed))
    with progress_bars.progress_tasks(log=True) as progress:
        models.train(
            settings,
            output,
            shapes=shapes or (),
            noisy=noisy or (),
            first_stage=first_stage,
            force=force,
            log=log,
            tensorboard=tensorboard,
            progress=progress,
            **controls,
        )
    if is_main():
        _print_use(output)


@app.command("train-gate")
@control_options("threads")
def train_gate(
    vertex: Annotated[Path, Argument(metavar="VERTEX", help="Weights file trained with configs/vertex.toml.")],
    surface: Annotated[Path, Argument(metavar="SURFACE", help="Weights file trained with configs/surface.toml.")],
    *,
    strong: Annotated[
        Path | None, Option(metavar="FILE", help="Weights file trained with configs/strong.toml after VERTEX.")
    ] = None,
    output: Annotated[Path, Option("-o", "--output", help="Weights file to write.")] = Path("auto.safetensors"),
    seed: Annotated[
        int | None, Option(min=0, help="Seed of the random numbers. The same seed produces the same file.")
    ] = None,
    force: Force = False,
    **controls: Any,
) -> None:
    """Train the gates that let `auto` choose between two trained networks, and write all of them to one file."""
    from cascadenorm.api import models
    from cascadenorm.cli import progress_bars

    with progress_bars.progress_tasks(log=True) as progress:
        models.train_gate(vertex, surface, output, strong=strong, seed=seed, force=force, progress=progress, **controls)
    _print_use(output)


def _print_use(model: Path) -> None:
    print(f"the model is in {model}; use it with: cascadenorm denoise scan.ply --model {shlex.quote(str(model))}")


@app.command("models")
def show_model(
    model: Annotated[str, Argument(help="Shipped model (auto or cascade), or a weights file.")] = "auto",
    *,
    curves: Annotated[
        Path | None, Option(metavar="FILE", help="Show the training curves of a file written by `train --log` instead.")
    ] = None,
    hub: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="Write the model card to this file in the format of the Hugging Face Hub, with the digest.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Print the model card of a model as JSON: training data, settings and validation error."""
    from cascadenorm.api import models
    from cascadenorm.cli import tables
    from cascadenorm.learned.training.training_log import read_passes

    if curves is not None:
        tables.print_curves(read_passes(curves))
        return
    if hub is not None:
        from cascadenorm.api.model_cards import hub_card
        from cascadenorm.io.atomic import write_atomically

        write_atomically(hub, [hub_card(model).encode()], force=force)
        return

    tables.print_json("models", {"model": model, "card": models.load_model(model).card})


@app.command("export-onnx")
def export_onnx(
    folder: Annotated[Path, Argument(metavar="OUT", help="Folder to create for stage1.onnx, stage2.onnx, and so on.")],
    *,
    model: Annotated[
        str, Option(metavar="NAME|FILE", help="Shipped model (auto or cascade), or a weights file.")
    ] = "auto",
    force: Force = False,
) -> None:
    """Export the networks of a model as ONNX files, one per stage. See docs/models.md for inputs and outputs."""
    from cascadenorm.api import models

    for path in models.export_onnx(models.load_model(model), folder, force=force):
        print(path)
