"""Hold-out validation: prediction of held-out readings, and withdrawal of findings that worsen it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from symfive.arrays import Array, Flags
from symfive.campaign import Campaign
from symfive.diagnose._split import Split
from symfive.effects import Effect, Varying, coordinate_words, effect_words
from symfive.errors import InputError
from symfive.identify import Identification
from symfive.inference import Problem, gauss_newton
from symfive.model import Model
from symfive.numbers import change, unit_words
from symfive.posterior import SAME, Expansion, sigmas_from_nothing
from symfive.threads import one_thread

Rows = Flags
TOLERANCE = 1e-2
"""Share of its 1σ by which no set-up error moves any more."""
WORSE = 0.01
"""A held-out part counts as worse by this share; less may be chance."""
PARTS = {"all": "of all readings", "fitted": "of the fitted part", "held_out": "of the held-out part"}


@dataclass(frozen=True)
class Withdrawn:
    """An effect that worsens the prediction of the held-out part: rms of that part without and with it; alike where it is nothing
    beside what remains."""

    effect: Effect
    rms_without_um: float
    rms_with_um: float

    @property
    def words(self) -> str:
        """The effect and its axis."""
        if isinstance(self.effect, Varying):
            law = effect_words(self.effect.of.vocabulary, self.effect.of.belongs_to)
            return f"the change of {law} over {coordinate_words(self.effect.over)}"
        if self.effect.unidentified:
            return f"unidentified effect over {coordinate_words(self.effect.coordinate)}"
        return effect_words(self.effect.vocabulary, self.effect.belongs_to)


@dataclass(frozen=True)
class HoldOut:
    """Prediction of held-out readings. `label` names the held-out part; `readings` counts and `rms` (before, after) by part:
    `all`, `fitted`, `held_out`; `withdrawn` effects in the order of their withdrawal."""

    label: str
    readings: Mapping[str, int]
    rms: Mapping[str, tuple[float, float]]
    withdrawn: tuple[Withdrawn, ...] = ()

    def sentences(self, unit: str) -> tuple[str, ...]:
        """One sentence per withdrawn effect; the last gives the rms of each part, before → after."""
        gone = [
            f"Withdrawn: {w.words} predicted {self.label} worse, {change(w.rms_without_um, w.rms_with_um, unit)} {unit}."
            if w.rms_with_um > w.rms_without_um
            else f"Withdrawn: {w.words} is below 2σ without it."
            for w in self.withdrawn
        ]
        sizes = [f"{words} {change(*self.rms[part], unit)} {unit}" for part, words in PARTS.items()]
        share = f"{self.readings['held_out']} of {self.readings['all']} readings"
        return (*gone, f"Held out: {self.label} ({share}); rms {', '.join(sizes)}.")

    def to_data(self, unit: str) -> dict[str, Any]:
        """`hold_out` of diagnosis.json."""
        return {
            "held_out": self.label,
            "readings": dict(self.readings),
            "rms_before_um": {part: before for part, (before, _) in self.rms.items()},
            "rms_after_um": {part: after for part, (_, after) in self.rms.items()},
            "withdrawn": [
                {
                    "effect": w.effect.vocabulary, "axis": w.effect.belongs_to, "form": w.effect.key,
                    "heldout_rms_without_um": w.rms_without_um, "heldout_rms_with_um": w.rms_with_um,
                }
                for w in self.withdrawn
            ],
            "says": " ".join(self.sentences(unit)),
        }  # fmt: skip


def held_out_square(fit: Identification, campaign: Campaign, split: Split, unit: str) -> tuple[float, int]:
    """Sum of squares, in `unit`, of the campaign's readings that the split holds out, and how many they are.

    `fit` was fitted on the rest (`over_whole`). Outliers count.
    """
    model, values = over_whole(fit, campaign, split)
    return _square(model, values, {run.id: ~split.learn(run) for run in campaign.runs}, unit)


def over_whole(fit: Identification, campaign: Campaign, split: Split) -> tuple[Model, Array]:
    """The model of the whole campaign, with the parameter values of a fit to part of it.

    A run outside the fit gets its own zeros and set-up, nothing else, so that the machine is tested and not the mounting. A run
    that was fitted in part keeps its set-up.
    """
    model = fit.model if fit.model.campaign is campaign else Model(campaign, fit.model.added)
    values = model.vector({name: value for name, value in fit.named.items() if name in model.index})
    strange = [run.id for run in campaign.runs if not split.learn(run).any()]
    if strange:
        own = _set_up(model, model.named(values), strange)
        values = model.vector(model.named(values) | own)
    return model, values


def _square(model: Model, values: Array, which: Mapping[str, Rows], unit: str) -> tuple[float, int]:
    """Sum of squares of the residuals of some rows of each run, in a unit, and how many there are."""
    problem, square, count = Problem.of(model), 0.0, 0
    residuals = problem.residuals_at(values)
    for run in model.campaign.runs:
        columns = model.columns(run)
        sensed = (k for _, part in problem.parts(run) for k in range(*part.indices(len(columns))))
        shown = [k for k in sensed if columns[k].unit == unit]
        if shown:
            counted = which[run.id][:, None] & problem.judged(run)[:, shown]
            residual = residuals[run.id][:, shown][counted]
            square, count = square + float(np.sum(residual**2)), count + residual.size
    return square, count


def _set_up(model: Model, known: Mapping[str, float], strange: Sequence[str]) -> dict[str, float]:
    """Zeros, set-up errors and states at the start of some runs, fitted on their own readings; all else is known, what these runs
    share with others too."""
    campaign = model.campaign.select(*strange)
    part = Model(campaign, [e for e in model.added if any(map(e.applies, campaign.runs))])
    problem = Problem.of(part)
    others = [run for run in model.campaign.runs if run.id not in strange]
    problem.free = np.array([p.of_setup and not any(run.owns(p) for run in others) for p in part.parameters])
    values = part.vector({name: value for name, value in known.items() if name in part.index})
    if problem.free.any():
        values, _ = gauss_newton(problem, values, TOLERANCE)
        if problem.flag_outliers(problem.survey(values), values):
            values, _ = gauss_newton(problem, values, TOLERANCE)
    return {p.name: float(v) for p, v in zip(part.parameters, values, strict=True) if p.of_setup}


@one_thread
def withdraw(
    here: Expansion, before: Identification, campaign: Campaign, split: Split
) -> tuple[Expansion, tuple[Withdrawn, ...]]:
    """The fit without the effects, and discrepancies, that make the held-out part of the campaign worse, one after the other, the
    worst first; all else is refitted each time, and what is nothing then is withdrawn too. What remains predicts it no
    worse than the baseline `before`, which is all that remains if need be. Raises `InputError` where no held-out reading has the
    unit of the fit's."""
    unit, gone = here.fit.file_unit, list[Withdrawn]()

    if not held_out_square(here.fit, campaign, split, unit)[1]:
        problem = f"no held-out reading has the unit {unit_words(unit)} of the fitted ones"
        raise InputError(problem, remedy="hold out runs of the same instrument")
    now, plain = (_held_out_rms(fit, campaign, split) for fit in (here.fit, before))
    while here.held:
        forms = [*here.discrepancies, *here.held]
        others = [here.without([form.effect.key]) for form in forms]
        sizes = [_held_out_rms(other.fit, campaign, split) for other in others]
        least = int(np.argmin(sizes))
        if now <= (1.0 + WORSE) * sizes[least]:
            break
        if least >= len(here.discrepancies):
            gone.append(Withdrawn(forms[least].effect, sizes[least], now))
        here, now = others[least], sizes[least]
        for effect in [form.effect for form in here.held]:  # each beside what remains by then
            if 0.5 * sigmas_from_nothing(here.fit, effect) ** 2 < SAME:
                here = here.without([effect.key])
                now = _held_out_rms(here.fit, campaign, split)
                gone.append(Withdrawn(effect, now, now))
    if now > (1.0 + WORSE) * plain:  # no single one is to blame: all, and the noise that was found with them
        gone += [Withdrawn(form.effect, plain, now) for form in here.held]
        here = replace(here, fit=before, held=(), discrepancies=())
    return here, tuple(gone)


