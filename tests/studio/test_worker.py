"""The worker of the studio answers every request, also where the code fails."""

from multiprocessing import Pipe
from threading import Thread
from types import SimpleNamespace

from cascadenorm.studio.worker import Request, _serve


def test_an_error_of_ours_is_told_and_the_next_request_is_answered():
    here, there = Pipe()
    with there:
        worker = Thread(target=_serve, args=(there, SimpleNamespace(value=0)))
        worker.start()
        with here:
            here.send(Request(1, "juggle", {}))
            here.send(Request(2, "which", {"names": ["notes.txt", "scan.ply"]}))
            failed, done = here.recv(), here.recv()
        worker.join()
    assert failed == (1, "failed", {"error": "ValueError: juggle (please report it)"}) and done == (2, "done", 1)
