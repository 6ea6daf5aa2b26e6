"""The evidence of a subset of terms, from moments alone.

With the reduced Gram matrix of a noise node, H of the subset's columns times their widths w, g of them with the residual, and q
of the residual with itself,

    A = H/κ² + I,   A·x = g/κ² - d,   log Z_j = -½[left/κ² + |x + d|² + n·log κ² + log|A| + const_j],   left = q - 2x·g + x·H·x,

d the departure of shape parameters from their prior means and κ² = max(1, left/n) the scale of the noise, never below what the
data sheet declares, by a fixed point. Z is the mean over the nodes, weighed by their priors (D. MacKay 1992; evidence with the
noise marginalised).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from symfive.posterior._moments import Columns, Moments

__all__ = [
    "SHARE", "WIDTHS", "Blocks", "Member", "Weighed", "beside", "discrepancies", "explained", "log_evidence",
    "nearest_width", "solution", "sweep", "widths_of",
]  # fmt: skip

Array = NDArray[np.float64]
Member = tuple[int, float]
"""A term of a subset: its number, and the width of its amplitudes' prior in units of its usual one."""
Blocks = tuple[tuple[int, float], ...]
"""Discrepancies: unidentified terms, each with the 1σ of its coefficients in units of its usual one."""
WIDTHS = (1.0, 3.0, 10.0, 30.0, 100.0)
"""A scale-free prior of amplitudes as a mixture, half a decade apart: nothing is capped by what machine tools usually have."""
SHARE = 0.3
"""1σ of a discrepancy as a share of its term: a form of the library is right to a third, or it is another form."""
PLAIN = 1e10
"""Trace of H up to which its rounding, 1e-16 of it, is nothing beside the prior's 1."""
STEPS = 3
"""Of the fixed point for κ², which contracts by the share of the prior in the evidence, 1e-2 or less."""


@dataclass(frozen=True)
class Weighed:
    """Log evidence of a subset, by node (J,) with the nodes' priors, and the noise scale κ² at the best node."""

    by_node: Array
    kappa2: float

    @property
    def total(self) -> float:
        """Over all nodes."""
        return float(logsumexp(self.by_node))

    @property
    def node(self) -> int:
        """The best node."""
        return int(np.argmax(self.by_node))


@dataclass(frozen=True)
class _Subset:
    """The normal equations of a subset in every node: `h` (J, n, n), `g` (J, n), `q` (J,), `d` (n,), `columns` and `scale` (n,),
    and the weights of the columns `aim` that make the residual less the exact contributions of terms that are held."""

    columns: NDArray[np.int64]
    scale: Array
    d: Array
    h: Array
    g: Array
    q: Array
    aim: NDArray[np.int64]
    weights: Array

    def solved(self, kappa2: Array) -> Array:
        """x (J, n) under the noise scales (J,)."""
        return np.asarray(np.linalg.solve(self._a(kappa2), (self.g / kappa2[:, None] - self.d)[..., None])[..., 0])

    def turned(self, x: Array) -> Array:
        """H·x (J, n)."""
        return np.asarray((self.h @ x[..., None])[..., 0])

    def logdet(self, kappa2: Array) -> Array:
        """log|A| (J,)."""
        return np.asarray(2.0 * np.log(np.diagonal(np.linalg.cholesky(self._a(kappa2)), axis1=1, axis2=2)).sum(axis=1))

    def _a(self, kappa2: Array) -> Array:
        return np.asarray(self.h / kappa2[:, None, None] + np.eye(len(self.d)))


def _subset(moments: Moments, members: Iterable[Member], blocks: Blocks = ()) -> _Subset:
    target = np.zeros(moments.size)
    target[-1] = 1.0
    columns, scale, departure = [np.zeros(0, dtype=np.int64)], [np.zeros(0)], [np.zeros(0)]
    for number, width in members:
        own = moments.columns[number]
        columns.append(own.where)
        scale.append(own.scaled(width))
        departure.append(own.departure)
        if own.exact >= 0:
            target[own.exact] -= 1.0
    for number, share in blocks:
        own = moments.columns[number]
        columns.append(own.where)
        scale.append(np.full(len(own.where), share))
        departure.append(np.zeros(len(own.where)))
    where, w, d = np.concatenate(columns), np.concatenate(scale), np.concatenate(departure)
    aim = np.flatnonzero(target)
    h = moments.gram[:, where[:, None], where] * np.outer(w, w)
    g = moments.gram[:, where[:, None], aim] @ target[aim] * w
    q = moments.gram[:, aim[:, None], aim] @ target[aim] @ target[aim]
    return _Subset(where, w, d, h, g, q, aim, target[aim])


