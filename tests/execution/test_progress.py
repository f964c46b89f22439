"""Methods report the share of their work that is done."""

import pytest
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.execution.progress import report_to, track


def test_track_counts_whether_or_not_anybody_listens():
    heard: list[float] = []
    assert list(track(3)) == [0, 1, 2]
    with report_to(heard.append):
        assert list(track(4)) == [0, 1, 2, 3]
    assert heard == [0, 0.25, 0.5, 0.75]
    assert list(track(2)) == [0, 1] and len(heard) == 4


def test_steps_within_a_step_are_a_part_of_it():
    heard: list[float] = []
    with report_to(heard.append):
        for _ in track(2):
            for _ in track(2):
                list(track(2))
    assert heard == sorted(heard)
    assert sorted(set(heard)) == [i / 8 for i in range(8)]


def test_after_an_interruption_nobody_listens():
    def stop(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), report_to(stop):
        list(track(2))
    assert list(track(2)) == [0, 1]


METHODS = ["bilateral-normal", "guided-normal", "l0", "tv-normal", "laplacian", "prescribed-mean-curvature"]


@pytest.mark.parametrize("name", METHODS)
def test_methods_report_progress(name):
    heard: list[float] = []
    cn.denoise(noisy(icosphere(2), 0.2), method=name, progress=heard.append)
    assert heard[0] == 0 and heard[-1] == 1 and len(set(heard)) > 3
    assert heard == sorted(heard)
