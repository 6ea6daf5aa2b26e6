"""Runs from a table whose columns have a meaning: a circle, a positioning test, a probe cycle, or a recording as it is.

Which of them a table is follows from what its columns mean:

| columns | becomes |
| --- | --- |
| `angle` and `deviation` or `radius`, or a column each of `ccw`, `cw` | ball-bar circles, positions reconstructed (`polar_run`) |
| `target` and `up`, `down` (n columns each) | a positioning test of ISO 230-2, cycle by cycle |
| `target` and `deviation` or `measured` | the same, rows in measured order, with a `time` or none; also of a rotary axis |
| `X_found`, `Y_found`, `Z_found` and rotary axes | a probe cycle: where the sphere's centre was found |
| readings by their names in a campaign (`dL`, `dx`, `X_dev`, `X_act` …), axes | a recording, dynamic where `time` is there |
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run, SetupSigma
from symfive.errors import InputError
from symfive.importers.polar import ANGLE_ERROR, DIRECTIONS, FITTED, NEAR, as_moved, enough, polar_run
from symfive.instruments import INSTRUMENTS
from symfive.machine import Machine
from symfive.procedures import PLANES, Nominal, tool_ball_of, within_travel

Columns = Mapping[str, Array]
SPHERE = SetupSigma(table_ball=1000.0, tool_ball=20.0)
"""A calibration sphere is put down by eye and a rule."""
PLATE = SetupSigma(plate=1000.0)
"""A grid plate is aligned with the axes to about 1 mm/m; how far it is turned is no error of the machine."""
TURN_MM = 1e-6
"""Where the same target stands twice, reached from either side, the second command is so much further (mm or degree): it tells
the side."""
SMALL = {"um": 1e3, "urad": 1e6 * np.pi / 180.0}
"""Unit of a reading → what multiplies it from mm or degree."""
LARGE = {"mm": 1.0 / SMALL["um"], "deg": 1.0 / SMALL["urad"]}
"""Unit of a reading → what multiplies a noise to it from µm or µrad, in which every noise is given (a force's in N or Nm)."""
KINDS = {kind: (name, units) for name, found in INSTRUMENTS.items() for kind, *units in found.imported}
"""What a column of readings may be called → the instrument, and its units in a campaign for a linear and for a rotary axis."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What a table of readings does not contain.

    `centre` mm of the table ball in the workpiece frame, `tool_ball` mm in the tool frame, `radius` mm of the circle (the
    bar's length), `feed` mm/min, `hold` positions of axes without a column, `axis` of a positioning test, `noise_um` 1σ of a
    reading, µm or µrad (of a force N or Nm); `fitted` where the software removed centre and mean radius; `direction` `ccw` or
    `cw` where the angles do not run as the circle did; `static` where the axes are at rest at each row of a timed recording.
    """

    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tool_ball: tuple[float, float, float] | None = None
    radius: float | None = None
    feed: float | None = None
    plane: str = "XY"
    axis: str = "X"
    hold: Mapping[str, float] = field(default_factory=dict)
    noise_um: float = 0.3
    fitted: bool = False
    angle_error: float = ANGLE_ERROR
    direction: str | None = None
    static: bool = False


def runs_of(machine: Machine, columns: Columns, setting: Setting, id: str) -> list[Run]:
    """The runs that a table's columns (name → (N, n) in mm, degree, s, N, Nm) make: one, or one per direction of a circle.

    Raises `InputError` naming what is missing.
    """
    if "angle" in columns:
        return _circles(machine, columns, setting, id)
    if "target" in columns:
        return [_positioning(machine, columns, setting, id)]
    found = {name.removesuffix("_found"): _one(columns, name) for name in columns if name.endswith("_found")}
    if found:
        commands = {name: _one(columns, name) for name in columns if name in machine.axes}
        time = _one(columns, "time") if "time" in columns else None
        return [probe_run(machine, found, commands, setting, id, time=time)]
    return [recorded_run(machine, columns, setting, id)]


def _one(columns: Columns, name: str) -> Array:
    if columns[name].shape[1] != 1:
        raise InputError(f"{columns[name].shape[1]} columns are called {name}", remedy=f"map one: --map {name}=2")
    return columns[name][:, 0]


def _circles(machine: Machine, columns: Columns, setting: Setting, id: str) -> list[Run]:
    """A sense in each of two columns, one after the other in one list, or one alone."""
    if setting.radius is None or setting.feed is None:
        raise InputError("a circle needs its radius and feed", remedy="add --radius 100 (mm) and --feed 1000 (mm/min)")
    angle = _one(columns, "angle")
    senses = [sense for sense in DIRECTIONS if sense in columns]
    if senses:
        return [
            _circle(machine, angle, _one(columns, sense), replace(setting, direction=sense), f"{id}-{sense}")
            for sense in senses
        ]
    if ("deviation" in columns) == ("radius" in columns):
        problem = "a circle needs one column deviation or radius (of the ball's path)"
        raise InputError(problem, remedy="say which: --map deviation=2:um, or --map radius=2:mm")
    if "radius" in columns:
        deviation = _one(columns, "radius") - setting.radius
        if abs(off := float(np.median(deviation))) > NEAR * setting.radius:
            problem = f"the radii are about {setting.radius + off:.4g} mm, and --radius says {setting.radius:g} mm"
            raise InputError(problem, remedy="give the length of this bar, or correct the column's unit in --map")
    else:
        deviation = _one(columns, "deviation")
    enough(len(angle))
    pieces = _one_way(angle)
    if len(pieces) == 1:
        return [_circle(machine, angle, deviation, setting, id)]
    return [_circle(machine, angle[p], deviation[p], setting, f"{id}-{k}") for k, p in enumerate(pieces, start=1)]


def _one_way(angle: Array) -> list[slice]:
    """The parts of a list of angles (degree; a jump by 360° is none) that rise or fall throughout.

    A step of less than half the usual one is none: it leads from the end of one part to the begin of the next.
    """
    steps = np.diff(np.unwrap(np.radians(angle)))
    senses = np.where(np.abs(steps) > 0.5 * np.median(np.abs(steps)), np.sign(steps), 0.0)
    turning = np.flatnonzero(senses)
    turned = turning[1:][np.diff(senses[turning]) != 0.0]
    edges = [0, *(int(i) if senses[i - 1] == 0.0 else int(i) + 1 for i in turned), len(angle)]
    return [slice(first, last) for first, last in pairwise(edges)]


def _circle(machine: Machine, angle: Array, deviation: Array, setting: Setting, id: str) -> Run:
    assert setting.radius is not None and setting.feed is not None
    if abs(float(np.median(deviation))) > 0.5 * setting.radius:
        problem = f"the deviations are about {float(np.median(deviation)):.4g} mm: these are radii"
        raise InputError(problem, remedy="map them so: --map radius=2:mm")
    angle, deviation = as_moved(angle, deviation, setting.direction)
    return polar_run(
        machine, angle, 1e3 * deviation, centre=setting.centre, radius=setting.radius, feed=setting.feed, id=id,
        plane=setting.plane, hold=setting.hold, tool_ball=setting.tool_ball, noise_um=setting.noise_um,
        setup_sigma_um=FITTED if setting.fitted else None, angle_error=setting.angle_error,
    )  # fmt: skip


def _positioning(machine: Machine, columns: Columns, setting: Setting, id: str) -> Run:
    target = _one(columns, "target")
    sides = [columns.get("up"), columns.get("down")]
    if any(side is not None for side in sides):
        order = np.argsort(target)
        cycles = [side.shape[1] for side in sides if side is not None]
        if len(set(cycles)) != 1:
            problem = f"{cycles[0]} columns up and {cycles[-1]} down"
            raise InputError(problem, remedy="map as many of both: --map up=2-6:um --map down=7-11:um")
        steps = [(side, order if k == 0 else order[::-1]) for k, side in enumerate(sides) if side is not None]
        rows = [(target[i], side[i, j]) for j in range(cycles[0]) for side, ways in steps for i in ways]
        where, deviation = (np.array(column) for column in zip(*rows, strict=True))
        _refuse_positions(where, deviation, "up and down")
        return positioning_run(machine, where, deviation, setting, id)
    if ("deviation" in columns) == ("measured" in columns):
        problem = "a positioning test needs one column deviation or measured beside the target, or columns up and down"
        remedy = "say which: --map deviation=2:um, --map measured=2:mm, or once for each column --map up=2:um --map down=3:um"
        raise InputError(problem, remedy=remedy)
    time = _one(columns, "time") if "time" in columns else None
    if "measured" in columns:
        deviation = _one(columns, "measured") - target
        _refuse_elsewhere(target, deviation)
        return positioning_run(machine, target, deviation, setting, id, time=time)
    deviation = _one(columns, "deviation")
    _refuse_positions(target, deviation, "deviation")
    return positioning_run(machine, target, deviation, setting, id, time=time)


def _refuse_positions(target: Array, values: Array, columns: str) -> None:
    """Raise `InputError` where values that are to be deviations move as far as their targets: they are nearer to these."""
    way, moved = target - target.mean(), values - values.mean()
    if np.abs(moved - way).sum() < np.abs(moved).sum():
        problem = f"the readings of {columns} move with the targets: these are positions and no deviations"
        raise InputError(problem, remedy="give deviations, or rows in measured order with --map measured=2:mm")


def _refuse_elsewhere(target: Array, deviation: Array) -> None:
    """Raise `InputError` where measured positions deviate from their targets by more than half of the motion: they have another
    sign or unit."""
    way, moved = target - target.mean(), deviation - deviation.mean()
    if np.abs(moved).sum() > 0.5 * np.abs(way).sum():
        ratio = 1.0 + float(way @ moved) / float(way @ way or 1.0)
        problem = f"the measured position moves by {ratio:.4g} where the target moves by 1"
        raise InputError(
            problem, remedy="give the unit in --map measured=2:mm; of the opposite sign multiply the column by -1"
        )


def positioning_run(
    machine: Machine, target: Sequence[float] | Array, deviation: Sequence[float] | Array, setting: Setting, id: str, *,
    time: Array | None = None,
) -> Run:  # fmt: skip
    """A static run of a laser along (mm) or about (degree) `setting.axis`: `target` and `deviation` (N,) in measured order (ISO
    230-2), at `time` (N,) s where it was recorded.

    At the ends the same target may stand twice, reached from either side after an overrun without a reading.
    """
    if setting.axis not in machine.axes:
        raise InputError(f"the machine has no axis {setting.axis}", remedy=f"name one: --axis {machine.axis_names[0]}")
    unit = "urad" if machine.axes[setting.axis].rotary else "um"
    way = _from_both_sides(np.asarray(target, dtype=float))
    commands = Nominal(machine).commands({**setting.hold, setting.axis: way}, len(way))
    run = Run(
        id=id, instrument=("laser",), sampling="static", clock="none" if time is None else "recorded",
        time=np.arange(float(len(way))) if time is None else time - time[0], commands=commands,
        readings={f"{setting.axis}_dev_{unit}": SMALL[unit] * np.asarray(deviation, dtype=float)},
        tool_ball=tool_ball_of(machine, setting.tool_ball), noise_um=setting.noise_um, options={"axis": setting.axis},
    )  # fmt: skip
    return within_travel(machine, run, place="the targets' unit or the travel in the machine file")


def _from_both_sides(target: Array) -> Array:
    """Targets (N,) in measured order, separate where an axis turns back at one that is read twice as often as others: what is
    read there first is read where the axis came from, the other half after an overrun."""
    way = np.array(target)
    stops = np.split(np.arange(len(way)), np.flatnonzero(np.diff(way)) + 1)
    usual = min(map(len, stops))
    for before, own, after in zip(stops, stops[1:], [*stops[2:], None], strict=False):
        came = np.sign(target[own[0]] - target[before[0]])
        turns = after is None or came * (target[after[0]] - target[own[0]]) < 0.0
        if turns and len(own) >= 2 * usual:
            way[own[(len(own) + 1) // 2 :]] -= came * TURN_MM
    return way


def probe_run(
    machine: Machine, found: Columns, commands: Columns, setting: Setting, id: str, *, time: Array | None = None
) -> Run:
    """A static run of a touch probe: `found` linear axis → (N,) mm at which a centred touch would stand, `commands` rotary axis →
    (N,) degree; both machine coordinates.

    The readings are found less nominal coordinates of the axes, the nominal ones those of a sphere at `setting.centre`. It need
    only be right to a few tenths of a millimetre; its prior is `SPHERE`. Raises `InputError` where an axis is missing, and for
    coordinates of the tip.
    """
    missing = [name for name in machine.linear_axes if name not in found]
    if missing:
        problem = f"where {', '.join(missing)} found the centre is missing"
        raise InputError(problem, remedy=f"add --map {missing[0]}_found=2:mm")
    nominal, ball, rows = Nominal(machine), tool_ball_of(machine, setting.tool_ball), len(next(iter(found.values())))
    positions, tip = (
        nominal.follow(np.tile(setting.centre, (rows, 1)), tool, {**setting.hold, **commands}, f"probe cycle {id}")
        for tool in (ball, (0.0, 0.0, 0.0))
    )
    if _distance(found, tip) < _distance(found, positions):
        problem = "the found coordinates are those of the tip, with the tool's length in them, not of the axes"
        raise InputError(
            problem, remedy="give those of the axes; where no axis turns the tool, --tool-ball 0,0,0 does too"
        )
    run = Run(
        id=id, instrument=("touch_probe",), sampling="static", clock="none" if time is None else "recorded",
        time=np.arange(float(rows)) if time is None else time - time[0], commands=positions,
        readings={f"{name}_dev_um": 1e3 * (found[name] - positions[name]) for name in machine.linear_axes},
        table_ball=setting.centre, tool_ball=ball, noise_um=setting.noise_um, setup_sigma_um=SPHERE,
    )  # fmt: skip
    return within_travel(
        machine, run, place="the found coordinates (machine coordinates?) or the travel in the machine file"
    )


def _distance(found: Columns, nominal: Columns) -> float:
    """Root of the sum of squares between found and nominal coordinates, mm."""
    return float(np.sqrt(sum(np.sum((column - nominal[name]) ** 2) for name, column in found.items())))


def recorded_run(machine: Machine, columns: Columns, setting: Setting, id: str) -> Run:
    """A recording: dynamic if it has a time and is not `setting.static`. Axes without a column stay at `setting.hold`
    or at home; at least one axis needs a column or `hold`."""
    time = _one(columns, "time") if "time" in columns else None
    dynamic = time is not None and not setting.static
    readings, noise, read = dict[str, Array](), dict[str, float](), dict[str, list[str]]()
    for name in columns:
        kind = name if name in KINDS else name.partition("_")[2]
        if kind not in KINDS:
            continue
        axis = machine.axes.get(name.partition("_")[0])
        instrument, units = KINDS[kind]
        unit = units[axis is not None and axis.rotary]
        readings[f"{name}_{unit}"] = _one(columns, name) * SMALL.get(unit, 1.0)
        noise[instrument] = setting.noise_um * LARGE.get(unit, 1.0)
        read.setdefault(instrument, []).append(name.partition("_")[0])
    commands = {name: _one(columns, name) for name in columns if name in machine.axes}
    if "laser" in read and not dynamic:
        commands |= {name: _from_both_sides(commands[name]) for name in read["laser"] if name in commands}
    known = {*commands, *setting.hold}
    named = [axis for axes in read.values() for axis in axes if axis in machine.axes and axis not in known]
    if not readings or not known or named:
        there = f"columns ({', '.join(columns)})" if columns else "names in the header"
        lacking = "reading" if not readings else f"commanded position of {named[0] if named else 'an axis'}"
        axis = machine.axes[(named or machine.axis_names)[0]]
        remedy = (
            f"map the columns: --map {axis.name}=2:{axis.unit} --map dL=3:um, or angle and deviation of a circle, or target, up "
            "and down of a positioning test, or X_found, Y_found, Z_found and the rotary axes of a probe cycle"
        )
        if readings:
            remedy = f"map it: --map {axis.name}=2:{axis.unit}; of a test at a standstill give --hold {axis.name}=0"
        raise InputError(f"the {there} hold no {lacking}", remedy=remedy)
    rows = len(next(iter(readings.values())))
    u, v = (np.eye(3)[i] for i in PLANES[setting.plane]) if "grid_encoder" in noise else (None, None)
    run = Run(
        id=id, instrument=tuple(noise), sampling="dynamic" if dynamic else "static", clock="none" if time is None else "recorded",
        time=np.arange(float(rows)) if time is None else time - time[0],
        commands=Nominal(machine).commands({**setting.hold, **commands}, rows), readings=readings, table_ball=setting.centre,
        tool_ball=tool_ball_of(machine, setting.tool_ball), length=setting.radius,
        noise_um=noise if len(noise) > 1 else next(iter(noise.values())),
        u=None if u is None else (float(u[0]), float(u[1]), float(u[2])),
        v=None if v is None else (float(v[0]), float(v[1]), float(v[2])),
        options=_options(read, dynamic), setup_sigma_um=SetupSigma() if u is None else PLATE,
    )  # fmt: skip
    return within_travel(machine, run, place="a position's unit or the travel in the machine file")


def _options(read: Mapping[str, Sequence[str]], dynamic: bool) -> dict[str, object]:
    """Which axes the instruments (name → axes of its columns) of a run are of; no axis moves in corners between its rows."""
    found: dict[str, object] = {"between": "curve"} if dynamic else {}
    if "encoder" in read:
        found["encoder_axes"] = list(read["encoder"])
    for instrument in ("drive_force", "laser"):
        if instrument in read:
            found["axis"] = read[instrument][0]
    return found
