"""Files that a mesh file names: taken along into another folder, named where that cannot be."""

import os

import pytest
from sample_files import MATERIALS, OBJ, PLY_TEXT

from cascadenorm import io
from cascadenorm.io import files


@pytest.fixture
def place(tmp_path):
    (tmp_path / "in" / "maps").mkdir(parents=True)
    (tmp_path / "out").mkdir()
    (tmp_path / "gloss.png").write_bytes(b"gloss")
    (tmp_path / "in" / "a.obj").write_bytes(OBJ)
    (tmp_path / "in" / "some materials.mtl").write_bytes(MATERIALS)
    (tmp_path / "in" / "maps" / "rust and dust.png").write_bytes(b"rust")
    (tmp_path / "in" / "a.ply").write_bytes(
        PLY_TEXT.replace(b"obj_info num", b"comment TextureFile caf\xe9.png\nobj_info num")
    )
    return tmp_path


def names(folder) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_materials_and_textures_follow_an_obj(place):
    lost = io.write(io.read(place / "in" / "a.obj"), place / "out" / "b.obj")
    assert names(place / "out") == ["b.obj", "maps/rust and dust.png", "some materials.mtl"]
    assert (place / "out" / "some materials.mtl").read_bytes() == MATERIALS
    assert sorted(lost) == [
        "the file '../gloss.png' that it references",
        "the file 'maps/bumps.png' that it references",
    ]


def test_materials_may_be_copied_by_another_process_in_the_meantime(place, monkeypatch):
    """As happens in a batch of files that share a library."""

    def meanwhile(folder) -> None:
        folder.mkdir(exist_ok=True)
        (place / "out" / "some materials.mtl").write_bytes(MATERIALS)

    monkeypatch.setattr(files, "make_folder", meanwhile)
    io.write(io.read(place / "in" / "a.obj"), place / "out" / "b.obj")
    assert names(place / "out") == ["b.obj", "maps/rust and dust.png", "some materials.mtl"]
    with pytest.raises(io.OutputError, match=r"b.obj exists already"):
        io.write(io.read(place / "in" / "a.obj"), place / "out" / "b.obj")


def test_several_libraries_in_a_line_are_found_and_backslashes_are_slashes(place):
    source = place / "in"
    (source / "maps" / "b.mtl").write_bytes(b"newmtl b\nmap_Ks \nmap_Kd maps/rust.png\n")
    (source / "a.mtl").write_bytes(b"newmtl a\n")
    (source / "a.obj").write_bytes(OBJ.replace(b"some materials.mtl", b".\\a.mtl maps\\b.mtl"))
    assert io.write(io.read(source / "a.obj"), place / "out" / "b.obj") == [
        "the file 'maps/maps/rust.png' that it references"
    ]
    assert names(place / "out") == ["a.mtl", "b.obj", "maps/b.mtl"]


def test_nothing_is_copied_beside_the_input_or_into_another_format(place):
    before = names(place / "in")
    assert io.write(io.read(place / "in" / "a.obj"), place / "in" / "b.obj") == []
    io.write(io.read(place / "in" / "a.obj"), place / "out" / "b.ply")
    assert names(place / "in") == sorted([*before, "b.obj"]) and names(place / "out") == ["b.ply"]


def test_textures_follow_a_ply(place):
    name = os.fsdecode(b"caf\xe9.png")
    file = io.read(place / "in" / "a.ply")
    assert io.write(file, place / "out" / "b.ply") == [f"the file {name!r} that it references"]
    (place / "in" / name).write_bytes(b"picture")
    assert io.write(file, place / "out" / "b.ply", force=True) == []
    assert (place / "out" / name).read_bytes() == b"picture"


def test_other_content_in_the_way_is_refused(place):
    (place / "out" / "some materials.mtl").write_bytes(b"precious")
    with pytest.raises(io.OutputError, match=r"differs from the referenced file 'some materials\.mtl'"):
        io.write(io.read(place / "in" / "a.obj"), place / "out" / "b.obj")
    assert names(place / "out") == ["some materials.mtl"]
    io.write(io.read(place / "in" / "a.obj"), place / "out" / "b.obj", force=True)
    assert (place / "out" / "some materials.mtl").read_bytes() == MATERIALS
