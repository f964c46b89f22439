"""The tables of docs/controls.md, made from the declaration of the controls: python docs/generate/control_tables.py"""

import re
import shlex
from pathlib import Path

from cascadenorm.registry.controls import CONTROLS, ControlSetting

PAGE = Path(__file__).parents[1] / "controls.md"


def main() -> None:
    """Write the tables between their markers."""
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


def with_tables(page: str) -> str:
    """Return the page with new tables between its markers."""
    for name, table in (("controls", controls_table()), ("values", values_table())):
        page, count = re.subn(
            rf"(<!-- {name}: begin -->\n).*?(<!-- {name}: end -->)",
            lambda found, table=table: f"{found[1]}{table}{found[2]}",  # type: ignore[misc]
            page,
            flags=re.DOTALL,
        )
        if count != 1:
            raise SystemExit(f"{PAGE} needs the markers of {name} once")
    return page


def controls_table() -> str:
    """Every control: an example in Python and on the command line, what it does, its default."""
    rows = [
        (_in_python(setting), _on_the_command_line(setting), setting.about.help, _default(setting))
        for setting in CONTROLS.values()
    ]
    return _table(("Python", "command line", "what it does", "default"), rows)


def values_table() -> str:
    """The controls that take more than a number or a choice: what they take as arrays, and for a mesh file."""
    rows = [
        (f"`{setting.name}`", setting.about.arrays, setting.about.words)
        for setting in CONTROLS.values()
        if setting.about.arrays
    ]
    return _table(("", "in Python", "for a mesh file, in Python and on the command line"), rows)


def _in_python(setting: ControlSetting) -> str:
    example = setting.about.metavar if setting.about.hidden else repr(setting.about.example)
    return f"`{setting.name}={example}`".replace("'", '"')


def _on_the_command_line(setting: ControlSetting) -> str:
    if setting.about.hidden:
        return ""
    value = "" if setting.about.flag else f" {shlex.quote(str(setting.about.example))}"
    return f"`{setting.option}{value}`".replace("'", '"')


def _default(setting: ControlSetting) -> str:
    return "" if setting.default is None else f"`{setting.default!r}`".replace("'", '"')


def _table(titles: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [titles, tuple("---" for _ in titles), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


if __name__ == "__main__":
    main()
