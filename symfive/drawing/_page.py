"""What every page is made of: its style, light or dark, on paper too; the frame of a page whose tables sort; colours."""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from symfive.version import __version__

if TYPE_CHECKING:
    from jinja2 import Environment

BLUE, ORANGE, GREEN, PURPLE = "#0072b2", "#d55e00", "#009e73", "#cc79a7"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, "#e69f00", "#56b4e9")
"""Distinguishable for everybody (M. Okabe & K. Ito 2008; the yellow left out, too pale on paper)."""
INK, FAINT, GRID, PAPER = "#1d2a36", "#6b7885", "#d9dfe5", "#fdfefe"
"""Lines of the page itself; the report replaces them by the colours of the reader's light or dark theme."""


def own_file(name: str) -> str:
    """The text of a file of this package."""
    return (files("symfive.drawing") / name).read_text(encoding="utf-8")


PAGE_STYLE = own_file("page.css")
"""CSS for a page whose content stands in `<main>`; wide tables stand in `<div class="wide">`, or are cut nowhere else."""


def page(title: str, body: str, *, style: str = "", script: str = "") -> str:
    """A page of one file that loads nothing: `title` plain text, `body` HTML whose text is already escaped.

    Tables sort by the buttons in their heads (`<th><button>`); a cell with `data-sort` sorts by that number. `style` and `script`
    are the page's own. The policy in its head lets only this very script run.
    """
    from markupsafe import Markup

    own = own_file("sort.js") + script
    digest = base64.b64encode(hashlib.sha256(own.encode()).digest()).decode()
    filled = templates("symfive.drawing", ".").get_template("page.html").render(
        title=title, body=Markup(body), style=Markup(f"{PAGE_STYLE}{own_file('sorted.css')}{style}"), script=Markup(own),
        script_hash=f"sha256-{digest}", version=__version__,
    )  # fmt: skip
    return f"{filled}\n"


@cache
def templates(package: str, folder: str = "templates") -> Environment:
    """The templates in a folder of a package (Jinja2). Every value is escaped, and one that is not given is an error."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader(package, folder)
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
