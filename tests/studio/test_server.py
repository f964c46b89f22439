"""When the server of the studio ends, and what it is started with."""

import asyncio
from types import SimpleNamespace

import numpy as np
import pytest

from cascadenorm.cli import run
from cascadenorm.studio import server
from cascadenorm.studio.session import Session


def test_the_size_of_files_may_be_unlimited(monkeypatch):
    given = {}
    monkeypatch.setattr(server, "serve", lambda _, **settings: given.update(settings))
    assert run(["studio", "--max-size", "inf"]) == 0 and given["most"] == np.inf


def ends_after(monkeypatch, *events):
    """Seconds after which a studio ends, whose page does something at some seconds; the clock is one of the test."""
    passed, left, pages = 0.0, list(events), []
    session, stopped = Session(), SimpleNamespace(should_exit=False)

    async def sleep(seconds):
        nonlocal passed
        passed += seconds
        assert passed < 10_000, "it never ends"
        while left and left[0][0] <= passed:
            session.requests += 1
            match left.pop(0)[1]:
                case "listens":
                    pages.append(session.page())
                    await pages[-1].__aenter__()
                case "leaves":
                    session.leave()
                    await pages.pop().__aexit__(None, None, None)
                case "is lost":
                    await pages.pop().__aexit__(None, None, None)

    monkeypatch.setattr(server.asyncio, "sleep", sleep)
    asyncio.run(server._end_without_pages(session, stopped))
    assert stopped.should_exit and not left
    return passed


@pytest.mark.parametrize(
    ("events", "seconds"),
    [
        ([(1, "loads")], 1 + server.LOADING_S),  # closed before it listened
        ([(1, "loads"), (50, "listens"), (55, "leaves")], 55 + server.RELOADING_S),
        ([(1, "listens"), (5, "leaves"), (7, "listens"), (9, "leaves")], 9 + server.RELOADING_S),
        ([(1, "listens"), (5, "is lost")], 5 + server.AWAITING_S),
        ([(1, "listens"), (5, "is lost"), (3000, "listens"), (3010, "leaves")], 3010 + server.RELOADING_S),
    ],
    ids=["closed while it starts", "closed", "loaded again", "discarded", "discarded and loaded again"],
)
def test_the_studio_ends_when_its_page_is_closed_and_waits_for_one_that_is_discarded(monkeypatch, events, seconds):
    assert ends_after(monkeypatch, *events) == pytest.approx(seconds, abs=2.5 * server.CHECKING_S)
