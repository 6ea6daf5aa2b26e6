"""HTML pages as the tests read them, and text that must not get into one unescaped."""

from html.parser import HTMLParser

import pytest

HOSTILE = "<script>alert('x')</script> & \"$\\frac{\" 铣床"


def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages of a diagnosis come without their figures, which are most of the work."""
    for name in ("drawn", "placed"):
        monkeypatch.setattr(f"symfive.report._diagnosis.{name}", lambda *_: "")


class Page(HTMLParser):
    """What a browser would make of the page: its tags, attributes and text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.words = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data: str) -> None:
        self.words += data
