"""Tension with the priors: how far the estimates lie from what was thought possible, in the directions that were learnt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincc

from symfive.identify._result import Identification
from symfive.instruments import has_bar
from symfive.parameters import Parameter

TENSE = 1e-3
"""p-value at which it is said: one of a thousand machines and set-ups that are as their priors say."""


@dataclass(frozen=True)
class Tension:
    """The distance of the `kind` of parameters (`machine`, `set-up`) from their prior means, as χ² `statistic` of `dof`, and its
    p-value; `worst` is the furthest parameter, by so many `sigmas` of its prior."""

    kind: str
    statistic: float
    dof: float
    p: float
    worst: Parameter
    sigmas: float

    @property
    def says(self) -> str:
        """In one sentence."""
        return (
            f"The {self.kind} errors are further from their priors than expected: {self.words} by {self.sigmas:.1f} σ."
        )

    @property
    def words(self) -> str:
        """The worst of them, as `clock of run ccw`."""
        return self.worst.words


def tensions(fit: Identification) -> tuple[Tension, ...]:
    """The estimates' distance from the prior means, in units of what was expected of it, machine and set-up apart; an effect
    is as large as it is.

    Before the data, an estimate is spread about the prior mean with covariance P - C (prior less posterior).
    """
    found = []
    sigma, mean = fit.model.prior_sigma, fit.model.prior_mean
    free = [i for i, std in enumerate(fit.std) if std > 0.0 and fit.parameters[i].kind != "effect"]
    kinds = {"machine": [i for i in free if not fit.parameters[i].of_setup],
             "set-up": [i for i in free if fit.parameters[i].of_setup]}  # fmt: skip
    for kind, places in kinds.items():
        if not places:
            continue
        away = (fit.values - mean)[places] / sigma[places]
        learnt = np.eye(len(places)) - fit.covariance[np.ix_(places, places)] / np.outer(sigma[places], sigma[places])
        size, directions = np.linalg.eigh(learnt)
        kept = size > 0.5  # learnt more than half: a direction about which the data speak
        if not kept.any():
            continue
        parts = (directions[:, kept].T @ away) ** 2 / size[kept]
        furthest, dof = int(np.argmax(np.abs(away))), float(kept.sum())
        p = float(gammaincc(0.5 * dof, 0.5 * float(parts.sum())))
        worst = fit.parameters[places[furthest]]
        found.append(Tension(kind, float(parts.sum()), dof, p, worst, float(abs(away[furthest]))))
    return tuple(found)


def tension_notes(fit: Identification) -> tuple[str, ...]:
    """What to look at where a fit explains its readings by errors that were thought impossible; nothing elsewhere."""
    worst = _worst(fit)
    if worst is None:
        return ()
    return (
        f"{worst.words} is {worst.sigmas:.1f} prior 1σ from its prior mean: check {_setup(fit, worst)} before a correction is "
        "entered; if the machine is that far off, enlarge the prior in the machine file",
    )


def relief_notes(plain: Identification, full: Identification) -> tuple[str, ...]:
    """Said where `full` explains the readings hardly better than `plain`, and only brings geometry and set-up nearer to their
    priors: then a ball that stands elsewhere does as well. Not where the readings refute `plain` by themselves."""
    worst = _worst(plain)
    readings = plain.chi2_dof_whitened * plain.dof - full.chi2_dof_whitened * full.dof
    refuted = gammaincc(0.5 * plain.dof, 0.5 * plain.dof * plain.chi2_dof_whitened / full.chi2_dof_whitened) < TENSE
    if worst is None or refuted or _distance(plain) - _distance(full) < readings:
        return ()
    return (
        f"The readings are explained nearly as well without: what speaks for it is that {worst.words} would otherwise be "
        f"{worst.sigmas:.1f} prior 1σ from its prior mean. Check first {_setup(plain, worst)}.",
    )


def _setup(fit: Identification, worst: Tension) -> str:
    """What a set-up may have wrong: an uncalibrated bar looks like a scale error of both axes of its circle."""
    if worst.worst.name.endswith((".clock", ".clock_drift")):
        return "the angles or times of the recording (clock_sigma_ms in campaign.toml)"
    bar = any(has_bar(run) for run in fit.model.campaign.runs)
    where = "where balls and nests stand (table_ball, tool_ball"
    return f"{where}{') and how long the bar is (length' if bar else ''}; setup_sigma_um in campaign.toml)"


def _worst(fit: Identification) -> Tension | None:
    tense = (tension for tension in tensions(fit) if tension.p < TENSE)
    return max(tense, key=lambda tension: tension.sigmas, default=None)


def _distance(fit: Identification) -> float:
    """Squared distance of all parameters from their prior means, by their prior 1σ."""
    return float(np.sum(((fit.values - fit.model.prior_mean) / fit.model.prior_sigma) ** 2))
