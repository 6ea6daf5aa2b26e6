"""Forward, swap and backward search for the physics that was left out, each step judged by exact refits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign
from symfive.diagnose._catalogue import catalogue
from symfive.diagnose._remainder import remainder
from symfive.diagnose._scan import probes, scan
from symfive.diagnose._scores import Board, Score, _added, score_catalogue
from symfive.diagnose._unknown import unknowns
from symfive.diagnose._variants import variants
from symfive.effects import Effect
from symfive.identify import Identification, identify
from symfive.inference import Problem, gauss_newton
from symfive.model import Model

__all__ = ["Member", "Search", "Trial", "search"]

Array = NDArray[np.float64]
MAX_EFFECTS = 5
TRIALS = 5
PASSES = 2
DECISIVE = 5.0
"""Log evidence from which one says decisive (H. Jeffreys 1961, appendix B: a factor of more than 100)."""
MATERIAL = 0.15
"""An effect counts only if what it takes off the residual has at least this rms in units of the white noise: less
changes the residual's rms by under 1 % (0.15²/2)."""


@dataclass(frozen=True)
class Trial:
    """An exact refit with one more effect: its log evidence against the fit without it, under the same noise, and its
    `gain`, the mean square that it takes off the residual over that of the white noise."""

    effect: Effect
    evidence: float
    values: Mapping[str, float]
    gain: float


@dataclass(frozen=True)
class Member:
    """An effect found. `log_p` of its score before it joined, corrected for all places looked at; `trials` the exact
    refits of all that could stand in its place, under the noise of the final fit, best first."""

    effect: Effect
    log_p: float
    trials: tuple[Trial, ...] = ()


@dataclass
class Search:
    """What the search found: the fit before and after, the members, the first board (for the observability table)."""

    before: Identification
    after: Identification
    members: list[Member] = field(default_factory=list)
    board: Board | None = None
    log_p: float = 0.0
    looks: int = 0


def search(
    campaign: Campaign,
    *,
    level: float = 0.01,
    exclude: Sequence[str] = (),
    progress: Callable[[str], None] = lambda message: None,
) -> Search:
    """Find effects until nothing significant and material is left. `level`: false alarms over the whole catalogue.

    `exclude` takes effects (by id) out of the catalogue, as a control.
    """
    progress("fitting the baseline")
    before = identify(campaign)
    state = Search(before, before)
    _forward(campaign, state, level, exclude, progress)
    for _ in range(PASSES):
        if not _contest(campaign, state, exclude, progress):
            break
        _forward(campaign, state, level, exclude, progress)
    return state


def _forward(
    campaign: Campaign, state: Search, level: float, exclude: Sequence[str], progress: Callable[[str], None]
) -> None:
    """Add effects until none that is left is significant and material."""
    while len(state.members) < MAX_EFFECTS:
        progress(f"scoring the catalogue, {len(state.members)} effects found")
        board, scores, looks = _scores(state.after, exclude)
        if state.board is None:
            state.board, state.looks = board, looks
            state.log_p = min(0.0, min((s.log_p for s in scores), default=0.0) + np.log(max(looks, 1)))
        best = _best(state.after, scores, looks, level, progress)
        if best is None:
            state.after = _with_families(campaign, state.after)
            return
        trial, log_p = best
        state.after = _shaped(campaign, state.after, trial)
        state.members.append(Member(_newest(state.after), log_p))
        progress(f"found {trial.effect.key}")
        _prune(campaign, state)


def _contest(campaign: Campaign, state: Search, exclude: Sequence[str], progress: Callable[[str], None]) -> bool:
    """Put every member to the test against all that could stand in its place; True where one was replaced.

    Under the noise of the full fit, with all other members in the model, the evidence is sharper than it was when the
    member was found.
    """
    swapped = False
    for number, member in enumerate(state.members):
        progress(f"rivals of {member.effect.key}")
        without = _lacking(campaign, state.after, member.effect)
        scores = [s for s in _scores(without, exclude, scanning=False)[1] if s.effect.key != member.effect.key]
        rivals = sorted(scores, key=lambda s: -s.drop)[:TRIALS]
        found = [t for t in (_try(without, s) for s in rivals) if t is not None]
        own = _try(without, _own_score(state.after, member.effect))
        if own is None:
            continue
        trials = sorted([own, *found], key=lambda t: -t.evidence)
        state.members[number] = replace(member, trials=tuple(trials))
        if trials[0].evidence > own.evidence + 1.0:
            state.after = _shaped(campaign, without, trials[0])
            state.members[number] = Member(_newest(state.after), member.log_p)
            progress(f"{trials[0].effect.key} takes the place of {member.effect.key}")
            swapped = True
    return swapped


