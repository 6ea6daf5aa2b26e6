"""Bar length: the ball bar is not as long as stated (ISO 230-4: a bar whose length is not calibrated)."""

from __future__ import annotations

from dataclasses import dataclass

from symfive.effects._base import Campaign, Effect, Form, Forms, Parameter, Row, Run
from symfive.instruments import has_bar


@dataclass(frozen=True, kw_only=True)
class BarLength(Effect):
    """length → length + error in all runs, beyond the 1σ that the campaign states; the reading falls by as much.

    Usual size: 20 µm, as of a ball that is placed by hand. A calibrated bar is known to 0.5 µm.
    """

    id = "bar_length"
    stage = "reading"
    says = "the bar is longer or shorter than stated, by more than its stated uncertainty"
    hidden_by = "scale errors of all axes at once; circles of two radii separate them"
    action = (
        "calibrate the bar, or correct its length or the 1σ of it (setup_sigma_um.length); the machine needs no repair"
    )
    coordinate = "reading"
    reported_as = "sensor_error"

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        return [Form(effect=cls())]

    def applies(self, run: Run) -> bool:
        return super().applies(run) and has_bar(run)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return (self.own("error", "um", 20.0),)

    def apply(self, row: Row) -> None:
        row.add_reading("ball_bar", -self.parameter(row, "error"))
