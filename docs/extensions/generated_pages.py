"""Pages that the build writes: methods, model cards, modules."""

from pathlib import Path
from typing import Any

from card_pages import card_page
from method_pages import write_pages
from module_table import module_page

FOLDER = Path(__file__).parents[1] / "generated"


def write(app: Any) -> None:
    """Write the pages into docs/generated."""
    FOLDER.mkdir(exist_ok=True)
    for name, page in (("model-cards.md", card_page()), ("modules.md", module_page())):
        (FOLDER / name).write_text(page, encoding="utf-8")
    write_pages(FOLDER / "methods")


def redirect(app: Any, error: Exception | None) -> None:
    """Redirect the root of the site to the first page, which is in a subfolder."""
    page = (
        f'<meta http-equiv="refresh" content="0; url={app.config.root_doc}.html"><title>{app.config.project}</title>\n'
    )
    (Path(app.outdir) / "index.html").write_text(page, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    app.connect("builder-inited", write, priority=100)  # before sources are read
    app.connect("build-finished", redirect)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
