"""Spectrum of the residuals: over frequency, and over order per revolution."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.fft import next_fast_len
from scipy.special import gammainccinv

from symfive.arrays import Array
from symfive.circles import CircleFinder
from symfive.disk import release
from symfive.drawing import INK, SERIES
from symfive.errors import InputError
from symfive.identify import Identification
from symfive.numbers import unit_words
from symfive.report._style import blank, footnote, plain_log, short, styled
from symfive.report._traces import Trace, by_panel, traces_of

LEVEL = 0.01
LEAST_ROWS = 64
BLOCK_ROWS = 1 << 14
STRETCH_ROWS, MOST_STRETCHES = 1 << 17, 8
"""A longer recording's spectrum is the mean of those of so many stretches of so many rows."""
MOST_ORDERS = 32
MOST_TURNED = 0.5
"""Of an order's wave, rad, over which a block may be averaged: it then shows 1 % too small (sinc)."""
MOST_RUNS = 12
LEAST_TURN = 0.9
PER_DECADE = 40
SWOLLEN = 2.0
"""An order counts while uneven angles swell its noise variance by no more than this over that of even ones."""
BESIDE = 0.6
"""Width, in orders, over which the stems of several runs stand beside each other."""


@styled
def residual_spectrum(identification: Identification, runs: str | Iterable[str] | None = None) -> Figure:
    """Amplitude of the residual: over frequency for recordings, over order per revolution for circles and turning axes.

    Columns of one instrument are added in squares; a long recording's spectrum is the mean of those of a few stretches (P. D.
    Welch 1967). The dashed line is what white noise of the declared size passes somewhere in one of a hundred spectra: peaks
    above it are real. Frequency: Hann window, one-sided amplitude. Order: least squares at whole orders of the circle's angle, or
    of the axis that turns by a whole turn, as many as the angles resolve. Raises `InputError` where no run is long enough.
    """
    groups = by_panel(traces_of(identification, runs))
    drawn = list(groups.items())[:MOST_RUNS]
    unit = drawn[0][0][1]
    drawn = [(key, traces) for key, traces in drawn if key[1] == unit]
    finder = CircleFinder(identification.model.machine)
    recorded = [
        (run, traces) for (run, _), traces in drawn if traces[0].run.dynamic and traces[0].run.rows >= LEAST_ROWS
    ]
    over_time = [(run, *_frequencies(traces)) for run, traces in recorded]
    turning = by_panel(traces_of(identification, {run for (run, _), _ in drawn}, drawn=True))
    over_turn = [(key[0], *found) for key, _ in drawn if (found := _orders(turning[key], finder)) is not None]
    panels = int(bool(over_time)) + int(bool(over_turn))
    if not panels:
        raise InputError(
            "no run is a recording or goes round",
            remedy=f"choose a run of at least {LEAST_ROWS} rows or of one revolution",
        )
    figure = blank(4.9 * panels + 0.4, 3.8)
    axes = list(figure.subplots(1, panels, squeeze=False)[0])
    colours = {run: SERIES[i % len(SERIES)] for i, ((run, _), _) in enumerate(drawn)}
    styles = {run: ("-", "--", ":")[i // len(SERIES) % 3] for i, ((run, _), _) in enumerate(drawn)}
    if over_time:
        _draw_frequencies(axes[0], over_time, colours, unit)
    if over_turn:
        _draw_orders(axes[-1], over_turn, colours, styles, unit)
    figure.suptitle("Spectrum of the residuals", x=0.01, ha="left")
    figure.legend(*axes[-1].get_legend_handles_labels(), loc="outside right upper")
    others = len(groups) - len(drawn)
    footnote(
        figure,
        "Dashed: exceeded by declared white noise in one spectrum of a hundred.",
        f"Over frequency: the highest line in each piece of 1/{PER_DECADE} decade." if over_time else "",
        f"Not drawn: {others} further runs or units." if others else "",
    )
    return figure


def _frequencies(traces: list[Trace]) -> tuple[Array, Array, float]:
    """Frequencies 1/s, amplitudes, and the threshold for declared noise.

    n lines of the mean of K spectra: the largest of white noise passes chi²(2K)/2K of its mean once in 1/`LEVEL` by the
    quantile `LEVEL`/n.
    """
    run = traces[0].run
    interval, rows = run.interval, min(run.rows, STRETCH_ROWS)
    firsts = np.unique(np.linspace(0, run.rows - rows, min(MOST_STRETCHES, run.rows // rows)).astype(int))
    count = min(round((float(run.time[first + rows - 1]) - float(run.time[first])) / interval) + 1 for first in firsts)
    window = np.hanning(count)
    padded = next_fast_len(4 * count, real=True)  # so that a tone between two lines keeps its size
    square = np.zeros(padded // 2 + 1)
    for first in firsts.tolist():
        time = np.array(run.time[first : first + rows])
        release(run.time)
        for trace in traces:
            residual, good = np.array(trace.residual[first : first + rows]), ~trace.outlier[first : first + rows]
            release(trace.residual)
            even = np.interp(time[0] + interval * np.arange(count), time[good], residual[good])
            square += np.abs(np.fft.rfft((even - even.mean()) * window, padded)) ** 2
    square *= 4.0 / window.sum() ** 2 / len(firsts)
    mean_square = sum(4.0 * t.noise.declared**2 * np.sum(window**2) / window.sum() ** 2 for t in traces)
    frequency = np.fft.rfftfreq(padded, interval)
    lowest = int(np.ceil(2.0 * padded / count))  # below two periods in the record the window sees only itself
    highest = gammainccinv(len(firsts), LEVEL / count) / len(firsts)
    return np.asarray(frequency[lowest:], dtype=float), np.sqrt(square[lowest:]), float(np.sqrt(mean_square * highest))


def _peaks(frequency: Array, amplitude: Array) -> tuple[Array, Array]:
    """The highest line in each fortieth of a decade."""
    group = np.unique(np.floor(PER_DECADE * np.log10(frequency)), return_index=True)[1]
    high = [first + int(np.argmax(part)) for first, part in zip(group, np.split(amplitude, group[1:]), strict=True)]
    return frequency[high], amplitude[high]


def _orders(traces: list[Trace], finder: CircleFinder) -> tuple[Array, Array, Array, str] | None:
    """Orders, amplitudes, their thresholds and what the order counts; None where nothing goes round or too few angles do.

    n rows at the angles φ, M = (1, cos φ, sin φ, …): white noise of variance σ² gives an order's two coefficients the
    covariance σ²·C, a block of (MᵀM)⁻¹; C = 2/n where the angles are even. Thresholds are from the larger eigenvalue of C.
    """
    found = _angle(traces[0], finder)
    if found is None:
        return None
    angle, over = found
    turns = float(np.ptp(angle)) / (2.0 * np.pi)
    good = np.all([np.isfinite(trace.kept) for trace in traces], axis=0)
    step = traces[0].step
    per_turn = len(np.unique(np.round(np.mod(angle[good], 2.0 * np.pi), 6)))
    most = int(min(MOST_ORDERS, (per_turn - 2) // 2, len(angle) // (4 * max(turns, 1.0)) + 1))
    if step > 1:
        most = min(most, int(MOST_TURNED / max(float(np.max(np.abs(np.diff(angle)))), 1e-9)))
    count = int(good.sum())
    normal, right = _sums(angle[good], [trace.residual[good] for trace in traces], max(most, 0))
    while most >= 1:
        size = 2 * most + 1
        swollen = _swollen(normal[:size, :size], count)
        if swollen.max() <= SWOLLEN:
            break
        most -= 1
    else:
        return None
    x = np.linalg.solve(normal[:size, :size], right[:size])
    square = np.sum(x[1::2] ** 2 + x[2::2] ** 2, axis=1)
    mean_square = sum(4.0 * t.noise.declared**2 / (count * step) for t in traces) * swollen
    orders = np.arange(1.0, most + 1.0)
    return orders, np.sqrt(square), np.sqrt(mean_square * np.log(most / LEVEL)), over


def _sums(angle: Array, residuals: list[Array], most: int) -> tuple[Array, Array]:
    """MᵀM (2·most+1, 2·most+1) and Mᵀr (2·most+1, columns), block by block: M of a long recording would not fit."""
    size = 2 * most + 1
    normal, right = np.zeros((size, size)), np.zeros((size, len(residuals)))
    for first in range(0, len(angle), BLOCK_ROWS):
        rows = slice(first, first + BLOCK_ROWS)
        turned = np.outer(angle[rows], np.arange(1, most + 1))
        matrix = np.ones((len(turned), size))
        matrix[:, 1::2], matrix[:, 2::2] = np.cos(turned), np.sin(turned)
        normal += matrix.T @ matrix
        right += matrix.T @ np.column_stack([residual[rows] for residual in residuals])
    return normal, right


def _swollen(normal: Array, count: int) -> Array:
    """Per order: the noise variance of its worse phase over that of even angles; infinite where angles leave it open."""
    if np.linalg.cond(normal) > 1e9:
        return np.full(len(normal) // 2, np.inf)
    inverse = np.linalg.inv(normal)
    blocks = [np.linalg.eigvalsh(inverse[i : i + 2, i : i + 2])[-1] for i in range(1, len(inverse), 2)]
    return 0.5 * count * np.array(blocks)


def _angle(trace: Trace, finder: CircleFinder) -> tuple[Array, str] | None:
    """The angle of the circle, else the coordinate of the rotary axis whose stations lie around a whole turn."""
    circle = finder.find(trace.run)
    if circle is not None and circle.turns >= LEAST_TURN:
        return circle.angle, circle.over
    for name, axis in finder.machine.axes.items():
        if axis.rotary:
            angle = np.radians(trace.run.commands[name])
            stations = np.unique(np.round(np.mod(angle, 2.0 * np.pi), 6))
            gaps = np.diff(stations, append=stations[0] + 2.0 * np.pi)
            if len(stations) >= 6 and gaps.max() < np.radians(75.0):
                return angle, f"coordinate of {name}"
    return None


def _draw_frequencies(
    axes: Axes, found: list[tuple[str, Array, Array, float]], colours: dict[str, str], unit: str
) -> None:
    for run, frequency, amplitude, _ in found:
        axes.plot(*_peaks(frequency, amplitude), color=colours[run], linewidth=0.9, label=short(run))
    level = max(threshold for *_, threshold in found)
    axes.axhline(level, color=INK, linewidth=0.9, linestyle="--")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(bottom=level / 10.0)
    plain_log(axes)
    axes.set_xlabel("frequency / (1/s)")
    axes.set_ylabel(f"amplitude / {unit_words(unit)}")
    axes.set_title("over frequency")


def _draw_orders(
    axes: Axes,
    found: list[tuple[str, Array, Array, Array, str]],
    colours: dict[str, str],
    styles: dict[str, str],
    unit: str,
) -> None:
    for k, (run, orders, amplitude, _, _) in enumerate(found):
        at = orders + BESIDE * (k - 0.5 * (len(found) - 1)) / max(len(found), 3)
        look = {"color": colours[run], "linestyle": styles[run], "linewidth": 0.8}
        axes.plot(at, amplitude, "o", color=colours[run], markersize=3.0)
        axes.vlines(at, 0.0, amplitude, colors=colours[run], linewidth=0.8)
        axes.plot([], [], marker="o", markersize=3.0, label=short(run), **look)  # type: ignore[arg-type]
    level = np.zeros(max(len(orders) for _, orders, *_ in found))
    for *_, threshold, _ in found:
        level[: len(threshold)] = np.maximum(level[: len(threshold)], threshold)
    edges = np.arange(len(level) + 1) + 0.5
    axes.stairs(level, edges, baseline=None, color=INK, linewidth=0.9, linestyle="--")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylim(bottom=0.0)
    over = " or ".join(dict.fromkeys(words for *_, words in found))
    axes.set_xlabel(f"order per revolution ({over})")
    axes.set_ylabel(f"amplitude / {unit_words(unit)}")
    axes.set_title("over order")
