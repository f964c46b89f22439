"""Check a built site: every internal link has a target, and no page loads anything from the network.

    python docs/extensions/check_site.py build/site

Addresses elsewhere must begin with https://; whether they answer is asked by `sphinx -b linkcheck`.
"""

import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src", "video": "src"}
"""Elements whose address the browser reads by itself."""


class Page(HTMLParser):
    """The anchors of a page, what it links to, and what it loads."""

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
    """Return what is wrong, a line each."""
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
    """The file that a relative address on a page stands for."""
    name = unquote(urlsplit(address).path)
    return (page.parent / name).resolve() if name else page


def main() -> None:
    """Print what is wrong with the site that is named; exit with 1 if anything is."""
    site = Path(sys.argv[1]).resolve()
    found = faults(site)
    print("\n".join(found) if found else f"{len(list(site.rglob('*.html')))} pages: every link leads somewhere")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
