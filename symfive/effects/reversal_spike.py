"""Reversal spike (quadrant glitch) by its shape in time, where no friction model is wanted (ISO 230-4 Annex B)."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from symfive.effects._base import Effect
from symfive.effects._form import Form, Forms, reversing
from symfive.motion import ReversalAhead, ReversalDistance, ReversalTime, Signal
from symfive.parameters import Parameter
from symfive.row import Row
from symfive.runs import Campaign

SHAPES = ("lag", "pulse", "stick")
TIMES_MS = (20.0, 60.0, 180.0)
"""Usual times, half a decade apart."""


@dataclass(frozen=True, kw_only=True)
class ReversalSpike(Effect):
    """A short deviation of the axis after each reversal, t the time since it, s the new direction.

    `shape`: `lag`, q → q - height·s·(t/τ)·exp(1 - t/τ): it hangs back, most at τ = `duration_ms`; `pulse`, q
    → q - height·s·exp(-((t - delay)/width)²), which may begin before the axis turns: with height < 0 the pulse of a
    friction compensation that comes too late; `stick`, q → q - s·min(path since the reversal, height·exp(-t/τ)): it stands still
    where it turned, breaks away, and recovers with τ = `duration_ms`, as a position loop does.
    Inside the loop friction makes such a spike by itself (`friction`); this one is only its shape. Typical
    1–15 µm, 20–200 ms.
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

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        """Looked at about several times after the reversal: readings are linear in the height only."""
        for axis in reversing(campaign):
            lag, pulse, stick = (cls(axis=axis, shape=shape) for shape in SHAPES)
            yield Form(effect=lag, shapes=(pulse, stick))
            for time in TIMES_MS:
                lasts = {f"{lag.key}.duration_ms": time}
                yield Form(effect=lag, shapes=(pulse, stick), at=lasts)
                yield Form(effect=stick, shapes=(lag, pulse), at=lasts)
                late = {f"{pulse.key}.delay_ms": time, f"{pulse.key}.width_ms": time}
                yield Form(effect=pulse, shapes=(lag, stick), at=late)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        axis = self.its_axis(campaign)
        most = {"lower": 0.0, "start": 0.5} if self.shape == "stick" else {}
        height = self.own("height", axis.error_unit, 50.0 if axis.rotary else 5.0, **most)
        if self.shape != "pulse":
            return (height, self.own("duration_ms", "ms", 60.0, mean=60.0, lower=1.0))
        return (
            height,
            self.own("delay_ms", "ms", 100.0, mean=100.0),
            self.own("width_ms", "ms", 50.0, mean=50.0, lower=1.0),
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
