"""Run a command and convert errors to messages and exit codes."""

import gc
import os
import shlex
import signal
import sys
from collections.abc import Callable, Sequence
from io import TextIOWrapper
from types import FrameType
from typing import NoReturn, cast

import typer

from cascadenorm.cli.commands import app
from cascadenorm.cli.errors import DONE, FAILED, INTERRUPTED, OUTPUT, USAGE, exit_code, notify, worded
from cascadenorm.cli.plain_calls import plain_call
from cascadenorm.compute.compile_time import tell_of_compiling
from cascadenorm.execution.signals import repeat_if_swallowed

USAGE_ERROR = cast(type[Exception], typer.BadParameter.__base__)  # from click, or from the copy of it in typer

_interruptions: list[int] = []  # Ctrl-C signals that this process has received


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit."""
    signal.signal(signal.SIGTERM, _terminated)
    if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) is signal.SIG_DFL:  # nohup ignores it
        signal.signal(signal.SIGHUP, _terminated)  # the terminal was closed
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # skipped if the signal is ignored
        signal.signal(signal.SIGINT, _interrupted)
        repeat_if_swallowed(signal.SIGINT, KeyboardInterrupt)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # closed by the caller
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 - until the end
    for stream in (sys.stdout, sys.stderr):  # file names may contain characters outside the encoding
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    tell_of_compiling(notify)
    code = run(sys.argv[1:] if arguments is None else arguments)
    if _interruptions:  # let a second Ctrl-C end remaining work without a traceback
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    gc.freeze()  # otherwise Python searches all objects for garbage before it exits
    sys.exit(code)


def run(arguments: Sequence[str]) -> int:
    """Run the command line and return its exit code."""
    call = plain_call(arguments)
    try:
        code = _called(call) if call else app(list(arguments), prog_name="cascadenorm", standalone_mode=False)
        sys.stdout.flush()
        if code == INTERRUPTED:  # newer versions of typer convert KeyboardInterrupt to this
            raise KeyboardInterrupt
        if not arguments:  # help was shown; older versions of click report success here
            return USAGE
        return code if isinstance(code, int) else DONE
    except (KeyboardInterrupt, typer.Abort):
        return _said_interrupted()
    except BrokenPipeError:  # the reader of stdout has exited
        _discard_stdout()
        return FAILED
    except USAGE_ERROR as error:
        message = error.format_message() if hasattr(error, "format_message") else str(error)
        message = message.removeprefix("Invalid value: ").replace(": Value error, ", ": ")
        message = _with_value(message, error, arguments)
        if message:  # empty if help was requested and printed
            context = getattr(error, "ctx", None)
            if context and context.info_name == "denoise" and "unexpected extra argument" in message:
                message += "; to denoise several files use `cascadenorm batch`"
            files = [word for word in arguments if word.startswith("-") and os.path.exists(word)]
            if "No such option" in message and files:
                message += f"; for the file {files[0]} write ./{files[0]}"
            if "No such command" in message and os.path.exists(arguments[0]):
                name = arguments[0]
                message = f"{name} is no command: to denoise it, use `cascadenorm denoise {shlex.quote(name)}`"
            command = context.command_path if context else f"cascadenorm {arguments[0]}"
            notify(f"{message.rstrip('.')} (see `{command} --help`)")
        return USAGE
    except Exception as error:
        if _interruptions:  # libraries may convert an interruption during an import to another error
            return _said_interrupted()
        if os.environ.get("CASCADENORM_TRACEBACK"):
            raise
        notify(worded(error))
        if exit_code(error) == OUTPUT:
            _discard_stdout()
        return exit_code(error)


def _with_value(message: str, error: Exception, arguments: Sequence[str]) -> str:
    """Return a message with the value of an option that is not a number, which newer versions of typer omit."""
    if "unable to parse" not in message and "is not a valid" not in message:
        return message
    number = "a whole number" if "integer" in message else "a number"
    for option in getattr(getattr(error, "param", None), "opts", ()):
        for place, word in enumerate(arguments):
            name, equals, value = word.partition("=")
            if name == option:
                return f"{name} is {(value if equals else arguments[place + 1])!r}; it must be {number}"
    return message


def _called(call: Callable[[], object]) -> int:
    try:
        call()
    except typer.Exit as end:
        return end.exit_code
    return DONE


def _said_interrupted() -> int:
    notify("interrupted; no file was left half written")
    return INTERRUPTED


def _interrupted(number: int, frame: FrameType | None) -> None:
    """Record Ctrl-C and raise KeyboardInterrupt."""
    _interruptions.append(number)
    signal.default_int_handler(number, frame)


def _terminated(number: int, _: object) -> NoReturn:
    """Exit as after an error, so that temporary files are removed."""
    raise SystemExit(128 + number)


def _discard_stdout() -> None:
    """Discard pending output to stdout, so that Python does not try to write it again at exit."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
