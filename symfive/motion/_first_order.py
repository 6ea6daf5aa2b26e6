"""First-order lag, τ·dy/dt + y = x, exactly discretised: x linear between rows (first-order hold), y at rest on the first one."""

from __future__ import annotations

from typing import Literal

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


def lag_response(command: Array, interval: float, tau: float, *, moving: bool) -> Array:
    """Motion of an axis that follows late by `tau` s and its slope in that, as of `drive_response`: (N, 3, 2).

    `command` (N,) `interval` s apart. The axis stands on the first one; where it is `moving` the lag has settled.
    """
    from scipy.signal import lfilter

    (weights,), (slopes,) = _hold(np.array([interval]), tau)
    speed, fade = float(command[1] - command[0]) / interval if moving else 0.0, [1.0, -weights[0]]
    rest = command - command[0] - speed * interval * np.arange(len(command))
    lagged = lfilter(weights[1:], fade, rest)
    forcing = slopes[1] * rest
    forcing[1:] += slopes[0] * lagged[:-1] + slopes[2] * rest[:-1]
    order: Literal[1, 2] = 2 if len(command) > 2 else 1
    found = np.empty((len(command), 3, 2))
    found[:, 0, 0] = command - rest + lagged - tau * speed
    found[:, 0, 1] = lfilter([1.0], fade, forcing) - speed
    for k in (1, 2):
        found[:, k] = np.gradient(found[:, k - 1], interval, axis=0, edge_order=order)
    return found


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
