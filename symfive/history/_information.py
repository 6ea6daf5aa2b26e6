"""What each visit alone says about the machine's errors: its information, without the prior that was fitted with it.

Of a Gaussian posterior with mean x and covariance C under the prior N(m, P) the likelihood of the readings is

    -½ θᵀ Λ θ + ηᵀ θ,    Λ = C⁻¹ - P⁻¹,    η = C⁻¹ x - P⁻¹ m,

with the set-up of the runs marginalised in C. Λ is zero along every combination that the visit could not see, whatever the
prior made of it, so that two visits are never compared there. Lengths are measured by the prior's 1σ throughout: a direction
is determined where its eigenvalue of Λ is at least one, the rule that an identification uses for its rank.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Flags
from symfive.history._visit import Visit
from symfive.history._zero import shifts

FLAT = 1e3
"""1σ that stands for no prior, in the parameter's own 1σ: it outweighs no data."""

ROUNDING = 1e-9
"""Share of the information that rounding may take away in a direction that has none."""


@dataclass(frozen=True)
class Information:
    """What n visits say of k parameters in units of `scale` (k,): `information` (n, k, k), `score` (n, k), `seen` (n, k)
    whether the visit's model had the parameter, `value` and `std` (n, k) in file units, NaN where it had not."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: Array
    information: Array
    score: Array
    seen: Flags
    value: Array
    std: Array

    def estimate(self, which: slice | Sequence[int] = slice(None)) -> tuple[Array, Array]:
        """Maximum a posteriori of a machine that did not change during these visits, and its covariance; scaled units."""
        precision = self.information[which].sum(axis=0) + np.eye(len(self.names))
        covariance = np.linalg.inv(precision)
        return covariance @ self.score[which].sum(axis=0), covariance


def information_of(visits: Sequence[Visit], names: Sequence[str] | None = None) -> Information:
    """The information of visits of one machine about `names` (all that any of them has), from the zero of the first."""
    wanted = tuple(names) if names is not None else tuple(dict.fromkeys(n for v in visits for n in v.names))
    count, k = len(visits), len(wanted)
    place = {name: i for i, name in enumerate(wanted)}
    scale, units = np.ones(k), [""] * k
    for visit in reversed(visits):  # the first visit's scale and unit stay
        for name, prior, std, unit in zip(visit.names, visit.priors, visit.std, visit.units, strict=True):
            if name in place:
                scale[place[name]] = prior if np.isfinite(prior) else FLAT * max(std, 1e-9)
                units[place[name]] = unit
    information, score = np.zeros((count, k, k)), np.zeros((count, k))
    value, std = np.full((count, k), np.nan), np.full((count, k), np.nan)
    groups: dict[tuple[str, ...], list[int]] = {}
    for number, visit in enumerate(visits):
        groups.setdefault(visit.names, []).append(number)
    for own, numbers in groups.items():
        there = [i for i, name in enumerate(own) if name in place]
        where = np.array([place[own[i]] for i in there], dtype=int)
        if not there:
            continue
        some = [visits[number] for number in numbers]
        covariance = np.array([v.covariance for v in some])[:, there][:, :, there] / np.outer(
            scale[where], scale[where]
        )
        shift = np.array([[by.get(own[i], 0.0) for i in there] for by in (shifts(v, visits[0]) for v in some)])
        x = (np.array([v.values for v in some])[:, there] + shift) / scale[where]
        mean = (np.array([v.means for v in some])[:, there] + shift) / scale[where]
        prior = np.array([v.priors for v in some])[:, there] / scale[where]
        weight = np.where(np.isfinite(prior), prior, FLAT) ** -2.0
        precision = _inverse(covariance)
        at = np.array(numbers)
        information[np.ix_(at, where, where)] = _without(precision, weight)
        data = np.einsum("nij,nj->ni", precision, x) - weight * mean
        score[np.ix_(at, where)] = data
        value[np.ix_(at, where)] = x * scale[where]
        std[np.ix_(at, where)] = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)) * scale[where]
    return Information(wanted, tuple(units), scale, information, score, np.isfinite(value), value, std)


def _inverse(covariance: Array) -> Array:
    """The precisions; a parameter that was held has no variance and is known as far as numbers go."""
    floor = 1e-14 * np.eye(covariance.shape[1])
    return np.asarray(np.linalg.inv(covariance + floor))


def _without(precision: Array, weight: Array) -> Array:
    """The precision less the prior's; rounding below zero is zero."""
    own = precision - weight[:, :, None] * np.eye(weight.shape[1])
    own = 0.5 * (own + own.transpose(0, 2, 1))
    slack = ROUNDING * np.trace(own, axis1=1, axis2=2)[:, None, None] * np.eye(weight.shape[1])
    try:
        np.linalg.cholesky(own + slack)
        return own
    except np.linalg.LinAlgError:
        size, axes = np.linalg.eigh(own)
    return np.asarray((axes * np.maximum(size, 0.0)[:, None, :]) @ axes.transpose(0, 2, 1))
