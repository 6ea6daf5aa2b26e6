"""Continuous refinement of a design by IPOPT with exact structured second derivatives.

With M = P + Σ F(zᵢ), C = M⁻¹, S the block of C that counts and G = C K ψ'(S) Kᵀ C:

    ∂ψ   = -⟨G, ∂F⟩
    ∂∂ψ  = ψ''(S)[∂S, ∂S] + 2 tr(∂F C ∂F G) - ⟨G, ∂∂F⟩,   ∂S = -Kᵀ C ∂F C K

The last term is block diagonal in the poses (bordered by the set-ups); only the kernels of single rows are differentiated.
For D, log det S = log det Mₒₒ - log det M with o all that does not count, so that
s ∂∂ψ = tr(∂F C ∂F C) - tr(∂Fₒₒ Mₒₒ⁻¹ ∂Fₒₒ Mₒₒ⁻¹) less the frozen block diagonal.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array, Indices
from symfive.compiled import Oracle
from symfive.optimal._information import Task
from symfive.optimal._kernel import Kernel

WITHIN = 1e-6
"""Limits are kept by this much, and met to as much: a design a hair beyond one of them would be lost."""
OPTIONS: dict[str, Any] = {
    "constr_viol_tol": WITHIN, "acceptable_constr_viol_tol": WITHIN,
    "max_iter": 40, "tol": 1e-5, "acceptable_tol": 1e-3, "acceptable_iter": 6, "mu_init": 1e-2, "bound_push": 1e-4,
    "bound_frac": 1e-4, "bound_relax_factor": 0.0, "bound_mult_init_method": "mu-based", "barrier_tol_factor": 100.0,
    "mu_linear_decrease_factor": 0.1, "print_level": 0, "sb": "yes",
    "mumps_scaling": 0, "mumps_permuting_scaling": 0,
}  # fmt: skip
"""Of IPOPT. Angles in rad and lengths in 100 mm are of one size: scaling each linear system costs half as much as solving it."""


@dataclass(frozen=True)
class Rows:
    """The rows of a design: variables `z` (n, nz) of which the first `poses` are each row's own and the others its
    set-up's, constants `k` (n, 1), set-up `group` (n,) of `groups`."""

    z: Array
    k: Array
    group: Indices
    groups: int
    poses: int

    @classmethod
    def of(cls, z: Array, k: Array, group: Indices, poses: int) -> Rows:
        """The rows with their set-ups numbered anew, those without a row left out."""
        used, renumbered = np.unique(group, return_inverse=True)
        return cls(z, k, renumbered.astype(np.int64), len(used), poses)

    @property
    def setups(self) -> tuple[Array, Array]:
        """What is decided of every set-up (groups, nz - poses), and its constants (groups, 1)."""
        first = [int(np.argmax(self.group == g)) for g in range(self.groups)]
        return self.z[first, self.poses :], self.k[first]

    @property
    def variables(self) -> Array:
        """Everything that is decided: first the poses, then the set-ups."""
        return np.concatenate([self.z[:, : self.poses].ravel(), self.setups[0].ravel()])

    @property
    def index(self) -> Indices:
        """Where each row finds its z in `variables`: (n, nz)."""
        n, nz = self.z.shape
        pose = np.arange(n * self.poses).reshape(n, self.poses)
        setup = n * self.poses + self.group[:, None] * (nz - self.poses) + np.arange(nz - self.poses)
        return np.concatenate([pose, setup], axis=1)

    def at(self, variables: Array) -> Rows:
        """The same rows elsewhere."""
        return Rows(variables[self.index], self.k, self.group, self.groups, self.poses)


