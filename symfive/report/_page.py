"""One self-contained HTML page: escaped text, figures as SVG that follow the reader's light or dark theme.

HTML from the templates beside this file (Jinja2). Every value is escaped, unless it is markup that a template made.
"""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from markupsafe import Markup
from matplotlib.figure import Figure

from symfive.drawing import BLUE, FAINT, GRID, INK, ORANGE, PAPER, page, templates
from symfive.drawing import SCRIPT as POSES
from symfive.outputs import write_text
from symfive.report._style import TippedFigure, rendered

_THEME = {INK: "var(--ink)", FAINT: "var(--faint)", GRID: "var(--grid)", PAPER: "var(--card)", BLUE: "var(--blue)",
          ORANGE: "var(--orange)"}  # fmt: skip


def fragment(template: str, /, **values: object) -> Markup:
    """The template `templates/NAME.html` filled with `values`."""
    return Markup(templates("symfive.report").get_template(f"{template}.html").render(values))


def asset(name: str) -> Markup:
    """A style or script of the package, as it is."""
    return Markup((files("symfive.report") / "templates" / name).read_text(encoding="utf-8"))


def write_page(path: Path, title: str, body: Markup) -> None:
    """Write the page whole or not at all. `title` is plain text, `body` HTML whose text is already escaped."""
    script = POSES if '<figure class="poses">' in body else ""
    write_text(path, page(title, body, style=asset("page.css"), script=script))


def embedded(figure: Figure, name: str, title: str, reading: str) -> Markup:
    """A `<figure>` with the drawing inline, its tips, its colours tied to the page's theme, and how to read it as caption."""
    svg = rendered(figure, "svg").decode()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    for key, texts in figure.tips.items() if isinstance(figure, TippedFigure) else ():
        svg = _tipped(svg, key, texts)
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r"url\(#", f"url(#{name}-", svg)
    svg = re.sub(r'href="#', f'href="#{name}-', svg)
    for colour, variable in _THEME.items():
        svg = re.sub(f"(fill|stroke): {colour}", rf"\1: {variable}", svg)
    svg = re.sub(r"(font(?:-family)?: [^;\"]*?)'DejaVu Sans'[^;\"]*", r"\1system-ui, 'DejaVu Sans', sans-serif", svg)
    svg = svg.replace("<svg ", f'<svg role="img" aria-label="{html.escape(title)}" ', 1)
    return fragment("figure", name=name, svg=Markup(svg), reading=reading)


def _tipped(svg: str, key: str, texts: Sequence[str]) -> str:
    """The points of one artist with a `<title>` each; as it is where the drawing left some points out."""
    begin = svg.find(f'<g id="{key}">')
    end = svg.find('<g id="', begin + 1)
    if begin < 0:
        return svg
    part = svg[begin:] if end < 0 else svg[begin:end]
    points = re.compile(r"(<use [^>]*?)/>")
    if len(points.findall(part)) != len(texts):
        return svg
    said = iter(texts)
    tipped = points.sub(lambda m: f"{m[1]}><title>{html.escape(next(said))}</title></use>", part)
    return svg[:begin] + tipped + svg[begin + len(part) :]


def sentences(lines: Sequence[str], most: int = 20) -> Markup:
    """A list of sentences; the ones after the first `most` are folded away; nothing where there is none."""
    return fragment("sentences", lines=lines, most=most) if lines else Markup()
