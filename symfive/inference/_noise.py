"""Noise of a recording: a white part and a slow one, estimated together with the fit, as a whitening filter.

    y = white + coloured,   white ~ N(0, σ_w²),   coloured: Gauss–Markov with σ_c and correlation time τ

Both parts together are an ARMA(1,1) process; its innovations (Kalman filter, steady state after the first rows) are
white. The white part is never below what the data sheet declares. Which parts exist is decided by likelihood ratios
at 1 %; their sizes maximise the restricted likelihood (REML: Patterson & Thompson 1971), in which the parameters that the
fit has already spent are accounted for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import lfilter
from scipy.stats import chi2

__all__ = ["Block", "Noise", "estimate_noise", "long_run_variance", "plain_noise", "whiten"]

Array = NDArray[np.float64]
LEVEL = 0.01
MAX_ROWS = 60_000
TRANSIENT = 64
ROUNDING = 1e-12
"""What is added to the diagonal so that rounding cannot make an eigenvalue negative."""


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


@dataclass(frozen=True)
class Block:
    """One run's readings of one instrument: `residual` (N, ny), `jacobian` (N, ny, k), `columns` (k,), row `interval` s.

    Rows in `left_out` (N, ny) are outliers: they carry no information.
    """

    residual: Array
    jacobian: Array
    columns: NDArray[np.int64]
    interval: float
    left_out: NDArray[np.bool_]

    @property
    def kept(self) -> int:
        """Number of readings that count."""
        return int(self.left_out.size - self.left_out.sum())

    def stacked(self) -> Array:
        """(N, ny, k + 1): jacobian and residual with the outliers emptied."""
        table = np.concatenate([self.jacobian, self.residual[:, :, None]], axis=2)
        return np.where(self.left_out[:, :, None], 0.0, table)

    def head(self, rows: int) -> Block:
        """Its first rows only."""
        return Block(self.residual[:rows], self.jacobian[:rows], self.columns, self.interval, self.left_out[:rows])


def whiten(table: Array, noise: Noise, interval: float) -> tuple[Array, float]:
    """Standardised innovations of every column of (N, …) along the rows, and Σ log of their variances per column."""
    flat = table.reshape(len(table), -1)
    n = len(flat)
    if noise.coloured <= 0.0:
        return (flat / noise.white).reshape(table.shape), 2.0 * n * float(np.log(noise.white))
    phi = float(np.exp(-interval / noise.time_constant))
    power, white = noise.coloured**2, noise.white**2
    first = min(n, TRANSIENT)
    filtered, predicted, logs = _transient(phi, power, white, first)
    out = np.empty_like(flat)
    out[:first] = filtered @ flat[:first]
    if n > first:
        variance = _steady(phi, power, white)
        total = variance + white
        theta = phi * (1.0 - variance / total)
        rest, _ = lfilter([1.0, -phi], [1.0, -theta], flat[first:], axis=0, zi=-(predicted @ flat[:first])[None, :])
        out[first:] = rest / np.sqrt(total)
        logs += (n - first) * np.log(total)
    return out.reshape(table.shape), float(logs)


@lru_cache(maxsize=64)
def _transient(phi: float, power: float, white: float, rows: int) -> tuple[Array, Array, float]:
    """The Kalman filter of the first `rows` as a matrix (rows, rows) on the readings, the prediction of the next one (rows,),
    and Σ log of the innovations' variances."""
    filtered, predicted = np.zeros((rows, rows)), np.zeros(rows)
    variance, logs = power, 0.0
    for t in range(rows):
        total = variance + white
        gain = variance / total
        innovation = -predicted
        innovation[t] += 1.0
        filtered[t] = innovation / np.sqrt(total)
        logs += float(np.log(total))
        predicted = phi * (predicted + gain * innovation)
        variance = phi**2 * variance * (1.0 - gain) + (1.0 - phi**2) * power
    return filtered, predicted, logs


def _steady(phi: float, power: float, white: float) -> float:
    """Steady prediction variance P = φ²·P·W/(P + W) + (1 - φ²)·σ_c² (scalar Riccati equation)."""
    source = (1.0 - phi**2) * power
    b = white * (1.0 - phi**2) - source
    return 0.5 * (-b + float(np.sqrt(b * b + 4.0 * source * white)))


def estimate_noise(blocks: Sequence[Block], declared: float, precision: Array) -> Noise:
    """The noise of these blocks. `precision` (k, k) is what the prior and all other data say about the parameters."""
    blocks = _head(blocks)
    count = sum(block.kept for block in blocks)
    white_only = Noise(declared, declared=declared)
    if count < 4:
        return white_only
    score = _objective(blocks, precision)
    best, best_score = white_only, score(white_only)
    scaled = _scaled(blocks, declared)
    if scaled.white > 1.005 * declared:
        better = _minimise(
            lambda x: Noise(declared * np.exp(abs(x[0])), declared=declared),
            [np.log(scaled.white / declared)],
            score,
            20,
        )
        if best_score - score(better) > chi2.isf(2 * LEVEL, 1):
            best, best_score = better, score(better)
    coloured = _with_coloured_part(blocks, declared, best, score)
    if coloured is not None and best_score - score(coloured) > chi2.isf(LEVEL, 2):
        best = coloured
    return best


def plain_noise(blocks: Sequence[Block], declared: float) -> Noise:
    """All of the residual as white, from its mean square."""
    residual = np.concatenate([block.residual[~block.left_out] for block in blocks])
    return Noise(max(declared, float(np.sqrt(np.mean(residual**2)))), declared=declared)


