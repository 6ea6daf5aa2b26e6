"""Sweeps of one mounting: what a straight path of the rotary axes, and of a bar's direction, tells while the instrument reads,
and how long it takes.

A position is what `Space` decides of a pose, in degree: the rotary axes and, of a ball bar, its azimuth and elevation in the
workpiece frame. The linear axes keep the ball in its nest, or the bar at its length. Circles of a bar and rotary axes that turn
with the bar radial, axial or tangential (ISO 230-4, ISO 10791-6) are straight paths between such positions.

Rows of a recording are correlated: its noise is white plus a Gauss-Markov part (`symfive.inference`), so reading faster does not
promise more than it gives. The information of a sweep is that of its whitened rows after a rest at its first position, which is
what they add to a recording that came there: sweeps of one recording then add up but for the rows about their joints. The set-up
errors are those of the one mounting. The lag of the drives and the delay of the instrument's clock are nuisance parameters
(`servo_mismatch`, `latency`): they change sign with the direction, geometry does not.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Flags
from symfive.campaign import Campaign, Run
from symfive.design._circles import typical_values
from symfive.design._space import SIGMAS_IN_RANGE, Space
from symfive.effects import Effect, make_effect
from symfive.errors import InputError
from symfive.inference import Noise, whiten
from symfive.instruments import INSTRUMENTS
from symfive.machine import Machine
from symfive.model import Model
from symfive.optimal import marginal
from symfive.procedures import DWELL_S, checked, followed, through

LOOKED_AT_DEG = 2.0
"""The limits of a sweep are evaluated so densely; its bodies are tested along the program (`_moves`)."""
OFF_THE_CUP_DEG = 1.0
"""More than a pose's least elevation, by as much as `_moves` takes together: on a straight block of the axes a bar that lies on
the cup's limit would cross it."""
Ends = tuple[tuple[float, ...], tuple[float, ...]]
MEMORY = 3.0
"""Correlation times of rest before a sweep after which its noise no longer depends on the beginning."""
DELAY, DELAY_MS = "latency", 10.0
"""The effect of one recording's delay, and the prior 1σ of the delay of each of several, which is an error of its set-up."""
SHORTEST = 2.0
"""Correlation times that a sweep lasts at least: only then does what two neighbours tell add up."""
TOGETHER = 8192
"""Rows of the sweeps that are computed together: enough for array operations, few enough for the processor's cache."""
TIME_CONSTANTS = 30.0
"""Of the slowest drive, in which it comes to a position: e^-30 is less than rounding leaves of a command."""


SLOW_S = 1.0
"""Correlation time of the slow noise where none is given, s: `identify` finds 0.27 µm and 1.07 s, beside 0.30 µm of white noise,
in the circular tests of `tests/data/campaigns/planar-none`. State your own: it prints them for every recording."""


@dataclass(frozen=True)
class Sweep:
    """From one position to another: information (k, k), file units, and the seconds it takes."""

    matrix: Array
    seconds: float

    @property
    def matrices(self) -> tuple[Array]:
        """The information at every draw from the prior: at its mean alone."""
        return (self.matrix,)


def nuisances(machine: Machine, *, delay: bool = True) -> tuple[Effect, ...]:
    """The `delay` of the instrument's clock, and lag of every axis whose drive the machine file describes, where its model has
    none."""
    held = {(entry.effect, entry.axis) for entry in machine.effects}
    drives = [name for name, axis in machine.axes.items() if axis.drive is not None]
    found = [
        *([make_effect(DELAY)] if delay else []),
        *(make_effect("servo_mismatch", name, gains=("position_gain",)) for name in drives),
    ]
    return tuple(effect for effect in found if (effect.id, effect.axis) not in held)


def without_drive(machine: Machine) -> Iterable[str]:
    """A note on the axes whose lag no recording is expected to have."""
    without = [name for name, axis in machine.axes.items() if axis.drive is None]
    if without:
        yield f"no lag of {', '.join(without)} is considered: the machine file has no drive of it"


def recording_noise(white: float, coloured: float | None, correlation_s: float) -> Noise:
    """Noise of a recording: 1σ of its white part and of its slow one (default: as large), µm, and correlation time, s. Raises
    `InputError`."""
    slow = white if coloured is None else coloured
    if not (white > 0.0 and slow >= 0.0 and correlation_s > 0.0):
        raise InputError("the noise is not described", remedy="give 1σ and correlation time above 0")
    return Noise(white, slow, correlation_s, white)


def noise_data(noise: Noise) -> dict[str, float]:
    """The noise as plan.json states it."""
    return {"white_um": noise.white, "coloured_um": noise.coloured, "correlation_s": noise.time_constant}


