"""Isolated readings: instrument outliers, or physics confined to a few positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag
from scipy.special import betaln

from symfive.arrays import Array, Flags
from symfive.identify import Identification
from symfive.inference import Outlier
from symfive.posterior._evidence import Turned
from symfive.posterior._explore import BEAM, MOST, Posterior, Subset
from symfive.posterior._moments import Moments
from symfive.posterior._scale import least
from symfive.posterior._tables import Tables

__all__ = ["log_chance", "odd_readings"]

USUAL = 0.002
"""Mean share of outliers of instruments: 0 to 0.7 % of the readings in ten series of docs/recordings.md recorded at rest."""


def log_chance(fit: Identification, kappa2: float) -> float:
    """Log probability density of the readings that a fit excluded, in declared noise, where the noise has `kappa2` times its
    variance."""
    problem, left = fit.problem(fit.model), list[float]()
    for o in fit.outliers:
        k = [column.name for column in fit.model.columns(o.run)].index(o.column)
        left.append(float(fit.residuals[o.run][o.row, k] / fit.model.noise(o.run)[k]))
    less = sum(float(np.sum(np.log(weight))) for weight in fit.weights.values())
    return _log_chance(np.array(left), problem.readings, kappa2) + less


def _log_chance(left: Array, readings: int, kappa2: float) -> float:
    """Of k readings that lie `left` (k,) off, in declared noise, among so many.

    Which of them are outliers: a rate of which the prior is Beta(1, 1/`USUAL`); where they lie: a Cauchy distribution as wide as
    the noise. A reading that is kept has its Gauss factor in the evidence, but for 1/√2π.
    """
    k, rare = len(left), 1.0 / USUAL
    which = betaln(1.0 + k, rare + readings - k) - betaln(1.0, rare)
    where = 0.5 * k * np.log(2.0 / np.pi / kappa2) - np.sum(np.log1p(left**2 / kappa2))
    return float(which + where)


def odd_readings(posterior: Posterior) -> tuple[Outlier, ...]:
    """The readings at rest without which one of the best subsets is more probable than the best one with them, none if so: a
    reading is odd beside what else is there, and while it counts, it hides that."""
    fit, best, found = posterior.moments.fit, max(posterior.mass.values()), tuple[Outlier, ...]()
    if any(run.dynamic for run in fit.model.campaign.runs):
        return ()
    for subset in sorted(posterior.mass, key=lambda s: -posterior.mass[s])[:BEAM]:
        gain, odd = _Rows.of(posterior.moments, subset).without_odd()
        if odd and posterior.mass[subset] + gain > best:
            best, found = posterior.mass[subset] + gain, odd
    return found


@dataclass(frozen=True)
class _Rows:
    """Kept readings `y` (n,) in declared noise, and the `columns` (n, k) that these are linear in, each in units of its prior;
    `outliers` (n,) says which reading each is; `excluded` how many are already."""

    y: Array
    columns: Array
    outliers: tuple[Outlier, ...]
    excluded: int

    @classmethod
    def of(cls, moments: Moments, subset: Subset) -> _Rows:
        """Of the set-up, the geometry and a subset."""
        fit, held = moments.fit, moments.held
        fresh = [moments.terms[t].form for t, _ in subset if t >= held]
        tables = Tables(fit, [term.effect for term in moments.terms[:held]], fresh)
        order = iter(tables.columns[held:])
        members = [(tables.columns[t] if t < held else next(order), width) for t, width in subset]
        departure = np.concatenate([tables.departure, *(m.departure for m, _ in members)])
        shared, setups, every, outliers = list[Array](), list[Array](), list[Array](), list[Outlier]()
        lacking = held > sum(t < held for t, _ in subset)
        for run, table in zip(fit.model.campaign.runs, tables, strict=True):
            rows = table.alone if lacking and table.alone is not None else table.rows
            whole = np.zeros((*rows.shape[:2], tables.size))
            whole[:, :, table.where] = rows[:, :, table.setup :]
            own = [whole[:, :, m.where] * np.where(m.amplitude, width, 1.0) for m, width in members]
            columns = np.concatenate([whole[:, :, : tables.geometry], *own], axis=2)
            setup = rows[:, :, : table.setup]
            y = whole[:, :, -1] - sum(whole[:, :, m.exact] for m, _ in members if m.exact >= 0)
            y += setup @ table.departure + columns @ departure
            kept = tables.kept(run)
            shared.append(columns[kept])
            setups.append(setup[kept])
            every.append(y[kept])
            names = [column.name for column in fit.model.columns(run)]
            outliers += [Outlier(run.id, row, names[j], 0.0, 0.0) for row, j in tables.places(run)]
        columns = np.hstack([block_diag(*setups), np.concatenate(shared)])
        return cls(np.concatenate(every), columns, tuple(outliers), len(fit.outliers))

    def without_odd(self) -> tuple[float, tuple[Outlier, ...]]:
        """By how many nats the readings are more probable without the odd ones, and these: one after the other the least probable
        beside the rest is excluded."""
        kept, best, found = np.ones(len(self.y), dtype=bool), 0.0, tuple[Outlier, ...]()
        first, least = self._without(kept)
        for _ in range(min(MOST, len(kept) - 1)):
            kept[least] = False
            now, least = self._without(kept)
            if now - first > best:
                best, found = now - first, tuple(o for o, k in zip(self.outliers, kept, strict=True) if not k)
        return best, found

    def _without(self, kept: Flags) -> tuple[float, int]:
        """Log evidence of the kept readings under white noise and log chance of the others; which of the kept is the least
        probable beside the rest."""
        columns, y = self.columns[kept], self.y[kept]
        power, axes = np.linalg.eigh(columns.T @ columns)
        turned, power = self.columns @ axes, np.maximum(power, 0.0)
        g, q = y @ turned[kept], np.array([y @ y])
        form = Turned(power[None], g[None], q, np.zeros((1, len(g))), axes[None])
        (cost,), (kappa2,) = least(q / len(y), len(y), len(g), form.weighed)
        left = self.y - turned @ (g / (power + kappa2))
        share = 1.0 - turned[kept] ** 2 @ (1.0 / (power + kappa2))  # of its variance that the rest does not tell
        odd = left[kept] ** 2 / share / kappa2 - np.log(share)
        chance = _log_chance(left[~kept], self.excluded + len(self.y), kappa2)
        return float(-0.5 * cost + chance), int(np.flatnonzero(kept)[np.argmax(odd)])
