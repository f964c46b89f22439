"""What the tests of trainings share."""

import pytest
from trainings import TINY

from cascadenorm.learned.training.training import train_cascade
from cascadenorm.mesh import limit_threads


@pytest.fixture(autouse=True, scope="module")
def in_this_process():
    with limit_threads(1):
        yield


@pytest.fixture(scope="session")
def trained(tmp_path_factory):
    with limit_threads(1):
        return train_cascade(TINY, tmp_path_factory.mktemp("tiny"))
