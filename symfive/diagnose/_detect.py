"""Detection: tests for residuals that noise does not explain.

Four tests of one fit, independent of any effect:

* *lack of fit*, if runs are repeated: residual beyond their scatter, against that scatter (F test);
* *whiteness*: correlation of the whitened residual from row to row (G. Ljung & G. Box 1978);
* *tension with the priors*: how far the estimates lie from what was thought possible, in the directions that were learnt;
* *disagreement*: one parameter, given a value of its own in every group of runs (feeds, directions, places, …), as a score
  test that is orthogonal to everything else that is fitted. This is how a concealed effect shows when the residual is
  small: what absorbed it differs between the groups.

The data sheet's noise is a lower bound, not the truth: a residual above it alone is no mismatch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln
from scipy.stats import chi2, f

from symfive.arrays import Array, Indices
from symfive.campaign import Campaign
from symfive.diagnose._groups import partitions
from symfive.identify import Identification, identify, tensions
from symfive.numbers import with_std
from symfive.screen import OnScreen
from symfive.threads import one_thread

MAX_LAG = 20
SILENT = 1e-9
"""A group with less than this share of what all tell of a parameter says nothing of it."""


@dataclass(frozen=True)
class Test:
    """One test: its statistic, degrees of freedom, p-value (corrected for all that it looked at), and what its failing
    says."""

    name: str
    statistic: float
    dof: float
    p_value: float
    says: str


@dataclass(frozen=True)
class Disagreement:
    """A parameter whose value differs between groups of runs: its name, also in `words`; `between`: the property by which the
    runs are grouped (feed, direction, …); `values` label of a group → (value, 1σ) in the file's unit; `log_p` natural log of the
    p-value, corrected for all parameters and groups."""

    parameter: str
    words: str
    unit: str
    between: str
    values: Mapping[str, tuple[float, float]]
    log_p: float

    @property
    def says(self) -> str:
        """The disagreement in one sentence."""
        seen = ", ".join(f"{with_std(v, s, self.unit)} ({label})" for label, (v, s) in list(self.values.items())[:4])
        return f"{self.words} differs between groups of runs by {self.between}: {seen}"


@dataclass(frozen=True, repr=False)
class Detection(OnScreen):
    """Test results for the residuals of one fit. `level`: the false-alarm rate in clean campaigns."""

    fit: Identification
    level: float
    tests: tuple[Test, ...]
    disagreements: tuple[Disagreement, ...]

    @property
    def p_value(self) -> float:
        """The smallest of the tests' p-values, corrected for their number."""
        return min(1.0, len(self.tests) * min((t.p_value for t in self.tests), default=1.0))

    @property
    def mismatch(self) -> bool:
        """Whether any test fails at the level."""
        return self.p_value < self.level

    @property
    def says(self) -> str:
        """One sentence per test, failed tests first."""
        ordered = sorted(self.tests, key=lambda t: t.p_value)
        return " ".join(t.says for t in ordered if t.p_value * len(self.tests) < self.level) or (
            "Noise alone explains the residual."
        )

    def __str__(self) -> str:
        failed = self.level / max(len(self.tests), 1)
        words = [t.says if t.p_value < failed else "passes" for t in self.tests]
        tests = [f"{t.name:<24} p = {t.p_value:<9.3g} {w}" for t, w in zip(self.tests, words, strict=True)]
        return "\n".join([self.says, *tests])


@one_thread
def detect(
    campaign: Campaign | Identification, *, level: float = 0.01, progress: Callable[[str], None] = lambda message: None
) -> Detection:
    """Fit the baseline (or take a fit) and test its residuals.

    `level` is the false-alarm rate of all tests together. Raises `InputError` for a campaign without readings.
    """
    if isinstance(campaign, Identification):
        fit = campaign
    else:
        progress("fitting the baseline")
        fit = identify(campaign, noise="repeats")
    grams, whitened = _grams(fit)
    found, comparisons = _disagreements(fit, grams)
    strained = [Test(f"tension, {t.kind}", t.statistic, t.dof, t.p, t.says) for t in tensions(fit)]
    tests = [*_lack_of_fit(fit, whitened), _whiteness(whitened), *strained, *_agreement(found, comparisons)]
    limit = np.log(level)
    return Detection(fit, level, tuple(tests), tuple(d for d in found if d.log_p < limit))


