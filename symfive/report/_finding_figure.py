"""The picture of a finding: the residual before and after, over the coordinate that matters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from symfive.arrays import Array, Indices
from symfive.campaign import Run
from symfive.diagnose import Diagnosis, Finding
from symfive.drawing import BLUE, FAINT, INK, ORANGE
from symfive.effects import coordinate_values
from symfive.identify import Identification
from symfive.machine import Machine
from symfive.numbers import plain_number, unit_words
from symfive.report._over_coordinates import means_along
from symfive.report._style import blank, footnote, robust_limit, short, styled, tip
from symfive.report._traces import Trace, direction_of, folded, running_mean, spread, traces_of

MOST = 2
MINUTES_FROM_S = 600.0
MOST_COLUMNS = 3
MOST_POINTS = 5000
FEW_ROWS = 1500
TIPPED_ROWS = 600
LEAST_SHARE = 0.25
LEAST_MEANS = 0.3
WAVES = 12
SENSES = ((1, BLUE), (-1, ORANGE))


@dataclass(frozen=True)
class Coordinate:
    """What a residual is drawn over: `label` with its unit, `values` of a run's rows (N,).

    `axis` is the one whose direction of motion splits the rows; `clock`: it is time, each run a line of its own.
    """

    label: str
    values: Callable[[Run], Array]
    axis: str | None = None
    clock: bool = False


def coordinates_of(finding: Finding, identification: Identification) -> list[Coordinate]:
    """The coordinates that a finding names, two at most; rows in their order where it names none that can be drawn."""
    machine, runs = identification.model.machine, identification.model.campaign.runs
    found = []
    for words in finding.coordinate.split(", ")[:MOST]:
        name, _, quantity = words.partition(" ")
        if words == "t":
            found.append(_clock(runs))
        elif name in machine.axes:
            found.append(_of_axis(machine, runs, name, quantity))
    return found or [_rows(runs)]


def _of_axis(machine: Machine, runs: tuple[Run, ...], name: str, quantity: str) -> Coordinate:
    axis = machine.axes[name]
    unit = unit_words(axis.unit)
    if quantity in ("velocity", "acceleration"):
        per = "s" if quantity == "velocity" else "s²"
        rate = f"{name} {quantity}"
        return Coordinate(f"{quantity} of {name} / ({unit}/{per})", lambda run: coordinate_values(rate, run, machine))
    if not folded(axis, runs):
        return Coordinate(f"{name} / {unit}", lambda run: np.asarray(run.commands[name]), name if quantity else None)

    def position(run: Run) -> Array:
        return np.asarray(np.mod(run.commands[name] + 180.0, 360.0) - 180.0)

    return Coordinate(f"{name} over one revolution / {unit}", position, name if quantity else None)


def _clock(runs: tuple[Run, ...]) -> Coordinate:
    end = max(run.start_s + float(run.time[-1]) for run in runs)
    scale, unit = (60.0, "min") if end > MINUTES_FROM_S else (1.0, "s")
    return Coordinate(
        f"time of the campaign / {unit}", lambda run: np.asarray((run.start_s + run.time) / scale), clock=True
    )


def _rows(runs: tuple[Run, ...]) -> Coordinate:
    first, count = {}, 0
    for run in runs:
        first[run.id] = count
        count += run.rows

    def numbers(run: Run) -> Array:
        return np.asarray(first[run.id] + 1.0 + np.arange(run.rows), dtype=np.float64)

    return Coordinate("row of the campaign, in the order of the runs", numbers, clock=True)


@dataclass(frozen=True)
class _Part:
    """One reading column of one run: abscissa, direction of motion, the residual before, what of it the other findings
    do not explain, the residual after, the effect's visible part (N,)."""

    run: str
    dynamic: bool
    at: Array
    sense: Indices
    before: Array
    alone: Array
    after: Array
    visible: Array
    noise: float


