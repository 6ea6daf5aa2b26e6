"""Structural resonance: a lightly damped vibration excited by the motion (ISO/TR 230-8)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.effects._axes import moving
from symfive.effects._base import TOOL, Campaign, Effect, Form, Forms, Parameter, Row, Run, Scan
from symfive.effects._quantity import Covariance, Quantity, Values, length_and_direction, own_quantity
from symfive.errors import InputError
from symfive.motion import FINE_S, Resonance, RunMotion, Signal

LOWEST_HZ, HIGHEST_HZ, SPACING = 5.0, 120.0, 1.08
"""Where a mode of a structure is looked for; one that is off by its damping still rings in step."""


@dataclass(frozen=True, kw_only=True)
class StructuralResonance(Effect):
    """ÿ + 2ζω ẏ + ω² y = -a(t) with the axis' acceleration a; shift of the tool = participation·y, three
    components.

    The participation says how much of the mode the axis drives (1: all of it); on a rotary axis it is a lever
    in mm. f near `frequency_hz`, ζ near `damping`. Typical 20–80 Hz, ζ 0.02–0.1, 1–10 µm at corners and
    reversals.
    """

    id = "structural_resonance"
    says = "a lightly damped vibration excited by the motion"
    hidden_by = "vibration of the floor where damping is small; reversal spikes"
    action = "reduce the jerk, or set a filter at this frequency in the control; check the mounting of the machine"
    coordinate = "{axis} acceleration"
    needs_axis = True
    dynamic_only = True
    frequency_hz: float
    damping: float = 0.05

    def prepare(self, campaign: Campaign) -> Self:
        if not (self.frequency_hz > 0.0 and math.isfinite(self.frequency_hz) and 0.0 < self.damping < 1.0):
            raise InputError(
                f"effect {self.id} needs a frequency above 0 and a damping between 0 and 1",
                remedy="write frequency_hz = 30.0, damping = 0.05",
            )
        return super().prepare(campaign)

    @property
    def _names(self) -> tuple[str, ...]:
        return tuple(f"{self.key}.participation.{c}" for c in "xyz")

    def _unit(self, campaign: Campaign) -> str:
        return "mm" if self.its_axis(campaign).rotary else "1"

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        runs = [run for run in campaign.runs if run.dynamic]
        for axis in moving(campaign) if runs else ():
            count = int(math.log(HIGHEST_HZ / LOWEST_HZ) / math.log(SPACING)) + 1
            frequencies = LOWEST_HZ * SPACING ** np.arange(count)

            def form(k: int, axis: str = axis, frequencies: Any = frequencies) -> Form:
                return Form(effect=cls(axis=axis, frequency_hz=float(frequencies[k])), places=len(frequencies))

            def courses(run: Run, axis: str = axis, frequencies: Any = frequencies) -> Any:
                if not run.dynamic or np.ptp(run.commands[axis]) == 0.0:
                    return np.zeros((run.rows, len(frequencies)))
                acceleration, rows, step = RunMotion(run, campaign.machine, {}, {}).fine_acceleration(axis, FINE_S)
                return np.stack([_ringing(acceleration.value, f, cls.damping, step)[rows] for f in frequencies], axis=1)

            yield Scan(channel=TOOL, count=count, courses=courses, form=form)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        sigma = 100.0 if self.its_axis(campaign).rotary else 1.0
        found = [self.own(f"participation.{c}", self._unit(campaign), sigma) for c in "xyz"]
        frequency, damping = self.frequency_hz, self.damping
        found.append(self.own("frequency_hz", "Hz", 0.1 * frequency, mean=frequency, lower=0.3 * frequency))
        found.append(self.own("damping", "1", damping, mean=damping, lower=0.05 * damping, upper=0.95))
        return tuple(found)

    def signals(self) -> tuple[Signal, ...]:
        return (Resonance(str(self.axis), f"{self.key}.frequency_hz", f"{self.key}.damping"),)

    def apply(self, row: Row) -> None:
        row.shift += ca.vertcat(*(row.parameter(name) for name in self._names)) * row.signal(self.signals()[0])

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        *_, frequency, damping = self.parameters(campaign)
        size, direction = length_and_direction(self._names, self._unit(campaign), values, covariance)
        return {
            "frequency_hz": own_quantity(frequency, values, covariance),
            "damping": own_quantity(damping, values, covariance),
            "participation": size,
            "direction": direction,
        }


def _ringing(acceleration: Array, frequency: float, damping: float, step: float) -> Array:
    """What a mode does beyond bending in proportion to the acceleration, which is an inertial compliance."""
    from scipy.signal import cont2discrete, lfilter

    omega = 2.0 * math.pi * frequency
    mode = ([-1.0], [1.0, 2.0 * damping * omega, omega**2])
    numerator, denominator, _ = cont2discrete(mode, step, method="foh")
    return np.asarray(lfilter(numerator.ravel(), denominator, acceleration) + acceleration / omega**2)
