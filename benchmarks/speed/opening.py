"""Measure what it takes to see a mesh of a million faces: in the studio, and in a report.

python -m benchmarks.speed.opening

Times are of the processor, user and system together, up to the first picture in the browser, which gets no GPU and
draws on the processor. chromium, chromedriver and the extra `dev` are needed. The table is printed, and written to
benchmarks/opening.md.
"""

import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from tempfile import TemporaryDirectory
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from browsers import Browser
from studios import Studio

from benchmarks.speed.speed import wavy_torus
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import thread_count

STEPS = (1000, 500)
TICK = os.sysconf("SC_CLK_TCK")
PAUSE = 0.2  # between two looks at a page, each of which takes time of the browser


class Process(NamedTuple):
    """A process of this machine."""

    parent: int
    seconds: float


def main() -> None:
    """Measure each, with kernels compiled before."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        save_mesh(folder / "warm.ply", wavy_torus(40, 30))
        save_mesh(folder / "large.ply", wavy_torus(*STEPS))
        opened(folder, "warm.ply")
        reported(folder, "warm.ply")
        rows = opened(folder, "large.ply")
        rows["`denoise --method laplacian --report`"] = reported(folder, "large.ply")
        rows["the report in the browser"] = looked_at(folder)
    machine = f"{thread_count()} threads, {platform.system()} {platform.machine()}, Python {platform.python_version()}"
    lines = [
        "# Time to see a million faces",
        "",
        f"Processor time up to the first picture, which the browser draws without a GPU; {machine}. "
        "`python -m benchmarks.speed.opening` writes this page.",
        "",
        "| work | processor seconds |",
        "| --- | ---: |",
        *(f"| {name} | {seconds:.1f} |" for name, seconds in rows.items()),
    ]
    text = "\n".join(lines) + "\n"
    (Path(__file__).parents[1] / "opening.md").write_text(text, encoding="utf-8")
    print(text, end="")


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
    words = ["denoise", name, "-o", "out.ply", "--method", "laplacian", "--report", "report.html", "--force", "--json"]
    before = getrusage(RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "cascadenorm", *words], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    after = getrusage(RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


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
        time.sleep(PAUSE)


def drawn(browser: Browser) -> None:
    """Wait until the browser has drawn what it was told to draw: a pixel of the page is asked for."""
    browser.settle()
    browser.driver.get_screenshot_as_png()


def spent_by_browser(browser: Browser) -> float:
    """Processor seconds of all processes of the browser."""
    return spent_below(browser.driver.service.process.pid)


def spent_below(pid: int) -> float:
    """Processor seconds of the processes that a process has started, directly or not."""
    known = processes()

    def descends(one: int) -> bool:
        parent = known[one].parent
        return parent == pid or (parent in known and descends(parent))

    return sum(process.seconds for one, process in known.items() if descends(one))


def processes() -> dict[int, Process]:
    """What runs on this machine, by number."""
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
