"""The server answers its own page alone, says what it cannot serve, and ends when its page is closed."""

import asyncio
import socket
import sys
from contextlib import closing
from http.client import HTTPConnection
from types import SimpleNamespace

import numpy as np
import pytest
from scans import LAPLACIAN, scanned

from cascadenorm.cli import run
from cascadenorm.studio import server
from cascadenorm.studio.session import Session


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"authorization": None}, 401),
        ({"authorization": "Bearer "}, 401),
        ({"authorization": "Bearer wrong"}, 401),
        ({"authorization": "Bearer té"}, 401),
        ({"host": "attacker.example"}, 403),
        ({"host": "127.0.0.1"}, 403),
        ({"host": "127.0.0.1.attacker.example"}, 403),
        ({"origin": "http://attacker.example"}, 403),
        ({"origin": "null"}, 403),
        ({"origin": None}, 403),
        ({"sec_fetch_site": "cross-site"}, 403),
        ({"sec_fetch_site": "same-site"}, 403),
    ],
    ids=str,
)
def test_only_its_own_page_with_the_token_is_answered(studio, headers, status):
    found, answer = studio.asked("POST", "/api/recipe", {"settings": LAPLACIAN, "name": "out.ply"}, **headers)
    assert found == status
    assert ("command" in answer) == (status == 200)


def test_the_port_of_another_server_is_no_origin(studio):
    assert studio.asked("POST", "/api/cancel", {}, origin=f"http://127.0.0.1:{int(studio.port) + 1}")[0] == 403
    assert studio.asked("POST", "/api/cancel", {}, origin=f"https://{studio.host}")[0] == 403


def test_the_page_is_served_without_a_token_and_loads_nothing_from_elsewhere(studio):
    status, page = studio.asked("GET", "/", authorization=None, origin=None)
    assert status == 200 and b"/studio.js" in page and b"http" not in page.replace(b"http-equiv", b"")
    assert "default-src 'none'" in studio.headers["content-security-policy"]
    assert "frame-ancestors 'none'" in studio.headers["content-security-policy"]
    assert studio.headers["cross-origin-resource-policy"] == "same-origin"
    assert "access-control-allow-origin" not in studio.headers
    assert studio.asked("GET", "/", host="attacker.example")[0] == 403


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has all of 127.0.0.0/8 on its loopback interface")
def test_other_addresses_of_this_machine_are_not_served(studio):
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", int(studio.port)))


@pytest.mark.parametrize(
    ("content", "code"),
    [
        ("no mesh", 3),
        ("", 3),
        ("ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\n", 3),
        (
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
            "element face 0\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n",
            4,
        ),
    ],
)
def test_a_file_that_is_no_mesh_is_refused_in_the_words_of_denoise(tmp_path, capsys, content, code):
    bad = tmp_path / "bad.ply"
    bad.write_text(content, encoding="utf-8", newline="")
    assert run(["denoise", str(bad)]) == code
    told = capsys.readouterr().err
    assert run(["studio", "--no-browser", str(bad)]) == code
    assert capsys.readouterr().err == told


def test_what_cannot_be_served_is_said_on_the_command_line(tmp_path, capsys):
    scanned(tmp_path / "scan.ply")
    assert run(["studio", "--no-browser", str(tmp_path / "none.ply")]) == 3
    assert "does not exist" in capsys.readouterr().err
    assert run(["studio", "--no-browser", str(tmp_path)]) == 3
    assert "is a folder" in capsys.readouterr().err
    assert run(["studio", "--no-browser", str(tmp_path / "scan.ply"), "--max-size", "0.001"]) == 3
    assert "exceeds the limit of the studio" in capsys.readouterr().err
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        assert run(["studio", "--no-browser", "--port", port]) == 5
    assert f"port {port} cannot be used" in capsys.readouterr().err


def test_the_size_of_files_may_be_unlimited(monkeypatch):
    given = {}
    monkeypatch.setattr(server, "serve", lambda _, **settings: given.update(settings))
    assert run(["studio", "--max-size", "inf"]) == 0 and given["most"] == np.inf


@pytest.mark.skipif(sys.platform == "win32", reason="Windows kills a process at once")
def test_the_end_of_the_studio_ends_the_events_of_its_page_and_waits_for_none(empty_studio):
    with closing(HTTPConnection(empty_studio.host)) as connection:
        connection.request("GET", "/api/events", headers={"authorization": f"Bearer {empty_studio.token}"})
        events = connection.getresponse()
        events.readline()
        empty_studio.process.terminate()
        events.read()  # raises IncompleteRead if the server has waited for the events, and cut them off then


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
