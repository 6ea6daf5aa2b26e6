"""What is legal in a campaign but hardly meant: places, feeds, readings, priors that do not fit instrument or machine."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping

import numpy as np

from symfive.arrays import Array
from symfive.instruments import BallInstrument, ball_instrument
from symfive.machine import Machine, designed_ball
from symfive.numbers import plain_number
from symfive.runs import FIRST_LINE, Campaign, Run

TINY, SLIP = 0.1, 10.0
"""Readings that scatter by less than this part of their noise; an axis faster than its max_feed by this factor (slips of
units are 57, 60 and 1000)."""
RESTED_S = 2.5
"""Fifty time constants of a slow position loop (20 1/s): no recording on the move has its rows so far apart."""
FAR_SIGMAS = 3.0
"""A sphere this far from where the file has it, in 1σ of set-up and machine together, stands elsewhere."""
SOUGHT_MM = 10.0
"""No program looks for a sphere so far from where it is expected."""
ROUNDING = 1e-6
TRUE_STROKE = "or give the true stroke under [workspace] in the machine file"
MOST_ROWS = 100_000
"""Of a longer run only the first rows are looked at."""


def doubts(campaign: Campaign) -> tuple[str, ...]:
    """What to look at before anything is measured or believed, in words; nothing where all is plausible.

    A prior 1σ smaller than the noise (mm or rad instead of µm or µrad?); an axis commanded faster than it can go; a ball or
    nest beside the table; a ball bar or an R-test that would be beyond its stroke on the machine as the file has it; readings
    beyond that stroke, or that hardly change (a wrong unit); a recording on the move whose rows are seconds apart; a sphere that
    was found elsewhere; one recording given to two runs.
    """
    of_runs = (said for run in _begun(campaign) for said in _of_run(campaign.machine, run))
    return (*_small_priors(campaign), *of_runs, *_one_recording(campaign))


def unreadable(campaign: Campaign) -> tuple[str, str] | None:
    """What no instrument can have read, and the remedy: a row at which, by the file's balls and commands, it would be two strokes
    off, from one end of its range beyond the other wherever its zero lies, or a reading so large; a sphere where no program looks
    for it; on a grid plate another path."""
    machine = campaign.machine
    for run in _begun(campaign):
        instrument = ball_instrument(run)
        if run.measured and instrument is not None:
            away, stroke = _away(machine, run, instrument), instrument.stroke(machine)
            if 1e-3 * float(np.max(np.abs(away))) > 2.0 * stroke:
                problem, remedy = _beyond(run, instrument, away, stroke)
                return problem, f"{remedy}, {TRUE_STROKE}"
            if large := _too_large(machine, run, instrument):
                return large, f"give them in µm, {TRUE_STROKE}"
            if instrument.probes and (far := _read(machine, run, instrument)[1]) > SOUGHT_MM:
                return _astray(run, far)
        if said := _another_path(machine, run):
            return said
    return None


def out_of_reach(machine: Machine, run: Run) -> Iterator[tuple[str, str]]:
    """Of a plan: every linear axis that would leave its travel if the balls stood where the file says, at its worst row, and the
    remedy. A bar points to where the commands bring its other ball."""
    if run.measured or ball_instrument(run) is None:
        return
    place = np.broadcast_to(run.table_ball, (run.rows, 3))
    if run.length is not None:
        way = designed_ball(machine, run.commands, run.tool_ball) - place
        place = place + run.length * way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), ROUNDING)
    for name, at in _followed(machine, run.commands, run.tool_ball, place).items():
        off, end = _beyond_travel(machine, name, at)
        row = int(np.argmax(off))
        if off[row] > ROUNDING:
            balls = f"table_ball {list(run.table_ball)} and tool_ball {list(run.tool_ball)}"
            yield (
                f"run {run.id}, line {row + FIRST_LINE} of {run.file}: {balls} need {name} at {at[row]:.6g} mm, its travel ends "
                f"at {end[row]:g} mm",
                f"place the balls within reach and plan again, or correct the travel of {name}",
            )


def beyond_travel(machine: Machine) -> tuple[str, ...]:
    """Ends of ball_height and tool_length that no length, and no height, brings within reach over the table's centre."""
    workspace, found = machine.workspace, dict[str, list[tuple[float, str]]]()
    if workspace.ball_height is None or workspace.tool_length is None:
        return ()
    home = {name: np.array([machine.home(name)]) for name in machine.axes}
    for height, tool in itertools.product(workspace.ball_height, workspace.tool_length):
        needed = _followed(machine, home, (0.0, 0.0, -tool), np.array([[*machine.table_centre, height]]))
        worst = (0.0, "")
        for name, at in needed.items():
            off, end = _beyond_travel(machine, name, at)
            said = f"over the table's centre needs {name} at {at[0]:.6g} mm, its travel ends at {end[0]:g} mm"
            worst = max(worst, (float(off[0]), said))
        for pair in (
            (f"ball_height = {height:g}", f"a tool of {tool:g}"),
            (f"tool_length = {tool:g}", f"a ball at {height:g}"),
        ):
            found.setdefault(pair[0], []).append((worst[0], f"{pair[0]} mm with {pair[1]} mm {worst[1]}"))
    return tuple(said for off, said in map(min, found.values()) if off > ROUNDING)


