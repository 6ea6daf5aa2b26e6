"""Tables: of every run the columns whose moments are taken, linear about a fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from symfive.arrays import Array, Flags, Indices
from symfive.campaign import Campaign, Run
from symfive.effects import Effect, Form, Varying
from symfive.identify import Identification
from symfive.model import Linearisation, Model
from symfive.posterior._tangents import Compressed, channel_of, compressed, probes
from symfive.posterior._terms import own_parameters, starts_of
from symfive.posterior._widths import WIDTHS, log_width, nearest_width

__all__ = ["STATED", "Columns", "Scale", "Table", "Tables"]


class Scale(NamedTuple):
    """By how much the stated 1σ of geometry and of set-up are too small, and how probable that is."""

    geometry: float
    setup: float

    @property
    def log_prior(self) -> float:
        return log_width(self.geometry, WIDTHS) + log_width(self.setup, WIDTHS)


STATED = Scale(1.0, 1.0)


@dataclass(frozen=True)
class Table:
    """One run: `rows` (N, ny, s + k) in declared noise, first the `setup` s columns, then those that stand at `where` (k,) in the
    whole, the geometry's before `geometry`; `departure` (s,) of the set-up from its prior mean, in 1σ; `count` of readings;
    `alone` the rows with the fresh terms' slopes without what the fit holds, None where there are none."""

    rows: Array
    alone: Array | None
    interval: float
    setup: int
    where: Indices
    geometry: int
    departure: Array
    count: int

    def wider(self, scale: Scale) -> Array:
        """The factor of each column (s + k,) where what is stated of set-up and geometry is so many times too small."""
        shared = np.where(self.where < self.geometry, scale.geometry, 1.0)
        return np.concatenate([np.full(self.setup, scale.setup), shared])


@dataclass(frozen=True)
class Columns:
    """Where a term stands in the moments: `where` (n,) its columns, `amplitude` (n,) which of them say how large it is,
    `departure` (n,) of its shape parameters from their prior means in 1σ, `lower` (n,) the bounds of its amplitudes in usual 1σ
    from nothing (-∞: none); `exact` the column of its exact contribution less its tangent, -1 where it is not in the fit."""

    where: Indices
    amplitude: Flags
    departure: Array
    lower: Array
    exact: int = -1

    def scaled(self, width: float) -> Array:
        """The factor (n,) of each column for a prior of so many times the usual width."""
        return np.where(self.amplitude, width, 1.0)

    def behind(self, geometry: int) -> Columns:
        """The same once so many columns before them are eliminated."""
        exact = self.exact - geometry if self.exact >= 0 else -1
        return replace(self, where=self.where - geometry, exact=exact)


def _lower(effect: Effect, campaign: Campaign) -> Array:
    """The bounds of all that joins with an effect, in usual prior 1σ from nothing; -∞ of what is no amplitude."""
    plain = replace(effect, spread=1.0)
    sizes = {p.name for p in plain.amplitudes(campaign)}
    own = own_parameters(plain, campaign)
    return np.array([(p.lower - p.mean) / p.sigma if p.name in sizes else -np.inf for p in own])


def smoothed(model: Model, run: Run, values: Array) -> Linearisation:
    """A run at parameter values (k,); slopes in parameters in which the readings are rough are taken over the effect's step."""
    line = model.linearise(run, values, ahead=True)
    steps = {n: s for e in model.effects if e.applies(run) for n, s in e.steps(model.campaign).items()}
    if not steps:
        return line
    jacobian = line.jacobian.copy()
    for name, step in steps.items():
        number = model.index[name]
        ahead, behind = values.copy(), values.copy()
        ahead[number], behind[number] = values[number] + step, values[number] - step
        change = model.predict_run(run, ahead) - model.predict_run(run, behind)
        jacobian[:, :, list(line.columns).index(number)] = change / (2.0 * step)
    return replace(line, jacobian=jacobian)


