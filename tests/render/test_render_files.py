"""Files with pictures of several meshes."""

import io
import re
import shutil
import subprocess
import sys
from base64 import b64decode

import numpy as np
import PIL.Image
import pytest
from pictures import decoded
from shapes import cube, icosphere, noisy

from cascadenorm.cli import run
from cascadenorm.errors import ParameterError
from cascadenorm.geometry.curvature import mean_curvature
from cascadenorm.geometry.metrics import measure
from cascadenorm.io import OutputError
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh
from cascadenorm.render import Camera
from cascadenorm.render.encoding import mp4
from cascadenorm.render.figure import ACCENTS
from cascadenorm.render.files import draw
from cascadenorm.render.scenes import FRAMES as TURNS
from cascadenorm.render.scenes import Style

BALL = icosphere(3)
ROUGH = noisy(BALL, 0.3)


def drawn(path, meshes, **style):
    """The pixels of a PNG file of meshes."""
    draw(meshes, path, Style(size=100, **style), force=True)
    return decoded(path.read_bytes()).astype(int)


def test_one_scale_of_colors_for_all_panels(tmp_path):
    """A mesh has the same colours wherever it stands, and a mesh with less error is lighter."""
    half = BALL.moved(0.9 * BALL.vertices + 0.1 * ROUGH.vertices)
    first = drawn(tmp_path / "a.png", [ROUGH, half], values="normal-error", reference=BALL)
    second = drawn(tmp_path / "b.png", [half, ROUGH], values="normal-error", reference=BALL)
    shown = Camera.looking_at(half), Camera.looking_at(ROUGH)
    assert shown[0].shows(ROUGH) and shown[1].shows(half)
    assert first[:100, :100].mean() < first[:100, 112:212].mean() - 10
    assert np.abs(first[20:80, 20:80].mean() - second[20:80, 132:192].mean()) < 3


def test_captions_have_the_mean_that_compare_measures(tmp_path):
    draw([ROUGH], tmp_path / "a.svg", Style(size=200, values="normal-error", reference=BALL), names=["rough"])
    mean = measure(ROUGH, BALL).normal_error_deg
    assert f">rough  mean {mean:#.3g}°</text>" in (tmp_path / "a.svg").read_text(encoding="utf-8")


@pytest.mark.parametrize("size", [16, 32])
def test_a_small_picture_has_a_color_bar(tmp_path, size):
    draw([BALL], tmp_path / "a.png", Style(size=size, values="curvature"), names=[""])
    assert decoded_size(tmp_path / "a.png") > (size, size)


def test_a_caption_has_no_mean_where_no_value_is_known(tmp_path, recwarn):
    one = Mesh(np.eye(3), [[0, 1, 2]])
    draw([one], tmp_path / "a.svg", Style(size=64, values="noise"), names=["one"])
    assert ">one</text>" in (tmp_path / "a.svg").read_text(encoding="utf-8") and not recwarn.list


def test_the_first_mesh_is_what_others_are_compared_with(tmp_path):
    picture = drawn(tmp_path / "a.png", [ROUGH, BALL], values="displacement")
    plain = drawn(tmp_path / "b.png", [ROUGH, BALL])
    assert (picture[:100, :100] == plain[:100, :100]).all()
    assert (picture[:100, 112:212] != plain[:100, 112:212]).any()


@pytest.mark.parametrize(
    ("values", "reference", "label"),
    [
        ("angle", None, "Angle to the input"),
        ("angle", BALL, "Angle to the reference"),
        ("normal-error", None, "Angle to the first mesh"),
        ("normal-error", BALL, "Angle to the reference"),
        ("distance", BALL, "Distance to the reference"),
    ],
)
def test_the_bar_names_the_mesh_that_values_are_measured_from(tmp_path, values, reference, label):
    draw([ROUGH, BALL], tmp_path / "a.svg", Style(size=64, values=values, reference=reference), names=["a", "b"])
    assert label in (tmp_path / "a.svg").read_text(encoding="utf-8")


def test_curvature_is_on_both_sides_of_grey(tmp_path):
    draw([BALL], tmp_path / "a.svg", Style(values="curvature", size=64))
    text = (tmp_path / "a.svg").read_text(encoding="utf-8")
    numbers = [float(found.replace("−", "-")) for found in re.findall(r">(−?[\d.]+)</text>", text)]
    assert min(numbers) == -max(numbers) and max(numbers) >= 0.5 * np.abs(mean_curvature(BALL)).max()
    assert "Mean curvature (1 / mesh unit)" in text


