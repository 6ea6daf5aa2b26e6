"""What changed between two visits of a machine, in the directions that both determine.

With Λ₁, Λ₂ the information of the visits and η₁, η₂ their scores, the unknown state θ₁ is eliminated from the likelihood of
θ₁ and θ₂ = θ₁ + δ:

    information of δ:  Λ₁ : Λ₂ = Λ₂ - Λ₂ (Λ₁ + Λ₂)⁺ Λ₂,      score of δ:  η₂ - Λ₂ (Λ₁ + Λ₂)⁺ (η₁ + η₂).

The parallel sum Λ₁ : Λ₂ has as its range the intersection of both ranges (W. N. Anderson & R. J. Duffin 1969): a combination
that one of the visits could not see has no part in the change, whatever the priors made of it there.

A machine with a history scatters from visit to visit by more than its readings explain, and follows its temperature. Both are
learnt (`Scatter`): with the scatter's covariance Σ a visit says (1 + ΛΣ)⁻¹ Λ, and what the temperature explains is subtracted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from scipy.special import gammaincc

from symfive.arrays import Array
from symfive.errors import InputError
from symfive.history._alarms import Cause, causes_of
from symfive.history._information import information_of
from symfive.history._visit import Finding, MachineId, Visit
from symfive.numbers import power_of_ten, with_std
from symfive.screen import aligned

ITSELF = 0.9
"""An error is compared by itself where so much of it lies in the directions that both visits determine."""

SMALL = 1e-6
"""Information, in that of the priors, that stands for none where a sum is inverted."""
UNLIKELY = 0.01
"""A difference that noise makes more often is no change."""
VISIBLE = 5.0
"""σ by which an effect of usual size shows where a test could see it (the rule of the diagnosis' table of what is visible)."""


@dataclass(frozen=True)
class Scatter:
    """What a machine does from visit to visit, of `names`: `covariance` (k, k) beyond the stated one, `slope` (k,) per °C and
    `slope_covariance` (k, k), file units."""

    names: tuple[str, ...]
    covariance: Array
    slope: Array
    slope_covariance: Array

    def of(self, names: Sequence[str], scale: Array) -> tuple[Array, Array, Array]:
        """The three of other names, in units of `scale`; an error that is not in it does not scatter."""
        found, k = [self.names.index(n) if n in self.names else -1 for n in names], len(names)
        here, there = [i for i in range(k) if found[i] >= 0], [i for i in found if i >= 0]
        covariance, slope, spread = np.zeros((k, k)), np.zeros(k), np.zeros((k, k))
        covariance[np.ix_(here, here)] = self.covariance[np.ix_(there, there)]
        spread[np.ix_(here, here)] = self.slope_covariance[np.ix_(there, there)]
        slope[here] = self.slope[there]
        return covariance / np.outer(scale, scale), slope / scale, spread / np.outer(scale, scale)


@dataclass(frozen=True)
class FindingChange:
    """A finding of one date or both; `before` and `after` None where it was not found, `parameters` name → (before, after,
    difference, its 1σ, unit), `hidden` whether the other test could not have seen it."""

    key: str
    words: str
    before: Finding | None
    after: Finding | None
    parameters: dict[str, tuple[float, float, float, float, str]] = field(default_factory=dict)
    hidden: bool = False

    @property
    def says(self) -> str:
        """In one sentence."""
        if self.before is None and self.after is not None:
            again = "; the earlier test could not detect it" if self.hidden else ""
            return f"New: {', '.join(filter(None, (self.words, self.after.size)))}{again}"
        if self.before is not None and self.after is None:
            again = "; the later test cannot detect it" if self.hidden else ""
            return f"Gone: {', '.join(filter(None, (self.words, self.before.size)))}{again}"
        from symfive.effects import finding_words

        effect = (self.after or self.before or Finding(effect="")).effect
        entries = [
            f"{finding_words(effect, name, unit)} {with_std(b, 0.0)} → {with_std(a, 0.0, unit)} ({with_std(d, s, unit)})"
            for name, (b, a, d, s, unit) in self.parameters.items()
        ]
        return f"{self.words[0].upper()}{self.words[1:]}: {', '.join(entries) or 'found in both'}"


@dataclass(frozen=True)
class Change:
    """The change from `first` to `second`: `rank` directions that both determine, `chance` that noise alone differs as much;
    `errors` name → (change, 1σ, unit) of those that both determine, `open` names of which that cannot be said; `causes` the
    fewest errors that explain it, the clearest first; `findings` compared as physics; `scatter_known` whether the machine's
    own scatter and temperature were known and taken into account."""

    first: Visit
    second: Visit
    rank: int
    chance: float
    errors: dict[str, tuple[float, float, str]]
    open: tuple[str, ...]
    causes: tuple[Cause, ...]
    findings: tuple[FindingChange, ...]
    scatter_known: bool = False

    @property
    def changed(self) -> bool:
        """Whether the machine changed by more than the stated uncertainties explain."""
        return self.chance < UNLIKELY

    def to_data(self) -> dict[str, Any]:
        """The change as JSON."""
        return {
            "from": self.first.when, "to": self.second.when, "changed": self.changed, "chance": self.chance, "rank": self.rank,
            "own_scatter": self.scatter_known, "causes": [asdict(cause) for cause in self.causes],
            "errors": {name: {"change": d, "std": s, "unit": u} for name, (d, s, u) in self.errors.items()},
            "not_comparable": list(self.open), "findings": [finding.says for finding in self.findings],
        }  # fmt: skip

    def __str__(self) -> str:
        head = f"From {self.first.date} to {self.second.date}"
        if not self.rank:
            lines = [f"{head}: the two tests determine no common combination of errors, so nothing can be compared."]
        elif self.changed:
            noise, chance = "the usual scatter" if self.scatter_known else "noise", power_of_ten(self.chance)
            chance = chance if chance.startswith(("about", "below")) else f"of {chance}"
            lines = [f"{head}: changed (probability of this by {noise} alone: {chance})."]
            lines += [f"  {cause_words(cause, self.second.machine)}{_shares(cause)}" for cause in self.causes]
            lines += ["  The change of each error, whatever the cause:"]
        else:
            beyond = "the machine's usual scatter" if self.scatter_known else "the uncertainties"
            lines = [f"{head}: no change beyond {beyond} ({self.rank} combinations compared)."]
        said = [(f"  {self.second.machine.said(n)}", with_std(d, s, u)) for n, (d, s, u) in self.errors.items()]
        lines += aligned(said) if said else []
        if self.open:
            names = ", ".join(map(self.second.machine.said, self.open))
            lines.append(f"  Not comparable, because one of the tests does not determine them: {names}.")
        return "\n".join([*lines, *(f"  {finding.says}." for finding in self.findings)])


def cause_words(cause: Cause, machine: MachineId) -> str:
    """A cause with its size; those that cannot be distinguished with `or`."""
    sign = "+" if cause.change >= 0.0 else ""
    return f"{' or '.join(map(machine.said, cause.names[:3]))} {sign}{with_std(cause.change, cause.std, cause.unit)}"


def _shares(cause: Cause) -> str:
    """How probable each of several names is."""
    shares = ", ".join(f"{100 * p:.0f} %" for p in cause.probabilities[:3])
    return f" (these tests do not separate them: {shares})" if len(cause.names) > 1 else ""


def change_between(first: Visit, second: Visit, scatter: Scatter | None = None) -> Change:
    """The change between two visits of one machine, beyond its `scatter` where that is known.

    Raises `InputError` for two machines.
    """
    if first.machine.key != second.machine.key:
        problem = f"{first.machine} and {second.machine} are two machines"
        raise InputError(problem, remedy="compare visits of one")
    names = [name for name in first.names if name in second.names]
    findings = _findings(first, second)
    if not names:
        return Change(first, second, 0, 1.0, {}, (), (), findings)
    data = information_of([first, second], names)
    (one, two), (s1, s2), k = data.information, data.score, len(names)
    if scatter is not None:
        covariance, slope, spread = scatter.of(names, data.scale)
        warm = (first.temperature, second.temperature)
        rise = warm[1] - warm[0] if warm[0] is not None and warm[1] is not None else 0.0
        s2 = s2 - two @ slope * rise
        one, s1 = _blurred(one, s1, covariance)
        two, s2 = _blurred(two, s2, covariance + rise**2 * spread)
    common = two @ np.linalg.inv(one + two + SMALL * np.eye(k))
    information, score = two - common @ two, s2 - common @ (s1 + s2)
    size, axes = np.linalg.eigh(0.5 * (information + information.T))
    size, axes = size[size >= 1.0], axes[:, size >= 1.0]
    x = (axes.T @ score) / np.sqrt(size)  # standard normal while nothing changed
    change = axes @ (x / np.sqrt(size)) * data.scale
    std = np.sqrt((axes**2) @ (1.0 / size)) * data.scale
    share = (axes**2).sum(axis=1)
    chance = float(gammaincc(0.5 * len(size), 0.5 * (x @ x))) if size.size else 1.0
    errors = {
        n: (float(change[i]), float(std[i]), data.units[i]) for i, n in enumerate(names) if share[i] >= ITSELF
    }  # fmt: skip
    unlikely = chance < UNLIKELY
    causes = causes_of(axes * np.sqrt(size), x, len(size), names, data.units, data.scale) if unlikely else ()
    return Change(first, second, len(size), chance, errors, tuple(n for n in names if n not in errors), causes, findings,
                  scatter is not None)  # fmt: skip


def _blurred(information: Array, score: Array, covariance: Array) -> tuple[Array, Array]:
    """What a visit says of the level about which the machine scatters."""
    less = np.linalg.inv(np.eye(len(score)) + information @ covariance)
    return less @ information, less @ score


def _findings(first: Visit, second: Visit) -> tuple[FindingChange, ...]:
    """Findings of two diagnoses, by effect and axis; nothing where one of the visits was not diagnosed."""
    if not (first.diagnosed and second.diagnosed):
        return ()
    before, after = ({f.key: f for f in visit.findings} for visit in (first, second))
    found = []
    for key in dict.fromkeys([*before, *after]):
        b, a = before.get(key), after.get(key)
        words = (a or b).words  # type: ignore[union-attr]
        if b is None or a is None:
            other = first if b is None else second
            hidden = other.visibility.get(key, np.inf) < VISIBLE
            found.append(FindingChange(key, words, b, a, hidden=hidden))
            continue
        parameters = {
            name: (v, w, w - v, float(np.hypot(s, t)), unit)
            for name, (v, s, unit) in b.parameters.items() if name in a.parameters
            for w, t, other_unit in [a.parameters[name]] if other_unit == unit
        }  # fmt: skip
        found.append(FindingChange(key, words, b, a, parameters))
    return tuple(found)
