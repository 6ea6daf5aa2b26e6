"""Effects with a parameter that must be found by a scan: periods, frequencies, instants, places.

Every family is a channel (how the readings answer to an axis, the tool, a ball) times a function of a coordinate that
depends on one nonlinear parameter. The numerator of the score is fᵀ(g·ρ) with ρ the twice whitened residual; it is
computed for a whole grid at once, and the peaks become exact candidates.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign, Run
from symfive.diagnose._catalogue import AxisOffset, ToolShift, moving_axes
from symfive.diagnose._scores import Board
from symfive.effects import Effect, make_effect
from symfive.errors import InputError
from symfive.identify._noise import Noise, whiten
from symfive.instruments import instruments_of

__all__ = ["Finding", "probes", "scan"]

Array = NDArray[np.float64]
BATCH = 256
PEAKS = 2


@dataclass(frozen=True)
class Finding:
    """A peak of a scan: the exact effect, and how many independent places were looked at."""

    effect: Effect
    looks: int


def probes(campaign: Campaign) -> list[Effect]:
    """The channels: the tool's three directions and every moving axis."""
    return [ToolShift(), *(AxisOffset(axis=name) for name in moving_axes(campaign))]


def scan(board: Board) -> list[Finding]:
    """Peaks of all families for the residual of the board's fit."""
    channels = _Channels(board)
    found: list[Finding] = []
    for family in (_periods, _tones, _shifts, _steps):
        for finding in family(channels):
            try:
                found.append(Finding(finding.effect.prepare(board.model.campaign), finding.looks))
            except InputError:
                continue
    return found


class _Channels:
    """Per run: the channels' columns, and the residual whitened twice."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self.campaign = board.model.campaign
        self.axes = moving_axes(self.campaign)
        self.twice: dict[str, Array] = {}
        self.power: dict[str, Array] = {}
        for run in self.campaign.runs:
            residual = np.asarray(board.result.residuals[run.id])
            for outlier in board.result.outliers:
                if outlier.run == run.id:
                    names = [c.name for c in board.result.model.columns(run)]
                    residual = residual.copy()
                    residual[outlier.row, names.index(outlier.column)] = 0.0
            self.twice[run.id] = _twice(residual, self.noise(run), _interval(run))
            tangent = board.tangents[run.id]
            white, _ = whiten(tangent, self.noise(run), _interval(run))
            self.power[run.id] = np.sum(white**2, axis=1)

    def noise(self, run: Run) -> Noise:
        """Noise of the run's first instrument (a board works on one instrument a run)."""
        return self.board.result.noises[run.id, instruments_of(run)[0].name]

    def answer(self, run: Run, index: int) -> Array:
        """g·ρ summed over the columns (N,), for the channel at `index`."""
        return np.einsum("nc,nc->n", self.board.tangents[run.id][:, :, index], self.twice[run.id])

    def axis_index(self, axis: str) -> int:
        """Where an axis' channel stands."""
        return 3 + self.axes.index(axis)


def _interval(run: Run) -> float:
    return float(np.median(np.diff(run.time))) if run.rows > 1 else 1.0


def _twice(residual: Array, noise: Noise, interval: float) -> Array:
    forward, _ = whiten(residual, noise, interval)
    backward, _ = whiten(forward[::-1], noise, interval)
    return backward[::-1]


