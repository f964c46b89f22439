"""Processes give results in order, and end with the process that started them."""

import os
import signal
import subprocess
import sys
import time
from itertools import islice

import pytest
import scipy.linalg  # noqa: F401 - brings a BLAS of its own
from threadpoolctl import threadpool_info

from cascadenorm.execution.process_map import WorkerError, parallel_map
from cascadenorm.mesh import thread_count


def most_threads(number: int) -> tuple[int, int, int]:
    """The number, and how many threads kernels and libraries would take."""
    return number, thread_count(), max(library["num_threads"] for library in threadpool_info())


def failing(number: int) -> int:
    if number == 3:
        raise ValueError("the third")
    return number


@pytest.fixture(scope="module")
def two_processes():
    with parallel_map(2) as each:
        yield each


def test_each_piece_of_work_has_one_thread_and_results_come_in_order(two_processes):
    found = list(two_processes(most_threads, range(20)))
    assert [number for number, *_ in found] == list(range(20))
    assert {threads for _, *threads in found for threads in threads} == {1}


def test_more_processes_than_a_system_can_have_are_no_error():
    with parallel_map(10**15) as each:
        assert list(each(abs, [-1])) == [1]


def test_an_error_is_raised_where_its_result_is_asked_for(two_processes):
    with parallel_map(1) as this_process:
        for each in (this_process, two_processes):
            results = each(failing, range(5))
            assert list(islice(results, 3)) == [0, 1, 2]
            with pytest.raises(ValueError, match="the third"):
                next(results)


def test_a_process_that_ends_early_is_a_worker_error():
    with pytest.raises(WorkerError, match="memory is short"), parallel_map(2) as each:
        list(each(os._exit, [1]))


INTERRUPTED = """
import signal, time
from cascadenorm.execution.process_map import parallel_map
signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background of a shell it is ignored
try:
    with parallel_map(2) as each:
        results = each(time.sleep, [0.1] * 5_000)
        print("begun", flush=True)
        list(results)
except KeyboardInterrupt:
    print("stopped")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C reaches processes in another way there")
def test_ctrl_c_while_processes_start_prints_nothing_from_them():
    command = [sys.executable, "-c", INTERRUPTED]
    piped = subprocess.PIPE
    with subprocess.Popen(command, stdout=piped, stderr=piped, text=True, start_new_session=True) as started:
        assert started.stdout is not None
        assert started.stdout.readline() == "begun\n"
        time.sleep(0.5)  # in which processes load their modules
        os.killpg(started.pid, signal.SIGINT)
        output, complaints = started.communicate()
    assert (output, complaints) == ("stopped\n", "")


INTERRUPTED_TWICE = """
import signal
from cascadenorm.execution.process_map import parallel_map
signal.signal(signal.SIGINT, signal.default_int_handler)
with parallel_map(2) as each:
    for result in each(bytes, [20_000_000] * 1_000):
        print("one", flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C reaches processes in another way there")
@pytest.mark.parametrize("pause", [0, 0.01, 0.02, 0.05])
def test_a_second_ctrl_c_does_not_leave_the_processes_waiting(pause):
    command, piped = [sys.executable, "-c", INTERRUPTED_TWICE], subprocess.PIPE
    with subprocess.Popen(command, stdout=piped, stderr=piped, text=True, start_new_session=True) as started:
        assert started.stdout is not None
        assert started.stdout.readline() == "one\n"
        started.send_signal(signal.SIGINT)
        time.sleep(pause)
        started.send_signal(signal.SIGINT)
        try:
            started.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            os.killpg(started.pid, signal.SIGKILL)
            raise


KILLED = """
import time
from cascadenorm.execution.process_map import parallel_map
with parallel_map(2) as each:
    results = each(time.sleep, [0.1] * 2 + [600] * 2)
    next(results)
    print("begun", flush=True)
    list(results)
"""


def test_no_process_outlives_the_one_that_started_it():
    with subprocess.Popen([sys.executable, "-c", KILLED], stdout=subprocess.PIPE, text=True) as started:
        assert started.stdout is not None
        assert started.stdout.readline() == "begun\n"
        started.kill()
        started.communicate()  # which waits for all that could still write
