"""What several files of tests start and end alike."""

import os
import sys
from contextlib import closing
from pathlib import Path

if "PYTEST_XDIST_WORKER" in os.environ:  # the workers share the cores; libraries read this when they are loaded
    for library in ("OMP", "OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# tests use the modules of helpers/ and the benchmarks of the checkout
sys.path += [str(Path(__file__).parent / "helpers"), str(Path(__file__).parents[1])]

import hypothesis
import pytest

from cascadenorm.compute import threads

threads.SMALLEST_CHUNK = 256  # kernels run on several threads even for the small meshes of tests
hypothesis.settings.register_profile("any machine", deadline=None)
hypothesis.settings.load_profile("any machine")


@pytest.fixture(scope="session")
def cluster(tmp_path_factory):
    """The address and the process of a Dask cluster with two workers; a line to the process kills one of them."""
    pytest.importorskip("distributed")
    from clusters import patient, started

    with patient(), started(tmp_path_factory.mktemp("cluster") / "here") as found:
        yield found


@pytest.fixture(scope="session")
def run_forked():
    """Runs a program in a process that need not import numba again."""
    from forked import forking

    with forking() as run:
        yield run


@pytest.fixture(scope="module")
def browser():
    """A browser for reports."""
    from report_pages import ReportBrowser  # needs selenium

    with closing(ReportBrowser()) as opened:
        yield opened
