"""Polar traces of circular tests (ISO 230-4)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from symfive.arrays import Array
from symfive.campaign import Campaign, Run
from symfive.circles import Circle, CircleFinder, grouped
from symfive.drawing import BLUE, FAINT, GRID, INK, ORANGE
from symfive.errors import InputError
from symfive.identify import Identification
from symfive.model import Model
from symfive.numbers import plain_number
from symfive.report._style import blank, footnote, short, styled
from symfive.report._traces import Condensed, chosen_runs, condensed, condensed_of, running_mean, spread

MOST_GROUPS = 8
MOST_POINTS = 4000
SMOOTH_POINTS = 720
REACH = 0.42
STEPS = np.array([0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0])
SHADES = {1: (BLUE, "#56b4e9"), -1: (ORANGE, "#e69f00")}


@dataclass(frozen=True)
class _Deviation:
    """One run's deviation (N,) µm before the fit, what the model makes of it, what is left, and that of single readings."""

    circle: Circle
    before: Array
    fitted: Array | None
    left: Array | None
    single: Array | None


@dataclass(frozen=True)
class _Scale:
    """`share` of the drawn radius that one µm takes, and the `step` between rings, µm."""

    share: float
    step: float

    @classmethod
    def of(cls, values: Sequence[Array]) -> _Scale:
        reach = max((float(np.quantile(np.abs(v[np.isfinite(v)]), 0.998)) for v in values), default=1.0)
        step = float(STEPS[min(int(np.searchsorted(STEPS, reach / 3.5)), len(STEPS) - 1)])
        return cls(REACH / max(reach, 1.5 * step), step)


@styled
def polar_trace(source: Identification | Campaign, runs: str | Iterable[str] | None = None) -> Figure:
    """Circular tests: the deviation magnified on the circle of the run, both directions overlaid, before and after the fit.

    Before: the radial deviation as read, minus the least-squares circle (its centre and mean radius are set-up),
    with the fitted model as a dark line; after: the residual. Runs of the same place and feed share a panel; all
    panels of a kind have the same scale, and each states its magnification and what a ring is worth. The angle is that
    of the bar (or on the plate) in the workpiece frame where the ball goes round there, else the coordinate of the axis
    that turns. `source` with readings; of a `Campaign` only the left half is drawn. Raises `InputError` where no run
    is circular.
    """
    campaign = source.model.campaign if isinstance(source, Identification) else source
    finder = CircleFinder(campaign.machine)
    views = {run.id: _view(source, run) for run in chosen_runs(campaign, runs) if run.measured}
    circles = [c for c in (finder.find(view.run) for view in views.values()) if c is not None]
    if not circles:
        raise InputError(
            "none of these runs is a measured circle", remedy="choose a circular ball-bar or grid-encoder run"
        )
    model = source.model if isinstance(source, Identification) else Model(campaign)
    groups = [
        [_deviation(circle, views[circle.run.id], model, source) for circle in group] for group in grouped(circles)
    ]
    drawn = groups[:MOST_GROUPS]
    both = isinstance(source, Identification)
    before = _Scale.of([_smooth(d, d.before) for group in drawn for d in group])
    after = _Scale.of([_smooth(d, d.left) for group in drawn for d in group if d.left is not None]) if both else before
    notes = _notes(circles, both, len(groups))
    figure, places = _layout(len(drawn), 2 if both else 1, max(len(group) for group in drawn), 0.15 * len(notes))
    for group, (left, bottom, side) in zip(drawn, places, strict=True):
        panels = [_axes(figure, left + k * side, bottom, side) for k in range(2 if both else 1)]
        _panel(panels[0], group, before, after=False)
        if both:
            _panel(panels[1], group, after, after=True)
        _heading(figure, group, left, bottom + side)
        _legend(figure, panels[0], left, bottom)
    figure.suptitle(
        f"Circular tests: radial deviation{', as read and after the fit' if both else ''}", x=0.01, ha="left"
    )
    footnote(figure, *notes)
    return figure


def _notes(circles: Sequence[Circle], both: bool, groups: int) -> list[str]:
    arcs = "" if all(c.whole for c in circles) else " (the mean only, where less than 3/4 of a revolution was measured)"
    notes = [f"Measured: least-squares centre and mean radius of each run removed{arcs}.",
             _lines_in_words(circles, both)]  # fmt: skip
    return [*notes, f"Drawn: {MOST_GROUPS} of {groups} sets of runs."] if groups > MOST_GROUPS else notes