def _beyond_travel(machine: Machine, name: str, at: Array) -> tuple[Array, Array]:
    """How far positions (N,) are beyond the travel of an axis, and its end there."""
    low, high = machine.axes[name].travel
    return np.maximum(low - at, at - high), np.where(at > high, high, low)


def _followed(
    machine: Machine, commands: Mapping[str, Array], tool_ball: tuple[float, ...], place: Array
) -> dict[str, Array]:
    """Positions (N,) of the linear axes with the tool's ball at places (N, 3) of the workpiece frame, all others as commanded;
    nothing where they do not span space."""
    here, slopes = designed_ball(machine, commands, tool_ball), dict[str, Array]()
    for name in machine.linear_axes:
        one = designed_ball(machine, {**commands, name: commands[name] + 1.0}, tool_ball) - here
        if np.linalg.matrix_rank(np.stack([*(slope[0] for slope in slopes.values()), one[0]]), tol=1e-6) > len(slopes):
            slopes[name] = one
    if len(slopes) < 3:
        return {}
    change = np.linalg.solve(np.stack([*slopes.values()], axis=2), (place - here)[:, :, None])[:, :, 0]
    return {name: commands[name] + change[:, i] for i, name in enumerate(slopes)}


def _begun(campaign: Campaign) -> Iterator[Run]:
    """The runs, long ones by their first rows."""
    return (run if run.rows <= MOST_ROWS else run.part(0, MOST_ROWS) for run in campaign.runs)


def _away(machine: Machine, run: Run, instrument: BallInstrument) -> Array:
    """What the machine as the file has it would let the instrument read (N, columns), µm."""
    away = designed_ball(machine, run.commands, run.tool_ball) - np.array(run.table_ball)
    return np.asarray(1e3 * instrument.designed(run, away))


def _read(machine: Machine, run: Run, instrument: BallInstrument) -> tuple[Array, float]:
    """The readings (N, columns), µm, and the largest of them, mm."""
    read = np.stack([run.readings[column.name] for column in instrument.columns(run, machine)], axis=1)
    return read, 1e-3 * float(np.max(np.abs(read)))


def _too_large(machine: Machine, run: Run, instrument: BallInstrument) -> str:
    """Readings beyond two strokes, in words; nothing of a probe, which has none."""
    (_, largest), stroke = _read(machine, run, instrument), instrument.stroke(machine)
    if instrument.probes or largest <= 2.0 * stroke:
        return ""
    sizes = f"{plain_number(largest)} mm are beyond the stroke of ±{plain_number(stroke)} mm"
    return f"run {run.id}: readings of up to {sizes}"


def _astray(run: Run, far: float) -> tuple[str, str]:
    place = f"up to {plain_number(far)} mm from where table_ball and tool_ball put them"
    remedy = "check these, the order and units of the columns, and the direction of the rotary axes"
    return f"run {run.id}: the centres found are {place}", remedy


def _beyond(run: Run, instrument: BallInstrument, away: Array, stroke: float) -> tuple[str, str]:
    row, _ = np.unravel_index(int(np.argmax(np.abs(away))), away.shape)
    most = plain_number(1e-3 * float(np.max(np.abs(away))))
    return (
        f"run {run.id}: with its balls and commands the {instrument.seated} would be {most} mm off in line {row + FIRST_LINE} of "
        f"{run.file} (stroke ±{plain_number(stroke)} mm)",
        "check table_ball, tool_ball, length, the feed and the units of the commands",
    )


def _another_path(machine: Machine, run: Run) -> tuple[str, str] | None:
    """Positions on a grid plate that are further from the commanded path than from their own mean."""
    if "grid_encoder" not in run.instrument or not run.measured:
        return None
    read = np.stack([run.readings[name] for name in ("du_um", "dv_um")], axis=1)
    path = 1e3 * designed_ball(machine, run.commands, run.tool_ball) @ np.stack([run.u or (), run.v or ()], axis=1)
    scatter, moved, off = (float(np.std(a - a.mean(axis=0))) for a in (read, path, read - path))
    if off <= scatter or not moved:
        return None
    sizes = f"vary by {plain_number(1e-3 * scatter)} mm (1σ), the commanded path by {plain_number(1e-3 * moved)} mm"
    remedy = "give positions on the plate along u and v (of deviations: add the path), and check units, signs and order"
    return f"run {run.id}: du and dv do not follow the path: they {sizes}", remedy


