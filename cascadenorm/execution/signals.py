"""Repeat signals whose exceptions are lost in callbacks of libraries, and ignore repeated ones during a clean-up."""

import signal
import sys
from _thread import interrupt_main
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer, current_thread, main_thread
from types import FrameType

RETRY_S = 0.05  # time until a signal is repeated


def repeat_if_swallowed(number: int, exception: type[BaseException]) -> None:
    """Repeat a signal if the exception that its installed handler raises arrives where Python cannot raise it."""
    handler = signal.getsignal(number)

    def repeat() -> None:
        if sys.platform == "win32":
            interrupt_main(number)
        else:
            signal.pthread_kill(main_thread().ident or 0, number)  # also ends a wait of the main thread

    def hook(unraisable: "sys.UnraisableHookArgs") -> None:
        if not issubclass(unraisable.exc_type, exception):
            sys.__unraisablehook__(unraisable)
            return
        signal.signal(number, handler)  # the handler may ignore further signals
        timer = Timer(RETRY_S, repeat)
        timer.daemon = True
        timer.start()

    sys.unraisablehook = hook


@contextmanager
def interrupted_once() -> Iterator[None]:
    """Ignore all but the first Ctrl-C within the context, so that what the first one ends can clean up.

    Blocking the signal in the main thread would not suffice: threads of libraries, such as OpenBLAS, receive it, too.
    """
    before = signal.getsignal(signal.SIGINT)
    if current_thread() is not main_thread() or not callable(before):
        yield
        return

    def handle(number: int, frame: FrameType | None) -> None:
        signal.signal(number, _ignore)
        before(number, frame)

    signal.signal(signal.SIGINT, handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _ignore(_number: int, _frame: FrameType | None) -> None:
    """Do nothing. Processes that start meanwhile would inherit SIG_IGN, but not this handler."""