@styled
def finding_figure(
    diagnosis: Diagnosis, finding: Finding, visible: Mapping[str, Array], others: Mapping[str, Array] | None = None
) -> Figure:
    """Residual before and after over the finding's coordinate, with the effect's own line.

    `visible` run → (N, ny): the part of its contribution that the fit before could not take; `others` the same of all
    other findings, which is subtracted (the residual as it was stays in grey). The reading columns in which the effect
    is largest are drawn, at most three.
    """
    coordinates = coordinates_of(finding, diagnosis.after)
    labels = _columns(diagnosis.after, finding, visible)
    rows = [(label, coordinate) for label in labels for coordinate in coordinates]
    figure = blank(9.4, 2.25 * len(rows) + 1.05)
    grid = figure.subplots(len(rows), 2, squeeze=False, sharey="row", sharex="row")
    zoomed, thinned = False, 1
    for i, ((label, unit), coordinate) in enumerate(rows):
        parts = _parts(diagnosis, finding, (visible, others), (label, unit), coordinate)
        parts, narrowed = _zoom(parts) if coordinate.clock else (parts, False)
        zoomed = zoomed or narrowed
        limit = robust_limit(np.concatenate([p.before for p in parts]), 4.0 * max(p.noise for p in parts))
        for j, axes in enumerate(grid[i]):
            step = _draw(axes, parts, coordinate, limit, after=bool(j), name=f"tip-{i}-{j}", unit=unit)
            thinned = max(thinned, step)
            axes.set_xlabel(coordinate.label)
        grid[i, 0].set_ylim(-limit, limit)
        grid[i, 0].set_ylabel(f"{label} / {unit_words(unit)}")
    grid[0, 0].set_title("Residual before, without the findings")
    grid[0, 1].set_title("Residual after, with the findings")
    _legend(figure, next((c.axis for c in coordinates if c.axis), None), others is not None)
    footnote(
        figure,
        f"Shown: about {WAVES} waves of the run in which it is strongest." if zoomed else "",
        f"Dots: one row in {thinned}; the lines are means over all rows." if thinned > 1 else "",
    )
    return figure


def _columns(result: Identification, finding: Finding, visible: Mapping[str, Array]) -> list[tuple[str, str]]:
    squares: dict[tuple[str, str], list[Array]] = {}
    for trace, j in _numbered(result, finding):
        column = visible[trace.run.id][:, j]
        squares.setdefault((trace.label, trace.unit), []).append(np.square(column / trace.noise.declared))
    size = {key: float(np.sqrt(np.mean(np.concatenate(values)))) for key, values in squares.items()}
    ranked = sorted(size, key=lambda key: -size[key])
    drawn = [key for key in ranked if size[key] >= LEAST_SHARE * size[ranked[0]]][:MOST_COLUMNS]
    return [key for key in size if key in drawn]


def _numbered(result: Identification, finding: Finding) -> list[tuple[Trace, int]]:
    """Every trace of the runs in which it acts, with its place among the run's columns."""
    runs = [r for r in finding.runs if r in finding.contribution] or list(finding.contribution)
    names = {run: [c.name for c in result.model.columns(run)] for run in runs}
    return [(t, names[t.run.id].index(t.column)) for t in traces_of(result, runs)]


def _parts(
    diagnosis: Diagnosis, finding: Finding, explained: tuple[Mapping[str, Array], Mapping[str, Array] | None],
    key: tuple[str, str], coordinate: Coordinate,
) -> list[_Part]:  # fmt: skip
    visible, others = explained
    parts = []
    for trace, j in _numbered(diagnosis.after, finding):
        if (trace.label, trace.unit) == key:
            run = trace.run
            before = np.where(trace.outlier, np.nan, diagnosis.before.residuals[run.id][:, j])
            alone = before if others is None else before - others[run.id][:, j]
            sense = (
                direction_of(run.commands[coordinate.axis]) if coordinate.axis else np.ones(run.rows, dtype=np.int64)
            )
            parts.append(_Part(
                run.id, run.dynamic, coordinate.values(run), sense, before, alone, trace.kept, visible[run.id][:, j],
                max(trace.noise.declared, trace.noise.white),
            ))  # fmt: skip
    return parts


