"""Residuals over time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from symfive.drawing import FAINT, INK, SERIES
from symfive.identify import Identification
from symfive.report._style import blank, footnote, plain_number, robust_limit, short, styled, unit_words
from symfive.report._traces import Array, Trace, running_mean, spread, traces_of

__all__ = ["residuals_over_time"]

MOST_PANELS = 24
MOST_POINTS = 12_000
NAMED_OUTLIERS = 3


@styled
def residuals_over_time(identification: Identification, runs: str | Iterable[str] | None = None) -> Figure:
    """What the fit leaves of every reading, run by run, on one common scale per unit.

    Pale: each reading; strong: their running mean, in which anything but noise stands out; grey: ±2σ of the noise that
    the run declares; dotted: ±2σ of the noise that the fit found, where it is larger; ringed: outliers, which the fit
    left out (at the edge, with their value, where they lie outside the panel).
    """
    panels: dict[tuple[str, str], list[Trace]] = {}
    for trace in traces_of(identification, runs):
        panels.setdefault((trace.run.id, trace.unit), []).append(trace)
    drawn = list(panels.items())[:MOST_PANELS]
    columns = 1 if len(drawn) <= 3 else 2 if len(drawn) <= 12 else 3
    rows = -(-len(drawn) // columns)
    figure = blank(9.0, max(2.6, 1.45 * rows + 1.0))
    grid = figure.subplots(rows, columns, squeeze=False)
    limits = _limits([trace for _, traces in drawn for trace in traces])
    steps = {1}
    for place, ((run, unit), traces) in enumerate(drawn):
        axes = grid[place // columns, place % columns]
        steps.add(_draw(axes, traces, limits[unit]))
        axes.set_title(short(run, 48))
        axes.set_ylim(-limits[unit], limits[unit])
        axes.set_ylabel(unit_words(unit))
        if place + columns >= len(drawn):
            axes.set_xlabel("time in the run / s")
    for place in range(len(drawn), rows * columns):
        grid[place // columns, place % columns].set_visible(False)
    figure.suptitle("Residuals over time", x=0.01, ha="left")
    _legend(figure, [trace for _, traces in drawn for trace in traces], limits)
    footnote(
        figure,
        f"Drawn: one row in {max(steps)} of long runs; all rows count in the means and in the fit."
        if max(steps) > 1
        else "",
        f"Drawn: the first {MOST_PANELS} of {len(panels)} panels." if len(panels) > MOST_PANELS else "",
    )
    return figure


def _limits(traces: list[Trace]) -> dict[str, float]:
    found: dict[str, float] = {}
    for unit in {trace.unit for trace in traces}:
        mine = [trace for trace in traces if trace.unit == unit]
        least = 4.0 * max(trace.noise.declared for trace in mine)
        found[unit] = robust_limit(np.concatenate([trace.kept for trace in mine]), least)
    return found


def _draw(axes: Axes, traces: list[Trace], limit: float) -> int:
    noise = traces[0].noise
    axes.axhspan(-2 * noise.declared, 2 * noise.declared, color=FAINT, alpha=0.16, linewidth=0)
    if noise.total > 1.05 * noise.declared:
        for side in (-2.0, 2.0):
            axes.axhline(side * noise.total, color=FAINT, linewidth=0.9, linestyle=":")
    step = 1
    for trace, colour in zip(traces, _colours(traces), strict=True):
        time, kept = trace.run.time, trace.kept
        index, step = spread(len(time), MOST_POINTS)
        if trace.run.dynamic:
            axes.plot(time[index], kept[index], color=colour, alpha=0.35, linewidth=0.5, rasterized=True)
            axes.plot(*_smooth(time, kept), color=colour, linewidth=1.3)
        else:
            style = {"linewidth": 0.5, "marker": "o", "markersize": 2.2}
            axes.plot(time[index], kept[index], color=colour, **style)  # type: ignore[arg-type]
        _outliers(axes, trace, limit, colour)
    axes.margins(x=0.01)
    return step


def _smooth(time: Array, values: Array) -> tuple[Array, Array]:
    window = max(5, len(values) // 100)
    index = spread(len(values), 400)[0]
    return time[index], running_mean(values, window)[index]


def _outliers(axes: Axes, trace: Trace, limit: float, colour: str) -> None:
    rows = np.flatnonzero(trace.outlier)
    outside = np.abs(trace.residual) > limit
    inside = rows[~outside[rows]]
    ring = {"markerfacecolor": "none", "markeredgecolor": INK, "markersize": 7.0, "linestyle": "none"}
    if inside.size:
        at, value = trace.run.time[inside], trace.residual[inside]
        axes.plot(at, value, marker="o", clip_on=False, **ring)  # type: ignore[arg-type]
        axes.plot(at, value, ".", color=colour, markersize=3.0)
    beyond = np.flatnonzero(outside)
    for row in beyond.tolist():
        up = trace.residual[row] > 0
        height = np.copysign(0.93 * limit, trace.residual[row])
        edge = INK if trace.outlier[row] else colour
        axes.plot(trace.run.time[row], height, "^" if up else "v", color=colour, markeredgecolor=edge, markersize=5.0)
    for row in _apart(sorted(beyond.tolist(), key=lambda r: -abs(trace.residual[r])), trace.run.time):
        axes.annotate(
            f" {plain_number(trace.residual[row])}",
            (float(trace.run.time[row]), float(np.copysign(0.93 * limit, trace.residual[row]))),
            fontsize=7,
            va="center",
            xytext=(4, 0),
            textcoords="offset points",
            in_layout=False,
        )


def _apart(rows: list[int], time: Array) -> list[int]:
    """The first few of the rows that are far enough from each other for their values to be legible."""
    named: list[int] = []
    for row in rows:
        if len(named) < NAMED_OUTLIERS and all(abs(time[row] - time[other]) > 0.08 * np.ptp(time) for other in named):
            named.append(row)
    return named


def _colours(traces: list[Trace]) -> list[str]:
    return [SERIES[i % len(SERIES)] for i in range(len(traces))]


def _legend(figure: Figure, traces: list[Trace], limits: Mapping[str, float]) -> None:
    handles: list[Line2D | Patch] = []
    labels: dict[str, list[str]] = {}
    groups: dict[tuple[str, str], list[Trace]] = {}
    for trace in traces:
        groups.setdefault((trace.run.id, trace.unit), []).append(trace)
    for group in groups.values():
        for trace, colour in zip(group, _colours(group), strict=True):
            same = labels.setdefault(colour, [])
            same += [trace.label] if trace.label not in same else []
    if all(len(names) <= 3 for names in labels.values()):
        handles += [Line2D([], [], color=colour, label=", ".join(names)) for colour, names in labels.items()]
    handles.append(Patch(color=FAINT, alpha=0.25, label="±2σ of the declared noise"))
    if any(trace.noise.total > 1.05 * trace.noise.declared for trace in traces):
        handles.append(Line2D([], [], color=FAINT, linestyle=":", label="±2σ of the noise found"))
    if any(trace.outlier.any() for trace in traces):
        ring = Line2D(
            [], [], marker="o", markerfacecolor="none", markeredgecolor=INK, linestyle="none", label="outlier, left out"
        )
        handles.append(ring)
    if any(np.any(np.abs(trace.residual) > limits[trace.unit]) for trace in traces):
        edge = Line2D([], [], marker="^", color=SERIES[0], linestyle="none", markersize=5.0, label="beyond the panel")
        handles.append(edge)
    figure.legend(handles=handles, loc="outside upper right", ncols=min(len(handles), 5))
