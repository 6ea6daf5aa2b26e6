"""The certificate: how good a plan is, measured against the best that any plan with as many poses can be.

Column generation: the relaxed design on a growing list of poses gives G; a global search over all poses for the largest
⟨G, F(pose)⟩ gives the Kiefer–Wolfowitz bound (see `_relaxed`) and the pose to add, until bound and value meet.

How rigorous: branch and bound (`_proof`) covers every pose of the plan's own set-ups, four dimensions of a ball bar included,
wherever the readings are smooth polynomials of the angles: location errors, Fourier error motions of rotary axes,
polynomial ones of all axes. A pose met on the way that exceeds what the search had found joins the relaxed design. Apart from
rounding errors of double precision that is a proof. Elsewhere (B-splines, Fourier error motions of linear axes) the search stands
alone; `rigour` says which.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from symfive.arrays import Array
from symfive.design._candidates import rows_of, value_of
from symfive.design._digits import down
from symfive.design._proof import bounded_sensitivity
from symfive.design._search import COARSE, FEW, MANY, Search
from symfive.design._space import Space
from symfive.optimal import Candidates, Relaxed, Rows, Task, marginal_sensitivity, relax

GAP = 2e-3
ROUNDS = 25
KEPT, FIRST, PATIENCE = 1e-5, 1000, 4
SUPPORT = 1e-4
PROOF = 0.5
LEAST_WEIGHT = 0.01
WEAK = 0.9
"""Efficiency below which a plan says why."""
PROOFS = 6
"""How often at most a bound is proved. Each proof may meet poses that the search has missed; they join the relaxed design."""
SEARCHED = (
    f"a search from {COARSE} quasi-random poses, edges and corners, refined from the best and from the relaxed design's own: "
    "numerically global, not proved"
)
PROVED = (
    "branch and bound over all poses of the set-ups with bounds of the third derivatives; a cell counts unless a limit excludes "
    "all of it; double precision"
)
SHARP = 0.1
"""Share of the distance between plan and relaxed design to which the bound is made tight; nothing is gained by more."""


@dataclass(frozen=True)
class Certificate:
    """Bound on how far a plan is from the best one.

    `efficiency`: at least this share of the best plan with `points` poses in the same set-ups (in variance, per parameter).
    `anywhere`: the same against any set-ups in the workspace (by `_anywhere`, on a grid of them; None if not asked for).
    `value` ψ of the plan, `bound` the lowest possible ψ, `relaxed` ψ of the relaxed design, `rigour` how sure the bound is."""

    efficiency: float
    value: float
    bound: float
    relaxed: float
    rigour: str
    points: int
    anywhere: float | None = None

    @property
    def proved(self) -> bool:
        """Whether branch and bound covered every pose of the set-ups."""
        return self.rigour.startswith("branch and bound")

    @property
    def why_low(self) -> str:
        """Where an efficiency below `WEAK` comes from, in one sentence; nothing above it."""
        if self.efficiency >= WEAK:
            return ""
        whole, slack = (1.0 - math.exp(x) for x in (self.relaxed - self.value, self.bound - self.relaxed))
        return (
            f"certified below {WEAK:g}: weights on poses in the same set-ups would lower the variance by {100.0 * whole:.0f} %, "
            f"which {self.points} whole poses cannot reach, and the bound itself may be {100.0 * slack:.1f} % too low; "
            "more poses raise the certificate"
        )

    @property
    def says(self) -> str:
        """The certificate in one sentence."""
        text = f"≥ {down(self.efficiency)} of the best plan with {self.points} poses in these set-ups"
        text += " (proved)" if self.proved else " (searched, not proved)"
        if self.anywhere is not None:
            text += f", and ≥ {down(self.anywhere)} of the best with any set-ups in the workspace (searched on a grid)"
        return text


@dataclass(frozen=True)
class Generated:
    """The relaxed design of some set-ups by column generation: `columns` with the weights `relaxed`, the lowest ψ `bound`
    that any design in them has, `reached` the lowest ψ of a relaxed design; `top` is the largest φ found at
    `relaxed`, `best` are its poses."""

    search: Search
    columns: Candidates
    relaxed: Relaxed
    reached: float
    bound: float
    top: float
    best: Candidates

    @property
    def support(self) -> Candidates:
        """The columns that count."""
        return self.columns.take(np.flatnonzero(self.relaxed.weights > SUPPORT))


def certify(space: Space, task: Task, rows: Rows, *, prove: bool = True) -> Certificate:
    """The certificate of the design `rows`; without `prove` its bound comes from a search alone."""
    points, value = len(rows.z), value_of(space, task, rows)
    found = generate(space, task, rows, value=value)
    bound, rigour = (-math.inf, PROVED) if prove else (found.bound, SEARCHED)
    for _ in range(PROOFS if prove else 0):
        slack = max(PROOF * GAP, SHARP * (value - found.reached))
        proved = _proved(space, task, rows, found, slack)
        if proved is None:
            bound, rigour = found.bound, SEARCHED
            break
        bound = max(bound, _bound(task, found.relaxed, rows.groups, points, proved[0]))
        if proved[2] or found.reached - bound <= GAP + 2.0 * slack:
            break
        found = generate(space, task, rows, value=value, more=found.columns.joined(proved[1]))
    efficiency = min(1.0, math.exp(bound - value))
    return Certificate(efficiency, value, bound, min(value, found.reached), rigour, points)


def _proved(
    space: Space, task: Task, rows: Rows, found: Generated, slack: float
) -> tuple[float, Candidates, bool] | None:
    """An upper bound of φ over all poses of the set-ups, no sharper than `slack`, poses that exceed all that were found, and
    whether cells ran out, so that no sharper bound is possible; None where nothing can be proved."""
    layout, highest, better, exhausted = task.layout(rows.groups), 0.0, found.best, False
    for g in range(rows.groups):
        first = int(np.flatnonzero(rows.group == g)[0])
        z, k = rows.z[first], rows.k[first]
        proved = bounded_sensitivity(space, layout, found.relaxed.pull, z, k, g, found.top, slack)
        if proved is None:
            return None
        highest, n = max(highest, proved.bound), len(proved.better)
        exhausted |= proved.exhausted
        some = np.concatenate([proved.better, np.tile(z[rows.poses :], (n, 1))], axis=1)
        lengths = np.tile(k, (n, 1))
        better = better.joined(Candidates(some, lengths, np.full(n, g), space.kernel.rows(some, lengths)))
    return highest, better.take(np.arange(len(found.best), len(better))), exhausted


def generate(
    space: Space, task: Task, rows: Rows, gap: float = GAP, most: int = ROUNDS, *, value: float = math.inf,
    points: int | None = None, more: Candidates | None = None,
) -> Generated:  # fmt: skip
    """Column generation for `points` readings (as many as `rows`, if None) in the set-ups of `rows`, until bound and relaxed
    design meet to `gap`; `more` poses to begin with. With ψ = `value` of a plan, for its certificate: until they meet to a small
    share of the distance to that, by searches that ascend to the maxima and in the end start from more poses."""
    points = points or len(rows.z)
    search, own = Search(space, task, *rows.setups), rows_of(space, rows)
    columns = own.joined(search.grid.take(np.arange(0, len(search.grid), max(1, len(search.grid) // FIRST))))
    columns = columns if more is None else columns.joined(more)
    given, certain = len(own), math.isfinite(value)
    weights = np.concatenate(
        [np.full(given, points / given), np.full(len(columns) - given, 0.1 * points / len(columns))]
    )
    bound, reached, starts = -math.inf, math.inf, FEW
    history: list[float] = []
    for rounds in range(1, most + 1):
        tolerance = max(
            0.5 * gap, min(0.02, 0.1 * (reached - bound))
        )  # while columns are missing, no sharper than they
        relaxed = relax(task, columns, rows.groups, points, weights, tolerance=tolerance, whole_poses=True)
        reached = min(reached, relaxed.value)
        relaxed = replace(relaxed, pull=_extended(task, relaxed, columns, search.grid, rows.groups, points))
        kept = np.flatnonzero(relaxed.weights > KEPT * points)
        support = columns.take(kept)
        top, fresh = search.largest(relaxed, support, starts) if certain else search.spread(relaxed, support)
        bound = max(bound, _bound(task, relaxed, rows.groups, points, top))
        history.append(bound)
        sharp = max(gap, SHARP * (value - reached)) if certain else gap
        stalled = len(history) > PATIENCE and bound - history[-1 - PATIENCE] < 0.2 * gap
        done = relaxed.value - bound < sharp or stalled
        if done and certain and starts == FEW:  # what few starts have missed would be in the bound
            starts, history = MANY, []
            top, fresh = search.largest(relaxed, support, starts)
            bound = _bound(task, relaxed, rows.groups, points, top)
            done = relaxed.value - bound < sharp
        if rounds == most or done:
            break
        columns = columns.take(kept).joined(fresh)
        weights = np.concatenate([relaxed.weights[kept], np.full(len(fresh), 0.02 * points / len(fresh))])
    return Generated(search, columns, relaxed, reached, bound, top, fresh)


def _extended(task: Task, relaxed: Relaxed, columns: Candidates, grid: Candidates, groups: int, points: int) -> Array:
    """G of the machine's parameters carried to set-up errors: (I, B)ᵀ G (I, B), which bounds for any B (see `_anywhere`).

    At the relaxed design this is G itself; for a set-up that it leaves empty B is taken from the most informative poses there.
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
        weights = (
            relaxed.weights[mine] if source is columns else marginal_sensitivity(machine, [rows], prior, [points])[0][2]
        )
        flat = rows.transpose(1, 0, 2).reshape(shared + own, -1)
        gram = (flat * np.repeat(weights, rows.shape[2])) @ flat.T
        carried.append(-np.linalg.solve(gram[shared:, shared:] + prior, gram[shared:, :shared]))
    whole = np.concatenate(carried)
    return np.asarray(whole @ machine @ whole.T)


def _bound(task: Task, relaxed: Relaxed, groups: int, points: int, top: float) -> float:
    return relaxed.lowest(float(np.sum(relaxed.pull * task.prior_information(groups))) + points * top)
