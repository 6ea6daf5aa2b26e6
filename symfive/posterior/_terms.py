"""Candidate terms of a campaign, as stated by the effects."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from symfive.campaign import Campaign
from symfive.effects import EFFECTS, Effect, Form, Scan, Tone, Varying
from symfive.errors import InputError
from symfive.model import Model
from symfive.parameters import Parameter

__all__ = [
    "UNIDENTIFIED", "Candidates", "Name", "Term", "candidates", "complete", "name_of", "own_parameters", "starts_of", "terms_of",
    "variations_of",
]  # fmt: skip

Name = tuple[str, str | None]
EXPECTED = 0.3
"""Effects that a campaign is expected to lack, all names together: one in three machines that are examined."""
UNIDENTIFIED = float(np.exp(-5.0))
"""Prior odds of an unidentified effect, all together: decisive evidence has to speak for it (H. Jeffreys 1961, appendix B)."""


@dataclass(frozen=True)
class Candidates:
    """All that may be missing in a campaign: `forms` at known places, and `scans` for those that have to be placed; `vary`:
    whether what is found may not be the same everywhere; `sharp`: whether noise may lie between the nodes."""

    forms: tuple[Form, ...]
    scans: tuple[Scan | Tone, ...]
    vary: bool = True
    sharp: bool = False


@dataclass(frozen=True)
class Term:
    """One form that may join: its name, the log of its prior probability, alone and, `again`, beside another one of its name;
    `slot`: of the terms of one slot at most one can act, and a law that varies stays in its own;
    `covers`: the channel and coordinate over which a named one may be a little off, so that no unidentified one acts there too;
    `needs`: the key of the effect of which it is a variation, and which has to be in the subset.
    """

    form: Form
    name: Name
    slot: tuple[object, ...]
    frees: frozenset[tuple[str, str]]
    covers: tuple[str, str]
    log_prior: float
    again: float
    needs: str = ""

    @property
    def effect(self) -> Effect:
        """Its effect."""
        return self.form.effect

    def varies(self, other: Term) -> bool:
        """Whether it is a variation of another one."""
        return bool(self.needs) and not other.needs and self.needs == other.effect.key

    def differs(self, other: Term) -> bool:
        """Whether another term says something else: another name, or another component. Another place of a scan does not."""
        return self.name != other.name or (self.slot != other.slot and not other.form.placed)

    def excludes(self, other: Term) -> bool:
        """Whether the two terms are mutually exclusive."""
        if self.varies(other) or other.varies(self):
            return False
        if self.slot == other.slot or self.frees & other.frees:
            return True
        return self.effect.unidentified != other.effect.unidentified and self.covers == other.covers


def candidates(campaign: Campaign, exclude: Collection[str] = ()) -> Candidates:
    """What every effect of the library states for this campaign, but for those that `exclude` names.

    What does not change from fit to fit, functions and courses along the runs, is kept.
    """
    stated = [draft for name, kind in EFFECTS.items() if name not in exclude for draft in kind.candidates(campaign)]
    forms = [replace(d, basis=cache(d.basis)) if d.basis else d for d in stated if isinstance(d, Form)]
    scans = [
        replace(d, courses=cache(d.courses)) if isinstance(d, Scan) else d for d in stated if not isinstance(d, Form)
    ]
    return Candidates(joinable(campaign, forms), tuple(scans), Varying.id not in exclude)


def variations_of(held: Sequence[Form], campaign: Campaign) -> list[Form]:
    """Variations of the effects that a fit holds, all equally probable."""
    found = list[Form]()
    for form in held:
        ways = Varying.of_effect(form.effect, campaign)
        found += [Form(effect=way, places=len(ways), once=True) for way in ways]
    return found


def complete(terms: Iterable[Term]) -> bool:
    """Whether a subset contains the effect of each of its variations."""
    chosen = list(terms)
    return all(any(term.varies(other) for other in chosen) for term in chosen if term.needs)


def joinable(campaign: Campaign, forms: Sequence[Form]) -> tuple[Form, ...]:
    """The forms that can join the baseline, prepared; of those that are one term to it only the first."""
    held, taken, found = {e.key for e in Model(campaign).effects}, set[tuple[object, ...]](), []
    for form in forms:
        try:
            effect = form.effect.prepare(campaign)
            seen = bool(effect.parameters(campaign)) and any(effect.applies(run) for run in campaign.runs)
        except InputError:
            continue  # the baseline holds it, or the machine lacks what it needs
        what = (effect, *form.at.items()) if form.at else (effect.key,)
        if seen and effect.key not in held and what not in taken:
            taken.add(what)
            found.append(replace(form, effect=effect))
    return tuple(found)


def starts_of(effect: Effect, campaign: Campaign) -> tuple[Parameter, ...]:
    """The states in which an effect begins, of all runs."""
    return tuple(p for run in campaign.runs if effect.applies(run) for p in effect.starts(run))


def own_parameters(effect: Effect, campaign: Campaign) -> tuple[Parameter, ...]:
    """All that joins the model with an effect: its parameters and the states in which it begins."""
    return (*effect.parameters(campaign), *starts_of(effect, campaign))


def name_of(effect: Effect) -> Name:
    """Vocabulary term and axis under which an effect is reported."""
    return effect.vocabulary, None if effect.unidentified else effect.belongs_to


def terms_of(forms: Sequence[Form]) -> tuple[Term, ...]:
    """The forms as terms. A word of the vocabulary has a share of the prior by how common it is, for each axis that has it; its
    forms, whatever their axis, share this alike, each with its places. Once one of them acts, another form of the same name is
    as probable as a further effect is, whatever its name. All unidentified effects but variations, which have their own, have
    the same share of theirs."""
    ways = Counter(form.effect.vocabulary for form in forms if not form.at)
    axes = Counter(word for word, _ in {name_of(form.effect) for form in forms})
    open_ = sum(form.effect.unidentified and not isinstance(form.effect, Varying) for form in forms)
    total = sum({name_of(form.effect): form.effect.rate for form in forms}.values())
    found, there = [], set[str]()
    for form in forms:
        effect, name = form.effect, name_of(form.effect)
        if effect.unidentified:
            prior = 1.0 if form.measured else UNIDENTIFIED / (1 if isinstance(effect, Varying) else open_)
            covers, share = (form.channel, effect.coordinate), prior
        else:
            covers = effect.answers or ("", "")
            share = EXPECTED * axes[name[0]] / max(1, ways[name[0]])
            prior = share * effect.rate / total
        law = effect.of if isinstance(effect, Varying) else effect
        own = (*name_of(law), law.key if form.placed else getattr(law, "component", None) or law.state)
        slot = ("", law.coordinate) if law.unidentified else own
        frees = frozenset(effect.frees())
        needs = effect.key if isinstance(effect, Varying) and effect.key in there else ""
        there.add(effect.key)
        alone, again = np.log([prior / form.places, share / form.places]).tolist()
        found.append(Term(form, name, slot, frees, covers, alone, again, needs))
    return tuple(found)
