"""The coordinate over which an effect acts, as rows of a run: position, velocity, acceleration, time, reading, pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run
from symfive.diagnose import Finding
from symfive.effects import coordinate_values
from symfive.identify import Identification
from symfive.machine import Machine
from symfive.numbers import unit_words
from symfive.report._traces import folded

MOST = 2
MINUTES_FROM_S = 600.0


@dataclass(frozen=True)
class Coordinate:
    """What a residual is drawn over: `label` with its unit, `values` of a run's rows (N,).

    `axis` is the one whose direction of motion splits the rows; `clock`: it is time, each run a line of its own.
    """

    label: str
    values: Callable[[Run], Array]
    axis: str | None = None
    clock: bool = False


def coordinates_of(finding: Finding, identification: Identification) -> list[Coordinate]:
    """The coordinates that a finding names, two at most; rows in their order where it names none that can be drawn."""
    machine, runs = identification.model.machine, identification.model.campaign.runs
    found = []
    for words in finding.coordinate.split(", ")[:MOST]:
        name, _, quantity = words.partition(" ")
        if words == "t":
            found.append(_clock(runs))
        elif name in machine.axes:
            found.append(_of_axis(machine, runs, name, quantity))
    return found or [_rows(runs)]


def _of_axis(machine: Machine, runs: tuple[Run, ...], name: str, quantity: str) -> Coordinate:
    axis = machine.axes[name]
    unit = unit_words(axis.unit)
    if quantity in ("velocity", "acceleration"):
        per = "s" if quantity == "velocity" else "s²"
        rate = f"{name} {quantity}"
        return Coordinate(f"{quantity} of {name} / ({unit}/{per})", lambda run: coordinate_values(rate, run, machine))
    if not folded(axis, runs):
        return Coordinate(f"{name} / {unit}", lambda run: np.asarray(run.commands[name]), name if quantity else None)

    def position(run: Run) -> Array:
        return np.asarray(np.mod(run.commands[name] + 180.0, 360.0) - 180.0)

    return Coordinate(f"{name} over one revolution / {unit}", position, name if quantity else None)


def _clock(runs: tuple[Run, ...]) -> Coordinate:
    end = max(run.start_s + float(run.time[-1]) for run in runs)
    scale, unit = (60.0, "min") if end > MINUTES_FROM_S else (1.0, "s")
    return Coordinate(
        f"time of the campaign / {unit}", lambda run: np.asarray((run.start_s + run.time) / scale), clock=True
    )


def _rows(runs: tuple[Run, ...]) -> Coordinate:
    first, count = {}, 0
    for run in runs:
        first[run.id] = count
        count += run.rows

    def numbers(run: Run) -> Array:
        return np.asarray(first[run.id] + 1.0 + np.arange(run.rows), dtype=np.float64)

    return Coordinate("row of the campaign, in the order of the runs", numbers, clock=True)
