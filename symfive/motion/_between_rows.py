"""What is commanded between the rows of a run, and before the first one where its recording begins in motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from symfive.arrays import Array, Indices
from symfive.motion._gaps import filled

if TYPE_CHECKING:
    from symfive.runs import Run

LATE_S = 5e-3
"""Instants between which a drive's motion is a cubic of position and velocity: a fourth of a fast loop's time constant."""
LEAD_S, LEAD_ROWS = 0.5, 5
"""Ten time constants of a slow position loop (20 1/s); rows that say how the motion goes on backwards."""

_THINNED: WeakKeyDictionary[Run, dict[int, tuple[Run, ...]]] = WeakKeyDictionary()


def instants(run: Run) -> int:
    """How many instants of an interval tell how an axis moves between its rows."""
    return max(1, int(np.ceil(run.interval / LATE_S - 1e-9)))


def is_curved(run: Run) -> bool:
    """Whether the axes are commanded along a smooth curve between rows, as by a control that interpolates a circle."""
    return run.options.get("between") == "curve" and run.rows > 3


def is_moving(run: Run) -> bool:
    """Whether a recording begins and ends in motion."""
    return run.options.get("start") == "moving"


def is_told_by_rows(run: Run) -> bool:
    """Whether the axes follow a curve between the rows of a run, of which these are all that is known."""
    return run.dynamic and is_curved(run) and not run.pieces and not run.encoder_is_motion


def thinned(run: Run, spacing: int) -> tuple[Run, ...]:
    """The run as its ends and every second, fourth … row tell how it was commanded: from the first row on, from the second, …"""
    kept = _THINNED.setdefault(run, {})
    if spacing not in kept:
        kept[spacing] = tuple(_through(run, np.arange(first, run.rows, spacing)) for first in range(spacing))
    return kept[spacing]


def begun_before(run: Run) -> Run | None:
    """The run as if the axes had been in motion before, where they move from the first row on and nothing is stated."""
    if "start" in run.options or all(way[0] == way[1] for way in run.commands.values()):
        return None
    return replace(run, options={**run.options, "start": "moving"})


def _through(run: Run, rows: Indices) -> Run:
    """The run as these rows and its ends tell how it was commanded."""
    from scipy.interpolate import CubicSpline

    known, steps = np.unique(np.concatenate([[0], rows, [run.rows - 1]])), run.steps
    moved = {name: way for name, way in run.commands.items() if np.ptp(way)}
    curves = {name: CubicSpline(steps[known], way[known])(steps) for name, way in moved.items()}
    return replace(run, commands={**run.commands, **curves})


def along_the_curve(run: Run, factor: int, respond: Callable[[int], Array]) -> Array:
    """The response to what is commanded, from `respond` to chords of so many instants per interval, `factor` to begin with.

    Responses to chords of h and h/2 lie off that to a curve by h²/12 of its second derivative on the mean (L. F. Richardson
    1911).
    """
    response = respond(factor)
    return (4.0 * respond(2 * factor) - response) / 3.0 if is_curved(run) else response


def finer(run: Run, column: Array, factor: int) -> tuple[Array, int]:
    """What is commanded at `factor` instants per interval, without gaps, with what came before and what comes after, which an
    early clock sees, and the place of the first row."""
    if len(column) != run.steps[-1] + 1:
        column = _whole(run.steps.tobytes(), np.ascontiguousarray(column).tobytes())
    before, after = lead(run, column), lead(run, column[::-1])[::-1]
    column, first = np.concatenate([before, column, after]), len(before)
    if factor == 1:
        return column, first
    at, rows = np.arange((len(column) - 1) * factor + 1) / factor, np.arange(len(column))
    if not is_curved(run):
        return np.interp(at, rows, column), first * factor
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(rows, column)(at)), first * factor


def pieces_of(run: Run, column: Array) -> tuple[Array, int]:
    """What is commanded between rows without gaps, as `finer` says: cubics (4, N - 1) by powers of the time since the row, s, and
    the place of the first row."""
    column, first = finer(run, column, 1)
    if not is_curved(run):
        still = np.zeros(len(column) - 1)
        return np.stack([column[:-1], np.diff(column) / run.interval, still, still]), first
    from scipy.interpolate import CubicSpline

    return np.array(CubicSpline(run.interval * np.arange(len(column)), column).c[::-1]), first


def lead(run: Run, command: Array) -> Array:
    """What a programme commanded before the first row where the recording begins in motion (`start = "moving"`): its first rows
    carried on backwards as a polynomial, for so long that the drive has forgotten how that began."""
    if not is_moving(run) or len(command) < LEAD_ROWS:
        return np.zeros(0)
    count = int(np.ceil(LEAD_S / run.interval))
    stride = min(max(1, count // (4 * LEAD_ROWS)), (len(command) - 1) // (LEAD_ROWS - 1))
    return np.asarray(_backwards(count, stride) @ command[: stride * LEAD_ROWS : stride])


@lru_cache(maxsize=16)
def _backwards(count: int, stride: int) -> Array:
    """What the polynomial through rows 0, `stride`, … (`LEAD_ROWS` of them) is in so many rows before these (count,
    LEAD_ROWS): its Lagrange polynomials."""
    at, rows = np.arange(-count, 0)[:, None] / stride, np.arange(LEAD_ROWS)
    apart = [[(at - j) / (k - j) for j in rows if j != k] for k in rows]
    return np.hstack([np.prod(factors, axis=0) for factors in apart])


def between(response: Array, place: Array, interval: float) -> tuple[Array, Array]:
    """A drive's motion (N, 3, m) between its instants, `interval` s apart, at the `place` (n,) of each, and its change in a
    second: both (n, 3, m). Position and velocity are cubic, by their own slopes; beyond the ends the axis stands."""
    inside = (place >= 0.0) & (place <= len(response) - 1.0)
    place = np.clip(place, 0.0, len(response) - 1.0)
    row = np.minimum(place.astype(np.int64), len(response) - 2)
    s = (place - row)[:, None, None]
    before, after = response[row], response[row + 1]
    rate = after - before
    motion = before + s * rate
    step = rate[:, :2].copy()
    left, right = interval * before[:, 1:] - step, step - interval * after[:, 1:]
    bent = (1.0 - s) * left + s * right
    motion[:, :2] += s * (1.0 - s) * bent
    rate[:, :2] += (1.0 - 2.0 * s) * bent + s * (1.0 - s) * (right - left)
    return motion, rate * (inside / interval)[:, None, None]


@lru_cache(maxsize=128)
def _whole(steps: bytes, command: bytes) -> Array:
    """`filled`, remembered: a recording's gaps stay the same."""
    full = filled(np.frombuffer(steps, dtype=np.int64), np.frombuffer(command))
    full.flags.writeable = False
    return full
