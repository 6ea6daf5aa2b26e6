"""Log evidence of a subset of terms, from moments.

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
from functools import cached_property

import numpy as np
from scipy.special import log_ndtr

from symfive.arrays import Array, Indices
from symfive.posterior._eliminate import eliminated_rows
from symfive.posterior._moments import Moments
from symfive.posterior._scale import least, solved

__all__ = [
    "SHARE", "Blocks", "Equations", "LogEvidence", "Selected", "Turned", "added", "beside", "bounded", "discrepancies",
    "equations", "evidence_of", "explained", "log_evidence", "solution",
]  # fmt: skip

Selected = tuple[int, float]
"""A term of a subset: its number, and the width of its amplitudes' prior in units of its usual one."""
Blocks = tuple[tuple[int, float], ...]
"""Discrepancies: unidentified terms, each with the 1σ of its coefficients in units of its usual one."""
SHARE = 0.3
"""1σ of a discrepancy as a share of its term: a form of the library is right to a third, or it is another form."""
PLAIN = 1e10
"""Trace of H up to which its rounding, 1e-16 of it, is nothing beside the prior's 1."""


@dataclass(frozen=True)
class LogEvidence:
    """Log evidence of a subset by noise node (J,), node priors included, and the noise `scales` κ² (J,)."""

    by_node: Array
    scales: Array

    @cached_property
    def total(self) -> float:
        """Log evidence marginalised over the noise nodes."""
        return float(np.logaddexp.reduce(self.by_node))

    @cached_property
    def node(self) -> int:
        """Index of the most probable noise node."""
        return int(np.argmax(self.by_node))

    @property
    def kappa2(self) -> float:
        """The noise scale κ² at the most probable node."""
        return float(self.scales[self.node])


@dataclass(frozen=True)
class Equations:
    """The normal equations of a subset in every node: `h` (J, n, n), `g` (J, n), `q` (J,), `d` (n,), of unknowns each of which is
    the `columns` (n,) of the moments times its own column of `turn` (n, n), `lower` (n,) the bounds of what belongs to these, and
    the weights of the columns `aim` that make the residual less the exact contributions of terms that are held."""

    columns: Indices
    turn: Array
    lower: Array
    d: Array
    h: Array
    g: Array
    q: Array
    aim: Indices
    weights: Array

    def weighed(self, nodes: Indices, kappa2: Array) -> tuple[Array, Array]:
        """What x leaves (j,) in some nodes (j,) under a noise scale each, and |x + d|² + log|A| (j,)."""
        a, g, k = self.h[nodes], self.g[nodes], kappa2[:, None]
        x, logdet = solved(a, g - k * self.d, kappa2)
        left = self.q[nodes] + np.sum(x * ((a @ x[..., None])[..., 0] - k * x - 2.0 * g), axis=1)
        return left, np.sum((x + self.d) ** 2, axis=1) + logdet

    def at(self, node: int, kappa2: float) -> Array:
        """x (n,) in one node, in units of the usual prior."""
        a = self.h[node] / kappa2 + np.eye(len(self.d))
        return np.asarray(self.turn @ np.linalg.solve(a, self.g[node] / kappa2 - self.d))

    def within(self, kappa2: Array) -> Array | float:
        """Log of how much more probable bounds are by the readings than by the priors, in every node (J,) under its noise scale:
        of the amplitudes that have one, each by itself."""
        own = np.flatnonzero(self.lower > -np.inf)
        if not len(own):
            return 0.0
        k, turn = kappa2[:, None], self.turn[own]
        half = np.linalg.inv(self.h / k[:, None] + np.eye(len(self.d))) @ turn.T
        x = np.einsum("jki,jk->ji", half, self.g / k - self.d)
        variance = np.einsum("ik,jki->ji", turn, half)
        return np.asarray(bounded(self.lower[own], x, variance, np.sqrt(np.sum(turn**2, axis=1))).sum(axis=1))


def bounded(lower: Array, x: Array, variance: Array, prior: Array | float) -> Array:
    """Log of the mass of N(x, variance) above `lower`, over that of N(0, prior²). Rounding may leave a variance below nothing: no
    amplitude is known better than to the last digit of its prior."""
    spread = np.sqrt(np.maximum(variance, (np.finfo(float).eps * prior) ** 2))
    return np.asarray(log_ndtr((x - lower) / spread) - log_ndtr(-lower / prior))


