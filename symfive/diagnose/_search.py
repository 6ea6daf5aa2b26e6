"""Name: forward, swap and backward search for the physics that was left out, each step judged by exact refits."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign
from symfive.diagnose._alike import SAME, levelled
from symfive.diagnose._detect import Detection
from symfive.diagnose._determined import log_chance_of_nothing
from symfive.diagnose._evidence import evidence_of
from symfive.diagnose._locate import Location, Survey, locate, survey
from symfive.diagnose._places import axis_of, reshapes
from symfive.diagnose._refit import (
    DECISIVE,
    Trial,
    amplitudes,
    best_shape,
    lacking,
    newest,
    refitted,
    settled,
    shaped,
    tried,
    tried_together,
    with_families,
)
from symfive.diagnose._regroup import kin, merge, simplify, spell_out
from symfive.diagnose._scores import Score, log_tail
from symfive.diagnose._slow import (
    changes_slowly,
    drift,
    large_noise,
    log_share,
    name_or_noise,
    physics_or_noise,
    slow_noise,
    whitened,
)
from symfive.diagnose._state import MAX_ADDED, Member, State
from symfive.diagnose._variants import simpler
from symfive.effects import Effect
from symfive.effects.unknown import Unknown
from symfive.identify import Identification
from symfive.model import Model
from symfive.screen import OnScreen
from symfive.threads import one_thread

__all__ = ["Member", "Naming", "name_effects"]

Array = NDArray[np.float64]
TRIALS, MOST_TRIALS = 4, 8
"""Names tried at least; and at most, where their scores are nearly equal."""
PASSES = 2
TIE = 0.05
"""Log evidence by which two that read alike may differ by rounding: neither takes the other's place."""
OPEN, OPEN_SHARE = 10.0, 0.2
"""Rivals that come as near as this to a member, both in plain shapes, are tried in all theirs: log evidence, and its share."""
MATERIAL = 0.15
"""An effect counts only if its readings about their mean have at least this rms in units of the declared noise: less
changes the residual's rms by under 1 % (0.15²/2), even where no other parameter swallows it."""


@dataclass(frozen=True, repr=False)
class Naming(OnScreen):
    """What was named: the fit `before` and `after`, the `members` in the order found, where they were looked for; `withdrawn`
    what had evidence but no size, each with the fit that held it."""

    before: Identification
    after: Identification
    members: tuple[Member, ...]
    location: Location = field(repr=False)
    withdrawn: tuple[tuple[Effect, Identification], ...] = field(default=(), repr=False)

    def __str__(self) -> str:
        return "\n".join(
            f"{m.effect.key:<34} log10 p = {m.log_p / np.log(10.0):.1f}"
            + "".join(f"\n    {t.effect.key:<34} log evidence {t.evidence:.1f}" for t in m.trials)
            for m in self.members
        )


@one_thread
def name_effects(
    found: Location | Detection | Identification | Campaign,
    *,
    level: float = 0.01,
    exclude: Sequence[str] = (),
    progress: Callable[[str], None] = lambda message: None,
) -> Naming:
    """Find effects until nothing significant and material is left, and weigh each against all that could stand in its place.

    `level` is the rate of false names over the whole catalogue, half of it under the noise of the fit and half under noise
    found anew; `exclude` takes effects (by id) out of the catalogue, as a control.
    """
    location = found if isinstance(found, Location) else locate(found, exclude=exclude, progress=progress)
    before = location.detection.fit
    names = Counter((s.effect.vocabulary, axis_of(s.effect)) for s in location.survey.scores)
    state = State(before, 0.5 * level, tuple(exclude), progress, names)
    _forward(state, location.survey)
    if simplify(state, location.survey):
        _forward(state)
    spell_out(state, _forward)
    for _ in range(PASSES):
        if merge(state):
            _forward(state)
        if not _contest(state):
            break
        _forward(state)
    _prune(state, state.members)
    _drifting(state)
    state.after = settled(state.after)
    _withdraw(state)
    after = state.after if state.members or not state.withdrawn else before
    return Naming(before, after, tuple(state.members), location, tuple(state.withdrawn))