def _zoom(parts: list[_Part]) -> tuple[list[_Part], bool]:
    """Where the effect is a fast wave in time: the strongest stretch of the strongest run alone."""
    strongest = max(parts, key=lambda p: float(np.mean(p.visible**2)))
    crossings = np.flatnonzero(np.diff(np.signbit(strongest.visible)))
    if not strongest.dynamic or len(crossings) < 6 * WAVES:
        return parts, False
    power = running_mean(strongest.visible**2, max(3, len(strongest.at) // 50))
    nearest = int(np.argmin(np.abs(crossings - int(np.argmax(power)))))
    first = int(np.clip(nearest - WAVES, 0, len(crossings) - 1 - 2 * WAVES))
    rows = slice(int(crossings[first]), int(crossings[first + 2 * WAVES]) + 1)
    names = ("at", "sense", "before", "alone", "after", "visible")
    cut = {name: getattr(strongest, name)[rows] for name in names}
    return [_Part(run=strongest.run, dynamic=True, noise=strongest.noise, **cut)], True


def _draw(
    axes: Axes, parts: list[_Part], coordinate: Coordinate, limit: float, *, after: bool, name: str, unit: str
) -> int:
    noise = max(p.noise for p in parts)
    axes.axhspan(-2.0 * noise, 2.0 * noise, color=FAINT, alpha=0.16, linewidth=0)
    axes.axhline(0.0, color=INK, linewidth=0.6)
    at, sense = np.concatenate([p.at for p in parts]), np.concatenate([p.sense for p in parts])
    value = np.concatenate([p.after if after else p.alone for p in parts])
    few = len(at) <= FEW_ROWS
    index, step = spread(len(at), MOST_POINTS)
    if not after and any(p.alone is not p.before for p in parts):
        before = np.concatenate([p.before for p in parts])
        axes.plot(at[index], before[index], "o", color=FAINT, markersize=2.0 if few else 1.0, alpha=0.45,
                  markeredgewidth=0.0, rasterized=True)  # fmt: skip
    index = index[np.isfinite(value[index]) & (np.abs(value[index]) <= limit)]
    for which, colour in SENSES:
        dots = index[sense[index] == which]
        if not dots.size:
            continue
        look = {"markersize": 3.0 if few else 1.3, "alpha": 0.65 if few else 0.3, "rasterized": not few}
        (line,) = axes.plot(at[dots], value[dots], "o", color=colour, markeredgewidth=0.0, **look)  # type: ignore[arg-type]
        if len(at) <= TIPPED_ROWS:
            tip(line, f"{name}-{which % 3}", _said(parts, dots, coordinate, unit))
    for which, colour in SENSES:
        if coordinate.axis and np.any(sense == which):
            axes.plot(*means_along(at[sense == which], value[sense == which]), color=colour, linewidth=1.5)
    if not after:
        _effect(axes, parts, coordinate, few=few)
    axes.margins(x=0.02)
    return step


def _effect(axes: Axes, parts: list[_Part], coordinate: Coordinate, *, few: bool) -> None:
    """The effect over the coordinate: run by run over time, else a tick for each of few rows, and their means.

    The means are left out where they hide most of it: where it differs much from row to row at the same place.
    """
    if coordinate.clock:
        for part in parts:
            index = spread(len(part.at), 600)[0]
            axes.plot(part.at[index], part.visible[index], color=INK, linewidth=1.5)
        return
    at, sense = np.concatenate([p.at for p in parts]), np.concatenate([p.sense for p in parts])
    value = np.concatenate([p.visible for p in parts])
    if few:
        axes.plot(at, value, "_", color=INK, markersize=7.0, markeredgewidth=0.9, alpha=0.7)
    for which, _ in SENSES:
        mine = sense == which
        if np.any(mine):
            places, means = means_along(at[mine], value[mine])
            if not few or np.nanvar(means) > LEAST_MEANS * np.var(value[mine]):
                axes.plot(places, means, color=INK, linewidth=1.5)


def _said(parts: list[_Part], dots: Indices, coordinate: Coordinate, unit: str) -> list[str]:
    run = np.concatenate([np.full(len(p.at), i) for i, p in enumerate(parts)])
    first = np.cumsum([0, *(len(p.at) for p in parts)])
    words, _, over = coordinate.label.partition(" / ")
    said = []
    for k in dots.tolist():
        part = parts[run[k]]
        row = k - int(first[run[k]])
        old, new = (plain_number(float(v), unit) for v in (part.before[row], part.after[row]))
        where = f"{words} {plain_number(float(part.at[row]))} {over}"
        number = f"{'row' if part.dynamic else 'pose'} {row + 1}"
        said.append(f"{short(part.run)}, {number}, {where}: {old} → {new} {unit_words(unit)}")
    return said


def _legend(figure: Figure, axis: str | None, others: bool) -> None:
    handles: list[Line2D | Patch] = []
    look = {"marker": "o", "linestyle": "none", "markersize": 4.0, "markeredgewidth": 0.0}
    if others:
        handles.append(Line2D([], [], color=FAINT, alpha=0.6, label="as it was", **look))  # type: ignore[arg-type]
    if axis is None:
        words = "less the other findings" if others else "residual"
        handles.append(Line2D([], [], color=BLUE, label=words, **look))  # type: ignore[arg-type]
    else:
        for (_, colour), words in zip(SENSES, "+−", strict=True):
            handles.append(Line2D([], [], color=colour, label=f"{axis} moving in {words}", **look))  # type: ignore[arg-type]
    handles.append(Line2D([], [], color=INK, linewidth=1.5, label="the effect, less what geometry absorbed"))
    handles.append(Patch(color=FAINT, alpha=0.25, label="±2σ of the noise"))
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles))
