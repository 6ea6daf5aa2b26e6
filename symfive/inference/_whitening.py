"""Whitening of a recording: white and slow noise together, filtered so that what is left is white.

    y = white + coloured,   white ~ N(0, σ_w²),   coloured: Gauss–Markov with σ_c and correlation time τ

Both parts together are an ARMA(1,1) process; its innovations (Kalman filter, steady state after the first rows) are white.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from symfive.arrays import Array

TRANSIENT = 64
_BLOCK = 32
_CACHED = 2**15


@dataclass(frozen=True)
class Noise:
    """Noise of one kind of reading, in its unit: `white` 1σ, `coloured` 1σ (0: none), `time_constant` s."""

    white: float
    coloured: float = 0.0
    time_constant: float = 0.0
    declared: float = 0.0

    @property
    def total(self) -> float:
        """1σ of one reading."""
        return float(np.hypot(self.white, self.coloured))


class Whitening:
    """Standardised innovations of a table that comes by stretches of its rows, the first of `TRANSIENT` rows or all.

    `logs` is Σ log of the innovations' variances so far, per column.
    """

    def __init__(self, noise: Noise, interval: float) -> None:
        self._noise, self._phi = noise, 0.0
        self._memory: Array | None = None
        self.logs = 0.0
        if noise.coloured > 0.0:
            self._phi = float(np.exp(-interval / noise.time_constant))

    def __call__(self, table: Array) -> Array:
        """The next rows (n, …) of every column, whitened."""
        flat = table.reshape(len(table), -1)
        noise, n = self._noise, len(flat)
        if noise.coloured <= 0.0:
            self.logs += 2.0 * n * float(np.log(noise.white))
            return (flat / noise.white).reshape(table.shape)
        phi, power, white = self._phi, noise.coloured**2, noise.white**2
        out, first = np.empty_like(flat), 0
        if self._memory is None:
            first = min(n, TRANSIENT)
            filtered, predicted, logs = _transient(phi, power, white, first)
            out[:first] = filtered @ flat[:first]
            self._memory = -(predicted @ flat[:first])[None, :]
            self.logs += logs
        if n > first:
            variance = steady_variance(phi, power, white)
            total = variance + white
            theta = phi * (1.0 - variance / total)
            rest, self._memory = innovations(flat[first:], phi, theta, self._memory)
            np.divide(rest, np.sqrt(total), out=out[first:])
            self.logs += (n - first) * float(np.log(total))
        return out.reshape(table.shape)


def whiten(table: Array, noise: Noise, interval: float) -> tuple[Array, float]:
    """Standardised innovations of every column of (N, …) along the rows, and Σ log of their variances per column."""
    whitening = Whitening(noise, interval)
    return whitening(table), whitening.logs


def innovations(table: Array, phi: float, theta: float, memory: Array) -> tuple[Array, Array]:
    """e of e[t] = y[t] - φ·y[t-1] + θ·e[t-1] for every column of `table` (N, k), and the memory after the last row.

    `memory` (1, k) is θ·e[-1] - φ·y[-1], the part of the first row that earlier rows make.
    """
    rows, columns = table.shape
    out = np.empty_like(table)
    span = max(_CACHED // max(columns, 1), _BLOCK)
    for first in range(0, rows, span):
        part = table[first : first + span]
        forcing = part.copy()
        forcing[1:] -= phi * part[:-1]
        forcing[:1] += memory
        filtered = _recurrence(theta, forcing)
        out[first : first + span] = filtered
        memory = theta * filtered[-1:] - phi * part[-1:]
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
def _transient(phi: float, power: float, white: float, rows: int) -> tuple[Array, Array, float]:
    """The Kalman filter of the first `rows` as a matrix (rows, rows) on the readings, the prediction of the next one (rows,),
    and Σ log of the innovations' variances."""
    predictions = [power]  # variances
    for _ in range(rows - 1):
        last = predictions[-1]
        predictions.append(phi**2 * last * white / (last + white) + (1.0 - phi**2) * power)
    variances = np.array(predictions) + white
    gains = np.array(predictions) / variances
    # reading s enters the prediction of row t > s by φ·K[s] times what the gains after it leave, Π φ·(1 - K)
    left = np.cumsum(np.log(np.maximum(phi * (1.0 - gains), np.finfo(float).tiny)))
    entered = phi * gains * np.exp(np.where(np.tri(rows, dtype=bool), left[:, None] - left, -np.inf))
    filtered = np.eye(rows)
    filtered[1:] -= entered[:-1]
    return filtered / np.sqrt(variances)[:, None], entered[-1], float(np.sum(np.log(variances)))


def steady_variance(phi: float, power: float, white: float) -> float:
    """Steady prediction variance P = φ²·P·W/(P + W) + (1 - φ²)·σ_c² (scalar Riccati equation)."""
    source = (1.0 - phi**2) * power
    b = white * (1.0 - phi**2) - source
    return 0.5 * (-b + float(np.sqrt(b * b + 4.0 * source * white)))
