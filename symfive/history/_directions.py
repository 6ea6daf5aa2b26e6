"""The combinations of errors that a machine's visits determine, and what each visit reads along them.

The basis U (k, r) is orthonormal in units of the priors. It begins with the eigenvectors of the first visit's information whose
eigenvalue is at least one, and grows where a later visit determines more; it never turns, so that what was said of the past
stays data. Along u a visit with information Λ and score η reads

    y = uᵀ r + uᵀ C (η - Λ r) / g,    g = uᵀ C Λ u,    variance uᵀ C Λ C u / g²,    C = (Λ + 1)⁻¹,

r what the visits before it say together: the prior is moved to where the machine was, so that it draws no reading away from
there. Where g < ½ the visit does not determine u and reads nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.history._information import Information

DETERMINED = 0.5


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
