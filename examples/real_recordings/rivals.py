"""A fair rival: what an hour's work without physics makes of the same readings.

Three plain regressions of what the plain fit leaves, all on the same rows: a table over position and direction, a ridge
regression on harmonics or polynomials of every axis with its direction, speed and acceleration (of recordings in motion also a
few rows earlier and later), and gradient boosting of small trees on the same coordinates. Which of them suits a held-out part
best is chosen *by that part*, which favours the rival.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign, Run
from symfive.diagnose import Split, over_whole
from symfive.effects import moving
from symfive.identify import Identification
from symfive.inference import Problem
from symfive.motion import approach

Array = NDArray[np.float64]
Regression = Callable[[Array, Array, Array], Array]
"""(features to learn from, what to learn, features to predict at) → prediction."""
CELLS, ORDER, TONES = 20, 4, 8
"""Places of a table; order of harmonics and polynomials; tones over an axis."""
LAGS = (-4, -2, 2, 4)
"""Rows before and after, of a recording in motion."""
PENALTIES = 10.0 ** np.arange(-3.0, 5.0)
TREES, RATE, BINS, LEAST = 150, 0.1, 32, 4
"""Of the boosting: trees of two levels, what of each is taken, thresholds tried, rows in a leaf."""
FOLDS = 4


@dataclass(frozen=True)
class Rows:
    """What one column leaves in some runs: `coordinates` (N, 4·axes): position, direction, speed and acceleration of each axis
    that moves; `near` the same of neighbouring rows; `left` (N,), `run` (N,) numbers of the runs."""

    coordinates: Array
    near: Array
    left: Array
    run: NDArray[np.int64]


def best_rival(fit: Identification, campaign: Campaign, split: Split, unit: str) -> tuple[str, float]:
    """The name of the regression that predicts the held-out readings of a unit best on top of the plain fit, and their rms."""
    model, values = over_whole(fit, campaign, split)
    residual = {run.id: model.readings(run) - model.predict_run(run, values) for run in campaign.runs}
    problem = Problem.of(model)
    left = dict.fromkeys(RIVALS, 0.0)
    count = 0
    set_up = [run.id for run in campaign.runs if any(map(run.owns, model.parameters))]
    names: dict[str, list[tuple[Run, int]]] = {}
    for run in campaign.runs:
        columns = model.columns(run)
        for _, part in problem.parts(run):
            for k in range(*part.indices(len(columns))):
                if columns[k].unit == unit:
                    names.setdefault(columns[k].name, []).append((run, k))
    for each in names.values():
        known = _rows(campaign, fit.residuals, problem, [(run, k) for run, k in each if split.learn(run).any()])
        others = [(run, k) for run, k in each if not split.learn(run).any()]
        asked = _rows(campaign, residual, problem, others)
        zeros = [number for number, (run, _) in enumerate(others) if run.id in set_up]
        count += len(asked.left)
        for name, regression in RIVALS.items():
            rest = asked.left if not len(known.left) else asked.left - _predicted(regression, known, asked)
            left[name] += float(np.sum(_less_zeros(rest, asked.run, zeros) ** 2))
    best = min(left, key=lambda name: left[name])
    return best, float(np.sqrt(left[best] / max(count, 1)))


def _less_zeros(values: Array, run: NDArray[np.int64], zeros: Sequence[int]) -> Array:
    """Less the mean of each of some runs: those to which the model also gives a set-up of their own; a drive's force has none."""
    out = values.copy()
    for number in zeros:
        out[run == number] -= out[run == number].mean()
    return out


def _predicted(regression: Regression, known: Rows, asked: Rows) -> Array:
    with_near = regression is harmonic
    first, second = ((np.hstack([r.coordinates, r.near]) if with_near else r.coordinates) for r in (known, asked))
    return regression(first, known.left, second)