def test_parts_are_enlarged_below_each_picture_in_frames_of_one_color(tmp_path):
    crops = [(0.5, 0.5, 0.2), (0.3, 0.6, 0.1)]
    picture = drawn(tmp_path / "a.png", [ROUGH, BALL], crops=crops)
    for number, color in enumerate(ACCENTS[:2]):
        alike = (np.abs(picture - list(bytes.fromhex(color[1:]))) < 3).all(axis=2)
        assert all(alike[rows, :100].any() and alike[rows, 112:].any() for rows in (slice(0, 100), slice(112, 160)))
        x, y, width = crops[number]
        rows, columns = np.nonzero(alike[:100, :100])
        assert (np.ptp(columns), np.ptp(rows)) == pytest.approx((100 * width, 100 * width), abs=3)
        assert (columns.mean(), rows.mean()) == pytest.approx((100 * x, 100 * y), abs=2)


def test_vector_files_hold_the_same_pixels_and_text_as_text(tmp_path):
    style, picture = Style(size=100, crops=[(0.5, 0.5, 0.2)]), drawn(tmp_path / "a.png", [ROUGH, BALL])[:100, :100]
    for suffix in ("svg", "pdf"):
        draw([ROUGH, BALL], tmp_path / f"a.{suffix}", style, names=["a (one)", "ball"])
    text = (tmp_path / "a.svg").read_text(encoding="utf-8")
    with PIL.Image.open(io.BytesIO(b64decode(re.search(r"base64,([^\"]+)", text)[1]))) as image:
        first = np.asarray(image.convert("RGB"))
    assert (first == picture).all() and ">a (one)</text>" in text and text.count("<image") == 4
    data = (tmp_path / "a.pdf").read_bytes()
    sides = sorted(re.findall(rb"/Width (\d+) /Height (\d+)", re.sub(rb"\s+", b" ", data)))
    assert (
        data.startswith(b"%PDF-") and b"/FontFile2" in data and sides == 2 * [(b"100", b"100")] + 2 * [(b"100", b"100")]
    )


def test_a_png_says_how_large_it_is_and_may_be_transparent(tmp_path):
    draw([BALL], tmp_path / "a.png", Style(size=64, transparent=True, values="noise"), names=["ball"])
    with PIL.Image.open(tmp_path / "a.png") as image:
        assert image.mode == "RGBA" and image.info["dpi"] == pytest.approx((300, 300), abs=0.1)
        pixels = np.asarray(image)
    assert pixels[0, 0, 3] == 0 and pixels[32, 32, 3] == 255 and 0 < pixels[64:, :, 3].mean() < 200


