"""The package is whole in a checkout in which nothing is installed."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
DENOISE = """
import sys
from pathlib import Path

import cascadenorm as cn
import cascadenorm.baselines, cascadenorm.data_gen.noise.noise

for package in (cn, cn.baselines, cn.data_gen.noise.noise):
    assert Path(sys.argv[1]) in Path(package.__file__).parents, package.__file__
mesh = cn.read(Path(cn.__file__).parent / "demo_data" / "part" / "noisy.ply").mesh
piece = cn.Mesh(mesh.vertices, mesh.faces[:60])
assert (cn.denoise(piece, method="taubin").vertices != piece.vertices).any()
"""


@pytest.mark.parametrize(
    "command", [("-c", DENOISE, str(ROOT)), ("-m", "cascadenorm", "methods")], ids=["Python", "program"]
)
def test_a_checkout_works_without_an_installation(command):
    """-S leaves out what an editable install has written; the folders of the dependencies are given as they are."""
    libraries = {str(Path(package.__file__).parents[1]) for package in (np, pytest)}
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sorted(libraries)), "PYTHONWARNINGS": "error"}
    done = subprocess.run([sys.executable, "-S", *command], cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert command[0] == "-c" or "bilateral-normal" in done.stdout