def beside(
    moments: Moments, members: Sequence[Member], columns: NDArray[np.int64], kappa2: float
) -> tuple[Array, Array, Array]:
    """What further `columns` (k,) find beside a subset under a noise scale: their information h (J, k, k) and slope g (J, k) once
    the subset is eliminated, and what the subset leaves, `left` (J,)."""
    s = _subset(moments, members)
    h = moments.gram[:, columns[:, None], columns]
    g = moments.gram[:, columns[:, None], s.aim] @ s.weights
    if not len(s.d):
        return h, g, s.q
    cross = moments.gram[:, s.columns[:, None], columns] * s.scale[:, None]
    solved = np.linalg.solve(s.h + kappa2 * np.eye(len(s.d)), np.concatenate([cross, s.g[:, :, None]], axis=2))
    x = solved[:, :, -1]
    left = s.q + np.einsum("ji,jik,jk->j", x, s.h, x) - 2.0 * np.sum(x * s.g, axis=1)
    turned = np.swapaxes(cross, 1, 2)
    return h - turned @ solved[:, :, :-1], g - (turned @ solved[:, :, -1:])[:, :, 0], left


def log_evidence(moments: Moments, members: Iterable[Member], blocks: Blocks = ()) -> Weighed:
    """The evidence of one subset, with the discrepancies `blocks` of its terms."""
    s = _subset(moments, members, blocks)
    form = _Base.of(s) if np.trace(s.h, axis1=1, axis2=2).max() > PLAIN else s
    kappa2 = np.maximum(1.0, s.q / moments.count)
    for step in range(STEPS):
        x = form.solved(kappa2)
        left = s.q + np.sum(x * (form.turned(x) - 2.0 * form.g), axis=1)
        if step < STEPS - 1:
            kappa2 = np.maximum(1.0, left / moments.count)
    pull = np.sum((x + form.d) ** 2, axis=1)
    cost = left / kappa2 + pull + moments.count * np.log(kappa2) + form.logdet(kappa2)
    by_node = -0.5 * (cost + moments.const) + moments.log_prior
    return Weighed(by_node, float(kappa2[np.argmax(by_node)]))


def widths_of(moments: Moments, number: int) -> tuple[float, ...]:
    """The widths that a term may have: the usual one where it frees a quantity of a drive, since no slope holds beyond, and where
    it has no size of its own, as what only varies another."""
    return WIDTHS[:1] if moments.terms[number].frees or moments.terms[number].needs else WIDTHS


def sweep(
    moments: Moments, members: Sequence[Member], chosen: Sequence[int], widths: Sequence[float], blocks: Blocks = ()
) -> tuple[Array, Array]:
    """The evidence of a subset and its `blocks` with each of the `chosen` terms (not held) added in its of the `widths`, and the
    rms of the amplitudes that each then has, in units of its usual ones: (chosen,), (chosen,).

    One eigen-decomposition H_SS = UΛUᵀ serves all: with P = (Λ/κ² + 1)^(-½)·UᵀH_St/κ² a term's Schur complement is
    H_tt/κ² + I - PᵀP.
    """
    s = _subset(moments, members, blocks)
    found, sizes = np.zeros(len(chosen)), np.zeros(len(chosen))
    base = _Base.of(s)
    kinds = [(len(moments.columns[t].where), moments.columns[t].exact >= 0) for t in chosen]
    for kind in sorted(set(kinds)):
        at = [k for k, own in enumerate(kinds) if own == kind]
        own = [moments.columns[chosen[k]] for k in at]
        total, x = _joined(moments, s, base, own, [widths[k] for k in at])
        by_node = total + (moments.log_prior - 0.5 * moments.const)[:, None]
        found[at] = logsumexp(by_node, axis=0)
        node = np.argmax(by_node, axis=0)
        for k, n, c, each in zip(at, node, own, np.swapaxes(x, 0, 1), strict=True):
            sizes[k] = widths[k] * np.sqrt(np.mean(each[n, c.amplitude] ** 2)) if c.amplitude.any() else 0.0
    return found, sizes


def nearest_width(size: float, widths: Sequence[float] = WIDTHS) -> float:
    """The width nearest to a size of amplitudes, by ratio."""
    return min(widths, key=lambda width: abs(np.log(width / max(size, 1e-300))))


@dataclass(frozen=True)
class _Base:
    """A subset in every node, turned into the eigenvectors `axes` (J, n, n) of its H: `power` Λ, `g` and `d` (J, n); no component
    of g is beyond what Cauchy and Schwarz allow, as rounding would have it where H is far larger than the prior's 1."""

    power: Array
    g: Array
    d: Array
    axes: Array

    @classmethod
    def of(cls, s: _Subset) -> _Base:
        power, axes = np.linalg.eigh(s.h)
        power = np.maximum(power, 0.0)
        most = np.sqrt(power * np.maximum(s.q, 0.0)[:, None])  # Cauchy and Schwarz; beyond it is rounding
        g = np.clip(np.einsum("jki,jk->ji", axes, s.g), -most, most)
        return cls(power, g, np.einsum("jki,k->ji", axes, s.d), axes)

    def solved(self, kappa2: Array) -> Array:
        """As that of a subset."""
        k = kappa2[:, None]
        return np.asarray((self.g / k - self.d) / (self.power / k + 1.0))

    def turned(self, x: Array) -> Array:
        """As that of a subset."""
        return self.power * x

    def logdet(self, kappa2: Array) -> Array:
        """As that of a subset."""
        return np.asarray(np.log(self.power / kappa2[:, None] + 1.0).sum(axis=1))


