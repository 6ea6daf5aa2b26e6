"""Prove: prediction of readings that were left out, before and after; and the next test where rivals stay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from symfive.diagnose._groups import way
from symfive.diagnose._next_test import next_test
from symfive.diagnose._places import axis_of
from symfive.diagnose._result import Finding, Fit
from symfive.diagnose._search import Naming
from symfive.identify import Identification, fitted_model, predict
from symfive.inference import gauss_newton
from symfive.model import Model
from symfive.threads import one_thread

__all__ = ["prove", "with_next_test"]

FOLDS = 4
OPEN = 0.05


@one_thread
def prove(before: Identification, after: Identification) -> Fit:
    """Quality before and after, over all that was fitted and over what was left out of the fit in turn: runs, and where the
    runs differ in them, a whole feed and a whole place at a time."""
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
    runs = held.pop("runs", (None, None))
    return Fit(before.rms_um, after.rms_um, before.chi2_dof, after.chi2_dof, runs[0], runs[1], held)


def _held_out(result: Identification, folds: Sequence[Sequence[str]]) -> float:
    """rms over runs that were left out of the fit, fold by fold, each with its own set-up fitted."""
    campaign = result.model.campaign
    ids = [run.id for run in campaign.runs]
    squares, count = 0.0, 0
    for fold in folds:
        rest = campaign.select(*(i for i in ids if i not in fold))
        effects = tuple(e for e in result.model.added if any(e.applies(run) for run in rest.runs))
        model = Model(rest, effects)
        start = {
            p.name: float(v) for p, v in zip(result.parameters, result.values, strict=True) if p.name in model.index
        }
        noises = {key: noise for key, noise in result.noises.items() if key[0] not in fold}
        problem = replace(
            result, noises=noises, outliers=tuple(o for o in result.outliers if o.run not in fold)
        ).problem(model)
        values, _ = gauss_newton(problem, model.vector(start), 1e-2)
        fitted = fitted_model(result)
        known = {p.name: float(v) for p, v in zip(model.parameters, values, strict=True) if p.run is None}
        prediction = predict(
            replace(fitted, effects=effects, values={**fitted.values, **known}), campaign.select(*fold)
        )
        for run in fold:
            size = campaign.run(run).rows
            squares += prediction.rms[run] ** 2 * size
            count += size
    return float(np.sqrt(squares / max(count, 1)))


def with_next_test(found: Naming, finding: Finding) -> Finding:
    """The finding with the test that parts it from what still could stand in its place."""
    member = next(m for m in found.members if m.effect.key == finding.effect.key)
    names = {(r.effect, r.axis) for r in finding.rivals if r.confidence > OPEN}
    open_ = [
        t.effect
        for t in member.trials
        if t.effect.key != finding.effect.key
        and t.effect.id != "unknown"
        and (t.effect.key in finding.alias or (t.effect.vocabulary, axis_of(t.effect)) in names)
    ]
    if not open_:
        return finding
    held = tuple(e for e in found.after.model.added if finding.effect.key not in (e.key, getattr(e, "of", "")))
    values = {
        p.name: float(v) for p, v in zip(found.after.parameters, found.after.values, strict=True) if p.run is None
    }
    test = next_test(found.after.model.campaign, finding.effect, open_[0], held=held, values=values)
    if test is None:
        return finding
    folder = f"plans/separate-{finding.effect.key}-from-{open_[0].key}" if test.useful else None
    extra = f" To tell it from {open_[0].key}: {test.says}."
    return replace(finding, test=test, next_test=folder, says=finding.says + extra)
