"""A figure as the content of a file."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

from matplotlib import rc_context
from matplotlib.backend_bases import get_registered_canvas_class
from matplotlib.figure import Figure

SAVED: dict[str, dict[str, Any]] = {
    "svg": {"metadata": {"Date": None}},
    "pdf": {"metadata": {"CreationDate": None}},
    "png": {"pil_kwargs": {"compress_level": 3}},
}
"""How each format is written: without what a file says of when it was made, and quickly (an eighth larger than most slowly)."""


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
            getattr(canvas, f"print_{format}")(stream, **SAVED[format])
        finally:
            figure.dpi = own
            figure.set_canvas(before)
    return stream.getvalue()