@dataclass(frozen=True)
class _Gram:
    """Of one run: whitened [fitted columns | residual], `matrix` (k + 1, k + 1) at `where` in the fit's parameters."""

    where: Indices
    matrix: Array


def _grams(fit: Identification) -> tuple[dict[str, _Gram], dict[str, Array]]:
    """Of every run, and its whitened residual (N, fitted columns), outliers at 0."""
    problem, campaign = fit.problem(), fit.model.campaign
    size = len(fit.parameters)
    wholes = {run.id: np.zeros((size + 1, size + 1)) for run in campaign.runs}
    used: dict[str, set[int]] = {run.id: {size} for run in campaign.runs}
    parts: dict[tuple[str, str], list[Array]] = {}
    for key, block, white in problem.whitened_at(fit.values):
        parts.setdefault(key, []).append(white[:, :, -1].copy())
        flat = white.reshape(-1, white.shape[2])
        where = np.append(block.columns, size)
        wholes[key[0]][np.ix_(where, where)] += flat.T @ flat
        used[key[0]] |= set(where.tolist())
    grams, residuals = {}, {}
    for run in campaign.runs:
        kept = np.array(sorted(used[run.id]), dtype=np.int64)
        grams[run.id] = _Gram(kept, wholes[run.id][np.ix_(kept, kept)])
        columns = [np.concatenate(parts[run.id, name]) for name, _ in problem.parts(run)]
        residuals[run.id] = np.concatenate(columns, axis=1)
    return grams, residuals


def _total(grams: Sequence[_Gram], size: int) -> Array:
    total = np.zeros((size + 1, size + 1))
    for gram in grams:
        total[np.ix_(gram.where, gram.where)] += gram.matrix
    return total


def _lack_of_fit(fit: Identification, whitened: Mapping[str, Array]) -> list[Test]:
    """F test of lack of fit: residual beyond the scatter of repeated runs, against that scatter (R. A. Fisher 1922)."""
    groups = fit.model.campaign.repeats
    pure, square = 0.0, 0.0
    for group in groups:
        each = np.stack([whitened[run] for run in group])
        square += float(np.sum((each - each.mean(axis=0)) ** 2))
        pure += (len(group) - 1) * (each[0].size - sum(_learnt(fit, run) for run in group) / len(group))
    rest = fit.dof - pure
    if pure < 1.0 or rest < 1.0 or square <= 0.0:
        return []
    whole = sum(float(np.sum(table**2)) for table in whitened.values())
    ratio = max(whole - square, 0.0) / rest / (square / pure)
    runs = sum(map(len, groups))
    says = f"The mean of {runs} repeated runs deviates from the model {np.sqrt(ratio):.3g} times as far as their scatter allows."
    return [Test("lack of fit", ratio, rest, float(f.sf(ratio, rest, pure)), says)]


def _learnt(fit: Identification, run: str) -> float:
    """Effective number of set-up parameters that the readings of a run determine."""
    own = [i for i, p in enumerate(fit.parameters) if p.run == run]
    return float(np.sum(1.0 - np.diag(fit.covariance)[own] / fit.model.prior_sigma[own] ** 2))


