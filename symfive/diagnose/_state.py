"""What the search for names holds while it runs."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

from symfive.campaign import Campaign
from symfive.diagnose._refit import Forms, Trial, newest
from symfive.diagnose._scores import Score
from symfive.effects import Effect
from symfive.identify import Identification

__all__ = ["MAX_ADDED", "Member", "State"]

MAX_EFFECTS, MAX_NAMELESS, MAX_ADDED = 5, 2, 10
"""At once; of these without a name (what two of them leave, a third does not explain); and in all, those dropped again too."""


@dataclass(frozen=True)
class Member:
    """An effect found. `log_p` of its score before it joined, corrected for all places looked at; `trials` the exact
    refits of all that could stand in its place, under the noise of the final fit, best first."""

    effect: Effect
    log_p: float
    looks: int = 1
    trials: tuple[Trial, ...] = ()


@dataclass
class State:
    """The search while it runs: the fit `after` all members so far, the names `met` among the best on the way, those `withdrawn`
    again with the fits that held them; `most` members may be, and `nameless` of them without a name; the first `together` joined
    at once."""

    after: Identification
    level: float
    exclude: tuple[str, ...]
    progress: Callable[[str], None]
    forms: Forms
    members: list[Member] = field(default_factory=list)
    dropped: set[str] = field(default_factory=set)
    useless: set[str] = field(default_factory=set)
    added: int = 0
    met: dict[str, Score] = field(default_factory=dict)
    withdrawn: list[tuple[Effect, Identification]] = field(default_factory=list)
    together: int = 0
    most: int = MAX_EFFECTS
    nameless: int = MAX_NAMELESS

    @property
    def campaign(self) -> Campaign:
        return self.after.model.campaign

    def open(self, score: Score) -> bool:
        """Whether an effect may still join: neither `dropped` for good nor `useless` in the present fit."""
        nameless = sum(m.effect.id == "unknown" for m in self.members)
        return score.effect.key not in self.dropped | self.useless and (
            score.effect.id != "unknown" or nameless < self.nameless
        )

    def meet(self, score: Score) -> None:
        """Remember a name that came among the best."""
        if score.effect.id != "unknown":
            self.met.setdefault(score.effect.key, score)

    def near(self, known: Collection[str] = ()) -> dict[str, Score]:
        """What was met on the way and is neither a member nor `known`, by key."""
        held = {m.effect.key for m in self.members}.union(known)
        return {key: score for key, score in self.met.items() if key not in held}

    def joined(self, after: Identification, log_p: float, looks: int = 1) -> None:
        """Take over the fit with one more member."""
        self.after = after
        self.members.append(Member(newest(after), log_p, looks))
        self.added += 1
        self.useless.clear()
