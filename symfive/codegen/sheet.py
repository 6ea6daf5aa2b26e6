"""Targets `siemens`, `fanuc`, `heidenhain`, `haas`: sheets to be read by a person, old and new value of every
parameter, the uncertainty of the change and whether it is to be entered.

They are drafts and stay so: the manuals describe what the numbers mean, but nothing here was tried on such a control. No file
is written that a control could load. A control is one entry of the table.
"""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symfive.arrays import Array
from symfive.codegen._entry import Change
from symfive.codegen._sources import page
from symfive.codegen._subject import AxisLine, Subject, axis_lines, lines_by_parameters, table_axes
from symfive.effects import form_words
from symfive.parameters import DETERMINED

Lines = tuple[AxisLine, AxisLine]


LENGTH, DIRECTION = 1e-3, 1e-7
"""Resolution of a control's fields: mm, and components of a direction (1e-7 is 0.1 µrad)."""


@dataclass(frozen=True)
class Row:
    """One parameter of a control: what it `means`, old and new value, unit, what a larger number does (`sign`), where its manual
    speaks of it. One that `closes` the chain is the opposite of the sum of these rows, as they are entered."""

    name: str
    means: str
    old: float
    new: float
    unit: str
    sign: str
    reference: str
    closes: tuple[str, ...] = ()

    @property
    def resolution(self) -> float:
        """The smallest step of its field, in its unit."""
        return LENGTH if self.unit == "mm" else DIRECTION


@dataclass(frozen=True)
class Control:
    """A control: its rows from (old, new) lines of the carrying and the carried rotary axis, and what it cannot hold."""

    title: str
    rows: Callable[[Lines, Lines], list[Row]]
    notes: tuple[str, ...]


def sheet_files(subject: Subject, prefix: str, control: str) -> dict[str, str]:
    """The sheet of a control as a page. Raises `InputError` unless two rotary axes stand under the workpiece."""
    entry = CONTROLS[control]
    names = table_axes(subject, f"the parameters of {entry.title}")
    lines = axis_lines(subject)
    rows = entry.rows(lines[names[0]], lines[names[1]])
    slope = None if subject.covariance is None else _by_parameters(subject, entry, names)
    spread = [None] * len(rows) if slope is None else subject.expanded(slope).tolist()
    notes = [
        *_not_here(subject, names, directions=any(row.unit == "1" for row in rows)),
        *entry.notes,
        *_open_parameters(subject, slope),
    ]
    machine = html.escape(subject.machine.name)
    text = page(
        "sheet.html", f"{entry.title}: {machine}", control=entry.title, rows=_cells(rows, spread),
        notes="".join(f"<li>{html.escape(n)}</li>" for n in notes), machine=machine,
        structure=html.escape(subject.machine.structure.code), digest=subject.digest,
        values=IDENTIFIED if subject.fitted else NOT_MEASURED,
    )  # fmt: skip
    return {f"{prefix}-{control}.html": text}


IDENTIFIED = (
    "U is the expanded uncertainty (k = 2) of the change, from the fit alone. It counts on the 1σ that the campaign states for "
    "the set-up (where the tool ball is, how long the bar); drift, another mounting of the instrument and its calibration come "
    "on top. A change below its uncertainty or below the control's resolution is not entered."
)
NOT_MEASURED = "Nothing is identified yet, so that no uncertainty is known and nothing is to be entered."


