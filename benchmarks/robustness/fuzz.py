"""Damage files and meshes at random, and keep the cases that break a guarantee.

    python -m benchmarks.robustness.fuzz --minutes 60

Every case is a seed. Failing cases are written to a folder, each with its seed and traceback; `--seed` runs one of them
again. tests/benchmarks/test_fuzz.py does the same for seconds.
"""

import argparse
import collections
import resource
import secrets
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "io"))

from damage import denoised, read_damaged
from test_io import SAMPLES, SAMPLES_FORMAT
from test_usd import SCENE, archive, stored
from test_xml import COLLADA, entries, nested_3mf

MODEL = "3D/3dmodel.model"
SCENES = {
    "3mf": entries(nested_3mf())[MODEL],
    "dae": COLLADA.encode(),
    "usda": SCENE.encode(),
    "usdz": SCENE.encode(),
    "usdc": stored(SCENE.encode(), "usdc"),
}
"""Samples of scenes; those of archives are what they hold."""

PACKED = {
    "3mf": lambda model: nested_3mf({MODEL: model}),
    "usdz": lambda layer: archive({"layer.usda": layer}),
}

LIMIT_S = 60  # of processor time for a case, after which it counts as hanging
BYTES = 8 << 30  # of address space, beyond which a file asks for too much


def main(arguments: Sequence[str] | None = None) -> int:
    """Run cases until the time is over; return 1 if any failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--seed", type=int, help="one case alone, with its traceback")
    parser.add_argument("--output", type=Path, default=Path("fuzz-failures"))
    chosen = parser.parse_args(arguments)
    warnings.simplefilter("error")
    if chosen.seed is not None:
        print(case(chosen.seed))
        return 0
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    signal.signal(signal.SIGPROF, _hanging)
    end = time.monotonic() + 60 * chosen.minutes
    outcomes: collections.Counter[str] = collections.Counter()
    failures: dict[str, int] = {}
    while time.monotonic() < end:
        seed = secrets.randbelow(2**63)
        signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
        try:
            outcomes[case(seed)] += 1
        except Exception as error:
            frame = traceback.extract_tb(error.__traceback__)[-1]
            place = f"{Path(frame.filename).name}-{frame.lineno}-{type(error).__name__}"
            if place not in failures:  # one case for each place is enough
                chosen.output.mkdir(parents=True, exist_ok=True)
                text = "".join(traceback.format_exception(error))
                (chosen.output / f"{place}.txt").write_text(f"--seed {seed}\n\n{text}", encoding="utf-8")
            failures[place] = failures.get(place, 0) + 1
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
    for name, count in [*outcomes.most_common(), *failures.items()]:
        print(f"{count:8} {name}")
    return int(bool(failures))


def case(seed: int) -> str:
    """Run one case; return what it was, and whether it was done or refused."""
    rng = np.random.default_rng(seed)
    if rng.random() < 0.3:
        return f"mesh {'done' if denoised(rng) == 'done' else 'refused'}"
    samples = {**SAMPLES, **SCENES}
    name = sorted(samples)[rng.integers(len(samples))]
    format = SAMPLES_FORMAT.get(name, name)
    found = read_damaged(format, samples[name], rng, list(samples.values()), PACKED.get(name, bytes))
    return f"{name} {'read' if found == 'read' else 'refused'}"


def _hanging(*_: object) -> None:
    raise TimeoutError(f"no end after {LIMIT_S} seconds")


if __name__ == "__main__":
    sys.exit(main())
