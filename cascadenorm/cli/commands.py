"""The command line: a command parses, calls one public function, prints.

Results go to stdout, messages and progress to stderr. What a command uses is imported in it, so that the command line
starts at once.
"""

import errno
import os
import signal
import sys
from collections.abc import Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn, cast

import typer

from cascadenorm.messages import counted

app = typer.Typer(
    name="cascadenorm",
    help="Denoise triangle meshes by cascaded normal regression, or by one of the classical methods.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

DONE, FAILED, USAGE, UNREADABLE, INVALID, OUTPUT, PARTLY, INTERRUPTED = 0, 1, 2, 3, 4, 5, 6, 130
SPELLINGS = {
    "on_bad='isolate'": "--on-bad isolate",
    "on_bad is": "--on-bad is",
    "keep_detail is": "--keep-detail is",
    "max_displacement is": "--max-displacement is",
}
"""What messages say of a control in Python, and what it is called here."""
USAGE_ERROR = cast(type[Exception], typer.BadParameter.__base__)  # click's own, or that of the copy in typer

Method = Annotated[str, typer.Option(help="One of those that `cascadenorm methods` lists.")]
Set = Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the method.")]
Strength = Annotated[float, typer.Option(min=0, help="0 nothing, 1 the method, 2 applied twice; any number.")]
Threads = Annotated[int | None, typer.Option(min=1, help="At most this many; the result is the same.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object, as docs/json.md describes it.")]


@app.callback(invoke_without_command=True)
def options(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    """Denoise triangle meshes by cascaded normal regression, or by one of the classical methods."""
    if version:
        from cascadenorm import __version__

        print(f"cascadenorm {__version__}")
        raise typer.Exit


@app.command()
def denoise(
    source: Annotated[str, typer.Argument(metavar="IN", help="Mesh file, or - for stdin.")],
    *,
    output: Annotated[
        str | None,
        typer.Option("-o", "--output", help="File, whose extension decides on the format, or - for stdout."),
    ] = None,
    method: Method = "auto",
    model: Annotated[Path | None, typer.Option(help="Weights of your own, for auto or cascade.")] = None,
    strength: Strength = 1.0,
    mask: Annotated[
        str | None,
        typer.Option(metavar="NAME|FILE", help="Where to denoise: a vertex attribute 0…1, or a .npy or .txt file."),
    ] = None,
    fixed: Annotated[
        str | None,
        typer.Option(metavar="NUMBERS|NAME|FILE", help='Vertices that stay: "0,5,7-20" from 0, an attribute, a file.'),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[KIND=]NAME",
            help="Only faces of this material, group, object, mesh, or face property; may be given several times.",
        ),
    ] = None,
    creases: Annotated[
        str | None,
        typer.Option(
            metavar="DEGREES|FILE",
            help="Mix nothing across edges sharper than this, of which noise makes some; or across those in a file, "
            "two vertices a line.",
        ),
    ] = None,
    boundary: Annotated[
        str,
        typer.Option(
            metavar="free|smooth|fixed",
            help="Rims: as the method moves them, smoothed along the surface as curves, or left as they are.",
        ),
    ] = "free",
    keep_detail: Annotated[
        str | None,
        typer.Option(metavar="LENGTH", help='Smallest feature to keep, in the unit of the mesh or like "4 edges".'),
    ] = None,
    max_displacement: Annotated[
        str | None, typer.Option(metavar="LENGTH", help='In the unit of the mesh, or "0.5 edges" (mean edge lengths).')
    ] = None,
    keep_volume: Annotated[bool, typer.Option("--keep-volume", help="Scale closed parts to their volume.")] = False,
    on_bad: Annotated[
        str, typer.Option(metavar="WHAT", help="error, or isolate: leave bad vertices and faces alone, do the rest.")
    ] = "error",
    settings: Set = None,
    threads: Threads = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Denoise a mesh file; by default into <stem>_denoised<suffix> beside it."""
    from dataclasses import asdict

    from cascadenorm import api
    from cascadenorm.cli import report

    target: Any = output if output is not None else ("-" if source == "-" else None)
    parameters = _parameters(settings)
    if model is not None:
        parameters["model"] = model
    with report.progress_bar("denoising") as progress:
        done = api.denoise_file(
            sys.stdin.buffer if source == "-" else source,
            sys.stdout.buffer if target == "-" else target,
            method=method,
            parameters=parameters,
            on_bad=cast(Any, on_bad),  # the function holds what it may be
            force=force,
            strength=strength,
            mask=mask,
            fixed=fixed,
            only=only or None,  # older versions of typer give an empty list
            creases=creases,
            boundary=boundary,
            keep_detail=keep_detail,
            max_displacement=max_displacement,
            volume="keep" if keep_volume else None,
            threads=threads,
            progress=progress,
        )
    out = sys.stderr if target == "-" else sys.stdout
    if as_json:
        report.print_json("denoise", asdict(done), file=out)
    else:
        report.print_denoised(done, file=out)


@app.command()
def inspect(
    source: Annotated[str, typer.Argument(metavar="IN", help="Mesh file, or - for stdin.")],
    *,
    self_intersections: Annotated[
        bool | None,
        typer.Option(help="Look for faces that cross, or do not; by default only in meshes of moderate size."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Say what a mesh is, what is wrong with it and where, and how noisy it is."""
    from dataclasses import asdict

    from cascadenorm import inspection
    from cascadenorm.cli import report

    found = inspection.inspect(sys.stdin.buffer if source == "-" else source, self_intersections=self_intersections)
    if as_json:
        report.print_json("inspect", asdict(found))
    else:
        report.print_inspection(found)


@app.command()
def compare(
    mesh: Annotated[str, typer.Argument(metavar="MESH", help="The mesh to judge, or - for stdin.")],
    reference: Annotated[str, typer.Argument(metavar="REFERENCE", help="The true mesh.")],
    *,
    as_json: Json = False,
) -> None:
    """Measure a mesh against the true one."""
    from dataclasses import asdict

    from cascadenorm import api
    from cascadenorm.cli import report

    measures = api.compare(sys.stdin.buffer if mesh == "-" else mesh, reference)
    if as_json:
        report.print_json("compare", {"mesh": mesh, "reference": reference, "measures": asdict(measures)})
    else:
        report.print_measures(measures)


@app.command()
def evaluate(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Pairs, or folders of pairs.")],
    *,
    method: Annotated[list[str] | None, typer.Option(help="May be given several times.")] = None,
    strength: Strength = 1.0,
    settings: Set = None,
    threads: Threads = None,
    csv: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the table to a file as well.")] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Denoise pairs of noisy.* and clean.* by several methods, and measure the results."""
    from cascadenorm.cli import report
    from cascadenorm.evaluation import harness
    from cascadenorm.io.atomic import check_output

    if csv is not None:
        check_output(csv, force=force)
    with report.progress_steps() as progress:
        done = harness.evaluate(
            folders,
            methods=method or harness.DEFAULT_METHODS,
            parameters=_parameters(settings),
            strength=strength,
            threads=threads,
            progress=progress,
        )
    for failure in done.failures:
        _complain(f"{failure.pair}{f', {failure.method}' if failure.method else ''}: {failure.error}")
    if as_json:
        report.print_json("evaluate", report.evaluation_object(done))
    else:
        report.print_evaluation(done)
    if csv is not None:
        report.write_table(csv, done, force=force)
    if done.failures:
        raise typer.Exit(PARTLY)


@app.command()
def methods(
    name: Annotated[str | None, typer.Argument(help="Show this method's parameters.")] = None, *, as_json: Json = False
) -> None:
    """List the methods, or the parameters of one."""
    from cascadenorm import api
    from cascadenorm.cli import report
    from cascadenorm.registry import find

    known = api.methods()
    chosen = known if name is None else {name: find(name)}
    if as_json:
        report.print_json("methods", {"methods": [report.method_object(method) for method in chosen.values()]})
    elif name is None:
        report.print_methods(known)
    else:
        report.print_method(chosen[name])


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
    from cascadenorm.cli import report
    from cascadenorm.evaluation import pairs

    with report.progress_steps() as progress:
        pairs.write_pairs(folder, count=count, seed=seed, workers=workers, force=force, progress=progress)
    print(f"{counted(count, 'pair')} in {folder}")


@app.command()
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
    threads: Threads = None,
    force: Force = False,
) -> None:
    """Train a cascade on generated shapes; interrupted and started again, it goes on where it was."""
    from dataclasses import replace

    from cascadenorm import models
    from cascadenorm.cli import report
    from cascadenorm.learned.config import QUICK, TrainConfig, read_config
    from cascadenorm.learned.launch import tells

    if config is not None and quick:
        raise typer.BadParameter("--quick has settings of its own: give it or --config, not both")
    settings = QUICK if quick else TrainConfig() if config is None else read_config(config)
    if seed is not None:
        settings = replace(settings, seed=seed, data=replace(settings.data, seed=seed))
    with report.progress_tasks() as progress:
        models.train(
            settings,
            output,
            shapes=shapes or (),
            noisy=noisy or (),
            force=force,
            threads=threads,
            progress=progress,
        )
    if tells():
        print(f"the model is in {output}; use it with: cascadenorm denoise scan.ply --model {output}")


@app.command("models")
def show_model(
    model: Annotated[str, typer.Argument(help="auto or cascade, which come with the package, or a file.")] = "auto",
) -> None:
    """Print the card of a model: what it was made of, how, and how well it fits, as JSON."""
    from cascadenorm import models
    from cascadenorm.cli import report

    denoiser = models.Denoiser.shipped(model) if model in models.SHIPPED else models.Denoiser.load(model)
    report.print_json("models", {"model": model, "card": denoiser.card})


@app.command()
def demo(
    folder: Annotated[Path, typer.Argument(help="Where to leave meshes and pictures; it is made.")] = Path(
        "cascadenorm-demo"
    ),
) -> None:
    """Denoise three meshes that come with the package; leave meshes and pictures in a folder."""
    from cascadenorm.cli import demo as demonstration
    from cascadenorm.cli import report

    with report.progress_steps() as progress:
        examples = demonstration.demo(folder, progress=progress)
    report.print_table(demonstration.table(examples))
    print(f"meshes and pictures are in {folder}; look at {folder / demonstration.BEFORE_AFTER} first")


@app.command("fill-holes")
def fill_holes(
    source: Annotated[Path, typer.Argument(metavar="IN", help="Mesh file.")],
    *,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="File; by default <stem>_filled<suffix> beside the source.")
    ] = None,
    order: Annotated[int, typer.Option(min=1, max=3, help="1 membrane, 2 goes on smoothly, 3 in curvature too.")] = 2,
    max_edges: Annotated[int | None, typer.Option(min=3, help="Leave longer holes open, an outer rim say.")] = None,
    force: Force = False,
) -> None:
    """Close the holes of a mesh by patches as dense as what is around them; what is there stays as it is."""
    from cascadenorm import api
    from cascadenorm.cli import report

    target = api.beside(source, "filled") if output is None else output
    kind = cast(Literal[1, 2, 3], order)  # typer holds the range
    done = api.fill_holes_file(source, target, order=kind, max_edges=max_edges, force=force)
    print(f"{target}: {counted(done.added, 'face')} added to {done.faces}")
    report.print_left_out(done.left_out)


