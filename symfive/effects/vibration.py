"""Vibration: a tone at a fixed frequency in time, whatever the motion (ISO/TR 230-8)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Self

from symfive.effects._base import READING, TOOL, Campaign, Covariance, Forms, Parameter, Quantity, Row, Run, Values
from symfive.effects._periodic import Tonal
from symfive.errors import InputError
from symfive.instruments import instruments_of

PLACES = ("structure", "reading")


def columns_read(campaign: Campaign, runs: Iterable[Run]) -> dict[str, str]:
    """Reading columns of instruments that are not the control's own → their units."""
    every = ((run, instrument) for run in runs for instrument in instruments_of(run) if not instrument.on_control)
    return {c.name: c.unit for run, instrument in every for c in instrument.columns(run, campaign.machine)}


@dataclass(frozen=True, kw_only=True)
class Vibration(Tonal):
    """A tone in time (`Tonal`).

    `place`: `structure`, a shift of the tool with two amplitudes in each of `directions` of the machine
    frame, or `reading`, two amplitudes in each reading column. `run`: in this run only; a campaign without it is left alone.
    Typical 0.1–2 µm.
    """

    id = "vibration"
    says = "a vibration of constant frequency"
    hidden_by = "a periodic error of a screw or gear where only one feed was run"
    action = "find the source by its frequency (fan, pump, spindle, floor) and isolate it"
    coordinate = "t"
    dynamic_only = True
    choices = (("place", PLACES), *Tonal.choices)
    place: str = "structure"
    directions: str = "xyz"
    run: str | None = None

    @property
    def key(self) -> str:
        """`vibration`, `vibration.reading` or one of these with `.RUN`."""
        return self._key("reading" if self.place == "reading" else None, self.run)

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
        return columns_read(campaign, self._runs(campaign))

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        """Of the structure, and of a bar or a nest that turns as it reads: what stands reads both alike."""
        runs = [run for run in campaign.runs if run.dynamic]
        yield from cls.tones(runs, TOOL)
        turning = [run for run in runs if any(i.turns(run, campaign.machine) for i in instruments_of(run))]
        if columns_read(campaign, turning):
            yield from cls.tones(turning, READING, place="reading")

    def advice(self, sizes: Mapping[str, Quantity]) -> tuple[str, str]:
        if self.place == "structure":
            return super().advice(sizes)
        return (
            "a tone in the readings that does not turn with the instrument, as of the mains",
            "check cables, earthing and filter of the instrument; the machine needs no repair",
        )

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        found = [
            pair
            for name, unit in self._channels(campaign).items()
            for pair in self.pairs(campaign, unit, 1.0 if unit in ("um", "urad") else 1e-3, f"{name}.")
        ]
        return (*found, self.frequency(campaign))

    def apply(self, row: Row) -> None:
        if self.place == "structure":
            for c in self.directions:
                row.shift["xyz".index(c)] += self.swing(row, f"{c}.")
            return
        for i in row.sensed:
            row.readings[i] += self.swing(row, f"{row.columns[i].name}.")

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """Frequency, `amplitude` along `direction`, the main axis of the (in general elliptic) motion, and its phase."""
        parameters, channels = self.parameters(campaign), self._channels(campaign)
        found, *direction = self.tone(campaign, parameters, len(channels), values, covariance)
        if self.place == "structure":
            full, spread = (dict(zip(channels, part.tolist(), strict=True)) for part in direction)
            found["direction"] = Quantity(
                tuple(full.get(c, 0.0) for c in "xyz"), tuple(spread.get(c, 0.0) for c in "xyz"), "1"
            )
        return found
