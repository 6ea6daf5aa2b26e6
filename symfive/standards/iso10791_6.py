"""Kinematic tests of the rotary axes (ISO 10791-6, annexes A, B, C): the range of each reading over the path.

Annex A (AK) is for two rotary axes in the head, B (BK) for two under the workpiece, C (CK) for one of each. The value is max -
min of the deviation, one direction, as read: the eccentricity of the set-up is in it. Of the numbers, 1 is the tilting axis with
linear ones following, 2 the axis that turns the table (of a head, the one that carries the other), 3 an axis that turns while
one linear axis moves, 4 all five axes; BK1, BK2 and BK4 are those of Florussen et al. (2020), the others follow them. The
expanded uncertainty is the declared noise at the two extreme readings: U = 2 √2 σ.
"""

from __future__ import annotations

import numpy as np

from symfive.campaign import Campaign, Run
from symfive.instruments import instruments_of
from symfive.machine import Machine
from symfive.numbers import plain_number
from symfive.procedures import Nominal
from symfive.standards._value import COVERAGE, StandardValue, moved, place_of

STANDARD = "ISO 10791-6"
ANNEX = {2: "AK", 1: "CK", 0: "BK"}
"""By how many of the two rotary axes stand on the tool's side."""
INSTRUMENTS = ("r_test", "ball_bar")
AXIAL, ACROSS = 0.9, 0.2
"""Cosines of the bar's direction to the axis or to the radius from which on it lies along it, and below which across."""


def kinematic_values(campaign: Campaign) -> tuple[StandardValue, ...]:
    """The range of every reading of the R-test and ball-bar runs that turn a rotary axis of a five-axis machine."""
    machine, values = campaign.machine, list[StandardValue]()
    if len(machine.rotary_axes) != 2:
        return ()
    for run in campaign.runs:
        turned = [name for name in machine.rotary_axes if name in moved(run)]
        if run.measured and turned and any(name in run.instrument for name in INSTRUMENTS):
            values += _of_run(machine, run, turned)
    return tuple(values)


def _of_run(machine: Machine, run: Run, turned: list[str]) -> list[StandardValue]:
    test, what = _test(machine, run, turned), dict[str, str]()
    for instrument in instruments_of(run):
        if instrument.name in INSTRUMENTS:
            what |= {column.name: instrument.name for column in instrument.columns(run, machine)}
    speed = run.fastest(run.commands[turned[0]]) if run.dynamic else 0.0
    conditions = {
        "stroke": ", ".join(f"{n} {plain_number(float(np.ptp(run.commands[n])))}°" for n in turned),
        "feed": f"{turned[0]} at most {plain_number(speed)} °/min" if run.dynamic else "none (static readings)",
        "direction": _sense(run, turned[0]), "readings": str(run.rows), **place_of(machine, run),
    }  # fmt: skip
    limits = ["as read: the range includes the eccentricity of the set-up"]
    if not run.dynamic:
        limits.append("static readings: the standard measures in motion")
    values = []
    for column, instrument_name in what.items():
        along = {"dx_um": "X", "dy_um": "Y", "dz_um": "Z"}.get(column) or _bar(machine, run, turned)
        frame = " of the workpiece frame" if instrument_name == "r_test" else ""
        u = COVERAGE * np.sqrt(2.0) * run.noise(instrument_name)
        values.append(StandardValue(
            standard=STANDARD, name=test, what=along, value=float(np.ptp(run.readings[column])), u=float(u), unit="um",
            runs=(run.id,), conditions={"reading": along + frame, **conditions}, limits=tuple(limits),
        ))  # fmt: skip
    return values


def _test(machine: Machine, run: Run, turned: list[str]) -> str:
    """The annex, and the number where it is known."""
    annex = ANNEX[sum(machine.structure.carries(name) == "tool" for name in machine.rotary_axes)]
    if len(turned) == 2:
        return f"{annex}4" if len(moved(run)) == 5 else f"{annex} ({'+'.join(turned)})"
    if len(moved(run)) == 2:
        return f"{annex}3"
    # the one that turns: next to the workpiece, or of two in the head next to the bed
    turning = next(n for n in (*machine.structure.workpiece, *machine.structure.tool) if machine.axes[n].rotary)
    return f"{annex}{2 if turned[0] == turning else 1}"


def _sense(run: Run, axis: str) -> str:
    change = float(run.commands[axis][-1] - run.commands[axis][0])
    return f"{axis}{'+' if change > 0 else '−'}" if abs(change) > 0.5 * float(np.ptp(run.commands[axis])) else "both"


def _bar(machine: Machine, run: Run, turned: list[str]) -> str:
    """How the bar lies to the axis that turns first, at the first row: radial, tangential or axial."""
    nominal, first = Nominal(machine), {name: way[:1] for name, way in run.commands.items()}
    point, direction = nominal.axis_line(turned[0], {name: float(way[0]) for name, way in first.items()})
    rotation, origin = nominal.workpiece_rotation(first)[0], nominal.workpiece_origin(first)[0]
    table = origin + rotation @ np.asarray(run.table_ball)
    bar = origin + rotation @ nominal.ball(first, run.tool_ball)[0] - table
    bar = bar / max(float(np.linalg.norm(bar)), 1e-12)
    arm = table - point
    arm = arm - direction * (arm @ direction)
    radius = float(np.linalg.norm(arm))
    if abs(bar @ direction) > AXIAL:
        return "axial"
    if radius > 1.0 and abs(bar @ arm) > AXIAL * radius:
        return "radial"
    if radius > 1.0 and abs(bar @ direction) < ACROSS and abs(bar @ arm) < ACROSS * radius:
        return "tangential"
    return "along the bar"
