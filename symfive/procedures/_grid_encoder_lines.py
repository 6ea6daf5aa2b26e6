"""Three lines along one axis read by a grid encoder: its six error motions (Wang & Li 2016, (9)-(10))."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run, SetupSigma
from symfive.errors import InputError
from symfive.machine import Axis, Machine
from symfive.procedures._limits import checked
from symfive.procedures._nominal import Nominal
from symfive.procedures._setting import heights, one_after_another, tool_ball_of, vector

HALF_LINE = 200.0
"""Half the usual length of a line, mm."""

PLATE_SETUP = SetupSigma(table_ball=1000.0, tool_ball=20.0, length=0.5, plate=50.0)
"""The plate is laid by hand: its origin does not matter, its orientation is known to 50 µrad after alignment."""


def grid_encoder_lines(
    machine: Machine, *, axis: str = "X",
    offsets: Sequence[tuple[float, float]] = ((0.0, 0.0), (0.0, 100.0), (100.0, 0.0)), every_reading: bool = False,
    pitch: float = 5.0, reach: tuple[float, float] | None = None, both_ways: bool = True,
    centre: Sequence[float] | None = None, hold: Mapping[str, float] | None = None, seconds_per_pose: float = 2.0,
    tool_ball: Sequence[float] | None = None, noise_um: float = 0.3, setup_sigma_um: SetupSigma = PLATE_SETUP,
) -> tuple[Run, ...]:  # fmt: skip
    """Static grid-encoder readings every `pitch` mm along lines of a linear axis, one run per line and plate position.

    With d the direction of motion and (v, w) the other two of the machine's x, y, z in cyclic order, line 1
    is read in the planes dv and dw, line 2 in dv, line 3 in dw (the paper's six readings; `every_reading`:
    both on each). `offsets` (v, w) of the lines, mm: they must not lie on one straight line and the first two
    must differ in w, or the roll is lost (paper 1, det of (10)). For an axis that carries the workpiece they
    are positions on the table, reached by the other axes; for one that carries the tool, and along an axis that this one
    itself carries, they are offsets of the reading head on the tool, since its rotations act on that lever. `reach`
    lowest and highest position of the axis, by default ±200 mm about the line (a vertical axis: from there
    upwards). `centre` mm in the workpiece frame. Raises `InputError` where a pose cannot be reached.
    """
    if axis not in machine.linear_axes:
        raise InputError(f"the machine has no linear axis {axis}", remedy="name a linear axis")
    moved = machine.axes[axis]
    d = int(np.argmax(np.abs(moved.direction)))
    v, w = (d + 1) % 3, (d + 2) % 3
    if len(offsets) != 3 or abs(np.linalg.det([[1.0, *map(float, pair)] for pair in offsets])) < 1e-6:
        raise InputError("the three lines lie in one plane", remedy="give three offsets that are not on one line")
    if abs(offsets[0][1] - offsets[1][1]) < 1e-6:
        raise InputError("lines 1 and 2 have the same second offset, which loses the roll", remedy="let them differ")
    planes = [(v, w), (v, w) if every_reading else (v,), (v, w) if every_reading else (w,)]
    start = np.asarray(vector(centre if centre is not None else (*machine.table_centre, heights(machine)[0])))
    nominal = Nominal(machine)
    unit = np.eye(3)
    at_rest = nominal.commands(hold or {}, 1)
    on_table = machine.structure.carries(axis) == "workpiece"
    on_tool = np.array([not on_table or _carried(machine, axis, i) for i in range(3)], dtype=float)
    usual = np.asarray(tool_ball_of(machine, tool_ball))
    middle = nominal.follow(start[None], usual, hold or {}, "line of the grid encoder")[axis][0]
    targets = _targets(moved, reach, float(middle), upright=d == 2, pitch=pitch)
    targets = np.concatenate([targets, targets[::-1]]) if both_ways else targets
    runs = []
    for number, (offset, seconds) in enumerate(zip(offsets, planes, strict=True), start=1):
        lever = offset[0] * unit[v] + offset[1] * unit[w]
        ball = usual + on_tool * lever
        line = start + nominal.seen_from_workpiece(at_rest, lever)[0]
        rest = nominal.follow(line[None], ball, hold or {}, "line of the grid encoder")
        fixed = {name: float(values[0]) for name, values in rest.items() if name != axis}
        commands = nominal.commands({**fixed, axis: targets}, len(targets))
        for second in seconds:
            letters = "xyz"[d] + "xyz"[second]
            u, s = (nominal.seen_from_workpiece(at_rest, unit[i])[0] for i in (d, second))
            run = Run(
                id=f"{axis.lower()}-line{number}-{letters}", instrument=("grid_encoder",), sampling="static",
                time=seconds_per_pose * np.arange(len(targets), dtype=float), commands=commands,
                table_ball=vector(line), tool_ball=vector(ball), u=vector(u), v=vector(s),
                noise_um=noise_um, setup_sigma_um=setup_sigma_um,
            )  # fmt: skip
            runs.append(checked(machine, run, place="the offsets, the reach or the tool length"))
    return one_after_another(runs)


def _carried(machine: Machine, axis: str, component: int) -> bool:
    """Whether an axis along x, y or z (0, 1, 2) stands on this one: moving it gives this one's carriage no lever."""
    outward = tuple(reversed(machine.structure.workpiece))
    further = outward[outward.index(axis) + 1 :]
    return any(not machine.axes[n].rotary and abs(machine.axes[n].direction[component]) > 0.5 for n in further)


def _targets(axis: Axis, reach: tuple[float, float] | None, middle: float, *, upright: bool, pitch: float) -> Array:
    """Positions of the axis, mm: the wanted ones or ±200 mm about the line's place, upright ones from there upward."""
    low = max(axis.travel[0], middle if upright else middle - HALF_LINE)
    high = min(axis.travel[1], middle + HALF_LINE)
    low, high = reach or (low, high)
    if not (pitch > 0.0 and high - low >= pitch):
        raise InputError(f"no two poses fit between {low:g} and {high:g} mm", remedy="correct reach or pitch")
    return low + pitch * np.arange(int(np.floor((high - low) / pitch + 1e-9)) + 1, dtype=float)
