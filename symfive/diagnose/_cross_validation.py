"""Cross-validation: prediction of held-out readings, before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from symfive.arrays import Array, Flags
from symfive.diagnose._groups import way
from symfive.diagnose._hold_out import WORSE
from symfive.effects import Effect
from symfive.identify import Identification
from symfive.inference import Noise, Problem, gauss_newton
from symfive.model import Model
from symfive.numbers import change, plain_number
from symfive.threads import one_thread

FOLDS = 4
BEYOND = 1.5
"""Held-out readings predicted so many times worse than fitted ones are reported."""


@dataclass(frozen=True)
class Fit:
    """Quality before and after: rms over all readings with the excluded outliers; χ² over those that each fit kept; the rms of
    held-out runs, each in turn; `heldout_by`: of a whole feed or place at a time, what → (before, after), µm.
    `heldout_expected_um`: what → the expected rms after, from the noise and the uncertainty of the prediction."""

    rms_before_um: float
    rms_after_um: float
    chi2_dof_before: float
    chi2_dof_after: float
    heldout_rms_before_um: float | None
    heldout_rms_after_um: float | None
    heldout_by: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    heldout_expected_um: Mapping[str, float] = field(default_factory=dict)

    def doubts(self, unit: str) -> tuple[str, ...]:
        """What speaks against the findings: held-out readings that are predicted worse with them, or far worse than those that
        were fitted, and not because the rest does not determine it."""
        runs = (self.heldout_rms_before_um, self.heldout_rms_after_um)
        said = []
        for what, (before, after) in {"run": runs, **self.heldout_by}.items():
            expected = self.heldout_expected_um.get(what, 0.0)
            if before is None or after is None or after < expected:
                continue
            one, beyond = f"A {what} that was left out of the fit", f"do not trust them beyond the {what}s recorded"
            if after > (1.0 + WORSE) * before:
                advice = "treat them as a hint, not as proven" if what == "run" else beyond
                said.append(f"{one} is predicted worse with them ({change(before, after, unit)} {unit} rms): {advice}.")
            elif after > BEYOND * max(self.rms_after_um, expected):
                sizes = plain_number(after, unit), plain_number(self.rms_after_um, unit)
                said.append(
                    f"{one} is predicted to {sizes[0]} {unit} rms only; the fitted readings leave {sizes[1]} {unit}: "
                    + (
                        "the other runs do not determine all its errors, or the machine changes from run to run."
                        if what == "run"
                        else f"{beyond}."
                    )
                )
        return tuple(said)


@one_thread
def cross_validated(before: Identification, after: Identification) -> Fit:
    """Quality before and after, over all readings and over what was held out of the fit in turn: runs (of a single run,
    quarters), and where the runs differ in them, a whole feed and a whole place at a time. Outliers, which either fit excludes,
    count in every rms."""
    campaign = after.model.campaign
    ids = [run.id for run in campaign.runs]
    count = min(FOLDS, len(ids))
    ways = {"runs": [ids[i::count] for i in range(count)]}
    ways |= {name: [list(g) for g in way(campaign, name).values()] for name in ("feed", "place")}
    same = after is before
    held, expected = {}, {}
    for name, folds in ways.items():
        if len(folds) > 1 or name == "runs":
            last = _held_out(after, folds, uncertain=True)
            first = last if same else _held_out(before, folds)
            held[name] = (first.rms, last.rms)
            expected["run" if name == "runs" else name] = float(np.hypot(after.rms_um, last.uncertainty))
    runs = held.pop("runs")
    return Fit(before.rms_um, after.rms_um, before.chi2_dof, after.chi2_dof, runs[0], runs[1], held, expected)


@dataclass(frozen=True)
class _HeldOut:
    """Readings that were left out of the fit: `squares` of their residuals, µm², their `count`, and the sum over them of the
    variances of their prediction that come from what the rest does not determine, `spread`, µm²."""

    squares: float = 0.0
    count: int = 0
    spread: float = 0.0

    @property
    def rms(self) -> float:
        """Of their residuals, µm."""
        return float(np.sqrt(self.squares / max(self.count, 1)))

    @property
    def uncertainty(self) -> float:
        """The root of the mean of that variance, µm."""
        return float(np.sqrt(max(self.spread, 0.0) / max(self.count, 1)))

    def beside(self, residuals: Sequence[Array], spread: float) -> _HeldOut:
        """With the residuals of further ones."""
        squares, count = sum(float(np.sum(r**2)) for r in residuals), sum(r.size for r in residuals)
        return _HeldOut(self.squares + squares, self.count + count, self.spread + spread)


def _held_out(result: Identification, folds: Sequence[Sequence[str]], *, uncertain: bool = False) -> _HeldOut:
    """Runs that were held out of the fit, fold by fold, each with its own set-up fitted; of a single run, its quarters. With
    their `spread` where it is asked how `uncertain` their prediction is."""
    if len(folds) == 1:
        return _held_out_rows(result, uncertain)
    campaign, found = result.model.campaign, _HeldOut()
    for fold in folds:
        rest = [run.id for run in campaign.runs if run.id not in fold]
        effects = [e for e in result.model.added if any(e.applies(campaign.run(id)) for id in rest)]
        rest_part, learnt = _part(result, rest, effects, {})
        known = {p.name: p.mean for effect in result.model.added for p in effect.parameters(campaign)}
        known |= rest_part.model.named(learnt)
        known = {name: value for name, value in known.items() if not name.startswith("setup.")}
        part, values = _part(result, fold, result.model.added, known)
        residuals = _residuals(part, values, result.file_unit)
        found = found.beside(residuals, _spread(part, rest_part, learnt, result) if uncertain else 0.0)
    return found


def _held_out_rows(result: Identification, uncertain: bool) -> _HeldOut:
    """The quarters of a single run, each left out of the fit in turn."""
    (run,), found = result.model.campaign.runs, _HeldOut()
    whole = result.problem()
    for rows in np.array_split(np.arange(run.rows), FOLDS):
        problem = result.problem()
        problem.left_out[run.id][rows] = True
        values, _ = gauss_newton(problem, result.values, 1e-2)
        only = np.zeros(run.rows, dtype=bool)
        only[rows] = True
        spread = 0.0
        if uncertain:
            seen = _products(whole, values, result.file_unit) - _products(problem, values, result.file_unit)
            spread = float(np.trace(seen @ _covariance(problem, values)))
        found = found.beside(_residuals(problem, values, result.file_unit, only), spread)
    return found


def _part(
    result: Identification, ids: Sequence[str], effects: Sequence[Effect], known: Mapping[str, float]
) -> tuple[Problem, Array]:
    """Some of the runs fitted under the noise of the whole fit, what is `known` held."""
    part = result.model.campaign.select(*ids)
    model = Model(part, [e for e in effects if any(e.applies(run) for run in part.runs)])
    noises = {key: noise for key, noise in result.noises.items() if key[0] in ids}
    kept = tuple(o for o in result.outliers if o.run in ids)
    problem = replace(result, noises=noises, outliers=kept).problem(model)
    problem.free = np.array([p.name not in known for p in model.parameters])
    start = result.named | dict(known)
    values, _ = gauss_newton(problem, model.vector({n: v for n, v in start.items() if n in model.index}), 1e-2)
    return problem, values


def _residuals(problem: Problem, values: Array, unit: str, rows: Flags | slice = slice(None)) -> list[Array]:
    """The residuals of all readings that count and have a unit, of some rows."""
    residuals = problem.residuals_at(values)
    return [
        residuals[run.id][rows, columns][problem.judged(run)[rows, columns]]
        for run in problem.model.campaign.runs
        for _, columns in problem.parts(run)
        if problem.unit_of(run, columns) == unit
    ]


def _covariance(problem: Problem, values: Array) -> Array:
    """Of all parameters (k, k)."""
    return np.asarray(np.linalg.inv(problem.information_at(values).matrix + np.diag(problem.prior_precision)))


def _products(problem: Problem, values: Array, unit: str) -> Array:
    """Of the slopes (k, k), summed over the readings of a unit, in that unit squared."""
    only = {
        (run.id, name)
        for run in problem.model.campaign.runs
        for name, columns in problem.parts(run)
        if problem.unit_of(run, columns) == unit
    }
    return replace(problem, noises=dict.fromkeys(problem.noises, Noise(1.0))).information_at(values, only).matrix


def _spread(part: Problem, rest: Problem, learnt: Array, result: Identification) -> float:
    """The variance, summed over the readings of a part, that what is held there adds by the uncertainty which the rest leaves of
    it, or its prior, what is free there fitted. Slopes are those about the whole fit: an effect that does nothing may have none.
    """
    values = part.model.vector({name: v for name, v in result.named.items() if name in part.model.index})
    free, held, prior = np.flatnonzero(part.free), np.flatnonzero(~part.free), np.diag(part.prior_precision)
    part.free = np.ones_like(part.free)
    matrix, products = part.information_at(values).matrix, _products(part, values, result.file_unit)
    covariance = np.diag(1.0 / part.prior_precision[held])
    where = [rest.model.index.get(part.model.parameters[i].name, -1) for i in held]
    seen = [k for k, number in enumerate(where) if number >= 0]
    own = [number for number in where if number >= 0]
    covariance[np.ix_(seen, seen)] = _covariance(rest, learnt)[np.ix_(own, own)]
    left = np.zeros((len(values), len(held)))  # what a change of each that is held moves, the free ones following
    left[held] = np.eye(len(held))
    left[free] = -np.linalg.solve((matrix + prior)[np.ix_(free, free)], matrix[np.ix_(free, held)])
    return float(np.trace(left.T @ products @ left @ covariance))
