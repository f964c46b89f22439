"""A process has the rank that torchrun gives it, and is alone without torchrun."""

import pytest

from cascadenorm.learned.config import ConfigError
from cascadenorm.learned.training.launch import is_local_main, is_main


def test_a_process_that_a_scheduler_has_numbered_is_alone_all_the_same(monkeypatch):
    for name in ("RANK", "LOCAL_RANK"):
        monkeypatch.setenv(name, "3")
    assert is_main() and is_local_main()
    monkeypatch.setenv("WORLD_SIZE", "4")
    with pytest.raises(ConfigError, match="LOCAL_WORLD_SIZE is not"):
        is_main()
    monkeypatch.setenv("LOCAL_WORLD_SIZE", "4")
    assert not is_main() and not is_local_main()
