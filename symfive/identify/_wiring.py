"""Files whose readings are something else than their columns and lines say: a sign, the columns, the unit or, of rows at
rest, the line of a run.

A fit is linear in small errors, so what it would leave of other readings follows from its normal equations. Whether a run, or all
of the same columns, hold other readings is decided by the odds of the two fits, each with the noise that it needs; a unit 1000
times as large takes 1000 times as much of the density of each reading. No library of physics is complete: the likelihood counts
to the power 1/(1 + N), N the divergence of what the better fit leaves from the declared noise (S. Kullback & R. A. Leibler 1951;
J. W. Miller & D. B. Dunson 2019), so that other readings are believed only where they explain nearly all of the residual, beside
what else may act.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from symfive.arrays import Array
from symfive.effects import Effect
from symfive.identify._result import Identification
from symfive.instruments import INSTRUMENTS, instruments_of
from symfive.model import Model
from symfive.numbers import plain_number

MOST_COLUMNS = 3
UNITS = {1e-3: "1000 times too large", 1e3: "1000 times too small"}
ODDS = 0.01
"""Prior odds that a run holds other readings: one set-up in a hundred."""
SURE = 100.0
"""Odds at which it is said."""
MOST_ROWS = 20_000
Part = tuple[str, str]
"""Run and instrument."""


@dataclass(frozen=True)
class _Other:
    """Other readings, in words: y = matrix · readings or, where there is none, those so many `lines` further down."""

    words: str
    matrix: Array | None = None
    lines: int = 0

    @property
    def turns_all(self) -> bool:
        """Whether several signs are turned: with those of the errors, too, these may be the same readings."""
        return self.matrix is not None and int(np.sum(self.matrix < 0.0)) > 1

    @property
    def density(self) -> float:
        """Of a row of them, over that of the readings (log)."""
        return 0.0 if self.matrix is None else float(np.linalg.slogdet(self.matrix)[1])


MOVED = (_Other("every reading one line further up", lines=-1), _Other("every reading one line further down", lines=1))
"""A reading forgotten, or one too many, where somebody writes them line by line."""


def wiring_doubts(fit: Identification, beside: Sequence[Effect] = ()) -> tuple[str, ...]:
    """The other readings that explain what a fit leaves, in words; nothing where the fit explains its readings, or none do.

    `beside` are effects that may act as well, each of its usual size: they explain what they can of either readings.
    """
    places, campaign = _places(fit), fit.model.campaign
    tried = [
        (where, other)
        for where, columns in places.items()
        for other in (*_wirings(columns), *(() if any(campaign.run(run).dynamic for run, _ in where) else MOVED))
    ]
    if not tried or campaign.rows > MOST_ROWS:
        return ()
    model = Model(campaign, (*fit.model.added, *beside)) if beside else fit.model
    for excluded in (True, False)[: 1 + bool(fit.outliers)]:
        if said := _said(fit, model, places, tried, excluded):
            return said
    return ()


def _said(
    fit: Identification,
    model: Model,
    places: Mapping[tuple[Part, ...], tuple[str, ...]],
    tried: Sequence[tuple[tuple[Part, ...], _Other]],
    excluded: bool,
) -> tuple[str, ...]:
    """The best of the other readings that are `tried`, in words, if it is sure; without the readings that the fit
    `excluded`, or with them: what are outliers as they are read may be none as they were meant."""
    campaign, limit = fit.model.campaign, np.log(SURE / ODDS * len(tried))
    if excluded and fit.chi2_dof * fit.dof < fit.dof + 2.0 * limit:
        return ()
    sums = _Sums(fit, model, [part for part in places if len(part) == 1], excluded)
    now, count = sums.left({}), sums.count
    found: list[tuple[float, tuple[Part, ...], str, float]] = []
    for where, other in tried:
        if len(where) == len(campaign.runs) and other.turns_all:
            continue
        left = sums.left(dict.fromkeys(where, other))
        density = sum(sums.rows[part] for part in where) * other.density
        wide = max(left / count, 1.0)
        gain = 0.5 * count * np.log(max(now / count, 1.0) / wide) + density
        found.append((gain / (1.0 + 0.5 * count * (wide - 1.0 - np.log(wide))), where, other.words, left))
    best, where, name, left = max(found, key=lambda each: each[0])
    if best <= limit:
        return ()
    same = [other for gain, other, its, _ in found if its == name and len(other) == 1 and gain > best - np.log(SURE)]
    runs = " or ".join(_runs_words(other, fit) for other in (same if len(where) == 1 else [where]))
    before, after = (plain_number(float(np.sqrt(max(square, 0.0) / count))) for square in (now, left))
    return (
        f"{runs}: {name} would explain the readings: the residual falls from {before} to {after} times the noise; check wiring, "
        "columns, lines and units, correct the file, and repeat",
    )


def _places(fit: Identification) -> dict[tuple[Part, ...], tuple[str, ...]]:
    """Where other readings may be, with their columns: each run, and all whose columns are the same."""
    campaign, alike = fit.model.campaign, dict[tuple[str, ...], list[Part]]()
    for run in campaign.runs:
        for instrument in instruments_of(run):
            columns = tuple(column.name for column in instrument.columns(run, campaign.machine))
            if instrument.wired and len(columns) <= MOST_COLUMNS and set(columns) <= set(run.readings):
                alike.setdefault(columns, []).append((run.id, instrument.name))
    single = {(part,): columns for columns, parts in alike.items() for part in parts}
    return single | {tuple(parts): columns for columns, parts in alike.items()}


def _runs_words(where: tuple[Part, ...], fit: Identification) -> str:
    names = list(dict.fromkeys(run for run, _ in where))
    if len(names) > 1:
        return "all runs" if len(names) == len(fit.model.campaign.runs) else f"runs {', '.join(names)}"
    return f"run {names[0]}"


@cache
def _wirings(columns: tuple[str, ...]) -> tuple[_Other, ...]:
    """What else columns may hold: others of them, their signs, another unit."""
    names = [column.rpartition("_")[0] for column in columns]
    units = (_Other(f"{' and '.join(names)} {said}", g * np.eye(len(columns))) for g, said in UNITS.items())
    return (*_reordered(names), *units)


def _reordered(names: Sequence[str]) -> Iterator[_Other]:
    """Every other assignment of the sensors to the columns, and their signs."""
    count = len(names)
    for order in itertools.permutations(range(count)):
        for signs in itertools.product((1.0, -1.0), repeat=count):
            matrix = np.zeros((count, count))
            matrix[range(count), order] = signs
            if not np.array_equal(matrix, np.eye(count)):
                yield _Other(_words(names, order, signs), matrix)


def _words(names: Sequence[str], order: Sequence[int], signs: Sequence[float]) -> str:
    """Such a wiring in words."""
    moved = [i for i in range(len(names)) if order[i] != i]
    said = []
    if len(moved) == 2:
        said.append(f"{names[moved[0]]} and {names[moved[1]]} exchanged")
    elif moved:
        said.append(f"{', '.join(names)} in the order {', '.join(names[i] for i in order)}")
    reversed_ = [names[i] for i in range(len(names)) if signs[i] < 0.0]
    if reversed_:
        said.append(f"{' and '.join(reversed_)} reversed in sign")
    return ", ".join(said)


class _Sums:
    """What the readings of some `parts` of a campaign do to the sum of squares that a `model` leaves of them, linear about a fit,
    parameters by their prior 1σ, readings by their declared noise; without those that the fit `excluded`, or with them."""

    def __init__(self, fit: Identification, model: Model, parts: Collection[tuple[Part, ...]], excluded: bool) -> None:
        problem, sigma, values = fit.problem(model), model.prior_sigma, model.vector(fit.named)
        slopes, left = [np.eye(len(sigma))], [(model.prior_mean - values) / sigma]
        self.count = 0
        self.rows, self._columns, self._at = dict[Part, int](), dict[Part, int](), dict[tuple[Part, int], int]()
        changes, here = list[tuple[int, Array]](), len(sigma)
        for (id, instrument), block in problem.blocks(values).items():
            weight = ~(block.left_out & excluded) / problem.noises[id, instrument].declared
            table = np.zeros((*weight.shape, len(sigma)))
            table[:, :, block.columns] = block.jacobian * sigma[block.columns] * weight[:, :, None]
            slopes.append(table.reshape(weight.size, -1))
            left.append((block.residual * weight).ravel())
            self.count += int(np.count_nonzero(weight))
            part = (id, instrument)
            if (part,) in parts:
                run = model.campaign.run(id)
                columns = [column.name for column in INSTRUMENTS[instrument].columns(run, model.campaign.machine)]
                read = np.stack([run.readings[name] for name in columns], axis=1)
                self.rows[part], self._columns[part] = run.rows, len(columns)
                self._at[part, 0] = len(changes)
                for place, name in itertools.product(np.eye(len(columns)), columns):
                    changes.append((here, (run.readings[name][:, None] * place * weight).ravel()))
                for other in () if run.dynamic else MOVED:
                    self._at[part, other.lines] = len(changes)
                    changes.append((here, ((np.roll(read, other.lines, axis=0) - read) * weight).ravel()))
                    free = np.zeros((run.rows, len(columns)))
                    free[0 if other.lines > 0 else -1] = 1.0  # the row that no reading is left for
                    changes += [(here, (free * place).ravel()) for place in np.eye(len(columns))]
            here += weight.size
        moved = np.zeros((here, len(changes) + 1))
        moved[:, -1] = np.concatenate(left)
        for number, (first, change) in enumerate(changes):
            moved[first : first + len(change), number] = change
        matrix = np.concatenate(slopes)
        factor = np.linalg.cholesky(matrix.T @ matrix)
        for _ in range(2):  # the second time takes away what rounding left of columns that the model explains
            moved -= matrix @ np.linalg.solve(factor.T, np.linalg.solve(factor, matrix.T @ moved))
        self._square = moved.T @ moved

    def left(self, others: Mapping[Part, _Other]) -> float:
        """χ², priors included, that the fit leaves where some parts hold other readings: of noise as declared the `count`."""
        change, free = np.zeros(len(self._square)), list[int]()
        change[-1] = 1.0
        for part, other in others.items():
            at, columns = self._at[part, other.lines], self._columns[part]
            if other.matrix is None:
                change[at] = 1.0
                free += range(at + 1, at + 1 + columns)
            else:
                change[at : at + columns**2] = (other.matrix - np.eye(columns)).ravel()
        gone = self._square[free] @ change
        best = np.linalg.lstsq(self._square[np.ix_(free, free)], gone, rcond=None)[0]
        return float(change @ self._square @ change - gone @ best)