def _lacking(campaign: Campaign, result: Identification, effect: Effect) -> Identification:
    """The fit without an effect and the rest of its family, under the same noise and outliers."""
    kept = tuple(e for e in _own(result) if effect.key not in (e.key, getattr(e, "of", "")))
    model = Model(campaign, kept)
    start = {p.name: float(v) for p, v in zip(result.parameters, result.values, strict=True) if p.name in model.index}
    values, _ = gauss_newton(_problem(model, result), model.vector(start), 1e-2)
    residuals = {run.id: model.readings(run) - model.predict_run(run, values) for run in campaign.runs}
    return replace(result, model=model, values=values, residuals=residuals)


def _own_score(result: Identification, effect: Effect) -> Score:
    """A member as a candidate again, starting from what the fit found for it."""
    step = {p.name: result[p.name] - p.mean for p in effect.parameters(result.model.campaign)}
    return Score(effect, np.inf, 1.0, -np.inf, 1.0, 1.0, step)


def _newest(result: Identification) -> Effect:
    return [e for e in result.model.effects if e.id != "family_shape"][-1]


def _scores(result: Identification, exclude: Sequence[str], *, scanning: bool = True) -> tuple[Board, list[Score], int]:
    campaign = result.model.campaign
    held = result.model.effects
    shapes = remainder(result.model, result.values, _own(result))
    plain = [e for e in catalogue(campaign, held) if e.id not in exclude]
    board = score_catalogue(result, plain, shapes, probes(campaign))
    scores = [board.score(e) for e in plain]
    taken = {e.key for e in held}
    found = [f for f in (scan(board) if scanning else []) if f.effect.id not in exclude and f.effect.key not in taken]
    unique = {f.effect.key: f for f in reversed(found)}
    nameless = list(unknowns(campaign, held))
    second = score_catalogue(result, [*(f.effect for f in unique.values()), *nameless], shapes)
    for f in unique.values():
        score = second.score(f.effect)
        scores.append(replace(score, log_p=score.log_p + float(np.log(f.looks))))
    scores += [second.score(effect) for effect in nameless]
    seen = [s for s in scores if s.dof > 0.5]
    return board, sorted(seen, key=lambda s: s.log_p), max(1, len(seen))


def _best(
    result: Identification, scores: Sequence[Score], looks: int, level: float, progress: Callable[[str], None]
) -> tuple[Trial, float] | None:
    """The effect with the greatest evidence among those that are significant and material, by exact refits."""
    limit = float(np.log(level / looks))
    significant = [s for s in scores if s.log_p < limit]
    if not significant:
        return None
    named = sorted((s for s in significant if s.effect.id != "unknown"), key=lambda s: -s.drop)[:TRIALS]
    nameless = sorted((s for s in significant if s.effect.id == "unknown"), key=lambda s: -s.drop)[:1]
    ordered = [*named, *nameless]
    trials = []
    for s in ordered:
        progress(f"trying {s.effect.key}")
        trial = _try(result, s)
        if trial is not None and trial.gain > MATERIAL**2:
            trials.append(trial)
    if not trials:
        return None
    best = max(trials, key=lambda t: t.evidence)
    log_p = next(s.log_p for s in scores if s.effect.key == best.effect.key) + float(np.log(looks))
    return best, min(log_p, 0.0)


def _gain(result: Identification, model: Model, values: Array) -> float:
    """Fall of the residual's mean square, in units of the white noise, over all that was read."""
    before = after = count = 0.0
    for run in model.campaign.runs:
        floor = np.array([n.white for (r, _), n in result.noises.items() if r == run.id]).mean()
        residual = (model.readings(run) - model.predict_run(run, values)) / floor
        before += float(np.sum((result.residuals[run.id] / floor) ** 2))
        after += float(np.sum(residual**2))
        count += residual.size
    return (before - after) / max(count, 1.0)


def _try(result: Identification, score: Score) -> Trial | None:
    """An exact refit with the effect, under the noise of the present fit."""
    campaign = result.model.campaign
    effects = (*_own(result), score.effect)
    model = Model(campaign, effects)
    start = {p.name: float(v) for p, v in zip(result.parameters, result.values, strict=True)}
    start |= _start(model, score)
    problem = _problem(model, result)
    try:
        values, _ = gauss_newton(problem, model.vector(start), 1e-2)
        evidence = _evidence(problem, values) - _evidence(_problem(result.model, result), result.values)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(evidence):
        return None
    named = {p.name: float(v) for p, v in zip(model.parameters, values, strict=True)}
    if score.effect.id == "unknown":
        evidence -= DECISIVE  # a name is given up only for decisive evidence
    return Trial(score.effect, evidence, named, _gain(result, model, values))


def _start(model: Model, score: Score) -> dict[str, float]:
    """Where the refit begins: the score's own step, from the prior mean, inside the bounds."""
    start = {}
    for name, step in score.step.items():
        p = model.parameters[model.index[name]]
        value = p.mean + step
        if p.start is not None and p.start != p.mean and step == 0.0:
            value = p.start
        start[name] = float(
            np.clip(value, p.lower if np.isfinite(p.lower) else value, p.upper if np.isfinite(p.upper) else value)
        )
    return start


