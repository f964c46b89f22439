"""Which file is next, where, and on how many threads."""

from batches import job

from cascadenorm.batch.scheduling import Place, Schedule, needed
from cascadenorm.execution.memory import PROCESS_BYTES


def test_files_run_side_by_side_as_far_as_memory_goes():
    small, middle, large = job(10**4, "s.ply"), job(10**6, "m.ply"), job(10**7, "l.ply")
    place = Place(4, needed(large) + needed(small), processes=4)
    schedule = Schedule()
    schedule.add([small, middle, large])
    assert schedule.next([place]) == (place, large, 3)  # most of the memory, so most of the cores
    assert schedule.next([place]) == (place, small, 1)  # the one in the middle does not fit beside it
    assert schedule.next([place]) is None and schedule.left == 3
    schedule.end(large)
    schedule.retry(large)
    assert schedule.next([place]) == (place, middle, 1)
    schedule.end(small)
    assert schedule.next([place]) is None
    schedule.end(middle)
    assert schedule.next([place]) == (place, large, 4)  # again, alone, and with every core
    schedule.end(large)
    assert schedule.left == 0


def test_a_file_larger_than_memory_runs_alone():
    place = Place(2, PROCESS_BYTES, processes=2)
    schedule = Schedule()
    schedule.add([job(10**9, "a.ply"), job(10**9, "b.ply")])
    assert schedule.next([place]) == (place, job(10**9, "a.ply"), 2)
    assert schedule.next([place]) is None


def test_a_file_goes_where_it_fits_and_to_the_largest_place_when_tried_again():
    large, huge, small = job(10**7, "l.ply"), job(10**9, "h.ply"), job(10, "s.ply")
    narrow, wide = Place(8, needed(small), processes=1), Place(2, needed(large), processes=1)
    schedule = Schedule()
    schedule.add([small, large, huge])
    assert schedule.next([narrow, wide]) == (wide, huge, 2)  # it fits nowhere
    assert schedule.next([narrow, wide]) == (narrow, small, 8)
    assert schedule.next([narrow, wide]) is None and schedule.next([]) is None
    schedule.end(small)
    schedule.retry(small)
    assert schedule.next([narrow, wide]) is None
    schedule.end(huge)
    assert schedule.next([narrow, wide]) == (wide, large, 2)
    assert schedule.next([narrow, wide]) is None  # not where memory may have been short
    schedule.end(large)
    assert schedule.next([narrow, wide]) == (wide, small, 2)
