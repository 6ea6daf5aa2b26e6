"""Sweep: the evidence of a subset with each of many further terms, by one elimination of the subset.

One eigen-decomposition H_SS = UΛUᵀ serves all: with C = H_tS·U a term's Schur complement is H_tt + κ² - C(Λ + κ²)⁻¹Cᵀ.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np

from symfive.arrays import Array, Flags, Indices
from symfive.posterior._evidence import Blocks, Equations, Selected, Turned, bounded, equations, evidence_of
from symfive.posterior._moments import Alike, Moments
from symfive.posterior._scale import settled, solved
from symfive.posterior._widths import WIDTHS, log_width, nearest_width

__all__ = ["Sweep", "widths_of"]

CHUNK = 1 << 17
"""Numbers of a table at a time: what is at work stays in the processor's cache."""


def widths_of(moments: Moments, number: int) -> tuple[float, ...]:
    """Prior widths to try for a term: only the usual one if it departs from a value that the machine file states, or varies
    another effect: neither has a size of its own."""
    term = moments.terms[number]
    return WIDTHS[:1] if term.effect.departs or term.needs else WIDTHS


@dataclass(frozen=True)
class Sweep:
    """A subset with its `equations` `turned` into their eigenvectors, and `slope` (J, m) all columns of the moments with what
    stands for the residual."""

    moments: Moments
    equations: Equations
    turned: Turned
    slope: Array

    @classmethod
    def of(cls, moments: Moments, members: Sequence[Selected], blocks: Blocks = ()) -> Sweep:
        """Of a subset and its discrepancies."""
        moments, s = moments.about(members), equations(moments, members, blocks)
        return cls(moments, s, Turned.of(s), moments.gram[:, :, s.aim] @ s.weights)

    def best(self, chosen: Sequence[int]) -> tuple[Array, list[float]]:
        """Log evidence (chosen,) with each of the `chosen` terms (not held) added, and the width of each: the most probable of
        those `_tried` under the noise that suits the subset. What a narrow prior leaves of an amplitude does not say how wide it
        should be."""
        base = evidence_of(self.moments, self.equations)
        nodes = (self.moments.log_prior - 0.5 * self.moments.const)[:, None]
        found, widths = np.zeros(len(chosen)), np.ones(len(chosen))
        for at, own in self._alike(chosen):
            pairs, count = self._pairs(own, base.scales), len(at)
            widths[at] = self._widths(own, pairs.some(slice(base.node * count, (base.node + 1) * count)))
            scale = np.where(own.amplitude, widths[at][:, None], 1.0)
            each, _ = pairs.weighed(np.tile(scale, (len(nodes), 1)), self.moments.count)
            found[at] = np.logaddexp.reduce(nodes + each.reshape(-1, count), axis=0)
        return found, [float(width) for width in widths]

    def _widths(self, own: Alike, pairs: _Pairs) -> Array:
        """The most probable width (T,) of each of some terms, in one node."""
        terms = len(own.numbers)
        scale = np.concatenate([np.where(own.amplitude, width, 1.0) for width in WIDTHS])
        each, x = pairs.some(np.tile(np.arange(terms), len(WIDTHS))).weighed(scale, self.moments.count)
        gains = each.reshape(-1, terms) + [[log_width(width, WIDTHS)] for width in WIDTHS]
        tried = [self._tried(t, x[k, own.amplitude[k]]) for k, t in enumerate(own.numbers)]
        gains[[[width not in each for each in tried] for width in WIDTHS]] = -np.inf
        return np.asarray(np.array(WIDTHS)[np.argmax(gains, axis=0)])

    def _tried(self, number: int, narrow: Array) -> tuple[float, ...]:
        """The widths to try for a term, of which the narrowest leaves amplitudes of such a size. Slopes of which the readings are
        not proportional to the amplitudes say nothing of sizes far from theirs."""
        widths = widths_of(self.moments, number)
        if self.moments.proportional[number]:
            return widths
        return (nearest_width(float(np.sqrt(np.mean(narrow**2))) if narrow.size else 0.0, widths),)

    def _alike(self, chosen: Sequence[int]) -> Iterator[tuple[list[int], Alike]]:
        """The `chosen` terms of as many columns together, and where they stand there."""
        place = {number: k for k, number in enumerate(chosen)}
        for alike in self.moments.alike:
            rows = [row for row, number in enumerate(alike.numbers) if number in place]
            if rows:
                yield [place[alike.numbers[row]] for row in rows], alike.some(rows)

    def _pairs(self, own: Alike, scales: Array) -> _Pairs:
        """Some terms of as many columns in every node, one node after the other, where the subset alone leaves noise of such
        `scales` κ² (J,)."""
        gram, exact, where, s = self.moments.gram, own.exact, own.where, self.equations
        axes = s.turn @ self.turned.axes
        q, g = np.repeat(s.q[:, None], len(exact), axis=1), self.slope[:, where]
        power, d, base = (
            np.repeat(part[:, None], len(exact), axis=1) for part in (self.turned.power, self.turned.d, self.turned.g)
        )
        if exact[0] >= 0:  # the residual is that less what the term adds beyond its slopes
            q = q - 2.0 * self.slope[:, exact] + gram[:, exact, exact]
            g = g - gram[:, where, exact[:, None]]
            base = base - gram[:, exact[:, None], s.columns] @ axes
        cross, at = np.empty((len(gram), where.size, len(s.d))), where.reshape(-1, 1) * self.moments.size + s.columns
        for node, out in enumerate(cross):
            np.matmul(gram[node].take(at), axes[node], out=out)
        cross = cross.reshape(*g.shape, len(s.d))
        departure, lower = (np.broadcast_to(part, g.shape) for part in (own.departure, own.lower))
        start = np.repeat(scales[:, None], len(exact), axis=1)
        bound = np.flatnonzero(s.lower > -np.inf)
        sides = np.repeat((s.turn[bound] @ self.turned.axes)[:, None], len(exact), axis=1)
        limits = np.broadcast_to(s.lower[bound], (*q.shape, len(bound)))
        by_node = departure, lower, sides, limits, own.gram, start, q, g, cross, base, power, d
        return _Pairs(*(part.reshape(q.size, *part.shape[2:]) for part in by_node))


