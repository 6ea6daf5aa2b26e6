"""How much a machine's forecasts usually err: a hierarchical estimate of the covariance, from a few visits on.

The standardised errors x (r,) of a visit's forecast have the readings' stated covariance, which is 1, and whatever the
machine does from visit to visit. Two layers give its prior:

    errors of one kind scatter alike   Ψ = 1 + D^-½ Uᵀ diag(q) U D^-½,  q = a² for lengths, b² for angles, in units of the priors
    this machine differs from that     Σ | Ψ ~ inverse Wishart, so that x ~ t_d(0, Ψ) before the first visit,

D (r, r) the readings' variances, U (k, r) the directions. a and b have equal chances by octaves from the prior's 1σ
downwards, d by octaves of four and without end (Σ = Ψ). After n visits with S = Σ x xᵀ an inverse Wishart is conjugate:

    x ~ t_{d+n}(0, (d Ψ̂ + S) / (d + n)),

Ψ̂ the mean over a and b. A scatter counts by how probable it made the visits, a d by how probable it made what each error by
itself seemed to do (A. P. Dawid 1984), so that a machine of alike errors is known after a few visits and another one is
itself. A visit counts with the reading's share of the forecast's variance: where the level was hardly known, x tells nothing
of the scatter.
A. Hannart & P. Naveau 2014, J. Multivariate Anal. 131 (shrinkage in the Gaussian conjugate family, evidence for its weight).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc, gammaln, ndtr, softmax, stdtr

from symfive.arrays import Array, Flags

Indices = NDArray[np.intp]
DEGREES = np.array([1.0, 4.0, 16.0, 64.0])
"""How many visits' worth the likeness of errors of one kind is, beside without end."""
POINTS, WIDEST = 17, 0.75
"""Of the lattice, for each kind, and octaves between them at first: from the prior's 1σ down to 1/4096 of it."""
LEAST = 1e-300
NEAR = 2.0
"""σ below which the mean covariance stands for the mixture over the scatters."""
IMPROBABLE = 1e-6
"""A combination less probable than this, beside the most probable one, is given up: far below any limit of an alarm."""
SAME = 0.25
"""Octaves within which readings' variances are the same: an eighth of an octave of the standard deviation."""


@dataclass(frozen=True)
class Predictive:
    """The distributions of x before each of m visits: of c scatters, `grid` (m, c) probable, with covariances
    1 + Σ `squares` (c, kinds) · `kinds` (m, kinds, r, r); and of finite degrees, Student's t with `degrees` (m, d) and `scales`
    (m, d, r, r). `seen` (m, r) which directions were read; `likely` (m, r, r) the mean covariance of the scatters,
    `inverse` (m, r, r) that of a mean `scale` of all, by which directions are combined;
    `distances` (m, c) of x for each scatter. `weights` (m, d + 1) below are of the degrees, those without end last."""

    grid: Array
    squares: Array
    kinds: Array
    degrees: Array
    scales: Array
    seen: Flags
    likely: Array
    scale: Array
    inverse: Array
    distances: Array

    def of(self, visit: int) -> Predictive:
        """That of one visit."""
        own = {
            field.name: value if field.name == "squares" else value[visit : visit + 1]
            for field in fields(self)
            for value in [getattr(self, field.name)]
        }
        return Predictive(**own)

    def chance(self, combined: Array, value: Array, weights: Array) -> Array:
        """The chance (m, q) that combinations h·x of `combined` (m, q, r) are as large as `value` (m, q) either way."""
        size = np.abs(value)
        tails = 2.0 * stdtr(self.degrees[:, None], -size[..., None] / self._size(combined, self.scales))
        normal = 2.0 * ndtr(-size / self._size(combined, self.likely[:, None])[..., 0])
        m, q = np.nonzero(normal < 2.0 * ndtr(-NEAR))
        far = combined[m, q]
        excess = ((self.kinds[m] @ far[:, None, :, None])[..., 0] * far[:, None]).sum(axis=2)
        each = np.sqrt(np.maximum((far**2).sum(axis=1)[:, None] + excess @ self.squares.T, LEAST))
        normal[m, q] = (2.0 * ndtr(-size[m, q, None] / each) * self.grid[m]).sum(axis=1)
        return np.asarray((weights[:, None, :-1] * tails).sum(axis=2) + weights[:, -1:] * normal)

    def densities(self, combined: Array, value: Array) -> Array:
        """Log densities (m, q, d + 1) of such combinations, all about the mean of the scatters: only the degrees differ."""
        n, square = self.degrees[:, None], value[..., None] ** 2
        finite, likely = self._size(combined, self.scales), self._size(combined, self.likely[:, None])
        student = gammaln(0.5 * (n + 1.0)) - gammaln(0.5 * n) - 0.5 * np.log(n * np.pi) - np.log(finite)
        student = student - 0.5 * (n + 1.0) * np.log1p(square / (n * finite**2))
        normal = -0.5 * (square / likely**2 + np.log(2.0 * np.pi)) - np.log(likely)
        return np.concatenate([student, normal], axis=2)

    def together(self, x: Array, weights: Array) -> Array:
        """A chance (m,) that all of x (m, r) are as far from zero: twice the mean of those of each distribution, which holds
        whatever their dependence (V. Vovk & R. Wang 2020, Biometrika 107)."""
        count = np.maximum(self.seen.sum(axis=1), 1)[:, None]
        squares = np.einsum("mi,mdij,mj->md", x, np.linalg.inv(self.scales), x)
        normal = (self.grid * chdtrc(count, self.distances)).sum(axis=1)
        mean = (weights[:, :-1] * fdtrc(count, self.degrees, squares / count)).sum(axis=1) + weights[:, -1] * normal
        return np.asarray(np.minimum(2.0 * mean, 1.0))

    def _size(self, combined: Array, covariance: Array) -> Array:
        """1σ (m, q, d) of combinations (m, q, r) for covariances (m, d, r, r)."""
        square = ((combined[:, None] @ covariance) * combined[:, None]).sum(axis=3)
        return np.asarray(np.sqrt(np.maximum(square.transpose(0, 2, 1), LEAST)))


