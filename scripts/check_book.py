"""Checks the built book: check_book.py FOLDER. Every link leads to a file and, with #, to a place in it; every picture is
there and has a description; the search finds pages; equations are set by MathJax on the pages that have some."""

import html.parser
import pathlib
import sys
import urllib.parse


class Page(html.parser.HTMLParser):
    """Places, links and pictures of a page."""

    def __init__(self, path: pathlib.Path) -> None:
        super().__init__()
        self.places: set[str] = set()
        self.links: list[str] = []
        self.problems: list[str] = []
        self.mathjax = False
        self.text: list[str] = []
        self.skipped = 0
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        values = dict(attributes)
        if identity := values.get("id"):
            if identity in self.places:
                self.problems.append(f"two elements have the id {identity}")
            self.places.add(identity)
        for name in ("href", "src"):
            if target := values.get(name):
                self.links.append(target)
        if tag == "img" and not values.get("alt"):
            self.problems.append(f"the picture {values.get('src')} has no description")
        if tag == "script" and "MathJax" in (values.get("src") or ""):
            self.mathjax = True
        if tag in ("script", "style", "code", "pre"):
            self.skipped += 1

    def handle_endtag(self, tag: str) -> None:
        if tag in ("script", "style", "code", "pre"):
            self.skipped -= 1

    def handle_data(self, data: str) -> None:
        if not self.skipped:
            self.text.append(data)


def main() -> int:
    book = pathlib.Path(sys.argv[1]).resolve()
    pages = {path: Page(path) for path in sorted(book.rglob("*.html"))}
    problems: list[str] = []
    links = 0
    for path, page in pages.items():
        name = path.relative_to(book)
        problems += [f"{name}: {problem}" for problem in page.problems]
        text = "".join(page.text)
        if ("\\(" in text or "\\[" in text) and not page.mathjax:
            problems.append(f"{name}: equations without MathJax")
        for opening, closing in (("\\(", "\\)"), ("\\[", "\\]")):
            if text.count(opening) != text.count(closing):
                problems.append(f"{name}: {text.count(opening)} times {opening}, {text.count(closing)} times {closing}")
        # The page of errors of a server; its links start at the root of the site. The printed book joins all pages.
        if name.name in ("404.html", "toc.html"):
            continue
        for link in page.links:
            url = urllib.parse.urlsplit(link)
            if url.scheme or url.netloc:
                continue
            links += 1
            target = path if not url.path else (path.parent / urllib.parse.unquote(url.path)).resolve()
            if not target.is_file():
                problems.append(f"{name}: {link} leads to no file")
            elif url.fragment and target.suffix == ".html":
                place = urllib.parse.unquote(url.fragment)
                if place not in pages[target].places:
                    problems.append(f"{name}: {link} leads to no place of the page")

    # The index of the search is JSON within a line of JavaScript.
    index = "".join(path.read_text(encoding="utf-8") for path in book.glob("searchindex*.js"))
    for word in ("ellipsoid", "covariance", "colmap"):
        # Words are cut to their stems.
        if word[:6] not in index:
            problems.append(f"the search does not find {word}")

    for problem in problems:
        print(f"error: {problem}", file=sys.stderr)
    print(f"{len(pages)} pages, {links} links, {len(problems)} problems")
    return 1 if problems or links < 1000 else 0


if __name__ == "__main__":
    sys.exit(main())