def _forward(state: State, seen: Survey | None = None) -> None:
    """Add effects until none that is left is significant and material. `seen`: the survey of the present fit, if at hand.

    What later members made needless does not come back: without that, two that stand in for a third take turns for ever.
    """
    done, fit = _Trials(), state.after
    while len(state.members) < state.most and state.added < MAX_ADDED:
        if state.after is not fit:
            done, fit = _Trials(), state.after
        state.progress(f"scoring the catalogue, {len(state.members)} effects found")
        seen = seen or survey(state.after, state.exclude)
        best = _best(state, seen, done)
        if best is not None and _together(state, seen, done, best[0]):
            seen = None
            continue
        if best is not None and _is_shape_of_another(best[0].effect, state.members, state.after, best[0].values):
            state.useless.add(best[0].effect.key)  # nor would it be another's in fewer directions
            continue
        after = shaped(state.after, best[0]) if best else None
        hidden = _behind_noise(state, after)
        if hidden is not None:
            state.joined(*hidden)
            seen = None
            state.progress(f"found {newest(state.after).key}, taken for noise before")
            continue
        if best is None or after is None:
            slow = _slow(state)
            if slow is None:
                break
            state.joined(*slow)
            seen = None
            state.progress(f"found {newest(state.after).key}, taken for slow noise before")
            continue
        trial, log_p = best
        if not _nearer(after, state.after) or _is_shape_of_another(newest(after), state.members, after, after.named):
            state.useless.add(trial.effect.key)
            continue
        state.joined(after, log_p, trial.looks)
        seen = None
        state.progress(f"found {trial.effect.key}")
        _prune(state, state.members[:-1])
    state.after = with_families(state.after)


def _together(state: State, seen: Survey, done: _Trials, single: Trial) -> bool:
    """Let one kind of effect join on all axes at once where the readings ask for that rather than for the best `single` one:
    parts of one kind wear on all axes, and found alone each leaves the others' share as noise. What is needless is dropped."""
    if state.members:
        return False
    limit = float(np.log(state.level / seen.looks))
    open_ = [s for s in seen.scores if state.open(s) and s.effect.axis is not None and s.effect.id != "unknown"]
    kinds: dict[str, dict[str, Score]] = {s.effect.id: {} for s in open_ if s.log_p < limit}
    for score in sorted(open_, key=lambda s: s.log_p):
        if score.effect.id in kinds:
            kinds[score.effect.id].setdefault(str(score.effect.axis), score)
    tries = (tried_together(state.after, done.base or 0.0, scores, state.forms) for scores in kinds.values())
    best = max((t for t in tries if t is not None), key=lambda t: t.evidence, default=None)
    if best is None or best.evidence < single.evidence + DECISIVE:
        return False
    state.progress(f"found {', '.join(score.effect.key for score in best.scores)} together")
    state.after = refitted(Model(state.campaign, (*state.after.model.added, *best.effects)), best.values, state.after)
    for score in best.scores:  # each in the best of its shapes, beside the others
        without = lacking(state.after, score.effect)
        after = shaped(without, Trial(score.effect, 0.0, state.after.named, 0.0, score.looks))
        state.joined(after, min(score.log_p, 0.0), score.looks)
    state.together = len(state.members)
    _prune(state, state.members)
    return True


@dataclass
class _Trials:
    """Exact refits made with one fit: its own log evidence, and by effect its plain shape and the best of all its shapes."""

    base: float | None = None
    plain: dict[str, Trial | None] = field(default_factory=dict)
    shaped: dict[str, Trial] = field(default_factory=dict)


def _is_shape_of_another(
    effect: Effect, members: Sequence[Member], fit: Identification, values: Mapping[str, float]
) -> bool:
    """Whether it is a term without a name that only changes the shape of a named one. Then the rest of the named one's family
    takes its place."""
    named = [m.effect for m in members if m.effect.id != "unknown"]
    return isinstance(effect, Unknown) and any(reshapes(effect, e, fit.model.machine, values) for e in named)


