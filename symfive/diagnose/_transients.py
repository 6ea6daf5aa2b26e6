"""Scans for what happens at instants: a structure that rings after the axis has accelerated, a burst in one run."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter
from scipy.stats import chi2

from symfive.campaign import Run
from symfive.diagnose._channels import Channels, Finding, peaks
from symfive.effects import make_effect
from symfive.motion import FINE_S, RunMotion

__all__ = ["bursts", "resonances"]

Array = NDArray[np.float64]
LOWEST_HZ, HIGHEST_HZ, SPACING, DAMPING = 5.0, 120.0, 1.08, 0.05
"""The ringing of a mode keeps in step with one whose frequency is off by its damping."""
PEAKS = 2
SHORTEST = 8
"""Rows of the shortest burst."""
LONGEST = 4
"""The longest one is a run's length over this."""
FINEST, ROWS_PER_INTERVAL = 60, 4
SHARE = 0.5
CLEAR = 4.0
"""σ by which a stretch stands out."""


def resonances(channels: Channels) -> Iterator[Finding]:
    """A mode excited by an axis: what it does beyond bending in proportion to the acceleration.

    That part is an inertial compliance; only the ringing tells a frequency.
    """
    runs = [run for run in channels.campaign.runs if run.dynamic]
    if not runs:
        return
    count = int(np.log(HIGHEST_HZ / LOWEST_HZ) / np.log(SPACING)) + 1
    frequencies = LOWEST_HZ * SPACING ** np.arange(count)
    for axis in channels.axes:
        answer, power = np.zeros((count, 3)), np.zeros((count, 3))
        for run in runs:
            if np.ptp(run.commands[axis]) == 0.0:
                continue
            motion = RunMotion(run, channels.campaign.machine, {}, {})
            acceleration, rows, step = motion.fine_acceleration(axis, FINE_S)
            for k, omega in enumerate(2.0 * np.pi * frequencies):
                swing = lfilter(*_mode(float(omega), step), acceleration.value)
                ringing = (swing + acceleration.value / omega**2)[rows]
                answer[k] += [ringing @ channels.answer(run, i) for i in range(3)]
                power[k] += ringing**2 @ channels.power[run.id][:, :3]
        score = np.sum(answer**2 / np.maximum(power, 1e-300), axis=1)
        for peak in peaks(score, PEAKS):
            if score[peak] > 0.0:
                yield Finding(make_effect("structural_resonance", axis, frequency_hz=float(frequencies[peak])), count)


@lru_cache(maxsize=1024)
def _mode(omega: float, step: float) -> tuple[Array, Array]:
    """The filter from the carrier's acceleration to a mode's swing: its numerator and denominator."""
    continuous = ([-1.0], [1.0, 2.0 * DAMPING * omega, omega**2])
    numerator, denominator, _ = cont2discrete(continuous, step, method="foh")
    return numerator.ravel(), denominator


def bursts(channels: Channels) -> Iterator[Finding]:
    """A stretch of one run that holds most of what is too large in all runs together, whatever its shape: a term without a
    name. What comes back at every reversal or place is no burst."""
    best: tuple[float, Run, int, int] | None = None
    tried, total = 0, 0.0
    excesses = _excesses(channels)
    for run in channels.campaign.runs:
        excess, unit = excesses[run.id]
        total += max(float(excess[-1]), 0.0)
        if not run.has_clock:
            continue
        length = SHORTEST
        while length <= run.rows // LONGEST:
            starts = np.arange(0, run.rows - length + 1, length // 4)
            score = (excess[starts + length] - excess[starts]) / (unit * np.sqrt(length))
            tried += len(starts)
            k = int(np.argmax(score))
            if best is None or score[k] > best[0]:
                best = float(score[k]), run, int(starts[k]), int(starts[k]) + length
            length *= 2
    if best is None or best[0] < CLEAR:
        return
    _, run, first, last = best
    excess, unit = excesses[run.id]
    piece = max(SHORTEST // 2, (last - first) // 4)
    pieces = [piece, 2 * piece]  # what rings passes through zero
    while (more := next((n for n in pieces if _clear(excess, unit, first - n, first)), 0)) > 0:
        first = max(first - more, 0)
    while (more := next((n for n in pieces if _clear(excess, unit, last, last + n)), 0)) > 0:
        last = min(last + more, run.rows)
    while last - first > 2 * piece and not _clear(excess, unit, last - piece, last):
        last -= piece
    while last - first > 2 * piece and not _clear(excess, unit, first, first + piece):
        first += piece
    first, last = (0 if first < piece else first), (run.rows if run.rows - last < piece else last)
    if excess[last] - excess[first] < SHARE * total:
        return
    clock = run.start_s + run.time
    span = ((float(clock[first]), float(clock[last - 1])),)
    order = int(np.clip((last - first) // ROWS_PER_INTERVAL, 4, FINEST))
    place = "reading" if len(channels.board.result.model.columns(run)) == 1 else "structure"
    options: dict[str, Any] = {"order": order, "place": place, "only_within": True, "tag": "burst"}
    yield Finding(make_effect("unknown", over=("t",), span=span, **options), tried)


def _clear(excess: Array, unit: float, first: int, last: int) -> bool:
    """Whether the rows from `first` to before `last` stand out."""
    first, last = max(first, 0), min(last, len(excess) - 1)
    return bool(last > first and excess[last] - excess[first] > CLEAR * unit * np.sqrt(last - first))


def _excesses(channels: Channels) -> dict[str, tuple[Array, float]]:
    """Of every run the running sum (N + 1,) of the residual's square over its usual size, less 1, and the 1σ that noise gives
    one row.

    Usual is the run's median: half of a run may be unusual, but then it is not more than that of half of the runs.
    """
    energies = {run.id: channels.energy(run) for run in channels.campaign.runs}
    share = {id: float(np.median(e) / chi2.median(k)) if k else 0.0 for id, (e, k) in energies.items()}
    common = float(np.median([share[id] for id, (_, k) in energies.items() if k] or [0.0]))
    found = {}
    for id, (energy, columns) in energies.items():
        usual = columns * min(share[id], common)
        if usual > 0.0:
            found[id] = np.append(0.0, np.cumsum(energy / usual - 1.0)), float(np.sqrt(2.0 / columns))
        else:
            found[id] = np.zeros(len(energy) + 1), 1.0
    return found
