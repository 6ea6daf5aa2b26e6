"""The polar form of a ball bar: deviation over angle, as its software exports it, without the control's positions.

The positions are reconstructed from the programme: a circle about the ball at constant feed (ISO 230-4), from the angles
themselves. The recording begins and ends in motion, so the drives do too (`start = "moving"`).

The software infers the angle from time: it sees the bar, not the command. Where an axis reverses the readings jump
within less than the angle's error; those next to a reversal are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run, SetupSigma
from symfive.errors import InputError, among
from symfive.importers.mapping import in_unit
from symfive.importers.split import rows_of
from symfive.importers.table import read_table
from symfive.instruments import ball_instrument
from symfive.machine import Machine
from symfive.procedures import PLANES, Nominal, tool_ball_of, within_travel
from symfive.screen import plural

EVEN = 0.05
"""Steps of the angle may differ from their median by this share (and be whole multiples of it where rows are lost)."""
LEAST_ROWS = 20
MOVES_MM = 1e-6
"""An axis that moves less on a circle stands still."""
ROUND_MM = 1e-3
"""By how much the radius of a planned circle may vary."""
NEAR = 0.02
"""Numbers that are so near to the radius are lengths, not deviations."""
COLUMNS = ("angle", "deviation")
DIRECTIONS = ("ccw", "cw")
MM_IN = 25.4
SHORT_DEG = 20.0
"""So short an arc is no circular test: one turn in radians is 6.28."""
STRAY_DEG = 10.0
"""No angle lies so far beyond the planned arc: run-up, lag and the software's start are a few degrees."""
SLOW_MIN = 60.0
"""A circle that takes longer has its feed in another unit."""
FITTED = SetupSigma(table_ball=1000.0, tool_ball=20.0, length=1000.0)
"""Set-up of a circle whose software has taken its own mean radius and centre off: neither is known any more."""
ANGLE_ERROR = 0.5
"""How well the software's angle is known, degree: a start found in the bar's own motion, a servo lag of 20 to 50 ms."""
UNKNOWN_LAG_MS = 25.0
"""1σ of the lag of axes whose drives the machine file does not state: the bar is where they are, 20 to 50 ms late."""
ZERO = 0.1
"""Mean deviation in units of one reading's noise from which on it is no accident: no bar is calibrated that well."""


def read_polar(
    path: Path | str, *, unit: str | None = None, columns: Sequence[str] = COLUMNS, direction: str | None = None
) -> tuple[Array, Array]:
    """Angle (N,) in degree and deviation (N,) in µm from columns of a text file (`read_table`).

    `columns` names those of the file in order: `angle`, `deviation`, and anything else for a column that is not needed. `unit`
    of the deviation in the file (`mm`, `um`, `in`, …), by default the one that its head has, else `um`; the angle is in that of
    the head, else in degree. `direction` `ccw` or `cw` if the file sorts the angles whatever the direction of the circle; a file
    in the opposite order is read from its end. Raises `InputError` naming file and line.
    """
    path = Path(path)
    if direction is not None:
        among(direction, DIRECTIONS, f'direction "{direction}" is unknown')
    if any(list(columns).count(name) != 1 for name in COLUMNS):
        problem = f"the columns {','.join(columns)} do not name {' and '.join(COLUMNS)} once each"
        raise InputError(problem, remedy="write --columns angle,deviation in the order of the file, - for any other")
    table = read_table(path)
    if (count := len(table.names)) != len(columns):
        problem = f"the rows have {count} numbers and {len(columns)} columns are named ({','.join(columns)})"
        remedy = f"name all {count}, as --columns {','.join([*COLUMNS, *['-'] * (count - 2)])}"
        if count == 2 * len(columns):
            remedy += "; if these are decimal commas, separate the columns by semicolons"
        raise InputError(problem, path=path, line=table.lines[0], remedy=remedy)
    enough(len(table.lines), path)
    angle = in_unit(table, list(columns).index("angle"), "deg")
    deviation = in_unit(table, list(columns).index("deviation"), "um", unit)
    return as_moved(angle, deviation, direction)