class Objective:
    """ψ of a design as a function of all that is decided, with exact derivatives."""

    def __init__(self, task: Task, kernel: Kernel, rows: Rows) -> None:
        self.task, self.kernel, self.rows = task, kernel, rows
        self.index = rows.index
        self.size = int(self.index.max()) + 1
        self.layout = task.layout(rows.groups)
        self.others = np.setdiff1d(np.arange(self.layout.size), task.interest)
        self._prior = task.prior_information(rows.groups)
        self._at: bytes = b""
        self._kept: tuple[Any, ...] = ()

    def _evaluate(self, x: Array) -> tuple[Any, ...]:
        key = x.tobytes()
        if key != self._at:
            z = x[self.index]
            rows, slopes = self.kernel.slopes(z, self.rows.k)
            whole = self.layout.embed(rows, self.rows.group)
            flat = whole.transpose(1, 0, 2).reshape(self.layout.size, -1)
            information = self._prior + flat @ flat.T
            covariance = np.linalg.inv(information)
            covariance = 0.5 * (covariance + covariance.T)
            S = self.task.of_interest(covariance)
            columns = covariance[:, self.task.interest]
            slope = self.task.criterion.slope(S)
            self._kept = (z, whole, slopes, information, columns, S, slope, columns @ slope @ columns.T)
            self._at = key
        return self._kept

    def value(self, x: Array) -> float:
        """ψ."""
        return self.task.criterion.value(self._evaluate(x)[5])

    def gradient(self, x: Array) -> Array:
        """dψ/dx."""
        _, whole, slopes, *_, pull = self._evaluate(x)
        slopes = self.layout.embed(slopes, self.rows.group)
        rows = -2.0 * np.einsum("nkpy,npy->nk", slopes, pull @ whole, optimize=True)
        return np.asarray(np.bincount(self.index.ravel(), rows.ravel(), self.size), dtype=float)

    def hessian(self, x: Array) -> Array:
        """d²ψ/dx² (m, m)."""
        z, whole, narrow, information, columns, S, slope, pull = self._evaluate(x)
        n, nz, _, _ = narrow.shape
        slopes = self.layout.embed(narrow, self.rows.group)
        still, moved = whole.transpose(0, 2, 1), slopes.transpose(0, 1, 3, 2)
        half = _half_inverse(information)
        if self.task.criterion.determinant:
            hessian = self._gram(moved @ half, still @ half)
            if self.others.size:
                half = _half_inverse(information[np.ix_(self.others, self.others)])
                hessian -= self._gram(moved[..., self.others] @ half, still[..., self.others] @ half)
            hessian /= len(self.task.interest)
        else:
            values, vectors = np.linalg.eigh(slope)
            bent = vectors * np.sqrt(np.maximum(values, 0.0))
            seen, by = still @ columns, moved @ columns
            changes = self._summed(by, seen)
            mixed = self._summed(moved @ half, seen @ bent) + self._summed(by @ bent, still @ half).swapaxes(1, 2)
            flat = mixed.reshape(self.size, -1)
            hessian = self.task.criterion.curvature(S, -(changes + changes.swapaxes(1, 2))) + 2.0 * (flat @ flat.T)
        own = self._narrow(pull @ whole)
        pulled = (pull @ slopes).reshape(n, nz, -1)
        block = pulled @ slopes.reshape(n, nz, -1).transpose(0, 2, 1) + self.kernel.curvature(z, self.rows.k, own)
        return np.asarray(hessian - 2.0 * self.gathered(block))

    def gathered(self, blocks: Array) -> Array:
        """Sum of matrices (n, nz, nz) of single rows in all that is decided (m, m)."""
        places = self.index[:, :, None] * self.size + self.index[:, None, :]
        summed = np.bincount(places.ravel(), blocks.ravel(), self.size**2)
        return np.asarray(summed, dtype=float).reshape(self.size, self.size)

    def _gram(self, moved: Array, still: Array) -> Array:
        """tr(∂F ∂F') of every two variables (m, m), from ∂J (n, nz, ny, p) and J (n, ny, p)."""
        n, _, ny, p = moved.shape
        poses = self.rows.poses
        first = n * poses
        gram = np.empty((self.size, self.size))
        gram[:first, :first] = (_sums if p < 2 * ny**2 else _pairs)(moved[:, :poses], still)
        if self.size > first:
            setups = self._of_setups(moved, still)
            setups += setups.swapaxes(1, 2)
            flat = setups.reshape(len(setups), -1)
            gram[first:, first:] = flat @ flat.T
            seen = (still.reshape(-1, p) @ setups).reshape(-1, n, ny * p).transpose(1, 2, 0)
            gram[:first, first:] = 2.0 * (moved[:, :poses].reshape(n, poses, -1) @ seen).reshape(first, -1)
            gram[first:, :first] = gram[:first, first:].T
        return gram

    def _summed(self, moved: Array, still: Array) -> Array:
        """Σ ∂Jᵀ J over the rows that a variable moves (m, p, q), of ∂J (n, nz, ny, p) and J (n, ny, q)."""
        poses = self.rows.poses
        own = moved[:, :poses].swapaxes(2, 3) @ still[:, None]
        return np.concatenate([own.reshape(-1, *own.shape[2:]), self._of_setups(moved, still)])

    def _of_setups(self, moved: Array, still: Array) -> Array:
        """The same for the variables of the set-ups alone."""
        _, nz, _, p = moved.shape
        poses, q = self.rows.poses, still.shape[2]
        if nz == poses:
            return np.empty((0, p, q))
        sums = []
        for g in range(self.rows.groups):
            mine = self.rows.group == g
            together = moved[mine, poses:].transpose(1, 3, 0, 2).reshape(nz - poses, p, -1)
            sums.append(together @ still[mine].reshape(-1, q))
        return np.concatenate(sums)

    def _narrow(self, whole: Array) -> Array:
        """Back from all columns (n, size, ny) to those of the row's own set-up."""
        shared, own = self.layout.shared, self.layout.own
        narrow = np.empty((len(whole), shared + own, whole.shape[2]))
        narrow[:, :shared] = whole[:, :shared]
        for g in range(self.rows.groups):
            mine = self.rows.group == g
            narrow[mine, shared:] = whole[mine, shared + g * own : shared + (g + 1) * own]
        return narrow

    def limits(self, x: Array) -> Array:
        """What must be ≥ 0, row by row (n·ng,)."""
        return self.kernel.limits(x[self.index], self.rows.k).ravel()


