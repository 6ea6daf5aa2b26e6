"""ISO 230-2 tests of linear axes: the `*_ISO230.dat` files of the ecmc test scripts, mm.

`TGT_DATA[i]` target of position i, `REF_DATA_FWD[i,j]` and `REF_DATA_BWD[i,j]` measured position in cycle j
on the way up and on the way down (the printed report has the two the other way round; the raw log of the X
axis agrees with the file). Before writing it the scripts fit the target as ratio·reference + offset; the
report beside the file (`*.md`) prints that ratio, with which the reference gets its own scale back.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from symfive.campaign import Run
from symfive.errors import InputError
from symfive.files import read_text, shown

_RATIO = re.compile(r"^Target Position \| Reference \| *([-+.0-9eE]+)", re.MULTILINE)
_ENTRY = re.compile(r"(TGT_DATA|REF_DATA_FWD|REF_DATA_BWD)\[(\d{1,9})(?:,(\d{1,9}))?\]=(\S+)")
_TARGET = re.compile(r"TGT_SET_PV=.*:(?:([A-Z])-|Axis)")
TURN_MM = 1e-6


def iso230_axis(path: Path) -> str:
    """The axis whose target the file names, `X` where it names a numbered one."""
    match = _TARGET.search(read_text(path))
    return (match.group(1) if match else None) or "X"


def iso230_run(path: Path, id: str, axis: str, axes: tuple[str, ...], noise_um: float) -> Run:
    """One file as a static run of a laser, rows in measured order (up and down, cycle by cycle); when they were
    read is not recorded.

    At the ends of the range the same target stands twice, reached from either side, since the axis overruns
    it before it turns (ISO 230-2). The overrun has no reading and so no row: instead the second of the two
    commands stands 1 nm further in the new direction (`TURN_MM`), which tells the direction of approach and
    changes no reading that counts.
    """
    targets, measured = _entries(path)
    ratio = _ratio(path)
    positions = sorted(targets)
    cycles = sorted({cycle for _, _, cycle in measured})
    rows: list[tuple[float, float]] = []
    for cycle in cycles:
        for direction, order in (("FWD", positions), ("BWD", positions[::-1])):
            for position in order:
                if (direction, position, cycle) not in measured:
                    raise InputError(f"REF_DATA_{direction}[{position},{cycle}] is missing", path=path)
                target, value = targets[position], measured[direction, position, cycle]
                if rows and rows[-1][0] == target:
                    turn = TURN_MM if direction == "FWD" else -TURN_MM
                    target, value = target + turn, value + turn
                rows.append((target, value))
    command, reading = np.array(rows).T
    idle = {name: np.zeros(len(rows)) for name in axes if name != axis}
    return Run(
        id=id,
        instrument=("laser",),
        sampling="static",
        time=np.arange(float(len(rows))),
        clock="none",
        commands={**idle, axis: command},
        readings={f"{axis}_dev_um": 1e3 * (reading / ratio - command)},
        noise_um=noise_um,
        options={"axis": axis},
    )


def _ratio(path: Path) -> float:
    """|target / reference| as the scripts fitted it, from the report on the same target channel; 1 without a
    report."""
    source = re.search(r"TGT_SET_PV=(\S+)", read_text(path))
    for report in sorted(path.parent.glob("*.md")):
        text = read_text(report)
        match = _RATIO.search(text)
        if source and match and f"Target position source | {source.group(1)}" in text:
            return abs(float(match.group(1))) or 1.0
    return 1.0


def _entries(path: Path) -> tuple[dict[int, float], dict[tuple[str, int, int], float]]:
    targets: dict[int, float] = {}
    measured: dict[tuple[str, int, int], float] = {}
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        match = _ENTRY.match(line.strip().removeprefix("TEST_DATA="))
        if match is None:
            continue
        kind, position, cycle, text = match.groups()
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise InputError(f"{shown(text)} is not a finite number", path=path, line=number)
        if kind == "TGT_DATA":
            targets[int(position)] = value
        elif cycle is None or int(position) not in targets:
            raise InputError(f"{kind} has no cycle or no target", path=path, line=number)
        else:
            measured[kind.removeprefix("REF_DATA_"), int(position), int(cycle)] = value
    if not targets or not measured:
        raise InputError(
            "the file holds no TGT_DATA and REF_DATA", path=path, remedy="it must be an ISO230.dat of the ecmc scripts"
        )
    return targets, measured