class Usual:
    """What a machine usually does from visit to visit, along r directions `basis` (k, r); `angular` (k,) which errors are angles.

    `sum` (r, r) and `count` (r,) of the visits used; `squares` (c, kinds) a² and b² of the scatters that are probable yet,
    points of a lattice that is laid finer as they become known; `evidence` (d + 1,) of the degrees.
    """

    def __init__(self, basis: Array, angular: Flags) -> None:
        r = basis.shape[1]
        self.kinds = np.stack([basis[kind].T @ basis[kind] for kind in (~angular, angular) if kind.any()])
        self.sum, self.count, self.evidence = np.zeros((r, r)), np.zeros(r), np.zeros(len(DEGREES) + 1)
        self.reference: Array | None = None  # variances (r,) of the first visit
        self.squares: Array
        self._points: Indices
        self._low, self._step = np.zeros(len(self.kinds)), np.full(len(self.kinds), WIDEST)
        self._lay()

    @property
    def visits(self) -> float:
        """As many visits as were used, of the direction that was read least."""
        return float(self.count.min()) if self.count.size else 0.0

    def excess(self, variance: Array) -> Array:
        """Mean covariance (r, r) of the machine's scatter beyond the readings' stated variances (r,)."""
        nothing = np.zeros((1, len(variance)))
        now = self.updates(nothing, nothing, variance[None]).predictive(np.array([0]), np.array([0]))
        size, axes = np.linalg.eigh(now.scale[0] - np.eye(len(variance)))
        return np.asarray(((axes * np.maximum(size, 0.0)) @ axes.T) * np.sqrt(np.outer(variance, variance)))

    def updates(self, x: Array, weight: Array, variance: Array) -> Updates:
        """The updates by m visits, one after the other: x (m, r), `weight` the reading's share of the forecast's variance, and
        the readings' stated `variance`, infinite where there is none."""
        return Updates(self, x, weight, variance)

    def learn(self, updates: Updates, count: int, evidence: Array) -> None:
        """Learn from the first `count` visits of the updates, which leave this `evidence` (d + 1,) of the degrees."""
        self.sum, self.count, self.evidence = updates.sums[count], updates.counts[count], evidence
        self.reference = updates.first if self.reference is None else self.reference
        weight = updates.scatter_probability(count)
        probable = weight > IMPROBABLE * weight.max()
        points = self._points[probable]
        self.squares, self._points = self.squares[probable], points
        if self._fitted(points):
            self._lay()

    def _lay(self) -> None:
        """All points of the lattice."""
        axes = np.meshgrid(*[np.arange(POINTS)] * len(self.kinds), indexing="ij")
        self._points = np.stack([axis.ravel() for axis in axes], axis=1)
        self.squares = 4.0 ** -(self._low + self._step * self._points)

    def _fitted(self, points: Indices) -> bool:
        """Fit the lattice to its probable points: twice as fine where they fill less than half of it, twice as wide where they
        touch its edge; whether that changed it."""
        changed = False
        for kind in range(len(self.kinds)):
            first, last = int(points[:, kind].min()), int(points[:, kind].max())
            low, step, reach = self._low[kind], self._step[kind], POINTS - 1
            edge = (first == 0 and low > 0.0) or (last == reach and low + reach * step < reach * WIDEST)
            if edge and step < WIDEST:
                step *= 2.0
            elif last - first < reach // 2 - 1:
                step *= 0.5
            else:
                continue
            middle = low + 0.5 * (first + last) * self._step[kind]
            start = round((middle - 0.5 * reach * step) / step) * step
            self._low[kind], self._step[kind] = max(min(start, reach * (WIDEST - step)), 0.0), step
            changed = True
        return changed