def _nearer(after: Identification, before: Identification) -> bool:
    """Whether a fit comes nearer to the readings, but for those that both take for outliers; one that does not helps only the
    noise model."""
    problems = [after.problem(), before.problem()]
    left = [0.0, 0.0]
    for run in after.model.campaign.runs:
        kept = ~(problems[0].left_out[run.id] & problems[1].left_out[run.id])
        noise = after.model.noise(run)
        for k, fit in enumerate((after, before)):
            left[k] += float(np.sum((fit.residuals[run.id] / noise)[kept] ** 2))
    return left[0] < left[1]


def _behind_noise(state: State, first: Identification | None) -> tuple[Identification, float] | None:
    """A name, cycle or burst, with its log p, that goes before the `first` one found, if any: where the noise is large without
    a name, or still with it, the noise may have swallowed what the readings really hold."""
    named = first is not None and newest(first).id != "unknown"
    if len(state.members) > state.together or not large_noise(state.after):
        return None
    if first is not None and named and not large_noise(first):
        return None
    seen = survey(whitened(state.after), state.exclude)
    still = [s for s in seen.scores if state.open(s)]
    names = [s for s in still if s.effect.id != "unknown" and not changes_slowly(s.effect)]
    candidates = sorted(names, key=lambda s: s.log_p)[:TRIALS]
    candidates += [s for s in still if isinstance(s.effect, Unknown) and (s.effect.period or s.effect.only_within)]
    for score in candidates:
        state.meet(score)
    return name_or_noise(state.after, candidates, len(names), first, state.forms, state.level, state.progress)


def _slow(state: State) -> tuple[Identification, float] | None:
    """An effect over time that was taken for noise, with its log p."""
    if not slow_noise(state.after, state.level):
        return None
    scores = _scores_over_time(state)
    named = [s for s in scores if s.effect.id != "unknown"]
    candidates = [*_best_of(named), *(s for s in scores if s.effect.id == "unknown")]
    for score in candidates:
        state.meet(score)
    return physics_or_noise(state.after, candidates, len(named), state.level, state.progress)


def _drifting(state: State) -> None:
    """What is left as noise slower and larger than hardly any instrument's is a drift, in place of any without a name that was
    found and left it; a name that it gets is put to the test."""
    share = log_share(state.after, state.level)
    if share > np.log(state.level):
        return
    for member in tuple(m for m in state.members if m.effect.id == "unknown" and changes_slowly(m.effect)):
        _leave(state, member, lacking(state.after, member.effect))
    scores = _scores_over_time(state)
    nameless = [s for s in scores if s.effect.id == "unknown"]
    named = _best_of([s for s in scores if s.effect.id != "unknown"])
    after = drift(state.after, [*named, *nameless], state.forms, state.level, state.progress)
    if after is None:
        return
    for score in named:
        state.meet(score)
    state.joined(after, share)
    state.progress(f"found {newest(after).key}, too slow and too large for noise")
    if newest(after).id != "unknown":
        _contest(state)


def _scores_over_time(state: State) -> list[Score]:
    """Effects over time as they score where none of the noise is slow."""
    return [
        s for s in survey(whitened(state.after), state.exclude).scores if changes_slowly(s.effect) and state.open(s)
    ]


