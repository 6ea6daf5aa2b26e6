"""Whitening of a recording: white and slow noise together, filtered so that what is left is white.

    y = white + coloured,   white ~ N(0, σ_w²),   coloured: Gauss–Markov with σ_c and correlation time τ, or n such processes
    of equal size together, each with a tenth of the time of the one before: flicker noise over n decades (M. Keshner 1982)

White and coloured are an ARMA(n, n) process; its innovations (Kalman filter, steady state after the first rows) are white.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from symfive.arrays import Array

TRANSIENT = 64
DOUBLINGS = 64
"""After 2^64 rows any filter is steady."""
_BLOCK = 32
_CACHED = 2**15


@dataclass(frozen=True)
class Noise:
    """Noise of one kind of reading, in its unit: `white` 1σ, `coloured` 1σ (0: none), `time_constant` s, the longest of so many
    `decades`."""

    white: float
    coloured: float = 0.0
    time_constant: float = 0.0
    declared: float = 0.0
    decades: int = 1

    @property
    def total(self) -> float:
        """1σ of one reading."""
        return float(np.hypot(self.white, self.coloured))

    @property
    def times(self) -> tuple[float, ...]:
        """The time constant of each Gauss-Markov process, s, the longest first."""
        return tuple(self.time_constant / 10.0**k for k in range(self.decades))

    def correlation(self, interval: float) -> tuple[float, ...]:
        """φ of each from one row to the next."""
        return tuple(float(np.exp(-interval / time)) for time in self.times)


class Whitening:
    """Standardised innovations of a table that comes by stretches of its rows, the first of `TRANSIENT` rows or all.

    `logs` is Σ log of the innovations' variances so far, per column.
    """

    def __init__(self, noise: Noise, interval: float) -> None:
        self._noise, self._interval = noise, interval
        self._memory: Array | None = None
        self.logs = 0.0

    def __call__(self, table: Array) -> Array:
        """The next rows (n, …) of every column, whitened."""
        flat = table.reshape(len(table), -1)
        noise, n = self._noise, len(flat)
        if noise.coloured <= 0.0:
            self.logs += 2.0 * n * float(np.log(noise.white))
            return (flat / noise.white).reshape(table.shape)
        told = noise.correlation(self._interval), noise.coloured**2, noise.white**2
        out, first, steady = np.empty_like(flat), 0, steady_filter(*told)
        if self._memory is None:
            first = min(n, TRANSIENT)
            filtered, predicted, logs = _transient(*told, first)
            out[:first] = filtered @ flat[:first]
            self._memory = steady.modes @ (predicted @ flat[:first])
            self.logs += logs
        if n > first:
            rest, self._memory = innovations(flat[first:], steady, self._memory)
            np.divide(rest, np.sqrt(steady.variance), out=out[first:])
            self.logs += (n - first) * float(np.log(steady.variance))
        return out.reshape(table.shape)


def whiten(table: Array, noise: Noise, interval: float) -> tuple[Array, float]:
    """Standardised innovations of every column of (N, …) along the rows, and Σ log of their variances per column."""
    whitening = Whitening(noise, interval)
    return whitening(table), whitening.logs


@dataclass(frozen=True)
class SteadyFilter:
    """The Kalman filter of n processes once it is steady, in its own modes: what it predicts is Σ w, w[t+1] = `poles`·w[t] +
    `gains`·y[t] (n,), w = `modes` (n, n) times the predicted states; the innovations have this `variance`."""

    poles: Array
    gains: Array
    modes: Array
    variance: float


@lru_cache(maxsize=64)
def steady_filter(phi: tuple[float, ...], power: float, white: float) -> SteadyFilter:
    """Of processes with φ each that have the variance `power` together, read with white noise.

    The prediction covariance P = F·(P - P·11ᵀ·P/(1ᵀ·P·1 + W))·Fᵀ + Q by doubling (E. Chu et al. 2004). With r² the gains F·K,
    F·(I - K·1ᵀ) is F - r·rᵀ in units of r: symmetric, so its poles are real.
    """
    size = len(phi)
    one, f = np.eye(size), np.diag(phi)
    a, g, p = f, np.full((size, size), 1.0 / white), np.diag((1.0 - np.square(phi)) * power / size)
    for _ in range(DOUBLINGS):
        if np.abs(a).max() < 1e-18:
            break
        inverse = np.linalg.inv(one + g @ p)
        a, g, p = a @ inverse @ a, g + a @ inverse @ g @ a.T, p + a.T @ p @ inverse @ a
    variance = float(p.sum()) + white
    root = np.sqrt(np.maximum(f @ p.sum(axis=1) / variance, np.finfo(float).tiny))
    poles, axes = np.linalg.eigh(f - np.outer(root, root))
    pull = root @ axes
    return SteadyFilter(poles, pull**2, pull[:, None] * axes.T / root, variance)


def innovations(table: Array, steady: SteadyFilter, memory: Array) -> tuple[Array, Array]:
    """What a filter does not predict of every column of `table` (N, k), and its memory w (n, k) after the last row."""
    rows, columns = table.shape
    out = np.empty_like(table)
    span = max(_CACHED // max(columns, 1), _BLOCK)
    for first in range(0, rows, span):
        part = table[first : first + span]
        left, kept = part.copy(), []
        for pole, gain, before in zip(steady.poles, steady.gains, memory, strict=True):
            predicted = _recurrence(pole, np.concatenate([before[None], gain * part[:-1]]))
            left -= predicted
            kept.append(pole * predicted[-1] + gain * part[-1])
        out[first : first + span], memory = left, np.array(kept)
    return out, memory


def _recurrence(theta: float, forcing: Array) -> Array:
    """s of s[t] = θ·s[t-1] + forcing[t] (N, k), s[-1] = 0: a product of matrices in every block of rows, and from block to
    block the same recurrence with a power of θ."""
    rows, columns = forcing.shape
    count = -(-rows // _BLOCK)
    powers = theta ** np.arange(_BLOCK + 1)
    lag = np.subtract.outer(np.arange(_BLOCK), np.arange(_BLOCK))
    inside = np.where(lag >= 0, powers[np.abs(lag)], 0.0)
    if count == 1:
        return np.asarray(inside[:rows, :rows] @ forcing)
    blocks = np.zeros((count, _BLOCK, columns))
    blocks.reshape(count * _BLOCK, columns)[:rows] = forcing
    blocks = inside @ blocks
    ends = _recurrence(float(powers[-1]), blocks[:-1, -1])
    blocks[1:] += powers[1:, None] * ends[:, None, :]
    return blocks.reshape(count * _BLOCK, columns)[:rows]


@lru_cache(maxsize=64)
def _transient(phi: tuple[float, ...], power: float, white: float, rows: int) -> tuple[Array, Array, float]:
    """The filter of the first `rows` as a matrix (rows, rows) on the readings, the prediction of the next states (n, rows), and
    Σ log of the innovations' variances."""
    own = power / len(phi) * np.array(phi)[:, None] ** np.arange(rows + 1)
    at = np.arange(rows)
    factor = np.linalg.cholesky(own.sum(axis=0)[np.abs(at[:, None] - at)] + white * np.eye(rows))
    filtered = np.linalg.inv(factor)
    return filtered, own[:, rows - at] @ filtered.T @ filtered, 2.0 * float(np.sum(np.log(np.diag(factor))))
