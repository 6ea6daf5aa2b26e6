"""The same maximum by IPOPT through CasADi, for bounds that bind and for a robust loss."""

from __future__ import annotations

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.compiled import Oracle
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


def solve_with_ipopt(problem: Problem, values: Array, loss: str) -> tuple[Array, bool, str]:
    """Values, whether IPOPT converged, and what it said if not. Begins at `values`."""
    objective = _Objective(problem, values, loss)
    dense, scalar, none = ca.Sparsity.dense(len(objective.free)), ca.Sparsity.scalar(), ca.Sparsity(0, 1)
    upper_triangle = ca.Sparsity.upper(len(objective.free))
    places = tuple(np.array(part) for part in upper_triangle.get_triplet())
    point = {"x": dense, "p": none}
    multiplied = {**point, "lam_f": scalar, "lam_g": none}
    nlp = Oracle("nlp", point, {"f": scalar, "g": none}, lambda x, p: (objective.evaluate(x)[0], ()))
    parts = {
        "grad_f": Oracle("nlp_grad_f", point, {"f": scalar, "grad_f_x": dense}, lambda x, p: objective.evaluate(x)[:2]),
        "hess_lag": Oracle("nlp_hess_l", multiplied, {"hess_gamma_x_x": upper_triangle},
                           lambda x, p, weight, _: (weight[0] * objective.evaluate(x)[2][places],)),
    }  # fmt: skip
    solver = ca.nlpsol(
        "map", "ipopt", nlp,
        {**parts, "calc_lam_p": False, "no_nlp_grad": True, "print_time": False, "show_eval_warnings": False,
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
