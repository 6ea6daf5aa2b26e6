"""First-order lag, τ·dy/dt + y = x, exactly discretised: x linear between rows (first-order hold), y at rest on the first one."""

from __future__ import annotations

import numpy as np

from symfive.arrays import Array

NEGLIGIBLE = 1e-18


def first_order(given: Array, steps: Array, tau: float) -> Array:
    """What a lag of `tau` (0: none) makes of x (N, …) in rows that are `steps` (N - 1,) apart, in the same unit."""
    weights, _ = _hold(steps, tau)
    found = given.copy()
    found[1:] = _weighed(weights[:, 1:], given[1:], given[:-1])
    return _followed(weights[:, 0], found)


def first_order_slope(given: Array, lagged: Array, steps: Array, tau: float) -> Array:
    """The slope in `tau` of `lagged` (N, …), which a lag made of `given`."""
    weights, slopes = _hold(steps, tau)
    moved = np.zeros_like(given)
    moved[1:] = _weighed(slopes[:, :1], lagged[:-1]) + _weighed(slopes[:, 1:], given[1:], given[:-1])
    return _followed(weights[:, 0], moved)


def lag_response(pieces: Array, interval: float, tau: float, place: Array, *, settled: bool) -> tuple[Array, Array]:
    """Position, velocity and acceleration of an axis that follows late by `tau` s, each with its slope in that (n, 3, 2), and the
    change of the three in a second (n, 3), at the `place` (n,) among rows `interval` s apart.

    Between rows the command is a cubic p each, `pieces` (4, N - 1) by powers of the time since the row, s. A lag makes
    p - τ·p' + τ²·p" - τ³·p"' of it, and by what that jumps from one to the next the axis is off, a share exp(-t/τ) of it after t.
    It stands on the first row, unless the lag has `settled`, and beyond both ends.
    """
    from scipy.signal import lfilter

    inside = (place >= 0.0) & (place <= pieces.shape[1])
    place = np.clip(place, 0.0, pieces.shape[1])
    row = np.minimum(place.astype(np.int64), pieces.shape[1] - 1)
    powers, changes = np.array([1.0, -tau, tau**2, -(tau**3)]), np.array([0.0, -1.0, 2.0 * tau, -3.0 * tau**2])
    since = (place - row) * interval
    given = _derivatives(pieces[:, row], since)
    motion, rate = np.empty((len(place), 3, 2)), np.empty((len(place), 3))
    for k in range(3):
        motion[:, k, 0], motion[:, k, 1] = powers[: 4 - k] @ given[k:], changes[: 4 - k] @ given[k:]
        rate[:, k] = powers[: 3 - k] @ given[k + 1 :]
    if tau > 0.0:
        begin, end = _derivatives(pieces, 0.0), _derivatives(pieces[:, :-1], interval)
        jump = np.column_stack([np.zeros(4) if settled else [0.0, *-begin[1:, 0]], end - begin[:, 1:]])
        keep = np.exp(-interval / tau)
        off = lfilter([1.0], [1.0, -keep], powers @ jump)
        forcing = changes @ jump
        forcing[1:] += keep * interval / tau**2 * off[:-1]
        fades = np.exp(-since / tau)
        left = off[row] * fades
        change = lfilter([1.0], [1.0, -keep], forcing)[row] * fades + left * since / tau**2
        for k in range(3):
            motion[:, k, 0] += left * (-1.0 / tau) ** k
            motion[:, k, 1] += (change - left * k / tau) * (-1.0 / tau) ** k
            rate[:, k] += left * (-1.0 / tau) ** (k + 1)
    return motion, rate * inside[:, None]


def _derivatives(pieces: Array, since: Array | float) -> Array:
    """Cubics (4, n) and their three derivatives, `since` (n,) s behind the row of each: (4, n)."""
    a, b, c, d = pieces
    return np.stack([
        a + since * (b + since * (c + since * d)), b + since * (2.0 * c + 3.0 * since * d), 2.0 * c + 6.0 * since * d, 6.0 * d,
    ])  # fmt: skip


def _weighed(weights: Array, *tables: Array) -> Array:
    """The sum of tables (N, …), each weighted by its column of `weights` (N, m)."""
    each = weights.reshape(*weights.shape, *(1,) * (tables[0].ndim - 1))
    return np.asarray(sum(each[:, k] * table for k, table in enumerate(tables)))


def _followed(keep: Array, forcing: Array) -> Array:
    """s with s[k] = keep[k - 1]·s[k - 1] + forcing[k] and s[0] = forcing[0] (N, …), by recursive doubling."""
    state = forcing.copy()
    power = np.append(0.0, keep).reshape(-1, *(1,) * (forcing.ndim - 1))
    reach = 1
    while reach < len(state) and np.abs(power).max() > NEGLIGIBLE:
        state[reach:] = state[reach:] + power[reach:] * state[:-reach]
        power[reach:] = power[reach:] * power[:-reach]
        power[:reach] = 0.0
        reach *= 2
    return state


def _hold(step: Array, tau: float) -> tuple[Array, Array]:
    """Weights (N - 1, 3) of the last output, the new and the former input, and their slopes in τ."""
    if tau <= 0.0:
        still = np.zeros_like(step)
        return np.stack([still, still + 1.0, still], axis=1), np.stack([still, -1.0 / step, 1.0 / step], axis=1)
    ratio = step / tau
    keep = np.exp(-ratio)
    mean = -np.expm1(-ratio) / ratio  # the average of exp(-t/τ) over the step
    d_keep = keep * ratio / tau
    d_mean = (mean - keep) / tau
    return np.stack([keep, 1.0 - mean, mean - keep], axis=1), np.stack([d_keep, -d_mean, d_mean - d_keep], axis=1)