def enough(count: int, path: Path | None = None) -> None:
    """Raise `InputError` where a circle has too few readings."""
    if count < LEAST_ROWS:
        problem = f"{plural(count, 'reading')} of angle and deviation on one circle"
        raise InputError(problem, path=path, remedy=f"export at least {LEAST_ROWS}, one a line")


def as_moved(angle: Array, deviation: Array, direction: str | None) -> tuple[Array, Array]:
    """Both from their end where the angles run against the `direction` of the motion."""
    against = direction is not None and (np.median(np.diff(angle)) > 0.0) != (direction == "ccw")
    return (angle[::-1], deviation[::-1]) if against else (angle, deviation)


def along_run(angle: Array, deviation: Array, direction: str | None, run: str) -> tuple[Array, Array]:
    """Angle and deviation in the order of a planned run; some software sorts a clockwise circle by rising angles. Raises
    `InputError` where the angles fall and the run is counter-clockwise."""
    if direction == "ccw" and np.median(np.diff(angle)) < 0.0:
        problem = f"the angles fall, a clockwise circle, and run {run} of the plan is counter-clockwise"
        raise InputError(problem, remedy="give the files in the order of the plan's runs, or name each as its run")
    return as_moved(angle, deviation, direction)


def check_arc(angle: Array, arc: tuple[float, float], run: str) -> None:
    """Raise `InputError` where angles (N,) lie beyond the `arc` of a planned run (first and last, degree): another run's file."""
    first, last = arc
    beyond = np.abs(np.remainder(angle - 0.5 * (first + last) + 180.0, 360.0) - 180.0) - 0.5 * (last - first)
    if beyond.max() > STRAY_DEG:
        stray = float(angle[np.argmax(beyond)])
        planned = f"run {run} of the plan, {first:.1f}° to {last:.1f}°"
        problem = f"the angle {stray:.1f}° lies {beyond.max():.1f}° beyond {planned} from the first axis of its plane"
        raise InputError(problem, remedy="give the files in the order of the plan's runs, or name each as its run")


def cut_short(angle: Array, arc: tuple[float, float], run: str) -> tuple[str, ...]:
    """A note where angles (N,) degree cover less than the `arc` of a planned run without run-up and run-out, or than a revolution
    where it has more: a run that was stopped."""
    phi = np.unwrap(np.radians(angle))
    covered = float(np.degrees(np.ptp(phi) + np.abs(np.median(np.diff(phi)))))
    wanted = min(arc[1] - arc[0], 360.0)
    if covered >= wanted - STRAY_DEG or covered < SHORT_DEG:  # of the latter `polar_doubts` says more
        return ()
    return (f"{run}: the angles cover {covered:.3g}° of {wanted:.3g}°; if the run was stopped, repeat it whole",)


def check_other(machine: Machine, run: Run, radius: float | None, plane: str | None) -> None:
    """Raise `InputError` where a `radius` (mm) or `plane` given by hand is that of another circle than the planned run's: the bar
    would have been beyond its stroke."""
    instrument = ball_instrument(run)
    stroke = 0.0 if instrument is None else instrument.stroke(machine)
    if radius is not None and run.length is not None and abs(radius - run.length) > stroke:
        problem = f"radius {radius:g} mm, and run {run.id} of the plan is a circle of {run.length:g} mm"
    elif plane is not None and plane in PLANES and set(plane) != _moving(run):
        problem = f"plane {plane}, and run {run.id} of the plan moves {' and '.join(sorted(_moving(run)))}"
    else:
        return
    raise InputError(problem, remedy="leave --radius and --plane out, or plan the circle that you measured")


def _moving(run: Run) -> set[str]:
    return {name for name, q in run.commands.items() if np.ptp(q) > MOVES_MM}


