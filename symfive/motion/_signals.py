"""Signals: what an effect or an instrument needs along a run beside the positions of the axes.

A signal is a small hashable description; `series` computes its values along a run and its exact derivatives with
respect to the parameters it depends on. What has memory (play, direction of approach, a resonance) lives here;
everything else is written symbolically in the row.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from symfive.arrays import Array, Indices
from symfive.motion._between_rows import is_curved
from symfive.motion._loop import linear_recurrence
from symfive.motion._motion import RunMotion, Series

LONG_AGO_S = FAR = 1e6
"""Before the first reversal an axis counts as far from one, in s and in mm or rad."""
FINE_S = 2e-3
"""Interval at which accelerations are taken: loops answer within a few ms."""


@dataclass(frozen=True)
class _OfAxis:
    axis: str

    @property
    def parameters(self) -> tuple[str, ...]:
        return ()


class Position(_OfAxis):
    """Position behind the drive's encoder, mm or rad."""

    def series(self, motion: RunMotion) -> Series:
        return motion.axis(self.axis).position


class Command(_OfAxis):
    """Commanded position, mm or rad."""

    def series(self, motion: RunMotion) -> Series:
        return motion.axis(self.axis).command


@dataclass(frozen=True)
class SpindleAngle:
    """How far the spindle is turned at each row, rad."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """None."""
        return ()

    def series(self, motion: RunMotion) -> Series:
        """Angles (N,); 0 where the run says none."""
        turned = motion.run.spindle
        return Series(np.zeros(motion.run.rows) if turned is None else np.radians(turned), steps=True)


class Velocity(_OfAxis):
    """Velocity behind the drive, mm/s or rad/s."""

    def series(self, motion: RunMotion) -> Series:
        return motion.axis(self.axis).velocity


class Acceleration(_OfAxis):
    """Acceleration behind the drive, mm/s² or rad/s²."""

    def series(self, motion: RunMotion) -> Series:
        return motion.axis(self.axis).acceleration


def approach(positions: Array) -> Array:
    """Sign of the last motion at each row; rows before the first motion count as approached like the first one."""
    change = np.diff(positions)
    signs = np.where(np.abs(change) > _resolution(positions), np.sign(change), 0.0)
    moved = np.flatnonzero(signs)
    if not moved.size:
        return np.zeros_like(positions)
    last = np.maximum.accumulate(np.where(signs != 0.0, np.arange(len(signs)), -1))
    filled = signs[np.where(last < 0, moved[0], last)]
    return np.concatenate([filled[:1], filled])


@dataclass(frozen=True)
class Direction(_OfAxis):
    """Direction of the last motion, -1 or +1.

    `start` names what it counts as before the axis' first motion in a run; where the run has none, the first motion's (0: the
    axis never moves).
    """

    start: str = ""

    @property
    def parameters(self) -> tuple[str, ...]:
        """The state at the start."""
        return (self.start,) if self.start else ()

    def series(self, motion: RunMotion) -> Series:
        positions = motion.axis(self.axis).position.value
        return _begun(motion, positions, approach(positions), self.start)


def unmoved(positions: Array) -> int:
    """How many rows an axis stands at the beginning before it first moves; all where it never does."""
    moved = np.flatnonzero(np.abs(np.diff(positions)) > _resolution(positions))
    return int(moved[0]) + 1 if moved.size else len(positions)


def _resolution(positions: Array) -> float:
    """Changes up to this are rounding."""
    return 1e-12 * max(1.0, float(np.abs(positions).max()))


def _begun(motion: RunMotion, positions: Array, side: Array, start: str) -> Series:
    """Sides that count as the parameter `start` says, if the run has it, before the first motion."""
    if start not in motion.values:
        return Series(side, steps=True)
    standing = np.arange(len(side)) < unmoved(positions)
    return Series(np.where(standing, motion.values[start], side), {start: standing.astype(float)}, steps=True)


def _with_turns(motion: RunMotion, position: Series, first: int = 0) -> tuple[Series, Indices]:
    """Positions, `first` of them before the run, with the turning points that a smooth motion has between its rows, and where the
    rows of the run are among them.

    A turning point is the vertex of the parabola through the three rows about it, where the motion stands still: its own shift
    along the row changes nothing to first order.
    """
    rows, q = np.arange(len(position.value)), position.value
    if not is_curved(motion.run):
        return position, rows[first:]
    steps = np.concatenate([np.arange(-first, 0), motion.run.steps])
    near = np.flatnonzero(np.diff(approach(q)) != 0.0)
    near = near[near > 0]
    near = near[(q[near - 1] != q[near]) & (steps[near + 1] - steps[near - 1] == 2)]
    before, after = q[near] - q[near - 1], q[near + 1] - q[near]
    place = 0.5 * (before + after) / (before - after)  # rows from the nearest one
    at = near + (place > 0.0)

    def vertex(column: Array) -> Array:
        earlier, later = column[near] - column[near - 1], column[near + 1] - column[near]
        turned = column[near] + 0.5 * (later + earlier) * place + 0.5 * (later - earlier) * place**2
        return np.insert(column, at, turned)

    return position.through(vertex), (rows + np.searchsorted(at, rows, side="right"))[first:]


class ReversalDistance(_OfAxis):
    """Distance from the last reversal |q - q_r|, mm or rad, by which pre-sliding and creep effects fade."""

    def series(self, motion: RunMotion) -> Series:
        _, position, first = motion.led(self.axis)
        position, rows = _with_turns(motion, position, first)
        direction = approach(position.value)
        turned = np.flatnonzero(np.diff(direction) != 0.0)
        origin = np.full(len(direction), -1)
        origin[turned + 1] = turned
        origin = np.maximum.accumulate(origin)
        since = position.through(lambda column: column - column[np.maximum(origin, 0)])
        away = np.where(origin < 0, 0.0, np.sign(since.value))
        tangents = {name: (away * slope)[rows] for name, slope in since.tangents.items()}
        return Series(np.where(origin < 0, FAR, np.abs(since.value))[rows], tangents, steps=True)


def _reversals(time: Array, position: Series) -> list[tuple[float, dict[str, float], float]]:
    """Instants at which an axis turns round with their slopes, and the direction from then on: the vertex of the parabola through
    the three rows about it, or the end of a rest."""
    positions, found = position.value, []
    direction = approach(positions)
    for k in np.flatnonzero(np.diff(direction) != 0.0):
        at, slopes = float(time[k]), dict[str, float]()
        if k > 0 and positions[k - 1] != positions[k]:
            width = 0.5 * (time[k + 1] - time[k - 1])
            before, after = np.diff(positions[k - 1 : k + 2]) / np.diff(time[k - 1 : k + 2])
            at = float(0.5 * (time[k - 1] + time[k]) + before / (before - after) * width)
            for name, tangent in position.tangents.items():
                earlier, later = np.diff(tangent[k - 1 : k + 2]) / np.diff(time[k - 1 : k + 2])
                slopes[name] = float((before * later - after * earlier) / (before - after) ** 2 * width)
        found.append((at, slopes, float(direction[k + 1])))
    return found


class ReversalTime(_OfAxis):
    """Time since the last reversal, s, with the sign of the motion since then; before the first one it counts as long ago.

    A reversal is placed between the rows, where the axis stands still.
    """

    def series(self, motion: RunMotion) -> Series:
        time, position, first = motion.led(self.axis)
        since = np.full(len(time), LONG_AGO_S)
        tangents = {name: np.zeros(len(time)) for name in position.tangents}
        for at, slopes, direction in _reversals(time, position):
            after = time >= at
            since[after] = direction * np.maximum(time[after] - at, 1e-9)
            for name, tangent in tangents.items():
                tangent[after] = -direction * slopes.get(name, 0.0)
        return Series(since[first:], {name: tangent[first:] for name, tangent in tangents.items()}, steps=True)


class ReversalAhead(_OfAxis):
    """Time until the next reversal, s, with the sign of the motion after it; after the last one it counts as far ahead."""

    def series(self, motion: RunMotion) -> Series:
        time, position = motion.run.time, motion.axis(self.axis).position
        until = np.full(motion.run.rows, LONG_AGO_S)
        tangents = {name: np.zeros(motion.run.rows) for name in position.tangents}
        for at, slopes, direction in reversed(_reversals(time, position)):
            before = time < at
            until[before] = direction * (at - time[before])
            for name, tangent in tangents.items():
                tangent[before] = direction * slopes.get(name, 0.0)
        return Series(until, tangents, steps=True)


@dataclass(frozen=True)
class PreSliding:
    """State w of a contact with pre-sliding: dw = (s - w)·|dq|/distance (P. R. Dahl 1968), -1…+1.

    After a reversal out of full slip w = s·(1 - 2·exp(-ξ/distance)), ξ the distance since it. `distance` names a
    parameter, and `start` the state in which the recording of a run begins; where the run has none, it is full slip in
    the direction of the first motion.
    """

    axis: str
    distance: str
    start: str = ""

    @property
    def parameters(self) -> tuple[str, ...]:
        """The distance and the state at the start."""
        return (self.distance, self.start) if self.start else (self.distance,)

    def series(self, motion: RunMotion) -> Series:
        """The states and their slopes."""
        position, rows = _with_turns(motion, motion.axis(self.axis).position)
        direction, distance = approach(position.value), max(abs(motion.values[self.distance]), 1e-12)
        begins = self.start in motion.values
        state = direction.copy()
        names = (self.distance, *((self.start,) if begins else ()), *position.tangents)
        slopes = {name: np.zeros(len(direction)) for name in names}
        ends = [*np.flatnonzero(np.diff(direction) != 0.0).tolist(), len(direction) - 1]
        if begins:
            ends = [0, *ends]
            state[0], slopes[self.start][0] = motion.values[self.start], 1.0
        for first, last in pairwise(ends):
            part, sign = slice(first + 1, last + 1), direction[min(first + 1, last)]
            xi = sign * (position.value[part] - position.value[first])
            open_ = (state[first] - sign) * np.exp(-xi / distance)
            state[part] = sign + open_
            for name in names:
                moved = -xi / distance if name == self.distance else 0.0
                if name in position.tangents:
                    moved = moved + sign * (position.tangents[name][part] - position.tangents[name][first])
                slopes[name][part] = slopes[name][first] * np.exp(-xi / distance) - open_ * moved / distance
        return Series(state, slopes, steps=True).through(lambda column: column[rows])


@dataclass(frozen=True)
class Play:
    """State of a play of total `width` (a parameter's name): -1 and +1 at the flanks, between them while it is
    crossed.

    Behind the play the coordinate is q - (width/2)·state. `start` names the state in which the recording of a run begins;
    where the run has none, it is the middle. Where `slope` names a parameter, the width is width + slope·q along the
    axis.
    """

    axis: str
    width: str
    slope: str = ""
    start: str = ""

    @property
    def parameters(self) -> tuple[str, ...]:
        """The width, where it grows its slope, and the state at the start."""
        return tuple(name for name in (self.width, self.slope, self.start) if name)

    def series(self, motion: RunMotion) -> Series:
        """The states, with slopes where the play is being crossed."""
        position = motion.axis(self.axis).position
        side = approach(position.value)
        if not motion.run.dynamic:
            return _begun(motion, position.value, side, self.start)
        growth = motion.values[self.slope] if self.slope else 0.0
        position, rows = _with_turns(motion, position)
        signed = motion.values[self.width] + growth * position.value
        half = 0.5 * np.abs(signed)
        if half.max() < 1e-15:
            return Series(side, steps=True)
        half = np.maximum(half, 1e-15)
        state = _play_states(position.value, motion.values.get(self.start, 0.0), half)
        sign = np.sign(signed)
        halves = {self.width: 0.5 * sign}
        if self.slope:
            halves[self.slope] = 0.5 * sign * position.value
        for name, tangent in position.tangents.items():
            halves[name] = 0.5 * sign * growth * tangent
        tangents = _play_tangents(state, half, position, halves)
        # until the first flank the output stands where it began, at a flank if not pushed
        if self.start in motion.values:
            pushed = motion.values[self.start] * (position.value - position.value[0]) > 0.0
            began = (state == motion.values[self.start]) & ~np.logical_or.accumulate(pushed)
            standing = np.logical_and.accumulate((np.abs(state) < 1.0) | began)
            tangents[self.start] = np.where(standing, half[0] / half, 0.0)
        return Series(state, tangents, steps=True).through(lambda column: column[rows])


def _play_states(positions: Array, start: float, half: Array) -> Array:
    """(q - output)/half, the output standing while q moves between its flanks."""
    low, high = positions - half, positions + half
    reach = 1
    while reach < len(positions):  # clamps in a row are one clamp; by recursive doubling
        low[reach:], high[reach:] = (
            np.clip(low[:-reach], low[reach:], high[reach:]), np.clip(high[:-reach], low[reach:], high[reach:]),
        )  # fmt: skip
        reach *= 2
    output = np.clip(positions[0] - start * half[0], low, high)
    states = np.asarray((positions - output) / half)
    flank = np.abs(states) > 1.0 - 1e-9
    states[flank] = np.sign(states[flank])
    return states


def _play_tangents(state: Array, half: Array, position: Series, halves: Mapping[str, Array]) -> dict[str, Array]:
    """Between the flanks the output stands where it left one: state·half = q - held moves with q and with the width."""
    crossing = np.abs(state) < 1.0
    if not crossing.any():
        return {}
    contact = np.maximum(np.maximum.accumulate(np.where(crossing, -1, np.arange(len(state)))), 0)
    tangents = {}
    for name, change in halves.items():
        slope = position.tangents.get(name, np.zeros(len(state)))
        held = slope[contact] - (state * change)[contact]
        tangents[name] = np.where(crossing, (slope - held - state * change) / half, 0.0)
    return tangents


@dataclass(frozen=True)
class Resonance:
    """Relative displacement of a mass on a spring carried by the axis: ÿ + 2ζω ẏ + ω² y = -a(t), in the axis' unit.

    `frequency` (Hz) and `damping` (ζ) name parameters. The acceleration is taken every 2 ms (loops answer within a
    few) and is linear in between (first-order hold).
    """

    axis: str
    frequency: str
    damping: str

    @property
    def parameters(self) -> tuple[str, ...]:
        return (self.frequency, self.damping)

    def series(self, motion: RunMotion) -> Series:
        from scipy.linalg import expm, expm_frechet

        omega, damping = 2.0 * np.pi * motion.values[self.frequency], motion.values[self.damping]
        acceleration, rows, h = motion.fine_acceleration(self.axis, FINE_S)
        matrix = np.zeros((4, 4))
        matrix[0, 1] = matrix[2, 3] = h
        matrix[1, :3] = h * np.array([-(omega**2), -2.0 * damping * omega, -1.0])
        step = expm(matrix)

        def follow(step: Array, value: Array, source: Array | None = None) -> Array:
            """States (N, 2) driven by the accelerations through `step[:2, 2:]`, plus a source."""
            slope = np.append(np.diff(value) / h, 0.0)
            forcing = np.zeros((len(value), 2, 1))
            forcing[1:, :, 0] = np.stack([value[:-1], slope[:-1]], axis=1) @ step[:2, 2:].T
            if source is not None:
                forcing[1:, :, 0] += source[:-1]
            return np.asarray(linear_recurrence(transition, forcing)[:, :, 0])

        transition = step[:2, :2]
        states = follow(step, acceleration.value)
        tangents = {name: follow(step, slope)[rows, 0] for name, slope in acceleration.tangents.items()}
        for name, change in (
            (self.frequency, 2.0 * np.pi * np.array([-2.0 * omega, -2.0 * damping, 0.0, 0.0])),
            (self.damping, np.array([0.0, -2.0 * omega, 0.0, 0.0])),
        ):
            direction = np.zeros((4, 4))
            direction[1] = h * change
            moved = expm_frechet(matrix, direction, compute_expm=False)
            tangents[name] = follow(moved, acceleration.value, states @ moved[:2, :2].T)[rows, 0]
        return Series(states[rows, 0], tangents)
