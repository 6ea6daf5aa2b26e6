"""Criteria of a plan, one table. Each is ψ(S), the logarithm of a size of the posterior covariance S.

S (s × s) is the covariance of the parameters of interest, each scaled by its prior 1σ, all others and every set-up error
marginalised. All criteria are homogeneous, ψ(aS) = ψ(S) + log a, and exp(-ψ) is concave in the information (an
information function: F. Pukelsheim, Optimal Design of Experiments, 1993, ch. 5), so that efficiencies compare variances
and one bound serves them all.

    D   (1/s) log det S                 volume of the joint uncertainty
    A   log(tr S / s)                   mean variance
    E   log λmax(S)                     worst combination; smoothed: (1/p) log tr Sᵖ
    V   log mean over the workspace of the variance of the tool centre point (also called I)
    G   log max over the workspace of it; smoothed by a p-mean

Ds is D (or any other) for chosen parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from symfive.arrays import Array
from symfive.errors import InputError

SMOOTHING = 32.0
"""Exponent of the p-means of E and G: at most log(s)/32 away from the maximum."""


class Criterion(Protocol):
    """The contract of a criterion, S (s, s) symmetric positive definite."""

    @property
    def name(self) -> str:
        """Its name in the table."""
        ...

    @property
    def determinant(self) -> bool:
        """Whether it is a determinant, for which exchanges have closed forms."""
        ...

    def value(self, S: Array) -> float:
        """ψ(S)."""
        ...

    def slope(self, S: Array) -> Array:
        """dψ/dS (s, s), positive semidefinite."""
        ...

    def curvature(self, S: Array, changes: Array) -> Array:
        """Second derivative of ψ along `changes` (m, s, s) of S: (m, m)."""
        ...


@dataclass(frozen=True)
class Volume:
    """D: (1/s) log det S; slope S⁻¹/s."""

    name: str = "D"
    determinant: bool = True

    def value(self, S: Array) -> float:
        return float(np.linalg.slogdet(S)[1]) / len(S)

    def slope(self, S: Array) -> Array:
        return np.asarray(np.linalg.inv(S) / len(S))

    def curvature(self, S: Array, changes: Array) -> Array:
        half = np.linalg.inv(np.linalg.cholesky(S))
        flat = (half @ changes @ half.T).reshape(len(changes), -1)
        return np.asarray(-(flat @ flat.T) / len(S))


@dataclass(frozen=True)
class Trace:
    """A and V: log⟨W, S⟩ with a fixed weight W."""

    name: str
    weight: Array
    determinant: bool = False

    def value(self, S: Array) -> float:
        return float(np.log(np.sum(self.weight * S)))

    def slope(self, S: Array) -> Array:
        return np.asarray(self.weight / np.sum(self.weight * S))

    def curvature(self, S: Array, changes: Array) -> Array:
        along = np.einsum("kab,ab->k", changes, self.slope(S))
        return np.asarray(-np.outer(along, along))


@dataclass(frozen=True)
class Largest:
    """E: (1/p) log tr Sᵖ; the second derivative of tr Sᵖ by Daleckii & Krein's divided differences."""

    name: str = "E"
    power: float = SMOOTHING
    determinant: bool = False

    def value(self, S: Array) -> float:
        values = np.linalg.eigvalsh(S)
        return float(np.log(values[-1]) + np.log(np.sum((values / values[-1]) ** self.power)) / self.power)

    def slope(self, S: Array) -> Array:
        values, vectors = np.linalg.eigh(S)
        scaled = values / values[-1]
        weights = scaled ** (self.power - 1.0) / (np.sum(scaled**self.power) * values[-1])
        return np.asarray((vectors * weights) @ vectors.T)

    def curvature(self, S: Array, changes: Array) -> Array:
        values, vectors = np.linalg.eigh(S)
        top, p = values[-1], self.power
        x = values / top
        total = np.sum(x**p)
        gap = x[:, None] - x[None, :]
        close = np.abs(gap) < 1e-9
        mean = 0.5 * (x[:, None] + x[None, :])
        first = x ** (p - 1.0)
        divided = np.where(
            close, (p - 1.0) * mean ** (p - 2.0), (first[:, None] - first[None, :]) / np.where(close, 1.0, gap)
        )
        inside = (vectors.T @ changes @ vectors) / top
        flat = inside.reshape(len(changes), -1)
        along = np.einsum("kaa,a->k", inside, first) / total
        return np.asarray((flat * (divided / total).ravel()) @ flat.T - p * np.outer(along, along))


@dataclass(frozen=True)
class Worst:
    """G: (1/p) log Σ uᵢᵖ of the variances uᵢ = ⟨Wᵢ, S⟩ at places of the workspace; weights (places, s, s)."""

    weights: Array
    name: str = "G"
    power: float = SMOOTHING
    determinant: bool = False

    def _variances(self, S: Array) -> Array:
        return np.asarray(np.einsum("kab,ab->k", self.weights, S))

    def value(self, S: Array) -> float:
        u = self._variances(S)
        return float(np.log(u.max()) + np.log(np.mean((u / u.max()) ** self.power)) / self.power)

    def _shares(self, u: Array) -> Array:
        x = u / u.max()
        return np.asarray(x**self.power / np.sum(x**self.power))

    def slope(self, S: Array) -> Array:
        u = self._variances(S)
        return np.asarray(np.einsum("k,kab->ab", self._shares(u) / u, self.weights))

    def curvature(self, S: Array, changes: Array) -> Array:
        u = self._variances(S)
        relative = np.einsum("kab,mab->mk", self.weights, changes) / u
        shares = self._shares(u)
        along = relative @ shares
        return np.asarray((self.power - 1.0) * (relative * shares) @ relative.T - self.power * np.outer(along, along))


def _tool_centre(name: str) -> Callable[[int, Array], Criterion]:
    def make(count: int, places: Array) -> Criterion:
        if places.shape[0] == 0:
            raise InputError(f"criterion {name} needs a workspace", remedy="add [workspace] to the machine file")
        weights = np.einsum("kya,kyb->kab", places, places)
        return Trace("V", weights.mean(axis=0)) if name == "V" else Worst(weights)

    return make


CRITERIA: dict[str, Callable[[int, Array], Criterion]] = {
    "D": lambda count, places: Volume(),
    "A": lambda count, places: Trace("A", np.eye(count) / count),
    "E": lambda count, places: Largest(),
    "V": _tool_centre("V"),
    "G": _tool_centre("G"),
}
"""Each made from the number of parameters and the tool centre point's sensitivities (places, 3, s) to them."""


def criterion_of(name: str, count: int, places: Array) -> Criterion:
    """The criterion of that name (`I` is another word for `V`, `Ds` for `D`). Raises `InputError`."""
    made = CRITERIA.get({"I": "V", "Ds": "D"}.get(name, name))
    if made is None:
        raise InputError(f'criterion "{name}" is unknown', remedy=f"use one of {', '.join(CRITERIA)}")
    return made(count, places)


def name_of(criterion: str | Criterion) -> str:
    """The name of a criterion that is given itself or by its name."""
    return criterion if isinstance(criterion, str) else criterion.name
