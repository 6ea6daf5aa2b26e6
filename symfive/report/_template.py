"""HTML from the templates beside this file (Jinja2). Every value is escaped, unless it is markup that a template made."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

__all__ = ["Markup", "asset", "fragment"]


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("symfive.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def fragment(template: str, /, **values: object) -> Markup:
    """The template `templates/NAME.html` filled with `values`."""
    return Markup(_environment().get_template(f"{template}.html").render(values))


def asset(name: str) -> Markup:
    """A style or script of the package, as it is."""
    return Markup((files("symfive.report") / "templates" / name).read_text(encoding="utf-8"))
