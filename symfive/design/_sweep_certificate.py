"""The certificate of sweeps: recordings compared with optimal seconds on a dense set of sweeps in the same mountings.

Seconds of any size on the sweeps of every mounting bound what recordings of as many seconds can reach (`_optimal_weights`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from symfive.design._assessment_data import six_digits
from symfive.design._circles import Goal
from symfive.design._optimal_weights import Offered, optimal_weights
from symfive.design._sweeps import Sweeps


@dataclass(frozen=True)
class SweepCertificate:
    """`efficiency` of recordings: at least this share of the best that weights of any size on `candidates` sweeps of these
    mountings can do in the same time (in variance, per parameter); `bound` the lowest ψ these have, `speeds` degree/s."""

    efficiency: float
    bound: float
    candidates: int
    speeds: tuple[float, ...]
    mountings: int = 1

    @property
    def says(self) -> str:
        """The certificate in one sentence."""
        share = math.floor(self.efficiency * 1e3) / 1e3
        speeds = ", ".join(f"{speed:g}" for speed in self.speeds)
        where = "this mounting" if self.mountings == 1 else f"these {self.mountings} mountings"
        return (
            f"efficiency ≥ {share:.3f} in the same recording time over {self.candidates} candidate sweeps in {where} at "
            f"{speeds} °/s (searched over a dense set, not proved)"
        )

    def to_data(self) -> dict[str, Any]:
        """The certificate in plan.json."""
        return {
            "says": self.says, "efficiency": six_digits(self.efficiency), "bound": six_digits(self.bound),
            "candidates": self.candidates, "speeds_deg_per_s": list(self.speeds), "rigour": "searched over a dense set",
        }  # fmt: skip


def certified(
    mounted: Sequence[Sweeps], goal: Goal, value: float, seconds: float, speeds: tuple[float, ...]
) -> SweepCertificate:
    """The certificate of recordings with ψ `value` in `seconds` altogether, against all sweeps that were evaluated."""
    bound, count = bound_of(mounted, goal, seconds), sum(len(sweeps.offered) for sweeps in mounted)
    return SweepCertificate(min(1.0, math.exp(bound - value)), bound, count, speeds, len(mounted))


def bound_of(mounted: Sequence[Sweeps], goal: Goal, seconds: float) -> float:
    """The lowest ψ of optimal seconds on all sweeps that were evaluated."""
    offered = [[sweep for _, _, sweep in sweeps.offered] for sweeps in mounted]
    offers = [
        Offered.of(some, np.array([sweep.seconds for sweep in some]), sweeps.own, sweeps.shared)
        for some, sweeps in zip(offered, mounted, strict=True)
    ]
    return optimal_weights(goal, offers, seconds)[1]
