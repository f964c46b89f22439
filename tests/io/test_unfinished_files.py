"""Temporary files that killed processes leave."""

import os

from cascadenorm.io.atomic import remove_unfinished, unfinished_name


def test_temporary_files_of_killed_processes_are_removed_and_no_others(tmp_path):
    alike = [f"{'x' * 50}-{number}.ply" for number in (1, 2)]  # the same first 40 characters
    outputs = ["scan.ply", alike[0], "part.gltf"]
    mine = [unfinished_name(name, tmp_path / name) for name in outputs]
    mine += [unfinished_name(name, tmp_path / "part.gltf") for name in ("part.bin", "texture.png")]
    owners = ["scan.obj", "scan.stl", alike[1], "other.ply"]  # the same stem; the same beginning
    others = [unfinished_name(name, tmp_path / name) for name in owners]
    others += ["scan.ply", ".scan.ply.part", ".scan.ply.notes.part"]
    for name in (*mine, *others):
        (tmp_path / name).touch()
    remove_unfinished([*(tmp_path / name for name in outputs), tmp_path / "nowhere" / "scan.ply"])
    assert sorted(os.listdir(tmp_path)) == sorted(others)
