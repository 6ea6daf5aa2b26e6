"""Scale error of a linear axis: positioning error growing with travel (ISO 230-2; ISO 230-3 for its growth)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import casadi as ca

from symfive.effects._base import Effect
from symfive.effects._form import Form, Scan, Tone, moving
from symfive.errors import InputError
from symfive.motion import Position
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.row import Row
    from symfive.runs import Campaign


@dataclass(frozen=True, kw_only=True)
class ScaleError(Effect):
    """q → q + ppm·(q - at), `at` (mm) where the scale or screw is fixed.

    With `growth` it is the thermal growth of a ball screw, ppm·(1 - exp(-t/time_constant_s))·(q - at) on the
    campaign's clock. Typical 5–25 ppm; a steel screw grows by 11.5 ppm/K, 10–100 µm/h at its free end.
    """

    id = "scale_error"
    stage = "axis"
    says = "positioning error growing with travel"
    hidden_by = "the bar's length and the other axes' scale: a ball bar reads only their difference"
    coordinate = "{axis}"
    needs_axis = True
    at: float = 0.0
    growth: bool = False

    @property
    def over_time(self) -> bool:  # type: ignore[override]
        """Whether it grows with time."""
        return self.growth

    def prepare(self, campaign: Campaign) -> Self:
        super().prepare(campaign)
        axis = self.its_axis(campaign)
        if axis.rotary:
            raise InputError(f"{self.key}: a rotary axis has no scale error", remedy="use transmission_error")
        for letter, part in zip("XYZ", axis.direction, strict=True):
            term = campaign.machine.errors.get(f"E{letter}{axis.name}")
            spans = term is not None and term.over == (axis.name,) and term.basis[0] in ("polynomial", "bspline")
            if abs(part) > 0.999 and spans and not self.growth:
                raise InputError(
                    f"the baseline already varies the scale of {axis.name} with E{letter}{axis.name}",
                    remedy="use growth = true for one that grows with time",
                )
        return self

    @classmethod
    def candidates(cls, campaign: Campaign) -> Iterable[Form | Scan | Tone]:
        yield from (Form(effect=cls(axis=axis)) for axis in moving(campaign))

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        scale = self.own("ppm", "ppm", 20.0)
        if not self.growth:
            return (scale,)
        tau = 0.5 * self.clock_span(campaign)
        return (scale, self.time_constant(tau))

    def apply(self, row: Row) -> None:
        grown = 1.0 - ca.exp(-row.clock / self.parameter(row, "time_constant_s")) if self.growth else 1.0
        distance = row.signal(Position(str(self.axis))) - self.at
        row.axis[str(self.axis)] += self.parameter(row, "ppm") * grown * distance