def as_planned(machine: Machine, run: Run) -> dict[str, Any]:
    """What `read_polar`, `check_arc` and `polar_run` take of a planned circle: direction, arc, centre, radius, feed, plane,
    rotary axes, tool ball, noise, set-up and mounting.

    Raises `InputError` where the run is no circle of the linear axes about its ball.
    """
    plane = next((plane for plane in PLANES if set(plane) == _moving(run)), None)
    nominal = Nominal(machine)
    way = nominal.ball(run.commands, run.tool_ball) - np.asarray(run.table_ball)
    if plane is None or run.length is None or not run.dynamic or np.ptp(np.linalg.norm(way, axis=1)) > ROUND_MM:
        problem = f"run {run.id} is no circle of X, Y and Z about its ball"
        raise InputError(problem, remedy="import such a run with symfive import")
    speed = np.linalg.norm(np.diff(way, axis=0), axis=1) / np.diff(run.time)
    a, b = (run.commands[name] - np.mean(run.commands[name]) for name in plane)
    rising = float(np.sum(a[:-1] * np.diff(b) - b[:-1] * np.diff(a))) > 0.0
    hold = {name: float(q[0]) for name, q in run.commands.items() if machine.axes[name].rotary}
    phi = np.degrees(np.unwrap(np.arctan2(*(way @ along for along in _in_plane(nominal, plane, hold)[::-1]))))
    return {
        "direction": DIRECTIONS[0 if rising else 1], "arc": (float(phi.min()), float(phi.max())),
        "centre": run.table_ball, "radius": run.length, "feed": float(f"{60.0 * np.median(speed):.5g}"), "plane": plane,
        "hold": hold, "id": run.id, "tool_ball": run.tool_ball, "noise_um": run.noise("ball_bar"),
        "setup_sigma_um": run.setup_sigma_um, "mounting": run.mounting,
    }  # fmt: skip


def _in_plane(nominal: Nominal, plane: str, hold: Mapping[str, float]) -> tuple[Array, Array]:
    """First and second axis of the plane, seen from the workpiece with the rotary axes at `hold`."""
    first, second = (nominal.seen_from_workpiece(nominal.commands(hold, 1), np.eye(3)[i])[0] for i in PLANES[plane])
    return first, second


def polar_run(
    machine: Machine, angle_deg: Sequence[float] | Array, deviation_um: Sequence[float] | Array, *,
    centre: Sequence[float], radius: float, feed: float, id: str = "circle", plane: str = "XY",
    hold: Mapping[str, float] | None = None, tool_ball: Sequence[float] | None = None, noise_um: float = 0.3,
    setup_sigma_um: SetupSigma | None = None, mounting: Mapping[str, str] | None = None, angle_error: float = ANGLE_ERROR,
) -> Run:  # fmt: skip
    """A dynamic ball-bar run from its polar form.

    `angle_deg` (N,) degree in the `plane` (`XY`, `YZ`, `ZX`) from its first axis, rising for a circle seen counter-clockwise
    and falling for a clockwise one, in even steps; a jump by 360° is no jump. `deviation_um` (N,) µm of the distance from
    `radius` mm; `centre` mm of the table ball in the workpiece frame; `feed` mm/min along the path; `hold` positions of rotary
    axes, `tool_ball` mm in the tool frame; `mounting` what stayed mounted, as in a run. Readings within
    `angle_error` degree of where an axis reverses are left out (at least the one at the reversal and its neighbours, if the error
    is above 0). Raises `InputError` where the angles are not a steady motion or an axis cannot follow.
    """
    among(plane, PLANES, f'plane "{plane}" is unknown')
    if not (radius > 0.0 and feed > 0.0):
        raise InputError(f"radius {radius:g} mm and feed {feed:g} mm/min make no circle", remedy="give both above 0")
    angle, deviation = np.asarray(angle_deg, dtype=float), np.asarray(deviation_um, dtype=float)
    if angle.shape != deviation.shape or angle.ndim != 1:
        raise InputError(f"{len(angle)} angles, {len(deviation)} deviations", remedy="give one deviation per angle")
    enough(len(angle))
    if np.abs(1e-3 * deviation - radius).max() < NEAR * radius:
        problem = f"the deviations are {1e-3 * deviation.mean():.6g} mm on average, the length of the bar"
        raise InputError(problem, remedy=f"subtract the radius, {radius:g} mm")
    phi = _steady(angle)
    nominal, ball = Nominal(machine), tool_ball_of(machine, tool_ball)
    u, v = _in_plane(nominal, plane, hold or {})
    time = np.abs(phi - phi[0]) * radius / (feed / 60.0)
    ahead = phi + np.sign(phi[-1] - phi[0]) * _lag(machine, plane) * feed / 60.0 / radius
    target = np.asarray(centre, dtype=float) + radius * (np.outer(np.cos(ahead), u) + np.outer(np.sin(ahead), v))
    x, y, z = (float(c) for c in centre)
    run = Run(
        id=id, instrument=("ball_bar",), sampling="dynamic", time=time,
        commands=nominal.follow(target, ball, hold or {}, f"circle {id}"), readings={"dL_um": deviation}, table_ball=(x, y, z),
        tool_ball=ball, length=radius, noise_um=noise_um, options={"start": "moving", "between": "curve"},
        setup_sigma_um=setup_sigma_um or SetupSigma(table_ball=20.0, tool_ball=20.0, length=0.5), mounting=mounting or {},
        clock_sigma_ms=_clock_sigma_ms(machine, plane, 0.5 * float(np.radians(angle_error)) * radius / (feed / 60.0)),
    )  # fmt: skip
    run = within_travel(machine, run, place="the centre, the radius or the tool's length in the machine file")
    return _timed(run, phi, ahead, np.radians(angle_error))