def worse_held_out(here: Expansion, other: Expansion, campaign: Campaign, split: Split) -> bool:
    """Whether `here` predicts the held-out part worse than `other`."""
    mine, others = (_held_out_rms(each.fit, campaign, split) for each in (here, other))
    return mine > (1.0 + WORSE) * others


def variations_withdrawn(full: Expansion, laws: Expansion, campaign: Campaign, split: Split) -> tuple[Withdrawn, ...]:
    """The variations of a fit, beside the fit of the laws alone, with which the held-out part is predicted worse."""
    with_, without = (_held_out_rms(each.fit, campaign, split) for each in (full, laws))
    return tuple(Withdrawn(form.effect, without, with_) for form in full.held if isinstance(form.effect, Varying))


def _held_out_rms(fit: Identification, campaign: Campaign, split: Split) -> float:
    return root(*held_out_square(fit, campaign, split, fit.file_unit))


def held_out(
    before: Identification,
    after: Identification,
    campaign: Campaign,
    split: Split,
    withdrawn: tuple[Withdrawn, ...] = (),
) -> HoldOut:
    """rms before and after, over the fitted part, the held-out part and all readings."""
    unit, fits = after.file_unit, (before, after)
    whole = {run.id: np.ones(run.rows, dtype=bool) for run in after.model.campaign.runs}
    learnt = [_square(fit.model, fit.values, whole, unit) for fit in fits]
    held = [held_out_square(fit, campaign, split, unit) for fit in fits]
    every = [(a + b, n + m) for (a, n), (b, m) in zip(learnt, held, strict=True)]
    squares = dict(zip(PARTS, (every, learnt, held), strict=True))
    rms = {part: (root(*first), root(*last)) for part, (first, last) in squares.items()}
    return HoldOut(split.label, {part: last[1] for part, (_, last) in squares.items()}, rms, withdrawn)


def validated(before: Identification, here: Expansion, campaign: Campaign, split: Split) -> tuple[Expansion, HoldOut]:
    """The fit after withdrawals, and how the baseline and this fit predict the held-out part."""
    here, withdrawn = withdraw(here, before, campaign, split)
    return here, held_out(before, here.fit, campaign, split, withdrawn)


def root(square: float, count: int) -> float:
    """Root mean square from a sum of squares; NaN if `count` is 0."""
    return float(np.sqrt(square / count)) if count else float("nan")
