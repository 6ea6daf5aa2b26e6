"""Continuous refinement of circles by IPOPT: the criterion's exact gradient, the axes' limits along every path.

Variables are the free ones of all circles together, each between 0 and 1 of its range. dψ/dv = -⟨G, dM/dv⟩ with dM/dv from
`_moved_run`; the limits (travel, feed and acceleration of every axis at 181 points of every path, the ball on the table) are
CasADi expressions and IPOPT has their exact derivatives. Second derivatives are IPOPT's own estimate (limited-memory BFGS): a
circle has four or five variables. The worst case over the draws is min t with ψ ≤ t at every draw.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.campaign import Campaign
from symfive.compiled import Oracle
from symfive.design._circles import Circle, Goal, true_values
from symfive.design._moved_run import MovedRun
from symfive.design._paths import FAMILIES, SMALLEST_GAP, CircleShape, make_path
from symfive.effects import Effect
from symfive.machine import Machine
from symfive.model import Model

OPTIONS: dict[str, Any] = {
    "max_iter": 25, "tol": 1e-5, "acceptable_tol": 1e-3, "acceptable_iter": 4, "mu_init": 1e-3, "bound_push": 1e-3,
    "bound_frac": 1e-3, "hessian_approximation": "limited-memory", "print_level": 0, "sb": "yes",
}  # fmt: skip
MARGIN = 0.01
"""Share of every limit that is kept free: rows between the points, and rounding of the result."""


class CircleObjective:
    """ψ of some circles at every draw as a function of the free variables x (each 0…1 of its range), with gradients."""

    def __init__(
        self, machine: Machine, effects: Iterable[Effect], circles: Sequence[Circle], free: Iterable[str],
        bounds: Mapping[str, tuple[float, float]], goal: Goal, rate_hz: float,
    ) -> None:  # fmt: skip
        self.goal, self.shapes = goal, [circle.shape for circle in circles]
        draws = 0 if goal.robust == "nominal" else len(circles[0].matrices) - 1
        wanted, effects = tuple(free), tuple(effects)
        self.paths, self.lower, self.upper, self.runs = [], [], [], []
        self.first = [0]
        for circle in circles:
            shape = circle.shape
            model = Model(Campaign(machine=machine, runs=circle.runs), effects)
            vectors = true_values(model, draws)
            senses = ("ccw", "cw") if shape.direction == "both" else (shape.direction,)
            paths = [make_path(machine, shape, sense, wanted) for sense in senses]
            self.runs.append(
                [
                    [MovedRun(model, run, path, vector, rate_hz) for vector in vectors]
                    for run, path in zip(circle.runs, paths, strict=True)
                ]
            )
            self.paths.append(paths)
            low, high = _range(shape, paths[0].free, bounds)
            self.lower.append(low)
            self.upper.append(high)
            self.first.append(self.first[-1] + len(low))
        self.size, self.draws = self.first[-1], draws + 1
        self._at, self._kept = b"", (np.empty(0), np.empty(0))

    @property
    def start(self) -> Array:
        """x of the circles as they are."""
        parts = [
            (shape.vector[list(paths[0].free)] - low) / (high - low)
            for shape, paths, low, high in zip(self.shapes, self.paths, self.lower, self.upper, strict=True)
        ]
        return np.clip(np.concatenate(parts), 0.0, 1.0)

    def values(self, i: int, x: Any) -> Any:
        """All variables of circle i at x (numbers or CasADi symbols), mm and mm/min."""
        free, low, high = self.paths[i][0].free, self.lower[i], self.upper[i]
        part = x[self.first[i] : self.first[i + 1]]
        whole: list[Any] = list(self.shapes[i].vector)
        for j, place in enumerate(free):
            whole[place] = low[j] + part[j] * (high[j] - low[j])
        return whole

    def shapes_at(self, x: Array) -> list[CircleShape]:
        """The circles at x."""
        return [shape.at(np.array(self.values(i, x))) for i, shape in enumerate(self.shapes)]

    def psi(self, x: Array) -> tuple[Array, Array]:
        """ψ at every draw (draws,) and gradients (draws, m)."""
        if x.tobytes() != self._at:
            self._kept = self._evaluate(x)
            self._at = x.tobytes()
        return self._kept

    def _evaluate(self, x: Array) -> tuple[Array, Array]:
        values, slopes = np.empty(self.draws), np.zeros((self.draws, self.size))
        for d in range(self.draws):
            totals, changes = [], []
            for i, runs in enumerate(self.runs):
                parts = [of_draw[d].information(np.array(self.values(i, x))) for of_draw in runs]
                totals.append(np.sum([part[0] for part in parts], axis=0))
                changes.append(np.sum([part[1] for part in parts], axis=0))
            whole = np.sum(totals, axis=0)
            values[d], pull = self.goal.psi_and_pull(whole)
            for i, change in enumerate(changes):
                range_ = self.upper[i] - self.lower[i]
                slopes[d, self.first[i] : self.first[i + 1]] = -np.einsum("ab,jab->j", pull, change) * range_
        return values, slopes

    def seconds(self, x: Any) -> Any:
        """Recording time of all runs as a CasADi expression."""
        return sum(
            path.setting(ca.vertcat(*self.values(i, x)))[0][4] for i, paths in enumerate(self.paths) for path in paths
        )

    def limits(self, x: Any) -> Any:
        """What must be ≥ 0, as a CasADi expression."""
        return ca.vertcat(
            *(path.limits(ca.vertcat(*self.values(i, x))) for i, paths in enumerate(self.paths) for path in paths)
        )


def _range(shape: CircleShape, free: tuple[int, ...], bounds: Mapping[str, tuple[float, float]]) -> tuple[Array, Array]:
    """Bounds of the free variables; a ratio stays on its side of 1."""
    low, high = [], []
    for i in free:
        name = FAMILIES[shape.family][i]
        least, most = bounds[name]
        if name == "ratio":
            inside = shape.values["ratio"] < 1.0
            least, most = (least, min(most, 1.0 - SMALLEST_GAP)) if inside else (max(least, 1.0 + SMALLEST_GAP), most)
        value = shape.values[name]
        low.append(min(least, value))
        high.append(max(most, value, least + 1e-9))
    return np.array(low), np.array(high)


def refined_shapes(objective: CircleObjective) -> list[CircleShape]:
    """The circles at the local optimum near those given."""
    point, values = {"x": ca.Sparsity.dense(objective.size)}, {"psi": ca.Sparsity.dense(objective.draws)}
    slopes = {"jacobian": ca.Sparsity.dense(objective.draws, objective.size)}
    gradient = Oracle("gradient", point | values, slopes, lambda x, psi: (objective.psi(x)[1].ravel(order="F"),))
    callback = Oracle("psi", point, values, lambda x: objective.psi(x)[:1], gradient)
    x = ca.MX.sym("x", objective.size)
    t = ca.MX.sym("t", 1 if objective.goal.robust == "worst" else 0)
    psi = callback(x)
    whole = t if t.numel() else ca.sum1(psi) / objective.draws
    if objective.goal.per_minute:
        whole = whole + ca.log(objective.seconds(x) / 60.0)
    limits = objective.limits(x) - MARGIN
    constraints = ca.vertcat(limits, *([t - psi] if t.numel() else []))
    nlp = {"x": ca.vertcat(x, t), "f": whole, "g": constraints}
    solver = ca.nlpsol("circles", "ipopt", nlp, {"ipopt": OPTIONS, "print_time": False, "error_on_fail": False})
    start = objective.start
    first = [objective.psi(start)[0].max()] if t.numel() else []
    lower = np.concatenate([np.zeros(objective.size), np.full(len(first), -np.inf)])
    upper = np.concatenate([np.ones(objective.size), np.full(len(first), np.inf)])
    free = np.asarray(ca.Function("g", [x], [limits])(start)).min() >= 0.0
    low = 0.0 if free else -1e-3  # a start at a limit may stay there
    found = solver(x0=np.concatenate([start, first]), lbx=lower, ubx=upper, lbg=low, ubg=np.inf)
    return objective.shapes_at(np.clip(np.asarray(found["x"]).ravel()[: objective.size], 0.0, 1.0))
