"""`identify`: parameters and their uncertainties from a campaign with readings.

IPOPT, through CasADi, finds the same maximum for bounds that bind and for a robust loss.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.campaign import Campaign
from symfive.compiled import Oracle
from symfive.effects import Effect
from symfive.errors import EvaluationError, InputError, among
from symfive.given import campaign_given
from symfive.identify._mounted import mounting_notes
from symfive.identify._result import Identification
from symfive.identify._tension import tension_notes
from symfive.identify._wiring import wiring_doubts
from symfive.inference import Noise, Problem, confounded_combinations, data_rank, solve, square_of
from symfive.instruments import INSTRUMENTS
from symfive.model import Model
from symfive.threads import one_thread

FEW, QUIET = 10, 0.2
"""Residuals this many times smaller than the noise that is declared are no luck where the readings are more than a few."""


@one_thread
def identify(
    campaign: Campaign | Model | Path | str, *, effects: Iterable[Effect] = (), free: Iterable[str] | None = None,
    fixed: Mapping[str, float] | None = None, noise: str = "estimate", solver: str = "gauss_newton",
    loss: str = "square", start: Mapping[str, float] | None = None,
    start_noise: Mapping[tuple[str, str], Noise] | None = None, refine: bool = True,
    progress: Callable[[str], None] = lambda _: None,
) -> Identification:  # fmt: skip
    """Maximum a posteriori estimate of every parameter of the baseline, the effects and the set-ups.

    `campaign` with readings, the path of its folder, or its `Model`; `effects` are added to the baseline. `free`: names of the
    only parameters to estimate; `fixed`: values of parameters held constant (file units). `noise`: `estimate` finds white
    noise (never below the declared one), coloured noise and outliers; `repeats` finds them from differences of repeated runs, if
    these show less noise; `declared` takes the data sheet. `solver`: `gauss_newton` or `ipopt` (bounds by an interior point);
    `loss`: `square` or `huber` (IPOPT). `start` and `start_noise` (by run and instrument) are the initial values. `refine`:
    IPOPT continues where a bound is active and Gauss–Newton has not converged. Runs of more than 50,000 rows are identified
    window by window, and their residuals stay on disk.

    Raises `InputError` where there are no readings. Source of the estimator: Gaussian prior and noise (A. Tarantola
    2005, ch. 3), restricted likelihood for the noise.
    """
    model = campaign if isinstance(campaign, Model) else Model(campaign_given(campaign), effects)
    among(noise, ("estimate", "repeats", "declared"), f'noise = "{noise}" is unknown')
    among(solver, ("gauss_newton", "ipopt"), f'solver = "{solver}" is unknown')
    among(loss, ("square", "huber"), f'loss = "{loss}" is unknown')
    values = model.vector(dict(start or {}))
    movable = np.ones(len(model.parameters), dtype=bool)
    if free is not None:
        chosen = [model.index[name] for name in model.index if name in set(free)]
        movable[:] = False
        movable[chosen] = True
    for name, value in (fixed or {}).items():
        values[_place(model, name)] = value
        movable[_place(model, name)] = False
    problem = Problem.of(model, movable, start_noise)
    if noise == "repeats":
        problem.repeats = model.campaign.repeats
    progress(f"{model.campaign.rows} rows, {int(movable.sum())} parameters")
    values, converged = solve(problem, values, noise=noise, progress=progress)
    notes = []
    at_bound = any(v in (p.lower, p.upper) for p, v in zip(model.parameters, values, strict=True))
    if solver == "ipopt" or loss != "square" or (refine and at_bound and not converged):
        progress("refining with IPOPT")
        values, converged, note = solve_with_ipopt(problem, values, loss)
        notes += [note] if note else []
    result = summarise(problem, values, converged, tuple(notes))
    held = [f"run {run} was held in memory as a whole: its rows depend on rows far away" for run in problem.held_whole]
    doubts = wiring_doubts(result) or tension_notes(result)
    return replace(result, notes=(*result.notes, *held, *doubts, *mounting_notes(problem, result)))


def _place(model: Model, name: str) -> int:
    if name not in model.index:
        raise InputError(f'the model has no parameter "{name}"', remedy="see model.parameters")
    return model.index[name]


def summarise(
    problem: Problem, values: Array, converged: bool, notes: tuple[str, ...] = (), method: str = "joint"
) -> Identification:
    """Covariance, rank, confounded combinations and residual statistics at the solution."""
    model = problem.model
    information, residuals = problem.information_at(values), problem.residuals_at(values)
    free = np.flatnonzero(problem.free)
    inner = np.ix_(free, free)
    covariance = np.zeros_like(information.matrix)
    covariance[inner] = np.linalg.inv(information.matrix[inner] + np.diag(problem.prior_precision[free]))
    spent = float(np.trace(covariance[inner] @ information.matrix[inner]))
    excess = problem.excess_at(values)[inner]
    covariance[inner] += covariance[inner] @ excess @ covariance[inner]
    declared, rms, rms_kept = _squares(problem, residuals)
    dof = max(information.count - spent, 1.0)
    runs = model.campaign.runs
    sizes = zip(values.tolist(), np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist(), strict=True)
    found = {p.name: size for p, size in zip(model.parameters, sizes, strict=True)}
    read = ((run, INSTRUMENTS[name]) for run in runs for name, _ in problem.parts(run))
    notes = (*notes, *(said for run, each in read for said in each.remarks(run, model.machine, found)))
    if not converged:
        notes = (*notes, "the fit did not converge; the values are the best found and their uncertainties may be wrong")
    if information.count <= spent:
        notes = (*notes, "there are no more readings than parameters: the fit cannot be judged")
    if dof > FEW and declared / dof < QUIET**2:
        notes = (
            *notes,
            f"the residuals are {(declared / dof) ** -0.5:.3g} times smaller than the noise declared: are the readings in "
            "the units that their columns name (µm, not mm), and is noise_um the 1σ of one of them?",
        )
    notes = (*notes, *_weighed(problem))
    active = [model.parameters[i] for i in free]
    sigma = np.array([p.sigma for p in active])
    return Identification(
        model=model,
        values=values,
        covariance=covariance,
        converged=converged,
        rank=data_rank(information.matrix[inner], sigma),
        confounded=confounded_combinations(information.matrix[inner], active),
        outliers=tuple(problem.outliers),
        noises=dict(problem.noises),
        residuals=residuals,
        rms=rms,
        rms_kept=rms_kept,
        chi2_dof=declared / dof,
        chi2_dof_whitened=information.square / dof,
        dof=dof,
        notes=notes,
        method=method,
        weights=dict(problem.weights),
    )


def _weighed(problem: Problem) -> Iterator[str]:
    """Of runs with readings that depend on what their rows do not show."""
    for run in problem.model.campaign.runs:
        less = np.any(~problem.judged(run) & ~problem.undetermined[run.id], axis=1)
        if less.any():
            yield (
                f"run {run.id}: {int(less.sum())} of {run.rows} rows hardly count: what they show depends on how the axes moved "
                "between the recorded rows or before the first, as where an axis starts; record more rows a second, from rest on"
            )


def _squares(problem: Problem, residuals: Mapping[str, Array]) -> tuple[float, dict[str, float], dict[str, float]]:
    """Sum of the kept residuals' squares over the declared noise's; the residuals' root mean square by unit of reading, of all
    of them and of those that were kept."""
    declared = 0.0
    every: dict[str, list[float]] = {}
    kept: dict[str, list[float]] = {}
    for run in problem.model.campaign.runs:
        for name, part in problem.parts(run):
            residual, left_out = residuals[run.id][:, part], problem.left_out[run.id][:, part]
            never = ~problem.judged(run)[:, part]
            out = left_out | never
            square = square_of(residual, out)
            whole = square_of(residual, never) if out.any() else square
            weighed = residual * problem.counts(run)[:, part] if run.id in problem.weights else None
            counted = square if weighed is None else square_of(weighed, left_out)
            declared += counted / problem.noises[run.id, name].declared ** 2
            unit = problem.unit_of(run, part)
            for sums, part_square, apart in ((every, whole, never), (kept, square, out)):
                entry = sums.setdefault(unit, [0.0, 0.0])
                entry[0] += part_square
                entry[1] += apart.size - int(apart.sum())
    return declared, _root_means(every), _root_means(kept)


def _root_means(sums: Mapping[str, Sequence[float]]) -> dict[str, float]:
    """Unit → root of (sum of squares, number)."""
    return {unit: float(np.sqrt(square / max(count, 1.0))) for unit, (square, count) in sums.items()}


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
