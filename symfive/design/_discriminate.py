"""Which test separates two rival explanations best: T-optimality, and its Bayesian form.

For a test with readings η and noise σ, and explanation a true at θ_a (A. C. Atkinson & V. V. Fedorov 1975)

    T(a, b) = min over θ_b of Σ ((η_a(θ_a) - η_b(θ_b)) / σ)² + Σ ((θ_b - mean) / σ_prior)² - Σ ((θ_a - mean) / σ_prior)²

is what remains after the rival has been fitted with all its freedom: machine errors, set-up errors, effects; by how much the
truth itself departs from its priors speaks for neither. √T is the expected separation in σ. What was measured already binds the
rival too, so its runs stand in the same sum. The Bayesian form averages T over the prior of the true explanation's parameters
(W. G. Hunter & A. M. Reiner 1965; G. E. P. Box & W. J. Hill 1967: ½T is the expected log Bayes factor). The smaller of T(a, b)
and T(b, a) counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Campaign, Run
from symfive.design._circles import with_drawn_effects
from symfive.effects import form_words
from symfive.errors import EvaluationError, InputError
from symfive.inference import halved
from symfive.model import Linearisation, Model
from symfive.screen import OnScreen
from symfive.threads import one_thread

_Lines = dict[str, Linearisation]
ITERATIONS = 4
PAUSE_S = 60.0
USELESS = 1.05
"""A test that raises the separation by less than this factor is as good as none."""
APART = 3.0
"""σ from which two explanations count as separated."""
Candidate = Campaign | Run | Sequence[Run]


@dataclass(frozen=True)
class Separation:
    """One candidate: `sigmas` expected with it (and with what was measured) if the one that it separates less is true; `minutes`
    of recording."""

    name: str
    sigmas: float
    minutes: float


@dataclass(frozen=True, repr=False)
class Discrimination(OnScreen):
    """The best test: a campaign without readings; its `separation` in σ, and `before` that of the readings so far; the `table`
    of all candidates, best first. With several rivals `each` holds the separation from every one; `separation` and
    `before` are the smallest among those that the test separates. `also`: pairs of rivals that it separates from each other, if
    that takes several runs."""

    test: Campaign
    separation: float
    before: float
    table: tuple[Separation, ...]
    each: tuple[tuple[str, float], ...] = ()
    also: tuple[tuple[str, str], ...] = ()

    @property
    def useful(self) -> bool:
        """Whether the explanations are separated with the best candidate, and better than they were."""
        return self.separation >= APART and self.separation > USELESS * self.before

    def __str__(self) -> str:
        return f"{self.says}\n{self.test}"

    @property
    def says(self) -> str:
        """The result in one sentence."""
        if not self.useful:
            return f"no further test here separates them ({self.separation:.1f}σ at best, of {len(self.table)} tests)"
        name = self.table[0].name.replace(" + ", " and ")
        does = "together separate" if name != self.table[0].name else "separates"
        if len(self.each) < 2:
            return f"{name} {does} the two by {self.separation:.1f}σ (today {self.before:.1f}σ)"
        machine = self.test.machine
        apart = [f"{form_words(rival, machine)} by {sigmas:.1f}σ" for rival, sigmas in self.each if sigmas >= APART]
        alike = [form_words(rival, machine) for rival, sigmas in self.each if sigmas < APART]
        if not apart:
            return f"{name} {does} them by {self.separation:.1f}σ (today {self.before:.1f}σ)"
        rest = f"; no test here separates it from {' or '.join(alike)}" if alike else ""
        pairs = [" from ".join(form_words(rival, machine) for rival in pair) for pair in self.also]
        rest = f", and {', '.join(pairs)}{rest}" if pairs else rest
        return f"{name} {does} it from {' and '.join(apart)} (today {self.before:.1f}σ){rest}"


@one_thread
def discriminate(
    model_a: Model, model_b: Model, candidates: Iterable[Candidate], *, values_a: Mapping[str, float] | None = None,
    values_b: Mapping[str, float] | None = None, draws: int = 0, seed: int = 0, measured: bool = True,
) -> Discrimination:  # fmt: skip
    """The candidate that separates two models of one machine best.

    `candidates` campaigns without readings, runs, or groups of runs; `values_a`, `values_b` parameters at which either is
    true, by name (default: effects of typical size); `draws` > 0 averages over that many draws of the true effects'
    parameters from their priors instead; `measured`: whether the runs of the models' own campaign bind the rival too.
    Raises `InputError` where there is nothing to compare.
    """
    tests = [_runs(candidate) for candidate in candidates]
    if not tests:
        raise InputError("there is no test to choose from", remedy="give at least one campaign or run")
    own = list(model_a.campaign.runs) if measured else []
    machine = model_a.machine
    end = max((run.start_s + float(run.time[-1]) for run in own), default=0.0)
    named = [tuple(_later(run, i, end) for run in test) for i, test in enumerate(tests)]
    every = Campaign(machine=machine, runs=(*own, *(run for test in named for run in test)))
    a, b = Model(every, model_a.added), Model(every, model_b.added)
    started: tuple[_Lines, _Lines] = ({}, {})
    ab = [_Explained(a, truth, b, _begin(b, values_b), started[1]) for truth in _truths(a, values_a, draws, seed)]
    ba = [_Explained(b, truth, a, _begin(a, values_a), started[0]) for truth in _truths(b, values_b, draws, seed)]
    ids = [run.id for run in own]
    before = _separation("measured", ab, ba, ids, 0.0).sigmas if own else 0.0
    table = []
    for test, runs in zip(tests, named, strict=True):
        minutes = sum(run.duration for run in test) / 60.0
        name = " + ".join(run.id for run in test)
        table.append(_separation(name, ab, ba, [*ids, *(run.id for run in runs)], minutes))
    best = max(range(len(table)), key=lambda i: table[i].sigmas)
    ordered = tuple(sorted(table, key=lambda s: -s.sigmas))
    chosen = Campaign(machine=machine, runs=tests[best], name="next test")
    return Discrimination(chosen, table[best].sigmas, before, ordered)


def in_common(parts: Mapping[str, Discrimination], candidates: Sequence[Candidate]) -> Discrimination:
    """The candidate that separates one explanation from several rivals: from as many as possible, and from the nearest of
    these by the largest separation. Only the separation that a test adds counts: if the priors alone make a rival
    improbable, no test separates it.

    `parts` a discrimination for every rival by name, all over the same `candidates`.
    """
    added = _added(parts)

    def nearest(name: str) -> tuple[int, float, str]:
        """How many rivals a test separates, and the least that it adds for one of them, with that rival."""
        apart = {rival: table[name] for rival, table in added.items() if table[name] >= APART}
        rival = min(apart or added, key=lambda r: added[r][name])
        return len(apart), added[rival][name], rival

    names = list(next(iter(added.values())))
    ranked = sorted(names, key=lambda n: nearest(n)[:2], reverse=True)
    tests = {" + ".join(run.id for run in _runs(c)): _runs(c) for c in candidates}
    rows = [next(row for row in parts[nearest(n)[2]].table if row.name == n) for n in ranked]
    return Discrimination(
        Campaign(machine=next(iter(parts.values())).test.machine, runs=tests[ranked[0]], name="next test"),
        rows[0].sigmas,
        parts[nearest(ranked[0])[2]].before,
        tuple(rows),
        tuple((rival, table[ranked[0]]) for rival, table in added.items()),
    )


def in_addition(parts: Mapping[str, Discrimination], first: str) -> list[str]:
    """The candidates by name that separate all pairs which any of them can: the `first`, then whichever separates most of what is
    left, of those the nearest by most.

    `parts` a discrimination for every pair, all over the same candidates.
    """
    added, chosen = _added(parts), [first]
    while True:
        left = [table for table in added.values() if max(table[name] for name in chosen) < APART]
        separated = {name: [table[name] for table in left if table[name] >= APART] for table in left for name in table}
        best = max(separated, key=lambda n: (len(separated[n]), min(separated[n], default=0.0)), default=None)
        if best is None or not separated[best]:
            return chosen
        chosen.append(best)


def _added(parts: Mapping[str, Discrimination]) -> dict[str, dict[str, float]]:
    """What every candidate adds to the separation that is known, σ."""
    return {
        key: {row.name: max(row.sigmas**2 - part.before**2, 0.0) ** 0.5 for row in part.table}
        for key, part in parts.items()
    }


def _later(run: Run, number: int, end: float) -> Run:
    """The run under a name of its own, after all that was measured."""
    return replace(
        run, id=f"t{number}-{run.id}", file=f"t{number}-{run.id}.csv", readings={}, start_s=end + PAUSE_S + run.start_s
    )


def _runs(candidate: Candidate) -> tuple[Run, ...]:
    if isinstance(candidate, Campaign):
        return candidate.runs
    return (candidate,) if isinstance(candidate, Run) else tuple(candidate)


def _truths(model: Model, values: Mapping[str, float] | None, draws: int, seed: int) -> list[Array]:
    """Parameter vectors at which the model is true."""
    vector = model.prior_mean.copy()
    for effect in model.added:
        for name, value in effect.typical(model.campaign).items():
            vector[model.index[name]] = value
    for name, value in (values or {}).items():
        if name in model.index:
            vector[model.index[name]] = value
    if draws <= 0:
        return [vector]
    generator = np.random.default_rng(seed)
    return [with_drawn_effects(model, vector, generator) for _ in range(draws)]


def _begin(model: Model, values: Mapping[str, float] | None) -> Array:
    """Where estimation of a rival begins: at what is known of it. From elsewhere a few steps do not lead to its best fit."""
    vector = np.array(model.start)
    for name, value in (values or {}).items():
        if name in model.index:
            vector[model.index[name]] = value
    return vector


def _separation(
    name: str, ab: Sequence[_Explained], ba: Sequence[_Explained], ids: Sequence[str], minutes: float
) -> Separation:
    there, back = (math.sqrt(float(np.mean([each.left(ids) for each in way]))) for way in (ab, ba))
    return Separation(name, min(there, back), minutes)


class _Explained:
    """A true model's readings and the rival that has to explain them; `started` holds the rival's linearisations where its
    estimation begins (`begin`), which are the same for all tests."""

    def __init__(self, true: Model, truth: Array, rival: Model, begin: Array, started: _Lines) -> None:
        runs = true.campaign.runs
        _, self._wanted = halved(
            lambda at: {run.id: true.predict_run(run, at) / true.noise(run) for run in runs}, truth, true.start
        )
        self._rival, self._begin, self._started = rival, begin, started
        self._departure = float(np.sum(((truth - true.prior_mean) / true.prior_sigma) ** 2))

    def _lines(self, ids: Sequence[str], values: Array, *, first: bool) -> _Lines:
        if not first:
            return {id: self._rival.linearise(id, values) for id in ids}
        self._started.update({id: self._rival.linearise(id, values) for id in ids if id not in self._started})
        return {id: self._started[id] for id in ids}

    def left(self, ids: Sequence[str]) -> float:
        """T: what the rival cannot explain of the readings of some runs (Gauss–Newton with the priors), at least nothing."""
        rival, values, best = self._rival, self._begin, math.inf
        precision = rival.prior_sigma**-2.0
        lower, upper = (np.array([getattr(p, side) for p in rival.parameters]) for side in ("lower", "upper"))
        for number in range(ITERATIONS):
            gram, gradient = np.diag(precision), -precision * (values - rival.prior_mean)
            square = float(np.sum(precision * (values - rival.prior_mean) ** 2))
            try:
                lines = self._lines(ids, values, first=number == 0)
            except EvaluationError:
                break  # a step too far: the best so far counts
            for id, line in lines.items():
                noise = rival.noise(id)
                residual = (self._wanted[id] - line.prediction / noise).ravel()
                slopes = (line.jacobian / noise[:, None]).reshape(len(residual), -1)
                gram[np.ix_(line.columns, line.columns)] += slopes.T @ slopes
                gradient[line.columns] += slopes.T @ residual
                square += float(residual @ residual)
            try:
                step = np.linalg.solve(gram, gradient)
            except np.linalg.LinAlgError:
                break  # far beyond what the readings say anything of: the best so far counts
            expected = max(square - float(gradient @ step), 0.0)
            best = min(best, square)
            moved = np.clip(values + step, lower, upper)
            if square - expected < 1e-3 * max(square, 1e-12) or not np.all(np.isfinite(moved)):
                break
            values = moved
        return max(best - self._departure, 0.0)
