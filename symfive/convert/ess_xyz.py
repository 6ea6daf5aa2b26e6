"""Linear axes X, Y, Z of a target drive unit: ISO 230-2 tests and raw logs of laser, command and motor
resolver.

A. Sandström, anderssandstrom/ecmc_target_muts_logger. The laser is a triangulation sensor (`ILD_DownSample`,
mm).
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Campaign, Run
from symfive.convert._files import Log, files, linear_axes, positive_name, read_log
from symfive.convert._iso230 import iso230_axis, iso230_run
from symfive.errors import InputError

AXES = ("X", "Y", "Z")
NOISE_UM = 0.4  # of the laser: one digit is 0.408 µm
REST_S = 1.0  # the axis has come to rest this long before the test number is written
COUNTS_PER_MM = {"X": 3.0818e6, "Z": -9.1428e7}  # motor resolver; the sign is that of the counts


def ess_xyz(folder: Path) -> Campaign:
    """Three kinds of runs, each with the other axes at zero.

    - `*_ISO230.dat`: static, instrument `laser`, the test script's own fit of offset and scale undone in
      scale;
    - `*.log` with ISO 230-2 test numbers (1jii on the way up, 2jii down, cycle j, position ii): static,
      instruments `laser` and `encoder` (resolver), the overrun at either end as rows of its own, raw scale,
      true times;
    - every `*.log` once more as a dynamic run `…-scan`: the laser's rows, the motor resolver as the command.
    """
    machine = linear_axes("ESS target drive unit", dict.fromkeys(AXES, (-30.0, 30.0)))
    runs: list[Run] = []
    for path in sorted(folder.glob("*_ISO230.dat")):
        runs.append(iso230_run(path, positive_name(path.name.split(".")[0]), iso230_axis(path), AXES, NOISE_UM))
    for path in sorted(folder.glob("*.log")):
        runs += _log_runs(read_log(path))
    if not runs:
        files(folder, "*_ISO230.dat")
    notes = ("temperatures in the logs are not converted: the model has no temperature",)
    return Campaign(
        machine=machine,
        runs=tuple(runs),
        name="ess-xyz" if folder.name == "ess-xyz" else f"ess-xyz/{folder.name}",
        notes=notes,
    )


def _log_runs(log: Log) -> list[Run]:
    match = next((m for name in log.channels if (m := re.search(r":([XYZ])-PosCmd$", name))), None)
    if match is None:
        raise InputError("the log names no axis (…:X-PosCmd)", path=log.path)
    axis = match.group(1)
    runs = [_scan(log, axis)]
    static = _stops(log, axis)
    return [static, *runs] if static is not None else runs


def _positions(log: Log, axis: str) -> Array:
    """The resolver in mm (N,), its zero where the control's own position is zero.

    Scale: the known counts per mm, else a straight line through the control's position at rest.
    """
    resolver, actual = log.find("EL7201-PosAct"), log.find(f":{axis}-PosAct")
    speed = np.abs(np.gradient(actual.value, actual.time))
    rest = speed < 1e-3
    if rest.sum() < 10:
        raise InputError("the axis is nowhere at rest, so the resolver's zero is unknown", path=log.path)
    counts = resolver.at(actual.time[rest])
    scale = COUNTS_PER_MM.get(axis) or float(np.polyfit(actual.value[rest], counts, 1)[0])
    return np.asarray(resolver.value / scale - float(np.mean(counts / scale - actual.value[rest])))


def _laser_sign(laser: Array, position: Array) -> float:
    return -1.0 if np.polyfit(position, laser, 1)[0] < 0.0 else 1.0


def _scan(log: Log, axis: str) -> Run:
    """The laser against the resolver, row by row of the laser (10 Hz, lost rows stay lost)."""
    laser, resolver = log.find("ILD_DownSample"), log.find("EL7201-PosAct")
    inside = (laser.time >= resolver.time[0]) & (laser.time <= resolver.time[-1])
    time, reading = laser.time[inside], laser.value[inside]
    increasing = np.concatenate([[True], np.diff(time) > 0.0])
    time, reading = time[increasing], reading[increasing]
    command = np.interp(time, resolver.time, _positions(log, axis))
    deviation = 1e3 * (_laser_sign(reading, command) * reading - command)
    return Run(
        id=f"{positive_name(log.path.stem)}-scan",
        instrument=("laser",),
        sampling="dynamic",
        time=time - time[0],
        commands={**_idle(axis, len(time)), axis: command},
        readings={f"{axis}_dev_um": deviation - deviation.mean()},
        noise_um=NOISE_UM,
        options={"axis": axis},
    )


def _stops(log: Log, axis: str) -> Run | None:
    """The stops of an ISO 230-2 test, means over the last `REST_S` before each test number, and the
    overruns."""
    tests, command = log.find("TestNumber"), log.find(f":{axis}-PosCmd")
    iso = (tests.value >= 1000.0) & (tests.value < 3000.0)
    if iso.sum() < 4:
        return None
    begin, end = tests.time[iso][0], tests.time[iso][-1]
    stops = [float(t) for t in tests.time[iso]]
    for k in np.flatnonzero((command.time > begin) & (command.time < end)):
        leave = command.time[k + 1] if k + 1 < len(command.time) else end
        if not any(command.time[k] < t <= leave for t in stops):
            stops.append(float(leave))
    stops.sort()
    laser, resolver = log.find("ILD_DownSample"), log.find("EL7201-PosAct")
    position = type(resolver)(resolver.time, _positions(log, axis))
    held = np.searchsorted(command.time, np.array(stops) - 1e-3, side="right") - 1  # the command before each
    target = command.value[np.maximum(held, 0)]
    reading = np.array([laser.mean(t - REST_S, t) for t in stops])
    deviation = 1e3 * (_laser_sign(reading, target) * reading - target)
    return Run(
        id=f"{positive_name(log.path.stem)}-stops",
        instrument=("laser", "encoder"),
        sampling="static",
        time=np.array(stops) - stops[0],
        commands={**_idle(axis, len(stops)), axis: target},
        readings={
            f"{axis}_dev_um": deviation - deviation.mean(),
            f"{axis}_act_mm": np.array([position.mean(t - REST_S, t) for t in stops]),
        },
        noise_um={"laser": NOISE_UM, "encoder": 2e-4},
        options={"axis": axis, "encoder_axes": [axis]},
    )


def _idle(axis: str, rows: int) -> dict[str, Array]:
    return {name: np.zeros(rows) for name in AXES if name != axis}
