"""The noise of a recording, estimated together with the fit: which parts it has, and how large they are.

The white part is never below what the data sheet declares; whether there is a coloured one, a likelihood ratio at 1 % decides.
Their sizes maximise the restricted likelihood (REML: Patterson & Thompson 1971), in which the parameters that the fit has already
spent are accounted for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Flags, Indices
from symfive.disk import release
from symfive.inference._whitening import Noise, Whitening, innovations, steady_filter, whiten
from symfive.inference._windows import spans_of

Key = tuple[str, str]
"""A recording: run and instrument."""
LEVEL = 0.01
SHORT = 100
LOUD = 2.0
"""An instrument's noise does not differ from run to run by more than this factor."""
LOUDER = ((0.0, 20.0), (-7.0, 9.0))
"""Logarithms between which the white and the coloured part are sought, over the declared noise."""
SHORTEST = -1.5
"""Logarithm of the shortest time constant sought, in rows."""
SETTLED = 1e-2
"""-2 log likelihood by which a step has to lower it: a hundredth of what one degree of freedom takes."""
STEP = 0.01
"""Of the differences that slopes and curvatures are taken from: 1 % of a size, or 1 % of its standard deviation."""
ROUNDING = 1e-12
"""What is added to the diagonal so that rounding cannot make an eigenvalue negative."""


@dataclass(frozen=True)
class Block:
    """One run's readings of one instrument: `residual` (N, ny), `jacobian` (N, ny, k), `columns` (k,), row `interval` s.

    Of a long run `jacobian` may hold the first rows only. Rows in `left_out` (N, ny) are outliers: they carry no information.
    """

    residual: Array
    jacobian: Array
    columns: Indices
    interval: float
    left_out: Flags

    @property
    def kept(self) -> int:
        """Number of readings that count."""
        return int(self.left_out.size - self.left_out.sum())

    def stacked(self) -> Array:
        """(N, ny, k + 1): jacobian and residual with the outliers emptied."""
        table = np.concatenate([self.jacobian, self.residual[:, :, None]], axis=2)
        if self.left_out.any():
            table[self.left_out] = 0.0
        return table

    @property
    def whole(self) -> bool:
        """Whether the slopes of all rows are there."""
        return len(self.jacobian) == len(self.residual)

    @property
    def head(self) -> Block:
        """Its first rows, of which the slopes are there."""
        rows = len(self.jacobian)
        return Block(self.residual[:rows], self.jacobian[:rows], self.columns, self.interval, self.left_out[:rows])


def estimate_noise(blocks: Sequence[Block], declared: float, precision: Array) -> Noise:
    """The noise of these blocks, of long ones of their heads. `precision` (k, k) is what the prior and all other data say
    about the parameters."""
    blocks = [block.head for block in blocks]
    count = sum(block.kept for block in blocks)
    white_only = Noise(declared, declared=declared)
    if count < 4:
        return white_only
    score = _objective(blocks, precision)
    best, best_score = white_only, score(white_only)
    start = np.log([max(_scaled(blocks, declared).white / declared, 1.05)])
    better = _minimise(lambda x: Noise(declared * float(np.exp(x[0])), declared=declared), start, LOUDER[:1], score)
    if score(better) < best_score:
        best, best_score = better, score(better)
    coloured = _with_coloured_part(blocks, declared, best, score)
    if coloured is not None and best_score - score(coloured) > _exceeded(LEVEL):
        best = coloured
    return best


def plain_noise(blocks: Sequence[Block], declared: float) -> Noise:
    """All of the residual as white, from its mean square."""
    square = sum(square_of(block.residual, block.left_out) for block in blocks)
    return Noise(max(declared, float(np.sqrt(square / max(sum(b.kept for b in blocks), 1)))), declared=declared)


def quiet_ones(blocks: Mapping[Key, Block], noises: Mapping[Key, Noise]) -> list[Key]:
    """Recordings that are no more than `LOUD` times as loud, once whitened, as their median, or too short to tell."""
    powers = {key: _power(block, noises[key]) for key, block in blocks.items()}
    limit = LOUD**2 * float(np.median(list(powers.values())))
    return [key for key, power in powers.items() if power <= limit or len(blocks[key].residual) < SHORT]


