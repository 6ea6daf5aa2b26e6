"""Cross-validation: prediction of held-out readings, before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from symfive.arrays import Array
from symfive.diagnose._groups import way
from symfive.diagnose._hold_out import WORSE
from symfive.effects import Effect
from symfive.identify import Identification
from symfive.inference import gauss_newton
from symfive.model import Model
from symfive.numbers import change, plain_number
from symfive.threads import one_thread

__all__ = ["Fit", "cross_validated"]

FOLDS = 4
BEYOND = 1.5
"""Held-out readings predicted so many times worse than fitted ones are reported."""


@dataclass(frozen=True)
class Fit:
    """Quality before and after: rms over all readings, excluded outliers too; χ² over those that each fit kept; the held-out
    part by leaving out runs in turn, `heldout_by` a whole feed or place at a time: what → (before, after), µm."""

    rms_before_um: float
    rms_after_um: float
    chi2_dof_before: float
    chi2_dof_after: float
    heldout_rms_before_um: float | None
    heldout_rms_after_um: float | None
    heldout_by: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def doubts(self, unit: str) -> tuple[str, ...]:
        """What speaks against the findings: held-out readings that are predicted worse with them, or far worse than those that
        were fitted."""
        runs = (self.heldout_rms_before_um, self.heldout_rms_after_um)
        said = []
        for what, (before, after) in {"run": runs, **self.heldout_by}.items():
            if before is None or after is None:
                continue
            one, beyond = f"A {what} that was left out of the fit", f"do not trust them beyond the {what}s recorded"
            if after > (1.0 + WORSE) * before:
                advice = "treat them as a hint, not as proven" if what == "run" else beyond
                said.append(f"{one} is predicted worse with them ({change(before, after, unit)} {unit} rms): {advice}.")
            elif after > BEYOND * self.rms_after_um:
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
    held = {}
    for name, folds in ways.items():
        if len(folds) > 1:
            first = _held_out(before, folds)
            held[name] = (first, first if same else _held_out(after, folds))
    if len(ids) == 1:
        first = _held_out_rows(before)
        held["runs"] = (first, first if same else _held_out_rows(after))
    runs = held.pop("runs", (None, None))
    return Fit(before.rms_um, after.rms_um, before.chi2_dof, after.chi2_dof, runs[0], runs[1], held)


def _held_out(result: Identification, folds: Sequence[Sequence[str]]) -> float:
    """rms over runs that were left out of the fit, fold by fold, each with its own set-up fitted."""
    campaign = result.model.campaign
    squares, count = 0.0, 0
    for fold in folds:
        rest = [run.id for run in campaign.runs if run.id not in fold]
        effects = [e for e in result.model.added if any(e.applies(campaign.run(id)) for id in rest)]
        learnt = _part(result, rest, effects, {})
        known = {name: v for name, v in learnt[0].items() if not name.startswith("setup.")}
        for residual in _part(result, fold, effects, known)[1]:
            squares += float(np.sum(residual**2))
            count += residual.size
    return float(np.sqrt(squares / max(count, 1)))


def _held_out_rows(result: Identification) -> float:
    """The same for a single run: rms over its quarters, each left out of the fit in turn."""
    unit = result.file_unit
    (run,) = result.model.campaign.runs
    squares, count = 0.0, 0
    for rows in np.array_split(np.arange(run.rows), FOLDS):
        problem = result.problem()
        problem.left_out[run.id][rows] = True
        values, _ = gauss_newton(problem, result.values, 1e-2)
        residual = problem.residuals_at(values)[run.id]
        for part in (part for _, part in problem.parts(run) if problem.unit_of(run, part) == unit):
            counted = residual[rows][:, part][~problem.undetermined[run.id][rows][:, part]]
            squares += float(np.sum(counted**2))
            count += counted.size
    return float(np.sqrt(squares / max(count, 1)))


def _part(
    result: Identification, ids: Sequence[str], effects: Sequence[Effect], known: Mapping[str, float]
) -> tuple[dict[str, float], list[Array]]:
    """Some of the runs fitted under the noise of the whole fit, what is `known` held: values by name, and the residuals of all
    readings that count and have the unit of the fit's rms."""
    part = result.model.campaign.select(*ids)
    model = Model(part, [e for e in effects if any(e.applies(run) for run in part.runs)])
    noises = {key: noise for key, noise in result.noises.items() if key[0] in ids}
    kept = tuple(o for o in result.outliers if o.run in ids)
    problem = replace(result, noises=noises, outliers=kept).problem(model)
    problem.free = np.array([p.name not in known for p in model.parameters])
    start = result.named | dict(known)
    values, _ = gauss_newton(problem, model.vector({n: v for n, v in start.items() if n in model.index}), 1e-2)
    residuals, unit = problem.residuals_at(values), result.file_unit
    return model.named(values), [
        residuals[run.id][:, columns][~problem.undetermined[run.id][:, columns]]
        for run in part.runs
        for _, columns in problem.parts(run)
        if problem.unit_of(run, columns) == unit
    ]
