"""Target `isg`: the volumetric compensation file "ISG CSV" of ISG kernels and Beckhoff TF5280.

Columns are named in a header line and separated by blanks, `//` begins a comment, `#` a new block (documentation of the ISG
kernel, "volumetric compensation", and of TF5280). Location errors are named in the letter order of DIN ISO 230 (`X0C` for
EX0C), error motions as here. One block holds the location errors, one block each axis' error motions over its positions.
Both are those of the whole model, whether the machine file or an effect brought them. Lengths in mm, angles and rotary
positions in rad and degree as the comments in the file say: units are a draft to be verified.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.codegen._subject import Subject
from symfive.errors import InputError
from symfive.machine import Axis, Machine

LETTERS = "XYZABC"
STEPS = 72
"""Least steps of a table: over the travel of a linear axis, over a revolution of a rotary one."""
MOST_STEPS = 200_000
"""An error motion that jumps would need ever more."""
INTERPOLATION = 1e-3
"""What a control that interpolates linearly between the rows may miss, in parts of an error's largest value."""
FORMAT = "{:.17g}"


@dataclass(frozen=True)
class _Errors:
    """Location errors and their expanded uncertainty (mm, rad), None where nothing was measured; per axis the names of its error
    motions and what gives them (k, N) mm and rad at its positions (N,) mm or degree; what the format cannot hold."""

    locations: Mapping[str, float]
    spread: Mapping[str, float] | None
    motions: Mapping[str, tuple[tuple[str, ...], ca.Function]]
    left_out: tuple[str, ...]


def isg_files(subject: Subject, prefix: str) -> dict[str, str]:
    """The CSV and a note on signs and sides. Raises `InputError` for errors of an axis that the format has no letter for."""
    machine, errors = subject.machine, _errors(subject)
    lines = [
        f"// symfive: {machine.name}, {machine.structure.code}; model sha256 {subject.digest}",
        "// draft, to be verified on the control: units mm and rad, rotary positions in degree; signs as in the note beside it",
    ]
    if errors.locations:
        lines += [" ".join(name[1:] for name in errors.locations)]
        lines += [" ".join(FORMAT.format(value) for value in errors.locations.values())]
    within: list[str] = []
    if errors.spread:
        lines.append(
            f"// U (k = 2) of these, from the fit alone: {' '.join(f'{u:.2g}' for u in errors.spread.values())}"
        )
        within = [name for name, u in errors.spread.items() if abs(errors.locations[name]) < u]
    for name, (motions, function) in errors.motions.items():
        at, values = _sampled(machine.axes[name], function)
        lines += ["#", " ".join([name, *motions])]
        lines += [" ".join(FORMAT.format(v) for v in row) for row in np.column_stack([at, values.T])]
    return {f"{prefix}.isg.csv": "\n".join(lines) + "\n", f"{prefix}.isg.txt": _note(machine, errors.left_out, within)}


def _errors(subject: Subject) -> _Errors:
    """The model's errors of every axis, by what they depend on."""
    machine, values = subject.machine, ca.DM(list(subject.values))
    q, p = ca.SX.sym("q", len(subject.axes)), ca.SX.sym("p", len(subject.parameters))
    tool = ca.SX.sym("tool", 3)
    row = subject.row(q, p, tool)
    for name in {name[2:].lstrip("0") for name in (*row.location, *row.motion)}:
        if name not in LETTERS or machine.axes[name].rotary != (name in "ABC"):
            problem = f"the table has no {machine.axes[name].kind} axis called {name}"
            raise InputError(problem, remedy="name linear axes X Y Z and rotary ones A B C, or use the target c")
    found = ca.vertcat(ca.SX(0, 1), *row.location.values())
    number = ca.Function("locations", [p], [found, ca.jacobian(found, p)])
    value, slope = (np.asarray(part.full()) for part in number(values))
    shown = [i for i in range(len(row.location)) if subject.fitted or value[i, 0] != 0.0]
    names = list(row.location)
    known = None if subject.covariance is None else subject.expanded(slope)
    spread = None if known is None else {names[i]: float(known[i]) for i in shown}
    left_out = [f"{key}: {reason}" for key, reason in subject.left_out]
    left_out += [
        f"{effect.key}: changes the position of an axis or of the tool, which the format has no column for"
        for effect in subject.effects
        if any(kind in ("axis", "shift", "tool") for kind, _ in subject.changed(effect))
    ]
    motions: dict[str, dict[str, Any]] = {}
    for name, motion in row.motion.items():
        over = [axis for i, axis in enumerate(subject.axes) if ca.depends_on(motion, q[i])]
        over += ["the tool's length"] if ca.depends_on(motion, tool) else []
        if over in ([], [name[2:]]):
            motions.setdefault(name[2:], {})[name] = motion
        else:
            left_out.append(f"{name}: a function of {' and '.join(over)}")
    return _Errors(
        {names[i]: float(value[i, 0]) for i in shown}, spread,
        {axis: (tuple(motions[axis]), _over(subject, axis, ca.substitute(ca.vertcat(*motions[axis].values()), p, values), q))
         for axis in subject.axes if axis in motions},
        tuple(left_out),
    )  # fmt: skip


def _over(subject: Subject, axis: str, motions: Any, q: Any) -> ca.Function:
    """Error motions over the position of their axis in the file's unit, all other axes at zero."""
    at, place = ca.SX.sym("at"), subject.axes.index(axis)
    stand = ca.SX.zeros(len(subject.axes))
    stand[place] = at * subject.machine.axes[axis].to_internal
    return ca.Function("motions", [at], [ca.densify(ca.substitute(motions, q, stand))])


def _sampled(axis: Axis, function: ca.Function) -> tuple[Array, Array]:
    """Positions (N,), so near that straight lines between them are good enough, and the error motions (k, N) there."""
    low, high = axis.travel
    steps = STEPS * (max(1, round((high - low) / 360.0)) if axis.rotary else 1)
    while steps <= MOST_STEPS:
        at = np.linspace(low, high, 2 * steps + 1)
        values = np.asarray(function(at[None, :]).full())
        missed = np.abs(values[:, 1::2] - 0.5 * (values[:, :-1:2] + values[:, 2::2])).max(axis=1)
        if np.all(missed <= INTERPOLATION * np.abs(values).max(axis=1)):
            return at[::2], values[:, ::2]
        steps *= 2
    problem = f"the error motions of {axis.name} change too fast for a table of {MOST_STEPS} rows"
    raise InputError(problem, remedy="lower their order, or use the target c")


def _note(machine: Machine, left_out: tuple[str, ...], within: list[str]) -> str:
    structure = machine.structure
    lines = [
        "Draft, to be verified on the control before use.", "",
        f"machine           {machine.name}",
        f"chain             {structure.code} (from the workpiece over the bed to the tool)",
        f"workpiece axes    {' '.join(structure.workpiece) or 'none'}",
        f"tool axes         {' '.join(structure.tool) or 'none'}",
        "file format       ISG_CSV", "",
        "Signs: every error is the displacement or turn of the carried component in the frame of its parent (ISO 230-1), and a",
        "positive command moves the tool relative to the workpiece (ISO 841). For the workpiece axes the control may count the",
        "other way: set `workpiece_axes` and `negate` in its list so that one known error moves the tool the right way, and",
        "check that with a dial gauge for one axis of each side.", "",
        *([f"Within their uncertainty U (k = 2), and in the table; write 0 to leave one out: {', '.join(within)}", ""]
          if within else []),
        "Not in the file:", *(f"  {entry}" for entry in left_out or ("nothing was left out",)),
    ]  # fmt: skip
    return "\n".join(lines) + "\n"
