"""Sweep: the evidence of a subset with each of many further terms, by one elimination of the subset.

One eigen-decomposition H_SS = UΛUᵀ serves all: with P = (Λ/κ² + 1)^(-½)·UᵀH_St/κ² a term's Schur complement is H_tt/κ² + I - PᵀP.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from symfive.arrays import Array
from symfive.posterior._evidence import STEPS, Blocks, Equations, Selected, Turned, equations, evidence_of
from symfive.posterior._moments import Alike, Moments

__all__ = ["WIDTHS", "Sweep", "log_width", "nearest_width", "widths_of"]

WIDTHS = (1.0, 3.0, 10.0, 30.0, 100.0)
"""Prior widths of amplitudes in units of the usual one, half a decade apart: nothing is capped by what machine tools usually
have."""


@cache
def log_width(width: float, widths: tuple[float, ...]) -> float:
    """Log of the prior probability of one of these widths: a half-Cauchy distribution in steps of equal ratio (A. Gelman 2006; N.
    Polson & J. Scott 2012). Large sizes are rare, and none is excluded."""
    weights = [w / (1.0 + w * w) for w in widths]
    return float(np.log(width / (1.0 + width * width) / sum(weights)))


def widths_of(moments: Moments, number: int) -> tuple[float, ...]:
    """Prior widths to try for a term: only the usual one if it departs from a value that the machine file states, or varies
    another effect: neither has a size of its own."""
    term = moments.terms[number]
    return WIDTHS[:1] if term.effect.departs or term.needs else WIDTHS


def nearest_width(size: float, widths: Sequence[float] = WIDTHS) -> float:
    """The prior width nearest to an amplitude in log scale."""
    return min(widths, key=lambda width: abs(np.log(width / max(size, 1e-300))))


@dataclass(frozen=True)
class Sweep:
    """A subset with its `equations` `turned` into their eigenvectors, `cross` (J, m, n) all columns of the moments with these,
    and `slope` (J, m) all columns with what stands for the residual."""

    moments: Moments
    equations: Equations
    turned: Turned
    cross: Array
    slope: Array

    @classmethod
    def of(cls, moments: Moments, members: Sequence[Selected], blocks: Blocks = ()) -> Sweep:
        """Of a subset and its discrepancies."""
        s = equations(moments, members, blocks)
        turned = Turned.of(s)
        cross = np.swapaxes(moments.gram[:, s.columns], 1, 2) @ (s.scale[:, None] * turned.axes)
        return cls(moments, s, turned, cross, moments.gram[:, :, s.aim] @ s.weights)

    def best(self, chosen: Sequence[int]) -> tuple[Array, list[float]]:
        """Log evidence (chosen,) with each of the `chosen` terms (not held) added, and the width of each: the most probable of
        those `_tried` under the noise that suits the subset. What a narrow prior leaves of an amplitude does not say how wide it
        should be."""
        node = evidence_of(self.moments, self.equations).node
        nodes = (self.moments.log_prior - 0.5 * self.moments.const)[:, None]
        found, widths = np.zeros(len(chosen)), np.ones(len(chosen))
        every, odds = np.array(WIDTHS), np.array([[log_width(width, WIDTHS)] for width in WIDTHS])
        for at, own in self._alike(chosen):
            parts = self._parts(own)
            gains, x = self._with_each(parts.under(node), np.where(own.amplitude, every[:, None, None], 1.0))
            gains += odds
            tried = [self._tried(t, x[0, k, own.amplitude[k]]) for k, t in enumerate(own.numbers)]
            gains[[[width not in each for each in tried] for width in WIDTHS]] = -np.inf
            widths[at] = every[np.argmax(gains, axis=0)]
            each, _ = self._with_each(parts, np.where(own.amplitude, widths[at][:, None], 1.0))
            found[at] = np.logaddexp.reduce(nodes + each, axis=0)
        return found, [float(width) for width in widths]

    def _tried(self, number: int, narrow: Array) -> tuple[float, ...]:
        """The widths to try for a term, of which the narrowest leaves amplitudes of such a size. Slopes of which the readings are
        not proportional to the amplitudes say nothing of sizes far from theirs."""
        widths = widths_of(self.moments, number)
        if self.moments.terms[number].form.proportional:
            return widths
        return (nearest_width(float(np.sqrt(np.mean(narrow**2))) if narrow.size else 0.0, widths),)

    def _alike(self, chosen: Sequence[int]) -> Iterator[tuple[list[int], Alike]]:
        """The `chosen` terms of as many columns together, and where they stand there."""
        place = {number: k for k, number in enumerate(chosen)}
        for alike in self.moments.alike:
            rows = [row for row, number in enumerate(alike.numbers) if number in place]
            if rows:
                yield [place[alike.numbers[row]] for row in rows], alike.some(rows)

    def _parts(self, own: Alike) -> _Parts:
        """What the evidence of some terms of as many columns needs."""
        gram, exact, where, turned = self.moments.gram, own.exact, own.where, self.turned
        power, d, base = (part[:, None, :] for part in (turned.power, turned.d, turned.g))
        q, g = np.repeat(self.equations.q[:, None], len(exact), axis=1), self.slope[:, where]
        if exact[0] >= 0:  # the residual is that less what the term adds beyond its slopes
            q = q - 2.0 * self.slope[:, exact] + gram[:, exact, exact]
            g = g - gram[:, where, exact[:, None]]
            base = base - self.cross[:, exact]
        return _Parts(own.departure, own.gram, q, g, np.swapaxes(self.cross[:, where], 2, 3), power, d, base)

    def _with_each(self, parts: _Parts, scale: Array) -> tuple[Array, Array]:
        """Log evidence (J, T), up to the nodes' constants, with each of some terms, these times `scale` (T, n); under one noise
        (W, T), each of them in each of so many scales (W, T, n)."""
        count, q, power, base = self.moments.count, parts.q, parts.power, parts.base
        kappa2 = np.broadcast_to(np.maximum(1.0, q / count), scale.shape[:-1] if scale.ndim > 2 else q.shape)
        for step in range(STEPS):
            # what all scales share is computed once where they have the same noise
            k = (kappa2[:1] if len(q) == 1 and np.all(kappa2 == kappa2[:1]) else kappa2)[..., None]
            shrunk = 1.0 / np.sqrt(power / k + 1.0)
            e = shrunk * (base / k - parts.d)
            p = (shrunk / k)[..., None] * parts.cross
            schur = parts.gram / k[..., None] - np.swapaxes(p, -1, -2) @ p
            slope = parts.g / k - (e[..., None, :] @ p)[..., 0, :]
            a = scale[..., :, None] * schur * scale[..., None, :] + np.eye(schur.shape[-1])
            x = np.linalg.solve(a, (scale * slope - parts.departure)[..., None])[..., 0]
            moved = (scale * x)[..., None]
            y = shrunk * (e - (p @ moved)[..., 0])
            pushed = (parts.gram @ moved)[..., 0] + 2.0 * ((y[..., None, :] @ parts.cross)[..., 0, :] - parts.g)
            left = q + np.sum(y * (power * y - 2.0 * base), axis=-1) + np.sum(moved[..., 0] * pushed, axis=-1)
            if step == STEPS - 1:
                break
            before, kappa2 = kappa2, np.maximum(1.0, left / count)
            if np.array_equal(before, kappa2):
                break
        pull = np.sum((y + parts.d) ** 2, axis=-1) + np.sum((x + parts.departure) ** 2, axis=-1)
        logdet = np.linalg.slogdet(a)[1] - 2.0 * np.log(shrunk).sum(axis=-1)
        return np.asarray(-0.5 * (left / kappa2 + pull + count * np.log(kappa2) + logdet)), np.asarray(x)


@dataclass(frozen=True)
class _Parts:
    """Some terms of as many columns beside a subset: their `departure` (T, n), their `gram` (J, T, n, n), what stands for the
    residual with itself `q` (J, T) and with their columns `g` (J, T, n), the subset's columns with theirs `cross` (J, T, s, n),
    with themselves `power` (J, 1, s), their departure `d` (J, 1, s), and with the residual `base`, (J, T, s) or (J, 1, s)."""

    departure: Array
    gram: Array
    q: Array
    g: Array
    cross: Array
    power: Array
    d: Array
    base: Array

    def under(self, node: int) -> _Parts:
        """The same under one noise node, J = 1."""
        by_node = self.gram, self.q, self.g, self.cross, self.power, self.d, self.base
        return _Parts(self.departure, *(part[node : node + 1] for part in by_node))
