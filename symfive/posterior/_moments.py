"""Moments: whitened Gram matrices, the search's only data.

Whitened Gram matrices of [set-up | geometry | terms | exact contributions | residual] per noise node, columns times their prior
1σ, rows over the declared noise. Each run's set-up is eliminated in its own matrix, the runs are added up, and the geometry is
eliminated from the sum (priors included).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from symfive.arrays import Array, Flags, Indices
from symfive.campaign import Run
from symfive.effects import Form
from symfive.identify import Identification
from symfive.instruments import has_clock_of_its_own
from symfive.posterior._eliminate import Total, eliminated, eliminated_rows
from symfive.posterior._noise import EXACT_ROWS, Bands, Node, grams, nodes_of, whitened
from symfive.posterior._tables import STATED, Columns, Scale, Table, Tables
from symfive.posterior._terms import Term, terms_of

__all__ = ["Alike", "Columns", "Known", "Moments", "moments_of", "of_electronics", "usual_noises"]

T = TypeVar("T")


@dataclass(frozen=True)
class Alike:
    """Terms of as many columns, `numbers` (T,): the fields of each one's `Columns`, (T, n) and (T,), and `gram` (J, T, n, n)."""

    numbers: tuple[int, ...]
    where: Indices
    amplitude: Flags
    departure: Array
    lower: Array
    exact: Indices
    gram: Array

    def some(self, rows: Sequence[int]) -> Alike:
        """Those in some rows."""
        if len(rows) == len(self.numbers):
            return self
        numbers = tuple(self.numbers[row] for row in rows)
        fields = self.where[rows], self.amplitude[rows], self.departure[rows], self.lower[rows], self.exact[rows]
        return Alike(numbers, *fields, self.gram[:, rows])


