"""The certificate: how good a plan is, measured against the best that any plan with as many poses can be.

Column generation: the relaxed design on a growing list of poses gives G; a global search over all poses for the largest
⟨G, F(pose)⟩ gives the Kiefer–Wolfowitz bound (see `_relaxed`) and the pose to add, until bound and value meet.

How rigorous: with two rotary axes (an R-test) and readings that are trigonometric polynomials in them (location errors and
Fourier error motions), ⟨G, F⟩ is one too; its degrees are read off its discrete Fourier transform, and S. Bernstein's
inequality |∂²φ/∂v²| ≤ (Σ dₖ|vₖ|)² max|φ| bounds it in a box, so branch and bound covers every pose. Rounding errors of
double precision apart that is a proof for the plan's own set-ups. Elsewhere (ball bars: four dimensions; polynomial error
motions) it is a dense search with local refinement and no proof; `rigour` says which.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from symfive.design._exchange import Candidates
from symfive.design._information import Task
from symfive.design._refine import Rows
from symfive.design._relaxed import Relaxed, best_told, relax, sensitivity
from symfive.design._space import Space

__all__ = ["Certificate", "certify"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
GAP = 2e-3
ROUNDS = 25
COARSE = 4096
KEPT, FIRST, PATIENCE = 1e-5, 1000, 4
LEAST_WEIGHT = 1.0
TORUS = 48
MARGIN_MM = 2.0
MOST_CELLS = 100_000


@dataclass(frozen=True)
class Certificate:
    """`efficiency` of the plan: at least this share of the best any plan with `points` poses in the same set-ups can reach
    (in variance, per parameter). `anywhere` the same against any set-ups in the workspace (by `_anywhere`, on a grid of
    them; None where it was not asked for). `value` ψ of the plan, `bound` the lowest ψ there is, `relaxed` ψ of the relaxed
    design, `rigour` how sure the bound is, `rounds` of column generation."""

    efficiency: float
    value: float
    bound: float
    relaxed: float
    rigour: str
    rounds: int
    points: int
    anywhere: float | None = None

    @property
    def says(self) -> str:
        """The certificate in one sentence."""
        text = f"≥ {_down(self.efficiency)} of the best any plan with {self.points} poses in these set-ups can do"
        if self.anywhere is not None:
            text += f", and ≥ {_down(self.anywhere)} of the best with any set-ups in the workspace (searched on a grid of them)"
        return text


def _down(share: float) -> str:
    """Three digits, rounded down."""
    return f"{math.floor(share * 1e3) / 1e3:.3f}"


def certify(space: Space, task: Task, rows: Rows, value: float | None = None, gap: float = GAP) -> Certificate:
    """The certificate of a design `rows` with ψ = `value` (of its own rows, if None)."""
    points = len(rows.z)
    setups = np.stack([rows.z[rows.group == g][0, rows.poses :] for g in range(rows.groups)])
    lengths = np.stack([rows.k[rows.group == g][0] for g in range(rows.groups)])
    search = _Search(space, task, setups, lengths)
    own = Candidates(rows.z, rows.k, rows.group, space.kernel.rows(rows.z, rows.k))
    if value is None:
        value = task.value(task.information(own.rows, own.group, rows.groups))
    columns = _joined(own, search.grid.take(np.arange(0, len(search.grid), max(1, len(search.grid) // FIRST))))
    weights = np.concatenate([np.ones(points), np.full(len(columns) - points, 0.1 * points / len(columns))])
    bound, rounds, reached = -math.inf, 0, value
    history: list[float] = []
    for rounds in range(1, ROUNDS + 1):  # noqa: B007
        relaxed = relax(task, columns, rows.groups, points, weights, tolerance=0.5 * gap)
        reached = min(reached, relaxed.value)
        relaxed = replace(relaxed, pull=_extended(task, relaxed, columns, search.grid, rows.groups, points))
        top, fresh = search.largest(relaxed)
        bound = max(bound, _bound(task, relaxed, rows.groups, points, top))
        history.append(bound)
        stalled = len(history) > PATIENCE and bound - history[-1 - PATIENCE] < gap
        if relaxed.value - bound < gap or stalled or not len(fresh):
            break
        kept = relaxed.weights > KEPT * points
        columns = _joined(columns.take(np.flatnonzero(kept)), fresh)
        weights = np.concatenate([relaxed.weights[kept], np.full(len(fresh), 0.02 * points / len(fresh))])
    rigour = "a dense search with local refinement over poses: numerically global, not proved"
    proved = search.proved_largest(relaxed)
    if proved is not None:
        bound = _bound(task, relaxed, rows.groups, points, proved)
        rigour = (
            "branch and bound over all rotary positions with Bernstein's inequality; limits tested at cell centres "
            f"with {MARGIN_MM:g} mm of margin; double precision"
        )
    efficiency = min(1.0, math.exp(bound - value))
    return Certificate(efficiency, value, bound, reached, rigour, rounds, points)


def _extended(task: Task, relaxed: Relaxed, columns: Candidates, grid: Candidates, groups: int, points: int) -> Array:
    """G of the machine's parameters carried to set-up errors: (I, B)ᵀ G (I, B), which bounds for any B (see `_anywhere`).

    At the relaxed design this is G itself; for a set-up that it leaves empty B is taken from the poses that tell most there.
    """
    shared, own = len(task.prior), len(task.own_sigma)
    weight = np.bincount(columns.group, relaxed.weights, groups)
    if own == 0 or weight.min() >= LEAST_WEIGHT:
        return relaxed.pull
    prior = np.diag(task.own_sigma**-2.0)
    machine = relaxed.pull[:shared, :shared]
    carried = [np.eye(shared)]
    for g in range(groups):
        source, mine = (columns, columns.group == g) if weight[g] >= LEAST_WEIGHT else (grid, grid.group == g)
        rows = source.rows[mine]
        weights = relaxed.weights[mine] if source is columns else best_told(machine, rows, prior, points)[2]
        flat = rows.transpose(1, 0, 2).reshape(shared + own, -1)
        gram = (flat * np.repeat(weights, rows.shape[2])) @ flat.T
        carried.append(-np.linalg.solve(gram[shared:, shared:] + prior, gram[shared:, :shared]))
    whole = np.concatenate(carried)
    return np.asarray(whole @ machine @ whole.T)


def _bound(task: Task, relaxed: Relaxed, groups: int, points: int, top: float) -> float:
    return relaxed.value - math.log(float(np.sum(relaxed.pull * task.prior_information(groups))) + points * top)


def _joined(a: Candidates, b: Candidates) -> Candidates:
    return Candidates(*(np.concatenate([getattr(a, n), getattr(b, n)]) for n in ("z", "k", "group", "rows")))


class _Search:
    """The largest ⟨G, F⟩ over the feasible poses of some set-ups."""

    def __init__(self, space: Space, task: Task, setups: Array, lengths: Array) -> None:
        self.space, self.setups, self.lengths = space, setups, lengths
        self.groups = len(setups)
        self.layout = task.layout(self.groups)
        poses = qmc.scale(
            qmc.Sobol(space.poses, seed=1).random(COARSE),
            space.lower[: space.poses],
            space.upper[: space.poses] + 1e-12,
        )
        self.grid = self._candidates(*self._rows(poses))
        self.whole = self.layout.embed(self.grid.rows, self.grid.group)

    def _rows(self, poses: Array) -> tuple[Array, Array, Indices]:
        n = len(poses)
        z = np.concatenate([np.tile(poses, (self.groups, 1)), np.repeat(self.setups, n, axis=0)], axis=1)
        return z, np.repeat(self.lengths, n, axis=0), np.repeat(np.arange(self.groups), n)

    def _candidates(self, z: Array, k: Array, group: Indices) -> Candidates:
        fits = self.space.feasible(z, k)
        return Candidates(z[fits], k[fits], group[fits], self.space.kernel.rows(z[fits], k[fits]))

    def _pulled(self, pull: Array, z: Array, k: Array, group: Indices) -> Array:
        return sensitivity(pull, self.layout.embed(self.space.kernel.rows(z, k), group))

    def largest(self, relaxed: Relaxed) -> tuple[float, Candidates]:
        """The largest value found and poses at local maxima that exceed what the relaxed design already weighs."""
        seen = sensitivity(relaxed.pull, self.whole)
        first = np.argsort(seen)[::-1][:96]
        z, k, group = self.grid.z[first].copy(), self.grid.k[first], self.grid.group[first]
        value = seen[first]
        poses = self.space.poses
        step = (self.space.upper[:poses] - self.space.lower[:poses]) * COARSE ** (-1.0 / poses)
        for _ in range(14):  # compass search, each time half as wide: down to 1e-4 of the first step
            for i in range(poses):
                for sign in (1.0, -1.0):
                    trial = z.copy()
                    trial[:, i] = np.clip(trial[:, i] + sign * step[i], self.space.lower[i], self.space.upper[i])
                    there = np.where(
                        self.space.feasible(trial, k), self._pulled(relaxed.pull, trial, k, group), -np.inf
                    )
                    better = there > value
                    z[better], value[better] = trial[better], there[better]
            step = 0.5 * step
        top = float(value.max())
        order = np.argsort(value)[::-1]
        distinct: list[int] = []
        scale = self.space.upper[:poses] - self.space.lower[:poses]
        for i in order:
            near = [j for j in distinct if group[j] == group[i] and np.abs((z[i] - z[j])[:poses] / scale).max() < 0.01]
            if not near:
                distinct.append(int(i))
        fresh = np.array(distinct[:24], dtype=np.int64)
        return top, Candidates(z[fresh], k[fresh], group[fresh], self.space.kernel.rows(z[fresh], k[fresh]))

    def proved_largest(self, relaxed: Relaxed) -> float | None:
        """An upper bound of ⟨G, F⟩ over all poses by branch and bound; None where the readings are no trigonometric
        polynomials of two rotary axes, or it would take too long."""
        if self.space.poses != 2 or self.space.instrument != "r_test":
            return None
        top = self.largest(relaxed)[0]
        bounds = [self._prove(relaxed.pull, g, top) for g in range(self.groups)]
        return None if any(bound is None for bound in bounds) else max(bound for bound in bounds if bound is not None)

    def _degrees(self, pull: Array, g: int) -> tuple[Array, float] | None:
        """Degrees of the trigonometric polynomial in either angle and a bound of its values."""
        angles = 2.0 * math.pi * np.arange(TORUS) / TORUS
        poses = np.stack(np.meshgrid(angles, angles, indexing="ij"), axis=-1).reshape(-1, 2)
        z = np.concatenate([poses, np.tile(self.setups[g], (len(poses), 1))], axis=1)
        values = self._pulled(pull, z, np.tile(self.lengths[g], (len(z), 1)), np.full(len(z), g))
        spectrum = np.abs(np.fft.fft2(values.reshape(TORUS, TORUS)))
        strong = np.argwhere(spectrum > 1e-9 * spectrum.max())
        degrees = np.minimum(strong, TORUS - strong).max(axis=0).astype(float)
        if degrees.max() > TORUS // 4:
            return None
        enlarged = 1.0 / math.prod(math.cos(math.pi * d / TORUS) for d in degrees)  # Ehlich & Zeller 1964
        return degrees, float(values.max()) * enlarged

    def _prove(self, pull: Array, g: int, top: float) -> float | None:
        found = self._degrees(pull, g)
        if found is None:
            return None
        degrees, most = found
        low, high = self.space.lower[:2], self.space.upper[:2]
        counts = np.ceil((high - low) / np.radians(6.0)).astype(int)
        half = (high - low) / counts / 2.0
        axes = [low[i] + half[i] * (2.0 * np.arange(counts[i]) + 1.0) for i in range(2)]
        cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        worst = top
        while len(cells):
            z = np.concatenate([cells, np.tile(self.setups[g], (len(cells), 1))], axis=1)
            k = np.tile(self.lengths[g], (len(z), 1))
            reachable = self._near_limits(z, k, half)
            z, k, cells = z[reachable], k[reachable], cells[reachable]
            group = np.full(len(z), g)
            rows, slopes = self.space.kernel.slopes(z, k)
            whole, moved = self.layout.embed(rows, group), self.layout.embed(slopes[:, :2], group)
            weighted = pull @ whole
            value = np.einsum("npy,npy->n", whole, weighted)
            slope = 2.0 * np.einsum("nkpy,npy->nk", moved, weighted)
            bent = 0.5 * float(degrees @ half) ** 2 * most
            highest = value + np.abs(slope) @ half + bent
            close = highest <= top * (1.0 + 0.5 * GAP)
            if 4 * int((~close).sum()) > MOST_CELLS:
                close[:] = True  # a valid bound all the same, only less sharp
            if close.any():
                worst = max(worst, float(highest[close].max()))
            cells = cells[~close]
            half = 0.5 * half
            cells = np.concatenate([cells + half * s for s in np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])])
        return worst

    def _near_limits(self, z: Array, k: Array, half: Array) -> NDArray[np.bool_]:
        """Cells that may hold a reachable pose: limits at the centre, with the slope across the cell and a margin."""
        if not self.space.kernel.limit_count:
            return np.full(len(z), True)
        limits = self.space.kernel.limits(z, k)
        slopes = np.abs(self.space.kernel.limit_slopes(z, k)[:, :2])
        across = np.einsum("nkg,k->ng", slopes, half)
        return np.asarray(np.all(limits + 2.0 * across + MARGIN_MM / 100.0 >= 0.0, axis=1))