def _cells(rows: Sequence[Row], uncertainty: Sequence[float | None]) -> str:
    """The table's rows; every cell names its column for screens on which the head does not fit."""
    found, typed = [], dict[str, float]()
    for row, spread in zip(rows, uncertainty, strict=True):
        change, unit = Change(row.old, row.new, row.resolution, spread), "" if row.unit == "1" else f" {row.unit}"
        entered, reason = change.entered, change.reason
        moved, new = change.said(change.difference, "+"), change.said(row.new)
        typed[row.name] = change.typed
        if row.closes:
            typed[row.name] = value = -sum(typed[name] for name in row.closes) + 0.0
            entered, moved, new = change.differs(value), change.field(value - row.old, "+"), change.field(value)
            reason = "closes the chain" if entered else "nothing that it closes is entered"
        cells = (
            ("parameter", "", f"<code>{html.escape(row.name)}</code><small>{html.escape(row.reference)}</small>"),
            ("meaning", "", f"{html.escape(row.means)}<small>{html.escape(row.sign)}</small>"),
            ("on the control", " class='blank'", ""),
            ("design", " class='n'", f"{change.field(row.old)}{unit}"),
            ("change", " class='n'", f"{moved}{unit}"),
            ("U (k = 2)", " class='n'", change.spread if spread is None else f"{change.spread}{unit}"),
            ("new", " class='n'", f"<b>{new}{unit}</b>" if entered else "unchanged"),
            ("enter", "", html.escape(": ".join(filter(None, ("yes" if entered else "no", reason))))),
        )
        written = "".join(f"<td{kind} data-head='{head}'>{text}</td>" for head, kind, text in cells)
        found.append(f"<tr{'' if entered else ' class=quiet'}>{written}</tr>")
    return "\n".join(found)


def _by_parameters(subject: Subject, entry: Control, names: tuple[str, str]) -> Array:
    """Derivatives of the rows by the parameters in their own units (rows, k): the rows are linear in the lines."""

    def at(lines: Array) -> Array:
        first, second = (AxisLine(n, v[:3], v[3:]) for n, v in zip(names, lines.reshape(2, 6), strict=True))
        return np.array([row.new for row in entry.rows((first, first), (second, second))])

    by_lines = np.array([at(unit) for unit in np.eye(12)]).T - at(np.zeros(12))[:, None]
    return np.asarray(by_lines @ lines_by_parameters(subject, names))


def _not_here(subject: Subject, axes: Sequence[str], *, directions: bool) -> list[str]:
    """The effects of the model that places, and perhaps directions, of the rotary `axes` do not correct."""
    held = {("location", f"E{c}0{axis}") for c in ("XYZABC" if directions else "XYZ") for axis in axes}
    keys = [effect.key for effect in subject.effects if not subject.changed(effect) <= held]
    keys += [key for key, _ in subject.left_out]
    names = [form_words(key, subject.machine) for key in dict.fromkeys(keys)]
    return [f"Not corrected by this sheet: {', '.join(names)}. They need their own compensation or repair."] * bool(
        names
    )


def _open_parameters(subject: Subject, slope: Array | None) -> list[str]:
    """Parameters of the rows that the readings do not determine."""
    if slope is None or subject.covariance is None:
        return []
    std, matters = np.sqrt(np.diag(subject.covariance)), np.any(slope != 0.0, axis=0)
    names = [p.name for p, s, m in zip(subject.parameters, std, matters, strict=True) if m and s > DETERMINED * p.sigma]
    return [
        f"Not determined by the readings: {', '.join(names)}. Measure them before you enter what depends on them."
    ] * bool(names)


def _vector(names: tuple[str, ...], means: str, old: Array, new: Array, sign: str, reference: str) -> list[Row]:
    """Three rows for x, y and z of a place (mm)."""
    return [Row(n, f"{means}, {c}", float(a), float(b), "mm", sign.format(c.upper()), reference)
            for n, c, a, b in zip(names, "xyz", old, new, strict=True)]  # fmt: skip


def _turned(names: tuple[str, ...], means: str, old: AxisLine, new: AxisLine, reference: str) -> list[Row]:
    """Three rows for the components of an axis' direction."""
    sign = f"a larger number leans the positive end of axis {new.axis} towards "
    return [Row(n, f"{means}, {c}", float(a), float(b), "1", f"{sign}+{c.upper()}", reference)
            for n, c, a, b in zip(names, "xyz", old.direction, new.direction, strict=True)]  # fmt: skip


def _moves(axis: str, beside: str = "") -> str:
    return f"a larger number moves axis {axis} towards +{{}}{beside}"


