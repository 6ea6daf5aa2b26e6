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
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Flags
from symfive.campaign import Campaign, Run
from symfive.design._circles import typical_values
from symfive.design._space import SIGMAS_IN_RANGE, Space
from symfive.effects import Effect, make_effect
from symfive.errors import InputError
from symfive.inference import Noise, whiten
from symfive.machine import Machine
from symfive.model import Model
from symfive.optimal import inverse
from symfive.procedures import DWELL_S, checked, through

__all__ = ["Sweep", "Sweeps", "nuisances"]

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


class Sweeps:
    """All sweeps of one mounting: `setup` as in `SETUP_VARIABLES`, `length` of its bar, mm (0 of an R-test); `noise` of the
    readings, `rate_hz` rows per second. `names` of what turns, from `low` to `high` (variables,), degree; `own` (k,) which
    parameters are this recording's alone: its set-up errors and its delay."""

    def __init__(self, space: Space, setup: Array, length: float, noise: Noise, rate_hz: float) -> None:
        self.space, self.setup, self.length, self.noise, self.rate_hz = space, setup, length, noise, rate_hz
        self.machine, self.effects = space.machine, nuisances(space.machine)
        self.names = space.names[: space.poses]
        self.bar = space.instrument == "ball_bar"
        self.low, self.high = (np.degrees(bounds[: space.poses]) for bounds in (space.lower, space.upper))
        self.low[-1] += OFF_THE_CUP_DEG if self.bar else 0.0
        z = np.concatenate([np.zeros(space.poses), setup])
        self.table_ball, self.tool_ball = space.table_ball(z), space.tool_ball(z)
        self.model = Model(
            Campaign(machine=self.machine, runs=(self._run(np.zeros((1, space.poses)), 1.0),)), self.effects
        )
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

    def run(self, stops: Array, speed: float) -> Run:
        """The recording through `stops` (n, variables), degree, at `speed` degree/s. Raises `InputError` where an axis cannot
        follow."""
        run = self._run(stops, speed)
        return checked(self.machine, run, feed=60.0 * speed, unit="degree/min", place="the speed or the mounting")

    def _run(self, stops: Array, speed: float) -> Run:
        time, positions = through(stops, speed, self.rate_hz)
        return Run(
            id="sweeps", instrument=(self.space.instrument,), sampling="dynamic", time=time,
            commands=self.space.commands(*self.poses(positions)), table_ball=self.table_ball, tool_ball=self.tool_ball,
            length=self.length if self.bar else None, noise_um=self.space.noise_um,
            setup_sigma_um=self.space.setup_sigma, options=self.space.options,
        )  # fmt: skip

    def seen(self, run: Run) -> Array:
        """Whitened slopes (N, readings, k) of the rows of a run that begins after a rest, zero for what it does not depend on.
        Raises `InputError` where the readings expected leave the sensor's range."""
        line = self.model.linearise(run, self.start)
        slopes = np.zeros((*line.prediction.shape, len(self.start)))
        slopes[:, :, line.columns] = line.jacobian
        spread = SIGMAS_IN_RANGE * np.sqrt(np.square(slopes) @ np.square(self._sizes))
        most = 1e-3 * float((np.abs(line.prediction) + spread).max())
        if most > self.machine.workspace.stroke(bar=self.bar):
            limit = "bar_stroke" if self.bar else "sensor_range"
            problem = f"the readings may reach {most:.2g} mm, beyond the {limit}"
            raise InputError(problem, remedy=f"lower the speed, or raise {limit} in [workspace]")
        before = math.ceil(MEMORY * self.noise.time_constant * self.rate_hz)
        rested = np.concatenate([np.repeat(slopes[:1], before, axis=0), slopes])
        return whiten(rested, self.noise, 1.0 / self.rate_hz)[0][before:]

    def between(self, before: Array, after: Array, speed: float) -> Sweep | None:
        """The sweep from one position (variables,), degree, to another; None where a limit is in the way."""
        key = ((tuple(before), tuple(after)), speed)
        if key not in self._known:
            try:
                self._known[key] = self._measured(before, after, speed)
            except InputError:
                self._known[key] = None
        return self._known[key]

    @property
    def offered(self) -> list[tuple[Ends, float, Sweep]]:
        """Both ends, the speed and the sweep of all that were evaluated and are possible."""
        return [(ends, speed, sweep) for (ends, speed), sweep in self._known.items() if sweep is not None]

    def blocked(self, before: Array, after: Array, speed: float) -> None:
        """The sweep and its reverse are no longer offered."""
        for a, b in ((before, after), (after, before)):
            self._known[(tuple(a), tuple(b)), speed] = None

    def _measured(self, before: Array, after: Array, speed: float) -> Sweep | None:
        size = float(np.abs(after - before).max())
        if (
            size < SHORTEST * self.noise.time_constant * speed
            or not self.reachable(self._along(before, after, size)).all()
        ):
            return None
        run = self.run(np.stack([before, after]), speed)
        moving = run.rows - round(DWELL_S * self.rate_hz)
        flat = self.seen(run)[1:moving].reshape(-1, len(self.start))
        return Sweep(flat.T @ flat, (moving - 1) / self.rate_hz)

    @staticmethod
    def _along(before: Array, after: Array, size: float) -> Array:
        share = np.linspace(0.0, 1.0, max(2, math.ceil(size / LOOKED_AT_DEG)))
        return np.asarray(before + share[:, None] * (after - before))

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
        own, others = np.flatnonzero(self.own), np.flatnonzero(~self.own)
        rest = total[np.ix_(own, own)] + np.diag(self.model.prior_sigma[own] ** -2.0)
        cross, found = total[np.ix_(others, own)], np.zeros_like(total)
        found[np.ix_(others, others)] = total[np.ix_(others, others)] - cross @ inverse(rest) @ cross.T
        return found

    def recorded(self, stops: Sequence[Array], speed: float) -> tuple[Run, Array]:
        """The recording through some stops, and its information (k, k)."""
        run = self.run(np.stack(stops), speed)
        flat = self.seen(run).reshape(-1, len(self.start))
        return run, flat.T @ flat