def _small_priors(campaign: Campaign) -> Iterator[str]:
    noise = min(run.noise(name) for run in campaign.runs for name in run.instrument)
    for term in campaign.machine.errors.values():
        if 0.0 < term.sigma < TINY * noise:
            unit = "µrad, not rad" if term.angular else "µm, not mm"
            yield f"{term.name}: the prior 1σ {plain_number(term.sigma)} is far below the noise; it is in {unit}"


def _one_recording(campaign: Campaign) -> Iterator[str]:
    """Runs with the readings of an earlier one, in its order or from its end (a circle the other way round)."""
    first = dict[bytes, str]()
    for run in _begun(campaign):
        table = (
            np.stack([run.readings[name] for name in sorted(run.readings)], axis=1)
            if run.measured
            else np.zeros((0, 1))
        )
        if not len(table) or not np.ptp(table, axis=0).any():  # a probe cycle that corrects itself reads zeros
            continue
        key = repr(sorted(run.readings)).encode() + min(table.tobytes(), np.ascontiguousarray(table[::-1]).tobytes())
        if first.setdefault(key, run.id) != run.id:
            yield f"run {run.id}: all its readings are those of run {first[key]}; give each run its own recording"


def _of_run(machine: Machine, run: Run) -> Iterator[str]:
    if run.dynamic and run.has_clock and run.interval > RESTED_S:
        apart = f"recorded on the move, its rows are {plain_number(run.interval)} s apart"
        yield f'run {run.id}: {apart}; t_s is in s; readings at standstill are sampling = "static"'
    for name in machine.axis_names if run.dynamic else ():
        axis, speed = machine.axes[name], run.fastest(run.commands[name])
        if axis.max_feed is not None and speed > SLIP * axis.max_feed:
            sizes = f"{plain_number(speed)} {axis.unit}/min where its max_feed is {plain_number(axis.max_feed)}"
            yield f"run {run.id}: {name} is commanded at up to {sizes}; check t_s and the units of {name}"
    if said := _another_path(machine, run):
        yield "; ".join(said)
    if (instrument := ball_instrument(run)) is not None:
        yield from _beside_the_table(machine, run)
        found = list(_of_stroke(machine, run, instrument))
        yield from found
        if not found and run.measured and "touch_probe" in run.instrument:
            yield from _found_elsewhere(machine, run)


def _beside_the_table(machine: Machine, run: Run) -> Iterator[str]:
    radius, centre = machine.workspace.table_radius, machine.table_centre
    away = math.dist(run.table_ball[:2], centre)
    if radius is not None and away > radius * (1.0 + ROUNDING):
        place = f"({', '.join(map(plain_number, centre))})"
        by = (
            f"axis {machine.table_axis}"
            if machine.workspace.table_centre is None and machine.table_axis
            else "table_centre"
        )
        yield (
            f"run {run.id}: table_ball is {plain_number(away)} mm from the centre of the table {place}, beyond "
            f"table_radius = {plain_number(radius)} mm; check table_ball and {by}"
        )


def _found_elsewhere(machine: Machine, run: Run) -> Iterator[str]:
    """Where the machine as the file has it finds the sphere, if neither its errors nor the set-up reach so far."""
    found = {
        name: q + 1e-3 * run.readings[f"{name}_dev_um"] if name in machine.linear_axes else q
        for name, q in run.commands.items()
    }
    place = designed_ball(machine, found, run.tool_ball).mean(axis=0)
    away, lever = 1e3 * (place - run.table_ball), 1e-3 * math.hypot(*run.table_ball)
    sigma = run.setup_sigma_um
    errors = (term.sigma * (lever if term.angular else 1.0) for term in machine.errors.values())
    if np.abs(away).max() > FAR_SIGMAS * math.hypot(sigma.table_ball, max(sigma.tool), *errors):
        where = ", ".join(f"{coordinate:.3f}" for coordinate in place)
        yield (
            f"run {run.id}: by the readings the sphere stands at ({where}) mm, {plain_number(1e-3 * math.hypot(*away))} mm from "
            f"table_ball, whose 1σ is {plain_number(sigma.table_ball)} µm; correct table_ball, or its 1σ in setup_sigma_um"
        )


def _of_stroke(machine: Machine, run: Run, instrument: BallInstrument) -> Iterator[str]:
    stroke, predicted = instrument.stroke(machine), _away(machine, run, instrument)
    if 1e-3 * float(np.max(np.abs(predicted))) > stroke:
        yield "; ".join(_beyond(run, instrument, predicted, stroke))
        return
    if not run.measured:
        return
    readings, largest = _read(machine, run, instrument)
    if largest > 2.0 * stroke:
        if instrument.probes:
            yield "; ".join(_astray(run, largest))
        else:
            yield f"{_too_large(machine, run, instrument)}; they are in µm"
    scatter, noise = float(np.std(readings - predicted)), run.noise(instrument.name)
    if len(readings) > 2 and scatter < TINY * noise:
        sizes = f"by {plain_number(scatter)} µm only, and noise_um is {plain_number(noise)}"
        yield f"run {run.id}: the readings vary {sizes}; they are read as µm: were they written in mm?"
