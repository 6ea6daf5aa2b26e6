"""Scale error of a linear axis: positioning error growing with travel (ISO 230-2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from symfive.effects._base import Campaign, Effect, Parameter, Row
from symfive.errors import InputError
from symfive.motion import Position


@dataclass(frozen=True, kw_only=True)
class ScaleError(Effect):
    """q → q + ppm·(q - at), `at` (mm) where the scale or screw is fixed. Typical 5–25 ppm.

    Effect `axis_growth` is one that comes as the axis warms up.
    """

    id = "scale_error"
    stage = "axis"
    says = "positioning error growing with travel"
    hidden_by = "the bar's length and the other axes' scale: a ball bar reads only their difference"
    action = "check the scale or the screw and its temperature; enter it in the pitch-error compensation of the control"
    terms = (("ppm", ""),)
    coordinate = "{axis}"
    needs_axis = True
    at: float = 0.0

    def prepare(self, campaign: Campaign) -> Self:
        super().prepare(campaign)
        axis = self.its_axis(campaign)
        if axis.rotary:
            raise InputError(f"{self.key}: a rotary axis has no scale error", remedy="use transmission_error")
        for letter, part in zip("XYZ", axis.direction, strict=True):
            term = campaign.machine.errors.get(f"E{letter}{axis.name}")
            spans = term is not None and term.over == (axis.name,) and term.basis[0] in ("polynomial", "bspline")
            if abs(part) > 0.999 and spans:
                raise InputError(
                    f"the baseline already varies the scale of {axis.name} with E{letter}{axis.name}",
                    remedy="use axis_growth for one that comes with time",
                )
        return self

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        return (self.own("ppm", "ppm", 20.0),)

    def apply(self, row: Row) -> None:
        distance = row.signal(Position(str(self.axis))) - self.at
        row.axis[str(self.axis)] += self.parameter(row, "ppm") * distance
