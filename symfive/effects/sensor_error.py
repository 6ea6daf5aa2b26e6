"""Sensor error: gain and cross-sensitivity of the instrument (ISO 230-4, 5; ISO 230-7, A)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from symfive.effects._base import Campaign, Covariance, Effect, Form, Forms, Parameter, Quantity, Row, Run, Values
from symfive.errors import InputError
from symfive.instruments import instruments_of

SHAPES = ("gain", "matrix")


@dataclass(frozen=True, kw_only=True)
class SensorError(Effect):
    """reading → gain·reading for every column, or, `shape = "matrix"`, readings → matrix·readings of
    `instrument`.

    The matrix holds the gains and the cross-sensitivity of an instrument with several probes (`r_test` 3×3).
    Its unknown zero is multiplied too, which only renames the zero. Typical gain 0.1–2 %, probes askew by
    0.2–2 %.
    """

    id = "sensor_error"
    stage = "reading"
    says = "gain or cross-sensitivity of the instrument"
    hidden_by = "everything proportional to the deviation; a known shift of 50 µm separates them"
    action = "calibrate the instrument; the machine needs no repair"
    terms = (("gain", "gain of {}"), ("matrix", "matrix element {}"))
    coordinate = "reading"
    choices = (("shape", SHAPES),)
    shape: str = "gain"
    instrument: str = "r_test"

    def prepare(self, campaign: Campaign) -> Self:
        read = [
            r.readings[name]
            for r in campaign.runs
            if r.measured
            for name in self._columns(campaign)
            if name in r.readings
        ]
        if read and all(np.ptp(values) == 0.0 for values in read):
            raise InputError(
                f"{self.key}: nothing is read but one value", remedy="an artefact that is seated has no gain"
            )
        return super().prepare(campaign)

    def applies(self, run: Run) -> bool:
        return self.shape == "gain" or self.instrument in run.instrument

    def _columns(self, campaign: Campaign) -> tuple[str, ...]:
        """The columns it acts on, in the order of the files."""
        found: dict[str, None] = {}
        for run in campaign.runs:
            for instrument in instruments_of(run):
                if not instrument.on_control and (self.shape == "gain" or instrument.name == self.instrument):
                    found |= dict.fromkeys(column.name for column in instrument.columns(run, campaign.machine))
        return tuple(found)

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        probes = [(i, run) for run in campaign.runs for i in instruments_of(run) if not i.on_control]
        several = sorted({i.name for i, run in probes if len(i.columns(run, campaign.machine)) > 1})
        for name in several:
            yield Form(effect=cls(instrument=name, shape="matrix", tag=name if len(several) > 1 else ""))
        yield Form(effect=cls(tag="gain"))

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        columns = self._columns(campaign)
        if self.shape == "gain":
            return tuple(self.own(f"gain.{name}", "1", 0.02, mean=1.0) for name in columns)
        numbers = range(1, len(columns) + 1)
        return tuple(
            self.own(f"matrix.{i}{j}", "1", 0.02, mean=1.0 if i == j else 0.0) for i in numbers for j in numbers
        )

    def typical(self, campaign: Campaign) -> dict[str, float]:
        return {p.name: p.mean + 0.5 * p.sigma for p in self.parameters(campaign)}

    def apply(self, row: Row) -> None:
        if self.shape == "gain":
            for i in row.sensed:
                row.readings[i] *= self.parameter(row, f"gain.{row.columns[i].name}")
            return
        own = [i for i, source in enumerate(row.sources) if source == self.instrument]
        raw = [row.readings[i] for i in own]
        for number, i in enumerate(own, start=1):
            row.readings[i] = sum(self.parameter(row, f"matrix.{number}{j}") * y for j, y in enumerate(raw, start=1))

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        found = super().describe(campaign, values, covariance)
        if self.shape == "gain":
            return found
        names = self._columns(campaign)
        numbers = range(1, len(names) + 1)
        lines = [[found[f"matrix.{i}{j}"] for j in numbers] for i in numbers]
        value = tuple(tuple(entry.value for entry in line) for line in lines)
        return {"matrix": Quantity(value, tuple(tuple(entry.std for entry in line) for line in lines), "1")}