def _power(block: Block, noise: Noise) -> float:
    """Mean square of a whitened recording. The largest tenth of the readings does not count: these may be outliers."""
    whitening, total, count = Whitening(noise, block.interval), 0.0, 0
    for rows in spans_of(len(block.residual)):
        left_out = block.left_out[rows]
        squares = np.sort(whitening(np.where(left_out, 0.0, block.residual[rows]))[~left_out] ** 2)
        release(block.residual)
        if len(squares):
            total += len(squares) * float(np.mean(squares[: max(1, int(0.9 * len(squares)))]))
            count += len(squares)
    return total / max(count, 1)


def square_of(residual: Array, left_out: Flags) -> float:
    """Sum of the squares that are not left out, (N, ny)."""
    total = 0.0
    for rows in spans_of(len(residual)):
        total += float(np.sum(residual[rows][~left_out[rows]] ** 2))
        release(residual)
    return total


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
    span = float(np.log(longest))
    bounds = [*LOUDER, (SHORTEST, span + 1.0)]
    plain = _first_look(blocks, interval)

    def noise(x: Array) -> Noise:
        louder, level, tau = (float(v) for v in np.exp(x))
        return Noise(declared * louder, declared * level, interval * tau, declared)

    start_white = np.log(max(white.white / declared, 1.0)) + 0.05
    starts = [np.array([start_white, level, 0.25 * k * span]) for k in (1, 2, 3) for level in (-1.0, 0.5)]
    rough = _minimise(noise, min(starts, key=lambda x: plain(noise(x))), bounds, plain)
    if plain(white) - plain(rough) < _exceeded(0.1):
        return None
    found = np.log([rough.white / declared, rough.coloured / declared, rough.time_constant / interval])
    return _minimise(noise, found, bounds, score)


def _exceeded(level: float) -> float:
    """What a χ² of two degrees of freedom, exp(-x/2) beyond x, exceeds with the probability `level`."""
    return -2.0 * math.log(level)


def _minimise(
    make: Callable[[Array], Noise], start: Array, bounds: Sequence[tuple[float, float]],
    score: Callable[[Noise], float],
) -> Noise:  # fmt: skip
    """The noise at the minimum that is reached from `start`, logarithms of its sizes, within their bounds.

    L-BFGS-B (R. Byrd et al. 1995), each logarithm in units of its curvature at the start: the white part is known hundreds of
    times better than a slow one, and steps in equal units end in the valley's wall.
    """
    from scipy.optimize import minimize

    low, high = np.transpose(bounds)
    first = np.clip(start, low + STEP, high - STEP)
    least = score(make(first))
    either = [score(make(first + step)) + score(make(first - step)) for step in STEP * np.eye(len(first))]
    unit = np.maximum(np.abs(np.array(either) - 2.0 * least) / STEP**2, 1.0) ** -0.5
    found = minimize(
        lambda x: score(make(x * unit)), first / unit, method="L-BFGS-B",
        bounds=np.transpose([low / unit, high / unit]), options={"eps": STEP, "ftol": SETTLED / max(abs(least), 1.0)},
    )  # fmt: skip
    return make(found.x * unit)


def _first_look(blocks: Sequence[Block], interval: float) -> Callable[[Noise], float]:
    """-2 log likelihood of the residuals put end to end, by the steady filter alone: rough, and cheap."""
    residual = np.concatenate([np.where(b.left_out, 0.0, b.residual).ravel(order="F") for b in blocks])

    def score(noise: Noise) -> float:
        if noise.coloured <= 0.0:
            return float(residual @ residual) / noise.white**2 + 2.0 * len(residual) * float(np.log(noise.white))
        steady = steady_filter(noise.correlation(interval), noise.coloured**2, noise.white**2)
        white = innovations(residual[:, None], steady, np.zeros((noise.decades, 1)))[0].ravel()
        return float(white @ white) / steady.variance + len(residual) * float(np.log(steady.variance))

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