def _joined(
    moments: Moments, s: _Subset, base: _Base, own: Sequence[Columns], widths: Sequence[float]
) -> tuple[Array, Array]:
    """Log evidence (J, T), up to the nodes' constants, with each of some terms of as many columns, and their x (J, T, n)."""
    where = np.stack([c.where for c in own])
    scale = np.stack([c.scaled(width) for c, width in zip(own, widths, strict=True)])
    d = np.stack([c.departure for c in own])
    h = moments.gram[:, where[:, :, None], where[:, None, :]] * scale[:, :, None] * scale[:, None, :]
    g = (moments.gram[:, where[:, :, None], s.aim] @ s.weights) * scale
    cross = (moments.gram[:, where[:, :, None], s.columns] * s.scale) @ base.axes[:, None]
    cross = np.swapaxes(cross, 2, 3) * scale[:, None, :]
    power, g_base, d_base = (part[:, None, :] for part in (base.power, base.g, base.d))
    q = s.q[:, None]
    exact = np.array([c.exact for c in own])
    if exact[0] >= 0:  # the residual is that less what the term adds beyond its slopes
        q = q - 2.0 * (moments.gram[:, exact[:, None], s.aim] @ s.weights) + moments.gram[:, exact, exact]
        g = g - moments.gram[:, where, exact[:, None]] * scale
        g_base = g_base - (moments.gram[:, exact[:, None], s.columns] * s.scale) @ base.axes
    kappa2 = np.broadcast_to(np.maximum(1.0, q / moments.count), (len(s.q), len(own)))
    for step in range(STEPS):
        k = kappa2[..., None]
        shrunk = 1.0 / np.sqrt(power / k + 1.0)
        e = shrunk * (g_base / k - d_base)
        p = shrunk[..., None] * cross / k[..., None]
        a = h / k[..., None] + np.eye(h.shape[-1]) - np.swapaxes(p, -1, -2) @ p
        b = g / k - d - (e[..., None, :] @ p)[..., 0, :]
        x = np.linalg.solve(a, b[..., None])[..., 0]
        y = shrunk * (e - (p @ x[..., None])[..., 0])
        moved = (h @ x[..., None])[..., 0] + 2.0 * (y[..., None, :] @ cross)[..., 0, :]
        left = q + np.sum(y * (power * y - 2.0 * g_base), axis=-1) + np.sum(x * (moved - 2.0 * g), axis=-1)
        if step < STEPS - 1:
            kappa2 = np.maximum(1.0, left / moments.count)
    pull = np.sum((y + d_base) ** 2, axis=-1) + np.sum((x + d) ** 2, axis=-1)
    logdet = np.linalg.slogdet(a)[1] - 2.0 * np.log(shrunk).sum(axis=-1)
    return np.asarray(-0.5 * (left / kappa2 + pull + moments.count * np.log(kappa2) + logdet)), x


def discrepancies(moments: Moments, members: Sequence[Member], weighed: Weighed) -> Blocks:
    """The discrepancy of each named member that does not vary: a term over its own coordinate, in its own channel, whose prior
    rms in the readings is `SHARE` of what the member came out as (M. Kennedy & A. O'Hagan 2001; one per channel and coordinate,
    of the largest)."""
    sizes: dict[int, float] = {}
    varied = {moments.terms[t].needs for t, _ in members}
    for (number, _), x in zip(members, solution(moments, members, weighed), strict=True):
        block = moments.blocks[number]
        if block >= 0 and moments.terms[number].effect.key not in varied:
            own, other = moments.columns[number], moments.columns[block].where
            a, at = x[own.amplitude], own.where[own.amplitude]
            square = float(a @ moments.raw[np.ix_(at, at)] @ a) / float(np.trace(moments.raw[np.ix_(other, other)]))
            sizes[block] = max(sizes.get(block, 0.0), SHARE * square**0.5)
    return tuple((number, size) for number, size in sizes.items() if size > 0.0)


def solution(moments: Moments, members: Sequence[Member], weighed: Weighed) -> list[Array]:
    """x of each member under the noise that fits best, in units of its usual prior, amplitudes counted from nothing."""
    if not members:
        return []
    s = _subset(moments, members)
    node, kappa2 = weighed.node, weighed.kappa2
    x = np.linalg.solve(s.h[node] / kappa2 + np.eye(len(s.d)), s.g[node] / kappa2 - s.d) * s.scale
    ends = np.cumsum([len(moments.columns[t].where) for t, _ in members])
    return np.split(x, ends[:-1])


def explained(moments: Moments, members: Sequence[Member], weighed: Weighed) -> list[float]:
    """The energy of what each member adds to the readings behind set-up and geometry, in units of the noise that fits best."""
    gram, found = moments.gram[weighed.node], list[float]()
    for (number, _), x in zip(members, solution(moments, members, weighed), strict=True):
        own = moments.columns[number]
        added = np.zeros(moments.size)
        added[own.where] = x
        if own.exact >= 0:
            added[own.exact] = 1.0
        found.append(float(added @ gram @ added) / weighed.kappa2)
    return found
