"""One effect for several, several for one: what joined one after the other need not be what is best together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations

from symfive.diagnose._catalogue import catalogue
from symfive.diagnose._evidence import evidence_of
from symfive.diagnose._locate import Survey
from symfive.diagnose._places import moves_the_same
from symfive.diagnose._refit import DECISIVE, Forms, amplitudes, beforehand, best_shape, lacking, newest, shaped, tried
from symfive.diagnose._scores import Score
from symfive.diagnose._state import Member, State
from symfive.effects import Effect
from symfive.effects.unknown import Unknown
from symfive.identify import Identification

__all__ = ["kin", "merge", "simplify", "spell_out"]

MOST_NAMES = 2
"""In place of a term without a name: what takes more of them is physics that the library lacks."""


def simplify(state: State, first: Survey) -> bool:
    """One term without a name in place of several names, where it explains the readings as well as all of them together. True
    where it was so.

    Physics that the library lacks is often mimicked by a handful of effects; each by itself then has decisive evidence.
    """
    if len(state.members) < 2:
        return False
    state.progress("one unknown against several names")
    bare = lacking(state.after, *(m.effect for m in state.members))
    sized = [group for m in state.members for group in amplitudes(state.campaign, m.effect)]
    full = evidence_of(state.after.problem(), state.after.values, sized)
    nameless = [s for s in first.scores if s.effect.id == "unknown"]
    base = evidence_of(bare.problem(), bare.values)
    likely = sorted(nameless, key=lambda s: -s.drop)[:2]
    trials = [t for t in (tried(bare, base, s, state.forms) for s in likely) if t is not None]
    best = max(trials, key=lambda t: t.evidence, default=None)
    if best is None or best.evidence <= full - base:
        return False
    state.after = shaped(bare, best)
    state.members = [Member(newest(state.after), min(m.log_p for m in state.members))]
    return True


def spell_out(state: State, forward: Callable[[State], None]) -> None:
    """Two names at most, found by `forward`, in place of a term without a name, where they explain the readings as well.

    Over two axes, or two components of one, such a term explains two effects at once, and so goes before each of them. Where
    two such terms are needed, the library lacks something.
    """
    nameless = [m for m in state.members if isinstance(m.effect, Unknown)]
    if len(nameless) != 1 or not _of_places(nameless[0].effect):
        return
    (member,) = nameless
    state.progress(f"names for {member.effect.key}")
    bare = lacking(state.after, member.effect)
    others = [m for m in state.members if m is not member]
    other = replace(
        state, after=bare, members=[*others], dropped=set(state.dropped), useless=set(), added=0,
        most=len(others) + MOST_NAMES, nameless=0,
    )  # fmt: skip
    forward(other)
    found = [m for m in other.members if m not in others]
    if not found or len(other.members) != len(others) + len(found):
        return
    if _together(bare, state.after, [member], state.forms) <= _together(bare, other.after, found, state.forms):
        state.after, state.members = other.after, other.members
        state.progress(f"{' and '.join(m.effect.key for m in found)} in place of {member.effect.key}")


def _of_places(term: Effect) -> bool:
    """Whether a term is one of axis positions or of time alone: no velocity, no way since a reversal, no burst, no cycle."""
    if not isinstance(term, Unknown) or term.only_within or term.period:
        return False
    return all(" " not in coordinate for coordinate in term.over)


def _together(bare: Identification, after: Identification, members: Sequence[Member], forms: Forms) -> float:
    """Log evidence of a fit with members under the noise of the `bare` one without them; every further one has to be decisive."""
    campaign, problem = after.model.campaign, bare.problem(after.model)
    sized = [group for m in members for group in amplitudes(campaign, m.effect)]
    chances = sum(beforehand(campaign, m.effect, m.looks, after.named, forms) for m in members)
    return evidence_of(problem, after.values, sized) + chances - DECISIVE * (len(members) - 1)


def merge(state: State) -> bool:
    """One effect in place of two with a name, where it explains the readings as well in one of its shapes: one that moves the
    same component as one of them, or came near on the way. A sag that comes back by another way is easily read as a sag and a
    play. True where it was so."""
    named = [m for m in state.members if m.effect.id != "unknown"]
    for pair in combinations(named, 2):
        bare = lacking(state.after, *(m.effect for m in pair))
        related = [*(state.near() | {s.effect.key: s for s in kin(state, bare, pair)}).values()]
        if not related:
            continue
        state.progress(f"one effect for {' and '.join(m.effect.key for m in pair)}")
        own = [m.effect for m in pair]  # that one of them will do without the other is not asked here
        base = evidence_of(bare.problem(), bare.values)
        both = _together(bare, state.after, pair, state.forms) - base
        trials = [t for t in (tried(bare, base, s, state.forms) for s in related) if t is not None]
        shapes = [t for t in (best_shape(bare, base, t, state.forms) for t in trials) if t.effect not in own]
        best = max(shapes, key=lambda t: t.evidence, default=None)
        if best is not None and best.evidence > both:
            state.after = shaped(bare, best)
            first = next(i for i, m in enumerate(state.members) if m in pair)
            kept = [m for m in state.members if m not in pair]
            state.members = [*kept[:first], Member(newest(state.after), min(m.log_p for m in pair)), *kept[first:]]
            state.progress(f"{best.effect.key} takes the place of {' and '.join(m.effect.key for m in pair)}")
            return True
    return False


def kin(state: State, bare: Identification, members: Sequence[Member]) -> list[Score]:
    """All of the catalogue that moves the component of one of the members."""
    effects = [e for e in catalogue(state.campaign, bare.model.effects) if e.id not in state.exclude]
    return [
        Score.unscored(e, {p.name: 0.0 for p in e.parameters(state.campaign)}, 1)
        for e in effects
        if any(moves_the_same(e, m.effect) for m in members)
    ]
