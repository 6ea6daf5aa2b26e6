"""Transmission error: a periodic error of worm, gear, ball screw or encoder (ISO 230-1, 8.3; ISO 230-2)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from symfive.effects._axes import moving
from symfive.effects._base import AXIS, Campaign, Form, Forms, Parameter, Row, Tone
from symfive.effects._periodic import CYCLES, Periodic, reach_and_shortest

RICHER, MULTIPLES = (2, 3, 8, 16), ((2, 2), (2, 4), (3, 3))
"""Numbers of harmonics of other shapes; multiples of a period that was found (the largest harmonic need not be the first), each
with its harmonics."""


@dataclass(frozen=True, kw_only=True)
class TransmissionError(Periodic):
    """q → q + Σ amplitude_n·sin(2πn·q/period + phase_n), n = 1…`harmonics`, at the output of the drive.

    Estimated as amplitudes of sine and cosine, so that it is linear but for the period, which is close to
    `period` (mm or degree; 1σ `period_sigma`, default 0.2 % of it; 0: known and fixed, as by the number of
    teeth).

    Typical 0.5–5 µm at the pitch of a screw, 15–100 µrad per tooth of a worm; an encoder's subdivision error
    is at most 1 % of its signal period (20 or 200 µm).
    """

    id = "transmission_error"
    stage = "axis"
    says = "periodic error of worm, gear, screw or encoder"
    hidden_by = "straightness where the period is near the circle's diameter; vibration where only one feed was run"
    action = "check screw, worm, gear and encoder for a part with this period; enter it in the error table of the axis"
    coordinate = "{axis}"
    period_sigma: float | None = None

    @property
    def _sigma(self) -> float:
        return 2e-3 * self.period if self.period_sigma is None else self.period_sigma

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        for axis in moving(campaign):
            reach, shortest = reach_and_shortest(campaign.runs, axis)
            # what is seen once may be a turn of a rotary axis; along a line it is a bow
            longest = reach if campaign.machine.axes[axis].rotary else reach / CYCLES

            def form(cycles: float, resolution: float, places: int, axis: str = axis, longest: float = longest) -> Form:
                period, sigma = 1.0 / cycles, 0.5 * resolution / cycles**2
                plain = cls(axis=axis, period=period, period_sigma=sigma)
                richer = [replace(plain, harmonics=n) for n in RICHER]
                richer += [
                    replace(plain, period=m * period, period_sigma=m * sigma, harmonics=n)
                    for m, n in MULTIPLES
                    if m * period <= longest
                ]
                return Form(effect=plain, shapes=tuple(richer), places=places)

            if reach > CYCLES * shortest:
                yield Tone(
                    channel=AXIS, axis=axis, coordinate=lambda run, axis=axis: np.asarray(run.commands[axis]),  # type: ignore[misc]
                    lowest=1.0 / longest, highest=1.0 / shortest, form=form,
                )  # fmt: skip

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        axis = self.its_axis(campaign)
        small, sigma = ("urad", 100.0) if axis.rotary else ("um", 5.0)
        return self.series(campaign, small, sigma)

    def apply(self, row: Row) -> None:
        for term in self.sines(row):
            row.axis[str(self.axis)] += term