def test_a_turntable_shows_every_side_once(tmp_path):
    flat = cube(2).moved(cube(2).vertices * (2, 1, 0.1))
    draw([flat], tmp_path / "t.webp", Style(size=64, direction=(0, 0, 1)), turntable=True)
    with PIL.Image.open(tmp_path / "t.webp") as image:
        assert image.n_frames == TURNS
        widths = []
        for number in range(0, TURNS, TURNS // 4):
            image.seek(number)
            dark = np.asarray(image.convert("L")) < 240
            widths.append(np.ptp(np.flatnonzero(dark[28:36].any(axis=0))))
    assert widths[0] == pytest.approx(widths[2], abs=2) and widths[1] == pytest.approx(widths[3], abs=2)
    assert widths[1] < 0.3 * widths[0]


def test_a_turntable_turns_around_the_target_at_the_distance(tmp_path):
    """A cube beside the target is seen at both sides of the middle, and half as large from twice as far."""
    box = cube(2).moved(cube(2).vertices * 0.1 + np.array([1.0, 0, 0]))
    places = []
    for number, distance in enumerate((4.0, 8.0)):
        style = Style(size=64, direction=(0, 0, 1), target=(0, 0, 0), distance=distance)
        draw([box], tmp_path / f"{number}.webp", style, names=[""], turntable=True)
        with PIL.Image.open(tmp_path / f"{number}.webp") as image:
            for frame in (0, TURNS // 2):
                image.seek(frame)
                places.append(np.flatnonzero((np.asarray(image.convert("L")) < 200).any(axis=0)).mean() - 31.5)
    assert places[0] == pytest.approx(-places[1], abs=2) and abs(places[0]) > 20
    assert places[2:] == pytest.approx([places[0] / 2, places[1] / 2], abs=2)


def video_of(path):
    """The frames of a video, and the format of its pixels."""
    read = ["ffmpeg", "-loglevel", "error", "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    probe = ["ffprobe", "-v", "error", "-count_frames", "-show_entries", "stream=width,height,pix_fmt,nb_read_frames"]
    said = subprocess.run([*probe, "-of", "csv=p=0", str(path)], capture_output=True, check=True, text=True)
    width, height, pixels, count = said.stdout.strip().split(",")
    data = subprocess.run(read, capture_output=True, check=True).stdout
    frames = np.frombuffer(data, np.uint8).reshape(int(count), int(height), int(width), 3)
    return frames.astype(int), pixels


needs_ffmpeg = pytest.mark.skipif(not shutil.which("ffmpeg"), reason="needs the program ffmpeg")


@needs_ffmpeg
def test_an_mp4_file_has_the_pictures_in_their_order(tmp_path):
    """Sides are even, as H.264 wants them: 33 and 65 pixels become 34 and 66."""
    images = [np.full((33, 65, 3), 200, np.uint8) for _ in range(8)]
    for number, image in enumerate(images):
        image[:, 8 * number : 8 * number + 8] = 40
    data = mp4(images, milliseconds=60)
    assert data == mp4(iter(images), milliseconds=60)
    (tmp_path / "a.mp4").write_bytes(data)
    frames, pixels = video_of(tmp_path / "a.mp4")
    assert pixels == "yuv420p" and frames.shape == (8, 34, 66, 3)
    for frame, image in zip(frames, images, strict=True):
        assert np.abs(frame[:33, :65] - image.astype(int)).mean() < 8


@needs_ffmpeg
def test_a_turntable_may_be_an_mp4_file(tmp_path):
    """It has no transparency."""
    flat = cube(2).moved(cube(2).vertices * (2, 1, 0.1))
    style = Style(size=32, direction=(0, 0, 1), transparent=True)
    draw([flat], tmp_path / "t.mp4", style, names=[""], turntable=True)
    frames, _ = video_of(tmp_path / "t.mp4")
    assert len(frames) == TURNS and frames[:, 0, 0].min() > 245
    widths = [np.ptp(np.flatnonzero((frame[14:18] < 230).any(axis=(0, 2)))) for frame in frames[:: TURNS // 4]]
    assert widths[1] < 0.4 * widths[0] and widths[2] > 0.8 * widths[0]


def test_an_mp4_file_needs_ffmpeg_and_says_what_that_says(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(OutputError, match=r"needs the program ffmpeg, .* or give a name that ends in \.webp"):
        draw([BALL], tmp_path / "t.mp4", turntable=True)
    if sys.platform != "win32":
        (tmp_path / "ffmpeg").write_text("#!/bin/sh\necho Unknown encoder >&2\nexit 8\n")
        (tmp_path / "ffmpeg").chmod(0o755)
        with pytest.raises(OutputError, match="ffmpeg ended with 8: Unknown encoder"):
            draw([cube(2)], tmp_path / "t.mp4", Style(size=32), turntable=True)
    assert not (tmp_path / "t.mp4").exists()


def test_a_target_and_a_distance_are_in_the_unit_of_the_file(tmp_path):
    """What lies at the target is in the middle, however large and far the mesh."""
    far = BALL.moved(512 * BALL.vertices + np.array([4096.0, 0, 0]))
    target = far.vertices[np.argmax(far.vertices[:, 2])]
    near = drawn(tmp_path / "a.png", [BALL], direction=(0, 0, 1), target=(0, 0, 1), distance=0.5)
    other = drawn(tmp_path / "b.png", [far], direction=(0, 0, 1), target=target, distance=256)
    assert np.abs(near - other).mean() < 1
    assert (near[:100].min(axis=2) < 250).all()


@pytest.mark.parametrize(
    ("style", "message"),
    [
        ({"values": "beauty"}, "values is 'beauty'; it must be one of"),
        ({"values": "normal-error"}, "compares a mesh with another one"),
        ({"limits": (2.0, 1.0)}, "limits is"),
        ({"crops": [(0.9, 0.5, 0.4)]}, "crop is"),
        ({"distance": -1.0}, "distance is"),
    ],
)
def test_senseless_styles_are_refused(style, message, tmp_path):
    with pytest.raises(ParameterError, match=message):
        draw([BALL], tmp_path / "a.png", Style(**style))


def test_names_of_other_kinds_are_refused(tmp_path):
    with pytest.raises(OutputError, match=r"give a name that ends in \.png, \.webp, \.svg, \.pdf"):
        draw([BALL], tmp_path / "a.gif")
    with pytest.raises(OutputError, match=r"ends in \.webp, \.mp4"):
        draw([BALL], tmp_path / "a.gif", turntable=True)


def test_a_picture_of_the_command_line_has_all_of_it(tmp_path, capsys):
    for name, mesh in (("a.ply", ROUGH), ("b.ply", BALL)):
        save_mesh(tmp_path / name, mesh)
    command = ["render", str(tmp_path / "a.ply"), str(tmp_path / "b.ply"), "-o", str(tmp_path / "x.png")]
    more = ["--size", "64", "--view", "30,20", "--up", "z", "--values", "distance", "--limits", "0,0.1", "--crop"]
    assert run([*command, *more, "0.5,0.5,0.3", "--smooth", "--wireframe", "--transparent"]) == 0
    assert decoded_size(tmp_path / "x.png") > (2 * 64, 2 * 64)
    assert run([*command, "--up", "w"]) == 2 and run([*command, "--crop", "0.5,0.5"]) == 2
    assert run(command[:-2]) == 2 and "nothing to write" in capsys.readouterr().err


def decoded_size(path):
    with PIL.Image.open(path) as image:
        return image.size
