"""Measure how long it takes to show a mesh of a million faces in the studio and in a report.

    python -m benchmarks.speed.opening [--record]

Times are of the processor, user and system together, up to the first picture in the browser, which has no GPU and draws
on the processor. Needs chromium, chromedriver and the extra `dev`. The table is that of benchmarks/speed.md.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from benchmarks import results
from benchmarks.speed.commands import COMMAND, timed
from benchmarks.speed.meshes import MILLION, wavy_torus
from cascadenorm.io.interop import save_mesh

sys.path.append(str(Path(__file__).parents[2] / "tests" / "helpers"))

from browsers import Browser
from studios import Studio

TICK = os.sysconf("SC_CLK_TCK")
PAUSE_S = 0.2  # between two looks at a page, each of which takes time of the browser


class Process(NamedTuple):
    """A process of this machine."""

    parent: int
    seconds: float


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure both; kernels are compiled beforehand."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    results.add_option(parser, "opening")
    options = parser.parse_args(arguments)
    with TemporaryDirectory() as name:
        folder = Path(name)
        save_mesh(folder / "warm.ply", wavy_torus(40, 30))
        save_mesh(folder / "large.ply", wavy_torus(*MILLION))
        opened(folder, "warm.ply")
        reported(folder, "warm.ply")
        seconds = opened(folder, "large.ply")
        seconds["`denoise --method laplacian --report`"] = reported(folder, "large.ply")
        seconds["the report in the browser"] = looked_at(folder)
    results.report(options.record, {"machine": results.machine(), "seconds": seconds}, table)


def table(figures: results.Figures) -> str:
    """Return a row for each step."""
    rows = [[name, f"{seconds:.1f}"] for name, seconds in figures["seconds"].items()]
    return f"{figures['machine']}.\n\n{results.markdown(['work', 'processor seconds'], rows)}"


def opened(folder: Path, name: str) -> dict[str, float]:
    """Open a file in the studio."""
    browser = Browser()
    try:
        before = spent_by_browser(browser)
        studio = Studio(name, folder=folder)
        try:
            browser.driver.get(studio.address)
            wait(browser, lambda: browser.js("return document.querySelector('#viewer canvas') !== null"))
            served = spent_below(studio.process.pid) + processes()[studio.process.pid].seconds
            drawn(browser)
            shown = spent_by_browser(browser) - before
        finally:
            studio.close()
    finally:
        browser.driver.quit()
    return {"studio: server and worker": served, "studio: browser": shown}


def reported(folder: Path, name: str) -> float:
    """Denoise a file with a report."""
    files = [folder / name, "-o", folder / "out.ply", "--report", folder / "report.html"]
    return timed([*COMMAND, "denoise", *files, "--method", "laplacian", "--force", "--json"]).processor


def looked_at(folder: Path) -> float:
    """Open the report."""
    browser = Browser()
    try:
        before = spent_by_browser(browser)
        browser.driver.get((folder / "report.html").as_uri())
        wait(browser, lambda: browser.js("return document.getElementById('viewer').dataset.state === 'ready'"))
        drawn(browser)
        return spent_by_browser(browser) - before
    finally:
        browser.driver.quit()


def wait(browser: Browser, there: Callable[[], bool]) -> None:
    """Wait for something on the page."""
    while not there():
        time.sleep(PAUSE_S)


def drawn(browser: Browser) -> None:
    """Wait until the browser has finished drawing, by requesting a pixel of the page."""
    browser.settle()
    browser.driver.get_screenshot_as_png()


def spent_by_browser(browser: Browser) -> float:
    """Return the processor seconds of all processes of the browser."""
    return spent_below(browser.driver.service.process.pid)


def spent_below(pid: int) -> float:
    """Return the processor seconds of all descendants of a process."""
    known = processes()

    def descends(one: int) -> bool:
        parent = known[one].parent
        return parent == pid or (parent in known and descends(parent))

    return sum(process.seconds for one, process in known.items() if descends(one))


def processes() -> dict[int, Process]:
    """Return the processes of this machine by number."""
    found = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            text = stat.read_text()
        except OSError:  # it has ended
            continue
        after_name = text.rpartition(")")[2].split()
        ticks = sum(map(int, after_name[11:13]))
        found[int(stat.parent.name)] = Process(int(after_name[1]), ticks / TICK)
    return found


if __name__ == "__main__":
    main()
