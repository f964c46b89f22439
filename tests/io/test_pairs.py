"""Pairs are found in folders, and folders without pairs are refused."""

import shutil

import pytest
from evaluated import save_pairs

from cascadenorm.evaluation.harness import evaluate
from cascadenorm.io import ReadError
from cascadenorm.io.pairs import find_pairs


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return save_pairs(tmp_path_factory.mktemp("pairs"))


def test_pairs_are_found_in_a_folder_and_in_the_folders_in_it(folder, tmp_path):
    assert [pair.name for pair in find_pairs([folder])] == ["ball", "cube"]
    assert [pair.name for pair in find_pairs([folder / "cube", folder / "ball"])] == ["cube", "ball"]
    assert [pair.name for pair in find_pairs([folder, folder / "ball"])] == ["ball", "cube"]
    other = shutil.copytree(folder / "ball", tmp_path / "ball")
    both = [pair.name for pair in find_pairs([folder, other])]
    assert both == [str(folder / "ball"), str(folder / "cube"), str(other)]


def test_folders_without_pairs_are_refused(folder, tmp_path):
    with pytest.raises(ReadError, match="is not a folder"):
        find_pairs([folder / "absent"])
    with pytest.raises(ReadError, match="holds no pairs"):
        find_pairs([folder / "notes"])
    with pytest.raises(ReadError, match="there are no pairs"):
        evaluate([])
    (tmp_path / "noisy.ply").touch()
    with pytest.raises(ReadError, match=r"holds noisy\.ply only"):
        find_pairs([tmp_path])
    (tmp_path / "clean.gltf").touch()
    for beside in ("noisy.mtl", "clean.bin", "clean.png"):  # what a mesh file names is none itself
        (tmp_path / beside).touch()
    assert [(pair.noisy.name, pair.clean.name) for pair in find_pairs([tmp_path])] == [("noisy.ply", "clean.gltf")]
    (tmp_path / "noisy.obj").touch()
    with pytest.raises(ReadError, match=r"holds 2 files noisy\.\*"):
        find_pairs([tmp_path])
