"""Commands for training data and models."""

from pathlib import Path
from typing import Annotated, Any

import typer

from cascadenorm.cli.app import app
from cascadenorm.cli.options import Force, takes_controls
from cascadenorm.messages import counted


@app.command()
def generate(
    folder: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for the data set; it is made.")],
    *,
    count: Annotated[int, typer.Option(min=1, help="Pairs to make.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="The same seed makes the same files.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes; the files are the same.")] = 1,
    force: Annotated[bool, typer.Option("--force", help="Write into a folder that is not empty.")] = False,
) -> None:
    """Make pairs of noisy and clean meshes: generated shapes, many kinds of noise."""
    from cascadenorm.cli import progress_bars
    from cascadenorm.evaluation import pairs

    with progress_bars.progress_tasks() as progress:
        pairs.write_pairs(folder, count=count, seed=seed, workers=workers, force=force, progress=progress)
    print(f"{counted(count, 'pair')} in {folder}")


@app.command()
@takes_controls("threads")
def train(
    *,
    output: Annotated[Path, typer.Option("-o", "--output", help="The weights file to write.")] = Path(
        "cascade.safetensors"
    ),
    config: Annotated[Path | None, typer.Option(help="Settings as TOML; what it leaves out keeps its default.")] = None,
    shapes: Annotated[
        list[Path] | None, typer.Option(help="Clean meshes of your own, a file or folder; may be given several times.")
    ] = None,
    noisy: Annotated[
        list[Path] | None, typer.Option(help="Pairs of your own, noisy.* and clean.*; may be given several times.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A minute's training, to see that it works.")] = False,
    seed: Annotated[int | None, typer.Option(min=0, help="The same seed makes the same file.")] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write losses and the validation error in degrees after each pass, as .csv or .jsonl; an interrupted "
            "training goes on with the file.",
        ),
    ] = None,
    tensorboard: Annotated[
        Path | None, typer.Option(metavar="DIR", help="The same for TensorBoard, if it is installed.")
    ] = None,
    force: Force = False,
    **controls: Any,
) -> None:
    """Train a cascade on generated shapes; interrupted and started again, it goes on where it was."""
    from dataclasses import replace

    from cascadenorm import models
    from cascadenorm.cli import progress_bars
    from cascadenorm.learned.config import QUICK, TrainConfig, read_config
    from cascadenorm.learned.launch import is_main

    if config is not None and quick:
        raise typer.BadParameter("--quick has settings of its own: give it or --config, not both")
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


@app.command("models")
def show_model(
    model: Annotated[str, typer.Argument(help="auto or cascade, which come with the package, or a file.")] = "auto",
    *,
    curves: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Show the curves of a training instead, which train --log has written."),
    ] = None,
    hub: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the card in the format of the Hugging Face Hub, with the digest."),
    ] = None,
    force: Force = False,
) -> None:
    """Print the card of a model: what it was made of, how, and how well it fits, as JSON."""
    from cascadenorm import models
    from cascadenorm.cli import json_output, tables
    from cascadenorm.learned.training_log import read_passes

    if curves is not None:
        tables.print_curves(read_passes(curves))
        return
    if hub is not None:
        from cascadenorm.io.atomic import write_atomically
        from cascadenorm.model_cards import hub_card

        write_atomically(hub, [hub_card(model).encode()], force=force)
        return

    json_output.print_json("models", {"model": model, "card": models.named(model).card})


@app.command("export-onnx")
def export_onnx(
    folder: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for stage1.onnx and so on; it is made.")],
    *,
    model: Annotated[str, typer.Option(help="auto or cascade, which come with the package, or a file.")] = "auto",
    force: Force = False,
) -> None:
    """Write the networks of a model as ONNX files, one a stage; docs/models.md has their inputs and outputs."""
    from cascadenorm import models

    for path in models.export_onnx(models.named(model), folder, force=force):
        print(path)
