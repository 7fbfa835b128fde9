"""Check the built site: every link leads somewhere, nothing is loaded from a network, every page
can be reached.

`python docs/site/check.py build/docs` ends with exit code 1 and a line for each fault.
"""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = {"script", "img", "iframe", "source", "link", "audio", "video", "object", "embed"}
"""Elements whose address a browser loads by itself."""
MADE_BY_SPHINX = {"genindex.html", "py-modindex.html", "search.html"}


class Page(HTMLParser):
    """The addresses and the anchors of one page."""

    def __init__(self, text):
        super().__init__()
        self.links, self.loaded, self.anchors, self.broken_equations = [], [], set(), 0
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        """Take up the addresses of one element."""
        given = dict(attributes)
        self.anchors.update(given[name] for name in ("id", "name") if given.get(name))
        self.broken_equations += tag == "merror"
        for name in ("href", "src", "data"):
            if address := given.get(name):
                (self.loaded if tag in LOADED else self.links).append(address)


def faults(folder):
    """What is wrong with the site in a folder, a line each."""
    pages = {
        path: Page(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.html"))
    }
    reached = {folder / "index.html", *(folder / name for name in MADE_BY_SPHINX)}
    for path, page in pages.items():
        name = path.relative_to(folder)
        if page.broken_equations:
            yield f"{name}: {page.broken_equations} equations cannot be drawn"
        yield from (
            f"{name}: loads {one} from a network" for one in page.loaded if urlsplit(one).netloc
        )
        for address in page.links + page.loaded:
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if target != path:
                reached.add(target)
            if not target.exists():
                yield f"{name}: {address} leads nowhere"
            elif (
                parts.fragment
                and target in pages
                and unquote(parts.fragment) not in pages[target].anchors
            ):
                yield f"{name}: {address} leads to no heading"
    yield from (
        f"{path.relative_to(folder)}: no link leads to this page"
        for path in pages
        if path not in reached
    )
    for path in sorted(folder.rglob("*.css")):
        if any(
            sign in path.read_text(encoding="utf-8")
            for sign in ("url(http", 'url("http', "url('http", "@import")
        ):
            yield f"{path.relative_to(folder)}: loads something from a network"


if __name__ == "__main__":
    found = list(faults(Path(sys.argv[1]).resolve()))
    print(
        "\n".join(found)
        or "every link of the site leads somewhere, and nothing is loaded from a network"
    )
    sys.exit(bool(found))