def _lines_in_words(circles: Sequence[Circle], both: bool) -> str:
    if not any(circle.run.dynamic for circle in circles):
        return "Points: the static readings, of which p–v is the height from peak to valley; outliers excluded."
    pale = "; pale: each reading; outliers excluded." if both else "."
    beyond = (
        "" if all(c.evaluated.all() for c in circles) else " over the complete turns, run-up and run-out not counted"
    )
    return f"Strong lines: running means, of which p–v is the height from peak to valley{beyond}{pale}"


def _layout(groups: int, panels: int, runs: int, notes: float) -> tuple[Figure, list[tuple[float, float, float]]]:
    """The figure and, for every group, left and lower edge and side of its first panel, inches."""
    side = 3.5 if groups == 1 else 2.75
    across = max(1, min(groups, 4 // panels))
    rows = -(-groups // across)
    below = 0.16 * runs + 0.2
    tall = side + below + 0.62
    width, height = across * (panels * side + 0.3), rows * tall + 0.4 + notes
    figure = blank(max(width, 4.6), height, arranged=False)
    lefts = [0.15 + (k % across) * (panels * side + 0.3) for k in range(groups)]
    bottoms = [height - 0.35 - (k // across + 1) * tall + below for k in range(groups)]
    return figure, [(left, bottom, side) for left, bottom in zip(lefts, bottoms, strict=True)]


def _axes(figure: Figure, left: float, bottom: float, side: float) -> Axes:
    width, height = figure.get_size_inches()
    axes = figure.add_axes((left / width, bottom / height, side / width, side / height))
    axes.set_axis_off()
    return axes


def _heading(figure: Figure, group: Sequence[_Deviation], left: float, top: float) -> None:
    width, height = figure.get_size_inches()
    circle = group[0].circle
    feed = f", {circle.feed:.0f} {circle.feed_unit}" if circle.run.dynamic else ", static readings"
    words = f"R = {circle.radius:.5g} mm{feed}; {circle.over}"
    figure.text((left + 0.05) / width, (top + 0.36) / height, words, fontsize=9, fontweight="bold")


def _legend(figure: Figure, axes: Axes, left: float, bottom: float) -> None:
    width, height = figure.get_size_inches()
    handles, labels = axes.get_legend_handles_labels()
    place = ((left + 0.05) / width, (bottom + 0.02) / height)
    figure.legend(
        handles, labels, loc="upper left", bbox_to_anchor=place, fontsize=7.5, borderpad=0.0, labelspacing=0.25
    )


def _view(source: Identification | Campaign, run: Run) -> Condensed:
    """The run as it is drawn; before a fit all of it is nothing but readings."""
    if isinstance(source, Identification):
        return condensed_of(source, run)
    return condensed(run, np.broadcast_to(0.0, (run.rows, 1)))


def _deviation(circle: Circle, view: Condensed, model: Model, source: Identification | Campaign) -> _Deviation:
    readings = model.readings(circle.run)
    raw = circle.measured(readings)
    one, used = np.ones(len(circle.angle)), circle.evaluated
    centring = np.column_stack([one, np.cos(circle.angle), np.sin(circle.angle)]) if circle.whole else one[:, None]
    removed = centring @ np.linalg.lstsq(centring[used], raw[used], rcond=None)[0]
    if not isinstance(source, Identification):
        return _Deviation(circle, raw - removed, None, None, None)
    residual = np.where(view.outlier, np.nan, view.residual)
    left = circle.radial(residual)
    good = np.isfinite(left)
    used &= good
    removed = centring @ np.linalg.lstsq(centring[used], raw[used], rcond=None)[0]
    return _Deviation(
        circle, np.where(good, raw - removed, np.nan), raw - removed - left, left, circle.radial(view.sample)
    )


def _smooth(deviation: _Deviation, values: Array) -> Array:
    window = max(9, len(values) // 150) if deviation.circle.run.dynamic else 1
    return running_mean(values, window)


def _panel(axes: Axes, group: Sequence[_Deviation], scale: _Scale, *, after: bool) -> None:
    circle = group[0].circle
    _rings(axes, scale, circle.marks)
    counts = {1: 0, -1: 0}
    for deviation in group:
        sense = deviation.circle.sense
        shades = SHADES[sense]
        colour = shades[counts[sense] % len(shades)]
        counts[sense] += 1
        values = deviation.left if after else deviation.before
        if values is None:
            continue
        if after and deviation.single is not None and deviation.circle.run.dynamic:
            _curve(axes, deviation, deviation.single, scale, color=colour, alpha=0.25, linewidth=0.4, rasterized=True)
        _curve(axes, deviation, _smooth(deviation, values), scale, color=colour, linewidth=1.3, label=_words(deviation))
        if deviation.fitted is not None and not after:
            _curve(axes, deviation, deviation.fitted, scale, color=INK, linewidth=0.7, linestyle=(0, (4, 2)), marker="")
    magnification = 1e3 * scale.share * circle.radius
    title = "left after the fit" if after else "measured" + (" (dashed: model)" if group[0].fitted is not None else "")
    axes.set_title(
        f"{title}\n×{_thousands(magnification)} · 1 ring = {scale.step:g} µm", loc="center", fontsize=8.5, pad=-6.0
    )


def _words(deviation: _Deviation) -> str:
    circle = deviation.circle
    name = f"{short(circle.run.id)} ({'CCW' if circle.sense > 0 else 'CW'})"
    words = f"{name}: p–v {plain_number(_height(deviation, deviation.before))} µm"
    return (
        words
        if deviation.left is None
        else f"{words}, after the fit {plain_number(_height(deviation, deviation.left))} µm"
    )


def _height(deviation: _Deviation, values: Array) -> float:
    smooth = _smooth(deviation, values)[deviation.circle.evaluated]
    return float(np.nanmax(smooth) - np.nanmin(smooth))


def _curve(axes: Axes, deviation: _Deviation, values: Array, scale: _Scale, **style: object) -> None:
    index = spread(len(values), MOST_POINTS if style.get("rasterized") else SMOOTH_POINTS)[0]
    radius = 1.0 + scale.share * values[index]
    radius = np.where(radius > 1.0 + 1.25 * REACH, np.nan, np.maximum(radius, 0.05))
    angle = deviation.circle.angle[index]
    if not deviation.circle.run.dynamic and "marker" not in style:  # single readings: nothing is known between them
        style |= {"marker": "o", "markersize": 3.5, "markeredgewidth": 0.0, "linestyle": "none"}
        ends = np.stack([np.ones_like(radius), radius], axis=1)[:, :, None]
        spokes = ends * np.stack([np.cos(angle), np.sin(angle)], axis=1)[:, None, :]
        axes.add_collection(LineCollection(list(spokes), colors=style["color"], linewidths=0.8, alpha=0.55))
    axes.plot(radius * np.cos(angle), radius * np.sin(angle), **style)  # type: ignore[arg-type]


def _rings(axes: Axes, scale: _Scale, marks: tuple[str, str] | None) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 121)
    count = int(REACH / scale.share / scale.step + 1e-6)
    for k in range(-count, count + 1):
        radius = 1.0 + k * scale.step * scale.share
        style = {"color": FAINT, "linewidth": 1.0} if k == 0 else {"color": GRID, "linewidth": 0.6}
        axes.plot(radius * np.cos(turn), radius * np.sin(turn), zorder=0.5, **style)  # type: ignore[arg-type]
        if k and (abs(k) == count or (count > 3 and abs(k) == count // 2)):
            x, y = radius * float(np.cos(1.18)), radius * float(np.sin(1.18))
            words = f"{k * scale.step:+g}".replace("-", "−")
            axes.text(x, y, words, fontsize=6.5, color=FAINT, ha="center", va="center", zorder=5)
    rim = 1.0 + 1.12 * REACH
    for spoke in range(0, 360, 30):
        direction = np.array([np.cos(np.radians(spoke)), np.sin(np.radians(spoke))])
        inner = 1.0 - REACH
        axes.plot(*np.outer(direction, (inner, 1.0 + REACH)), color=GRID, linewidth=0.6, zorder=0.4)
        if spoke % 90 == 0:
            name = f"{spoke}°"
            if marks is not None:
                name = (marks[0], marks[1], _opposite(marks[0]), _opposite(marks[1]))[spoke // 90]
            axes.text(
                float(direction[0]) * rim, float(direction[1]) * rim, name, ha="center", va="center", fontsize=7.5
            )
    axes.set_aspect("equal")
    axes.set_xlim(-1.7, 1.7)
    axes.set_ylim(-1.7, 1.7)


def _opposite(mark: str) -> str:
    return ("−" if mark[0] == "+" else "+") + mark[1:]


def _thousands(value: float) -> str:
    digits = 1 - int(np.floor(np.log10(max(value, 1e-9))))
    return f"{round(value, digits):,.0f}".replace(",", " ")
