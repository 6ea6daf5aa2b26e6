"""Time along a path: from rest to a constant speed and to rest again, without a jump in acceleration."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from casadi import fmin

from symfive.arrays import Array
from symfive.errors import InputError
from symfive.machine import Machine

DWELL_S = 0.3
"""Rest at the end of a recording, in which the drives come to their command."""

DIRECTIONS = {"ccw": 1, "cw": -1}
MAX_ROWS = 2_000_000
MOST_PER_ROW = 0.1


def senses(direction: str) -> tuple[str, ...]:
    """`ccw`, `cw` or both of them."""
    if direction != "both" and direction not in DIRECTIONS:
        raise InputError(f'direction "{direction}" is unknown', remedy='use "ccw", "cw" or "both"')
    return tuple(DIRECTIONS) if direction == "both" else (direction,)


CAUTION = 0.5
"""Share of an axis' greatest acceleration that a control uses to get up to a feed."""


def ramp_of(machine: Machine, speed: Any, radius: Any, run_up: float) -> Any:
    """Angle, rad, in which a circle of `radius` mm reaches `speed` rad/s: at the peak of `along` with `CAUTION` of the
    acceleration that all linear axes have, but at most `run_up` rad, and `run_up` if no acceleration is known.

    `speed` and `radius` are numbers or CasADi expressions.
    """
    limits = [axis.max_acceleration for axis in machine.axes.values() if not axis.rotary]
    known = [limit for limit in limits if limit is not None]
    return fmin(run_up, 0.75 * speed**2 * radius / (CAUTION * min(known))) if known else run_up


def along(length: float, speed: float, run_up: float, rate_hz: float) -> tuple[Array, Array]:
    """Times (N,) s at `rate_hz` and the angle (N,) rad from 0 to `length` at `speed` rad/s.

    Within `run_up` rad at either end the speed rises or falls as 3x² - 2x³, so that speed and acceleration
    scale with the feed and its square and neither jumps. Whether the rows are close enough says `check_spacing`, once it is
    known that the axes can follow.
    """
    for name, value in (("path", length), ("feed", speed), ("run-up", run_up), ("sample rate", rate_hz)):
        if not 0.0 < value < np.inf:
            raise InputError(f"the {name} is not positive and finite", remedy=f"give a {name} above 0")
    run_up = min(run_up, length / 2.0)
    ramp = 2.0 * run_up / speed
    end = 2.0 * ramp + (length - 2.0 * run_up) / speed
    if (end + DWELL_S) * rate_hz > MAX_ROWS:
        problem = f"the recording would have {(end + DWELL_S) * rate_hz:.3g} rows"
        raise InputError(problem, remedy="lower the sample rate or raise the feed")
    time = np.arange(int(np.ceil((end + DWELL_S) * rate_hz - 1e-9)) + 1) / rate_hz

    def from_rest(t: Array) -> Array:
        x = np.clip(t / ramp, 0.0, 1.0)
        return speed * ramp * (x**3 - x**4 / 2.0) + speed * np.maximum(t - ramp, 0.0)

    way = np.where(time < end / 2.0, from_rest(time), length - from_rest(np.maximum(end - time, 0.0)))
    return time, way


SOFT_S = 0.5
"""In which an axis gets up to the speed of a sweep: ten time constants of a slow position loop (20 1/s)."""
AT_A_STOP_DEG = 1e-4
"""A row nearer to a stop is the stop: a program has no block so short, and its time would go to the next one."""


def through(stops: Array, speed: float, rate_hz: float) -> tuple[Array, Array]:
    """Times (N,) s and positions (N, axes), degree, on straight moves through different `stops` (n, axes), at rest for a moment
    at each.

    The axis that turns most on a move does so at `speed` degree/s. The last `DWELL_S` are a rest.
    """
    parts = [stops[:1]]
    for before, after in itertools.pairwise(stops):
        length = float(np.abs(after - before).max())
        _, turned = along(np.radians(length), np.radians(speed), np.radians(0.5 * SOFT_S * speed), rate_hz)
        share = turned / turned[-1]
        rows = int(np.argmax(share >= 1.0 - AT_A_STOP_DEG / length)) + 1
        parts.append(before + np.append(share[1 : rows - 1], 1.0)[:, None] * (after - before))
    parts.append(np.tile(stops[-1:], (round(DWELL_S * rate_hz), 1)))
    positions = np.concatenate(parts)
    return np.arange(len(positions)) / rate_hz, positions


def check_spacing(speed: float, rate_hz: float) -> None:
    """Raises `InputError` where a row covers more than 0.1 rad of a circle: between rows the command is a straight line."""
    if speed / rate_hz > MOST_PER_ROW:
        problem = f"at this feed a row covers {speed / rate_hz:.2g} rad of the circle"
        raise InputError(
            problem, remedy=f"raise the sample rate to {np.ceil(speed / MOST_PER_ROW):g} Hz or lower the feed"
        )