@dataclass(frozen=True)
class _Pairs:
    """Terms of as many columns beside a subset, each in a node: their `departure` and bounds `lower` (P, n), the subset's
    amplitudes that have a bound by its columns, `sides` (P, b, s), and these `limits` (P, b), the terms' `gram` (P, n, n), the
    κ² `start` (P,) without them, what stands for the residual with itself `q` (P,) and with their columns `g` (P, n), these with
    the subset's columns `cross` (P, n, s), and of the latter that with the residual `base`, the `power` and the departure `d`
    (P, s).
    """

    departure: Array
    lower: Array
    sides: Array
    limits: Array
    gram: Array
    start: Array
    q: Array
    g: Array
    cross: Array
    base: Array
    power: Array
    d: Array

    def some(self, rows: Indices | Flags | slice) -> _Pairs:
        """Those in some rows."""
        return _Pairs(*(getattr(self, part.name)[rows] for part in fields(self)))

    def weighed(self, scale: Array, count: int) -> tuple[Array, Array]:
        """Log evidence (P,) with each of the terms times `scale` (P, n) added, up to the nodes' constants, of so many readings,
        and x (P, n) of each."""
        cost, x = np.empty(len(scale)), np.empty(scale.shape)
        rows = max(1, CHUNK // max(1, self.cross[:1].size))
        for first in range(0, len(scale), rows):
            part = slice(first, first + rows)
            pairs = self.some(part)._scaled(scale[part])
            columns = pairs.d.shape[1] + pairs.g.shape[1]
            cost[part], kappa2 = settled(pairs.start, count, columns, partial(pairs._solved, x[part]))
            cost[part] -= 2.0 * pairs._within(x[part], kappa2)
        return -0.5 * cost, x

    def _within(self, x: Array, kappa2: Array) -> Array:
        """Log of how much more probable all bounds are by the readings than by the priors (P,), the terms being x (P, n)."""
        sides, found = self.sides[0], np.zeros(len(x))
        rows = np.flatnonzero((self.lower > -np.inf).any(axis=1) | bool(len(sides)))
        if not len(rows):
            return found
        now, k, x = self.some(rows), kappa2[rows][:, None], x[rows]
        shrunk, cross = 1.0 / (now.power + k), np.swapaxes(now.cross, 1, 2)
        inverse = np.linalg.inv(now.gram - now.cross @ (shrunk[..., None] * cross) + k[:, None] * np.eye(x.shape[1]))
        found[rows] = bounded(now.lower, x, k * np.diagonal(inverse, axis1=1, axis2=2), 1.0).sum(axis=1)
        if len(sides):
            y = shrunk * (now.base - k * now.d - (cross @ x[..., None])[..., 0])
            part = now.sides * shrunk[:, None]
            moved = part @ cross
            variance = k * (np.sum(part * now.sides, axis=2) + np.sum(moved @ inverse * moved, axis=2))
            prior = np.sqrt(np.sum(now.sides**2, axis=2))
            found[rows] += bounded(now.limits, (now.sides @ y[..., None])[..., 0], variance, prior).sum(axis=1)
        return found

    def _scaled(self, scale: Array) -> _Pairs:
        """The same with the terms' columns times a scale (P, n)."""
        gram = self.gram * (scale[:, :, None] * scale[:, None, :])
        return replace(
            self, lower=self.lower / scale, gram=gram, g=self.g * scale, cross=self.cross * scale[:, :, None]
        )

    def _solved(self, found: Array, rows: Indices, kappa2: Array) -> tuple[Array, Array]:
        """What is left (p,) in some rows (p,) under a noise scale each, and |x + d|² + log|A| (p,) of all columns; x of the term
        is written into these rows of `found`."""
        now, k = self if len(rows) == len(self.q) else self.some(rows), kappa2[:, None]
        shrunk, pushed = 1.0 / (now.power + k), now.base - k * now.d
        part = shrunk[:, None, :] * now.cross
        schur = now.gram - part @ np.swapaxes(now.cross, 1, 2)
        slope = now.g - (part @ pushed[..., None])[..., 0]
        x, logdet = solved(schur, slope - k * now.departure, kappa2)
        found[rows] = x
        y = shrunk * (pushed - (x[:, None] @ now.cross)[:, 0])
        turned = (now.gram @ x[..., None] + 2.0 * (now.cross @ y[..., None]))[..., 0] - 2.0 * now.g
        left = now.q + np.sum(y * (now.power * y - 2.0 * now.base), axis=1) + np.sum(x * turned, axis=1)
        pull = np.sum((y + now.d) ** 2, axis=1) + np.sum((x + now.departure) ** 2, axis=1)
        return left, pull + logdet - np.log(shrunk * k).sum(axis=1)
