"""Pairs to evaluate methods on."""

import pytest
from evaluated import save_pairs


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return save_pairs(tmp_path_factory.mktemp("pairs"))