@dataclass(frozen=True)
class Moments:
    """Reduced Gram matrices `gram` (J, m, m) of the terms' columns, the exact contributions and, last, the residual, by noise
    node; `const` (J,) what every subset has in -2·log evidence, `log_prior` (J,) of the nodes, `count` of readings.

    `terms`: those that are held by the fit come first (`held` of them). `blocks`: the number of the unidentified term that is a
    named one's discrepancy, -1 where there is none; `raw` (m, m) the Gram matrix under white noise before anything is eliminated;
    `rows` (J, r, m), of which `gram` is the product, where they are fewer than the columns. `alone`: the same with the slopes of
    fresh terms without what the fit holds, None where there are none.
    """

    fit: Identification
    terms: tuple[Term, ...]
    columns: tuple[Columns, ...]
    held: int
    nodes: tuple[Node, ...]
    gram: Array
    const: Array
    log_prior: Array
    count: int
    blocks: tuple[int, ...]
    raw: Array
    rows: Array | None = None
    alone: Moments | None = None
    _known: dict[Hashable, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def once(self, what: Hashable, make: Callable[[], T]) -> T:
        """What `make` finds of these moments; searches ask for the same subsets again."""
        if what not in self._known:
            self._known[what] = make()
        found: T = self._known[what]
        return found

    def about(self, members: Iterable[tuple[int, float]]) -> Moments:
        """The moments that hold for a subset: if it lacks what the fit holds, terms have no slope that they owe to that."""
        if self.alone is None or sum(number < self.held for number, _ in members) == self.held:
            return self
        return self.alone

    def tempered(self, factor: float, log_prior: Array, const: Array) -> Moments:
        """All Gram matrices times a factor, under noise whose nodes are so probable and cost every subset `const` (J,)."""
        alone = self.alone.tempered(factor, log_prior, const) if self.alone is not None else None
        return replace(self, gram=self.gram * factor, rows=None, const=const, log_prior=log_prior, alone=alone)

    @cached_property
    def alike(self) -> tuple[Alike, ...]:
        """All terms, those of as many columns together, with an exact contribution and without apart."""
        groups: dict[tuple[int, bool], list[int]] = {}
        for number, columns in enumerate(self.columns):
            groups.setdefault((len(columns.where), columns.exact >= 0), []).append(number)
        found = []
        for numbers in groups.values():
            own = [self.columns[number] for number in numbers]
            where = np.stack([c.where for c in own])
            amplitude, departure = np.stack([c.amplitude for c in own]), np.stack([c.departure for c in own])
            lower, exact = np.stack([c.lower for c in own]), np.array([c.exact for c in own])
            gram = self.gram[:, where[:, :, None], where[:, None, :]]
            found.append(Alike(tuple(numbers), where, amplitude, departure, lower, exact, gram))
        return tuple(found)

    @cached_property
    def proportional(self) -> tuple[bool, ...]:
        """Of every term whether the readings are proportional to its amplitudes."""
        return tuple(term.form.proportional(self.fit.model.campaign) for term in self.terms)

    @property
    def size(self) -> int:
        """Columns, the residual's included."""
        return int(self.gram.shape[1])


def moments_of(
    fit: Identification, held: Sequence[Form], fresh: Sequence[Form], noises: Sequence[Node] = ()
) -> Moments:
    """The moments of a fit: `held` the forms of its effects beyond the machine file's, in order, `fresh` those that may join;
    under some `noises`, the usual ones where none are given."""
    tables = Tables(fit, [form.effect for form in held], fresh)
    return _reduced(tables, held, fresh, noises or usual_noises(fit), ((table, None) for table in tables))


@dataclass(frozen=True)
class Known:
    """The moments of what a fit holds, under any noise, by bands."""

    tables: Tables
    held: tuple[Form, ...]
    parts: tuple[tuple[Table, Bands], ...]

    @classmethod
    def of(cls, fit: Identification, held: Sequence[Form]) -> Known:
        """Of a fit, and the forms of its effects beyond the machine file's, in order."""
        tables = Tables(fit, [form.effect for form in held], ())
        return cls(tables, tuple(held), tuple((table, Bands.of(table.rows, table.interval)) for table in tables))

    def moments(self, noises: Sequence[Node]) -> Moments:
        """Under some noises."""
        return _reduced(self.tables, self.held, (), noises, self.parts)


def usual_noises(fit: Identification) -> tuple[Node, ...]:
    """The nodes of a campaign's noise."""
    runs = fit.model.campaign.runs
    readings = sum(run.rows * len(fit.model.columns(run)) for run in runs)
    return nodes_of(max(map(_recorded, runs)), min(run.interval for run in runs), readings, of_electronics(fit))


def of_electronics(fit: Identification) -> bool:
    """Whether all noise is that of instruments: what the control itself records holds counts, and physics."""
    return all(map(has_clock_of_its_own, fit.model.campaign.runs))


def _reduced(
    tables: Tables,
    held: Sequence[Form],
    fresh: Sequence[Form],
    noises: Sequence[Node],
    parts: Iterable[tuple[Table, Bands | None]],
) -> Moments:
    """The moments of tables, set-up and geometry eliminated; from the bands of those where they are known."""
    scales = tables.scales
    nodes = tuple(replace(n, log_prior=n.log_prior + scale.log_prior) for scale in scales for n in noises)
    departure = np.repeat([tables.departure / scale.geometry for scale in scales], len(noises), axis=0)
    total, alone, raw = (Total(number, tables.size) for number in (len(nodes), len(nodes), 1))
    const, count = np.zeros(len(nodes)), 0
    for table, bands in parts:
        const += _summed(table, table.rows, noises, scales, total, raw, bands)
        count += table.count
        if table.alone is not None:
            _summed(table, table.alone, noises, scales, alone)
    gram, few, logs = total.without(tables.geometry, departure)
    first = tables.geometry
    columns = tuple(c.behind(first) for c in tables.columns)
    prior = np.array([node.log_prior for node in nodes])
    terms = terms_of([*held, *fresh])
    whole, _, _ = raw.without(0, np.zeros(0))
    blocks = _blocks(terms, columns)
    whole = whole[0, first:, first:]
    found = Moments(tables.fit, terms, columns, len(held), nodes, gram, const + logs, prior, count, blocks, whole, few)
    if not tables.alone:
        return found
    gram, few, _ = alone.without(tables.geometry, departure)
    return replace(found, alone=replace(found, gram=gram, rows=few))


def _summed(
    table: Table, rows: Array, noises: Sequence[Node], scales: Sequence[Scale], total: Total, raw: Total | None = None,
    bands: Bands | None = None,
) -> Array:  # fmt: skip
    """Adds the moments of a run's `rows`, its set-up eliminated, to a `total`, under every noise where each of the scales holds,
    and under white noise, with nothing eliminated, to `raw`; what they add to `const` (J,)."""
    count, columns, size = rows.shape
    few = bands is None and count < EXACT_ROWS and count * columns < size
    white, logs = bands.grams(noises) if bands else (whitened if few else grams)(rows, table.interval, noises)
    if raw and few:
        raw.add_rows(white[:1, :, table.setup :], table.where)
    elif raw:
        raw.add(white[:1, table.setup :, table.setup :], table.where)
    found, const = list[Array](), list[Array]()
    for scale in scales:
        factor = table.wider(scale)
        wide = white if scale == STATED else white * (factor if few else np.outer(factor, factor))
        left, more = (eliminated_rows if few else eliminated)(wide, table.setup, table.departure / scale.setup)
        found.append(left)
        const.append(logs + more)
    (total.add_rows if few else total.add)(np.concatenate(found), table.where)
    return np.concatenate(const)


def _recorded(run: Run) -> float:
    """How long it took to record a run's rows, s, as the whitening counts: gaps between them are none."""
    return run.rows * run.interval if run.pieces else run.duration


def _blocks(terms: Sequence[Term], columns: Sequence[Columns]) -> tuple[int, ...]:
    """Of every term the unidentified one that is its discrepancy, if the readings see any of that."""
    free = [k for k, (t, c) in enumerate(zip(terms, columns, strict=True)) if t.form.basis is not None and len(c.where)]
    places = {(terms[k].form.channel, terms[k].effect.coordinate): k for k in free}
    return tuple(-1 if t.effect.unidentified else places.get(t.covers, -1) for t in terms)
