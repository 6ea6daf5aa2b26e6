"""Isolated readings that noise cannot explain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from symfive.arrays import Array, Flags
from symfive.disk import new_table, release
from symfive.inference._noise import Block, Key
from symfive.inference._whitening import Noise, Whitening, whiten
from symfive.inference._windows import spans_of

OUTLIER_LEVEL = 0.01
LONGEST_OUTLIER = 3
MOST_LEVERAGE = 0.99
"""A reading that alone determines a parameter leaves nothing of its noise in the residual."""
MOST_SNOOPED = 1000
"""So many readings beyond the limit are the mismatch of a model; each step takes their number squared."""
RESPONSE_ROWS = 200


@dataclass(frozen=True)
class Outlier:
    """A reading that the noise cannot explain: run, row (from 0), column, residual in the column's unit, in σ."""

    run: str
    row: int
    column: str
    residual: float
    sigmas: float


def outlier_limit(readings: int) -> float:
    """What noise exceeds once in 1/`OUTLIER_LEVEL` campaigns of so many readings, in σ."""
    return -NormalDist().inv_cdf(0.5 * OUTLIER_LEVEL / max(readings, 1))


def isolated_outliers(block: Block, noise: Noise, limit: float, leverage: Array) -> tuple[list[tuple[int, int]], Array]:
    """(row, column) of isolated innovations beyond `limit` σ, and all innovations (N, ny) in σ.

    Each over its own σ: a reading with the `leverage` h (N, ny) draws the fit towards itself, and leaves σ·√(1 - h) of its noise
    in the residual; one that the fit excludes, σ·√(1 + h) (W. Baarda 1968). More than a few neighbouring rows, or a level that
    stays, are no outlier but a mismatch.
    """
    count, columns = block.residual.shape
    table, whitening = new_table(count, columns), Whitening(noise, block.interval)
    beyond: list[list[int]] = [[] for _ in range(columns)]
    for rows in spans_of(count):
        share = np.where(block.left_out[rows], 1.0 + leverage[rows], 1.0 - leverage[rows])
        table[rows] = whitening(np.array(block.residual[rows])) / np.sqrt(share)
        for j in range(columns):
            beyond[j] += (rows.start + np.flatnonzero(np.abs(table[rows, j]) > limit)).tolist()
        release(table, block.residual)
    response = _response(noise, block.interval)
    found = []
    for j in range(columns):
        for group in _isolated(_disturbed(beyond[j], table[:, j], response, limit)):
            if _returns(np.array(table[group[0] : group[0] + RESPONSE_ROWS, j]), response):
                found += [(row, j) for row in group]
    return found, table


def leverage_of(
    blocks: Mapping[Key, Block], covariance: Array, noises: Mapping[Key, Noise]
) -> dict[Key, tuple[Block, Array]]:
    """Every recording, and h = diag(J C Jᵀ) of its whitened readings (N, ny), C the `covariance` (k, k)."""
    found = {}
    for key, block in blocks.items():
        slopes = whiten(block.jacobian, noises[key], block.interval)[0]
        inner = covariance[np.ix_(block.columns, block.columns)]
        found[key] = block, np.minimum(np.einsum("nyk,nyk->ny", slopes @ inner, slopes), MOST_LEVERAGE)
    return found


def one_by_one(
    blocks: Mapping[Key, Block], covariance: Array, noises: Mapping[Key, Noise], limit: float
) -> dict[Key, Flags]:
    """Which readings (N, ny) stay beyond `limit` σ when the worse ones are left out: these bend the fit, and by that the
    residuals of good ones (data snooping, W. Baarda 1968). Of more than `MOST_SNOOPED`, those that are left out already.

    Without one reading the innovation of another changes by G/(1 - G) of that reading's, G = J C Jᵀ.
    """
    found = {key: block.left_out.copy() for key, block in blocks.items()}
    places, rows, values = list[tuple[Key, int, int]](), list[Array](), list[float]()
    for key, (block, leverage) in leverage_of(blocks, covariance, noises).items():
        white = whiten(block.stacked(), noises[key], block.interval)[0]
        for row, j in np.argwhere((np.abs(white[:, :, -1]) > limit * np.sqrt(1.0 - leverage)) & ~block.left_out):
            slope = np.zeros(len(covariance))
            slope[block.columns] = white[row, j, :-1]
            places.append((key, int(row), int(j)))
            rows.append(slope)
            values.append(float(white[row, j, -1]))
    if not 0 < len(places) <= MOST_SNOOPED:
        return found
    gram, innovation = np.array(rows) @ covariance @ np.array(rows).T, np.array(values)
    left = np.ones(len(places), dtype=bool)
    while left.any():
        share = np.maximum(1.0 - np.diag(gram), 1.0 - MOST_LEVERAGE)
        sigmas = np.where(left, np.abs(innovation) / np.sqrt(share), 0.0)
        worst = int(np.argmax(sigmas))
        if sigmas[worst] <= limit:
            break
        key, row, j = places[worst]
        left[worst], found[key][row, j] = False, True
        pull = gram[:, worst] / share[worst]
        innovation, gram = innovation + pull * innovation[worst], gram + np.outer(pull, gram[worst])
    return {key: short_groups(mask) | blocks[key].left_out for key, mask in found.items()}


def short_groups(mask: Flags) -> Flags:
    """Those of some readings (N, ny) that stand in groups short enough to be outliers."""
    kept = np.zeros_like(mask)
    for j in range(mask.shape[1]):
        for group in _isolated(np.flatnonzero(mask[:, j]).tolist()):
            kept[group, j] = True
    return kept


def _disturbed(rows: list[int], innovations: Array, response: Array, limit: float) -> list[int]:
    """Which of the `rows` are beyond `limit` without what short groups of them before cause: under slow noise one disturbed
    reading draws the innovations of many after it."""
    found, causes, length = list[int](), list[tuple[int, float]](), 0
    for row in rows:
        causes = [(at, size) for at, size in causes if row - at < len(response)]
        rest = float(innovations[row]) - sum(size * response[row - at] for at, size in causes)
        if abs(rest) <= limit:
            continue
        length = length + 1 if found and row == found[-1] + 1 else 1
        found.append(row)
        if length <= LONGEST_OUTLIER:
            causes.append((row, rest / float(response[0])))
        else:  # a mismatch, and no disturbance of single readings
            causes = [(at, size) for at, size in causes if at <= row - length]
    return found


def _response(noise: Noise, interval: float) -> Array:
    """Innovations that a disturbance of one reading causes, long after the start of a run."""
    impulse = np.zeros((2 * RESPONSE_ROWS, 1))
    impulse[RESPONSE_ROWS] = 1.0
    return whiten(impulse, noise, interval)[0][RESPONSE_ROWS:, 0]


def _returns(innovations: Array, response: Array) -> bool:
    """Whether a disturbance is one of a single reading and not a new level, by the larger of both likelihood ratios
    (I. Chang, G. Tiao & C. Chen 1988)."""
    count = min(len(innovations), len(response))
    single, level = response[:count], np.cumsum(response[:count])
    part = innovations[:count]
    return bool(abs(part @ single) / np.linalg.norm(single) >= abs(part @ level) / np.linalg.norm(level))


def _isolated(rows: list[int]) -> list[list[int]]:
    """Groups of neighbouring rows short enough to be outliers."""
    groups: list[list[int]] = []
    for row in rows:
        if groups and row - groups[-1][-1] <= 1:
            groups[-1].append(row)
        else:
            groups.append([row])
    return [group for group in groups if len(group) <= LONGEST_OUTLIER]
