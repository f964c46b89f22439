"""The manifest of a batch has whole lines alone, and another file is not taken for one."""

import errno
import io
import json
import os

import pytest

from cascadenorm.batch.manifest import MANIFEST_NAME, REQUIRED, Manifest
from cascadenorm.errors import OutputError


def line(output):
    return {**dict.fromkeys(REQUIRED), "output": output, "status": "done"}


def test_half_a_line_does_not_count_and_the_next_is_whole(tmp_path):
    lacking = '{"output": "d", "status": "done"}'  # as another version may have written it
    text = f'{json.dumps(line("a"))}\n[1]\n{lacking}\n{{"output": "b", "sta'
    (tmp_path / "manifest.jsonl").write_text(text, "utf-8")
    manifest = Manifest(tmp_path / MANIFEST_NAME)
    assert set(manifest.last) == {"a"}
    with pytest.raises(OutputError, match="another batch is writing"):
        Manifest(tmp_path / MANIFEST_NAME)
    manifest.add(line("c"))
    manifest.close()
    again = Manifest(tmp_path / MANIFEST_NAME)
    assert set(again.last) == {"a", "c"}
    again.close()


def test_a_line_is_written_to_its_end_or_refused(tmp_path, monkeypatch):
    """A file without a buffer accepts what fits on the disk, and refuses the rest only at the next write."""
    manifest = Manifest(tmp_path / MANIFEST_NAME)

    class Disk(io.FileIO):
        free = 10**6

        def write(self, data):
            if self.free == 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            done = super().write(data[: min(self.free, 50)])
            self.free -= done
            return done

    manifest.close()
    manifest._file = Disk(tmp_path / MANIFEST_NAME, "a")
    manifest.add(line("whole"))
    manifest._file.free = 60
    with pytest.raises(OutputError, match=r"manifest\.jsonl cannot be written: No space left"):
        manifest.add(line("cut"))
    manifest.close()
    again = Manifest(tmp_path / MANIFEST_NAME)
    assert set(again.last) == {"whole"}
    again.close()


@pytest.mark.parametrize("content", ["ply\nformat ascii 1.0\n", '{\n "asset": {}\n}', "[1]"])
def test_another_file_is_not_continued_as_a_manifest(tmp_path, content):
    path = tmp_path / "mesh.ply"
    path.write_text(content, "utf-8")
    with pytest.raises(OutputError, match=r"mesh\.ply is not the manifest of a batch: name another file"):
        Manifest(path)
    assert path.read_text("utf-8") == content
    path.write_text('{"output": "a", "sta', "utf-8")
    Manifest(path).close()
