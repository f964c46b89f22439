"""Which files a batch takes, and where their results go."""

import errno
import json
import os
from pathlib import Path

import pytest
from batches import BALL, FAST, scans
from shapes import icosphere

from cascadenorm.batch.batch import denoise_files
from cascadenorm.batch.inputs import find_jobs
from cascadenorm.batch.work import Task, batch_settings, work
from cascadenorm.cli import run
from cascadenorm.errors import OutputError, ReadError
from cascadenorm.io.interop import save_mesh


def test_results_lie_as_the_files_do(place):
    scans(place / "scans", 2)
    (place / "scans" / "notes.txt").write_text("no mesh", encoding="ascii")
    (place / "scans" / ".hidden.ply").touch()
    (place / "scans" / ".hidden").mkdir()
    (place / "scans" / ".hidden" / "0.ply").touch()
    for sources in ("scans", "scans/**/*", [place / "scans"], ["scans/a/*.ply", "scans/b/0.ply"]):
        jobs = find_jobs(sources, Path("out"), "stl")
        assert [job.output for job in jobs] == ["out/a/0.stl", "out/b/0.stl"]
    assert [job.output for job in find_jobs("scans/b/0.ply", Path("out"))] == ["out/0.ply"]
    (place / "scans" / "b" / "0.ply").rename(place / "scans" / "b" / "[0].ply")
    assert [job.source for job in find_jobs("scans/b/[0].ply", Path("out"))] == ["scans/b/[0].ply"]


def test_patterns_end_where_links_lead_back(place):
    scans(place / "scans", 2)
    (place / ".elsewhere").mkdir()
    save_mesh(place / ".elsewhere" / "1.ply", BALL)
    (place / "scans" / "linked").symlink_to(place / ".elsewhere")
    for name in ("a", "b"):
        (place / "scans" / name / "loop").symlink_to("..")
        (place / "scans" / name / "itself").symlink_to("itself")
    expected = ["scans/a/0.ply", "scans/b/0.ply", "scans/linked/1.ply"]
    for pattern in ("scans/**/*.ply", "scans/**", "**/*.ply"):
        assert sorted(job.source for job in find_jobs(pattern, Path("out"))) == expected


def test_results_of_denoise_beside_their_sources_are_no_input(place, capsys):
    scans(place / "scans", 2)
    for name in ("a/0_denoised.ply", "a/0_denoised.stl", "b/other_denoised.ply"):
        save_mesh(place / "scans" / name, BALL)
    (place / "out").mkdir()
    save_mesh(place / "out" / "0.ply", BALL)
    save_mesh(place / "out" / "0_denoised.ply", BALL)
    for sources in ("scans", "scans/**/*", ["scans", "scans/a/*", "out"]):
        skipped = []
        found = {
            job.output.removeprefix("out/scans/").removeprefix("out/")
            for job in find_jobs(sources, Path("out"), skipped=skipped)
        }
        assert skipped == [str(Path("scans/a/0_denoised.ply"))]
        # without a source beside them they may be anything
        assert found == {"a/0.ply", "b/0.ply", "a/0_denoised.stl", "b/other_denoised.ply"}
    skipped = []
    for name in ("0.ply", "0_denoised.ply"):
        (named,) = find_jobs(f"scans/a/{name}", Path("out"), skipped=skipped)
        assert named.output == f"out/{name}" and not skipped
    assert run(["batch", "scans/a", "-o", "out2", *FAST, "--workers", "1"]) == 0
    said = capsys.readouterr().out
    assert "the results are in out2\n" in said
    assert f"1 file skipped: results of `denoise` beside their sources ({Path('scans/a/0_denoised.ply')})\n" in said
    assert run(["batch", "scans/a", "-o", "out2", *FAST, "--workers", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["skipped"] == [str(Path("scans/a/0_denoised.ply"))]


def test_a_format_that_cannot_be_read_is_the_fault_of_the_source_and_not_of_the_result(place, capsys):
    scans(place / "scans", 1)
    (place / "scans" / "part.fbx").write_text("no mesh", encoding="ascii")
    (job,) = find_jobs("scans/part.fbx", Path("out"))
    found = work(batch_settings("laplacian", {}, {}, None, force=False)[0], Task(job, None, checked=True))
    assert isinstance(found.error, ReadError) and "'fbx' is not a supported mesh format" in str(found.error)
    assert run(["denoise", "scans/a/0.ply", "-o", "0.fbx", *FAST]) == 5
    assert "the format 'fbx' cannot be written" in capsys.readouterr().err


def test_a_folder_that_cannot_be_listed_is_not_passed_over(place, monkeypatch):
    scans(place / "scans", 2)
    listed = os.scandir

    def stale(folder):
        if Path(folder).name == "b":
            raise OSError(errno.ESTALE, os.strerror(errno.ESTALE), folder)
        return listed(folder)

    monkeypatch.setattr(os, "scandir", stale)
    with pytest.raises(ReadError, match=r"scans/b cannot be listed: Stale file handle: try again, or name"):
        find_jobs("scans", Path("out"))


def test_a_file_that_cannot_be_looked_at_now_is_listed_for_the_work_to_say_so(place, monkeypatch):
    scans(place / "scans", 2)
    for name in ("stat", "lstat"):
        true = getattr(os, name)

        def stale(path, *rest, true=true, **options):
            if str(path).endswith("scans/b/0.ply"):
                raise OSError(errno.ESTALE, os.strerror(errno.ESTALE), path)
            return true(path, *rest, **options)

        monkeypatch.setattr(os, name, stale)
    found = {job.source: job.changed is None for job in find_jobs("scans", Path("out"))}
    assert found == {"scans/a/0.ply": False, "scans/b/0.ply": True}


def test_a_file_that_is_given_twice_by_links_is_denoised_once(place):
    scans(place / "scans", 1)
    (place / "scans" / "link.ply").symlink_to(place / "scans" / "a" / "0.ply")
    (place / "scans" / "c").symlink_to(place / "scans" / "a")
    assert len(find_jobs(["scans", "scans/c/*.ply"], Path("out"))) == 1


def test_results_stay_in_their_folder_where_sources_lie_beside_the_working_folder(tmp_path, monkeypatch):
    scans(tmp_path, 2)
    monkeypatch.chdir(tmp_path / "a")
    for sources in (["../b/0.ply", "0.ply"], ["../b", "."], ["../b/*.ply", "../a/*.ply"]):
        outputs = {job.output for job in find_jobs(sources, Path("../a/out"))}
        assert outputs == {"../a/out/a/0.ply", "../a/out/b/0.ply"}


def test_the_largest_file_comes_first_and_results_are_no_input(place):
    scans(place / "scans", 2)
    save_mesh(place / "scans" / "large.ply", icosphere(3))
    save_mesh(place / "scans" / "out.ply", BALL)
    jobs = find_jobs("scans", Path("scans/a"))
    assert [Path(job.source).name for job in jobs] == ["large.ply", "0.ply", "out.ply"]
    assert jobs[0].size == (place / "scans" / "large.ply").stat().st_size


def test_two_files_with_one_place_for_their_results_are_refused(place):
    scans(place / "scans", 1)
    save_mesh(place / "scans" / "a" / "0.obj", BALL)
    with pytest.raises(OutputError, match=r"0\.obj and scans/a/0\.ply would both be written to out/a/0\.stl"):
        denoise_files("scans", "out", format="stl", method="laplacian")
