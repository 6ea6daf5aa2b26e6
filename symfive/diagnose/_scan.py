"""Effects with a parameter that must be found by a scan: periods, frequencies, instants, places.

Every family is a channel (how the readings answer to an axis, the tool, a ball) times a function of a coordinate that
depends on one nonlinear parameter. The numerator of the score is fᵀ(g·ρ) with ρ the twice whitened residual; it is
computed for a whole grid at once, and the peaks become exact candidates.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Run
from symfive.diagnose._channels import Channels, Finding, peaks
from symfive.diagnose._scores import Board
from symfive.diagnose._transients import bursts, resonances
from symfive.effects import Effect, make_effect
from symfive.effects.unknown import Unknown
from symfive.errors import InputError

__all__ = ["scan"]

Array = NDArray[np.float64]
PEAKS = 2
PER_CYCLE = 4
"""Steps in which a frequency is looked for, per change of one cycle over the campaign."""


def scan(board: Board) -> list[Finding]:
    """Peaks of all families for the residual of the board's fit; beside a tone and a period a cycle without a name."""
    channels = Channels(board)
    found: list[Finding] = []
    for family in (_periods, _tones, _cycles, _onsets, _shifts, _steps, resonances, bursts):
        for finding in family(channels):
            try:
                found.append(Finding(finding.effect.prepare(board.model.campaign), finding.looks))
            except InputError:
                continue
    return found


def _spectrum(coordinate: Array, answer: Array, origin: float, step: float, count: int) -> Array:
    """Σ answer·exp(-iωq) (count // 2 + 1,) at ω = 2πk/(count·step), by gridding and one FFT.

    The answer is shared linearly between the two neighbours on a grid of `step`; the loss of that, sinc², is undone.
    """
    position = (coordinate - origin) / step
    left = np.floor(position).astype(int)
    share = position - left
    grid = (
        np.bincount(left, answer * (1.0 - share), count)[:count] + np.bincount(left + 1, answer * share, count)[:count]
    )
    spectrum = np.fft.rfft(grid)
    return np.asarray(spectrum / np.sinc(np.arange(len(spectrum)) / count) ** 2)


def _grid(reach: float, shortest: float) -> tuple[float, int]:
    """Step and length of a grid that resolves the shortest period eightfold, padded to twice the reach."""
    step = shortest / 8.0
    return step, int(2 ** np.ceil(np.log2(2.0 * reach / step + 2.0)))


