"""A figure as the content of a file."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

from matplotlib import rc_context
from matplotlib.backend_bases import get_registered_canvas_class
from matplotlib.figure import Figure

__all__ = ["rendered"]

NAMELESS: dict[str, dict[str, None]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
"""What a file would say of when it was made, by format."""


def rendered(figure: Figure, format: str, look: Mapping[str, Any], dpi: float) -> bytes:
    """The figure as `png`, `svg` or `pdf`, drawn with the settings `look`, images in it with `dpi`.

    The same figure gives the same bytes where the look holds `svg.hashsalt`. Its layout is made once, and then stays.
    """
    stream = io.BytesIO()
    with rc_context(look):  # type: ignore[arg-type]
        layout = figure.get_layout_engine()
        if layout is not None:
            layout.execute(figure)
            figure.set_layout_engine("none")
        before, own = figure.canvas, figure.dpi
        figure.dpi = dpi
        canvas: Any = get_registered_canvas_class(format)(figure)
        try:  # not by `savefig`, which draws a figure that has a layout engine, "none" too, once more for nothing
            getattr(canvas, f"print_{format}")(stream, metadata=NAMELESS.get(format, {}))
        finally:
            figure.dpi = own
            figure.set_canvas(before)
    return stream.getvalue()
