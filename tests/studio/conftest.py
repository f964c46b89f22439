"""A studio for the tests of each file."""

import pytest
from scans import studio_on_a_scan


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """A studio on a scanned mesh."""
    with studio_on_a_scan(tmp_path_factory.mktemp("studio")) as started:
        yield started
