"""Errors end in one line that says what to do, and in the exit code of their kind."""

import pytest
from commands import FAST, refused

from cascadenorm.cli import run
from cascadenorm.cli.errors import worded

OFF = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"


@pytest.mark.parametrize(
    ("words", "suggests"),
    [
        ("compare bad.obj true.ply", False),
        ("compare bad.obj true.ply --report r.html", False),
        ("spectrum bad.obj", False),
        ("fill-holes bad.obj", False),
        ("render bad.obj -o a.png", False),
        ("denoise true.ply --report r.html --truth bad.obj", False),
        ("denoise bad.obj", True),
        ("denoise bad.obj --weld 0.1", True),
        ("denoise bad.obj --drop-components 10", True),
        ("denoise-regions bad.obj true.ply -o out", True),
    ],
)
def test_isolating_is_suggested_only_where_it_helps(place, capsys, words, suggests):
    (place / "bad.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", encoding="ascii")
    code, message = refused(capsys, *words.split())
    assert code == 4 and "not finite" in message and ("--on-bad isolate" in message) == suggests


BAD_FILES = {
    "empty.ply": (b"", 3, "empty.ply: the file is empty"),
    "text.ply": (b"Dear Sir or Madam,\n", 3, "text.ply"),
    "text.xyz": (b"1 2 3\n4 5 6\n", 3, "text.xyz"),
    "random.stl": (bytes(range(256)) * 4, 3, "random.stl"),
    "index.off": (OFF.replace("3 2 0 3", "3 2 0 9").encode(), 4, "index.off: 1 face uses vertices that do not exist"),
    "nan.off": (OFF.replace("0 0 1\n", "0 0 nan\n").encode(), 4, "nan.off: 1 of 4 vertices are not finite"),
    "short.stl": (b"hello\n", 3, "short.stl: the file has 6 bytes, fewer than the 84 of a header"),
    "nothing.gltf": (b"{}", 4, "nothing.gltf: the file has no vertices and no faces: export the mesh again"),
    "points.off": (b"OFF\n2 0 0\n0 0 0\n1 1 1\n", 4, "points.off: the file has 2 vertices and no faces"),
}


@pytest.mark.parametrize("name", BAD_FILES)
@pytest.mark.parametrize("words", [["denoise", *FAST], ["compare", "true.ply"]])
def test_bad_files_end_in_one_line_and_no_output(place, capsys, name, words):
    content, code, message = BAD_FILES[name]
    (place / name).write_bytes(content)
    before = sorted(place.iterdir())
    found, line = refused(capsys, *words, name)
    assert found == code and message in line
    assert sorted(place.iterdir()) == before


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_truncated_files_are_unreadable(place, capsys, share):
    whole = (place / "ball.ply").read_bytes()
    (place / "cut.ply").write_bytes(whole[: int(share * len(whole))])
    assert refused(capsys, "denoise", "cut.ply", *FAST)[0] == 3


def test_a_large_strength_is_warned_of_and_does_no_more_than_ten(place, capsys):
    assert run(["denoise", "ball.ply", *FAST, "--strength", "3"]) == 0
    assert capsys.readouterr().err == ""
    for strength in ("10", "100"):
        assert run(["denoise", "ball.ply", "-o", f"{strength}.ply", *FAST, "--strength", strength]) == 0
        assert f"--strength {strength} removes shape as well as noise" in capsys.readouterr().err
    assert (place / "10.ply").read_bytes() == (place / "100.ply").read_bytes()


LONG = "n" * 300


def test_lack_of_memory_is_not_blamed_on_a_mesh():
    assert worded(MemoryError()) == "there is not enough memory"  # as for `render --size 100000`


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["denoise", f"{LONG}.ply"], 5),
        (["fill-holes", f"{LONG}.ply"], 5),
        (["studio", "--no-browser", f"{LONG}.ply"], 3),
        (["generate", LONG], 5),
        (["evaluate", LONG], 3),
        (["train", "--noisy", LONG], 3),
        (["train", "--shapes", LONG], 3),
    ],
    ids=lambda value: " ".join(value)[:15] if isinstance(value, list) else "",
)
def test_a_name_that_the_system_rejects_is_no_fault_of_the_program(words, code, place, capsys):
    if words[0] == "train":
        pytest.importorskip("torch")
    assert run(words) == code
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and "please report it" not in message