def _rows(campaign: Campaign, residual: Mapping[str, Array], problem: Problem, each: list[tuple[Run, int]]) -> Rows:
    """Of the readings that count."""
    axes = moving(campaign)
    width = 4 * len(axes)
    coordinates, near, left, numbers = [np.zeros((0, width))], [np.zeros((0, width * len(LAGS)))], [np.zeros(0)], [0]
    for number, (run, k) in enumerate(each):
        own = (
            np.column_stack([part for axis in axes for part in _motion(run, axis)]) if axes else np.zeros((run.rows, 0))
        )
        at = np.arange(run.rows)
        shifted = [own[np.clip(at + lag, 0, run.rows - 1)] * run.dynamic for lag in LAGS]
        counted = ~problem.undetermined[run.id][:, k]
        coordinates.append(own[counted])
        near.append(np.hstack(shifted)[counted])
        left.append(residual[run.id][counted, k])
        numbers += [number] * int(counted.sum())
    return Rows(np.vstack(coordinates), np.vstack(near), np.concatenate(left), np.array(numbers[1:], dtype=np.int64))


def _motion(run: Run, axis: str) -> tuple[Array, Array, Array, Array]:
    """Position, direction, speed and acceleration along a run."""
    q = np.asarray(run.commands[axis])
    if not run.dynamic or run.rows < 3:
        return q, approach(q), np.zeros(run.rows), np.zeros(run.rows)
    speed = np.gradient(q, run.time)
    return q, approach(q), speed, np.gradient(speed, run.time)


def table(known: Array, left: Array, asked: Array) -> Array:
    """Mean over the cells of position and direction of the axis that explains most, none where a cell was not seen."""
    best: tuple[float, Array] = (0.0, np.zeros(len(asked)))
    for k in range(0, known.shape[1], 4):
        edges = np.unique(np.quantile(known[:, k], np.linspace(0.0, 1.0, CELLS + 1)[1:-1]))
        cells, places = (2 * np.searchsorted(edges, x[:, k]) + (x[:, k + 1] > 0.0) for x in (known, asked))
        size = 2 * (len(edges) + 1)
        count = np.bincount(cells, minlength=size)
        mean = np.bincount(cells, left, minlength=size) / (count + 1.0)  # less where few were seen
        gain = float(np.sum(count * mean**2))
        if gain > best[0]:
            best = gain, mean[places]
    return best[1]


def harmonic(known: Array, left: Array, asked: Array) -> Array:
    """Ridge regression on functions of every coordinate, its penalty by cross-validation over stretches of rows."""
    functions, (first, second) = _functions(known, left), (known, asked)
    x, at = functions(first), functions(second)
    scale = np.maximum(x.std(axis=0), 1e-9)
    x, at = (np.hstack([np.ones((len(part), 1)), part / scale]) for part in (x, at))
    folds = np.array_split(np.arange(len(x)), FOLDS)
    scores = np.zeros(len(PENALTIES))
    for fold in folds:
        rest = np.setdiff1d(np.arange(len(x)), fold)
        if len(rest):
            for k, penalty in enumerate(PENALTIES):
                scores[k] += float(np.sum((left[fold] - x[fold] @ _ridge(x[rest], left[rest], penalty)) ** 2))
    return np.asarray(at @ _ridge(x, left, float(PENALTIES[np.argmin(scores)])))


def _ridge(x: Array, y: Array, penalty: float) -> Array:
    return np.asarray(np.linalg.solve(x.T @ x + penalty * np.eye(x.shape[1]), x.T @ y))


