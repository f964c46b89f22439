"""Repeat signals whose exceptions are lost in callbacks of libraries, such as the compiler of kernels."""

import signal
import sys
from _thread import interrupt_main
from threading import Timer, main_thread

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