def _contest(state: State) -> bool:
    """Put every member to the test against all that could stand in its place; True where one was replaced. What only a scan finds
    takes part as it was met on the way.

    Under the noise of the full fit, with all other members in the model, the evidence is sharper than it was when the
    member was found.
    """
    swapped = False
    for number, member in enumerate(state.members):
        state.progress(f"rivals of {member.effect.key}")
        without = lacking(state.after, member.effect)
        scores = [s for s in survey(without, state.exclude, scanning=False).scores if s.effect.key != member.effect.key]
        others = [m for m in state.members if m is not member]
        scores = [s for s in scores if not _is_shape_of_another(s.effect, others, without, without.named)]
        close = {s.effect.key: s for s in kin(state, without, [member]) if s.effect.key != member.effect.key}
        rivals = state.near({s.effect.key for s in scores}) | close | {s.effect.key: s for s in _best_of(scores)}
        base = evidence_of(without.problem(), without.values)
        found = [t for t in (tried(without, base, s, state.forms) for s in rivals.values()) if t is not None]
        own = tried(
            without, base, _own_score(state.after, member), state.forms, near=_known(without, state.after, member)
        )
        if own is None:
            continue
        simple = _simpler_trials(state, without, base, member)
        first = (simple or [own])[0].evidence
        least = min(own.evidence, first - max(OPEN, OPEN_SHARE * first))
        found = [
            best_shape(without, base, t, state.forms) if t.evidence > least or t.effect.key in close else t
            for t in found
        ]
        enough = [t for t in simple if t.misfit < own.misfit + 2.0 * DECISIVE]  # also without the rest of its family
        mine = max([*enough, own], key=lambda t: t.evidence + TIE * (t is own))
        stays, (mine, *found) = mine is own, levelled(state.campaign, [mine, *found])
        trials = sorted([mine, *found], key=lambda t: -t.evidence)
        state.members[number] = replace(member, trials=tuple(trials))
        best = _most_probable(trials, mine)
        if not (stays and best is mine):
            state.after = shaped(without, best)
            state.members[number] = Member(newest(state.after), member.log_p, best.looks, tuple(trials))
            state.progress(f"{best.effect.key} takes the place of {member.effect.key}")
            swapped = True
    return swapped


def _most_probable(trials: Sequence[Trial], own: Trial) -> Trial:
    """The best form of the most probable name, all its forms together; `own` unless another is better beyond rounding."""
    names: dict[tuple[str, str | None], list[Trial]] = {}
    for trial in trials:
        names.setdefault((trial.effect.vocabulary, axis_of(trial.effect)), []).append(trial)

    def total(forms: Sequence[Trial]) -> float:
        evidence = [t.evidence for t in forms]
        return float(max(evidence) if forms[0].effect.id == "unknown" else np.logaddexp.reduce(evidence))

    mine = next(forms for forms in names.values() if own in forms)
    best = max(names.values(), key=total)
    if total(best) <= total(mine) + TIE:
        best = mine
    first = max(best, key=lambda t: t.evidence)
    return own if own in best and first.evidence <= own.evidence + TIE else first


def _simpler_trials(state: State, without: Identification, base: float, member: Member) -> list[Trial]:
    """A member in its plain shape, to which its rivals in theirs compare, and in others that do without what it may have needed
    when less was found."""
    trials = []
    for effect in (e.prepare(state.campaign) for e in simpler(member.effect)):
        step = {p.name: 0.0 for p in effect.parameters(state.campaign)}
        trials.append(tried(without, base, Score.unscored(effect, step, member.looks), state.forms))
    return [t for t in trials if t is not None]


def _best_of(scores: Sequence[Score]) -> list[Score]:
    """Those that promise most, by what they take off the cost and by what they take off for their freedom: the best forms, and
    the best form of each of the best names, which the many forms of one name would crowd out."""
    named = [s for s in scores if s.effect.id != "unknown"]
    by_drop, by_chance = sorted(named, key=lambda s: -s.drop)[:TRIALS], sorted(named, key=lambda s: s.log_p)
    names: dict[tuple[str, str | None], Score] = {}
    for score in by_chance:
        names.setdefault((score.effect.vocabulary, axis_of(score.effect)), score)
    chosen = [s for group in (by_chance, [*names.values()]) for s in _first(group)]
    nameless = [s for s in scores if s.effect.id == "unknown"]
    terms = [*sorted(nameless, key=lambda s: -s.drop)[:2], *sorted(nameless, key=lambda s: s.log_p)[:1]]
    return list({s.effect.key: s for s in (*chosen, *by_drop, *terms)}.values())