class Updates:
    """The m + 1 states that m visits lead to: `sums` (m + 1, r, r) and `counts` (m + 1, r)."""

    def __init__(self, usual: Usual, x: Array, weight: Array, variance: Array) -> None:
        self._usual, self._x, self._seen, self.first = usual, x, np.isfinite(variance), variance[0]
        weight = np.where(self._seen, weight, 0.0)
        share = np.sqrt(weight) * x
        self.sums = _summed(usual.sum, share[:, :, None] * share[:, None])
        self.counts = _summed(usual.count, weight)
        self._kinds, self._alike = _alike(usual.kinds, variance, usual.reference)
        covariance = np.eye(x.shape[1]) + np.einsum("ck,akij->acij", usual.squares, self._kinds)
        self._inverse, self._size = np.linalg.inv(covariance), np.linalg.slogdet(covariance)[1]
        squares = (x[:, :, None] * x[:, None]).reshape(len(x), -1)
        self._distances = self._by_scatter(squares, np.arange(len(x)))

    def scatter_probability(self, state: int) -> Array:
        """How probable each scatter (c,) is at a state, at the readings' variances of the last visit."""
        return np.asarray(softmax(self._scatters(np.array([state]), np.array([len(self._x) - 1]))[0]))

    def predictive(self, states: Indices, visits: Indices) -> Predictive:
        """What is expected of `visits` (n,) from what is known at `states` (n,): the number of visits used before."""
        grid = softmax(self._scatters(states, visits), axis=1)
        kinds = self._kinds[self._alike[visits]]
        likely = np.eye(self._x.shape[1]) + np.einsum("mk,mkij->mij", grid @ self._usual.squares, kinds)  # Ψ̂
        degrees, scales = self._finite(states, visits, likely)
        weights = softmax(self._usual.evidence)
        scale = np.einsum("d,mdij->mij", weights[:-1], scales) + weights[-1] * likely
        return Predictive(
            grid, self._usual.squares, kinds, degrees, scales, self._seen[visits], likely, scale, np.linalg.inv(scale),
            self._distances[visits],
        )  # fmt: skip

    def _scatters(self, states: Indices, visits: Indices) -> Array:
        """Log probability (m, c) of each scatter, but for a constant, from the visits up to each state."""
        least, own = self._own(states, visits)
        distances = self._by_scatter(own.reshape(len(own), -1), visits)
        return np.asarray(-0.5 * (distances + least[:, None] * self._size[self._alike[visits]]))

    def _by_scatter(self, squares: Array, visits: Indices) -> Array:
        """trace(Ψ⁻¹ A) (m, c) of matrices A as `squares` (m, r²), with Ψ as at the visits (m,)."""
        found = np.empty((len(squares), len(self._usual.squares)))
        for alike, inverse in enumerate(self._inverse):
            at = self._alike[visits] == alike
            found[at] = squares[at] @ inverse.reshape(len(inverse), -1).T
        return found

    def _own(self, states: Indices, visits: Indices) -> tuple[Array, Array]:
        """Number of visits (m,) and the sum (m, r, r) of the directions that a visit reads, at a state; directions that were
        read more often count as often as the one that was read least."""
        counts, seen = self.counts[states], self._seen[visits]
        least = np.min(counts, axis=1, where=seen, initial=np.inf)
        least = np.where(np.isfinite(least), least, 0.0)
        root = np.where(seen, np.sqrt(least[:, None] / np.maximum(counts, 1e-12)), 0.0)
        return least, self.sums[states] * root[:, :, None] * root[:, None]

    def _finite(self, states: Indices, visits: Indices, likely: Array) -> tuple[Array, Array]:
        """Degrees (m, d) and scales (m, d, r, r) of Student's t."""
        least, own = self._own(states, visits)
        degrees = DEGREES + least[:, None]
        scales = (DEGREES[:, None, None] * likely[:, None] + own[:, None]) / degrees[..., None, None]
        unseen = ~self._seen[visits][:, None, :, None] & np.eye(self._x.shape[1], dtype=bool)
        return degrees, np.where(unseen, 1.0, scales)


def _alike(kinds: Array, variance: Array, reference: Array | None) -> tuple[Array, Indices]:
    """D^-½ · `kinds` (kinds, r, r) · D^-½ for every set of variances that differs from the `reference` (r,) and the sets
    before it, (a, kinds, r, r), and which of them each visit (m,) has; zero where nothing is read."""
    sets = [] if reference is None else [reference]
    which = np.zeros(len(variance), dtype=np.intp)
    for visit, own in enumerate(variance):
        for number, there in enumerate(sets):
            if np.array_equal(np.isinf(own), np.isinf(there)) and _octaves(own, there) <= SAME:
                which[visit] = number
                break
        else:
            which[visit] = len(sets)
            sets.append(own)
    root = np.array(sets) ** -0.5
    return kinds * root[:, None, :, None] * root[:, None, None, :], which


def _octaves(one: Array, other: Array) -> float:
    """By how many octaves two sets of variances (r,) differ at most, where they are finite."""
    finite = np.isfinite(one) & np.isfinite(other)
    return float(np.abs(np.log2(one[finite] / other[finite])).max(initial=0.0))


def _summed(first: Array, each: Array) -> Array:
    return np.concatenate([first[None], first + np.cumsum(each, axis=0)])
