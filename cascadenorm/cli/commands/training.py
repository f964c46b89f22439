"""Commands for training data and models."""

from pathlib import Path
from typing import Annotated, Any

import typer

from cascadenorm.cli.app import app
from cascadenorm.cli.options import Force, Scheduler, control_options
from cascadenorm.errors import counted


@app.command()
def generate(
    folder: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for the data set; it is created.")],
    *,
    count: Annotated[int, typer.Option(min=1, help="Number of pairs.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="The same seed makes the same files.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Number of processes; the files do not depend on it.")] = 1,
    scheduler: Scheduler = None,
    force: Annotated[bool, typer.Option("--force", help="Write into a folder that is not empty.")] = False,
) -> None:
    """Generate pairs of noisy and clean meshes from random shapes with many kinds of noise."""
    from cascadenorm.cli import progress_bars
    from cascadenorm.models.training_pairs import write_pairs

    with progress_bars.progress_tasks() as progress:
        write_pairs(
            folder, count=count, seed=seed, workers=workers, scheduler=scheduler, force=force, progress=progress
        )
    print(f"{counted(count, 'pair')} in {folder}")


@app.command()
@control_options("threads")
def train(
    *,
    output: Annotated[Path, typer.Option("-o", "--output", help="Weights file to write.")] = Path(
        "cascade.safetensors"
    ),
    config: Annotated[
        Path | None, typer.Option(help="TOML file of settings; missing settings keep their defaults.")
    ] = None,
    shapes: Annotated[
        list[Path] | None, typer.Option(help="Your own clean meshes, a file or folder; may be given several times.")
    ] = None,
    noisy: Annotated[
        list[Path] | None,
        typer.Option(help="Folder of your own pairs, noisy.* and clean.*; may be given several times."),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Train for about a minute, to check that training works.")
    ] = False,
    seed: Annotated[int | None, typer.Option(min=0, help="The same seed makes the same file.")] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write losses and the validation error in degrees after each epoch, as .csv or .jsonl; a resumed "
            "training appends to the file.",
        ),
    ] = None,
    tensorboard: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the same for TensorBoard, if it is installed.")
    ] = None,
    force: Force = False,
    **controls: Any,
) -> None:
    """Train a cascade on generated shapes; if interrupted, training resumes when it is started again."""
    from dataclasses import replace

    from cascadenorm.cli import progress_bars
    from cascadenorm.learned.config import QUICK, TrainConfig, read_config
    from cascadenorm.learned.training.launch import is_main
    from cascadenorm.models import models

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
            force=force,
            log=log,
            tensorboard=tensorboard,
            progress=progress,
            **controls,
        )
    if is_main():
        print(f"the model is in {output}; use it with: cascadenorm denoise scan.ply --model {output}")


@app.command("train-gate")
@control_options("threads")
def train_gate(
    vertex: Annotated[Path, typer.Argument(help="Weights trained with configs/vertex.toml.")],
    surface: Annotated[Path, typer.Argument(help="Weights trained with configs/surface.toml.")],
    *,
    output: Annotated[Path, typer.Option("-o", "--output", help="Weights file to write.")] = Path("auto.safetensors"),
    seed: Annotated[int | None, typer.Option(min=0, help="The same seed makes the same file.")] = None,
    force: Force = False,
    **controls: Any,
) -> None:
    """Train the gate that lets `auto` choose between two trained networks, and write all three to one file."""
    from cascadenorm.cli import progress_bars
    from cascadenorm.models import models

    with progress_bars.progress_tasks(log=True) as progress:
        models.train_gate(vertex, surface, output, seed=seed, force=force, progress=progress, **controls)
    print(f"the model is in {output}; use it with: cascadenorm denoise scan.ply --model {output}")


@app.command("models")
def show_model(
    model: Annotated[str, typer.Argument(help="auto or cascade, which are shipped, or a weights file.")] = "auto",
    *,
    curves: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Show the training curves in a file written by `train --log` instead."),
    ] = None,
    hub: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write the model card in the format of the Hugging Face Hub, with the digest."
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Print the model card of a model as JSON: training data, settings and validation error."""
    from cascadenorm.cli import json_output, tables
    from cascadenorm.learned.training.training_log import read_passes
    from cascadenorm.models import models

    if curves is not None:
        tables.print_curves(read_passes(curves))
        return
    if hub is not None:
        from cascadenorm.io.atomic import write_atomically
        from cascadenorm.models.model_cards import hub_card

        write_atomically(hub, [hub_card(model).encode()], force=force)
        return

    json_output.print_json("models", {"model": model, "card": models.named(model).card})


@app.command("export-onnx")
def export_onnx(
    folder: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for stage1.onnx and so on; it is created.")],
    *,
    model: Annotated[str, typer.Option(help="auto or cascade, which are shipped, or a weights file.")] = "auto",
    force: Force = False,
) -> None:
    """Export the networks of a model as ONNX files, one per stage; docs/models.md describes inputs and outputs."""
    from cascadenorm.models import models

    for path in models.export_onnx(models.named(model), folder, force=force):
        print(path)
