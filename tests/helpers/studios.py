"""A studio that runs, and requests to it as a page makes them."""

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import quote


class Studio:
    """A studio in a process of its own."""

    def __init__(self, *arguments: str | Path, folder: Path | None = None) -> None:
        command = [sys.executable, "-m", "cascadenorm", "studio", "--no-browser", *map(str, arguments)]
        self.folder = folder
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=folder)
        self.address = re.search(r"http://\S+", self.process.stdout.readline())[0]
        self.port, self.token = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/#token=(.+)", self.address).groups()
        self.host = f"127.0.0.1:{self.port}"

    def asked(self, method: str, path: str, body: Any = None, **headers: str | None) -> tuple[int, Any]:
        """Ask as the page does, unless headers are given otherwise or as None; return the status and the answer."""
        usual = {"host": self.host, "authorization": f"Bearer {self.token}", "origin": f"http://{self.host}"}
        given = {name: value for name, value in {**usual, **headers}.items() if value is not None}
        content = body if isinstance(body, bytes | None) else json.dumps(body).encode()
        connection = HTTPConnection("127.0.0.1", int(self.port))
        try:
            connection.request(method, path, content, {name.replace("_", "-"): value for name, value in given.items()})
            answer = connection.getresponse()
            self.headers = answer.headers
            text = answer.read()
        finally:
            connection.close()
        return answer.status, json.loads(text) if "json" in answer.headers.get("content-type", "") else text

    def done(self, path: str, body: Any = None) -> Any:
        """Ask for something that is to succeed."""
        status, answer = self.asked("POST", path, {} if body is None else body)
        assert status == 200, answer
        return answer

    def drop(self, *files: Path) -> tuple[int, Any]:
        """Drop files on the page."""
        drop = self.done("/api/drop")["drop"]
        for file in files:
            self.done(f"/api/drop/{drop}?name={quote(file.name)}", file.read_bytes())
        return self.asked("POST", "/api/open", {"drop": drop, "names": [file.name for file in files]})

    @contextmanager
    def told(self, *, leaves: bool = True) -> Iterator[Iterator[dict[str, Any]]]:
        """What the studio tells a page while that is open; one that is discarded does not say that it leaves."""
        connection = HTTPConnection("127.0.0.1", int(self.port))
        connection.request("GET", "/api/events", headers={"authorization": f"Bearer {self.token}"})
        lines = connection.getresponse()
        try:
            told = (line for line in iter(lines.readline, b"") if line.startswith((b"data: ", b":")))
            yield (json.loads(line[6:]) if line.startswith(b"data: ") else {} for line in told)  # {}: nothing new
        finally:
            lines.close()
            connection.close()
            if leaves and self.process.poll() is None:
                self.done("/api/leave")

    def ended(self) -> int:
        """Wait for the end; the exit code."""
        return self.process.wait()

    def close(self) -> None:
        """End the studio, if it runs."""
        self.process.terminate()
        self.process.wait()
        self.process.stdout.close()


@contextmanager
def kept_open(*arguments: str | Path, folder: Path) -> Iterator[Studio]:
    """A studio in a folder that stays open without a page, for tests that leave it as it was."""
    with closing(Studio(*arguments, folder=folder)) as started, started.told() as events:
        while next(events).get("type") not in ("opened", "empty"):
            pass
        yield started


def until(events: Iterator[dict[str, Any]], **wanted: Any) -> dict[str, Any]:
    """The next event with these values, however long it takes; fails where the studio ends before."""
    for event in events:
        if all(event.get(name) == value for name, value in wanted.items()):
            return event
        over = event.get("type") in ("failed", "cancelled") and event.get("ticket") == wanted.get("ticket", "")
        assert not over, event
    raise AssertionError("the studio has ended")
