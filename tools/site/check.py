"""Checks the links and the equations of a built site (run `check.py SITE`)."""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote


class Page(HTMLParser):
    """The links of a page, and the anchors to which other pages can link."""

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
    # Pages of cargo doc and pdoc are not checked.
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
    if sum(page.equations for path, page in pages.items() if path.parent == site / "optics") < 8:
        wrong.append("the pages in optics/ have fewer than 8 equations")
    if wrong:
        sys.exit("\n".join(wrong))
    print(f"{len(pages)} pages, {sum(len(p.targets) for p in pages.values())} links")


if __name__ == "__main__":
    main(*sys.argv[1:])
