"""Batches over files at URLs, against an S3-compatible server and a web server on the loopback address."""

import hashlib
import signal
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Event, Thread

import pytest
from batches import FAST, done_so_far, lines, results, scans, wait_for, watching
from shapes import icosphere, noisy

import cascadenorm as cn
from benchmarks.speed.scale import REQUESTS
from cascadenorm.batch import remote_files
from cascadenorm.batch.batch import denoise_files
from cascadenorm.batch.inputs import Job, find_jobs
from cascadenorm.batch.remote_files import file_name, fixed_part
from cascadenorm.batch.work import Task, batch_settings, work
from cascadenorm.cli import run
from cascadenorm.errors import OutputError, ParameterError, ReadError
from cascadenorm.io.files import is_url
from cascadenorm.io.interop import save_mesh

boto3 = pytest.importorskip("boto3")
pytest.importorskip("s3fs")
moto_server = pytest.importorskip("moto.server")


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    """The address of an S3-compatible server."""
    server = moto_server.ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    yield f"http://{host}:{port}"
    server.stop()


@pytest.fixture
def bucket(endpoint, tmp_path, monkeypatch):
    """An empty bucket, which every process finds by the environment."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("AWS_ENDPOINT_URL", endpoint)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "key")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    store = boto3.resource("s3", endpoint_url=endpoint).Bucket(tmp_path.name.replace("_", "-").lower())
    store.create()
    return store


def objects(bucket, prefix: str) -> dict[str, bytes]:
    found = bucket.objects.filter(Prefix=prefix)
    return {one.key.removeprefix(prefix): one.get()["Body"].read() for one in found}


@pytest.fixture
def asked(monkeypatch) -> list[str]:
    """The requests to the S3-compatible server."""
    from werkzeug.serving import WSGIRequestHandler

    found: list[str] = []
    monkeypatch.setattr(WSGIRequestHandler, "log_request", lambda handler, *_: found.append(handler.requestline))
    return found


def test_a_batch_from_and_to_an_object_store_is_that_of_folders(bucket, tmp_path, capsys, asked):
    """It takes as many requests for a file as the plan counts."""
    scans(tmp_path / "scans", 3)
    (tmp_path / "scans" / "a" / "bad.ply").write_text("ply\nno more", encoding="ascii")
    assert run(["batch", "scans", "-o", "local", *FAST, "--workers", "1"]) == 6
    for path in (tmp_path / "scans").rglob("*.ply"):
        bucket.upload_file(str(path), path.relative_to(tmp_path).as_posix())
    root = f"s3://{bucket.name}"
    capsys.readouterr()
    asked.clear()
    words = ["batch", f"{root}/scans/**/*.ply", "-o", f"{root}/out", *FAST, "--workers", "1", "--manifest", "m.jsonl"]
    assert run(words) == 6
    of_files = [line for line in asked if "/scans/" in line or "out" in line]  # without the listing of the sources
    assert len([line for line in of_files if "bad.ply" not in line]) == 3 * REQUESTS
    said = capsys.readouterr().err
    assert said.startswith(f"cascadenorm: {root}/scans/a/bad.ply: ") and said.count("\n") == 1 and "/tmp" not in said
    assert objects(bucket, "out/") == results(tmp_path / "local")

    (tmp_path / "manifest.jsonl").write_bytes((tmp_path / "m.jsonl").read_bytes())
    mine = {line["output"]: line for line in lines(tmp_path, "done")}
    for line in lines(tmp_path / "local", "done"):
        same = mine[line["output"]]
        assert all(same[key] == line[key] for key in ("input_sha256", "output_sha256", "settings"))
        assert same["summary"]["source"] == same["input"] == f"{root}/{line['input']}"

    bucket.delete_objects(Delete={"Objects": [{"Key": "out/a/1.ply"}, {"Key": "scans/a/bad.ply"}]})
    save_mesh(tmp_path / "changed.ply", noisy(icosphere(2), 0.1))
    bucket.upload_file(str(tmp_path / "changed.ply"), "scans/b/0.ply")
    bucket.put_object(Key="out/a/0.ply", Body=b"of somebody else")
    bucket.upload_file(str(tmp_path / "changed.ply"), "scans/b/1.ply")
    bucket.put_object(Key="out/b/1.ply", Body=b"not in the manifest")
    found = denoise_files(f"{root}/scans", f"{root}/out", method="laplacian", workers=1, manifest="m.jsonl")
    assert sorted(line["output"] for line in found.lines) == ["a/0.ply", "a/1.ply", "b/0.ply", "b/1.ply"]
    assert sorted(failure.source for failure in found.failures) == [
        f"{root}/scans/{name}.ply" for name in ("a/0", "b/1")
    ]
    for failure in found.failures:
        assert failure.error.remedy == ("force", True) and "exists already" in str(failure.error)
    assert objects(bucket, "out/a/0")[".ply"] == b"of somebody else"
    assert objects(bucket, "out/b/1")[".ply"] == b"not in the manifest"


def test_names_with_a_hash_or_a_question_mark_are_not_passed_over(bucket, tmp_path):
    scans(tmp_path / "scans", 1)
    for name in ("a#1.ply", "a?1.ply", "a?2.ply", "b#/c.ply", ".hidden.ply", ".hidden/d.ply"):
        bucket.upload_file(str(tmp_path / "scans" / "a" / "0.ply"), f"scans/{name}")
    root = f"s3://{bucket.name}/scans"
    inside = {job.source: job.output for job in find_jobs(root, "out")}
    assert inside == {f"{root}/{name}": f"out/{name}" for name in ("a#1.ply", "a?1.ply", "a?2.ply", "b#/c.ply")}
    (job,) = find_jobs(f"{root}/a#1.ply", "out")
    settings = batch_settings("laplacian", {}, {}, None, force=False)[0]
    checked = work(settings, Task(job, None))
    assert work(settings, Task(job, None, checked=True, digest=checked.input_digest)).status == "done"
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["a#1.ply"]


@pytest.mark.parametrize(
    ("url", "name", "folder"),
    [
        ("https://h/d/a.ply?sign=/x.y", "a.ply", "https://h/d"),
        ("https://h/d/a.ply#top", "a.ply", "https://h/d"),
        ("s3://b/d/a?x#y.ply", "a?x#y.ply", "s3://b/d"),
        ("s3://b/d#e", "d#e", "s3://b/d#e"),
        ("https://h", "", "https://h"),
    ],
)
def test_a_query_is_no_part_of_a_name_on_the_web_alone(url, name, folder):
    assert (file_name(url), fixed_part(url)) == (name, folder)


def test_files_of_a_web_server_are_denoised_into_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scans(tmp_path / "scans", 2)
    for name in ("a", "b"):
        (tmp_path / "local" / name).mkdir(parents=True)
        cn.denoise_file(f"scans/{name}/0.ply", f"local/{name}/0.ply", method="laplacian")
    handler = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    monkeypatch.setattr(SimpleHTTPRequestHandler, "log_message", lambda *_: None)
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    Thread(target=server.serve_forever, daemon=True).start()
    try:
        root = f"http://127.0.0.1:{server.server_port}"
        names = [f"{root}/scans/a/0.ply", f"{root}/scans/b/0.ply?token=3", f"{root}/scans/none.ply"]
        found = denoise_files(names, "out", method="laplacian", workers=1, retries=0)
        assert results(tmp_path / "out") == results(tmp_path / "local")
        (failure,) = found.failures
        assert failure.source == names[2] and f"{names[2]} cannot be read: it does not exist" in str(failure.error)
        listed = [job.source for job in find_jobs(f"{root}/scans/*/*.ply", "out")]
        assert sorted(listed) == [f"{root}/scans/a/0.ply", f"{root}/scans/b/0.ply"]
    finally:
        server.shutdown()
        server.server_close()


class Overwritten(SimpleHTTPRequestHandler):
    """A web server on which each file is replaced after half of it has been read, as often as a list says."""

    times: list[int]
    new: bytes

    def copyfile(self, source, outputfile):
        whole = source.read()
        outputfile.write(whole[: len(whole) // 2])
        if self.times:
            self.times.pop()
            Path(self.translate_path(self.path)).write_bytes(self.new)
        source.seek(len(whole) // 2)
        outputfile.write(source.read()[: len(whole) - len(whole) // 2])
        self.close_connection = True  # fewer bytes than were promised

    def log_message(self, *_):
        pass


@pytest.mark.slow  # a process; test_work.py has a file of a folder that changes
def test_a_file_that_is_replaced_while_it_is_read_is_tried_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scans(tmp_path / "new", 1)
    new = (tmp_path / "new" / "a" / "0.ply").read_bytes()
    (tmp_path / "scan.ply").write_bytes(new.replace(b"ply\n", b"ply\ncomment\n", 1))  # longer, and mostly the same
    names = {"times": [1], "new": new, "protocol_version": "HTTP/1.1"}
    handler = partial(type("Handler", (Overwritten,), names), directory=str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        found = denoise_files(
            f"http://127.0.0.1:{server.server_port}/scan.ply", "out", method="laplacian", workers=1, retries=1
        )
        server.shutdown()
    (line,) = found.lines
    assert line["attempts"] == 2 and line["input_sha256"] == hashlib.sha256(new).hexdigest()
    cn.denoise_file(tmp_path / "new" / "a" / "0.ply", "alone.ply", method="laplacian")
    assert (tmp_path / "out" / "scan.ply").read_bytes() == (tmp_path / "alone.ply").read_bytes()


def test_a_server_that_falls_silent_within_a_file_is_an_error_and_may_be_asked_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scans(tmp_path / "scans", 1)
    silent, given_up = [True], Event()

    class Handler(SimpleHTTPRequestHandler):
        def copyfile(self, source, outputfile):
            whole = source.read()
            outputfile.write(whole[:-10])
            if silent:
                silent.pop()
                given_up.wait()
            outputfile.write(whole[-10:])

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, directory=str(tmp_path / "scans" / "a"))) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/0.ply"
        with monkeypatch.context() as patch, pytest.raises(ReadError, match=r"0\.ply cannot be read"):
            patch.setattr(remote_files, "RESPONSE_TIMEOUT_S", 0.5)
            remote_files.fetched(url, tmp_path / "first")
        given_up.set()
        monkeypatch.setattr(remote_files, "RESPONSE_TIMEOUT_S", 24 * 3600.0)
        assert remote_files.fetched(url, tmp_path / "second").read_bytes() == (tmp_path / "scans/a/0.ply").read_bytes()
        server.shutdown()


@pytest.mark.slow  # two more processes; test_watching.py has a folder that is gone for a while
def test_a_watch_goes_on_when_its_server_does_not_answer_for_a_while(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scans(tmp_path / "scans", 2)
    (tmp_path / "scans" / "b").rename(tmp_path / "later")
    monkeypatch.setattr(SimpleHTTPRequestHandler, "log_message", lambda *_: None)
    handler = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))

    def start(port):
        server = ThreadingHTTPServer(("127.0.0.1", port), handler)
        Thread(target=server.serve_forever, daemon=True).start()
        return server

    server = start(0)
    root = f"http://127.0.0.1:{server.server_port}/scans/*/*.ply"
    with watching(root, "-o", "out", "--watch", "0", "--workers", "1") as process:
        wait_for(lambda: done_so_far(tmp_path / "out") == 1, process)
        server.shutdown()
        server.server_close()
        assert process.stderr.readline().startswith(f"cascadenorm: {root} cannot be read: ")
        (tmp_path / "later").rename(tmp_path / "scans" / "b")
        server = start(server.server_port)
        wait_for(lambda: done_so_far(tmp_path / "out") == 2, process)
        process.send_signal(signal.SIGINT)
        process.communicate()
        server.shutdown()
        server.server_close()
    assert process.returncode == 130 and not lines(tmp_path / "out", "failed")


def test_a_result_that_does_not_arrive_is_a_failure_of_its_file_alone(bucket, tmp_path):
    scans(tmp_path / "scans", 2)
    found = denoise_files("scans", "s3://no-such-bucket/out", method="laplacian", workers=1, retries=0, manifest="m")
    assert {type(failure.error) for failure in found.failures} == {OutputError} and len(found.failures) == 2
    assert str(found.failures[0].error).startswith("s3://no-such-bucket/out/")


def test_what_cannot_be_written_whole_or_has_no_manifest_is_refused(tmp_path):
    scans(tmp_path / "scans", 1)
    with pytest.raises(OutputError, match=r"https://host/out cannot be written: results go to folders or object"):
        denoise_files(tmp_path / "scans", "https://host/out")
    with pytest.raises(OutputError, match=r"https://host/out cannot be written: results go to folders or object"):
        denoise_files(tmp_path / "scans", "https://host/out", manifest=tmp_path / "m.jsonl")
    with pytest.raises(ParameterError, match="manifest is not given, and s3://bucket/out is a URL"):
        denoise_files(tmp_path / "scans", "s3://bucket/out")
    with pytest.raises(ReadError, match="some sources are URLs and others are not"):
        find_jobs(["s3://bucket/a.ply", "scans"], "out")
    with pytest.raises(ReadError, match="several buckets"):
        find_jobs(["s3://one/a.ply", "s3://two/a.ply"], "out")


def test_the_parts_of_a_url():
    assert is_url("s3://b/a.ply") and is_url("https://h/a.ply")
    assert not any(map(is_url, ["scans/a.ply", "C://a.ply", Path("s3://b"), 3]))
    assert file_name("https://h/a/b.ply?x=/c.ply") == "b.ply"
    assert fixed_part("s3://b/scans/**/*.ply") == fixed_part("s3://b/scans/x.ply") == fixed_part("s3://b/scans/")
    assert fixed_part("s3://b/sc*") == "s3://b"


def test_materials_and_textures_are_not_put_into_a_store(bucket, tmp_path):
    (tmp_path / "scans" / "maps").mkdir(parents=True)
    source = tmp_path / "scans" / "a.obj"
    save_mesh(source, noisy(icosphere(2), 0.2))
    source.write_bytes(b"mtllib paint.mtl\n" + source.read_bytes())
    (tmp_path / "scans" / "paint.mtl").write_bytes(b"newmtl red\nmap_Kd maps/wood.png\n")
    (tmp_path / "scans" / "maps" / "wood.png").write_bytes(b"oak")
    bucket.put_object(Key="out/paint.mtl", Body=b"precious")
    settings = batch_settings("laplacian", {}, {}, None, force=False)[0]
    found = work(settings, Task(Job("scans/a.obj", f"s3://{bucket.name}/out/a.obj", 1, 1), None, checked=True))
    assert found.status == "done", found.error
    assert found.summary.left_out == tuple(
        f"the file '{name}' that it references" for name in ("paint.mtl", "maps/wood.png")
    )
    stored = objects(bucket, "out/")
    assert set(stored) == {"a.obj", "paint.mtl"} and stored["paint.mtl"] == b"precious"
