"""A thousand machines: what the paper's sequence and the joint estimate make of the same readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign
from symfive.model import Model

from .estimators import SLOPES, Joint, Sequence, noisy
from .machine import draw, readings_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Fate:
    """Errors of estimate over many machines by parameter name, µm and µrad.

    `bias` and `spread` (mean and 1σ) of both methods, `stated` the 1σ that the joint estimate claims, `flat` its rms error
    with the machine's priors a hundred times as wide, `prior` their 1σ.
    """

    bias: Mapping[str, tuple[float, float]]
    spread: Mapping[str, tuple[float, float]]
    flat: Mapping[str, float]
    stated: Mapping[str, float]
    prior: Mapping[str, float]
    count: int

    def gain(self, name: str) -> float:
        """1σ of the sequence over 1σ of the joint estimate."""
        sequence, joint = self.spread[name]
        return sequence / joint

    def largest_bias(self, method: int) -> float:
        """Largest |bias| of all errors in 1σ of the mean, of the sequence (0) or the joint estimate (1)."""
        ratio = (abs(self.bias[n][method]) / self.spread[n][method] for n in self.spread)
        return max(ratio) * float(np.sqrt(self.count))

    @property
    def honest(self) -> float:
        """Largest of |actual / stated 1σ - 1| of the joint estimate."""
        return max(abs(self.spread[n][1] / self.stated[n] - 1.0) for n in self.spread)


def compare(campaign: Campaign, *, count: int = 1000, seed: int = 41) -> Fate:
    """Draw machines and set-ups from their priors, read them exactly with the paper's noise and estimate them both ways.

    By the paper's convention straightness has no slope beside the three squarenesses.
    """
    model = Model(campaign)
    values = draw(model.parameters, count, seed, truth=dict.fromkeys(SLOPES, 0.0))
    truth = {p.name: values[:, i] for i, p in enumerate(model.parameters)}
    readings = noisy(readings_of(campaign, truth, count), seed + 1)
    joint, flat = Joint.of(campaign), Joint.of(campaign, wide=100.0)
    by_sequence, at_once, widely = (
        Sequence(campaign).estimate(readings),
        joint.estimate(readings),
        flat.estimate(readings),
    )
    names = list(by_sequence)
    errors = {n: (by_sequence[n] - truth[n], at_once[n] - truth[n]) for n in names}
    return Fate(
        bias={n: (float(a.mean()), float(b.mean())) for n, (a, b) in errors.items()},
        spread={n: (float(a.std()), float(b.std())) for n, (a, b) in errors.items()},
        flat={n: float(np.sqrt(np.mean((widely[n] - truth[n]) ** 2))) for n in names},
        stated={n: joint.sigma[n] for n in names},
        prior={n: model.parameters[model.index[n]].sigma for n in names},
        count=count,
    )


def raw_slopes(campaign: Campaign, *, count: int = 200, seed: int = 43) -> dict[str, float]:
    """Rms error, µrad, of the squarenesses as plain slopes of the corner, without noise: what the levers put into them."""
    model = Model(campaign)
    values = draw(model.parameters, count, seed, truth=dict.fromkeys(SLOPES, 0.0))
    truth = {p.name: values[:, i] for i, p in enumerate(model.parameters)}
    corners = campaign.select(*(run.id for run in campaign.runs if run.id.startswith("square-")))
    readings, nominal = readings_of(corners, truth, count), readings_of(corners, {}, 1)
    found = Sequence(corners).squareness({run: y - nominal[run] for run, y in readings.items()})
    return {name: float(np.sqrt(np.mean((found[name] - truth[name]) ** 2))) for name in found}