@app.command()
def render(
    meshes: Annotated[
        list[str], typer.Argument(metavar="MESH...", help="Side by side, from one place if they lie alike.")
    ],
    *,
    output: Annotated[Path, typer.Option("-o", "--output", help="PNG file.")],
    size: Annotated[int, typer.Option(min=16, help="Width and height of each picture in pixels.")] = 600,
    force: Force = False,
) -> None:
    """Draw meshes into a picture, without a graphics card or a window."""
    from cascadenorm.render.files import draw

    draw(meshes, output, size=size, force=force)
    print(output)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit; every error becomes one line on stderr and an exit code here."""
    signal.signal(signal.SIGTERM, _terminated)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # the caller has closed it
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 - until the end
    for stream in (sys.stdout, sys.stderr):  # file names need not be in any encoding
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    sys.exit(run(sys.argv[1:] if arguments is None else arguments))


def run(arguments: Sequence[str]) -> int:
    """Run the command line and return its exit code."""
    try:
        code = app(list(arguments), prog_name="cascadenorm", standalone_mode=False)
        sys.stdout.flush()
        if code == INTERRUPTED:  # what newer typers make of a KeyboardInterrupt
            raise KeyboardInterrupt
        return code if isinstance(code, int) else DONE
    except (KeyboardInterrupt, typer.Abort):
        _complain("interrupted; no file was left half written")
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output has gone
        _give_up_stdout()
        return FAILED
    except USAGE_ERROR as error:
        message = error.format_message() if hasattr(error, "format_message") else str(error)
        if message:  # none: the help was asked for, and has been printed
            _complain(f"{message} (see `cascadenorm --help`)")
        return USAGE
    except Exception as error:
        if os.environ.get("CASCADENORM_TRACEBACK"):
            raise
        code, message = _judged(error)
        _complain(message)
        if code == OUTPUT:
            _give_up_stdout()
        return code


def _terminated(number: int, _: object) -> NoReturn:
    """End as on an error, so that temporary files are removed."""
    raise SystemExit(128 + number)


def _give_up_stdout() -> None:
    """Throw away what cannot be written to stdout, so that Python does not try again at its end."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _judged(error: Exception) -> tuple[int, str]:
    """Exit code and message of an error."""
    from cascadenorm.controls import DenoiseError
    from cascadenorm.io import OutputError, ReadError
    from cascadenorm.learned.config import ConfigError
    from cascadenorm.mesh import MeshError
    from cascadenorm.registry import ParameterError
    from cascadenorm.workers import WorkerError

    codes = {
        ParameterError: USAGE,
        ConfigError: USAGE,
        ReadError: UNREADABLE,
        MeshError: INVALID,
        OutputError: OUTPUT,
        DenoiseError: FAILED,
        WorkerError: FAILED,
    }
    for kind, code in codes.items():
        if isinstance(error, kind):
            return code, str(error)
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO):
        return OUTPUT, f"the output cannot be written: {error.strerror}"
    if isinstance(error, MemoryError):
        return FAILED, "there is not enough memory for this mesh"
    name = type(error).__name__
    return FAILED, f"{name}: {error} (please report it; CASCADENORM_TRACEBACK=1 shows where it comes from)"


def _complain(message: str) -> None:
    for in_python, here in SPELLINGS.items():
        message = message.replace(in_python, here)
    print(f"cascadenorm: {' '.join(message.split())}", file=sys.stderr)


def _parameters(settings: Sequence[str] | None) -> dict[str, Any]:
    """Read NAME=VALUE pairs; the method checks names and values."""
    pairs = [setting.partition("=") for setting in settings or ()]
    for name, equals, _ in pairs:
        if not (name and equals):
            raise typer.BadParameter(f"--set {name or equals}: write it as NAME=VALUE")
    return {name.strip().replace("-", "_"): value.strip() for name, _, value in pairs}