def _whiteness(whitened: Mapping[str, Array]) -> Test:
    """Ljung–Box over all recordings together, each column on its own."""
    statistic, dof = 0.0, 0
    for white in whitened.values():
        n = len(white)
        lags = min(MAX_LAG, n // 5)
        for column in (white - white.mean(axis=0)).T:
            power = float(column @ column)
            if lags < 1 or power <= 0.0:
                continue
            rho = np.array([column[k:] @ column[:-k] for k in range(1, lags + 1)]) / power
            statistic += n * (n + 2.0) * float(np.sum(rho**2 / (n - np.arange(1, lags + 1))))
            dof += lags
    p = float(chi2.sf(statistic, dof)) if dof else 1.0
    return Test(
        "whiteness",
        statistic,
        dof,
        p,
        "The residual is correlated from row to row: the noise model does not explain it.",
    )


def _agreement(found: Sequence[Disagreement], comparisons: int) -> list[Test]:
    if not comparisons:
        return []
    worst = min(found, key=lambda d: d.log_p)
    p = float(np.exp(min(0.0, worst.log_p)))
    return [Test("agreement of groups", float(comparisons), float(comparisons), p, worst.says + ".")]


def _disagreements(fit: Identification, grams: Mapping[str, _Gram]) -> tuple[list[Disagreement], int]:
    """Every machine parameter between all groups of every way to part the runs, worst first; how many were looked at."""
    size = len(fit.parameters)
    total = _total(list(grams.values()), size)
    a = total[:size, :size] + np.diag(fit.model.prior_sigma**-2.0)
    inverse = np.asarray(np.linalg.inv(a))
    found = []
    for between, groups in partitions(fit.model.campaign).items():
        parts = {label: _total([grams[id] for id in ids], size) for label, ids in groups.items()}
        for i, parameter in enumerate(fit.parameters):
            if not parameter.of_setup:
                one = _one(fit, i, parts, inverse, a)
                if one is not None:
                    log_p, values = one
                    found.append(Disagreement(parameter.name, parameter.words, parameter.unit, between, values, log_p))
    comparisons = len(found)
    corrected = [replace(d, log_p=min(0.0, d.log_p + float(np.log(comparisons)))) for d in found]
    return sorted(corrected, key=lambda d: d.log_p), comparisons


def _one(
    fit: Identification, i: int, parts: Mapping[str, Array], inverse: Array, a: Array
) -> tuple[float, dict[str, tuple[float, float]]] | None:
    """Score test of a departure of parameter `i` in every group but the first, and its values in all groups."""
    size = len(fit.parameters)
    whole = sum(part[i, i] for part in parts.values())
    labels = [label for label, part in parts.items() if part[i, i] > SILENT * whole]
    if len(labels) < 2:  # one group alone tells of it: it is the parameter itself
        return None
    rows = np.array([parts[label][i, :size] for label in labels[1:]])
    own = np.array([parts[label][i, i] for label in labels[1:]])
    pull = np.array([parts[label][i, size] for label in labels[1:]])
    gradient = sum(part[:size, size] for part in parts.values())
    gradient = gradient - (fit.values - fit.model.prior_mean) / fit.model.prior_sigma**2
    h = np.diag(own) - rows @ inverse @ rows.T
    s = pull - rows @ inverse @ gradient
    sigma = fit.parameters[i].sigma
    scaled = h * sigma**2
    solution = np.linalg.solve(scaled + np.eye(len(s)), s * sigma)
    drop = float((s * sigma) @ solution)
    seen = np.maximum(np.linalg.eigvalsh(scaled), 0.0)
    dof = float(np.sum(seen / (1.0 + seen)))
    if dof < 0.5:
        return None
    wide = np.block([[a, rows.T], [rows, np.diag(own + sigma**-2.0)]])
    right = np.concatenate([gradient, pull])
    covariance = np.linalg.inv(wide)
    step = covariance @ right
    values = {}
    for k, label in enumerate(labels):
        pick = np.zeros(size + len(s))
        pick[i] = 1.0
        if k:
            pick[size + k - 1] = 1.0
        values[label] = (float(fit.values[i] + pick @ step), float(np.sqrt(pick @ covariance @ pick)))
    return log_tail(drop, dof), values


def log_tail(drop: float, dof: float) -> float:
    """log P(χ² > drop); far out by its leading term (M. Abramowitz & I. Stegun 1964, 26.4.12), where it is below the least
    number that is not 0."""
    exact = float(chi2.logsf(drop, dof))
    if np.isfinite(exact):
        return exact
    return float((0.5 * dof - 1.0) * np.log(0.5 * drop) - 0.5 * drop - gammaln(0.5 * dof))
