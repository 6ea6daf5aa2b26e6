"""The same maximum by IPOPT through CasADi, for bounds that bind and for a robust loss."""

from __future__ import annotations

from typing import Any, ClassVar

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.errors import EvaluationError
from symfive.inference import Problem

HUBER = 1.345
"""Where Huber's loss turns linear, in σ: 95 % efficiency for Gaussian noise (P. J. Huber 1981)."""


class _Objective:
    """-log posterior over the scaled free parameters, with gradient and Gauss–Newton Hessian, evaluated once per point."""

    def __init__(self, problem: Problem, values: Array, loss: str) -> None:
        self.problem, self.values, self.loss = problem, values.copy(), loss
        self.free = np.flatnonzero(problem.free)
        self.sigma = problem.model.prior_sigma[self.free]
        self._at: tuple[bytes, float, Array, Array] | None = None

    def full(self, x: Array) -> Array:
        """Parameter vector from scaled free ones."""
        values = self.values.copy()
        values[self.free] = self.problem.model.prior_mean[self.free] + self.sigma * x
        return values

    def scaled(self, values: Array) -> Array:
        """The opposite."""
        return np.asarray((values[self.free] - self.problem.model.prior_mean[self.free]) / self.sigma)

    def evaluate(self, x: Array) -> tuple[float, Array, Array]:
        """Value, gradient and Gauss–Newton Hessian at x."""
        key = x.tobytes()
        if self._at is None or self._at[0] != key:
            try:
                self._at = (key, *self._evaluate(x))
            except EvaluationError:  # IPOPT shortens a step to where the value is not finite
                self._at = (key, np.inf, np.zeros(len(x)), np.eye(len(x)))
        return self._at[1:]

    def _evaluate(self, x: Array) -> tuple[float, Array, Array]:
        size = len(self.problem.model.parameters)
        value, gradient, hessian = 0.0, np.zeros(size), np.zeros((size, size))
        for _, block, white in self.problem.whitened_at(self.full(x)):
            flat = white.reshape(-1, white.shape[2])
            residual, jacobian = flat[:, -1], flat[:, :-1]
            weight = np.ones_like(residual)
            if self.loss == "huber":
                weight = HUBER / np.maximum(np.abs(residual), HUBER)
                beyond = np.abs(residual) > HUBER
                value += float(np.sum(np.where(beyond, HUBER * (np.abs(residual) - 0.5 * HUBER), 0.5 * residual**2)))
            else:
                value += 0.5 * float(residual @ residual)
            gradient[block.columns] -= jacobian.T @ (weight * residual)
            hessian[np.ix_(block.columns, block.columns)] += jacobian.T @ (weight[:, None] * jacobian)
        value += 0.5 * float(x @ x)
        gradient_x = gradient[self.free] * self.sigma + x
        hessian_x = hessian[np.ix_(self.free, self.free)] * np.outer(self.sigma, self.sigma) + np.eye(len(x))
        return value, gradient_x, hessian_x


class _Value(ca.Callback):
    """One of the functions that IPOPT asks for, computed from the objective."""

    SHAPES: ClassVar = {"f": ("n",), "jac": ("n", "1"), "grad": ("n", "0"), "hess": ("n", "0", "1", "0")}

    def __init__(self, name: str, objective: _Objective, kind: str) -> None:
        ca.Callback.__init__(self)
        self.objective, self.kind = objective, kind
        self._kept: list[Any] = []
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self.SHAPES[self.kind])

    def get_n_out(self) -> int:
        return 2 if self.kind == "grad" else 1

    def get_sparsity_in(self, i: int) -> Any:
        n = len(self.objective.free)
        return {"n": ca.Sparsity.dense(n), "1": ca.Sparsity.dense(1), "0": ca.Sparsity(0, 1)}[self.SHAPES[self.kind][i]]

    def get_sparsity_out(self, i: int) -> Any:
        n = len(self.objective.free)
        shapes = {"f": [(1, 1)], "jac": [(1, n)], "grad": [(1, 1), (n, 1)]}
        return ca.Sparsity.upper(n) if self.kind == "hess" else ca.Sparsity.dense(*shapes[self.kind][i])

    def has_jacobian(self) -> bool:
        return self.kind == "f"

    def get_jacobian(self, name: str, inames: Any, onames: Any, opts: Any) -> Any:
        self._kept.append(_Value(name, self.objective, "jac"))
        return self._kept[-1]

    def eval(self, arg: Any) -> list[Any]:
        value, gradient, hessian = self.objective.evaluate(np.asarray(arg[0], dtype=float).ravel())
        if self.kind == "f":
            return [value]
        if self.kind == "jac":
            return [gradient[None, :]]
        if self.kind == "grad":
            return [value, gradient]
        return [ca.triu(ca.DM(hessian)) * float(arg[2])]


def solve_with_ipopt(problem: Problem, values: Array, loss: str) -> tuple[Array, bool, str]:
    """Values, whether IPOPT converged, and what it said if not. Begins at `values`."""
    objective = _Objective(problem, values, loss)
    n = len(objective.free)
    f, grad, hess = (_Value(f"objective_{kind}", objective, kind) for kind in ("f", "grad", "hess"))
    x = ca.MX.sym("x", n)
    solver = ca.nlpsol(
        "map", "ipopt", {"x": x, "f": f(x)},
        {"grad_f": grad, "hess_lag": hess, "print_time": False, "show_eval_warnings": False,
         "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-6,
         "ipopt.max_iter": 60, "ipopt.mu_strategy": "adaptive", "error_on_fail": False,
         # a play or a friction makes kinks, at which no gradient vanishes: a cost that stands still ends the search too
         "ipopt.acceptable_tol": 1e3, "ipopt.acceptable_obj_change_tol": 1e-9, "ipopt.acceptable_iter": 2},
    )  # fmt: skip
    parameters = [problem.model.parameters[i] for i in objective.free]
    lower = np.array([(p.lower - p.mean) / p.sigma for p in parameters])
    upper = np.array([(p.upper - p.mean) / p.sigma for p in parameters])
    found = solver(x0=objective.scaled(values), lbx=lower, ubx=upper)
    status = str(solver.stats()["return_status"])
    success = bool(solver.stats()["success"])
    note = "" if success else f"IPOPT ended with {status}; the best point found is reported"
    return objective.full(np.asarray(found["x"], dtype=float).ravel()), success, note
