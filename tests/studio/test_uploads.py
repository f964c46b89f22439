"""Files that are sent to the studio."""

import asyncio

import pytest
from starlette.requests import ClientDisconnect

from cascadenorm.studio.uploads import TooLarge, Uploads


async def arriving(*parts):
    for part in parts:
        yield part


def test_what_is_dropped_counts_together_until_a_mesh_of_it_is_open(tmp_path):
    uploads = Uploads(tmp_path, most=100)

    def take(drop, name, size):
        asyncio.run(uploads.take(drop, name, arriving(bytes(size)), announced=0))

    take(1, "a.ply", 60)
    with pytest.raises(TooLarge):  # of another drop, which alone would fit
        take(2, "b.ply", 60)
    uploads.opened(1)
    take(3, "c.ply", 90)  # takes the place of the one that is open
    with pytest.raises(TooLarge):
        take(4, "d.ply", 20)
    uploads.refused(3)
    take(5, "e.ply", 90)
    take(6, "f.ply", 10)  # from another page
    uploads.opened(5)
    assert sorted(path.name for path in tmp_path.rglob("*.ply")) == ["e.ply", "f.ply"]


def test_nothing_is_kept_of_a_file_whose_page_was_closed_while_it_was_sent(tmp_path):
    async def interrupted():
        yield bytes(60)
        raise ClientDisconnect

    uploads = Uploads(tmp_path, most=100)
    with pytest.raises(ClientDisconnect):
        asyncio.run(uploads.take(1, "a.ply", interrupted(), announced=90))
    asyncio.run(uploads.take(2, "b.ply", arriving(bytes(90)), announced=90))
