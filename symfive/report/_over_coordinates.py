"""Residuals over the coordinates of the axes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from symfive.arrays import Array, Indices
from symfive.drawing import BLUE, INK, ORANGE
from symfive.errors import InputError
from symfive.identify import Identification
from symfive.machine import Axis
from symfive.numbers import unit_words, with_unit
from symfive.report._over_time import FEW_ROWS
from symfive.report._style import blank, footnote, styled, tip
from symfive.report._traces import Trace, direction_of, folded, limit_of, moving_axes, spread, traces_of

MOST_POINTS = 6000
MOST_ROWS = 8
BINS = 48
LEAST_ROWS = 4
SENSES = ((1, BLUE, "moving in +"), (-1, ORANGE, "moving in −"))


@styled
def residuals_over_coordinates(identification: Identification, runs: str | Iterable[str] | None = None) -> Figure:
    """Every reading's residual against the coordinate of every axis that moves, all runs together.

    Colours give the direction of motion (in a static run: of the approach), so that backlash and
    hysteresis show as two lines and geometry as one; the lines are means over short pieces of travel, of which few rows
    (below `FEW_ROWS`) have none. A turning axis
    that makes more than one turn is folded into one. Raises `InputError` where no axis moves.
    """
    traces = traces_of(identification, runs, drawn=True)
    machine = identification.model.machine
    moved = moving_axes([trace.run for trace in traces], machine)
    if not moved:
        raise InputError("no axis moves in these runs", remedy="choose runs in which one does")
    kinds = list(dict.fromkeys((trace.label, trace.unit) for trace in traces))
    rows = kinds[:MOST_ROWS]
    figure = blank(max(6.0, min(2.9 * len(moved) + 0.6, 13.0)), 2.1 * len(rows) + 1.0)
    grid = figure.subplots(len(rows), len(moved), squeeze=False, sharey="row", sharex="col")
    thinned = 1
    for i, (label, unit) in enumerate(rows):
        mine = [trace for trace in traces if (trace.label, trace.unit) == (label, unit)]
        limit = limit_of(mine)
        for j, name in enumerate(moved):
            thinned = max(thinned, _draw(grid[i, j], machine.axes[name], mine))
        grid[i, 0].set_ylim(-limit, limit)
        grid[i, 0].set_ylabel(f"{label} / {unit_words(unit)}")
    for j, name in enumerate(moved):
        axis = machine.axes[name]
        once = " over one revolution" if folded(axis, [t.run for t in traces]) else ""
        grid[-1, j].set_xlabel(f"{name}{once} / {unit_words(axis.unit)}")
    figure.suptitle("Residuals over the axes", x=0.01, ha="left")
    handles = [Line2D([], [], color=colour, label=f"axis {words}") for _, colour, words in SENSES]
    figure.legend(handles=handles, loc="outside upper right", ncols=2)
    footnote(
        figure,
        f"Dots: one row in {thinned}; the lines are means over all rows." if thinned > 1 else "",
        f"Drawn: {MOST_ROWS} of {len(kinds)} reading columns." if len(kinds) > MOST_ROWS else "",
    )
    return figure


def _draw(axes: Axes, axis: Axis, traces: Sequence[Trace]) -> int:
    parts = [trace for trace in traces if np.ptp(trace.run.commands[axis.name]) > 1e-9]
    if not parts:
        axes.text(0.5, 0.5, "at rest", transform=axes.transAxes, ha="center", va="center")
        return 1
    axes.axhline(0.0, color=INK, linewidth=0.6)
    place = np.concatenate([trace.run.commands[axis.name] for trace in parts])
    place = np.mod(place, 360.0) if folded(axis, [trace.run for trace in traces]) else place
    sense = np.concatenate([direction_of(trace.run.commands[axis.name]) for trace in parts])
    value, single = (np.concatenate([getattr(t, name) for t in parts]) for name in ("kept", "sample"))
    index, step = spread(len(place), MOST_POINTS)
    few = not any(trace.run.dynamic for trace in parts)
    size = 4.0 if len(place) < FEW_ROWS else 2.4 if few else 1.2
    for which, colour, _ in SENSES:
        dots = index[sense[index] == which]
        style = {"linestyle": "none", "marker": "o", "markersize": size, "markeredgewidth": 0.0}
        style |= {"color": colour, "alpha": 0.6 if few else 0.3, "rasterized": len(index) > 400}
        if len(place) < FEW_ROWS:
            dots = dots[np.isfinite(value[dots])]
        (line,) = axes.plot(place[dots], single[dots], **style)  # type: ignore[arg-type]
        if few and len(place) < FEW_ROWS:
            tip(line, f"tip-{axis.name}-{traces[0].label}-{which % 3}", _said(parts, dots, place, axis))
        if len(place) >= FEW_ROWS:
            means = means_along(place[sense == which], value[sense == which])
            axes.plot(*means, color=colour, linewidth=1.5, marker="o" if few else "", markersize=3.5)
    return step * max(trace.step for trace in parts)


def _said(parts: Sequence[Trace], dots: Indices, place: Array, axis: Axis) -> list[str]:
    """Run, pose, coordinate and residual of each of the `dots`, rows of all parts one after the other."""
    owners = [(trace, row) for trace in parts for row in range(trace.run.rows)]
    found = []
    for dot in dots.tolist():
        trace, row = owners[dot]
        pose, left = trace.said(row)
        found.append(f"{pose}, {axis.name} {with_unit(place[dot], axis.unit)}: {left}")
    return found


def means_along(place: Array, value: Array) -> tuple[Array, Array]:
    """Mean value at each coordinate where many rows stand at few of them, else over pieces of the travel; with a gap in the line
    where a large part of it was not visited."""
    known = np.isfinite(value)
    place, value = place[known], value[known]
    if not place.size:
        return place, value
    points, group = np.unique(np.round(place, 4), return_inverse=True)
    least = 1
    if len(points) > BINS or len(place) < LEAST_ROWS * len(points):
        bins = int(np.clip(len(place) // (3 * LEAST_ROWS), 4, BINS))
        edges = np.linspace(place.min(), place.max(), bins + 1)
        group = np.clip(np.digitize(place, edges) - 1, 0, bins - 1)
        least = max(2, len(place) // (20 * bins))
    count = np.bincount(group)
    filled = count >= least
    count = np.maximum(count, 1)
    place, value = ((np.bincount(group, weights=v) / count)[filled] for v in (place, value))
    wide = np.flatnonzero(np.diff(place) > 0.2 * max(float(np.ptp(place)), 1e-9)) + 1
    return np.insert(place, wide, np.nan), np.insert(value, wide, np.nan)
