"""An interruption that Python swallows comes again."""

import signal
import sys
import time
from types import SimpleNamespace

import pytest

from cascadenorm.execution.signals import repeat_if_swallowed


def test_an_interruption_that_cannot_be_raised_comes_again(monkeypatch):
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # it is ignored in the background of a shell
    try:
        repeat_if_swallowed(signal.SIGINT, KeyboardInterrupt)
        sys.unraisablehook(SimpleNamespace(exc_type=KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            for _ in range(60_000):
                time.sleep(0.01)
    finally:
        signal.signal(signal.SIGINT, before)
