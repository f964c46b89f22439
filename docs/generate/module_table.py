"""Write the table of packages in docs/architecture.md: python docs/generate/module_table.py

Summaries are the first sentences of docstrings. A room is a folder or a single module of the package; rooms are listed
in an order in which each imports only earlier ones. The build of the site writes the table of all modules.
"""

import ast
import re
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

from markdown_table import table

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "architecture.md"
BEGIN, END = "<!-- packages: written by docs/generate/module_table.py -->", "<!-- end of packages -->"
INTRODUCTION = """\
# Modules

Every module with the first sentence of its docstring. [Architecture](../architecture.md) describes how they work
together. Each package imports only those above it.
"""


def main() -> None:
    """Replace the table in the page."""
    PAGE.write_text(renewed(PAGE.read_text(encoding="utf-8")), encoding="utf-8", newline="\n")


def renewed(page: str) -> str:
    """Return the page with the table as the code has it now."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n\n{package_table(modules())}\n{END}{after}"


def modules() -> dict[str, Path]:
    """Return the files of all modules by their names within the package; a folder has the name of its `__init__`."""
    found = {}
    for folder in (ROOT / "cascadenorm", ROOT / "baselines", ROOT / "data_gen"):
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder if folder.name == "cascadenorm" else ROOT).with_suffix("").parts
            if parts not in {("__init__",), ("__main__",)}:
                found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def package_table(found: dict[str, Path]) -> str:
    """Return a row for each room."""
    return table(("package", "holds"), [(f"`{place(found[room])}`", summary(found[room])) for room in rooms(found)])


def module_page() -> str:
    """Return a page with a section for each room and a row for each of its modules."""
    found = modules()
    parts = [INTRODUCTION]
    for room in rooms(found):
        parts.append(f"## `{place(found[room])}`\n\n{summary(found[room])}\n")
        names = sorted(name for name in found if name.startswith(f"{room}."))
        rows = [(f"`{name.partition('.')[2]}`", summary(found[name])) for name in names]
        parts += [table(("module", "holds"), rows)] if rows else []
    return "\n".join(parts)


def rooms(found: dict[str, Path]) -> list[str]:
    """Return the rooms in an order in which each imports only earlier ones."""
    imports = {name.partition(".")[0]: set[str]() for name in found}
    for name, path in found.items():
        imports[name.partition(".")[0]] |= imported(path) - {name.partition(".")[0]}
    return in_order(imports)


def place(path: Path) -> str:
    """Return the path of a module or package within the repository."""
    where = path.relative_to(ROOT).as_posix()
    return where.removesuffix("__init__.py")


def in_order(imports: dict[str, set[str]]) -> list[str]:
    """Return the rooms from those that import nothing upward; of rooms at one height, by name."""
    height: dict[str, int] = {}
    for room in TopologicalSorter(imports).static_order():
        height[room] = 1 + max((height[below] for below in imports[room]), default=0)
    return sorted(height, key=lambda room: (height[room], room))


@cache
def imported(path: Path) -> set[str]:
    """Return the rooms that a module imports."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {name.split(".")[1] for name in names if name.startswith("cascadenorm.")}


def summary(path: Path) -> str:
    """Return the first sentence of a module's docstring, as a cell of a table."""
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    first = re.sub(r"\s+", " ", text.split("\n\n")[0])
    return re.split(r"(?<=[.!?])\s+(?=[A-Z`])", first)[0]


if __name__ == "__main__":
    main()
