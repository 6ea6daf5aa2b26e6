"""Sphinx: `python3 go.py docs` builds these pages without warnings."""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from _effects_page import effects_page

import symfive

project = "symfive"
copyright = "symfive developers"
version = release = symfive.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.mathjax"]
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build", "Thumbs.db", ".DS_Store"]
html_theme = "alabaster"
html_theme_options = {
    "description": symfive.__doc__.split(": ", 1)[-1].split("\n")[0],
    "page_width": "1100px",
    "sidebar_width": "240px",
}
html_show_sourcelink = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_type_aliases = {name: name for name in ("Array", "Symbol", "Vector", "Values", "Covariance")}
python_maximum_signature_line_length = 100

_MARK = re.compile(r"<!-- effects:.*?-->")
_CODE = re.compile(r"`([^`]+)`")


_OPTIONAL = re.compile(r"^\?(\w+)\n", re.MULTILINE)


def _complete(app, name, source):
    """Effects, made from docstrings and model, where their page has its mark; `?page` in a toctree if it exists."""
    if name == "index":
        pages = Path(app.srcdir)
        source[0] = _OPTIONAL.sub(lambda m: f"{m[1]}\n" if (pages / f"{m[1]}.md").exists() else "", source[0])
    if name == "effects":
        source[0] = _MARK.sub(lambda _: effects_page(Path(app.srcdir)), source[0])


def _to_rst(app, what, name, thing, options, lines):
    """Docstrings are Markdown: code in single backticks, code blocks indented. Turn them into what autodoc reads."""
    converted, inside = [], False
    for number, line in enumerate(lines):
        indented = line.startswith("    ") and line.strip()
        opens = indented and not inside and number > 0 and not lines[number - 1].strip() and not _in_list(lines, number)
        if opens:
            converted += ["::", ""]
            inside = True
        elif inside and line.strip() and not line.startswith("    "):
            inside = False
        converted.append(line if inside else _escaped(line))
    lines[:] = converted


def _in_list(lines, number):
    """Whether the line continues a list item above it."""
    for line in reversed(lines[:number]):
        if line.strip() and not line.startswith("    "):
            return line.lstrip().startswith("- ")
    return False


def _escaped(line):
    """Single backticks to double ones; what RST would read as markup elsewhere is escaped."""
    parts = _CODE.split(line.replace("``", "`"))
    for i, part in enumerate(parts):
        parts[i] = (
            f"``{part.strip()}``" if i % 2 else re.sub(r"([*|_])(?=\S)|(?<=\S)([*|_])", lambda m: "\\" + m[0], part)
        )
    return "".join(parts)


def setup(app):
    """Register the two hooks."""
    app.connect("source-read", _complete)
    app.connect("autodoc-process-docstring", _to_rst)
    return {"parallel_read_safe": False}
