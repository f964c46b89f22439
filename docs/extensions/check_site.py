"""Check a built site: every internal link has a target, and no page loads anything from the network.

    python docs/extensions/check_site.py build/site

Links to other sites must begin with https://; `sphinx -b linkcheck` tests whether they exist.
"""

import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src", "video": "src"}
"""Elements that make the browser load an address, and the attribute that holds it."""


class Page(HTMLParser):
    """The anchors, the links and the loaded addresses of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        self.anchors |= {values[name] for name in ("id", "name") if name in values}
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        elif tag in LOADED and LOADED[tag] in values:
            self.loads.append(values[LOADED[tag]])


@cache
def read(path: Path) -> Page:
    return Page(path.read_text(encoding="utf-8"))


def faults(site: Path) -> list[str]:
    """Return one line for each fault of the site."""
    found = []
    for path in sorted(site.rglob("*.html")):
        if "_static" in path.parts:  # templates of the theme
            continue
        page, name = read(path), path.relative_to(site)
        for address in page.loads:
            if urlsplit(address).scheme not in ("", "data") or address.startswith("//"):
                found.append(f"{name}: loads {address}, which is elsewhere")
            elif not urlsplit(address).scheme and not target(path, address).exists():
                found.append(f"{name}: loads {address}, which does not exist")
        for address in page.links:
            parts = urlsplit(address)
            if parts.scheme:
                if parts.scheme not in ("https", "mailto"):
                    found.append(f"{name}: links to {address}; write https://")
                continue
            there = target(path, address)
            if not there.exists():
                found.append(f"{name}: links to {address}, which does not exist")
            elif parts.fragment and there.suffix == ".html" and unquote(parts.fragment) not in read(there).anchors:
                found.append(f"{name}: links to {address}, but there is no such heading")
    return found


def target(page: Path, address: str) -> Path:
    """Return the file that a relative address on a page refers to."""
    name = unquote(urlsplit(address).path)
    return (page.parent / name).resolve() if name else page


def main() -> None:
    """Print the faults of a site; exit with 1 if there are any."""
    site = Path(sys.argv[1]).resolve()
    found = faults(site)
    print("\n".join(found) if found else f"{len(list(site.rglob('*.html')))} pages: every link leads somewhere")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
