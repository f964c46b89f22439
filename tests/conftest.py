"""What several files of tests start and end alike."""

import pytest
from studios import Studio

from cascadenorm.interop import save_mesh


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
