"""A page for each method with its formula, source, limits and parameters from the registry, and pictures of results."""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from markdown_table import table

import cascadenorm as cn
from cascadenorm.data_gen.meshing.surface import extent_of
from cascadenorm.data_gen.meshing.tessellation import tessellate
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.data_gen.scanning.views import scanned_view
from cascadenorm.data_gen.shapes import fields, organic
from cascadenorm.mesh import Mesh
from cascadenorm.registry import Method, Setting, by_family
from cascadenorm.render import Panel, montage, pixels, render, webp

SIZE, SMALL = 320, 150
"""Width and height of a picture on a method's page and on the list of methods, in pixels."""
INDEX = """\
# All methods

All methods share one interface: `cascadenorm denoise scan.ply --method NAME`, or `cn.denoise(mesh, method="NAME")`.
Each page has the formula, the source, the limits and the parameters of one method, and shows its results on three
shapes with default settings. [How to choose](../../how-to/index.md#choose-a-method) compares the methods, and
[the theory](../theory/index.rst) explains them in order.
"""


class Example(NamedTuple):
    """A noisy mesh and its clean version."""

    noisy: Mesh
    clean: Mesh


@cache
def examples() -> dict[str, Example]:
    """The shapes that every method is seen on: a cube and a statue with Gaussian noise, and the scan of a camera."""
    edges, skin, sheet = (np.random.default_rng(seed) for seed in (1, 4, 2))
    box, bust, head = fields.box([0.7, 0.7, 0.7]), organic.bust(0.03, skin), organic.bust(0.03, sheet)
    cube = tessellate(box, extent_of(box, rng=edges), faces=5000, sharp=True, tessellation="even", rng=edges)
    statue = tessellate(bust, extent_of(bust, rng=skin), faces=8000, sharp=False, tessellation="even", rng=skin)
    scan = scanned_view(head, extent_of(head, rng=sheet), faces=8000, rng=sheet)
    return {
        "cube": _disturbed(cube, "gaussian", 0.25, edges),
        "statue": _disturbed(statue, "gaussian", 0.2, skin),
        "scan": _disturbed(scan, "sensor", 0.3, sheet),
    }


def _disturbed(clean: Mesh, kind: str, level: float, rng: np.random.Generator) -> Example:
    moves = displacements(clean, kind, level=level, rng=rng)  # type: ignore[arg-type]
    return Example(clean.moved(clean.vertices + moves), clean)


def write_pages(folder: Path) -> None:
    """Write the list of methods, the page of each, and the pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    known = cn.methods()
    parts = [INDEX]
    for family, members in by_family().items():
        rows = []
        for name in (one.name for one in members):
            results = {shape: _denoised(known[name], example) for shape, example in examples().items()}
            (folder / f"{name}.webp").write_bytes(_picture(results, SIZE))
            (folder / f"{name}-small.webp").write_bytes(_small(results))
            (folder / f"{name}.md").write_text(method_page(known[name], results), encoding="utf-8")
            rows.append((f"[{name}]({name}.md)", known[name].summary, f"![]({name}-small.webp)"))
        parts += [f"## {family.title}\n\n{family.about}\n", table(("method", "what it does", "cube and statue"), rows)]
    every = "\n".join(one.name for members in by_family().values() for one in members)
    parts.append(f"```{{toctree}}\n:hidden:\n\n{every}\n```\n")
    (folder / "index.md").write_text("\n".join(parts), encoding="utf-8")


def _denoised(method: Method, example: Example) -> Mesh:
    """Apply a method at its defaults; one that needs a region replaces a disk of the surface."""
    noisy = example.noisy
    if method.name != "fairing":
        return cn.denoise(noisy, method=method.name)
    top = noisy.vertices[np.argmax(noisy.vertices @ [0.4, 0.5, 0.8])]
    near = np.linalg.norm(noisy.vertices - top, axis=1) < 0.25 * noisy.diagonal
    return cn.denoise(noisy, method=method.name, mask=near)


def _picture(results: Mapping[str, Mesh], size: int) -> bytes:
    """The noisy shapes above their denoised versions."""
    rows = [[example.noisy for example in examples().values()], list(results.values())]
    return _drawn(rows, size)


def _small(results: Mapping[str, Mesh]) -> bytes:
    return _drawn([[results[shape] for shape in ("cube", "statue")]], SMALL)


def _drawn(rows: Sequence[Sequence[Mesh]], size: int) -> bytes:
    panels = [[Panel(render(mesh, size=(size, size), transparent=True)) for mesh in row] for row in rows]
    return webp(pixels(montage(panels), transparent=True))


def method_page(method: Method, results: Mapping[str, Mesh]) -> str:
    """Return the page of a method, as Markdown."""
    _, *more = method.section("").split("\n", 1)
    errors = [
        (title, *(f"{cn.compare(mesh, examples()[shape].clean).normal_error_deg:.1f}°" for shape, mesh in row.items()))
        for title, row in (("noisy", {shape: one.noisy for shape, one in examples().items()}), (method.name, results))
    ]
    return "\n".join(
        [
            f"# {method.name}\n\n{method.summary}\n\n**Source:** {method.source}\n",
            f":::{{image}} {method.name}.webp\n:alt: A cube, a statue and a scan: noisy above, {method.name} below\n"
            ":class: dark-light\n:::\n",
            "The picture shows the noisy meshes above and the results with default settings below. The table shows\n"
            "the mean angle between the face normals and the true ones:\n",
            table(("", *results), errors),
            f"## Formula\n\n```text\n{method.section('Formula')}\n```\n",
            *(text.strip() + "\n" for text in more),
            f"## Limits\n\n{method.section('Limits')}\n",
            f"## Parameters\n\n{_parameters(method)}",
            f"## Use\n\n{_use(method)}",
        ]
    )


def _parameters(method: Method) -> str:
    rows = [
        (f"`{one.name}`", one.about.help, f"`{one.default}`", one.about.unit, allowed(one))
        for one in method.given_by_name
    ]
    if not rows:
        return "This method has no parameters.\n"
    return table(("parameter", "meaning", "default", "unit", "allowed"), rows) + (
        "\nStrength, masks, creases, boundaries and limits are [controls](../../controls.md) of every method.\n"
    )


def allowed(setting: Setting) -> str:
    """Return the allowed values of a parameter as text."""
    return ", ".join(f"`{choice}`" for choice in setting.choices) or setting.about.allowed


def _use(method: Method) -> str:
    if method.name == "fairing":
        return (
            "```bash\ncascadenorm denoise scan.ply --method fairing --mask dent.npy\n```\n\n"
            '```python\ncn.denoise(mesh, method="fairing", mask=dent)  # (n,) bool, the vertices to replace\n```\n'
        )
    example = next((one for one in method.given_by_name if isinstance(one.default, int | float)), None)
    option = f" --set {example.name}={example.default}" if example else ""
    keyword = f", {example.name}={example.default}" if example else ""
    return (
        f"```bash\ncascadenorm denoise scan.ply --method {method.name}{option}\n```\n\n"
        f'```python\ncn.denoise(mesh, method="{method.name}"{keyword})\n```\n'
    )