def _own(result: Identification) -> tuple[Effect, ...]:
    return tuple(_added(result.model))


def _problem(model: Model, result: Identification) -> Problem:
    problem = Problem.of(model, noises=result.noises)
    for outlier in result.outliers:
        names = [c.name for c in model.columns(outlier.run)]
        problem.left_out[outlier.run][outlier.row, names.index(outlier.column)] = True
    return problem


def _evidence(problem: Problem, values: Array) -> float:
    """Log marginal likelihood, up to what does not depend on the model, of a fit that may or may not need the rest of
    its effects' own families: the mean of both.

    Where the library's form is right the plain fit decides; where it is a little off, what counts is whether the family
    explains the readings, and a form that needs less of the rest is better.
    """
    return float(np.logaddexp(_plain_evidence(problem, values), _family_evidence(problem, values)) - np.log(2.0))


def _plain_evidence(problem: Problem, values: Array) -> float:
    """-½ cost - ½ log det(1 + H σ²): Laplace's approximation, linear in what is small."""
    return _marginal(problem, problem.model, values)


def _family_evidence(problem: Problem, values: Array) -> float:
    """The same with the rest of every effect's family integrated out."""
    model = problem.model
    shapes = remainder(model, values, model.effects)
    if not shapes:
        return -np.inf
    return _marginal(problem, Model(model.campaign, [*_added(model), *shapes]), values)


def _marginal(problem: Problem, wide: Model, values: Array) -> float:
    full = wide.vector({p.name: float(v) for p, v in zip(problem.model.parameters, values, strict=True)})
    inner = Problem.of(wide, noises=problem.noises)
    inner.left_out = problem.left_out
    information = inner.information(inner.blocks(full))
    sigma = wide.prior_sigma
    departure = (full - wide.prior_mean) / sigma
    scaled = information.matrix * np.outer(sigma, sigma) + np.eye(len(sigma))
    pull = information.gradient * sigma - departure
    gain = float(pull @ np.linalg.solve(scaled, pull))
    cost = information.square + float(departure @ departure) - gain
    return -0.5 * cost - 0.5 * float(np.linalg.slogdet(scaled)[1])


def _shaped(campaign: Campaign, result: Identification, trial: Trial) -> Identification:
    """Full fit with the effect in the best of its own shapes, noise found anew.

    The plain shape keeps its place unless another one's evidence is better under the same noise.
    """
    plain = identify(Model(campaign, (*_own(result), trial.effect)), start=trial.values, start_noise=result.noises)
    best, best_evidence = plain, _evidence(_problem(plain.model, plain), plain.values)
    for other in variants(trial.effect):
        try:
            prepared = other.prepare(campaign)
            model = Model(campaign, (*_own(result), prepared))
            start = {n: v for n, v in trial.values.items() if n in model.index}
            problem = _problem(model, plain)
            values, _ = gauss_newton(problem, model.vector(start), 1e-2)
            evidence = _evidence(problem, values)
        except (ValueError, np.linalg.LinAlgError):
            continue
        simpler = len(prepared.parameters(campaign)) < len(trial.effect.parameters(campaign))
        if evidence > best_evidence + (0.0 if simpler else DECISIVE):
            named = {p.name: float(v) for p, v in zip(model.parameters, values, strict=True)}
            best, best_evidence = identify(model, start=named, start_noise=plain.noises), evidence
    return best


def _with_families(campaign: Campaign, result: Identification) -> Identification:
    """The fit with the rest of each effect's family in the model, where the evidence for it is decisive.

    Family right, shape different: the rest is a part of the finding, not a second one. It comes last, when no effect
    with a name of its own explains more.
    """
    for shape in remainder(result.model, result.values, _own(result)):
        wide = Model(campaign, (*_own(result), shape))
        problem = _problem(result.model, result)
        if _marginal(problem, wide, result.values) > _plain_evidence(problem, result.values) + DECISIVE:
            start = {p.name: float(v) for p, v in zip(result.parameters, result.values, strict=True)}
            result = identify(wide, start=start, start_noise=result.noises)
    return result


def _prune(campaign: Campaign, state: Search) -> None:
    """Drop an earlier effect that the later ones have made needless."""
    for member in state.members[:-1]:
        without = _lacking(campaign, state.after, member.effect)
        full = _evidence(_problem(state.after.model, state.after), state.after.values)
        if full - _evidence(_problem(without.model, without), without.values) < 3.0:
            named = {p.name: float(v) for p, v in zip(without.parameters, without.values, strict=True)}
            state.after = identify(without.model, start=named, start_noise=without.noises)
            state.members = [m for m in state.members if m.effect.key != member.effect.key]
