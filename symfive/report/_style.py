"""One look for all figures: colours that colour-blind readers can distinguish, numbers and units as engineers write them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, ParamSpec, TypeVar

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator

from symfive.arrays import Array
from symfive.drawing import FAINT, GRID, INK, PAPER, render
from symfive.numbers import unit_words

_LOOK: Any = {
    "font.family": "sans-serif", "font.size": 9.0, "axes.titlesize": 9.0, "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0, "ytick.labelsize": 8.0, "legend.fontsize": 8.0, "figure.titlesize": 11.0,
    "text.color": INK, "axes.labelcolor": INK, "axes.titlecolor": INK, "xtick.color": FAINT, "ytick.color": FAINT,
    "xtick.labelcolor": INK, "ytick.labelcolor": INK, "axes.edgecolor": FAINT, "axes.linewidth": 0.7,
    "axes.facecolor": "none", "figure.facecolor": PAPER, "savefig.facecolor": PAPER, "legend.facecolor": PAPER,
    "axes.grid": True, "axes.axisbelow": True, "grid.color": GRID, "grid.linewidth": 0.6, "axes.spines.top": False,
    "axes.spines.right": False, "axes.titlelocation": "left", "legend.frameon": False, "lines.linewidth": 1.2,
    "axes.formatter.useoffset": False, "text.parse_math": False, "svg.fonttype": "none", "svg.hashsalt": "symfive",
    "path.simplify": True, "agg.path.chunksize": 10_000, "xtick.major.size": 3.0, "ytick.major.size": 3.0,
}  # fmt: skip
DIVERGING = LinearSegmentedColormap.from_list(
    "symfive_diverging", ["#00568a", "#5aa6d6", "#f7f8f9", "#e8935a", "#b84f00"]
)
SEQUENTIAL = LinearSegmentedColormap.from_list("symfive_sequential", ["#f7f8f9", "#9cc9e3", "#0072b2", "#00456d"])
"""Colour maps from the same family as the lines: blue through white to vermilion, white to blue."""
_DPI = 150
_RESOLUTION = {"svg": 110}

P = ParamSpec("P")
T = TypeVar("T")


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Draw with this look whatever the caller's matplotlib settings are, and leave those as they were."""

    @functools.wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> T:
        with rc_context(_LOOK):
            return draw(*args, **kwargs)

    return drawn


class TippedFigure(Figure):
    """A figure with `tips`: by the id (gid) of a drawn artist what hovering over each of its points says."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.tips: dict[str, Sequence[str]] = {}


def blank(width: float, height: float, *, arranged: bool = True) -> TippedFigure:
    """An empty figure (inches) that belongs to no window and no global state; `arranged`: it places its axes itself."""
    figure = TippedFigure(figsize=(width, height), dpi=_DPI, layout="constrained" if arranged else None)
    FigureCanvasAgg(figure)
    return figure


def tip(artist: Artist, name: str, said: Sequence[str]) -> None:
    """Name an artist of a `blank` figure and say what hovering over each of its points tells."""
    artist.set_gid(name)
    figure = artist.get_figure()
    assert isinstance(figure, TippedFigure)
    figure.tips[name] = said


def rendered(figure: Figure, format: str) -> bytes:
    """The figure as a file's content (`symfive.drawing.render`) with this look."""
    return render.rendered(figure, format, _LOOK, _RESOLUTION.get(format, _DPI))


def label_of(column: str) -> str:
    """A reading column without its unit: `dL_um` dL, `X_act_mm` X_act."""
    return column.rsplit("_", 1)[0]


def short(text: str, most: int = 36) -> str:
    """The text, its middle left out where it is longer than `most` characters."""
    return text if len(text) <= most else f"{text[: most // 2 - 1]}…{text[-(most - most // 2) :]}"


def plain_log(axes: Axes) -> None:
    """Logarithmic axes whose ticks read 0.1, 1, 10; the upright one also 0.2 and 0.5, since it may span less than a decade."""
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(FuncFormatter(lambda value, _: ""))


def named_rows(axes: Axes, names: Sequence[str], unit: str) -> None:
    """A row for each name, the first one on top, over values in `unit` about zero."""
    axes.set_yticks(range(len(names)), [short(name) for name in names])
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlabel(unit_words(unit))
    axes.axvline(0.0, color=INK, linewidth=0.6)
    axes.grid(visible=False, axis="y")


def footnote(figure: Figure, *sentences: str) -> None:
    """Small print under a figure: what was left out of the drawing and why."""
    said = [sentence for sentence in sentences if sentence]
    if said:
        figure.supxlabel("\n".join(said), x=0.01, ha="left", fontsize=7.5, color=FAINT)


def robust_limit(values: Array, least: float) -> float:
    """Half height of an axis about zero that shows all but the wildest thousandth of the values and at least ±`least`."""
    finite = np.abs(values[np.isfinite(values)])
    reach = float(np.quantile(finite, 0.999)) if finite.size else 0.0
    return max(1.15 * reach, least, 1e-12)