class Distant:
    """An effect that may join a fit (`alone`: without the effects that the fit holds), looked at where it is of some size: its
    slopes there, and the rest of what it adds."""

    def __init__(self, fit: Identification, form: Form, *, alone: bool = False) -> None:
        campaign = fit.model.campaign
        self._model = Model(campaign, (form.effect,) if alone else (*fit.model.added, form.effect))
        self._at = self._model.vector(_known(self._model, {**fit.named, **form.at}))
        self._own = own_parameters(form.effect, campaign)
        self._sizes = {p.name for p in form.effect.amplitudes(campaign)}
        self._lower = _lower(form.effect, campaign)
        self._values = self._model.named(self._at)
        self.where = np.zeros(0, dtype=np.int64)

    def placed_at(self, here: int) -> Columns:
        """Its columns from `here` on."""
        self.where = here + np.arange(len(self._own) + 1)
        amplitude = np.array([p.name in self._sizes for p in self._own])
        departure = np.array([0.0 if p.name in self._sizes else (self._values[p.name] - p.mean) / p.sigma
                              for p in self._own])  # fmt: skip
        return Columns(self.where[:-1], amplitude, departure, self._lower, int(self.where[-1]))

    def columns(self, run: Run, without: Array) -> Array:
        """Slopes times prior 1σ, and last what it adds to the prediction `without` it less the slopes' share of that:
        (N, ny, parameters + 1)."""
        line = smoothed(self._model, run, self._at)
        place = {self._model.parameters[n].name: k for k, n in enumerate(line.columns)}
        found = np.zeros((*line.prediction.shape, len(self._own) + 1))
        found[:, :, -1] = line.prediction - without
        for i, p in enumerate(self._own):
            if p.name in place:
                slope = line.jacobian[:, :, place[p.name]]
                found[:, :, i] = slope * p.sigma
                if p.name in self._sizes:
                    found[:, :, -1] -= slope * (self._values[p.name] - p.mean)
        return found


