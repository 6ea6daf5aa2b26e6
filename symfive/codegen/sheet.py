"""Targets `siemens`, `fanuc`, `heidenhain`, `haas`: sheets to be read by a person, old and new value of every parameter.

They are drafts and stay so: the manuals describe what the numbers mean, but nothing here was tried on such a control. No file
is written that a control could load. A control is one entry of the table.
"""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symfive.codegen._lines import AxisLine, axis_lines, table_axes
from symfive.codegen._sources import filled
from symfive.codegen._subject import Subject

__all__ = ["CONTROLS", "Control", "Row", "sheet_files"]

Array = NDArray[np.float64]
Lines = tuple[AxisLine, AxisLine]


@dataclass(frozen=True)
class Row:
    """One parameter of a control: what it means, old and new value, unit, where its manual speaks of it."""

    name: str
    means: str
    old: float
    new: float
    unit: str
    reference: str


@dataclass(frozen=True)
class Control:
    """A control: its rows from (old, new) lines of the carrying and the carried rotary axis, and what it cannot hold."""

    title: str
    rows: Callable[[Lines, Lines], list[Row]]
    notes: tuple[str, ...]


def sheet_files(subject: Subject, prefix: str, control: str) -> dict[str, str]:
    """The sheet of a control as a page. Raises `InputError` unless two rotary axes stand under the workpiece."""
    entry = CONTROLS[control]
    first, second = table_axes(subject, f"the parameters of {entry.title}")
    lines = axis_lines(subject)
    rows = entry.rows(lines[first], lines[second])
    cells = "\n".join(
        f"<tr><td><code>{html.escape(r.name)}</code></td><td>{html.escape(r.means)}</td><td class='n'>{r.old:.6f}</td>"
        f"<td class='n'><b>{r.new:.6f}</b></td><td class='n'>{r.new - r.old:+.6f}</td><td>{r.unit}</td>"
        f"<td>{html.escape(r.reference)}</td></tr>"
        for r in rows
    )
    page = filled(
        "sheet.html", title=entry.title, rows=cells, notes="".join(f"<li>{html.escape(n)}</li>" for n in entry.notes),
        machine=html.escape(subject.machine.name), structure=html.escape(subject.machine.structure.code),
        digest=subject.digest, values="identified" if subject.fitted else "prior means: nothing is identified yet",
    )  # fmt: skip
    return {f"{prefix}-{control}.html": page}


def _vector(names: tuple[str, ...], means: str, old: Array, new: Array, unit: str, reference: str) -> list[Row]:
    """Three rows for x, y and z."""
    return [Row(n, f"{means}, {c}", float(a), float(b), unit, reference)
            for n, c, a, b in zip(names, "xyz", old, new, strict=True)]  # fmt: skip


def _siemens(first: Lines, second: Lines) -> list[Row]:
    manual = "commissioning manual IM9 (12/2017), p. 572"
    (old1, new1), (old2, new2) = first, second
    i2, i3 = (old1.point, new1.point), (old2.point - old1.point, new2.point - new1.point)
    rows = _vector(("$TC_CARR4 / MD24550[0]", "$TC_CARR5 / MD24550[1]", "$TC_CARR6 / MD24550[2]"),
                   f"I2: reference point to axis {old1.axis}", *i2, "mm", manual)  # fmt: skip
    rows += _vector(("$TC_CARR15 / MD24558[0]", "$TC_CARR16 / MD24558[1]", "$TC_CARR17 / MD24558[2]"),
                    f"I3: axis {old1.axis} to axis {old2.axis}", *i3, "mm", manual)  # fmt: skip
    rows += _vector(("$TC_CARR18 / MD24500[0]", "$TC_CARR19 / MD24500[1]", "$TC_CARR20 / MD24500[2]"),
                    "I4 = -(I2 + I3)", -(i2[0] + i3[0]), -(i2[1] + i3[1]), "mm", manual)  # fmt: skip
    rows += _vector(("$TC_CARR7 / MD24570[0]", "$TC_CARR8 / MD24570[1]", "$TC_CARR9 / MD24570[2]"),
                    f"V1: direction of axis {old1.axis}", old1.direction, new1.direction, "1", manual)  # fmt: skip
    rows += _vector(("$TC_CARR10 / MD24572[0]", "$TC_CARR11 / MD24572[1]", "$TC_CARR12 / MD24572[2]"),
                    f"V2: direction of axis {old2.axis}", old2.direction, new2.direction, "1", manual)  # fmt: skip
    return rows


def _fanuc(first: Lines, second: Lines) -> list[Row]:
    (old1, new1), (old2, new2) = first, second
    rows = _vector(("19700", "19701", "19702"), f"position of the rotary table: axis {old1.axis} from the machine's zero",
                   old1.point, new1.point, "mm", "A-79348E; number from memory, check it there")  # fmt: skip
    return rows + _vector(("19703", "19704", "19705"), f"offset from axis {old1.axis} to axis {old2.axis}",
                          old2.point - old1.point, new2.point - new1.point, "mm", "A-79348E, p. 72 to 86")  # fmt: skip


def _heidenhain(first: Lines, second: Lines) -> list[Row]:
    rows = []
    for (old, new), place in ((first, "axis 1"), (second, "axis 2")):
        reference = "kinematics description of this machine; measured by KinematicsOpt, cycles 451 and 452"
        names = tuple(f"{place}, {old.axis}: {c}" for c in "XYZ")
        rows += _vector(names, f"point on axis {old.axis}", old.point, new.point, "mm", reference)
        names = tuple(f"{place}, {old.axis}: direction {c}" for c in "XYZ")
        manual = "KinematicsComp, columns EAA … ECC: iTNC 530 technical manual, p. 680"
        rows += _vector(names, f"direction of axis {old.axis}", old.direction, new.direction, "1", manual)
    return rows


def _haas(first: Lines, second: Lines) -> list[Row]:
    check = "machine rotary zero point: check the numbers of these settings on the control"
    return [
        Row(f"MRZP {c} offset", f"axis {old.axis} along {c}", float(old.point[k]), float(new.point[k]), "mm", check)
        for k, c, (old, new) in ((0, "X", second), (1, "Y", second), (2, "Z", first))
    ]


CONTROLS: dict[str, Control] = {
    "siemens": Control("Siemens SINUMERIK", _siemens, (
        "Tables print the machine data both by number and by name, and not all editions agree (MD24558 JOINT_OFFSET_PART, "
        "MD24560): compare number and name on the control before typing.",
        "The fine offsets $TC_CARR41 to 60 may take the differences instead of new base values.",
        "Holds place and direction of both rotary axes; squareness of X Y Z and error motions need other compensations.",
    )),
    "fanuc": Control("Fanuc 30i", _fanuc, (
        "Type in parameter 19680 (12: table), axes and directions in 19682, 19684, 19686: leave as they are.",
        "Lengths are radius values. Holds places only: tilts of the rotary axes, squareness and error motions are not in these.",
        "A pivot stands in two places on some controls (tool length and 19666): both must agree.",
    )),
    "heidenhain": Control("Heidenhain TNC", _heidenhain, (
        "The table with these values is the machine builder's and differs between machines: this sheet names values, no places.",
        "Squareness and error motions can be put into KinematicsComp where the option is there.",
    )),
    "haas": Control("Haas NGC", _haas, (
        "Holds the place of the rotary axes only (X and Y of the turning axis, Z of the tilting one).",
        "With G254 the B value of the work offset must be zero.",
    )),
}  # fmt: skip