def _timed(run: Run, phi: Array, ahead: Array, error: float) -> Run:
    """The rows of a run at the angles `phi` that are further from every reversal of an axis than the angle's `error`, rad.

    On a circle an axis stands at a·cos + b·sin + c of the commanded angle and turns round where that is largest and least.
    """
    if error <= 0.0:
        return run
    waves = np.stack([np.cos(ahead), np.sin(ahead), np.ones(len(ahead))], axis=1)
    error = max(error, 1.01 * float(np.median(np.abs(np.diff(phi)))))
    known = np.ones(run.rows, dtype=bool)
    for positions in run.commands.values():
        a, b, _ = np.linalg.lstsq(waves, positions, rcond=None)[0]
        if np.hypot(a, b) > MOVES_MM:
            known &= np.abs(np.remainder(phi - np.arctan2(b, a) + 0.5 * np.pi, np.pi) - 0.5 * np.pi) > error
    if not known.any():
        problem = f"no reading is further than {np.degrees(error):.3g}° from where an axis reverses"
        raise InputError(
            problem, remedy="give a smaller angle_error (--angle-error), in degrees, or more readings per revolution"
        )
    run = rows_of(run, known)
    return replace(run, time=run.time - run.time[0])


def _lag(machine: Machine, plane: str) -> float:
    """By how much the axes are behind the command at constant speed, s: the software's angles are where the bar is, and the bar
    is where the axes are."""
    drives = [machine.axes[name].drive for name in machine.axis_names if name in plane]
    lags = [(1.0 - drive.feedforward) / drive.position_gain for drive in drives if drive is not None]
    return float(np.mean(lags)) if lags else 0.0


def _clock_sigma_ms(machine: Machine, plane: str, start: float) -> float:
    """1σ of the time by which the angles are late against the command, where they begin within `start` s (0: they are exact)."""
    stated = all(machine.axes[name].drive is not None for name in machine.axis_names if name in plane)
    return float(np.hypot(1e3 * start, 0.0 if stated else UNKNOWN_LAG_MS)) if start else 0.0


