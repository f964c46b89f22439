"""The worker of the studio answers every request, also where the code fails."""

from queue import SimpleQueue

from cascadenorm.studio.worker import Channel, Request


def test_an_error_of_ours_is_told_and_the_next_request_is_answered():
    heard = SimpleQueue()
    channel = Channel(heard.put, heard.put)
    channel.send(Request(1, "juggle", {}))
    channel.send(Request(2, "which", {"names": ["notes.txt", "scan.ply"]}))
    failed, done = heard.get(), heard.get()
    channel.stop()
    assert failed == (1, "failed", {"error": "ValueError: juggle (please report it)"}) and done == (2, "done", 1)
