"""Bar temperature: the ball bar's length follows its temperature (ISO 230-4, 6; ISO/TR 230-9)."""

from __future__ import annotations

from dataclasses import dataclass

from symfive.effects._base import Campaign, Forms, Parameter, Row, Run
from symfive.effects._warming import Rising
from symfive.instruments import has_bar

CLOCKS = ("run", "campaign")


@dataclass(frozen=True, kw_only=True)
class BarTemperature(Rising):
    """length → length + amplitude·(1 - exp(-t/time_constant_s)); the reading falls by as much.

    `clock`: t since the run's start (a hand warmed it when it was set up) or on the campaign's clock. Typical
    0.1–1 µm/K for 300 mm of carbon fibre, 3.4 µm/K of steel; minutes.
    """

    id = "bar_temperature"
    stage = "reading"
    over_time = True
    says = "the bar grows or shrinks with its temperature"
    hidden_by = (
        "the bar's length, a drift of the tool (|cos| 0.96), unequal backlash, which is the other cause of a spiral"
    )
    action = "let the bar reach the machine's temperature, calibrate its length, repeat the test; the machine needs no repair"
    coordinate = "t"
    reported_as = "thermal_drift"
    choices = (("clock", CLOCKS),)
    clock: str = "run"

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        return list(cls().at_time_constants(campaign))

    def applies(self, run: Run) -> bool:
        return super().applies(run) and has_bar(run)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        longest = max([1.0, *(float(run.time[-1]) for run in campaign.runs if run.has_clock)])
        tau = 0.5 * (longest if self.clock == "run" else self.clock_span(campaign))
        return (self.own("amplitude", "um", 3.0), self.time_constant(tau))

    def apply(self, row: Row) -> None:
        time = row.time if self.clock == "run" else row.clock
        growth = self.parameter(row, "amplitude") * self.risen(row, time)
        row.add_reading("ball_bar", -growth)
