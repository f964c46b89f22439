"""What several files of tests start and end alike."""

import sys
from pathlib import Path

import pytest
from studios import Studio

from cascadenorm.io.interop import save_mesh

# tests of one folder may use what those of another make, and the benchmarks of the checkout
sys.path += [str(folder) for folder in sorted(Path(__file__).parent.iterdir()) if folder.is_dir()]
sys.path.append(str(Path(__file__).parents[1]))


@pytest.fixture(scope="module")
def page():
    """A browser for the pages of studios."""
    from studio_pages import Page  # needs selenium

    opened = Page()
    yield opened
    opened.driver.quit()


@pytest.fixture
def studio(tmp_path):
    """A studio without a file."""
    started = Studio(folder=tmp_path)
    yield started
    started.close()


@pytest.fixture
def named(tmp_path):
    """A studio on a file."""
    from studio_pages import ROUGH

    save_mesh(tmp_path / "rough.ply", ROUGH)
    started = Studio("rough.ply", folder=tmp_path)
    yield started
    started.close()
