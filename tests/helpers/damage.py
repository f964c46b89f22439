"""Files and meshes as mean as can be, made from random numbers."""

import io
import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from shapes import cube, grid, icosphere

WORDS = (
    b"nan",
    b"-inf",
    b"-1",
    b"0",
    b"1e400",
    b"-1e308",
    b"4e-320",
    b"0.1",
    b"255",
    b"65536",
    b"2147483648",
    b"4294967295",
    b"999999999999",
    b"9223372036854775808",
    b"1" * 400,
    b"1_0",
    b"0x1F",
    b"",
    b"{}",
    b'"',
    b"\xff\xfe",
)
"""What numbers of a text are replaced by."""

RAW = [
    np.array(value, kind).tobytes()
    for kind, values in {
        "u1": (0, 255),
        "<i4": (-1, 2**31 - 1, -(2**31)),
        ">i4": (1, 2**31 - 1),
        "<u4": (2**32 - 1, 10**9),
        "<f4": (np.nan, np.inf, 3e38, 1e-45),
        "<f8": (np.nan, -np.inf, 1e308, 5e-324),
    }.items()
    for value in values
]
"""What bytes are replaced by."""

Generator = np.random.Generator


def damaged(data: bytes, others: Sequence[bytes], rng: Generator) -> bytes:
    """Return a file with one to four kinds of damage; others are files to take pieces from."""
    for _ in range(rng.integers(1, 5)):
        data = DAMAGES[rng.integers(len(DAMAGES))](data, others, rng)
    return data


def _flipped(data: bytes, others: Sequence[bytes], rng: Generator) -> bytes:
    content = bytearray(data)
    for _ in range(min(len(data), rng.integers(1, 9))):
        content[rng.integers(len(data))] ^= 1 << rng.integers(8)
    return bytes(content)


def _truncated(data: bytes, others: Sequence[bytes], rng: Generator) -> bytes:
    return data[: rng.integers(len(data) + 1)]


def _span(data: bytes, rng: Generator) -> tuple[int, int]:
    begin = int(rng.integers(len(data) + 1))
    return begin, min(begin + int(2 ** rng.uniform(0, 8)), len(data))


def _without_span(data: bytes, others: Sequence[bytes], rng: Generator) -> bytes:
    begin, end = _span(data, rng)
    return data[:begin] + data[end:]


def _with_span_twice(data: bytes, others: Sequence[bytes], rng: Generator) -> bytes:
    begin, end = _span(data, rng)
    return data[:end] + data[begin:]


def _with_span_of_another(data: bytes, others: Sequence[bytes], rng: Generator) -> bytes:
    other = others[rng.integers(len(others))]
    begin, end = _span(other, rng)
    at, stop = _span(data, rng)
    return data[:at] + other[begin:end] + data[stop:]


def _with_other_number(data: bytes, others: Sequence[bytes], rng: Generator) -> bytes:
    numbers = list(re.finditer(rb"-?\d+(\.\d*)?(e-?\d+)?", data))
    if not numbers:
        return data
    begin, end = numbers[rng.integers(len(numbers))].span()
    return data[:begin] + WORDS[rng.integers(len(WORDS))] + data[end:]


def _with_other_bytes(data: bytes, others: Sequence[bytes], rng: Generator) -> bytes:
    raw = RAW[rng.integers(len(RAW))]
    at = int(rng.integers(len(data) + 1))
    return data[:at] + raw + data[at + len(raw) :]


def _with_lines_swapped(data: bytes, others: Sequence[bytes], rng: Generator) -> bytes:
    lines = data.split(b"\n")
    a, b = rng.integers(len(lines), size=2)
    lines[a], lines[b] = lines[b], lines[a]
    return b"\n".join(lines)


DAMAGES: list[Callable[[bytes, Sequence[bytes], Generator], bytes]] = [
    _flipped,
    _truncated,
    _without_span,
    _with_span_twice,
    _with_span_of_another,
    _with_other_number,
    _with_other_bytes,
    _with_lines_swapped,
]


