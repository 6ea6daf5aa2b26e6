"""Stated priors as wide as the errors are: machine file and set-up sheet state what is usual, not what may be.

Each stated 1σ counts times one of the widths that amplitudes of effects have too, with the same prior. Otherwise an effect, which
may have any size, is named wherever it brings an error nearer to a prior that was stated too narrow. With the posterior N(x, C)
of a fit, in stated 1σ, the parameters G that share one have with width w instead of v

    log Z_w - log Z_v = -½·(log|I + δ·C_GG| + δ·x_Gᵀ(I + δ·C_GG)⁻¹x_G) - |G|·log(w/v),   δ = w⁻² - v⁻²

(D. MacKay 1992: hyperparameters by evidence). The largest gain is taken first, for errors far off draw others with them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from symfive.arrays import Array, Indices
from symfive.campaign import Campaign, Run
from symfive.identify import Identification
from symfive.parameters import Parameter
from symfive.posterior._noise import NEGLIGIBLE
from symfive.posterior._sweep import WIDTHS, log_width, nearest_width

__all__ = ["log_priors", "widened"]

Group = tuple[str, str]
"""What shares a stated 1σ: the run or mounting ("": the machine), and the error."""
FIELDS = {
    "table_ball": ("table_ball",), "tool_ball": ("tool_ball", "tool_length"), "length": ("length",), "plate": ("plate",),
}  # fmt: skip
"""Error of the set-up → the fields that state its 1σ."""


def widened(fit: Identification, stated: Campaign) -> Campaign:
    """The campaign of a fit with its `stated` priors as wide as the evidence has them; the same one where they are already."""
    first = now = _widths(fit.model.campaign, stated)
    groups = {g: np.array([i for i, p in enumerate(fit.parameters) if _group(p) == g], dtype=np.int64) for g in first}
    x, c = _posterior(fit, groups, now)
    while True:
        steps = [(_gain(x, c, groups[g], now[g], w), g, w) for g in groups for w in WIDTHS if w != now[g]]
        gain, group, width = max(steps, default=(0.0, ("", ""), 1.0))
        if gain < NEGLIGIBLE:
            return fit.model.campaign if now == first else _with(stated, now)
        x, c = _moved(x, c, groups[group], width**-2.0 - now[group] ** -2.0)
        now = {**now, group: width}


def log_priors(campaign: Campaign, stated: Campaign) -> float:
    """Log of the prior probability of how wide the priors of a campaign are, over that of the `stated` ones."""
    return sum(_log_prior(width) for width in _widths(campaign, stated).values())


def _log_prior(width: float) -> float:
    return log_width(width, WIDTHS) - log_width(1.0, WIDTHS)


def _group(p: Parameter) -> Group:
    return (p.owner_words, p.quantity.partition(".")[0]) if p.of_setup else ("", p.name.partition(".")[0])


def _sigmas(campaign: Campaign) -> dict[Group, float]:
    """The 1σ that machine and runs state."""
    found: dict[Group, float] = {("", name): term.sigma for name, term in campaign.machine.errors.items()}
    for run in campaign.runs:
        for what, (field, *_) in FIELDS.items():
            if sigma := getattr(run.setup_sigma_um, field):
                found[_owner(run, what), what] = sigma
    return found


def _owner(run: Run, what: str) -> str:
    """As `Parameter.owner_words` has it."""
    mounting = run.mounted(what)
    return run.id if mounting is None else f"mounting {mounting}"


def _widths(campaign: Campaign, stated: Campaign) -> dict[Group, float]:
    usual = _sigmas(stated)
    return {group: nearest_width(sigma / usual[group]) for group, sigma in _sigmas(campaign).items()}


def _with(stated: Campaign, widths: Mapping[Group, float]) -> Campaign:
    """The campaign with its stated priors so many times as wide."""
    errors = {n: replace(term, sigma=widths["", n] * term.sigma) for n, term in stated.machine.errors.items()}
    runs = list[Run]()
    for run in stated.runs:
        sigma, wider = run.setup_sigma_um, dict[str, Any]()
        for what, fields in FIELDS.items():
            width = widths.get((_owner(run, what), what), 1.0)
            wider |= {f: width * value for f in fields if (value := getattr(sigma, f)) is not None and width != 1.0}
        runs.append(replace(run, setup_sigma_um=replace(sigma, **wider)) if wider else run)
    return replace(stated, machine=replace(stated.machine, errors=errors), runs=tuple(runs))


def _posterior(
    fit: Identification, groups: Mapping[Group, Indices], widths: Mapping[Group, float]
) -> tuple[Array, Array]:
    """Estimates less prior means (k,) and covariance (k, k) of a fit, in stated 1σ; no covariance is larger than the prior's."""
    width = np.ones(len(fit.parameters))
    for group, where in groups.items():
        width[where] = widths[group]
    sigma = fit.model.prior_sigma
    size, axes = np.linalg.eigh(fit.covariance / np.outer(sigma, sigma))
    c = (axes * np.clip(size, 0.0, 1.0)) @ axes.T
    return width * (fit.values - fit.model.prior_mean) / sigma, c * np.outer(width, width)


def _gain(x: Array, c: Array, where: Indices, before: float, width: float) -> float:
    """By how many nats a width of the prior of some parameters is more probable than the one before."""
    if not len(where):
        return 0.0
    delta = width**-2.0 - before**-2.0
    a = np.eye(len(where)) + delta * c[np.ix_(where, where)]
    cost = np.linalg.slogdet(a)[1] + delta * x[where] @ np.linalg.solve(a, x[where])
    return float(-0.5 * cost - len(where) * np.log(width / before)) + _log_prior(width) - _log_prior(before)


def _moved(x: Array, c: Array, where: Indices, delta: float) -> tuple[Array, Array]:
    """Estimates and covariance when the prior precision of some parameters changes by `delta`."""
    gain = delta * np.linalg.solve(np.eye(len(where)) + delta * c[np.ix_(where, where)], c[where]).T
    return x - gain @ x[where], c - gain @ c[where]
