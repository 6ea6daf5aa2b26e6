"""Latency: the instrument's clock runs behind the control's (L. Andolfatto, S. Lavernhe & R. Mayer 2011)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from symfive.effects._base import INSTRUMENT, Effect
from symfive.instruments import has_clock_of_its_own
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.runs import Campaign, Run


@dataclass(frozen=True, kw_only=True)
class Latency(Effect):
    """y(t) = y_true(t - delay): every position, velocity and state that the instrument sees is `delay` old.

    What the control records itself (encoder, drive force) keeps its time. Typical 1–20 ms; below 0 where
    recording was triggered before the motion.
    """

    id = "latency"
    stage = "drive"
    says = "delay of the instrument's clock"
    hidden_by = "a servo mismatch of all axes alike; the set-up where only one direction was run"
    action = "synchronise the instrument with the control, or correct its time stamps; the machine needs no repair"
    coordinate = "time"
    dynamic_only = True

    @property
    def link(self) -> str:
        """The instrument is to blame."""
        return INSTRUMENT

    def applies(self, run: Run) -> bool:
        return super().applies(run) and has_clock_of_its_own(run)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return (self.own("delay_ms", "ms", 10.0),)

    def frees(self) -> Mapping[tuple[str, str], str]:
        return {("", "delay"): f"{self.key}.delay_ms"}