def _half_inverse(matrix: Array) -> Array:
    """H with H Hᵀ = M⁻¹."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(matrix)).T)


def _sums(moved: Array, still: Array) -> Array:
    """The same as `_pairs` from the matrices ∂F themselves, which is less work where they are small."""
    n, q, _, p = moved.shape
    sums = moved.swapaxes(2, 3) @ still[:, None]
    flat = (sums + sums.swapaxes(2, 3)).reshape(n * q, p * p)
    return np.asarray(flat @ flat.T)


def _pairs(moved: Array, still: Array) -> Array:
    """tr(∂F ∂F') of every two poses and their variables (n·q, n·q), ∂F = Σ ∂Jᵀ J + Jᵀ ∂J over the readings.

    From ∂J (n, q, ny, p) and J (n, ny, p): 2 Σ (∂J ∂J'ᵀ)(J J'ᵀ) + (∂J J'ᵀ)(J ∂J'ᵀ), so that only inner products are needed.
    """
    n, q, ny, p = moved.shape
    moved_flat = moved.transpose(2, 1, 0, 3).reshape(-1, p)
    still_flat = still.transpose(1, 0, 2).reshape(-1, p)
    JJ = (still_flat @ still_flat.T).reshape(ny, n, ny, n)
    DJ = (moved_flat @ still_flat.T).reshape(ny, q, n, ny, n)
    DD = (moved_flat @ moved_flat.T).reshape(ny, q, n, ny, q, n)
    total = np.zeros((q, n, q, n))
    for a, b in itertools.product(range(ny), repeat=2):
        total += DD[a, :, :, b] * JJ[a, None, :, b, None]
        total += DJ[a, :, :, b, None] * DJ[b, :, :, a].transpose(2, 0, 1)
    return np.asarray(2.0 * total.transpose(1, 0, 3, 2).reshape(n * q, n * q))


def refine(task: Task, kernel: Kernel, rows: Rows, lower: Array, upper: Array, **options: Any) -> tuple[Rows, float]:
    """The local optimum near a design and its ψ. `lower`, `upper` (nz,) bound the variables of a row."""
    objective = Objective(task, kernel, rows)
    index, m, n, ng = objective.index, objective.size, len(rows.z), kernel.limit_count
    dense, scalar, none = ca.Sparsity.dense(m), ca.Sparsity.scalar(), ca.Sparsity(0, 1)
    constraints = ca.Sparsity.dense(n * ng)
    upper_triangle = ca.Sparsity.upper(m)
    hessian_rows, hessian_columns = (np.array(part) for part in upper_triangle.get_triplet())
    jacobian_rows = np.broadcast_to(np.arange(n * ng).reshape(n, 1, ng), (n, rows.z.shape[1], ng)).ravel()
    jacobian_columns = np.broadcast_to(index[:, :, None], (n, rows.z.shape[1], ng)).ravel()
    order = np.lexsort((jacobian_rows, jacobian_columns))
    jacobian_sparsity = ca.Sparsity.triplet(n * ng, m, jacobian_rows[order].tolist(), jacobian_columns[order].tolist())

    def oracle(x: Array, p: Array) -> tuple[Any, ...]:
        return objective.value(x), objective.limits(x) if ng else ()

    def gradient(x: Array, p: Array) -> tuple[Any, ...]:
        return objective.value(x), objective.gradient(x)

    def jacobian(x: Array, p: Array) -> tuple[Any, ...]:
        return objective.limits(x), kernel.limit_slopes(x[index], rows.k).ravel()[order]

    def hessian(x: Array, p: Array, weight: Array, multipliers: Array) -> tuple[Any, ...]:
        whole = weight[0] * objective.hessian(x)
        if ng and np.any(multipliers):
            whole += objective.gathered(kernel.limit_curvature(x[index], rows.k, multipliers.reshape(n, ng)))
        return (whole[hessian_rows, hessian_columns],)

    point = {"x": dense, "p": none}
    nlp = Oracle("nlp", point, {"f": scalar, "g": constraints if ng else none}, oracle)
    parts = {
        "grad_f": Oracle("nlp_grad_f", point, {"f": scalar, "grad_f_x": dense}, gradient),
        "hess_lag": Oracle(
            "nlp_hess_l",
            {**point, "lam_f": scalar, "lam_g": constraints if ng else none},
            {"hess_gamma_x_x": upper_triangle},
            hessian,
        ),
    }  # fmt: skip
    if ng:
        parts["jac_g"] = Oracle("nlp_jac_g", point, {"g": constraints, "jac_g_x": jacobian_sparsity}, jacobian)
    settings: dict[str, Any] = {"ipopt": OPTIONS | options, "print_time": False, "error_on_fail": False, **parts}
    settings |= {"calc_lam_p": False, "no_nlp_grad": True}
    solver = ca.nlpsol("refine", "ipopt", nlp, settings)
    low, high = np.empty(m), np.empty(m)
    low[index], high[index] = lower, upper
    start = np.clip(rows.variables, low, high)
    found = solver(x0=start, lbx=low, ubx=high, **({"lbg": WITHIN, "ubg": np.inf} if ng else {}))
    best = np.clip(np.asarray(found["x"]).ravel(), low, high)
    return rows.at(best), objective.value(best)
