"""What each visit alone says about the machine's errors, and what it reads along the combinations that the visits determine.

Of a Gaussian posterior with mean x and covariance C under the prior N(m, P) the likelihood of the readings is

    -½ θᵀ Λ θ + ηᵀ θ,    Λ = C⁻¹ - P⁻¹,    η = C⁻¹ x - P⁻¹ m,

with the set-up of the runs marginalised in C. Λ is zero along every combination that the visit could not see, whatever the
prior made of it, so that two visits are never compared there. Lengths are measured by the prior's 1σ throughout: a direction
is determined where its eigenvalue of Λ is at least one, the rule that an identification uses for its rank.

The basis U (k, r) is orthonormal in units of the priors. It begins with the eigenvectors of the first visit's information whose
eigenvalue is at least one, and grows where a later visit determines more; it never turns, so that what was said of the past
stays data. Along u a visit with information Λ and score η reads

    y = uᵀ r + uᵀ C (η - Λ r) / g,    g = uᵀ C Λ u,    variance uᵀ C Λ C u / g²,    C = (Λ + 1)⁻¹,

r what the visits before it say together: the prior is moved to where the machine was, so that it draws no reading away from
there. Where g < ½ the visit does not determine u and reads nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.history._visit import Visit
from symfive.machine import Structure

FLAT = 1e3
"""1σ that stands for no prior, in the parameter's own 1σ: it outweighs no data."""

ROUNDING = 1e-9
"""Share of the information that rounding may take away in a direction that has none."""
MICRO = 1e3, 1e6
"""µm in a mm, µrad in a rad."""
DETERMINED = 0.5


@dataclass(frozen=True)
class Information:
    """What n visits say of k parameters in units of `scale` (k,): `information` (n, k, k), `score` (n, k), `value` and
    `std` (n, k) in file units, NaN where the visit's model had not the parameter."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: Array
    information: Array
    score: Array
    value: Array
    std: Array


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
        # a parameter that was held has no variance and is known as far as numbers go
        precision = np.asarray(np.linalg.inv(covariance + 1e-14 * np.eye(len(where))))
        at = np.array(numbers)
        information[np.ix_(at, where, where)] = _without(precision, weight)
        data = np.einsum("nij,nj->ni", precision, x) - weight * mean
        score[np.ix_(at, where)] = data
        value[np.ix_(at, where)] = x * scale[where]
        std[np.ix_(at, where)] = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)) * scale[where]
    return Information(wanted, tuple(units), scale, information, score, value, std)


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


def shifts(visit: Visit, zero: Visit) -> dict[str, float]:
    """What to add to the visit's location errors so that they count from the nominal machine of `zero`, control uncorrected.

    Where the nominal origin o of a rotary axis or its direction e moved by the twist ξ = (d, ω) about o, the chain

        Trans(o + P0) R0 Rot(e, s) Trans(-o)

    stays as it is to first order where ξ joins the axis' own location errors (P0, R0) and leaves those of the next rotary axis
    outward, carried over to its origin: P0 -= d + ω × (o_next - o), R0 -= ω. A linear axis takes the tilt of its direction
    and hands nothing on. The last axis hands on to workpiece or tool, which is set-up. To this the control's corrections
    are added: the machine's error is what is left and what was corrected.
    """
    found: dict[str, float] = dict(visit.corrections)
    if visit.nominal == zero.nominal:
        return found
    structure = Structure.parse(zero.machine.structure)
    for side in (tuple(reversed(structure.workpiece)), structure.tool):
        before: tuple[Array, Sequence[float]] | None = None
        for axis in side:
            if axis not in visit.nominal or axis not in zero.nominal:
                continue
            (here, along), (there, nominal) = visit.nominal[axis], zero.nominal[axis]
            turn = np.cross(nominal, along)
            if here is None or there is None:
                _add(found, axis, np.concatenate([np.zeros(3), turn]))
                continue
            own = np.concatenate([np.subtract(here, there), turn])
            handed = np.zeros(6)
            if before is not None:
                twist, place = before
                handed = np.concatenate([twist[:3] + np.cross(twist[3:], np.subtract(there, place)), twist[3:]])
            _add(found, axis, own - handed)
            before = own, there
    return found


def _add(found: dict[str, float], axis: str, own: Array) -> None:
    for letter, value, scale in zip("XYZABC", own, (MICRO[0],) * 3 + (MICRO[1],) * 3, strict=True):
        if abs(value * scale) > 1e-9:
            name = f"E{letter}0{axis}"
            found[name] = found.get(name, 0.0) + float(value * scale)


@dataclass(frozen=True)
class Readings:
    """Along r directions `basis` (k, r) the n visits read `value` (n, r) with `variance` (n, r), NaN where they do not see it;
    `known` (n, k) what the visits before each say together. Scaled units."""

    basis: Array
    value: Array
    variance: Array
    known: Array


def readings_of(data: Information) -> Readings:
    """Basis and readings of a machine's visits in their order."""
    basis, n, k = _basis(data.information), len(data.score), len(data.names)
    total = np.concatenate([np.zeros((1, k, k)), np.cumsum(data.information, axis=0)[:-1]])
    sums = np.concatenate([np.zeros((1, k)), np.cumsum(data.score, axis=0)[:-1]])
    if n:
        total[0], sums[0] = data.information[0], data.score[0]
    known = np.linalg.solve(total + np.eye(k), sums[..., None])[..., 0]
    covariance = np.linalg.inv(data.information + np.eye(k))
    gain = covariance @ data.information
    towards = np.einsum("nij,nj->ni", covariance, data.score - np.einsum("nij,nj->ni", data.information, known))
    share = np.einsum("km,nkl,lm->nm", basis, gain, basis, optimize=True)
    spread = np.einsum("km,nkl,lm->nm", basis, gain @ covariance, basis, optimize=True)
    seen = share >= DETERMINED
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.where(seen, known @ basis + (towards @ basis) / share, np.nan)
        variance = np.where(seen, np.maximum(spread, 1e-24) / share**2, np.nan)
    return Readings(basis, value, variance, known)


def _basis(information: Array) -> Array:
    """The directions of the first visit, and those that later ones add to them."""
    k = information.shape[1]
    basis, begin = np.empty((k, 0)), 0
    while True:
        outside = np.eye(k) - basis @ basis.T
        beyond = np.einsum("ij,njk,ik->n", outside, information[begin:], outside, optimize=True)  # traces
        more = np.flatnonzero(beyond >= 1.0)
        if not more.size:
            return basis
        at = begin + int(more[0])
        size, axes = np.linalg.eigh(outside @ information[at] @ outside)
        new = axes[:, size >= 1.0]
        basis = np.concatenate([basis, _signed(new)], axis=1)
        begin = at + 1


def _signed(axes: Array) -> Array:
    """Each axis with its largest entry positive, as it came first by size."""
    if not axes.size:
        return axes
    largest = np.abs(axes).argmax(axis=0)
    return np.asarray(axes * np.sign(axes[largest, np.arange(axes.shape[1])]))[:, ::-1]