class Sweeps:
    """All sweeps of one mounting: `setup` as in `SETUP_VARIABLES`, `length` of its bar, mm (0 of an R-test); `noise` of the
    readings, `rate_hz` rows per second. `names` of what turns, from `low` to `high` (variables,), degree; `own` (k,) which
    parameters are this recording's alone: its set-up errors and its delay."""

    def __init__(self, space: Space, setup: Array, length: float, noise: Noise, rate_hz: float) -> None:
        self.space, self.setup, self.length, self.noise, self.rate_hz = space, setup, length, noise, rate_hz
        self.machine, self.effects = space.machine, nuisances(space.machine)
        self.names = space.names[: space.poses]
        self.bar = space.bar
        self.stroke = INSTRUMENTS[space.instrument].stroke(space.machine)
        self.low, self.high = (np.degrees(bounds[: space.poses]) for bounds in (space.lower, space.upper))
        self.low[-1] += OFF_THE_CUP_DEG if self.bar else 0.0
        z = np.concatenate([np.zeros(space.poses), setup])
        self.table_ball, self.tool_ball = space.table_ball(z), space.tool_ball(z)
        self.model = Model(Campaign(machine=self.machine, runs=(self._run(np.zeros((3, space.poses))),)), self.effects)
        self.start = self.model.start
        sizes = np.abs(typical_values(self.model) - self.start)
        kinds = [p.kind for p in self.model.parameters]
        usual = np.where([kind == "effect" for kind in kinds], sizes, self.model.prior_sigma)
        self._sizes = np.where([kind == "setup" for kind in kinds], 0.0, usual)
        self.own: Flags = np.array(
            [
                kind == "setup" or p.name.startswith(f"{DELAY}.")
                for kind, p in zip(kinds, self.model.parameters, strict=True)
            ]
        )
        self._known: dict[tuple[Ends, float], Sweep | None] = {}
        drives = [axis.drive for axis in self.machine.axes.values() if axis.drive is not None]
        slowest = max([max(1.0 / drive.position_gain, drive.integral_time) for drive in drives], default=0.0)
        self._settled = max(TIME_CONSTANTS * slowest, 3.0 / rate_hz)

    def run(self, stops: Array, speed: float) -> Run:
        """The recording through `stops` (n, variables), degree, at `speed` degree/s. Raises `InputError` where an axis cannot
        follow."""
        run = self._run(through(stops, speed, self.rate_hz)[1])
        return checked(self.machine, run, feed=60.0 * speed, unit="degree/min", place="the speed or the mounting")

    def _run(self, positions: Array) -> Run:
        """Positions (N, variables), degree, one row after the other."""
        return Run(
            id="sweeps", instrument=(self.space.instrument,), sampling="dynamic",
            time=np.arange(len(positions)) / self.rate_hz, commands=self.space.commands(*self.poses(positions)),
            table_ball=self.table_ball, tool_ball=self.tool_ball, length=self.length if self.bar else None,
            noise_um=self.space.noise_um, setup_sigma_um=self.space.setup_sigma, options=self.space.options,
        )  # fmt: skip

    def _linearised(self, run: Run) -> tuple[Array, Array]:
        """Slopes (N, readings, k) of the rows of a run, zero for what it does not depend on, and how far they may go (N,), mm."""
        line = self.model.linearise(run, self.start)
        slopes = np.zeros((*line.prediction.shape, len(self.start)))
        slopes[:, :, line.columns] = line.jacobian
        spread = SIGMAS_IN_RANGE * np.sqrt(np.square(slopes) @ np.square(self._sizes))
        return slopes, 1e-3 * (np.abs(line.prediction) + spread).max(axis=1)

    def seen(self, run: Run) -> Array:
        """Whitened slopes (N, readings, k) of the rows of a run that begins after a rest, zero for what it does not depend on.
        Raises `InputError` where the readings expected leave the sensor's range."""
        slopes, reached = self._linearised(run)
        most = float(reached.max())
        if most > self.stroke:
            limit = INSTRUMENTS[self.space.instrument].limit
            problem = f"the readings may reach {most:.2g} mm, beyond the {limit}"
            raise InputError(problem, remedy=f"lower the speed, or raise {limit} in [workspace]")
        return self._whitened([slopes])[0]

    def _whitened(self, tables: Sequence[Array]) -> list[Array]:
        """Slopes (N, readings, k) of runs that begin after a rest, whitened."""
        before = math.ceil(MEMORY * self.noise.time_constant * self.rate_hz)
        longest = max(map(len, tables))
        rested = np.zeros((before + longest, len(tables), *tables[0].shape[1:]))
        for i, table in enumerate(tables):
            rested[:before, i], rested[before : before + len(table), i] = table[0], table
        white = whiten(rested, self.noise, 1.0 / self.rate_hz)[0]
        return [white[before : before + len(table), i] for i, table in enumerate(tables)]

    def between(self, before: Array, after: Array, speed: float) -> Sweep | None:
        """The sweep from one position (variables,), degree, to another; None where a limit is in the way."""
        return self.all_between([(before, after)], speed)[0]

    def all_between(self, pairs: Sequence[tuple[Array, Array]], speed: float) -> list[Sweep | None]:
        """The sweeps between pairs of positions, those computed together that are not yet known."""
        keys = [((tuple(before), tuple(after)), speed) for before, after in pairs]
        fresh = {key: np.stack(pair) for key, pair in zip(keys, pairs, strict=True) if key not in self._known}
        self._known |= dict.fromkeys(fresh)
        sizes = {key: float(np.abs(np.subtract(*ends)).max()) for key, ends in fresh.items()}
        least = SHORTEST * self.noise.time_constant * speed
        long = [key for key, size in sizes.items() if size >= least]
        along = [self._along(fresh[key], sizes[key]) for key in long]
        if not along:
            return [self._known[key] for key in keys]
        bounds = np.cumsum([0, *map(len, along)])[:-1]
        inside = np.logical_and.reduceat(self.reachable(np.concatenate(along)), bounds)
        left = sorted((key for key, free in zip(long, inside, strict=True) if free), key=lambda key: sizes[key])
        while left:
            count = self._count([sizes[key] for key in left], speed)
            some, left = left[:count], left[count:]
            self._known |= zip(some, self._measured([fresh[key] for key in some], speed), strict=True)
        return [self._known[key] for key in keys]

    @property
    def offered(self) -> list[tuple[Ends, float, Sweep]]:
        """Both ends, the speed and the sweep of all that were evaluated and are possible."""
        return [(ends, speed, sweep) for (ends, speed), sweep in self._known.items() if sweep is not None]

    def blocked(self, before: Array, after: Array, speed: float) -> None:
        """The sweep and its reverse are no longer offered."""
        for a, b in ((before, after), (after, before)):
            self._known[(tuple(a), tuple(b)), speed] = None

    def _count(self, sizes: Sequence[float], speed: float) -> int:
        """How many of the next sweeps are computed together. What an effect of the machine file remembers of the way, or of the
        time, is its own for every sweep."""
        rows = np.cumsum(np.array(sizes) / speed + self._settled) * self.rate_hz
        return 1 if self.machine.effects else max(1, int(np.searchsorted(rows, TOGETHER)))

    def _measured(self, ends: Sequence[Array], speed: float) -> list[Sweep | None]:
        """Sweeps between the ends (2, variables) of each, recorded one after the other: before every one but the first the axes
        jump to its beginning and rest until the drives have come to it."""
        lead = math.ceil(self._settled * self.rate_hz)
        paths = [through(pair, speed, self.rate_hz)[1] for pair in ends]
        rested = [np.concatenate([np.repeat(path[:1], lead, axis=0), path]) for path in paths[1:]]
        run = self._run(np.concatenate([paths[0], *rested]))
        lasts = np.cumsum([len(path) for path in (paths[0], *rested)])
        parts = [slice(last - len(path), last) for last, path in zip(lasts, paths, strict=True)]
        slopes, reached = self._linearised(run)
        possible = followed(self.machine, run) & (reached <= self.stroke)
        found: list[Sweep | None] = [None] * len(parts)
        left = [i for i, part in enumerate(parts) if possible[part].all()]
        for i, white in zip(left, self._whitened([slopes[parts[i]] for i in left]) if left else [], strict=True):
            moving = len(white) - round(DWELL_S * self.rate_hz)
            flat = white[1:moving].reshape(-1, len(self.start))
            found[i] = Sweep(flat.T @ flat, (moving - 1) / self.rate_hz)
        return found

    @staticmethod
    def _along(ends: Array, size: float) -> Array:
        share = np.linspace(0.0, 1.0, max(2, math.ceil(size / LOOKED_AT_DEG)))
        return np.asarray(ends[0] + share[:, None] * (ends[1] - ends[0]))

    def poses(self, positions: Array) -> tuple[Array, Array]:
        """Positions (n, variables), degree, as the variables of `Space` and its constants."""
        z = np.concatenate([np.radians(positions), np.tile(self.setup, (len(positions), 1))], axis=1)
        return z, np.full((len(positions), 1), self.length)

    def reachable(self, positions: Array) -> Flags:
        """Which positions (n, variables), degree, are inside all limits."""
        inside: Flags = np.all((positions >= self.low) & (positions <= self.high), axis=1)
        return inside & self.space.feasible(*self.poses(positions))

    def shared(self, total: Array) -> Array:
        """What the information (k, k) of a recording says of the parameters that all recordings share, its own marginalised;
        (k, k), zero for its own."""
        others, found = np.flatnonzero(~self.own), np.zeros_like(total)
        priors = np.diag(np.where(self.own, self.model.prior_sigma**-2.0, 0.0))
        found[np.ix_(others, others)] = marginal(total + priors, others)
        return found

    def recorded(self, stops: Sequence[Array], speed: float) -> tuple[Run, Array]:
        """The recording through some stops, and its information (k, k)."""
        run = self.run(np.stack(stops), speed)
        flat = self.seen(run).reshape(-1, len(self.start))
        return run, flat.T @ flat
