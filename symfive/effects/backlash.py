"""Backlash: play between the drive and the axis (ISO 230-1, reversal value; ISO 230-4 Annex B)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from symfive.effects._axes import reversing
from symfive.effects._base import Campaign, Form, Forms, Parameter, Quantity, Row, Run
from symfive.effects._contact import Contact
from symfive.motion import Direction, Play, Position, PreSliding, Signal

SHAPES = ("play", "pre_sliding", "wind_up", "gradual", "step")


@dataclass(frozen=True, kw_only=True)
class Backlash(Contact):
    """q → q - (width/2)·s with a state s in -1…+1: the output lags the motion by half the width.

    `shape`:

    - `play`: s is ±1 at the flanks and in between while the play is crossed and the output stands.
    - `pre_sliding` (lost motion, low hysteresis): s = ±(1 - 2·exp(-ξ/distance)), ξ the distance since the
      reversal (P. R. Dahl 1968); the contact creeps over `distance`.
    - `gradual`: s changes in proportion to ξ until `distance`, a contact that is softer than a free play.
    - `step`: s = ±1 at once, as circular tests are read (ISO 230-4, Annex B).
    - `wind_up` (unequal backlash): a play whose width grows along the axis, width + slope·q.

    Where in the play a recording begins is a parameter of the run. Static rows: s is the direction from which the axis
    came. Typical 1–20 µm, worn over 100 µm, rotary 10–100 µrad; distance 10–300 µm.
    """

    id = "backlash"
    stage = "axis"
    says = "backlash between drive and axis"
    hidden_by = "servo mismatch where only one feed was run; location errors of a rotary axis"
    action = (
        "check the preload of the drive (screw, nut, coupling, worm); enter it as backlash compensation in the control"
    )
    coordinate = "{axis} velocity sign"
    needs_axis = True
    choices = (("shape", SHAPES),)
    shape: str = "play"

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        for axis in reversing(campaign):
            shapes = {shape: cls(axis=axis, shape=shape) for shape in SHAPES}
            for first, tag in (("play", ""), ("step", "step")):
                others = tuple(each for shape, each in shapes.items() if shape != first)
                yield Form(effect=replace(shapes[first], tag=tag), shapes=others)

    def advice(self, sizes: Mapping[str, Quantity]) -> tuple[str, str]:
        """A backlash grows along the axis only if its slope is beyond 2σ, from where a report states it."""
        width, slope = sizes.get("width"), sizes.get("slope", Quantity(0.0, 0.0))
        if isinstance(slope.value, float) and isinstance(slope.std, float) and abs(slope.value) > 2.0 * slope.std:
            return (
                "unequal backlash: it grows along the axis (wind-up)",
                "check the support bearings of the screw, its wear and its torsion at the end where the backlash is larger; one "
                "value of backlash compensation removes its mean only",
            )
        if width is None or not isinstance(width.value, float) or width.value >= 0.0:
            return super().advice(sizes)
        return (
            "axis goes beyond its target behind a reversal: the opposite of backlash",
            "reduce the backlash compensation in the control, or see whether the axis overshoots its target",
        )

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        rotary = self.its_axis(campaign).rotary
        small = self.its_axis(campaign).error_unit
        found = [self.own("width", small, 100.0 if rotary else 20.0, start=1.0)]
        if self.shape in ("pre_sliding", "gradual"):
            distance = 300.0 if rotary else 50.0
            found.append(self.own("distance", small, distance, mean=distance, lower=0.02 * distance))
        if self.shape == "wind_up":
            found.append(self.own("slope", "urad/deg", 1.0) if rotary else self.own("slope", "um/mm", 0.05))
        return tuple(found)

    def starts(self, run: Run) -> tuple[Parameter, ...]:
        return self.start_of_contact(run, str(self.axis), memory=self.shape != "step")

    def signals(self) -> tuple[Signal, ...]:
        if self.shape == "pre_sliding":
            return (PreSliding(str(self.axis), f"{self.key}.distance", self.started),)
        if self.shape == "step":
            return (Direction(str(self.axis), self.started),)
        if self.shape == "gradual":
            return (Play(str(self.axis), f"{self.key}.distance", start=self.started),)
        slope = f"{self.key}.slope" if self.shape == "wind_up" else ""
        return (Play(str(self.axis), f"{self.key}.width", slope, self.started),)

    def apply(self, row: Row) -> None:
        width = self.parameter(row, "width")
        if self.shape == "wind_up":
            width = width + self.parameter(row, "slope") * row.signal(Position(str(self.axis)))
        row.axis[str(self.axis)] -= 0.5 * width * row.signal(self.signals()[0])