def _siemens(first: Lines, second: Lines) -> list[Row]:
    manual = "commissioning manual IM9 (12/2017), p. 572"
    (old1, new1), (old2, new2) = first, second
    i2, i3 = (old1.point, new1.point), (old2.point - old1.point, new2.point - new1.point)
    rows = _vector(("$TC_CARR4 / MD24550[0]", "$TC_CARR5 / MD24550[1]", "$TC_CARR6 / MD24550[2]"),
                   f"I2: reference point to axis {old1.axis}", *i2, _moves(f"{old1.axis} and {old2.axis}"), manual)  # fmt: skip
    rows += _vector(("$TC_CARR15 / MD24558[0]", "$TC_CARR16 / MD24558[1]", "$TC_CARR17 / MD24558[2]"),
                    f"I3: axis {old1.axis} to axis {old2.axis}", *i3,
                    _moves(old2.axis, f" of axis {old1.axis}"), manual)  # fmt: skip
    closing = _vector(("$TC_CARR18 / MD24500[0]", "$TC_CARR19 / MD24500[1]", "$TC_CARR20 / MD24500[2]"),
                      "I4 = -(I2 + I3)", -(i2[0] + i3[0]), -(i2[1] + i3[1]), "closes the chain along {}", manual)  # fmt: skip
    rows += [replace(row, closes=(rows[k].name, rows[k + 3].name)) for k, row in enumerate(closing)]
    rows += _turned(("$TC_CARR7 / MD24570[0]", "$TC_CARR8 / MD24570[1]", "$TC_CARR9 / MD24570[2]"),
                    f"V1: direction of axis {old1.axis}", old1, new1, manual)  # fmt: skip
    rows += _turned(("$TC_CARR10 / MD24572[0]", "$TC_CARR11 / MD24572[1]", "$TC_CARR12 / MD24572[2]"),
                    f"V2: direction of axis {old2.axis}", old2, new2, manual)  # fmt: skip
    return rows


def _fanuc(first: Lines, second: Lines) -> list[Row]:
    (old1, new1), (old2, new2) = first, second
    rows = _vector(("19700", "19701", "19702"), f"position of the rotary table: axis {old1.axis} from the machine's zero",
                   old1.point, new1.point, _moves(f"{old1.axis} and {old2.axis}"),
                   "A-79348E; number from memory, check it there")  # fmt: skip
    return rows + _vector(("19703", "19704", "19705"), f"offset from axis {old1.axis} to axis {old2.axis}",
                          old2.point - old1.point, new2.point - new1.point, _moves(old2.axis, f" of axis {old1.axis}"),
                          "A-79348E, p. 72 to 86")  # fmt: skip


def _heidenhain(first: Lines, second: Lines) -> list[Row]:
    rows = []
    for (old, new), place in ((first, "axis 1"), (second, "axis 2")):
        reference = "kinematics description of this machine; measured by KinematicsOpt, cycles 451 and 452"
        names = tuple(f"{place}, {old.axis}: {c}" for c in "XYZ")
        rows += _vector(names, f"point on axis {old.axis}", old.point, new.point, _moves(old.axis), reference)
        names = tuple(f"{place}, {old.axis}: direction {c}" for c in "XYZ")
        manual = "KinematicsComp, columns EAA … ECC: iTNC 530 technical manual, p. 680"
        rows += _turned(names, f"direction of axis {old.axis}", old, new, manual)
    return rows


def _haas(first: Lines, second: Lines) -> list[Row]:
    check = "machine rotary zero point: check the numbers of these settings on the control"
    return [
        Row(f"MRZP {c} offset", f"axis {old.axis} along {c}", float(old.point[k]), float(new.point[k]), "mm",
            _moves(old.axis).format(c), check)
        for k, c, (old, new) in ((0, "X", second), (1, "Y", second), (2, "Z", first))
    ]  # fmt: skip


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
        "KinematicsOpt limits a change in one step (often to 0.05 mm; check it): a larger one needs a second measurement.",
        "The table with these values is the machine builder's and differs between machines: this sheet names values, no places.",
        "Squareness and error motions can be put into KinematicsComp where the option is there.",
    )),
    "haas": Control("Haas NGC", _haas, (
        "Holds the place of the rotary axes only (X and Y of the turning axis, Z of the tilting one).",
        "With G254 the B value of the work offset must be zero.",
    )),
}  # fmt: skip
