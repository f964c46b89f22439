"""Work in a thread: its progress, its result, its errors, its end."""

import numpy as np
import pytest
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.execution.progress import Cancelled, report_to, track
from cascadenorm.frontends.jobs import BackgroundJob

BALL = noisy(icosphere(2), 0.2)


def test_a_job_returns_what_its_function_returns():
    job = BackgroundJob(lambda listener: cn.denoise(BALL, method="bilateral-normal", progress=listener))
    expected = cn.denoise(BALL, method="bilateral-normal")
    np.testing.assert_array_equal(job.result().vertices, expected.vertices)
    assert job.done and job.fraction > 0.5 and not job.cancelled


def test_a_job_raises_what_its_function_raises():
    job = BackgroundJob(lambda listener: cn.denoise(BALL, method="no such", progress=listener))
    with pytest.raises(cn.ParameterError, match="there is no method 'no such'"):
        job.result()
    assert job.done


def test_a_job_ends_at_the_next_step_once_it_is_cancelled():
    def count(listener):
        with report_to(listener):
            return sum(track(10**8))

    job = BackgroundJob(count)
    while job.fraction == 0:
        assert not job.done
    job.cancel()
    with pytest.raises(Cancelled):
        job.result()
    assert job.done and job.cancelled and job.fraction < 0.5