def _functions(known: Array, left: Array) -> Callable[[Array], Array]:
    """Harmonics of what goes round or is an angle's size, polynomials, their product with the direction, and tones."""
    spans = [(float(known[:, k].min()), float(known[:, k].max())) for k in range(known.shape[1])]
    used = [k for k, (low, high) in enumerate(spans) if high > low]
    tones = {k: _tones(known[:, k], left) for k in used if k % 4 == 0}

    def functions(x: Array) -> Array:
        found = []
        for k in used:
            low, high = spans[k]
            z = np.clip(2.0 * (x[:, k] - low) / (high - low) - 1.0, -1.0, 1.0)
            if k % 4:
                found += [z] if k % 4 == 1 else [z, z**2, z**3]
                continue
            own = [z**n for n in range(1, ORDER + 3)]
            own += [f(n * np.radians(x[:, k])) for n in range(1, ORDER + 1) for f in (np.cos, np.sin)]
            own += [f(2.0 * np.pi * rate * x[:, k]) for rate in tones[k] for f in (np.cos, np.sin)]
            found += [*own, *(part * x[:, k + 1] for part in own)]
        return np.column_stack(found) if found else np.zeros((len(x), 0))

    return functions


def _tones(q: Array, left: Array) -> list[float]:
    """Cycles per unit of the strongest periodic parts over a coordinate, one after the other."""
    reach = float(np.ptp(q))
    count = min(len(np.unique(q)) // 4, 500)
    rates, rest, found = np.arange(1, 2 * count) / (2.0 * reach), left - left.mean(), list[float]()
    for _ in range(TONES if count > 20 else 0):
        waves = np.exp(-2j * np.pi * np.outer(rates, q))
        found.append(float(rates[np.argmax(np.abs(waves @ rest))]))
        x = np.column_stack([f(2.0 * np.pi * rate * q) for rate in found for f in (np.cos, np.sin)])
        rest = left - left.mean() - x @ np.linalg.lstsq(x, left - left.mean(), rcond=None)[0]
    return found


def boosted(known: Array, left: Array, asked: Array) -> Array:
    """Gradient boosting of trees of two levels (J. Friedman 2001)."""
    edges = [np.unique(np.quantile(column, np.linspace(0.0, 1.0, BINS + 1)[1:-1])) for column in known.T]
    first, second = ([np.searchsorted(e, x[:, k]) for k, e in enumerate(edges)] for x in (known, asked))
    rest, answer = left - left.mean(), np.full(len(asked), left.mean())
    for _ in range(TREES if len(left) >= 4 * LEAST else 0):
        split = _split(first, rest, np.ones(len(rest), dtype=bool))
        if split is None:
            break
        for side in (False, True):
            rows, there = ((x[split[0]] > split[1]) == side for x in (first, second))
            leaf = _split(first, rest, rows)
            for end in (False, True):
                inner, outer = rows, there
                if leaf is not None:
                    inner, outer = (
                        rows & ((first[leaf[0]] > leaf[1]) == end),
                        there & ((second[leaf[0]] > leaf[1]) == end),
                    )
                elif end:
                    break
                step = RATE * rest[inner].sum() / (inner.sum() + 1.0)
                rest[inner] -= step
                answer[outer] += step
    return answer


def _split(bins: list[NDArray[np.int64]], rest: Array, rows: NDArray[np.bool_]) -> tuple[int, int] | None:
    """Coordinate and threshold that divide some rows best; None where none leaves enough on both sides."""
    best: tuple[float, tuple[int, int]] | None = None
    count, total = int(rows.sum()), float(rest[rows].sum())
    for k, column in enumerate(bins):
        below = np.cumsum(np.bincount(column[rows], minlength=BINS))
        sums = np.cumsum(np.bincount(column[rows], rest[rows], minlength=BINS))
        able = (below >= LEAST) & (count - below >= LEAST)
        if able.any():
            gain = np.where(
                able, sums**2 / np.maximum(below, 1) + (total - sums) ** 2 / np.maximum(count - below, 1), -1.0
            )
            at = int(np.argmax(gain))
            if best is None or gain[at] > best[0]:
                best = float(gain[at]), (k, at)
    return None if best is None else best[1]


RIVALS: Mapping[str, Regression] = {"table": table, "harmonic regression": harmonic, "boosted trees": boosted}
