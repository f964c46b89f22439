"""The manifest of a batch, and the digest of its settings."""

import errno
import io
import json
import os

import numpy as np
import pytest

from cascadenorm.batch.manifest import MANIFEST_NAME, REQUIRED, Manifest
from cascadenorm.batch.work import batch_settings
from cascadenorm.errors import OutputError, ParameterError
from cascadenorm.registry import find


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


def test_the_digest_of_the_settings_is_of_all_that_a_result_depends_on(tmp_path):
    mask = tmp_path / "mask.npy"
    np.save(mask, np.ones(4))

    usual = find("laplacian").settings["iterations"].default

    def key(method="laplacian", parameters=None, **controls):
        return batch_settings(method, parameters or {}, controls, None, force=False)[0].key

    assert key() == key(threads=1) == key(strength=1.0) == key(parameters={"iterations": usual})
    first = key(mask=str(mask))
    np.save(mask, np.zeros(4))
    others = [key("taubin"), key(parameters={"iterations": usual + 1}), key(strength=0.5), first, key(mask=str(mask))]
    assert len({key(), *others}) == 6
    with pytest.raises(ParameterError, match="cannot be read"):
        key("auto", {"model": tmp_path / "none.safetensors"})


def test_a_list_of_vertices_may_be_longer_than_a_file_name():
    fixed = ",".join(map(str, range(100)))
    settings, *_ = batch_settings("laplacian", {}, {"fixed": fixed}, None, force=False)
    assert settings.controls["fixed"] == fixed