def _periods(channels: Channels) -> Iterator[Finding]:
    """Periodic transmission error: a tone in an axis' own coordinate, the same in all runs."""
    campaign = channels.campaign
    for axis in channels.axes:
        commands = [np.asarray(run.commands[axis]) for run in campaign.runs]
        changes = np.concatenate([np.abs(np.diff(c)) for c in commands])
        low = min(float(c.min()) for c in commands)
        reach = max(float(c.max()) for c in commands) - low
        shortest = 2.5 * float(np.median(changes[changes > 0.0]))
        if reach < 3.0 * shortest:
            continue
        step, count = _grid(reach, shortest)
        index = channels.axis_index(axis)
        total = np.zeros(count // 2 + 1, dtype=complex)
        power = 0.0
        for run, coordinate in zip(campaign.runs, commands, strict=True):
            total += _spectrum(coordinate, channels.answer(run, index), low, step, count)
            power += 0.5 * float(channels.power[run.id][:, index].sum())
        inverse = np.arange(len(total)) / (count * step)
        seen = (inverse >= 1.0 / reach) & (inverse <= 1.0 / shortest)
        score = np.where(seen, np.abs(total) ** 2 / max(power, 1e-300), 0.0)
        number = _fast(channels, axis) + 1
        looks = int(seen.sum()) // 2 + 1
        for rank, peak in enumerate(peaks(score, PEAKS)):
            if score[peak] > 0.0:
                period = 1.0 / float(inverse[peak])
                sigma = 0.5 * period**2 * float(inverse[1])
                yield Finding(make_effect("transmission_error", axis, period=period, period_sigma=sigma), looks)
                if rank == 0:
                    yield Finding(_cycle(period, 1.0 / float(inverse[1]), f"{FAST}{number}", axis, "axis"), looks)


def _tones(channels: Channels) -> Iterator[Finding]:
    """Vibration: a tone in time; its phase is not kept from run to run, so the runs' powers are added."""
    runs = [run for run in channels.campaign.runs if run.dynamic]
    if not runs:
        return
    longest = max(float(run.time[-1] - run.time[0]) for run in runs)
    shortest = max(2.0 * run.interval for run in runs)
    if longest < 8.0 * shortest:
        return
    step, count = _grid(longest, shortest)
    score = np.zeros(count // 2 + 1)
    for run in runs:
        for index in range(3):
            power = 0.5 * float(channels.power[run.id][:, index].sum())
            if power > 0.0:
                spectrum = _spectrum(np.asarray(run.time), channels.answer(run, index), float(run.time[0]), step, count)
                score += np.abs(spectrum) ** 2 / power
    frequency = np.arange(len(score)) / (count * step)
    seen = (frequency >= 4.0 / longest) & (frequency <= 0.98 / shortest)
    number = sum(e.id == "vibration" for e in channels.board.result.model.effects) + _fast(channels, "t") + 1
    tag = f"tone{number}" if number > 1 else ""  # a beat is two tones
    for peak in peaks(np.where(seen, score, 0.0), 1):
        rough = float(frequency[peak])
        exact, kept, tried = _in_phase(channels, runs, rough, 1.0 / longest)
        if kept > 0.5 * score[peak]:
            effect = make_effect("vibration", frequency_hz=exact, tag=tag)
            yield Finding(_cycle(1.0 / exact, _span(runs), f"{FAST}{number}"), int(seen.sum()) // 2 + tried)
        else:  # the runs' clocks do not hang together: the run that swings most
            strongest = max(runs, key=lambda run: _in_phase(channels, [run], rough, 0.0)[1])
            effect = make_effect("vibration", frequency_hz=rough, run=strongest.id, tag=tag)
        yield Finding(effect, int(seen.sum()) // 2 + tried)


def _in_phase(channels: Channels, runs: Sequence[Run], rough: float, reach: float) -> tuple[float, float, int]:
    """Best frequency within `reach` of a rough one for a tone that keeps its phase from run to run, its score, and how many
    were tried: over a campaign of length T they differ by a fraction of 1/T."""
    span = _span(runs)
    steps = math.ceil(PER_CYCLE * reach * span)
    frequencies = rough + np.arange(-steps, steps + 1) / max(PER_CYCLE * span, 1e-12)
    score = _coherent(channels, runs, frequencies)
    best = int(np.argmax(score))
    return float(frequencies[best]), float(score[best]), 2 * steps + 1


def _span(runs: Sequence[Run]) -> float:
    """Time from the first row of all runs to the last, s."""
    return max(run.start_s + float(run.time[-1]) for run in runs) - min(
        run.start_s + float(run.time[0]) for run in runs
    )


def _timed(channels: Channels) -> list[Run]:
    """The runs whose clock was recorded: all that can be said over time."""
    return [run for run in channels.campaign.runs if run.has_clock]


def _clocks(runs: Sequence[Run]) -> dict[str, Array]:
    """Run → its rows (N,) on the campaign's clock, s."""
    return {run.id: run.start_s + np.asarray(run.time) for run in runs}


def _coherent(channels: Channels, runs: Sequence[Run], frequencies: Array) -> Array:
    """The score of tones of the tool on the campaign's clock."""
    clocks = _clocks(runs)
    score = np.zeros(len(frequencies))
    for index in range(3):
        power = 0.5 * sum(float(channels.power[run.id][:, index].sum()) for run in runs)
        if power <= 0.0:
            continue
        total = np.zeros(len(frequencies), dtype=complex)
        for run in runs:
            clock, answer = clocks[run.id], channels.answer(run, index)
            for block in np.array_split(np.arange(len(frequencies)), max(1, len(frequencies) * len(clock) // 10**6)):
                total[block] += np.exp(-2j * np.pi * np.outer(frequencies[block], clock)) @ answer
        score += np.abs(total) ** 2 / power
    return score


FAST = "fast"
"""Begins the tag of a cycle as fast as a vibration, or of one over an axis."""
CYCLE_HARMONICS, FINE = 4, 8
"""Of a cycle; and steps in which its frequency is looked for, per change of one cycle over the campaign."""
FEWEST, MOST_CYCLES = 2.5, 16
"""Cycles in a campaign at least: of fewer it could as well be a drift; and peaks about which they are scored exactly."""


def _cycles(channels: Channels) -> Iterator[Finding]:
    """A cycle that is too slow for a vibration, over the campaign's clock: a cooler, a pump, the light of day. It has no name,
    but it can be foretold."""
    runs = _timed(channels)
    if not runs:
        return
    span = _span(runs)
    longest = max((run.duration for run in runs if run.dynamic), default=0.0)
    rows = sum(run.rows for run in runs)
    fastest = 4.0 / longest if longest > 0.0 else 0.25 * (rows - 1) / max(span, 1e-9)
    count = int(FINE * (fastest * span - FEWEST))
    if span <= 0.0 or count < FINE:
        return
    frequencies = (FEWEST + np.arange(count) / FINE) / span
    rough = peaks(_coherent(channels, runs, frequencies), MOST_CYCLES)
    # what the fit swallows moves the peaks
    near = np.unique(np.clip(np.add.outer(rough, np.arange(-FINE // 2, FINE // 2 + 1)), 0, count - 1))
    phases = {id: 2.0 * np.pi * np.outer(clock, frequencies[near]) for id, clock in _clocks(runs).items()}
    score = channels.tool_scores({id: np.stack([np.cos(p), np.sin(p)], axis=2) for id, p in phases.items()})
    best = float(frequencies[near[np.argmax(score)]])
    yield Finding(_cycle(1.0 / best, span, "cycle"), count // (FINE // PER_CYCLE))


def _fast(channels: Channels, over: str) -> int:
    """The number of fast cycles of a coordinate that the fit holds."""
    held = [e for e in channels.board.result.model.effects if isinstance(e, Unknown)]
    return sum(e.over == (over,) and e.tag.startswith(FAST) for e in held)


def _cycle(period: float, reach: float, tag: str, over: str = "t", place: str = "structure") -> Effect:
    """Whatever repeats itself after a period of a coordinate, of which the campaign covers so much."""
    return make_effect(
        "unknown", over=(over,), basis="fourier", order=CYCLE_HARMONICS, period=period,
        period_sigma=0.5 * period**2 / reach, place=place, tag=tag,
    )  # fmt: skip


ONSETS = 20
LASTS = (0.1, 0.3, 1.0)
"""Time constants of a drift that begins in mid-campaign, as shares of what is left of it."""


def _onsets(channels: Channels) -> Iterator[Finding]:
    """A thermal drift whose heat comes on at one instant of the campaign's clock; in a pause if it could as well be there."""
    runs = _timed(channels)
    if not runs:
        return
    clocks = _clocks(runs)
    rows = np.sort(np.concatenate(list(clocks.values())))
    span, end = float(np.ptp(rows)), float(rows[-1])
    within = np.unique(np.quantile(rows, np.linspace(0.05, 0.9, ONSETS)))
    before = np.flatnonzero(np.diff(rows) > span / ONSETS)
    begins = np.concatenate([within, 0.5 * (rows[before] + rows[before + 1])])
    sigmas = np.concatenate([np.full(len(within), 0.25 * span), (rows[before + 1] - rows[before]) / math.sqrt(12.0)])
    begins, sigmas = begins[begins < end], sigmas[begins < end]
    if not begins.size:
        return
    onset, tau = (x.ravel() for x in np.broadcast_arrays(begins[:, None], (end - begins[:, None]) * np.array(LASTS)))
    courses = {id: 1.0 - np.exp(-np.maximum(clock[:, None] - onset, 0.0) / tau) for id, clock in clocks.items()}
    scores = channels.tool_scores(courses).reshape(-1, len(LASTS)).max(axis=1)
    scores[len(within) :] += SLOWER
    best = int(np.argmax(scores))
    begin, sigma = float(begins[best]), float(sigmas[best])
    yield Finding(make_effect("thermal_drift", shape="delayed", onset_s=begin, onset_sigma_s=sigma), len(onset))


PLACES, CREEPS = 150, 30
LASTING = (0.05, 0.15, 0.5)
"""Time constants of a creep, as shares of a run."""
SLOWER = 10.0
"""What the square of the residual must fall further by if a shift is to be a creep: one more parameter, decisively."""
MOST_STEPS, NARROW = 100, 0.1


def _shifts(channels: Channels) -> Iterator[Finding]:
    """Set-up shift: the tool against the ball by a constant from one instant of one run on, at once or creeping."""
    best: tuple[float, Finding] | None = None
    for run in _timed(channels):
        if run.rows < 4 * _margin(run):
            continue
        score, at = _best_row(channels, run, PLACES, partial(_late, run))
        shape = "step"
        if score > SLOWER:
            for share in LASTING:
                creep, row = _best_row(channels, run, CREEPS, partial(_creep, run, share * run.duration))
                if creep > score + SLOWER * (shape == "step"):
                    score, at, shape = creep, row, "creep"
        instant = 0.5 * float(run.time[at - 1] + run.time[at])
        if best is None or score > best[0]:
            effect = make_effect("setup_shift", run=run.id, t_s=instant, shape=shape)
            best = score, Finding(effect, channels.campaign.rows)
    if best is not None:
        yield best[1]


def _best_row(
    channels: Channels, run: Run, places: int, courses: Callable[[NDArray[np.int64]], Array]
) -> tuple[float, int]:
    """The best score of a shift and the row where it begins: first of so many `places`, then of the rows about the best."""
    margin = _margin(run)
    stride = max(1, run.rows // places)
    rows = np.arange(margin, run.rows - margin, stride)
    found = channels.shift_scores(run, courses(rows))
    if stride > 1:
        middle, finer = int(rows[np.argmax(found)]), max(1, stride // places)
        rows = np.arange(max(margin, middle - stride), min(run.rows - margin, middle + stride + 1), finer)
        found = channels.shift_scores(run, courses(rows))
    return float(found.max()), int(rows[np.argmax(found)])


def _margin(run: Run) -> int:
    """Rows at the ends of a run where a shift could not be told from its set-up."""
    return max(3, run.rows // 50)


def _late(run: Run, rows: NDArray[np.int64]) -> Array:
    return np.asarray(np.arange(run.rows)[:, None] >= rows[None, :], dtype=float)


def _creep(run: Run, tau: float, rows: NDArray[np.int64]) -> Array:
    since = run.time[:, None] - run.time[rows][None, :]
    return np.asarray(1.0 - np.exp(-np.maximum(since, 0.0) / tau))


def _steps(channels: Channels) -> Iterator[Finding]:
    """A step of an axis' positioning error at one place."""
    for axis in channels.axes:
        ways = {run.id: np.asarray(run.commands[axis]) for run in channels.campaign.runs}
        ranked = np.sort(np.concatenate(list(ways.values())))
        apart = np.diff(ranked) > 1e-9 * max(float(np.ptp(ranked)), 1e-30)
        between = 1 + np.flatnonzero(apart)  # first row after a step
        inner = between[(between >= 0.05 * len(ranked)) & (between <= 0.95 * len(ranked))]
        if len(inner) < 5:
            continue
        inner = inner[np.unique(np.linspace(0, len(inner) - 1, min(len(inner), MOST_STEPS)).astype(int))]
        middles = 0.5 * (ranked[inner - 1] + ranked[inner])
        scores = channels.axis_scores(axis, {id: np.asarray(way[:, None] > middles, float) for id, way in ways.items()})
        first = int(inner[np.argmax(scores)])
        at, ramp = float(ranked[first - 1]), max(float(ranked[first] - ranked[first - 1]), NARROW)
        yield Finding(make_effect("table_step", axis, at=at, ramp=ramp), len(inner))
