"""HTML from the templates beside this file (Jinja2). Every value is escaped, unless it is markup that a template made."""

from __future__ import annotations

from importlib.resources import files

from markupsafe import Markup

from symfive.drawing import templates


def fragment(template: str, /, **values: object) -> Markup:
    """The template `templates/NAME.html` filled with `values`."""
    return Markup(templates("symfive.report").get_template(f"{template}.html").render(values))


def asset(name: str) -> Markup:
    """A style or script of the package, as it is."""
    return Markup((files("symfive.report") / "templates" / name).read_text(encoding="utf-8"))
