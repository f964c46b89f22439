"""Write the table of modules in docs/architecture.md: python docs/generate/module_table.py

What a module holds is the first sentence of its docstring. Rooms, which are the folders and single modules of the
package, stand in an order in which each imports only earlier ones.
"""

import ast
import re
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "architecture.md"
BEGIN, END = "<!-- modules: docs/generate/module_table.py writes them -->", "<!-- end of modules -->"


def main() -> None:
    """Replace the table in the page."""
    PAGE.write_text(renewed(PAGE.read_text(encoding="utf-8")), encoding="utf-8", newline="\n")


def renewed(page: str) -> str:
    """Return the page with the table as the code has it now."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n\n{table(modules())}\n{END}{after}"


def modules() -> dict[str, Path]:
    """Return the files of all modules by their names within the package; a folder has the name of its `__init__`."""
    found = {}
    for folder in (ROOT / "cascadenorm", ROOT / "baselines", ROOT / "data_gen"):
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder if folder.name == "cascadenorm" else ROOT).with_suffix("").parts
            if parts not in {("__init__",), ("__main__",)}:
                found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def table(found: dict[str, Path]) -> str:
    """Return a row for each module, below a row for its room, with what that imports."""
    rooms: dict[str, list[str]] = {}
    for name in found:
        rooms.setdefault(name.partition(".")[0], []).append(name)
    imports = {room: set().union(*(imported(found[name]) for name in names)) - {room} for room, names in rooms.items()}
    lines = ["| module | holds |", "| --- | --- |"]
    for room in in_order(imports):
        place = found[room].relative_to(ROOT).as_posix().removesuffix("/__init__.py")
        below = f" Imports {', '.join(sorted(imports[room]))}." if imports[room] else " Imports nothing of the package."
        lines.append(
            f"| **`{place}{'/' if found[room].stem == '__init__' else ''}`** | {summary(found[room])}{below} |"
        )
        lines += [
            f"| `{name.partition('.')[2]}` | {summary(found[name])} |" for name in sorted(rooms[room]) if name != room
        ]
    return "\n".join(lines) + "\n"


def in_order(imports: dict[str, set[str]]) -> list[str]:
    """Return the rooms from those that import nothing upward; of rooms at one height, by name."""
    height: dict[str, int] = {}
    for room in TopologicalSorter(imports).static_order():
        height[room] = 1 + max((height[below] for below in imports[room]), default=0)
    return sorted(height, key=lambda room: (height[room], room))


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
    sentence = re.split(r"(?<=[.!?])\s+(?=[A-Z`])", first)[0]
    return sentence.replace("|", "\\|")


if __name__ == "__main__":
    main()
