"""A report tells all that makes its result again, and leads with what changed."""

import hashlib
import re
import shlex

import numpy as np
from report_contents import CLEAN, ROUGH, text_of
from shapes import grid

import cascadenorm as cn
from cascadenorm.api.api import denoise_file_with_meshes
from cascadenorm.cli import run
from cascadenorm.mesh import Mesh
from cascadenorm.reports import report_denoised
from cascadenorm.reports.facts import command_line, python_call


def test_a_report_on_a_denoised_file_has_all_that_makes_it_again(place):
    arguments = ["denoise", "rough.ply", "-o", "out.ply", "--method", "taubin", "--set", "iterations=3"]
    arguments += ["--strength", "0.5", "--keep-volume", "--fixed", "0,5,7-9"]
    assert run([*arguments, "--report", "r.html", "--truth", "true.ply"]) == 0
    text = text_of(place / "r.html")
    for name in ("rough.ply", "out.ply", "true.ply"):
        assert hashlib.sha256((place / name).read_bytes()).hexdigest() in text
    assert cn.__version__ in text and "0,5,7-9" in text
    assert f"{cn.compare('out.ply', 'true.ply').normal_error_deg:.3f}" in text
    assert len(re.findall(r"\bstrength 0\.5 1\.0\b", text)) == 1

    commands = re.findall(r"<pre><code>(.*?)</code></pre>", (place / "r.html").read_text(), re.S)
    first = (place / "out.ply").read_bytes()
    command = shlex.split(commands[0].replace("&#x27;", "'").replace("&quot;", '"'))
    assert command[0] == "cascadenorm"
    assert run([*command[1:], "--force"]) == 0
    assert (place / "out.ply").read_bytes() == first
    (place / "out.ply").unlink()
    exec(commands[1].replace("&#x27;", "'").replace("&quot;", '"'), {})
    assert (place / "out.ply").read_bytes() == first


def test_a_report_leads_with_figures_before_and_after(place):
    double = Mesh(ROUGH.vertices * np.cbrt([2, 2, 2]), ROUGH.faces)
    cn.report("r.html", ROUGH, double, truth=Mesh(CLEAN.vertices, CLEAN.faces))
    text = text_of(place / "r.html")
    noise = f"{cn.inspect(ROUGH).noise:.2g}"
    angle = f"{cn.compare(ROUGH, CLEAN).normal_error_deg:.2f}°"
    assert f"Noise {noise} → {noise} mean edge lengths" in text
    assert f"Angle to the truth {angle} → {angle}" in text
    assert "Volume +100.00 %" in text
    assert re.search(r"Self-intersecting faces \d+ → \d+ Spikes \d+ → \d+", text)
    cn.report("r.html", ROUGH, double, force=True)
    assert "Angle to the input 0.00°" in text_of(place / "r.html")
    cn.report("open.html", grid(3, 4))
    assert "Volume none open, 1 boundary loop" in text_of(place / "open.html")
    flipped = Mesh(ROUGH.vertices, [ROUGH.faces[0, ::-1], *ROUGH.faces[1:]])
    cn.report("flipped.html", flipped)
    said = text_of(place / "flipped.html")
    assert "surface closed" in said and "Volume none not an oriented manifold" in said


def test_the_kind_of_error_is_said_as_denoise_says_it(place, capsys):
    assert run(["denoise", "rough.ply", "-o", "out.ply", "--report", "r.html"]) == 0
    lines = dict(line.split(": ", 1) for line in capsys.readouterr().out.splitlines() if ": " in line)
    text = text_of(place / "r.html")
    assert f"Kind of error: {lines['kind of error']}. Treated as: {lines['treated as']}. Method: auto" in text


def test_what_was_welded_and_dropped_before_is_made_again(place, monkeypatch):
    settings = {"weld": "0.001 edges", "drop_components": "1%"}
    done = denoise_file_with_meshes("rough.ply", "smooth.ply", method="laplacian", **settings)
    report_denoised("report.html", done)
    first = (place / "smooth.ply").read_bytes()
    (place / "smooth.ply").unlink()
    words = shlex.split(command_line(done.summary))
    assert words[-4:] == ["--weld", "0.001 edges", "--drop-components", "1%"]
    assert run(words[1:]) == 0 and (place / "smooth.ply").read_bytes() == first
    assert python_call(done.summary).endswith("weld='0.001 edges', drop_components='1%')")


def test_a_file_name_that_begins_with_a_hyphen_is_no_option_of_the_command(place):
    (place / "rough.ply").rename("-h rough.ply")
    done = denoise_file_with_meshes("-h rough.ply", "-h smooth.ply", method="laplacian")
    result = place / "-h smooth.ply"
    first = result.read_bytes()
    result.unlink()
    assert run(shlex.split(command_line(done.summary))[1:]) == 0 and result.read_bytes() == first


def test_learned_methods_name_the_digest_of_their_weights(place):
    denoised = denoise_file_with_meshes("rough.ply", "out.ply", method="laplacian")
    report_denoised("plain.html", denoised)
    assert "weights of" not in text_of(place / "plain.html")
    auto = denoised._replace(summary=denoised.summary.__class__(**{**vars(denoised.summary), "method": "auto"}))
    report_denoised("auto.html", auto)
    weights = (cn.__path__[0], "weights", "auto.safetensors")
    with open("/".join(weights), "rb") as file:
        assert hashlib.sha256(file.read()).hexdigest() in text_of(place / "auto.html")
