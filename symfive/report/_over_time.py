"""Residuals over time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from symfive.arrays import Array, Flags
from symfive.drawing import FAINT, INK, SERIES
from symfive.identify import Identification
from symfive.numbers import plain_number, unit_words
from symfive.report._style import blank, footnote, short, styled
from symfive.report._traces import Trace, by_panel, limit_of, running_mean, spread, traces_of

FEW_ROWS = 100
"""Runs of fewer rows are drawn as single readings: a line between them would show nothing that was measured."""
APART = 0.24
"""By which the columns of a reading stand beside each other, in poses."""
TIPPED_ROWS = 3000
MOST_PANELS = 24
MOST_POINTS = 12_000
PIECES = 1500
"""Of a line, each drawn by its lowest and highest reading: one a pixel."""
NAMED_OUTLIERS = 3


@styled
def residuals_over_time(identification: Identification, runs: str | Iterable[str] | None = None) -> Figure:
    """Residual of every reading, run by run, on one common scale per unit.

    Recordings: pale each reading, strong their running mean, in which anything but noise stands out. Static runs: a point
    for each pose. Grey: ±2σ of the noise that the run declares; dotted: ±2σ of the noise that the fit found, where it is
    larger; ringed: outliers, which the fit excluded (at the edge, with their value, where they lie outside the panel).
    """
    panels = by_panel(traces_of(identification, runs, drawn=True))
    drawn = list(panels.items())[:MOST_PANELS]
    every = [trace for _, traces in drawn for trace in traces]
    columns = 1 if len(drawn) <= 3 else 2 if len(drawn) <= 12 else 3
    rows = -(-len(drawn) // columns)
    figure = blank(9.0, max(2.6, 1.45 * rows + 1.0))
    grid = figure.subplots(rows, columns, squeeze=False)
    limits = {unit: limit_of([trace for trace in every if trace.unit == unit]) for unit in {t.unit for t in every}}
    steps = {1}
    tipped = sum(trace.run.rows for trace in every if not trace.run.dynamic) <= TIPPED_ROWS
    alike = len({trace.run.dynamic for trace in every}) == 1
    for place, ((run, unit), traces) in enumerate(drawn):
        axes = grid[place // columns, place % columns]
        steps.add(_draw(axes, traces, limits[unit]))
        if tipped and not traces[0].run.dynamic:
            figure.tips |= _tips(traces, limits[unit])
        axes.set_title(short(run, 48))
        axes.set_ylim(-limits[unit], limits[unit])
        axes.set_ylabel(unit_words(unit))
        if place + columns >= len(drawn) or not alike:
            axes.set_xlabel("time in the run / s" if traces[0].run.dynamic else "number of the pose")
    for place in range(len(drawn), rows * columns):
        grid[place // columns, place % columns].set_visible(False)
    recorded = [trace for trace in every if trace.run.dynamic]
    figure.suptitle("Residuals over time" if recorded else "Residuals, pose by pose", x=0.01, ha="left")
    _legend(figure, every, limits)
    pieces = max((trace.step * trace.piece(PIECES) for trace in recorded), default=1)
    footnote(
        figure,
        f"Drawn: one row in {max(steps)} of long runs; all rows count in the fit." if max(steps) > 1 else "",
        f"Pale: the lowest and the highest of every {pieces} readings; all count in the means and in the fit."
        if pieces > 1
        else "",
        f"Drawn: the first {MOST_PANELS} of {len(panels)} panels." if len(panels) > MOST_PANELS else "",
    )
    return figure


def _draw(axes: Axes, traces: list[Trace], limit: float) -> int:
    noise = traces[0].noise
    axes.axhspan(-2 * noise.declared, 2 * noise.declared, color=FAINT, alpha=0.16, linewidth=0)
    if noise.total > 1.05 * noise.declared:
        for side in (-2.0, 2.0):
            axes.axhline(side * noise.total, color=FAINT, linewidth=0.9, linestyle=":")
    step = 1
    for k, (trace, colour) in enumerate(zip(traces, _colours(traces), strict=True)):
        at, kept = _across(traces, k), trace.kept
        if len(at) >= FEW_ROWS and trace.run.dynamic:
            rows, values = trace.envelope(PIECES)
            axes.plot(at[rows], values, color=colour, alpha=0.35, linewidth=0.5, rasterized=True)
            index, means = spread(len(at), 400)[0], running_mean(kept, max(5, len(kept) // 100))
            axes.plot(at[index], means[index], color=colour, linewidth=1.3)
        else:
            index, step = spread(len(at), MOST_POINTS)
            inside = index[_shown(kept, limit)[index]]
            if len(at) < FEW_ROWS:
                axes.vlines(at[inside], 0.0, kept[inside], color=colour, linewidth=0.8, alpha=0.55)
            size = 4.0 if len(at) < FEW_ROWS else 2.4
            (dots,) = axes.plot(at[inside], kept[inside], "o", color=colour, markersize=size, markeredgewidth=0.0)
            dots.set_gid(_name(trace))
        _outliers(axes, trace, at, limit, colour)
    if not traces[0].run.dynamic:
        axes.axhline(0.0, color=INK, linewidth=0.6)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.margins(x=0.01 if traces[0].run.dynamic else 0.02)
    return step


def _across(traces: Sequence[Trace], k: int) -> Array:
    """Abscissae of the k-th column: time in a recording, else the pose's number, of few poses side by side."""
    run = traces[k].run
    if run.dynamic:
        return run.time
    beside = APART * (k - 0.5 * (len(traces) - 1)) if run.rows < FEW_ROWS else 0.0
    return np.arange(1.0, run.rows + 1.0) + beside