def long_run_variance(scores: Array) -> Array:
    """Variance (k, k) of the sum of a correlated vector series (N, k) with zero mean."""
    n = len(scores)
    scale = np.maximum(np.sqrt(np.mean(scores**2, axis=0)), 1e-300)
    unit = scores / scale
    rho = np.clip(np.sum(unit[1:] * unit[:-1], axis=0) / np.maximum(np.sum(unit**2, axis=0), 1e-300), 0.0, 0.97)
    alpha = float(np.mean(4.0 * rho**2 / (1.0 - rho**2) ** 2))
    window = min(n - 1, int(np.ceil(1.1447 * (alpha * n) ** (1.0 / 3.0))))
    total = scores.T @ scores
    for lag in range(1, window + 1):
        part = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / (window + 1.0)) * (part + part.T)
    return np.asarray(total)


def _head(blocks: Sequence[Block]) -> list[Block]:
    total = sum(len(block.residual) for block in blocks)
    if total <= MAX_ROWS:
        return list(blocks)
    return [block.head(max(TRANSIENT, len(block.residual) * MAX_ROWS // total)) for block in blocks]


def _scaled(blocks: Sequence[Block], declared: float) -> Noise:
    """The white noise that would explain the residual's median square, a start that outliers cannot move."""
    residual = np.concatenate([block.residual[~block.left_out] for block in blocks])
    return Noise(max(declared, float(np.median(np.abs(residual)) / 0.6745)), declared=declared)


def _with_coloured_part(
    blocks: Sequence[Block], declared: float, white: Noise, score: Callable[[Noise], float]
) -> Noise | None:
    """The best white and coloured part together, or None where a first look at the residuals finds no colour."""
    interval = float(np.median([block.interval for block in blocks]))
    longest = max(len(block.residual) for block in blocks)
    if longest < 8:
        return None
    span = np.log(max(longest, 8))
    plain = _first_look(blocks, interval)

    def noise(x: Sequence[float]) -> Noise:
        tau = interval * np.exp(np.clip(x[2], -1.5, span + 1.0))
        return Noise(
            float(declared * np.exp(abs(x[0]))),
            float(declared * np.exp(np.clip(x[1], -7.0, 9.0))),
            float(tau),
            declared,
        )

    start_white = np.log(max(white.white / declared, 1.0)) + 0.05
    starts = [[start_white, level, 0.25 * k * span] for k in (1, 2, 3) for level in (-1.0, 0.5)]
    rough = _minimise(noise, min(starts, key=lambda x: plain(noise(x))), plain, evaluations=150)
    if plain(white) - plain(rough) < chi2.isf(0.1, 2):
        return None
    x = [
        np.log(rough.white / declared) + 1e-3,
        np.log(rough.coloured / declared),
        np.log(rough.time_constant / interval),
    ]
    return _minimise(noise, x, score, evaluations=45)


def _minimise(
    make: Callable[[Sequence[float]], Noise], start: Sequence[float], score: Callable[[Noise], float], evaluations: int
) -> Noise:
    options = {"xatol": 5e-3, "fatol": 5e-2, "maxfev": evaluations}
    simplex = np.vstack([start, *(np.array(start) + 0.3 * row for row in np.eye(len(start)))])
    found = minimize(
        lambda x: score(make(x)), start, method="Nelder-Mead", options={**options, "initial_simplex": simplex}
    )
    return make(found.x)


def _first_look(blocks: Sequence[Block], interval: float) -> Callable[[Noise], float]:
    """-2 log likelihood of the residuals put end to end, by the steady filter alone: rough, and cheap."""
    residual = np.concatenate([np.where(b.left_out, 0.0, b.residual).ravel(order="F") for b in blocks])

    def score(noise: Noise) -> float:
        if noise.coloured <= 0.0:
            return float(residual @ residual) / noise.white**2 + 2.0 * len(residual) * float(np.log(noise.white))
        phi = float(np.exp(-interval / noise.time_constant))
        variance = _steady(phi, noise.coloured**2, noise.white**2)
        total = variance + noise.white**2
        innovations = lfilter([1.0, -phi], [1.0, -phi * (1.0 - variance / total)], residual)
        return float(innovations @ innovations) / total + len(residual) * float(np.log(total))

    return score


def _objective(blocks: Sequence[Block], precision: Array) -> Callable[[Noise], float]:
    """-2 log restricted likelihood of the noise, the parameters integrated out."""
    tables = [block.stacked() for block in blocks]
    size = len(precision)

    def gathered(noise: Noise) -> tuple[Array, float]:
        gram, value = np.zeros((size + 1, size + 1)), 0.0
        for block, table in zip(blocks, tables, strict=True):
            white, logs = whiten(table, noise, block.interval)
            flat = white.reshape(-1, table.shape[2])
            where = np.append(block.columns, size)
            gram[np.ix_(where, where)] += flat.T @ flat
            value += logs * table.shape[1]
        return gram, value

    plain, _ = gathered(Noise(1.0))
    count = sum(table.shape[0] * table.shape[1] for table in tables)

    def score(noise: Noise) -> float:
        if noise.coloured > 0.0:
            gram, value = gathered(noise)
        else:
            gram, value = plain / noise.white**2, 2.0 * count * float(np.log(noise.white))
        gram[:size, :size] += precision
        gram[np.diag_indices(size)] *= 1.0 + ROUNDING
        factor = np.linalg.cholesky(gram[:size, :size])
        pulled = np.linalg.solve(factor, gram[:size, size])
        return value + float(gram[size, size] - pulled @ pulled) + 2.0 * float(np.sum(np.log(np.diag(factor))))

    return score
