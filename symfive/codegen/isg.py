"""Target `isg`: the volumetric compensation file "ISG CSV" of ISG kernels and Beckhoff TF5280, and its reading back.

Columns are named in a header line and separated by blanks, `//` begins a comment, `#` a new block (documentation of the ISG
kernel, "volumetric compensation", and of TF5280). Location errors are named in the letter order of DIN ISO 230 (`X0C` for
EX0C), error motions as here. One block holds the location errors, one block each axis' error motions over its positions.
Lengths in mm, angles and rotary positions in rad and degree as the comments in the file say: units are a draft to be verified.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from symfive.codegen._entry import COVERAGE
from symfive.codegen._subject import Subject
from symfive.errors import InputError
from symfive.files import read_text
from symfive.kinematics import basis_of
from symfive.machine import ErrorTerm, Machine

POINTS, MOST = 73, 1e12
FORMAT = "{:.17g}"


def isg_files(subject: Subject, prefix: str) -> dict[str, str]:
    """The CSV and a note on signs and sides."""
    machine = subject.machine
    values = {p.name: v * p.scale for p, v in zip(subject.parameters, subject.values, strict=True)}
    locations = [term for term in machine.location_errors if values[term.name] != 0.0 or subject.fitted]
    lines = [
        f"// symfive: {machine.name}, {machine.structure.code}; model sha256 {subject.digest}",
        "// draft, to be verified on the control: units mm and rad, rotary positions in degree; signs as in the note beside it",
    ]
    if locations:
        lines += [" ".join(_short(term.name) for term in locations)]
        lines += [" ".join(FORMAT.format(values[term.name]) for term in locations)]
    spread = _expanded(subject, locations)
    if spread:
        lines.append(f"// U (k = 2) of these, from the fit alone: {' '.join(f'{u:.2g}' for u in spread.values())}")
    within = [name for name, u in spread.items() if abs(values[name]) < u]
    blocks, left_out = [], [f"{key}: {reason}" for key, reason in subject.left_out]
    left_out += [
        f"{effect.key}: an effect of its own, which the format has no column for" for effect in subject.effects
    ]
    for name in machine.axis_names:
        terms = [t for t in machine.error_motions if t.axis == name and t.over == (name,)]
        if terms:
            blocks.append(_table(machine, name, terms, values))
    left_out += [
        f"{t.name}: a function of {' and '.join(t.over)}" for t in machine.error_motions if t.over != (t.axis,)
    ]
    for block in blocks:
        lines += ["#", *block]
    return {f"{prefix}.isg.csv": "\n".join(lines) + "\n", f"{prefix}.isg.txt": _note(machine, left_out, within)}


def _expanded(subject: Subject, locations: Sequence[ErrorTerm]) -> dict[str, float]:
    """Expanded uncertainty of location errors, mm and rad; empty where nothing was measured."""
    if subject.covariance is None:
        return {}
    names = {term.name for term in locations}
    spread = zip(subject.parameters, np.sqrt(np.diag(subject.covariance)), strict=True)
    return {p.name: COVERAGE * p.scale * float(std) for p, std in spread if p.name in names}


def _short(name: str) -> str:
    return name[1:]


def _table(machine: Machine, axis: str, terms: list[ErrorTerm], values: Mapping[str, float]) -> list[str]:
    """Header and rows of one axis: its position (mm or degree), then every error motion there (mm or rad)."""
    at = np.linspace(*machine.axes[axis].travel, POINTS)
    columns = [at]
    for term in terms:
        basis = basis_of(term, machine)
        weights = np.array([values[f"{term.name}.{n}"] for n in basis.names])
        columns.append(basis.matrix(at * machine.axes[axis].to_internal) @ weights)
    rows = [" ".join(FORMAT.format(v) for v in row) for row in np.column_stack(columns)]
    return [" ".join([axis, *(term.name for term in terms)]), *rows]


def _note(machine: Machine, left_out: list[str], within: list[str]) -> str:
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
        *([f"Smaller than their uncertainty U (k = 2), not to be entered: {', '.join(within)}", ""] if within else []),
        "Not in the file:", *(f"  {entry}" for entry in left_out or ["nothing was left out"]),
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def read_isg(path: Path | str, machine: Machine) -> dict[str, float]:
    """The parameters of a machine from such a file, by name in µm and µrad; tables by least squares in the machine's bases.

    Raises `InputError` with the line for text where a number belongs, a wrong number of columns or rows and unknown names.
    """
    path = Path(path)
    found: dict[str, float] = {}
    for header_line, header, rows in _blocks(path):
        if not rows:
            raise InputError("the block has no rows", path=path, line=header_line, remedy="complete the file")
        if header[0] in machine.axes:
            found |= _motions(path, header_line, machine, header, np.array(rows))
        else:
            found |= _locations(path, header_line, machine, header, rows)
    return found


def _blocks(path: Path) -> list[tuple[int, list[str], list[list[float]]]]:
    """(line, column names, rows) of every block."""
    blocks: list[tuple[int, list[str], list[list[float]]]] = []
    fresh = True
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        words = line.split("//", 1)[0].split()
        if words and words[0].startswith("#"):
            fresh = True
        elif words and fresh:
            blocks.append((number, words, []))
            fresh = False
        elif words:
            blocks[-1][2].append(_values(path, number, words, len(blocks[-1][1])))
    return blocks


def _values(path: Path, line: int, words: list[str], count: int) -> list[float]:
    if len(words) != count:
        raise InputError(f"{len(words)} values under {count} names", path=path, line=line, remedy="complete the row")
    try:
        values = [float(word) for word in words]
        if all(abs(value) < MOST for value in values):
            return values
        raise ValueError
    except ValueError:
        raise InputError("text stands where a number belongs", path=path, line=line, remedy="write numbers") from None


def _locations(path: Path, line: int, machine: Machine, names: list[str], rows: list[list[float]]) -> dict[str, float]:
    found: dict[str, float] = {}
    if len(rows) != 1 or len(set(names)) != len(names):
        raise InputError(
            "location errors are one row of different names", path=path, line=line, remedy="correct the block"
        )
    known = {_short(term.name): term for term in machine.location_errors}
    for name, value in zip(names, rows[0], strict=True):
        if name not in known:
            remedy = f"it varies {', '.join(known) or 'none'}"
            raise InputError(f"the machine varies no location error {name[:40]}", path=path, line=line, remedy=remedy)
        found[known[name].name] = value / (1e-6 if known[name].angular else 1e-3)
    return found


def _motions(path: Path, line: int, machine: Machine, names: list[str], rows: np.ndarray) -> dict[str, float]:
    found: dict[str, float] = {}
    low, high = machine.axes[names[0]].travel
    if rows[:, 0].min() < low - 1e-9 * abs(low) or rows[:, 0].max() > high + 1e-9 * abs(high):
        remedy = f"it must be a table of this machine: {low:g}…{high:g}"
        raise InputError(f"a position lies outside the travel of {names[0]}", path=path, line=line, remedy=remedy)
    at = rows[:, 0] * machine.axes[names[0]].to_internal
    for column, name in enumerate(names[1:], start=1):
        term = machine.errors.get(name)
        if term is None or term.is_location:
            raise InputError(f"the machine varies no error motion {name[:40]}", path=path, line=line, remedy="add it")
        basis = basis_of(term, machine)
        weights = np.linalg.lstsq(basis.matrix(at), rows[:, column], rcond=None)[0]
        scale = 1e-6 if term.angular else 1e-3
        found |= {f"{name}.{n}": float(w) / scale for n, w in zip(basis.names, weights, strict=True)}
    return found