def equations(moments: Moments, members: Iterable[Selected], blocks: Blocks = ()) -> Equations:
    """Of one subset, with the discrepancies `blocks` of its terms, orthogonal to these: by what its best amplitudes explain a law
    is not off (M. Plumlee 2017)."""
    members = tuple(members)
    moments = moments.about(members)
    target = np.zeros(moments.size)
    target[-1] = 1.0
    columns, scale, departure, lower = [np.zeros(0, dtype=np.int64)], [np.zeros(0)], [np.zeros(0)], [np.zeros(0)]
    for number, width in members:
        own = moments.columns[number]
        columns.append(own.where)
        scale.append(own.scaled(width))
        departure.append(own.departure)
        lower.append(own.lower)
        if own.exact >= 0:
            target[own.exact] -= 1.0
    for number, share in blocks:
        own = moments.columns[number]
        columns.append(own.where)
        scale.append(np.full(len(own.where), share))
        departure.append(np.zeros(len(own.where)))
        lower.append(own.lower)
    where, w = np.concatenate(columns), np.concatenate(scale)
    d, bounds = np.concatenate(departure), np.concatenate(lower)
    aim = np.flatnonzero(target)
    place, size = where[:, None] * moments.size + where, np.outer(w, w)
    h = np.stack([gram.take(place) * size for gram in moments.gram])
    g = moments.gram[:, where[:, None], aim] @ target[aim] * w
    q = moments.gram[:, aim[:, None], aim] @ target[aim] @ target[aim]
    if not blocks:
        return Equations(where, np.diag(w), bounds, d, h, g, q, aim, target[aim])
    apart = _apart(moments, members, blocks, h[0])
    return Equations(where, w[:, None] * apart, bounds, d, apart.T @ h @ apart, g @ apart, q, aim, target[aim])


def _apart(moments: Moments, members: Sequence[Selected], blocks: Blocks, h: Array) -> Array:
    """The matrix (n, n) that takes from the columns of each discrepancy what those of the amplitudes of its laws hold of them, by
    the normal equations `h` (n, n) of white noise, without set-up and geometry."""
    sizes = [moments.columns[number].amplitude for number, _ in members]
    laws = np.repeat([moments.blocks[number] for number, _ in members], [len(own) for own in sizes])
    first, found = len(laws), np.eye(len(h))
    for number, _ in blocks:
        own = np.flatnonzero(np.concatenate(sizes) & (laws == number))
        last = first + len(moments.columns[number].where)
        found[own, first:last] = -np.linalg.lstsq(h[np.ix_(own, own)], h[own, first:last], rcond=None)[0]
        first = last
    return found


def beside(
    moments: Moments, members: Sequence[Selected], columns: Indices, kappa2: float
) -> tuple[Array, Array, Array]:
    """What further `columns` (k,) find beside a subset under a noise scale: the eigenvalues of their information once the subset
    is eliminated, `power` (J, r), their slope (J, r) along its eigenvectors, and what the subset leaves, `left` (J,)."""
    s, moments = equations(moments, members), moments.about(members)
    x = np.linalg.solve(s.h + kappa2 * np.eye(len(s.d)), s.g[:, :, None])[:, :, 0]
    left = s.q + np.einsum("ji,jik,jk->j", x, s.h, x) - 2.0 * np.sum(x * s.g, axis=1)
    if moments.rows is not None:  # there are fewer of them than columns
        own, others = moments.rows[:, :, s.columns] @ (s.turn / kappa2**0.5), moments.rows[:, :, columns]
        rows = np.concatenate([own, others, (moments.rows[:, :, s.aim] @ s.weights)[:, :, None]], axis=2)
        rows, _ = eliminated_rows(rows, len(s.columns), np.zeros(len(s.columns)))
        power, axes = np.linalg.eigh(rows[:, :, :-1] @ np.swapaxes(rows[:, :, :-1], 1, 2))
        power = np.maximum(power, 0.0)
        return power, np.sqrt(power) * np.einsum("jni,jn->ji", axes, rows[:, :, -1]), left
    h = moments.gram[:, columns[:, None], columns]
    g = moments.gram[:, columns[:, None], s.aim] @ s.weights
    cross = s.turn.T @ moments.gram[:, s.columns[:, None], columns]
    taken = np.linalg.solve(s.h + kappa2 * np.eye(len(s.d)), cross)
    power, axes = np.linalg.eigh(h - np.swapaxes(cross, 1, 2) @ taken)
    slope = np.einsum("jki,jk->ji", axes, g - np.einsum("jik,ji->jk", cross, x))
    return np.maximum(power, 0.0), slope, left


