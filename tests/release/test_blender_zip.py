"""The zip of the extension: what Blender asks of a manifest, and everything that it lists."""

import sys
import zipfile

import pytest
from blender_zip import build

import cascadenorm as cn

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

REQUIRED = {
    "schema_version",
    "id",
    "version",
    "name",
    "tagline",
    "maintainer",
    "type",
    "license",
    "blender_version_min",
}


@pytest.fixture(scope="module")
def wheels(tmp_path_factory):
    """The wheel of the package alone: the others would be downloaded."""
    return build.own_wheel(tmp_path_factory.mktemp("wheel"))


@pytest.fixture(params=["3.11", "3.13"])
def archive(request, wheels, tmp_path):
    """The zip for a version of Python."""
    with zipfile.ZipFile(build.packed(wheels, "linux-x64", request.param, tmp_path)) as opened:
        yield opened


def test_the_manifest_says_what_blender_asks_for(archive):
    manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
    assert set(manifest) >= REQUIRED and manifest["version"] == cn.__version__
    assert not manifest["tagline"].endswith((".", "!")) and len(manifest["tagline"]) <= 64
    assert all(len(reason) <= 64 and not reason.endswith(".") for reason in manifest["permissions"].values())
    assert manifest["platforms"] == ["linux-x64"] and manifest["license"] == ["SPDX:MIT"]


def test_everything_that_is_listed_is_in_the_zip(archive):
    names = set(archive.namelist())
    wheels = tomllib.loads(archive.read("blender_manifest.toml").decode())["wheels"]
    assert wheels and {wheel.removeprefix("./") for wheel in wheels} <= names
    assert {"__init__.py", "LICENSE"} <= names
    with archive.open(wheels[0].removeprefix("./")) as inside, zipfile.ZipFile(inside) as wheel:
        assert "cascadenorm/frontends/blender/operators.py" in wheel.namelist()
    assert f"| cascadenorm | {cn.__version__} | MIT |" in archive.read("LICENSES.md").decode()