def _shown(values: Array, limit: float) -> Flags:
    return np.isfinite(values) & (np.abs(values) <= limit)


def _name(trace: Trace) -> str:
    return f"tip-{trace.run.id}-{trace.column}"


def _tips(traces: Sequence[Trace], limit: float) -> dict[str, list[str]]:
    """By drawn column: pose, line of the file, positions of the rotary axes, residual."""
    found = {}
    for trace in traces:
        said = []
        for row in np.flatnonzero(_shown(trace.kept, limit)).tolist():
            turned = ", ".join(
                f"{n} {plain_number(v[row], 'deg')}°" for n, v in trace.run.commands.items() if n in "ABC"
            )
            pose, left = trace.said(row)
            said.append(f"{pose}: {turned}{': ' if turned else ''}{left}")
        found[_name(trace)] = said
    return found


def _outliers(axes: Axes, trace: Trace, across: Array, limit: float, colour: str) -> None:
    far = trace.farthest
    rows = np.flatnonzero(trace.outlier)
    outside = np.abs(far) > limit
    inside = rows[~outside[rows]]
    ring = {"markerfacecolor": "none", "markeredgecolor": INK, "markersize": 7.0, "linestyle": "none"}
    if inside.size:
        at, value = across[inside], trace.residual[inside]
        axes.plot(at, value, marker="o", clip_on=False, **ring)  # type: ignore[arg-type]
        axes.plot(at, value, ".", color=colour, markersize=3.0)
    beyond = np.flatnonzero(outside)
    for up, marker in ((True, "^"), (False, "v")):
        for left_out, edge in ((True, INK), (False, colour)):
            chosen = beyond[((far > 0) == up)[beyond] & (trace.outlier[beyond] == left_out)]
            height = np.full(len(chosen), 0.93 * limit if up else -0.93 * limit)
            axes.plot(across[chosen], height, marker, color=colour, markeredgecolor=edge, markersize=5.0)
    late = across.min() + 0.85 * np.ptp(across)  # beside the panel's right edge a number would be cut
    for row in _apart(sorted(beyond.tolist(), key=lambda r: -abs(far[r])), across):
        left = bool(across[row] > late)
        axes.annotate(
            plain_number(far[row], trace.unit),
            (float(across[row]), float(np.copysign(0.93 * limit, far[row]))),
            fontsize=7,
            va="center",
            ha="right" if left else "left",
            xytext=(-6 if left else 6, 0),
            textcoords="offset points",
            in_layout=False,
        )


def _apart(rows: list[int], across: Array) -> list[int]:
    """The first few of the rows that are far enough from each other for their values to be legible."""
    named: list[int] = []
    for row in rows:
        if len(named) < NAMED_OUTLIERS and all(
            abs(across[row] - across[other]) > 0.08 * np.ptp(across) for other in named
        ):
            named.append(row)
    return named


def _colours(traces: list[Trace]) -> list[str]:
    return [SERIES[i % len(SERIES)] for i in range(len(traces))]


def _legend(figure: Figure, traces: list[Trace], limits: Mapping[str, float]) -> None:
    handles: list[Line2D | Patch] = []
    labels: dict[str, list[str]] = {}
    for group in by_panel(traces).values():
        for trace, colour in zip(group, _colours(group), strict=True):
            same = labels.setdefault(colour, [])
            same += [trace.label] if trace.label not in same else []
    if all(len(names) <= 3 for names in labels.values()):
        handles += [Line2D([], [], color=colour, label=", ".join(names)) for colour, names in labels.items()]
    handles.append(Patch(color=FAINT, alpha=0.25, label="±2σ of the declared noise"))
    if any(trace.noise.total > 1.05 * trace.noise.declared for trace in traces):
        handles.append(Line2D([], [], color=FAINT, linestyle=":", label="±2σ of the noise found"))
    if any(trace.outlier.any() for trace in traces):
        ring = {"marker": "o", "markerfacecolor": "none", "markeredgecolor": INK, "linestyle": "none"}
        handles.append(Line2D([], [], label="excluded outlier", **ring))  # type: ignore[arg-type]
    if any(np.any(np.abs(trace.farthest) > limits[trace.unit]) for trace in traces):
        edge = Line2D([], [], marker="^", color=SERIES[0], linestyle="none", markersize=5.0, label="beyond the panel")
        handles.append(edge)
    figure.legend(handles=handles, loc="outside upper right", ncols=min(len(handles), 5))