def log_evidence(moments: Moments, members: Iterable[Selected], blocks: Blocks = ()) -> LogEvidence:
    """The evidence of one subset, with the discrepancies `blocks` of its terms."""
    return evidence_of(moments, equations(moments, members, blocks))


def evidence_of(moments: Moments, s: Equations) -> LogEvidence:
    """The evidence of the subset whose equations these are."""
    form = Turned.of(s) if np.trace(s.h, axis1=1, axis2=2).max() > PLAIN else s
    cost, kappa2 = least(s.q / moments.count, moments.count, len(s.d), form.weighed)
    return LogEvidence(-0.5 * (cost + moments.const) + moments.log_prior + s.within(kappa2), kappa2)


@dataclass(frozen=True)
class Turned:
    """A subset in every node, turned into the eigenvectors `axes` (J, n, n) of its H: `power` Λ, `g` and `d` (J, n), `q` (J,); no
    component of g is beyond what Cauchy and Schwarz allow, as rounding would have it where H is far larger than the prior's 1."""

    power: Array
    g: Array
    q: Array
    d: Array
    axes: Array

    @classmethod
    def of(cls, s: Equations) -> Turned:
        power, axes = np.linalg.eigh(s.h)
        power = np.maximum(power, 0.0)
        most = np.sqrt(power * np.maximum(s.q, 0.0)[:, None])  # Cauchy and Schwarz; beyond it is rounding
        g = np.clip(np.einsum("jki,jk->ji", axes, s.g), -most, most)
        return cls(power, g, s.q, np.einsum("jki,k->ji", axes, s.d), axes)

    def weighed(self, nodes: Indices, kappa2: Array) -> tuple[Array, Array]:
        """As that of a subset."""
        power, g, d, k = self.power[nodes], self.g[nodes], self.d[nodes], kappa2[:, None]
        x = (g / k - d) / (power / k + 1.0)
        left = self.q[nodes] + np.sum(x * (power * x - 2.0 * g), axis=1)
        return left, np.sum((x + d) ** 2 + np.log(power / k + 1.0), axis=1)


def discrepancies(moments: Moments, members: Sequence[Selected], x: Array) -> Blocks:
    """What the members of a subset whose solution is `x` may be off by: of each named one that does not vary a term over its own
    coordinate, in its own channel, whose prior rms in the readings is `SHARE` of what the member came out as (M. Kennedy & A.
    O'Hagan 2001; one per channel and coordinate, of the largest)."""
    sizes: dict[int, float] = {}
    varied = {moments.terms[t].needs for t, _ in members}
    for (number, _), own_x in zip(members, _by_member(moments, members, x), strict=True):
        block = moments.blocks[number]
        if block >= 0 and moments.terms[number].effect.key not in varied:
            own, other = moments.columns[number], moments.columns[block].where
            a, at = own_x[own.amplitude], own.where[own.amplitude]
            square = float(a @ moments.raw[at[:, None], at] @ a) / float(np.sum(moments.raw[other, other]))
            sizes[block] = max(sizes.get(block, 0.0), SHARE * square**0.5)
    return tuple((number, size) for number, size in sizes.items() if size > 0.0)


def solution(moments: Moments, members: Sequence[Selected], evidence: LogEvidence) -> list[Array]:
    """x of each member under the noise that fits best, in units of its usual prior, amplitudes counted from nothing."""
    return (
        _by_member(moments, members, equations(moments, members).at(evidence.node, evidence.kappa2)) if members else []
    )


def _by_member(moments: Moments, members: Sequence[Selected], x: Array) -> list[Array]:
    ends = np.cumsum([len(moments.columns[t].where) for t, _ in members])
    return np.split(x, ends[:-1])


def explained(moments: Moments, members: Sequence[Selected], evidence: LogEvidence) -> list[float]:
    """The energy of what each member adds to the readings behind set-up and geometry, in units of the noise that fits best."""
    gram = moments.about(members).gram[evidence.node] / evidence.kappa2
    return [float(own @ gram @ own) for own in added(moments, members, evidence)]


def added(moments: Moments, members: Sequence[Selected], evidence: LogEvidence) -> list[Array]:
    """What each member adds to the readings, as factors (m,) of the columns of the moments."""
    found = list[Array]()
    for (number, _), x in zip(members, solution(moments, members, evidence), strict=True):
        own = moments.columns[number]
        found.append(np.zeros(moments.size))
        found[-1][own.where] = x
        if own.exact >= 0:
            found[-1][own.exact] = 1.0
    return found