class Tables:
    """The tables of a fit, run by run: [geometry | held terms | fresh terms | exact contributions | residual].

    Physical terms are linearised by the model together; an unidentified one is a channel's tangent times its functions,
    compressed to the directions that the readings see. What slope a fresh term has beside a held one may be owed to that (a
    latency moves spikes in time), so all have one without what is held too.
    """

    def __init__(self, fit: Identification, held: Sequence[Effect], fresh: Sequence[Form]) -> None:
        self.fit, self._held = fit, held
        self._varied = [form.effect for form in fresh if isinstance(form.effect, Varying)]
        physical = [form.effect for form in fresh if _sloped(form)]
        freeing = _disjoint([effect for effect in physical if effect.frees()])
        others = [effect for effect in physical if not effect.frees()]
        campaign = fit.model.campaign
        channels = [channel_of(form) for form in fresh if form.basis is not None]
        # what is fitted is linearised alone, and what changes the motion apart from what acts behind it: a candidate begins where
        # it has a slope, and that must not move the slopes of others
        # runs share the function of the same effects: what acts in one run alone is linearised apart
        lone = [e for e in others if len(campaign.runs) > 1 and sum(map(e.applies, campaign.runs)) == 1]
        common = [effect for effect in others if effect not in lone]
        groups = [group for group in ([*common, *probes(channels)], *freeing, lone) if group]
        self._models = [fit.model, *(Model(campaign, (*fit.model.added, *group)) for group in groups)]
        alone = [Model(campaign, group) for group in groups] if held and physical else []
        values = [fit.named] * len(self._models)
        # where a recording begins has a slope only in an effect that acts: of usual size
        starting = [effect for effect in others if any(effect.starts(run) for run in campaign.runs)]
        if starting:
            self._models.append(Model(campaign, (*fit.model.added, *starting)))
            alone += [Model(campaign, starting)] if alone else []
            typical = {name: size for effect in starting for name, size in effect.typical(campaign).items()}
            values.append({**typical, **fit.named})
        self._started = {p.name for effect in starting for p in starts_of(effect, campaign)}
        self._held_own = {p.name for effect in held for p in own_parameters(effect, campaign)}
        own = {p.name for effect in held for p in effect.parameters(campaign)}
        # a fit that ends at a bound would go on: there is no slope beyond it
        self._stopped = {p.name for p in fit.parameters if p.name in own and not p.lower < fit[p.name] < p.upper}
        kept = [p for p in fit.parameters if p.run is None and p.name not in self._held_own]
        self.geometry = len(kept)
        self.departure = np.array([(fit[p.name] - p.mean) / p.sigma for p in kept])
        self._place = {p.name: (i, p.sigma) for i, p in enumerate(kept)}
        self._noise = {run.id: fit.model.noise(run) for run in campaign.runs}
        problem = fit.problem()
        self._problem = problem
        self._fitted = {run.id: np.concatenate([np.arange(part.start, part.stop) for _, part in problem.parts(run)])
                        for run in campaign.runs}  # fmt: skip
        self._lines = {run.id: [smoothed(model, run, model.vector(at)) for model, at in zip(self._models, values, strict=True)]
                       for run in campaign.runs}  # fmt: skip
        self.alone = alone
        at = [model.vector(_known(model, own)) for model, own in zip(alone, values[1:], strict=False)]
        self._alone_lines = {run.id: [smoothed(model, run, own) for model, own in zip(alone, at, strict=True)]
                             for run in campaign.runs}  # fmt: skip
        self._distant = {id(form): Distant(fit, form) for form in fresh if form.at}
        self._distant_alone = [Distant(fit, form, alone=True) for form in fresh if form.at and alone]
        plain = Model(campaign)
        start = plain.vector(_known(plain, fit.named))
        self._plain = {run.id: plain.predict_run(run, start) for run in campaign.runs if self._distant_alone}
        self._tangents = self._compressed([form for form in fresh if form.basis is not None])
        self.columns = self._placed(held, fresh)
        columns = zip(fresh, self.columns[len(held) :], strict=True)
        self._places_varied = [placed.where for form, placed in columns if isinstance(form.effect, Varying)]
        whole = {run: lines[0].prediction for run, lines in self._lines.items()}
        self._contributions = [fit.model.contribution(effect, fit.values, whole) for effect in held]

    @cached_property
    def scales(self) -> tuple[Scale, ...]:
        """What is stated of geometry and set-up holds, or both are wrong by as much as those of them that the readings tell are
        further from it than that, in the rms."""
        found = []
        for shared in (True, False):
            own = [p for p in self.fit.parameters if p.name not in self._held_own and (p.run is None) == shared]
            told = sum(max(0.0, 1.0 - (self.fit.uncertainty(p.name) / p.sigma) ** 2) for p in own)
            square = sum(((self.fit[p.name] - p.mean) / p.sigma) ** 2 for p in own)
            found.append(nearest_width(float(np.sqrt(square / max(told, 1.0)))))
        return tuple(dict.fromkeys([STATED, Scale(*found)]))

    def _compressed(self, forms: Sequence[Form]) -> dict[int, Compressed]:
        """By identity of the form."""
        if not forms:
            return {}
        bases = [self._base(run) for run in self.fit.model.campaign.runs]
        lines = {run: each[1] for run, each in self._lines.items()}
        found = compressed(self._models[1], lines, bases, self._scaled, forms)
        return {id(form): entry for form, entry in zip(forms, found, strict=True)}

    def _placed(self, held: Sequence[Effect], fresh: Sequence[Form]) -> tuple[Columns, ...]:
        here, found = self.geometry, list[Columns]()
        for effect in (*held, *(form.effect for form in fresh if _sloped(form))):
            here = self._name(effect, here)
        for effect in held:
            found.append(self._columns_of(effect, here))
            here += 1
        for form in fresh:
            if form.at:
                found.append(self._distant[id(form)].placed_at(here))
                here = found[-1].exact + 1
                continue
            if isinstance(form.effect, Varying):
                width = form.effect.functions(self.fit.model.campaign.runs[0], self.fit.model.campaign).shape[1]
                free = np.full(width, -np.inf)
                found.append(Columns(here + np.arange(width), np.zeros(width, dtype=bool), np.zeros(width), free))
                here += width
                continue
            if form.basis is None:
                found.append(self._columns_of(form.effect, -1))
                continue
            width = self._tangents[id(form)].turn.shape[1]
            where, free = here + np.arange(width), np.full(width, -np.inf)
            found.append(Columns(where, np.ones(width, dtype=bool), np.zeros(width), free))
            self._tangents[id(form)] = replace(self._tangents[id(form)], where=here + np.arange(width))
            here += width
        self.size = here + 1
        return tuple(found)

    def _name(self, effect: Effect, at: int) -> int:
        """Give an effect's parameters their columns, in units of the prior of its usual width."""
        for p in own_parameters(replace(effect, spread=1.0), self.fit.model.campaign):
            self._place[p.name] = at, p.sigma
            at += 1
        return at

    def _columns_of(self, effect: Effect, exact: int) -> Columns:
        campaign = self.fit.model.campaign
        parameters = own_parameters(effect, campaign)
        sizes = {p.name for p in effect.amplitudes(campaign)}
        if exact < 0:
            sizes |= {p.name for p in starts_of(effect, campaign)}  # in units of an amplitude, and as wide
        amplitude = np.array([p.name in sizes for p in parameters])
        departure = [0.0 if exact < 0 or size else (self.fit[p.name] - p.mean) / p.sigma
                     for p, size in zip(parameters, amplitude, strict=True)]  # fmt: skip
        where = np.array([self._place[p.name][0] for p in parameters])
        return Columns(where, amplitude, np.array(departure), _lower(effect, campaign), exact)

    def _scaled(self, run: Run, table: Array) -> Array:
        """The fitted columns of readings (N, ny, …) in declared noise; what was left out as an outlier carries nothing."""
        chosen = self._fitted[run.id]
        shape = (1, len(chosen), *(1,) * (table.ndim - 2))
        counts = self._problem.counts(run)[:, chosen].reshape(len(table), *shape[1:])
        return np.asarray(table[:, chosen] * (counts / self._noise[run.id][chosen].reshape(shape)))

    def kept(self, run: Run) -> Flags:
        """Which of the fitted readings of a run (N, ny) are not left out as outliers."""
        return ~self._problem.left_out[run.id][:, self._fitted[run.id]]

    def places(self, run: Run) -> list[tuple[int, int]]:
        """(row, column of the model) of each of these."""
        return [(int(row), int(self._fitted[run.id][j])) for row, j in np.argwhere(self.kept(run))]

    def _base(self, run: Run) -> tuple[Array, int]:
        """Set-up and geometry of a run (N, ny, s + g), and how many columns are the set-up's."""
        line, (setup, shared) = self._lines[run.id][0], self._known(run)
        parameters = self.fit.parameters
        found = np.zeros((*line.jacobian.shape[:2], len(setup) + self.geometry))
        for k, i in enumerate(setup):
            found[:, :, k] = line.jacobian[:, :, i] * parameters[line.columns[i]].sigma
        for i in shared:
            column, sigma = self._place.get(parameters[line.columns[i]].name, (self.geometry, 0.0))
            if column < self.geometry:
                found[:, :, len(setup) + column] = line.jacobian[:, :, i] * sigma
        return self._scaled(run, found), len(setup)

    def _known(self, run: Run) -> tuple[list[int], list[int]]:
        """Which columns of a run's linearisation are its set-up, and which belong to the whole campaign."""
        parameters = [self.fit.parameters[number] for number in self._lines[run.id][0].columns]
        setup = [k for k, p in enumerate(parameters) if p.run is not None and p.name not in self._held_own]
        return setup, [k for k, p in enumerate(parameters) if p.run is None]

    def __iter__(self) -> Iterator[Table]:
        for run in self.fit.model.campaign.runs:
            yield self._table(run)

    def _table(self, run: Run) -> Table:
        (line, *others), (setup, _) = self._lines[run.id], self._known(run)
        own = [self.fit.parameters[line.columns[k]] for k in setup]
        sigma = [p.sigma for p in own]
        parts, where, alone = [line.jacobian[:, :, setup] * np.array(sigma)], list[Indices](), list[Array]()
        for number, (model, table) in enumerate(zip(self._models, (line, *others), strict=True)):
            names = [model.parameters[n].name for n in table.columns]
            names = [name for name in names if name in self._place and self._taken(model, name)]
            where.append(np.array([self._place[name][0] for name in names], dtype=np.int64))
            parts.append(self._slopes(model, table, names))
            if self.alone and number:
                alone.append(self._slopes(self.alone[number - 1], self._alone_lines[run.id][number - 1], names))
        residual = np.array(self.fit.residuals[run.id])
        for effect, placed, given in zip(self._held, self.columns, self._contributions, strict=False):
            residual += given[run.id]
            parts.append((given[run.id] - self._tangent(line, effect))[:, :, None])
            where.append(np.array([placed.exact]))
        for effect, at in zip(self._varied, self._places_varied, strict=True):
            number = next(k for k, own in enumerate(self._held) if own.key == effect.key)
            functions = effect.functions(run, self.fit.model.campaign)
            parts.append(self._contributions[number][run.id][:, :, None] * functions[:, None, :])
            where.append(at)
        first = len(parts)
        for distant in self._distant.values():
            parts.append(distant.columns(run, line.prediction))
            where.append(distant.where)
        for form in self._tangents.values():
            parts.append(form.columns(self._models[1], run, others[0]))
            where.append(form.where)
        parts.append(residual[:, :, None])
        rows = self._scaled(run, np.concatenate(parts, axis=2))
        if alone:
            parts[2 : 2 + len(alone)] = alone
            for k, distant in enumerate(self._distant_alone, start=first):
                parts[k] = distant.columns(run, self._plain[run.id])
        at = np.concatenate([*where, [self.size - 1]])
        used = np.any(rows != 0.0, axis=(0, 1))
        used[: len(setup)] = used[-1] = True
        other = self._scaled(run, np.concatenate(parts, axis=2)[:, :, used]) if alone else None
        departure = np.array([(self.fit[p.name] - p.mean) / p.sigma for p in own])
        count = int(np.sum(self.kept(run)))
        there = at[used[len(setup) :]]
        return Table(rows[:, :, used], other, run.interval, len(setup), there, self.geometry, departure, count)

    def _slopes(self, model: Model, line: Linearisation, names: Sequence[str]) -> Array:
        """The slopes of a run in parameters by name (N, ny, names), times their prior 1σ; none in those that move nothing."""
        place = {model.parameters[number].name: k for k, number in enumerate(line.columns)}
        found = np.zeros((*line.prediction.shape, len(names)))
        for k, name in enumerate(names):
            if name in place:
                found[:, :, k] = line.jacobian[:, :, place[name]] * self._place[name][1]
        return found

    def _taken(self, model: Model, name: str) -> bool:
        """Whether a parameter's column comes from this of the models."""
        if name in self.fit.model.index:
            return model is self._models[0] and name not in self._stopped
        return (model is self._models[-1]) == (name in self._started) if self._started else True

    def _tangent(self, line: Linearisation, effect: Effect) -> Array:
        """J·a of an effect that is held, a its amplitudes counted from nothing (N, ny)."""
        place = {self.fit.parameters[number].name: k for k, number in enumerate(line.columns)}
        total = np.zeros(line.prediction.shape)
        for p in effect.amplitudes(self.fit.model.campaign):
            if p.name in place and p.name not in self._stopped:
                total += line.jacobian[:, :, place[p.name]] * (self.fit[p.name] - p.mean)
        return total


def _known(model: Model, values: Mapping[str, float]) -> dict[str, float]:
    """What of some values are parameters of a model."""
    return {name: value for name, value in values.items() if name in model.index}


def _disjoint(effects: Sequence[Effect]) -> list[list[Effect]]:
    """The effects in groups of which none frees what another one in it does."""
    groups = list[list[Effect]]()
    for effect in effects:
        apart = (group for group in groups if not any(effect.frees().keys() & other.frees().keys() for other in group))
        group = next(apart, None)
        if group is None:
            groups.append([effect])
        else:
            group.append(effect)
    return groups


def _sloped(form: Form) -> bool:
    """Whether its columns are slopes of the model about where estimation begins."""
    return form.sloped and not isinstance(form.effect, Varying)
