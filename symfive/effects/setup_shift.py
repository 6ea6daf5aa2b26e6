"""Set-up shift: a ball or nest slips at one instant (without a clock: at one row) within a run."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Self

import casadi as ca
import numpy as np

from symfive.arrays import Array, Indices
from symfive.effects._base import BALL, INSTRUMENT, Begin, Campaign, Form, Forms, Parameter, Row, Run, Scan
from symfive.effects._coordinates import ROW
from symfive.effects._quantity import Covariance, Quantity, Values, own_quantity
from symfive.effects._warming import Rising
from symfive.errors import InputError

ARTEFACTS = ("table", "tool")
SHAPES = ("step", "creep")
MOST_PLACES = 150
"""Rows of a run that are scanned, evenly spread."""


@dataclass(frozen=True, kw_only=True)
class SetupShift(Rising):
    """From `t_s` or `row` of the run on the ball is displaced by shift (3, µm): the table's in the workpiece frame,
    the tool's in its.

    `run` its id, `t_s` on the run's own clock, or `row`, the first displaced one (from 1), of a run whose clock was not recorded;
    `artefact` which ball, `shape`: `step` at once (its place from a scan: readings jump between two rows, so it has no
    derivative), or, with a clock, `creep`, shift·(1 - exp(-(t - t_s)/creep_s)) with the instant a parameter about `t_s`.
    `rows_off` the 1σ of that place in rows, beside that between two of them. Typical 1–20 µm.
    """

    id = "setup_shift"
    says = "the artefact moved within the run"
    hidden_by = "the run's set-up errors where it happened near its start or end"
    action = "clamp the artefact again and repeat the run; the machine needs no repair"
    terms = (("t_s", "instant"), ("creep_s", "creep time"))
    acts_in = INSTRUMENT
    choices = (("artefact", ARTEFACTS), ("shape", SHAPES))
    run: str
    t_s: float = 0.0
    row: int = 0
    artefact: str = "table"
    shape: str = "step"
    rows_off: float = field(default=0.0, compare=False)

    @property
    def key(self) -> str:
        """`setup_shift.RUN`."""
        return self._key(self.run)

    @property
    def over_time(self) -> bool:  # type: ignore[override]
        """Whether its place is an instant, and not a row."""
        return not self.row

    @property
    def coordinate(self) -> str:  # type: ignore[override]
        """Time, or the row of its run."""
        return "t" if self.over_time else f"{ROW} in {self.run}"

    @property
    def _place(self) -> tuple[str, float]:
        """Name and value of where it happened."""
        return ("t_s", self.t_s) if self.over_time else ("row", self.row)

    @property
    def _begin(self) -> float:
        """Where it begins along `Run.course`; a row, halfway from the one before."""
        return self.t_s if self.over_time else self.row - 0.5

    def prepare(self, campaign: Campaign) -> Self:
        if self.row and (self.t_s or self.shape != "step"):
            raise InputError(f"{self.key}: a row has no clock", remedy='write row = … alone, with shape = "step"')
        for run in filter(self.applies, campaign.runs):
            if not run.course[0] < self._begin <= run.course[-1]:
                name, given = self._place
                raise InputError(
                    f"{self.key}: {name} = {given} lies outside the run",
                    remedy=f"{run.course[0]:g} < {name} <= {run.course[-1]:g}",
                )
        return super().prepare(campaign)

    def applies(self, run: Run) -> bool:
        return run.id == self.run and run.has_clock == self.over_time

    def begins(self, run: Run) -> Begin | None:
        if not self.applies(run) or self.shape != "step":
            return None
        always = replace(self, row=2) if self.row else replace(self, t_s=float(run.course[1]))
        row = int(np.searchsorted(run.course, self._begin))
        return Begin(row=row, always=always, within=lambda rows: replace(self, rows_off=rows))

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        for run in campaign.runs:
            margin = max(3, run.rows // 50)  # nearer to an end it could not be separated from the set-up
            if run.rows >= 4 * margin and run.measured:
                rows = np.arange(margin, run.rows - margin, max(1, run.rows // MOST_PLACES))
                yield cls._scan(run, rows, campaign.rows)

    @classmethod
    def _scan(cls, run: Run, rows: Indices, places: int) -> Scan:
        """Of some rows of a run at which it may have begun; about the best of them, of every row."""

        def form(k: int) -> Form:
            if not run.has_clock:
                return Form(effect=cls(run=run.id, row=int(rows[k]) + 1), places=places)
            instant = 0.5 * float(run.time[rows[k] - 1] + run.time[rows[k]])
            plain = cls(run=run.id, t_s=instant)
            return Form(effect=plain, shapes=(replace(plain, shape="creep"),), places=places)

        def courses(of: Run) -> Array:
            return np.asarray(np.arange(of.rows)[:, None] >= rows, dtype=float) * (of.id == run.id)

        def finer(k: int) -> Scan:
            return cls._scan(run, np.arange(rows[max(k - 1, 0)], rows[min(k + 1, len(rows) - 1)] + 1), places)

        apart = len(rows) > 1 and rows[1] - rows[0] > 1
        return Scan(
            channel=BALL, count=len(rows), courses=courses, form=form, run=run.id, finer=finer if apart else None
        )

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        found = [self.own(f"shift.{c}", "um", 10.0) for c in "xyz"]
        if self.shape == "creep":
            clock = np.concatenate([[self.t_s], *(run.time for run in filter(self.applies, campaign.runs))])
            begin, end = float(clock.min()), float(clock.max()) + 1e-3
            tau = 0.3 * (end - self.t_s)
            found.append(self.time_constant(tau, "creep_s"))
            found.append(self.own("t_s", "s", 0.25 * (end - begin), mean=self.t_s, lower=begin, upper=end))
        return tuple(found)

    def apply(self, row: Row) -> None:
        if self.shape == "creep":
            late = ca.fmax(row.time - self.parameter(row, "t_s"), 0.0)
            share = 1.0 - ca.exp(-late / self.parameter(row, "creep_s"))
        else:
            share = ca.if_else(row.time >= self._begin, 1.0, 0.0)
        shift = share * ca.vertcat(*(self.parameter(row, f"shift.{c}") for c in "xyz"))
        if self.artefact == "table":
            row.table_ball += shift
        else:
            row.tool_ball += shift

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        parameters = self.parameters(campaign)
        parts = [own_quantity(p, values, covariance) for p in parameters[:3]]
        name, place = self._place
        rows = math.hypot(self.rows_off, 1.0 / math.sqrt(12.0))
        found = {
            "run": Quantity(self.run),
            name: Quantity(place, rows * campaign.run(self.run).interval, "s")
            if self.over_time
            else Quantity(place, self.rows_off or None),
            "shift": Quantity(tuple(p.value for p in parts), tuple(p.std for p in parts), "um"),
        }
        if self.shape == "creep":
            found |= {p.name.rpartition(".")[2]: own_quantity(p, values, covariance) for p in parameters[3:]}
        return found