def polar_doubts(
    machine: Machine, runs: Sequence[Run], angles_deg: Sequence[Array], *, radius: float, feed: float
) -> tuple[str, ...]:
    """What looks wrong in the circles of `polar_run`, each with its remedy: a short arc (radians?), a feed that an axis cannot
    reach or that takes hours, inches for mm or mm for µm, one direction only, a removed mean radius.
    `angles_deg`: the angles of each run."""
    said = []
    for run in runs:
        deviation = run.readings["dL_um"]
        if np.abs(deviation - radius).max() < NEAR * radius:
            problem = f"{run.id}: the deviations are {deviation.mean():.6g} µm on average, the radius is {radius:g} mm"
            said.append(f"{problem}; if the file holds the bar's length, subtract the radius and give --unit mm")
        if np.abs(deviation).max() < run.noise("ball_bar"):
            problem = f"{run.id}: no deviation reaches the noise of {run.noise('ball_bar'):g} µm"
            said.append(f"{problem}; if they are mm, give --unit mm, in symfive import --map deviation=2:mm")
    for run, angle in zip(runs, angles_deg, strict=True):
        sweep = float(np.ptp(np.unwrap(np.radians(angle))))
        if np.degrees(sweep) < SHORT_DEG:
            problem = f"{run.id}: the angles cover {np.degrees(sweep):.3g}° only"
            said.append(f"{problem}; if they are radians, write them in degree (times 57.29578)")
    bars = machine.workspace.bar_lengths
    inches = [bar for bar in bars if radius not in bars and abs(MM_IN * radius - bar) < NEAR * bar]
    if inches:
        problem = f"no bar of {radius:g} mm is declared, but one of {inches[0]:g} mm, which is {radius:g} in"
        said.append(f"{problem}; give --radius and --centre in mm, and --feed in mm/min")
    minutes = 2.0 * np.pi * radius / feed
    if minutes > SLOW_MIN:
        problem = f"at {feed:g} mm/min one circle takes {minutes / 60.0:.2g} hours"
        said.append(f"{problem}; if the feed is in m/min, give --feed {1e3 * feed:g}")
    for name, axis in machine.axes.items():
        speed = max(run.fastest(run.commands[name]) for run in runs)
        if axis.max_feed is not None and speed > 1.01 * axis.max_feed:
            problem = f"axis {name} would go at {speed:.0f} {axis.unit}/min, its max_feed is {axis.max_feed:g}"
            said.append(f"{problem}; give --feed in mm/min as the programme has it, or correct the machine file")
    means = [
        (abs(float(np.mean(run.readings["dL_um"]))) / run.noise("ball_bar"), run.setup_sigma_um.length) for run in runs
    ]
    if all(mean < ZERO and known < FITTED.length for mean, known in means):
        problem = "no circle has a mean deviation: the ball-bar software may have removed the mean radius"
        said.append(f"{problem}; if it did, give --fitted, or the fit takes lag and expansion for zero")
    senses = {bool(np.unwrap(np.radians(a))[-1] > np.radians(a[0])) for a in angles_deg}
    if len(runs) > 1 and len(senses) == 1:
        sense = DIRECTIONS[0] if senses == {True} else DIRECTIONS[1]
        problem = f"all {len(runs)} files go {sense} by their angles: backlash cannot be separated from lag"
        said.append(f"{problem}; if a file sorts its angles, add --direction ccw or cw once per file, in their order")
    return tuple(said)


def _steady(angle_deg: Array) -> Array:
    """The angle unwrapped, rad. Raises `InputError` where it stands, turns back or goes in uneven steps."""
    phi = np.unwrap(np.radians(angle_deg))
    steps = np.diff(phi)
    usual = float(np.median(steps))
    ratio = steps / usual if usual != 0.0 else np.zeros(1)
    wrong = np.flatnonzero((np.abs(ratio - np.round(ratio)) > EVEN * np.maximum(np.round(ratio), 1.0)) | (ratio < 0.5))
    if usual == 0.0 or len(wrong):
        at = int(wrong[0]) + 2 if len(wrong) else 2
        before, after = angle_deg[at - 2 : at]
        raise InputError(
            f"reading {at}: the angle goes from {before:g}° to {after:g}°, usual are steps of {np.degrees(usual):.4g}°",
            remedy="export the angles of one circle in even steps, both directions as two files",
        )
    return np.asarray(phi)