class Arrays(NamedTuple):
    """A mesh that nobody has checked."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]


def adversarial_mesh(rng: Generator) -> Arrays:
    """Return a small mesh, finite and with indices in range, in which everything else may be wrong."""
    shape = rng.integers(4)
    if shape == 0:
        count = int(rng.integers(1, 40))
        vertices = rng.normal(size=(count, 3))
        faces = rng.integers(count, size=(rng.integers(1, 60), 3))
    else:
        mesh = (icosphere(1), grid(4, 5), cube(2))[shape - 1]
        vertices, faces = mesh.vertices + rng.normal(size=mesh.vertices.shape) * rng.choice([0, 0.05, 0.5]), mesh.faces
    faces = faces.astype(np.int64)
    for _ in range(rng.integers(4)):
        vertices, faces = SPOILT[rng.integers(len(SPOILT))](vertices, faces, rng)
    return Arrays(PLACED[rng.integers(len(PLACED))](vertices, rng), faces)


def _with_repeated_corners(vertices, faces, rng):
    faces = faces.copy()
    chosen = rng.random(len(faces)) < 0.2
    faces[chosen, 1] = faces[chosen, 0]
    return vertices, faces


def _with_repeated_faces(vertices, faces, rng):
    again = faces[rng.integers(len(faces), size=rng.integers(1, 10))]
    return vertices, np.concatenate([faces, np.roll(again, 1, axis=1)])


def _with_flipped_faces(vertices, faces, rng):
    flipped = rng.random(len(faces)) < 0.3
    return vertices, np.where(flipped[:, None], faces[:, ::-1], faces)


def _with_fins(vertices, faces, rng):
    fins = faces[rng.integers(len(faces), size=rng.integers(1, 5))].copy()
    fins[:, 2] = rng.integers(len(vertices), size=len(fins))
    return vertices, np.concatenate([faces, fins])


def _with_places_shared(vertices, faces, rng):
    vertices = vertices.copy()
    chosen = rng.random(len(vertices)) < 0.2
    vertices[chosen] = vertices[rng.integers(len(vertices))]
    return vertices, faces


def _with_a_spike(vertices, faces, rng):
    vertices = vertices.copy()
    vertices[rng.integers(len(vertices))] *= 10.0 ** rng.integers(1, 100)
    return vertices, faces


def _flattened(vertices, faces, rng):
    vertices = vertices.copy()
    vertices[:, : rng.integers(1, 4)] = 0  # a plane, a line, a point
    return vertices, faces


def _as_soup(vertices, faces, rng):
    return vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)


def _with_loose_vertices(vertices, faces, rng):
    loose = rng.normal(size=(rng.integers(1, 5), 3)) * 10.0 ** rng.integers(-5, 200)
    return np.concatenate([loose, vertices]), faces + len(loose)


def _with_few_faces(vertices, faces, rng):
    return vertices, faces[: rng.integers(1, 4)]


SPOILT = [
    _with_repeated_corners,
    _with_repeated_faces,
    _with_flipped_faces,
    _with_fins,
    _with_places_shared,
    _with_a_spike,
    _flattened,
    _as_soup,
    _with_loose_vertices,
    _with_few_faces,
]

PLACED = [
    lambda vertices, rng: vertices,
    lambda vertices, rng: vertices,
    lambda vertices, rng: vertices + np.array((5e6, 6e5, 100)),
    lambda vertices, rng: _scaled(vertices, 10.0 ** rng.uniform(-150, 150)),
    lambda vertices, rng: _scaled(vertices, 10.0 ** rng.choice([-320, -300, 300])),
    lambda vertices, rng: np.round(vertices * 2),
    lambda vertices, rng: np.clip(vertices, -1e38, 1e38).astype(np.float32).astype(float),
]


def _scaled(vertices, factor):
    largest = np.abs(vertices).max()
    return vertices * factor if largest < 1e5 else vertices / largest * 1e5


def read_damaged(
    format: str,
    data: bytes,
    rng: Generator,
    others: Sequence[bytes],
    packed: Callable[[bytes], bytes] = bytes,
) -> str:
    """Damage a file, read it, weld, move and write; what came of it: 'read' or our own error.

    What is damaged is the content of an archive where `packed` puts it into one.

    Raises
    ------
    AssertionError : a promise is broken
    """
    import cascadenorm as cn

    content = packed(damaged(data, others, rng))
    try:
        file = cn.read(io.BytesIO(content), format if rng.random() < 0.8 else None)
        assert b"".join(file.pieces()) == content, "unmoved, but not as it was"
        moved = file.with_vertices(file.mesh.vertices + 1)
        again = cn.read(io.BytesIO(b"".join(moved.pieces())), file.format)
        expected = moved.positions.astype(
            again.positions.dtype
        )  # a PLY text with few digits is read as single precision
        assert np.array_equal(again.positions, expected), "moved, but not read back so"
        assert np.array_equal(again.polygons.corners, file.polygons.corners), "faces have changed"
        moved.content()
    except (cn.ReadError, cn.MeshError) as error:
        assert len(str(error)) < 1000, "an endless message"
        return str(error)
    return "read"


def denoised(rng: Generator) -> str:
    """Denoise a malformed mesh by a random method under random controls; what came of it: 'done' or our own error.

    Raises
    ------
    AssertionError : a promise is broken
    """
    import cascadenorm as cn
    from cascadenorm.mesh import bad_faces

    mesh = adversarial_mesh(rng)
    count = len(mesh.vertices)
    method = str(rng.choice(sorted(cn.methods())))
    settings = {"method": method, "strength": float(rng.choice([0, 0.3, 1, 1, 1, 2.5]))}
    fixed = np.zeros(count, bool)
    if rng.random() < 0.3:
        settings["mask"] = rng.choice([0, 0.5, 1], count)
        fixed |= settings["mask"] == 0
    if rng.random() < 0.3:
        settings["fixed"] = rng.random(count) < 0.2
        fixed |= settings["fixed"]
    if rng.random() < 0.3:
        settings["max_displacement"] = str(rng.choice(["0.5 edges", "0", "1e-3", "1e300"]))
    if rng.random() < 0.3:
        settings["only"] = rng.random(len(mesh.faces)) < 0.7
    for name, choices in (
        ("boundary", ["smooth", "fixed"]),
        ("creases", [0.0, 30.0, 180.0]),
        ("keep_detail", ["0 edges", "3 edges", "1e-300", "inf"]),
        ("remove_detail", ["0 edges", "3 edges", "1e-300", "inf"]),
        ("volume", ["keep"]),
        ("on_bad", ["isolate"]),
    ):
        if rng.random() < 0.2:
            settings[name] = rng.choice(choices).item()
    if "only" in settings:
        holding = ~settings["only"]
        if "on_bad" in settings:
            holding &= ~bad_faces(*mesh)
        fixed[mesh.faces[holding]] = True
    for name in cn.methods()[method].settings:
        if "iterations" in name or name in ("steps", "passes"):
            settings[name] = int(rng.integers(1, 4))
    before = mesh.vertices.copy()
    try:
        after = cn.denoise(*mesh, **settings)
    except (cn.MeshError, cn.ParameterError, cn.DenoiseError) as error:
        return f"{method}: {error}"
    assert np.array_equal(mesh.vertices, before), f"{method} changed its input"
    assert after.shape == before.shape and after.dtype == before.dtype, f"{method}: shape"
    assert np.isfinite(after).all(), f"{method}: not finite"
    assert np.array_equal(after[fixed], before[fixed]), f"{method}: fixed vertices moved"
    used = np.isin(np.arange(count), mesh.faces)
    assert np.array_equal(after[~used], before[~used]), f"{method}: unused vertices moved"
    if settings["strength"] == 0:
        assert np.array_equal(after, before), f"{method}: moved at strength 0"
    return "done"
