"""Vibration: a tone at a fixed frequency in time, whatever the motion (ISO/TR 230-8)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from symfive.arrays import Array
from symfive.effects._form import TOOL, Forms
from symfive.effects._periodic import Tonal
from symfive.effects._quantity import Covariance, Quantity, Values, length_spread, own_quantity, propagate, seen_length
from symfive.errors import InputError
from symfive.instruments import instruments_of
from symfive.parameters import Parameter
from symfive.row import Row
from symfive.runs import Campaign, Run

PLACES = ("structure", "reading")


@dataclass(frozen=True, kw_only=True)
class Vibration(Tonal):
    """sin·sin(2πft) + cos·cos(2πft), t on the campaign's clock, f near `frequency_hz`.

    `place`: `structure`, a shift of the tool with two amplitudes in each of `directions` of the machine
    frame, or `reading`, two amplitudes in each reading column. `run`: in this run only (a tone keeps its
    phase from run to run only if the runs' `start_s` are right); a campaign without it is left alone. Typical 0.1–2 µm.
    """

    id = "vibration"
    says = "a vibration of constant frequency"
    hidden_by = "a periodic error of a screw or gear where only one feed was run"
    action = "find the source by its frequency (fan, pump, spindle, floor) and isolate it"
    coordinate = "t"
    dynamic_only = True
    choices = (("place", PLACES),)
    place: str = "structure"
    directions: str = "xyz"
    run: str | None = None

    @property
    def key(self) -> str:
        """`vibration` or `vibration.RUN`."""
        return self._key(self.run)

    @property
    def stage(self) -> str:  # type: ignore[override]
        """Where it enters."""
        return self.place

    def prepare(self, campaign: Campaign) -> Self:
        prepared = super().prepare(campaign)
        if not self.directions or any(c not in "xyz" for c in self.directions):
            raise InputError(
                f"{self.key}: directions {self.directions!r} are unknown", remedy='write "xyz" or some of it'
            )
        return prepared

    def applies(self, run: Run) -> bool:
        return run.dynamic and self.run in (None, run.id)

    def _channels(self, campaign: Campaign) -> dict[str, str]:
        """Directions or columns that swing, with their units."""
        if self.place == "structure":
            return dict.fromkeys(self.directions, "um")
        found: dict[str, str] = {}
        for run in filter(self.applies, campaign.runs):
            for instrument in instruments_of(run):
                if not instrument.on_control:
                    found |= {column.name: column.unit for column in instrument.columns(run, campaign.machine)}
        return found

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        yield from cls.tones([run for run in campaign.runs if run.dynamic], TOOL)

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        found = [
            self.own(f"{name}.{part}", unit, 1.0 if unit in ("um", "urad") else 1e-3)
            for name, unit in self._channels(campaign).items()
            for part in ("sin", "cos")
        ]
        return (*found, self.frequency(campaign))

    def apply(self, row: Row) -> None:
        sine, cosine = self.sine_and_cosine(row)
        if self.place == "structure":
            for c in self.directions:
                row.shift["xyz".index(c)] += (
                    self.parameter(row, f"{c}.sin") * sine + self.parameter(row, f"{c}.cos") * cosine
                )
            return
        for i in row.sensed:
            name = row.columns[i].name
            row.readings[i] += self.parameter(row, f"{name}.sin") * sine + self.parameter(row, f"{name}.cos") * cosine

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """`amplitude` along `direction`, the main axis of the (in general elliptic) motion, and its phase."""
        parameters = self.parameters(campaign)
        names = [p.name for p in parameters[:-1]]

        def main(p: Array) -> tuple[float, Array, float]:
            parts = p.reshape(-1, 2)
            left, sizes, right = np.linalg.svd(parts)
            sign = 1.0 if left[np.argmax(np.abs(left[:, 0])), 0] > 0.0 else -1.0
            return float(sizes[0]), sign * left[:, 0], math.atan2(sign * right[0, 1], sign * right[0, 0])

        amplitude, direction, phase = main(np.array([values[name] for name in names]))
        std = length_spread(lambda p: main(p)[0], names, values, covariance)

        def heading(p: Array) -> Array:
            _, way, angle = main(p)
            return np.append(way, phase + math.remainder(angle - phase, 2.0 * math.pi))

        *ways, turn = (float(s) for s in propagate(heading, names, values, covariance)[1])
        found = {
            "frequency_hz": own_quantity(parameters[-1], values, covariance),
            "amplitude": Quantity(amplitude, std, parameters[0].unit),
            "phase": Quantity(phase, min(turn, math.pi), "rad"),
        }
        found |= seen_length(names, parameters[0].unit, values, covariance)
        if self.place == "structure":
            full, spread = (dict(zip(self.directions, part, strict=True)) for part in (direction.tolist(), ways))
            found["direction"] = Quantity(
                tuple(full.get(c, 0.0) for c in "xyz"), tuple(min(spread.get(c, 0.0), 1.0) for c in "xyz"), "1"
            )
        return found
