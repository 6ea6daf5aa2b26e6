"""`diagnose`: detect, locate, name, model and prove, from a campaign with readings to an expert's letter."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign
from symfive.diagnose._next_test import next_test
from symfive.diagnose._result import Diagnosis, Finding, Fit, Interval, Observability, RivalName
from symfive.diagnose._scores import Board
from symfive.diagnose._search import Member, Search, _lacking, _own, _problem, search
from symfive.effects import Effect
from symfive.effects.unknown import Unknown
from symfive.identify import Identification, fitted_model, predict
from symfive.inference import gauss_newton
from symfive.model import Model
from symfive.threads import one_thread

__all__ = ["diagnose"]

Array = NDArray[np.float64]
FOLDS = 4
ALIAS = 0.999
ALIAS_EVIDENCE = 3.0
OPEN = 0.05


@one_thread
def diagnose(
    campaign: Campaign,
    *,
    false_alarms: float = 0.01,
    exclude: Sequence[str] = (),
    progress: Callable[[str], None] = lambda message: None,
) -> Diagnosis:
    """Find, name and model the physics that the baseline leaves out.

    `false_alarms` is the rate at which a clean campaign may raise any finding, over the whole catalogue; `exclude`
    takes effects (by id) out of the catalogue, as a control. Raises `InputError` for a campaign without readings.
    """
    found = search(campaign, level=false_alarms, exclude=exclude, progress=progress)
    progress("comparing rivals")
    findings = [_finding(found, member) for member in found.members]
    progress("looking for the next test")
    findings = [_with_test(found, finding, member) for finding, member in zip(findings, found.members, strict=True)]
    findings.sort(key=lambda f: -f.share)
    progress("leaving out runs in turn")
    assert found.board is not None
    return Diagnosis(
        mismatch=bool(findings),
        p_value=float(np.exp(max(found.log_p, -690.0))),
        noise_um=float(np.sqrt(np.mean([n.white**2 for n in found.after.noises.values()]))),
        findings=tuple(findings),
        fit=_fit(found),
        observability=_observability(found.board),
        classes=_classes(found.board),
        before=found.before,
        after=found.after,
    )


def _observability(board: Board) -> tuple[Observability, ...]:
    rows = []
    for effect in board.effects:
        score = board.score(effect)
        rows.append(Observability(effect.vocabulary, _axis(effect), effect.key, min(score.visible, 1.0), score.size))
    return tuple(rows)


def _axis(effect: Effect) -> str | None:
    """The axis an effect is about: its own, or that of its component."""
    component = getattr(effect, "component", None)
    if effect.axis is None and isinstance(component, str):
        return component[3:] if component[2:3] == "0" else component[2:]
    return effect.axis


def _classes(board: Board) -> tuple[tuple[str, ...], ...]:
    """Effects with one visible parameter direction whose shapes agree after the fit has taken its part."""
    scores = [board.score(e) for e in board.effects]
    seen = [s.effect for s in scores if s.size > 3.0 and s.dof < 1.5]
    groups: list[list[Effect]] = []
    for effect in seen:
        home = next((g for g in groups if board.cosine(g[0], effect) > ALIAS), None)
        if home is None:
            groups.append([effect])
        else:
            home.append(effect)
    return tuple(tuple(e.key for e in g) for g in groups if len(g) > 1)


def _finding(found: Search, member: Member) -> Finding:
    after = found.after
    campaign = after.model.campaign
    effect = next(e for e in after.model.effects if e.key == member.effect.key)
    values = {p.name: float(v) for p, v in zip(after.parameters, after.values, strict=True)}
    covariance = _pairs(after, effect)
    contribution = _contribution(after, effect)
    lacking = _lacking(campaign, after, effect)
    rivals, alias, confidence = _rivals(effect, member)
    shape = _shape_share(after, effect, contribution)
    parameters = effect.describe(campaign, values, covariance)
    square = {run: float(np.mean(c**2)) for run, c in contribution.items()}
    total = float(np.mean(np.concatenate([r.ravel() ** 2 for r in found.before.residuals.values()])))
    left = float(np.mean(np.concatenate([r.ravel() ** 2 for r in after.residuals.values()])))
    lost = float(np.mean(np.concatenate([r.ravel() ** 2 for r in lacking.residuals.values()])))
    share = max(0.0, (lost - left) / max(total, 1e-300))
    strongest = max(square.values(), default=0.0)
    runs = tuple(run for run, s in square.items() if s > 0.05 * strongest)
    name, axis = effect.vocabulary, _axis(effect)
    board = found.board
    visible = (
        next((board.score(e).visible for e in board.effects if e.key == effect.key), 1.0) if board is not None else 1.0
    )
    before = {p.name: float(v) for p, v in zip(lacking.parameters, lacking.values, strict=True) if p.run is None}
    moved = _moved(before, after)
    draft = Finding(
        effect=effect, name=name, axis=axis, confidence=confidence, parameters=parameters, rivals=rivals, runs=runs,
        coordinate=_coordinate(effect), intervals=_intervals(campaign, contribution),
        direction=_direction(after, effect), says="", log_p=member.log_p, visible=min(visible, 1.0),
        share=min(share, 1.0), moved=moved,
        contribution=contribution, alias=alias, shape_differs=shape,
    )  # fmt: skip
    return replace(draft, says=_sentence(draft))


def _pairs(result: Identification, effect: Effect) -> dict[tuple[str, str], float]:
    names = [p.name for p in effect.parameters(result.model.campaign)]
    place = [result.model.index[n] for n in names]
    return {
        (a, b): float(result.covariance[i, j])
        for a, i in zip(names, place, strict=True)
        for b, j in zip(names, place, strict=True)
    }


def _contribution(result: Identification, effect: Effect) -> dict[str, Array]:
    """Readings with the effect minus readings without it, everything else as fitted."""
    values = result.values.copy()
    for p in effect.parameters(result.model.campaign):
        values[result.model.index[p.name]] = p.mean
    return {
        run.id: result.model.predict_run(run, result.values) - result.model.predict_run(run, values)
        for run in result.model.campaign.runs
    }


def _shape_share(result: Identification, effect: Effect, contribution: Mapping[str, Array]) -> float:
    """rms of the rest of the effect's family over its own: by how much its shape differs from the library's."""
    rest = next((e for e in result.model.effects if getattr(e, "of", "") == effect.key), None)
    if rest is None:
        return 0.0
    parts = _contribution(result, rest)
    own = np.concatenate([(c - c.mean(axis=0)).ravel() for c in contribution.values()])
    other = np.concatenate([(c - c.mean(axis=0)).ravel() for c in parts.values()])
    return float(np.sqrt(np.mean(other**2) / max(float(np.mean(own**2)), 1e-300)))


def _moved(before: Mapping[str, float], after: Identification) -> dict[str, tuple[float, float]]:
    """Machine parameters that moved by more than their 1σ, the most moved first."""
    moved = {}
    for p in after.parameters:
        if p.kind in ("location_error", "error_motion") and p.name in before:
            change = abs(after[p.name] - before[p.name]) / max(after.uncertainty(p.name), 1e-12)
            if change > 1.0:
                moved[p.name] = (change, before[p.name], after[p.name])
    ranked = sorted(moved.items(), key=lambda item: -item[1][0])
    return {name: (b, a) for name, (_, b, a) in ranked[:8]}


def _rivals(effect: Effect, member: Member) -> tuple[tuple[RivalName, ...], tuple[str, ...], float]:
    """Rivals with their probabilities, forms of the same effect that read alike, and the probability of the name.

    Probabilities from the log evidence of exact refits under the final noise, every name weighed by its best form.
    """
    own = next((t.evidence for t in member.trials if t.effect.key == effect.key), None)
    if own is None:
        return (), (), 0.999
    behind: dict[tuple[str, str | None], tuple[float, Effect]] = {}
    alias = []
    for trial in member.trials:
        gap = own - trial.evidence
        who = (trial.effect.vocabulary, _axis(trial.effect))
        if who == (effect.vocabulary, _axis(effect)):
            if trial.effect.key != effect.key and gap < ALIAS_EVIDENCE:
                alias.append(trial.effect.key)
        elif who not in behind or gap < behind[who][0]:
            behind[who] = (gap, trial.effect)
    weights = {who: float(np.exp(-np.clip(gap, -30.0, 700.0))) for who, (gap, _) in behind.items()}
    total = 1.0 + sum(weights.values())
    names = tuple(
        RivalName(who[0], who[1], weights[who] / total, getattr(behind[who][1], "component", None))
        for who in sorted(weights, key=lambda w: -weights[w])
    )
    return names, tuple(alias), min(1.0 / total, 0.999)


def _with_test(found: Search, finding: Finding, member: Member) -> Finding:
    """The finding with the test that parts it from what still could stand in its place."""
    names = {(r.effect, r.axis) for r in finding.rivals if r.confidence > OPEN}
    open_ = [
        t.effect
        for t in member.trials
        if t.effect.key != finding.effect.key
        and t.effect.id != "unknown"
        and (t.effect.key in finding.alias or (t.effect.vocabulary, _axis(t.effect)) in names)
    ]
    if not open_:
        return finding
    held = tuple(e for e in _own(found.after) if finding.effect.key not in (e.key, getattr(e, "of", "")))
    values = {
        p.name: float(v) for p, v in zip(found.after.parameters, found.after.values, strict=True) if p.run is None
    }
    test = next_test(found.after.model.campaign, finding.effect, open_[0], held=held, values=values)
    if test is None:
        return finding
    folder = f"plans/separate-{finding.effect.key}-from-{open_[0].key}" if test.useful else None
    extra = f" To tell it from {open_[0].key}: {test.says}."
    return replace(finding, test=test, next_test=folder, says=finding.says + extra)


_COORDINATES = {
    "backlash": "{axis} velocity sign", "lateral_play": "{axis} velocity sign", "friction": "{axis} velocity sign",
    "reversal_spike": "{axis} velocity sign", "counterbalance": "{axis} velocity sign", "transmission_error": "{axis}",
    "servo_mismatch": "{axis} velocity", "latency": "time", "location_error": "pose", "error_motion": "{axis}",
    "scale_error": "{axis}", "gravity_sag": "{axis}", "thermal_drift": "time", "spindle_growth": "time",
    "bar_temperature": "time", "setup_shift": "time", "sensor_error": "reading", "sensor_low_pass": "time",
    "vibration": "time", "inertial_compliance": "{axis} acceleration", "structural_resonance": "{axis} acceleration",
    "table_step": "{axis}", "eccentric_mass": "{axis}",
}  # fmt: skip


def _coordinate(effect: Effect) -> str:
    if isinstance(effect, Unknown):
        return ", ".join(effect.over)
    return _COORDINATES.get(effect.id, "pose").format(axis=_axis(effect))


def _intervals(campaign: Campaign, contribution: Mapping[str, Array], limit: int = 40) -> tuple[Interval, ...]:
    """Stretches in which the effect exceeds half of its largest deviation from its own mean."""
    largest = max((float(np.abs(c - np.median(c, axis=0)).max()) for c in contribution.values()), default=0.0)
    found = []
    for run in campaign.runs:
        c = contribution[run.id]
        strong = np.abs(c - np.median(c, axis=0)).max(axis=1) > 0.5 * largest
        edges = np.flatnonzero(np.diff(np.concatenate([[False], strong, [False]]).astype(int)))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            found.append(Interval(run.id, float(run.time[begin]), float(run.time[end - 1])))
    return tuple(found[:limit])


def _direction(result: Identification, effect: Effect) -> tuple[float, float, float] | None:
    """Direction of space in which it acts, machine frame: of its three amplitudes, its component or its axis."""
    vectors = [p for p in effect.parameters(result.model.campaign) if p.name[-2:] in (".x", ".y", ".z")]
    if len(vectors) == 3:
        v = np.array([result[p.name] for p in vectors])
        norm = float(np.linalg.norm(v))
        return tuple((v / norm).tolist()) if norm > 0.0 else None
    component = getattr(effect, "component", None)
    if isinstance(component, str):
        return tuple(float(i == "XYZABC".index(component[1]) % 3) for i in range(3))  # type: ignore[return-value]
    axis = _axis(effect)
    return None if axis is None else result.model.machine.axes[axis].direction


def _fit(found: Search) -> Fit:
    before, after = _held_out(found.before), None
    after = before if not found.members else _held_out(found.after)
    return Fit(
        found.before.rms_um, found.after.rms_um, found.before.chi2_dof, found.after.chi2_dof, before, after,
    )  # fmt: skip


def _held_out(result: Identification) -> float | None:
    """rms over runs that were left out of the fit in turn, each with its own set-up fitted; None for a single run."""
    campaign = result.model.campaign
    ids = [run.id for run in campaign.runs]
    if len(ids) < 2:
        return None
    squares, count = 0.0, 0
    folds = [ids[i :: min(FOLDS, len(ids))] for i in range(min(FOLDS, len(ids)))]
    for fold in folds:
        rest = campaign.select(*(i for i in ids if i not in fold))
        effects = tuple(e for e in _own(result) if any(e.applies(run) for run in rest.runs))
        model = Model(rest, effects)
        start = {
            p.name: float(v) for p, v in zip(result.parameters, result.values, strict=True) if p.name in model.index
        }
        noises = {key: noise for key, noise in result.noises.items() if key[0] not in fold}
        problem = _problem(
            model, replace(result, noises=noises, outliers=tuple(o for o in result.outliers if o.run not in fold))
        )
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


def _sentence(finding: Finding) -> str:
    """One sentence: what, where, how large, how sure, what hides it."""
    effect = finding.effect
    where = f" of axis {finding.axis}" if finding.axis else ""
    sizes = []
    for name, q in finding.parameters.items():
        if isinstance(q.value, float) and isinstance(q.std, float):
            sizes.append(f"{_plain(name, q.unit)} {q.value:.4g} ± {q.std:.2g} {_shown(q.unit)}".rstrip())
        elif isinstance(q.value, str):
            sizes.append(f"{name} {q.value}")
    sure = "over 99" if finding.confidence >= 0.995 else f"{100 * finding.confidence:.0f}"
    count = len(finding.runs)
    text = f"{finding.name.replace('_', ' ').capitalize()}{where} ({effect.says})"
    text += f": {', '.join(sizes[:4])}" if sizes else ""
    text += f"; it acts over {finding.coordinate} in {count} run{'s' if count > 1 else ''}, confidence {sure} %"
    if finding.moved:
        name, (before, after) = next(iter(finding.moved.items()))
        unit = "µm" if name[1] in "XYZ" else "µrad"
        text += f"; before it was modelled it hid in the geometry ({name} {before:.3g} → {after:.3g} {unit})"
    elif finding.visible < 0.5:
        text += f"; the fit had swallowed {100 * (1 - finding.visible):.0f} % of it"
    if finding.shape_differs:
        text += f"; its shape differs from the library's by {100 * finding.shape_differs:.0f} %"
    if finding.alias:
        text += f"; {', '.join(finding.alias)} would read the same here"
    return text + "."


def _shown(unit: str | None) -> str:
    return (unit or "").replace("um", "µm").replace("urad", "µrad").replace("^2", "²")


def _plain(name: str, unit: str | None) -> str:
    """A parameter's name as words, without the unit that stands behind the number."""
    return name.removesuffix(f"_{(unit or '').lower()}").replace("_", " ")
