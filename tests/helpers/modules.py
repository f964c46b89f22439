"""The modules of the package."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDERS = {"cascadenorm": ROOT / "cascadenorm", "baselines": ROOT / "baselines", "data_gen": ROOT / "data_gen"}


def modules() -> dict[str, Path]:
    """Every module of the package by its name without the package's."""
    found = {}
    for name, folder in FOLDERS.items():
        for path in sorted(folder.rglob("*.py")):
            inside = path.relative_to(folder).with_suffix("").parts
            parts = inside if name == "cascadenorm" else (name, *inside)
            parts = parts[:-1] if parts[-1] == "__init__" else parts
            if parts and parts != ("__main__",):
                found[".".join(parts)] = path
    return found


MODULES = modules()
