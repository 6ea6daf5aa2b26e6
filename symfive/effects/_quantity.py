"""Quantities of a report: value, standard deviation and unit, carried over by first-order propagation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from symfive.arrays import Array
from symfive.parameters import Parameter

KNOWN = 0.5
"""Of a direction of amplitudes the readings say more than the prior where they leave less than this share of its variance."""
UNSEEN = 0.3
"""A component with a 1σ of more than this share of the rest is not seen where the others have less than this share of its own."""
Values = Mapping[str, float]
Covariance = Mapping[tuple[str, str], float]
"""By pairs of parameter names, file units; pairs that are left out count as 0, and either order will do."""


@dataclass(frozen=True)
class Quantity:
    """One line of a finding: a number, several numbers or a name; `std` of the same form, None where it is no
    estimate. `aside`: another line says the same to a person."""

    value: float | str | tuple[Any, ...]
    std: float | tuple[Any, ...] | None = None
    unit: str | None = None
    aside: bool = False

    @property
    def said(self) -> Quantity:
        """In the unit in which a person reads it: an angle in degrees."""
        return replace(self.times(180.0 / math.pi), unit="deg") if self.unit == "rad" else self

    def times(self, factor: float) -> Quantity:
        """A number `factor` times as large, its uncertainty too."""
        if isinstance(self.value, (int, float)) and isinstance(self.std, (int, float)):
            return Quantity(factor * self.value, factor * self.std, self.unit)
        return self


def own_quantity(parameter: Parameter, values: Values, covariance: Covariance) -> Quantity:
    """A parameter as it is."""
    variance = _entry(covariance, parameter.name, parameter.name)
    return Quantity(float(values[parameter.name]), math.sqrt(max(variance, 0.0)), parameter.unit)


def propagate(
    function: Callable[[Array], Array | Sequence[float]], names: Sequence[str], values: Values, covariance: Covariance
) -> tuple[Array, Array]:
    """function(values of `names`) (k,) and its standard deviations (k,), to first order (GUM, 5.1.2; central
    differences)."""
    x, matrix = _moments(names, values, covariance)
    steps = 1e-5 * np.maximum(np.abs(x), np.sqrt(np.maximum(np.diag(matrix), 0.0))) + 1e-12
    slopes = [
        (np.asarray(function(x + e)) - np.asarray(function(x - e))) / (2.0 * e.max()) for e in np.diag(steps)
    ]  # fmt: skip
    slope = np.stack(slopes, axis=1)
    variance = np.einsum("ij,jk,ik->i", slope, matrix, slope)
    return np.asarray(function(x), dtype=float), np.sqrt(np.maximum(variance, 0.0))


def propagated(
    function: Callable[[Array], float], names: Sequence[str], unit: str | None, values: Values, covariance: Covariance
) -> Quantity:
    """One number function(values of `names`) in `unit` with its standard deviation, to first order."""
    (value,), (std,) = propagate(lambda p: [function(p)], names, values, covariance)
    return Quantity(float(value), float(std), unit)


def known_part(
    parameters: Sequence[Parameter], values: Values, covariance: Covariance
) -> tuple[dict[str, float], dict[tuple[str, str], float]]:
    """Amplitudes and their covariance in those directions alone of which the readings say more than the prior."""
    names, sigma = [p.name for p in parameters], np.array([p.sigma for p in parameters])
    x, matrix = _moments(names, values, covariance)
    powers, axes = np.linalg.eigh(matrix / np.outer(sigma, sigma))
    known = axes[:, powers < KNOWN]
    part = sigma * (known @ (known.T @ (x / sigma)))
    spread = np.outer(sigma, sigma) * ((known * powers[powers < KNOWN]) @ known.T)
    pairs = {(a, b): float(spread[i, j]) for i, a in enumerate(names) for j, b in enumerate(names)}
    return dict(zip(names, part.tolist(), strict=True)), pairs


def length_spread(
    length: Callable[[Array], float], names: Sequence[str], values: Values, covariance: Covariance
) -> float:
    """1σ of a length of `names` about its value: to first order, or with what components that are not seen may add to it, which
    to first order is nothing, whichever is more.

    The latter from 2n points at √3 σ along the covariance's principal axes (S. Julier & J. Uhlmann 1997, κ = 3 - n).
    """
    _, (first,) = propagate(lambda p: [length(p)], names, values, covariance)
    x, matrix = _moments(names, values, covariance)
    powers, axes = np.linalg.eigh(matrix)
    steps = (axes * np.sqrt(3.0 * np.maximum(powers, 0.0))).T
    centre = length(x)
    far = sum((length(x + e) - centre) ** 2 + (length(x - e) - centre) ** 2 for e in steps)
    return max(float(first), math.sqrt(far / 6.0))


def amplitude_and_phase(
    sine: str, cosine: str, unit: str, values: Values, covariance: Covariance
) -> tuple[Quantity, Quantity]:
    """(A, φ) of A·sin(x + φ) = sine·sin x + cosine·cos x; φ in rad from -π to π."""
    centre = math.atan2(values[cosine], values[sine])

    def polar(p: Array) -> list[float]:
        turned = math.atan2(p[1], p[0]) - centre
        return [math.hypot(p[0], p[1]), centre + math.remainder(turned, 2.0 * math.pi)]

    value, std = propagate(polar, (sine, cosine), values, covariance)
    return Quantity(float(value[0]), float(std[0]), unit), Quantity(float(value[1]), float(min(std[1], math.pi)), "rad")


def seen_length(names: Sequence[str], unit: str, values: Values, covariance: Covariance) -> dict[str, Quantity]:
    """`seen`: the length of the vector of `names` in those directions that the readings determine; nothing where they determine
    all."""
    x, matrix = _moments(names, values, covariance)
    powers, axes = np.linalg.eigh(matrix)
    sigma = np.sqrt(np.maximum(powers, 0.0))
    known = axes[:, sigma < UNSEEN * sigma[-1]]
    part = known @ (known.T @ x)
    length = float(np.linalg.norm(part))
    if length == 0.0 or sigma[-1] < UNSEEN * length:
        return {}
    return {"seen": Quantity(length, math.sqrt(max(float(part @ matrix @ part), 0.0)) / length, unit)}


def length_and_direction(
    names: Sequence[str], unit: str, values: Values, covariance: Covariance
) -> tuple[Quantity, Quantity]:
    """|v| and v/|v| of a vector given by its components; the direction of no length is zero."""

    def length(p: Array) -> float:
        return float(np.linalg.norm(p))

    value, std = propagate(lambda p: p / (length(p) or 1.0), names, values, covariance)
    direction = Quantity(tuple(map(float, value)), tuple(map(float, np.minimum(std, 1.0))), "1")
    size = length(np.array([values[name] for name in names]))
    return Quantity(size, length_spread(length, names, values, covariance), unit), direction


def _moments(names: Sequence[str], values: Values, covariance: Covariance) -> tuple[Array, Array]:
    """The values of `names` (n,) and their covariance (n, n)."""
    matrix = np.array([[_entry(covariance, a, b) for b in names] for a in names])
    return np.array([values[name] for name in names], dtype=float), matrix


def _entry(covariance: Covariance, a: str, b: str) -> float:
    return float(covariance.get((a, b), covariance.get((b, a), 0.0)))
