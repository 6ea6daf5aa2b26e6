"""Reversal spike (quadrant glitch) by its shape in time, where no friction model is wanted (ISO 230-4 Annex B)."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from symfive.effects._axes import reversing
from symfive.effects._base import Campaign, Effect, Form, Forms, Parameter, Row
from symfive.motion import ReversalAhead, ReversalDistance, ReversalTime, Signal

SHAPES = ("lag", "pulse", "stick")
SHORTEST_MS, BRIEF = 20.0, 0.05
"""The time of a position loop, and the share of the time between two reversals up to which a spike is one: between them it is
looked for at times half a decade apart."""


@dataclass(frozen=True, kw_only=True)
class ReversalSpike(Effect):
    """A short deviation of the axis after each reversal, t the time since it, s the new direction.

    `shape`: `lag`, q → q - height·s·(t/τ)·exp(1 - t/τ): it hangs back, most at τ = `duration_ms`; `pulse`, q
    → q - height·s·exp(-((t - delay)/width)²), which may begin before the axis turns: with height < 0 the pulse of a
    friction compensation that comes too late; `stick`, q → q - s·min(path since the reversal, height·exp(-t/τ)): it stands still
    where it turned, breaks away, and recovers with τ = `duration_ms`, as a position loop does.
    Inside the loop friction makes such a spike by itself (`friction`); this one is only its shape. Typical 1–15 µm, and
    times about `usual_ms` (prior mean and 1σ).
    """

    id = "reversal_spike"
    stage = "axis"
    says = "a spike after each reversal"
    hidden_by = "Coulomb friction in the loop; backlash where the rows after a reversal are few"
    action = "set the friction compensation at reversal in the control"
    coordinate = "{axis} velocity sign"
    reported_as = "friction"
    needs_axis = True
    dynamic_only = True
    choices = (("shape", SHAPES),)
    shape: str = "lag"
    usual_ms: float = 60.0

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        """Looked at about several times after the reversal: readings are linear in the height only."""
        for axis in reversing(campaign):
            yield Form(effect=cls(axis=axis))
            for usual in _times_ms(campaign, axis):
                lag, pulse, stick = (cls(axis=axis, shape=shape, usual_ms=usual) for shape in SHAPES)
                lasts = {f"{lag.key}.duration_ms": usual}
                late = {f"{pulse.key}.delay_ms": usual, f"{pulse.key}.width_ms": usual}
                yield Form(effect=lag, shapes=(pulse, stick), at=lasts)
                yield Form(effect=stick, shapes=(lag, pulse), at=lasts)
                yield Form(effect=pulse, shapes=(lag, stick), at=late)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        axis, usual = self.its_axis(campaign), self.usual_ms
        most = {"lower": 0.0, "start": 0.5} if self.shape == "stick" else {}
        height = self.own("height", axis.error_unit, 50.0 if axis.rotary else 5.0, **most)
        if self.shape != "pulse":
            return (height, self.own("duration_ms", "ms", usual, mean=usual, lower=1.0))
        return (
            height,
            self.own("delay_ms", "ms", 1.5 * usual, mean=1.5 * usual),
            self.own("width_ms", "ms", usual, mean=usual, lower=1.0),
        )

    def signals(self) -> tuple[Signal, ...]:
        found: list[Signal] = [ReversalTime(str(self.axis))]
        if self.shape != "lag":
            found.append((ReversalAhead if self.shape == "pulse" else ReversalDistance)(str(self.axis)))
        return tuple(found)

    def apply(self, row: Row) -> None:
        height, axis = self.parameter(row, "height"), str(self.axis)
        since = row.signal(ReversalTime(axis))
        if self.shape != "pulse":
            part = ca.fabs(since) / self.parameter(row, "duration_ms")
            late = height * part * ca.exp(1.0 - part)
            if self.shape == "stick":
                late = ca.fmin(row.signal(ReversalDistance(axis)), height * ca.exp(-part))
            row.axis[axis] -= ca.sign(since) * late
            return
        delay, width = self.parameter(row, "delay_ms"), self.parameter(row, "width_ms")
        until = row.signal(ReversalAhead(axis))
        for sign, time in ((ca.sign(since), ca.fabs(since)), (ca.sign(until), -ca.fabs(until))):
            row.axis[axis] -= height * sign * ca.exp(-(((time - delay) / width) ** 2))


def _times_ms(campaign: Campaign, axis: str) -> list[float]:
    """At which spikes of an axis are looked for: those that its recordings resolve."""
    longest, rows = SHORTEST_MS, list[float]()
    for run in campaign.runs:
        way = np.sign(np.diff(run.commands[axis]))
        turns = int(np.sum(np.diff(way[way != 0.0]) != 0.0))
        if run.dynamic and turns:
            rows.append(1e3 * run.interval)
            longest = max(longest, BRIEF * 1e3 * run.duration / turns)
    first = max(SHORTEST_MS, min(rows, default=SHORTEST_MS))
    return [first * 10.0 ** (0.5 * k) for k in range(1 + int(2.0 * np.log10(max(longest / first, 1.0))))]
