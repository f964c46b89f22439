"""Flame graphs: of which calls the time of a program consists, as a picture."""

import subprocess
import sys
import tempfile
from collections import Counter
from html import escape
from pathlib import Path
from typing import NamedTuple

from benchmarks.environments import interpreter

RATE = 100
"""Samples a second."""
WIDTH, HEIGHT, LETTER = 1200, 18, 6.6
"""Of the picture, of a call and of a letter, in pixels."""
LEAST = 0.003
"""Share of the time from which a call is drawn."""
COLORS = ("#f4a261", "#e9c46a", "#f6bd60", "#f28482")

Stack = tuple[str, ...]


class Call(NamedTuple):
    """A rectangle: a call, its depth, and when it begins and ends, in samples."""

    name: str
    depth: int
    begin: int
    end: int


def sampled(program: str, first: str, environment: Path) -> Counter[Stack]:
    """Run a Python program; count by py-spy how often each stack of functions was seen, from the first one named on.

    Parameters
    ----------
    environment : where py-spy is, or is installed
    """
    python = interpreter(environment, ["py-spy"])
    with tempfile.TemporaryDirectory() as name:
        found = Path(name, "stacks.txt")
        recorder = [str(python.with_name("py-spy")), "record", "--rate", str(RATE), "--function", "--format", "raw"]
        command = [*recorder, "--output", str(found), "--", sys.executable, "-c", program]
        subprocess.run(command, check=True, capture_output=True, cwd=Path(__file__).parents[2])
        lines = found.read_text(encoding="utf-8").splitlines()
    counted: Counter[Stack] = Counter()
    for line in lines:
        frames, _, count = line.rpartition(" ")
        names = [frame.partition(" (")[0] for frame in frames.split(";") if "/mesh/thread" not in frame]
        if first in names:
            counted[tuple(names[names.index(first) :])] += int(count)
    return counted


def calls(stacks: Counter[Stack], depth: int = 0, begin: int = 0) -> list[Call]:
    """Return the calls at a depth of stacks that are alike up to there, and all that these call; longest first."""
    inside: dict[str, Counter[Stack]] = {}
    for stack, count in stacks.items():
        if len(stack) > depth:
            inside.setdefault(stack[depth], Counter())[stack] = count
    found = []
    for name, those in sorted(inside.items(), key=lambda item: (-item[1].total(), item[0])):
        found += [Call(name, depth, begin, begin + those.total()), *calls(those, depth + 1, begin)]
        begin += those.total()
    return found


def drawn(stacks: Counter[Stack]) -> str:
    """Return an SVG picture; the width of a call is its share of the time, what it calls is below it."""
    total = stacks.total()
    large = [call for call in calls(stacks) if call.end - call.begin >= LEAST * total]
    height = HEIGHT * (1 + max(call.depth for call in large))
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="monospace" '
        'font-size="11">'
    ]
    for call in large:
        x, width = WIDTH * call.begin / total, WIDTH * (call.end - call.begin) / total
        y, share = HEIGHT * call.depth, (call.end - call.begin) / total
        letters = int((width - 4) / LETTER)
        shown = call.name if len(call.name) <= letters else f"{call.name[: letters - 1]}…" if letters > 3 else ""
        lines += [
            f"<g><title>{escape(call.name)}, {share:.1%}</title>"
            f'<rect x="{x:.1f}" y="{y}" width="{width:.1f}" height="{HEIGHT - 1}" '
            f'fill="{COLORS[sum(map(ord, call.name)) % len(COLORS)]}"/>'
            f'<text x="{x + 3:.1f}" y="{y + 13}">{escape(shown)}</text></g>'
        ]
    return "\n".join([*lines, "</svg>", ""])
