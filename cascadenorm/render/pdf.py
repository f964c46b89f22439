"""Figures as PDF: pictures as pixels, text in the embedded font, frames as lines."""

import zlib
from collections.abc import Iterable

from cascadenorm.render.color import INK, Image
from cascadenorm.render.figure import DPI, Figure, Frame, Picture, Text
from cascadenorm.render.pillow import CAPITALS, font_file, printable, text_length

FIRST, LAST = 32, 255
"""Characters that the font is asked for, as Windows code page 1252 numbers them."""


def pdf(figure: Figure) -> bytes:
    """Return a figure as a PDF file (ISO 32000) of one page, of DPI pixels an inch, on no paper.

    Raises
    ------
    MissingDependencyError
        Pillow is not installed.
    """
    pictures = [item.image for item in figure.items if isinstance(item, Picture)]
    scale = 72 / DPI
    objects: list[bytes] = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        b"",  # the page, when the numbers of its pictures are known
        _stream(_drawn(figure).encode("cp1252", "replace")),
        *_font(first=5),
    ]
    names = []
    for number, image in enumerate(pictures):
        names.append(f"/I{number} {len(objects) + 1} 0 R")
        objects += _image(image, first=len(objects) + 1)
    box = f"[0 0 {figure.width * scale:g} {figure.height * scale:g}]"
    resources = f"<< /Font << /F 5 0 R >> /XObject << {' '.join(names)} >> >>"
    page = f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R /Resources {resources} >>"
    objects[2] = page.encode()
    return _file(objects)


def _drawn(figure: Figure) -> str:
    """Return the instructions that draw the items; one pixel is one unit, and y runs upward."""
    lines = [f"{72 / DPI:g} 0 0 {72 / DPI:g} 0 0 cm"]
    pictures = 0
    for item in figure.items:
        if isinstance(item, Picture):
            height, width, _ = item.image.shape
            bottom = figure.height - item.top - height
            lines.append(f"q {width} 0 0 {height} {item.left} {bottom} cm /I{pictures} Do Q")
            pictures += 1
        elif isinstance(item, Frame):
            bottom = figure.height - item.top - item.height
            color = " ".join(f"{part:g}" for part in item.color)
            lines.append(f"{color} RG {item.line:g} w {item.left:g} {bottom:g} {item.width:g} {item.height:g} re S")
        else:
            lines.append(_text(item, figure.height))
    return "\n".join(lines)


def _text(item: Text, height: int) -> str:
    line = printable(item.text)
    before = 0.0 if item.begins else text_length(line, size=item.size) / 2
    below = item.size / 2
    x, y = (item.x + below, height - item.y - before) if item.upward else (item.x - before, height - item.y - below)
    turn = "0 1 -1 0" if item.upward else "1 0 0 1"
    quoted = line.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
    color = " ".join(f"{part:g}" for part in INK)
    return f"BT {color} rg /F {item.size / CAPITALS:.4g} Tf {turn} {x:.4g} {y:.4g} Tm ({quoted}) Tj ET"


def _font(*, first: int) -> list[bytes]:
    """The font, its description and its file, numbered from `first`."""
    letters = [bytes([code]).decode("cp1252", "replace") for code in range(FIRST, LAST + 1)]
    widths = " ".join(f"{1000 * CAPITALS * text_length(letter, size=1):.0f}" for letter in letters)
    name = "/Aileron-Regular"
    font = (
        f"<< /Type /Font /Subtype /TrueType /BaseFont {name} /Encoding /WinAnsiEncoding /FirstChar {FIRST} "
        f"/LastChar {LAST} /Widths [{widths}] /FontDescriptor {first + 1} 0 R >>"
    )
    about = (
        f"<< /Type /FontDescriptor /FontName {name} /Flags 32 /FontBBox [-200 -250 1200 1000] /ItalicAngle 0 "
        f"/Ascent 950 /Descent -250 /CapHeight 700 /StemV 80 /FontFile2 {first + 2} 0 R >>"
    )
    file = font_file()
    return [font.encode(), about.encode(), _stream(file, f"/Length1 {len(file)}")]


def _image(image: Image, *, first: int) -> Iterable[bytes]:
    """The pixels, and where there is one the mask of the coverage, numbered from `first`."""
    height, width, channels = image.shape
    about = f"/Type /XObject /Subtype /Image /Width {width} /Height {height} /BitsPerComponent 8 /ColorSpace"
    mask = f" /SMask {first + 1} 0 R" if channels == 4 else ""
    yield _stream(image[..., :3].tobytes(), f"{about} /DeviceRGB{mask}")
    if channels == 4:
        yield _stream(image[..., 3].tobytes(), f"{about} /DeviceGray")


def _stream(data: bytes, about: str = "") -> bytes:
    packed = zlib.compress(data, 6)
    head = f"<< {about} /Filter /FlateDecode /Length {len(packed)} >>\nstream\n"
    return head.encode() + packed + b"\nendstream"


def _file(objects: Iterable[bytes]) -> bytes:
    """Number the objects, and list where each begins."""
    out, places = bytearray(b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n"), []
    for number, content in enumerate(objects, start=1):
        places.append(len(out))
        out += f"{number} 0 obj\n".encode() + content + b"\nendobj\n"
    start = len(out)
    out += f"xref\n0 {len(places) + 1}\n0000000000 65535 f \n".encode()
    out += b"".join(f"{place:010d} 00000 n \n".encode() for place in places)
    out += f"trailer\n<< /Size {len(places) + 1} /Root 1 0 R >>\nstartxref\n{start}\n%%EOF\n".encode()
    return bytes(out)
