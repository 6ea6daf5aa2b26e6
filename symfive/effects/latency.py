"""Latency: the instrument's clock runs behind the control's (L. Andolfatto, S. Lavernhe & R. Mayer 2011)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from symfive.effects._base import INSTRUMENT, Campaign, Effect, Forms, Parameter, Run
from symfive.effects.sensor_low_pass import SensorLowPass
from symfive.instruments import has_clock_of_its_own

SIZES = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""In units of the usual one, up to a second, at which the readings are looked at."""


@dataclass(frozen=True, kw_only=True)
class Latency(Effect):
    """y(t) = y_true(t - delay): every position, velocity and state that the instrument sees is `delay` old.

    What the control records itself (encoder, drive force) keeps its time. Typical 1–20 ms; below 0 where
    recording was triggered before the motion.
    """

    id = "latency"
    stage = "drive"
    acts_in = INSTRUMENT
    says = "delay of the instrument's clock"
    hidden_by = "a servo mismatch of all axes alike; the set-up where only one direction was run"
    action = "synchronise the instrument with the control, or correct its time stamps; the machine needs no repair"
    coordinate = "t"
    dynamic_only = True

    def applies(self, run: Run) -> bool:
        return super().applies(run) and has_clock_of_its_own(run)

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        """While an axis accelerates the readings are far from linear in the delay: they are looked at about several delays, up to
        a quarter of the shortest run. A filter of the instrument is late too."""
        shortest = min(
            (run.duration for run in campaign.runs if run.dynamic and has_clock_of_its_own(run)), default=0.0
        )
        (delay,) = cls().parameters(campaign)
        sizes = [sign * times * delay.sigma for times in SIZES for sign in (1.0, -1.0)]
        yield from cls().forms_about(delay, [size for size in sizes if abs(size) <= 250.0 * shortest], SensorLowPass())

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return (self.own("delay_ms", "ms", 10.0),)

    def steps(self, campaign: Campaign) -> Mapping[str, float]:
        """A command is a chord between two rows: over one row and more the readings are smooth in the delay."""
        return {f"{self.key}.delay_ms": 1e3 * max(run.interval for run in campaign.runs if self.applies(run))}

    def frees(self) -> Mapping[tuple[str, str], str]:
        return {("", "delay"): f"{self.key}.delay_ms"}