def _spectrum(coordinate: Array, answer: Array, power: Array, frequencies: Array) -> tuple[Array, Array, Array]:
    """(cos numerator, sin numerator, denominator) over a grid of angular frequencies."""
    cos, sin = np.empty(len(frequencies)), np.empty(len(frequencies))
    step = max(1, BATCH * 4096 // max(len(coordinate), 1))
    for first in range(0, len(frequencies), step):
        part = slice(first, first + step)
        phase = np.outer(coordinate, frequencies[part])
        cos[part], sin[part] = answer @ np.cos(phase), answer @ np.sin(phase)
    return cos, sin, np.full(len(frequencies), 0.5 * float(power.sum()))


def _peaks(score: Array, count: int = PEAKS) -> list[int]:
    """Highest local maxima."""
    inner = np.flatnonzero((score >= np.roll(score, 1)) & (score >= np.roll(score, -1)))
    return [int(i) for i in inner[np.argsort(-score[inner])][:count]]


def _periods(channels: _Channels) -> Iterator[Finding]:
    """Periodic transmission error: a tone in an axis' own coordinate, the same in all runs."""
    campaign = channels.campaign
    for axis in channels.axes:
        spans = [np.ptp(run.commands[axis]) for run in campaign.runs]
        steps = [np.median(np.abs(np.diff(run.commands[axis]))[np.diff(run.commands[axis]) != 0.0])
                 for run in campaign.runs if np.ptp(run.commands[axis]) > 0.0]  # fmt: skip
        reach = float(max(np.concatenate([run.commands[axis] for run in campaign.runs]))
                      - min(np.concatenate([run.commands[axis] for run in campaign.runs])))  # fmt: skip
        shortest = 2.5 * float(np.median(steps))
        if max(spans) <= 0.0 or reach / shortest < 3.0:
            continue
        count = int(min(3.0 * reach / shortest, 6000))
        inverse = np.linspace(1.0 / reach, 1.0 / shortest, count)
        if not any(run.dynamic for run in campaign.runs):
            inverse = inverse[inverse <= 0.5 / float(np.median(steps))]
        total = np.zeros((3, len(inverse)))
        for run in campaign.runs:
            index = channels.axis_index(axis)
            coordinate = np.asarray(run.commands[axis])
            parts = _spectrum(coordinate, channels.answer(run, index), channels.power[run.id][:, index], 2 * np.pi * inverse)
            total += np.stack(parts)
        score = (total[0] ** 2 + total[1] ** 2) / np.maximum(total[2], 1e-300)
        for peak in _peaks(score):
            period = 1.0 / inverse[peak]
            sigma = 0.5 * period**2 * (inverse[1] - inverse[0]) if len(inverse) > 1 else 0.0
            effect = make_effect("transmission_error", axis, period=float(period), period_sigma=float(max(sigma, 1e-4 * period)))
            yield Finding(effect, max(1, len(inverse) // 2))


def _tones(channels: _Channels) -> Iterator[Finding]:
    """Vibration: a tone in time; its phase is not kept from run to run, so the runs' powers are added."""
    runs = [run for run in channels.campaign.runs if run.dynamic]
    if not runs:
        return
    longest = max(run.time[-1] - run.time[0] for run in runs)
    highest = min(0.5 / _interval(run) for run in runs)
    count = int(min(2.0 * highest * longest, 8000))
    if count < 4:
        return
    frequencies = np.linspace(max(0.5, 4.0 / longest), 0.98 * highest, count)
    score = np.zeros(count)
    for run in runs:
        for index in range(3):
            power = channels.power[run.id][:, index]
            if power.sum() <= 0.0:
                continue
            cos, sin, scale = _spectrum(run.time, channels.answer(run, index), power, 2 * np.pi * frequencies)
            score += (cos**2 + sin**2) / np.maximum(scale, 1e-300)
    for peak in _peaks(score, 1):
        yield Finding(make_effect("vibration", frequency_hz=float(frequencies[peak])), count // 2)


def _shifts(channels: _Channels) -> Iterator[Finding]:
    """Set-up shift: the tool against the ball by a constant from one instant of one run on."""
    best: tuple[float, Finding] | None = None
    for run in channels.campaign.runs:
        if run.rows < 12:
            continue
        answers = np.stack([channels.answer(run, i) for i in range(3)], axis=1)
        power = channels.power[run.id][:, :3]
        after = np.cumsum(answers[::-1], axis=0)[::-1]
        left = np.cumsum(power[::-1], axis=0)[::-1]
        share = left / np.maximum(power.sum(axis=0), 1e-300)
        # what a constant over the whole run explains belongs to the set-up: the variance left is share·(1 - share)
        score = np.sum(np.where(power.sum(axis=0) > 0, after**2 / np.maximum(left * (1.0 - share), 1e-300), 0.0), axis=1)
        margin = max(3, run.rows // 50)
        at = margin + int(np.argmax(score[margin : run.rows - margin]))
        instant = 0.5 * float(run.time[at - 1] + run.time[at])
        finding = Finding(make_effect("setup_shift", run=run.id, t_s=instant), channels.campaign.rows)
        if best is None or score[at] > best[0]:
            best = (float(score[at]), finding)
    if best is not None:
        yield best[1]


def _steps(channels: _Channels) -> Iterator[Finding]:
    """A step of an axis' positioning error at one place."""
    campaign = channels.campaign
    for axis in channels.axes:
        index = channels.axis_index(axis)
        where = np.concatenate([run.commands[axis] for run in campaign.runs])
        answer = np.concatenate([channels.answer(run, index) for run in campaign.runs])
        power = np.concatenate([channels.power[run.id][:, index] for run in campaign.runs])
        order = np.argsort(where, kind="stable")
        places = np.unique(np.quantile(where, np.linspace(0.05, 0.95, 200)))
        if len(places) < 5 or power.sum() <= 0.0:
            continue
        after = np.cumsum(answer[order][::-1])[::-1]
        left = np.cumsum(power[order][::-1])[::-1]
        share = left / power.sum()
        score = after**2 / np.maximum(left * (1.0 - share), 1e-300)
        index_of = np.searchsorted(where[order], places)
        at = int(index_of[np.argmax(score[np.minimum(index_of, len(score) - 1)])])
        yield Finding(make_effect("table_step", axis, at=float(where[order][min(at, len(order) - 1)])), len(places))
