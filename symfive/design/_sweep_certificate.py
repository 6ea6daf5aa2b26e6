"""The certificate of sweeps: recordings compared with optimal seconds on a dense set of sweeps in the same mountings.

Seconds w on the sweeps i of every mounting m, Σ w = T, add Σ w Mᵢ/tᵢ. As for poses and circles (`_relaxed`,
`_circle_certificate`; Kiefer & Wolfowitz 1960, Pukelsheim 1993, ch. 7), whatever w is,

    ψ ≥ ψ(w) - log(⟨G, P⟩ + T · max over sweeps of ⟨G, Mᵢ⟩/tᵢ),   G = -dψ/dM, P the prior's information,

and of several mountings every sweep meets only the block of G of its own parameters, whose set-up errors are no other's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from symfive.arrays import Array
from symfive.design._assessment_data import six_digits
from symfive.design._circles import Goal
from symfive.design._sweeps import Sweeps

__all__ = ["SweepCertificate", "certified", "together"]

STEPS, GAP = 1000, 2e-3


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
    bound = _bound(mounted, goal, seconds)
    count = sum(len(sweeps.offered) for sweeps in mounted)
    return SweepCertificate(min(1.0, math.exp(bound - value)), bound, count, speeds, len(mounted))


def together(mounted: Sequence[Sweeps], goal: Goal, totals: Sequence[Array]) -> list[Goal]:
    """For every mounting the goal that knows what the recordings of the others tell, by their information `totals` (k, k)."""
    told = [sweeps.shared(total) for sweeps, total in zip(mounted, totals, strict=True)]
    return [replace(goal, known=goal.known + sum(told[:i]) + sum(told[i + 1 :])) for i in range(len(told))]


def _bound(mounted: Sequence[Sweeps], goal: Goal, seconds: float) -> float:
    """The lowest ψ of any weights, by multiplicative steps (D. M. Titterington 1976)."""
    k = len(goal.scale)
    offered = [[sweep for _, _, sweep in sweeps.offered] for sweeps in mounted]
    rates = [np.array([sweep.matrix.ravel() / sweep.seconds for sweep in some]) for some in offered]
    weights = [np.full(len(some), seconds / sum(map(len, offered))) for some in offered]
    power, bound, reached = 1.0 if goal.criterion.determinant else 0.5, -math.inf, math.inf
    for _ in range(STEPS):
        totals = [(w @ r).reshape(k, k) for w, r in zip(weights, rates, strict=True)]
        goals = together(mounted, goal, totals)
        psi = goals[0].psi(totals[0])
        pulls = [own.pull(total) for own, total in zip(goals, totals, strict=True)]
        prior = float(np.sum(pulls[0] * (np.diag(goal.scale**-2.0) + goal.known)))
        prior += sum(
            float(np.diag(pull)[sweeps.own] @ goal.scale[sweeps.own] ** -2.0)
            for pull, sweeps in zip(pulls[1:], mounted[1:], strict=True)
        )
        seen = [np.maximum(r @ pull.ravel(), 0.0) for r, pull in zip(rates, pulls, strict=True)]
        bound = max(bound, psi - math.log(prior + seconds * max(float(s.max()) for s in seen)))
        reached = min(reached, psi)
        if reached - bound < GAP:
            break
        weights = [w * s**power for w, s in zip(weights, seen, strict=True)]
        whole = sum(float(w.sum()) for w in weights)
        weights = [w * (seconds / whole) for w in weights]
    return bound