def _first(ranked: Sequence[Score]) -> Sequence[Score]:
    """The first few of them, more where their scores are nearly equal."""
    close = [s for s in ranked[:MOST_TRIALS] if s.log_p < ranked[0].log_p + OPEN]
    return ranked[: max(TRIALS, len(close))]


def _known(without: Identification, after: Identification, member: Member) -> dict[str, float]:
    """The final fit's values of all that is in the model with a member alone: where its own refit ends anyway."""
    own = {p.name for p in member.effect.parameters(after.model.campaign)}
    starts = {p.name for run in after.model.campaign.runs for p in member.effect.starts(run)}
    return {n: v for n, v in after.named.items() if n in without.model.index or n in own | starts}


def _own_score(result: Identification, member: Member) -> Score:
    """A member as a candidate again, starting from what the fit found for it."""
    step = {p.name: result[p.name] - p.mean for p in member.effect.parameters(result.model.campaign)}
    return Score.unscored(member.effect, step, member.looks)


def _best(state: State, seen: Survey, done: _Trials) -> tuple[Trial, float] | None:
    """The effect with the greatest evidence among those that are significant and material, by exact refits. `done`: those of the
    present fit that were made before."""
    limit = float(np.log(state.level / seen.looks))
    significant = [s for s in seen.scores if s.log_p < limit and state.open(s)]
    if significant and done.base is None:
        done.base = evidence_of(state.after.problem(), state.after.values)
    trials = []
    for s in _best_of(significant):
        if s.effect.key not in done.plain:
            state.progress(f"trying {s.effect.key}")
            state.meet(s)
            done.plain[s.effect.key] = tried(state.after, done.base or 0.0, s, state.forms)
        trial = done.plain[s.effect.key]
        if trial is not None and trial.size > MATERIAL**2:
            trials.append(trial)
    if not trials:
        return None
    best = max(trials, key=lambda t: t.evidence)
    if best.effect.id == "unknown":  # no name is given up before its other shapes were tried
        named = [t for t in trials if t.effect.id != "unknown"]
        for t in named:
            if t.effect.key not in done.shaped:
                done.shaped[t.effect.key] = best_shape(state.after, done.base or 0.0, t, state.forms)
        best = max([best, *(done.shaped[t.effect.key] for t in named)], key=lambda t: t.evidence)
    log_p = next(s.log_p for s in significant if s.effect.key == best.effect.key) + float(np.log(seen.looks))
    return best, min(log_p, 0.0)


def _prune(state: State, members: Sequence[Member]) -> None:
    """Drop effects that others have made needless."""
    for member in tuple(members):
        without = lacking(state.after, member.effect)
        own = () if member.effect.id == "unknown" else amplitudes(state.campaign, member.effect)
        full = evidence_of(state.after.problem(), state.after.values, own)
        if full - evidence_of(without.problem(), without.values) < 3.0:
            _leave(state, member, without)
            state.dropped.add(member.effect.key)


def _withdraw(state: State) -> None:
    """Take out what the final fit leaves no size (2σ from none), the least certain first: the refit without it stands."""
    while state.members:
        held = {e.key: e for e in state.after.model.added}
        chances = [log_chance_of_nothing(state.after, held[m.effect.key]) for m in state.members]
        worst = int(np.argmax(chances))
        if chances[worst] < log_tail(SAME, 1.0):
            return
        member = state.members[worst]
        state.withdrawn.append((held[member.effect.key], state.after))
        _leave(state, member, lacking(state.after, member.effect))
        state.after = settled(state.after)
        state.progress(f"{member.effect.key} has no size")


def _leave(state: State, member: Member, without: Identification) -> None:
    """Take a member out; `without` is the fit that lacks it, its noise as it was."""
    state.after = refitted(without.model, without.named, without)
    state.members = [m for m in state.members if m.effect.key != member.effect.key]
