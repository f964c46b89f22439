"""Count passes, bytes and memory, which tell on any machine whether a method became slower.

python -m benchmarks.speed.track                    # compares with the last record; fails where a count has grown
python -m benchmarks.speed.track --record REASON    # appends a record to benchmarks/records/track.json
"""

import argparse
import json
import sys
import tracemalloc
from collections.abc import Sequence
from pathlib import Path

from benchmarks.speed.kernel_use import watched
from benchmarks.speed.meshes import wavy_torus
from cascadenorm import denoise
from cascadenorm.mesh import Mesh

HISTORY = Path(__file__).parents[1] / "records" / "track.json"
METHODS = ("auto", "cascade", "bilateral-normal", "guided-normal", "tv-normal", "l0", "taubin")
SIZE = 100, 50
"""Steps of the torus: 10,000 faces."""
TOLERANCE = {"rows a face": 0.001, "bytes a face": 0.01, "memory, bytes a face": 0.05}
"""By how much a count may grow; memory depends a little on the version of Python."""

Counts = dict[str, float]


def main(arguments: Sequence[str] | None = None) -> int:
    """Count, compare, and record if asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", metavar="REASON", help="why the counts are as they are now")
    chosen = parser.parse_args(arguments)
    mesh = wavy_torus(*SIZE)
    found = {method: counted(mesh, method) for method in METHODS}
    history = json.loads(HISTORY.read_text(encoding="utf-8")) if HISTORY.exists() else []
    messages = grown(history[-1]["counts"], found) if history else []
    print(*messages or ["no count has grown"], sep="\n")
    if chosen.record:
        history.append({"reason": chosen.record, "counts": found})
        HISTORY.write_text(json.dumps(history, indent=1) + "\n", encoding="utf-8")
        return 0
    return 1 if messages else 0


def counted(mesh: Mesh, method: str) -> Counts:
    """Denoise a mesh on one thread and return the counts."""
    faces = len(mesh.faces)
    denoise(mesh, method=method, threads=1)  # whatever is compiled or loaded once
    with watched() as uses:
        tracemalloc.start()
        denoise(Mesh(mesh.vertices, mesh.faces), method=method, threads=1)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    return {
        "rows a face": round(sum(use.rows for use in uses.values()) / faces, 3),
        "bytes a face": round(sum(use.bytes for use in uses.values()) / faces),
        "memory, bytes a face": round(peak / faces),
    }


def grown(before: dict[str, Counts], now: dict[str, Counts]) -> list[str]:
    """Say which counts have grown by more than their tolerance."""
    return [
        f"{method}: {name} {before[method][name]:,} -> {count:,}"
        for method, counts in now.items()
        for name, count in counts.items()
        if method in before and count > before[method][name] * (1 + TOLERANCE[name])
    ]


if __name__ == "__main__":
    sys.exit(main())
