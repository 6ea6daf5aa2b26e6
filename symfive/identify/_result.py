"""The result of an identification: every value with its uncertainty, and what stays confounded, by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from symfive.arrays import Array
from symfive.campaign import FIRST_LINE
from symfive.disk import release
from symfive.errors import InputError
from symfive.inference import Confounding, Noise, Outlier, Problem, not_separated
from symfive.kinematics import basis_of
from symfive.model import Model
from symfive.numbers import percent, plain_number, unit_words, with_std
from symfive.parameters import Parameter
from symfive.screen import OnScreen, listed

SCHEMA = "symfive.identification/1"
UNCONVERGED = "The fit did not converge: uncertainties may be wrong, take nothing below as final."
CURVE_POINTS = 37
LEVEL = 1e-3
"""How rarely declared noise alone may lead to "does not fit"."""
NEAR = 1.1
"""Up to this χ²/dof a significant excess is called small."""


@dataclass(frozen=True)
class MotionCurve:
    """An identified error motion over its axes: `at` axis → (N,) mm or degree, `value` and `std` (N,) µm or µrad."""

    name: str
    unit: str
    at: Mapping[str, Array]
    value: Array
    std: Array


@dataclass(frozen=True, repr=False)
class Identification(OnScreen):
    """Estimated parameters of a model with covariance, fit quality, outliers and confounded combinations.

    `values`, `std` (k,) in the order and units of `model.parameters`; `covariance` (k, k); `rank` directions in which
    the data outweigh the prior; `rms` root mean square of all residuals, by unit of reading, `rms_kept` without those of
    the `outliers`, which the fit excluded; `chi2_dof` mean square of the kept ones over the *declared* noise per degree of
    freedom; `residuals` run → (N, ny), on disk where a run is long; `weights` run → (N, ny), 0…1: how much each reading counts,
    of runs whose rows may not tell all of the motion between them.
    """

    model: Model
    values: Array
    covariance: Array
    converged: bool
    rank: int
    confounded: tuple[Confounding, ...]
    outliers: tuple[Outlier, ...]
    noises: Mapping[tuple[str, str], Noise]
    residuals: Mapping[str, Array]
    rms: Mapping[str, float]
    rms_kept: Mapping[str, float]
    chi2_dof: float
    chi2_dof_whitened: float
    dof: float
    notes: tuple[str, ...] = ()
    method: str = "joint"
    weights: Mapping[str, Array] = field(default_factory=dict)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters, in the order of `values`."""
        return self.model.parameters

    @property
    def named(self) -> dict[str, float]:
        """The values by name, file units."""
        return self.model.named(self.values)

    @property
    def fits(self) -> str:
        """Whether the model explains the readings down to the declared noise: `yes`, `nearly`, `no`, `better` (residuals smaller
        than declared) or `unknown` (too few readings)."""
        from scipy.special import chdtr, chdtrc

        ratio, dof = self.chi2_dof, self.dof
        if dof <= 1.0:
            return "unknown"
        if chdtrc(dof, ratio * dof) > LEVEL:
            return "better" if ratio < 0.8 and chdtr(dof, ratio * dof) < LEVEL else "yes"
        return "nearly" if ratio <= NEAR else "no"

    @property
    def std(self) -> Array:
        """Posterior standard deviations (k,), file units."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def problem(self, model: Model | None = None) -> Problem:
        """The estimation problem of this fit, or of another model of its campaign, with its noise and without its outliers."""
        problem = Problem.of(model or self.model, noises=self.noises)
        problem.weights = dict(self.weights)
        for outlier in self.outliers:
            names = [c.name for c in problem.model.columns(outlier.run)]
            problem.left_out[outlier.run][outlier.row, names.index(outlier.column)] = True
        return problem

    def __getitem__(self, name: str) -> float:
        """The value of a parameter in its file unit."""
        return float(self.values[self._place(name)])

    def uncertainty(self, name: str) -> float:
        """Its posterior standard deviation."""
        return float(self.std[self._place(name)])

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """The central interval that holds the true value with probability `level` (Student's t for few readings)."""
        from scipy.special import ndtri, stdtrit

        i = self._place(name)
        tail = (1 - level) / 2
        factor = float(-stdtrit(self.dof, tail) if 1.0 < self.dof < 1e4 else -ndtri(tail))
        return float(self.values[i] - factor * self.std[i]), float(self.values[i] + factor * self.std[i])

    def _place(self, name: str) -> int:
        if name not in self.model.index:
            raise InputError(f'there is no parameter "{name}"', remedy="see result.parameters")
        return self.model.index[name]

    @property
    def rms_um(self) -> float:
        """Root mean square of all residuals, in µm where readings are in µm, else in `unit`."""
        return self.rms.get(self.file_unit, 0.0)

    @property
    def file_unit(self) -> str:
        """The unit of `rms_um` as files spell it."""
        return "um" if "um" in self.rms else next(iter(self.rms), "um")

    @property
    def unit(self) -> str:
        """The unit of `rms_um`, as it is printed."""
        return unit_words(self.file_unit)

    @property
    def white_noise(self) -> float:
        """1σ of the white noise that was found, root mean square over the recordings in `unit`."""
        problem, runs = self.problem(), {run.id: run for run in self.model.campaign.runs}
        parts = [(id, name, part) for id, run in runs.items() for name, part in problem.parts(run)]
        own = [(id, name) for id, name, part in parts if problem.unit_of(runs[id], part) == self.file_unit]
        return float(np.sqrt(np.mean([self.noises[key].white ** 2 for key in own or self.noises])))

    @property
    def excluded(self) -> str:
        """How many readings the fit excluded as outliers, their share, and what the others leave; "" where there are none."""
        if not self.outliers:
            return ""
        count, every, unit = len(self.outliers), self.problem().readings, self.file_unit
        kept = f"{plain_number(self.rms_kept[unit], unit)} {self.unit}"
        return f"Excluded outliers: {count} of {every} readings ({percent(count / every)}); without them rms {kept}."

    @property
    def inseparable(self) -> list[str]:
        """What the readings do not separate, in words, where a parameter of the machine is in it."""
        return not_separated(c for c in self.confounded if c.of_machine)

    def error_motion(self, name: str, points: int = CURVE_POINTS) -> MotionCurve:
        """The identified error motion over the travel, with the 1σ of each point from the joint covariance."""
        term = self.model.machine.errors[name]
        basis = basis_of(term, self.model.machine)
        axes = [self.model.machine.axes[axis] for axis in term.over]
        count = points if len(axes) == 1 else max(9, int(points ** (1.0 / len(axes)) * 2))
        grids = np.meshgrid(*(self._reach(axis.name, count) for axis in axes), indexing="ij")
        flat = [grid.ravel() for grid in grids]
        matrix = basis.matrix(*(f * axis.to_internal for f, axis in zip(flat, axes, strict=True)))
        where = [self.model.index[f"{name}.{n}"] for n in basis.names]
        value = matrix @ self.values[where]
        std = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", matrix, self.covariance[np.ix_(where, where)], matrix), 0.0))
        return MotionCurve(name, term.unit, dict(zip(term.over, flat, strict=True)), value, std)

    def _reach(self, axis: str, count: int) -> Array:
        """The part of the travel that the campaign used (of a turning axis at most one turn)."""
        low, high = np.inf, -np.inf
        for run in self.model.campaign.runs:
            command = run.commands[axis]
            low, high = min(low, float(np.min(command))), max(high, float(np.max(command)))
            release(command)
        if high - low < 1e-9:
            low, high = self.model.machine.axes[axis].travel
        if self.model.machine.axes[axis].rotary and high - low > 360.0:
            low, high = 0.0, 360.0
        return np.linspace(low, high, count)

    def to_data(self) -> dict[str, Any]:
        """`identification.json` (conventions, section 6)."""
        machine = self.model.machine
        motions = {term.name: self.error_motion(term.name) for term in machine.error_motions}
        setup: dict[str, dict[str, Any]] = {run.id: {} for run in self.model.campaign.runs}
        mountings: dict[str, dict[str, Any]] = {}
        shared = {}
        for i, p in enumerate(self.parameters):
            entry = {"value": float(self.values[i]), "std": float(self.std[i]), "unit": p.unit}
            if not p.of_setup:
                shared[p.name] = {**entry, "prior": p.sigma, "prior_mean": p.mean}
            elif p.mounting is None:
                setup[str(p.run)][p.quantity] = entry
            else:
                mountings.setdefault(p.mounting, {})[p.quantity] = entry
        return {
            "schema": SCHEMA,
            "method": self.method,
            "converged": self.converged,
            "parameters": shared,
            "error_motions": {
                name: {
                    "at": {axis: _rounded(at) for axis, at in curve.at.items()},
                    "value": _rounded(curve.value),
                    "std": _rounded(curve.std),
                    "unit": curve.unit,
                }
                for name, curve in motions.items()
            },
            "setup": setup,
            "mountings": mountings,
            "rank": self.rank,
            "confounded": [list(c.names) for c in self.confounded if c.of_machine],
            "confounded_setup": [list(c.names) for c in self.confounded if not c.of_machine],
            "says": [c.words for c in self.confounded if c.of_machine],
            "rms_um": float(self.rms_um),
            "rms": {unit: float(v) for unit, v in self.rms.items()},
            "rms_kept": {unit: float(v) for unit, v in self.rms_kept.items()},
            "chi2_dof": float(self.chi2_dof),
            "chi2_dof_whitened": float(self.chi2_dof_whitened),
            "noise": {
                f"{run}.{instrument}": {
                    "declared": n.declared, "white": n.white, "coloured": n.coloured,
                    "time_constant_s" if self.model.campaign.run(run).has_clock else "rows_correlated": n.time_constant,
                    **({"decades": n.decades} if n.decades > 1 else {}),
                }
                for (run, instrument), n in self.noises.items()
            },
            "outliers": [
                {"run": o.run, "row": o.row + FIRST_LINE, "column": o.column, "residual": o.residual, "sigmas": o.sigmas}
                for o in self.outliers
            ],
            "notes": list(self.notes),
        }  # fmt: skip

    def table(self, setup: bool = False) -> list[tuple[str, float, float, str, float]]:
        """Rows (name, value, std, unit, prior 1σ), set-up parameters only if asked for."""
        rows = zip(self.parameters, self.values, self.std, strict=True)
        return [(p.name, float(v), float(s), p.unit, p.sigma) for p, v, s in rows if setup or not p.of_setup]

    def __str__(self) -> str:
        table = self.table()
        width = max([len(name) for name, *_ in table], default=0)
        rows = [f"  {name:<{width}}  {with_std(value, std, unit)}" for name, value, std, unit, _ in table]
        state = "" if self.converged else "not converged, "
        head = (
            f"identification of {self.model.machine.name}: {state}rms {plain_number(self.rms_um)} {self.unit}, χ²/dof "
            f"{plain_number(self.chi2_dof)} against the declared noise, rank {self.rank} of {len(self.parameters)} parameters; "
            "± is 1σ"
        )
        excluded = [self.excluded] if self.excluded else []
        apart = listed(self.inseparable, "result.confounded")
        return "\n".join([head, *listed(rows, "result.table()"), *excluded, *apart])


def _rounded(values: Array) -> list[float]:
    return [float(f"{v:.9g}") for v in values]
