"""Studios and a browser for the tests of this folder; what takes seconds to start is shared."""

from contextlib import closing

import pytest
from scans import ROUGH, scanned
from studios import Studio, kept_open

from cascadenorm.io.interop import save_mesh


@pytest.fixture(scope="package")
def studio(tmp_path_factory):
    """A studio on a scanned mesh, for files of up to 0.5 MB. No test opens another mesh in it."""
    folder = tmp_path_factory.mktemp("studio")
    scanned(folder / "scan.ply")
    with kept_open("scan.ply", "--max-size", "0.5", folder=folder) as started:
        yield started


@pytest.fixture(scope="package")
def page():
    """A browser for the pages of studios."""
    from studio_pages import Page  # needs selenium

    with closing(Page()) as opened:
        yield opened


@pytest.fixture(scope="package")
def shared_studio(tmp_path_factory):
    folder = tmp_path_factory.mktemp("named")
    save_mesh(folder / "rough.ply", ROUGH)
    with kept_open("rough.ply", folder=folder) as started:
        yield started


@pytest.fixture
def named(page, shared_studio):
    """A studio on a file, without paint and without another file beside it. No test opens another mesh in it."""
    page.driver.get("about:blank")  # the page of the test before, which could send more
    shared_studio.done("/api/cancel")
    shared_studio.done("/api/paint", bytes(len(ROUGH.vertices)))
    for path in shared_studio.folder.iterdir():
        if path.name != "rough.ply":
            path.unlink()
    return shared_studio


@pytest.fixture(scope="package")
def drop_studio(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dropped")
    save_mesh(folder / "rough.ply", ROUGH)
    with kept_open(folder=folder) as started:
        yield started


@pytest.fixture
def dropped(page, drop_studio):
    """A studio on which a mesh was dropped; tests may drop others."""
    page.driver.get("about:blank")
    assert drop_studio.drop(drop_studio.folder / "rough.ply")[0] == 200
    return drop_studio


@pytest.fixture
def empty_studio(tmp_path):
    """A studio of the test's own, without a file."""
    with closing(Studio(folder=tmp_path)) as started:
        yield started


@pytest.fixture
def own_studio(tmp_path):
    """A studio of the test's own, on a file."""
    save_mesh(tmp_path / "rough.ply", ROUGH)
    with closing(Studio("rough.ply", folder=tmp_path)) as started:
        yield started
