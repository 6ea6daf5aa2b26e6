"""A continuous recording over a whole static run: cut at its rests, which are matched with the poses of the plan.

A rest is where all readings stand: their spread in a window is not above what the quietest twentieth of the recording has.
Which rest is which pose is decided by time: from the end of one rest to the start of another passes what the plan says, within
`SLACK_S` and `SLACK`, whatever the clocks' offset and however long the program waits for the operator at the first pose; a pose
may have no rest (its move shook on, the ball left the nest), a rest no pose (a stop by hand). The assignment with the least sum
of mismatches and of what is left over is found by dynamic programming.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from symfive.arrays import Array, Indices
from symfive.campaign import FIRST_LINE, Run
from symfive.errors import InputError
from symfive.files import shown
from symfive.importers.mapping import in_unit
from symfive.importers.split import piece_of
from symfive.importers.table import Table, check_time, read_table
from symfive.instruments import columns_of, instruments_of
from symfive.machine import Machine
from symfive.motion import approach

LEAST_ROWS = 20
WINDOW = 0.25
"""Length of the window of which the spread is taken, as a share of the dwell."""
QUIETEST, STILL = 0.05, 3.0
"""So many times the spread of the quietest twentieth is still a rest."""
SHORTEST = 0.5
"""A rest lasts at least this share of the dwell."""
SETTLED = 0.6
"""Share of a rest, its end, that is read."""
SLACK_S, SLACK = 1.0, 0.03
"""How far the time between two rests may be from the plan's: in s, and as a share."""
POSE_COST, REST_COST = 1.0, 0.25
"""What a pose without a rest and a rest without a pose cost, in squares of a whole slack."""
MOST_LEFT = 12
"""Poses, and rests, that may be left over one after the other."""
SAME = 1e-6
"""mm or degree: an axis that moves by less keeps its side."""
TIE = 0.2
"""An assignment that costs so little more is as good."""


@dataclass(frozen=True)
class Rest:
    """From `start` to `end` s of the recording; `values` (columns,) the median of its settled part."""

    start: float
    end: float
    values: Array


@dataclass(frozen=True)
class Matched:
    """A planned run with the readings of the poses that were found.

    `runs`: more than one, each with set-up errors of its own, where a missing pose contained a reversal, after which the next
    pose would be on the wrong side of a backlash; `missing` rows of the plan; found rows that would be `alone` in their run;
    `rests` of the recording and how many of them are `unused`.
    """

    runs: tuple[Run, ...]
    missing: tuple[int, ...]
    alone: tuple[int, ...]
    rests: int
    unused: int

    def __str__(self) -> str:
        said = [f"run {self.runs[0].id}: {sum(run.rows for run in self.runs)} poses found in {self.rests} rests"]
        if self.missing:
            said.append(f"not found: {_poses(self.missing)}")
        if self.alone:
            said.append(f"left out, alone between missing ones: {_poses(self.alone)}")
        if len(self.runs) > 1:
            names = ", ".join(run.id for run in self.runs)
            said.append(
                f"in {len(self.runs)} runs ({names}): a missing pose had turned an axis, and play would see the wrong side"
            )
        if self.unused:
            said.append(f"rests that are no pose of the plan: {self.unused}")
        return "; ".join(said)


def _poses(rows: Sequence[int]) -> str:
    return ", ".join(f"pose {row + 1} (line {row + FIRST_LINE})" for row in rows)


def read_recording(
    path: Path | str, columns: Sequence[str], *, unit: str | None = None
) -> tuple[Array, dict[str, Array]]:
    """Time (N,) s and readings (N,) in µm by name from a text file (`read_table`).

    `columns` names those of the file in order: `t` the time in s, the plan's reading columns, `-` for a column not needed;
    `unit` of the readings (`mm`, `um`, `in`, …), by default the one that the file's head has, else `um`. Raises `InputError`
    naming file and line, also for a unit in the head that is none of a length or, of the time, none of a time.
    """
    path = Path(path)
    wanted = [name for name in columns if name != "-"]
    if len(set(wanted)) < len(wanted) or "t" not in wanted or len(wanted) < 2:
        problem = f"the columns {','.join(columns)} do not name t and readings once each"
        raise InputError(
            problem, remedy="write --columns t,dx_um,dy_um,dz_um in the order of the file, - for any other"
        )
    table = read_table(path)
    if len(table.names) != len(columns) or len(table.lines) < LEAST_ROWS:
        problem = f"{len(table.lines)} rows of {len(table.names)} numbers, {len(columns)} columns are named"
        remedy = f"name all columns of the file, - for what is not needed, and record at least {LEAST_ROWS} rows"
        raise InputError(problem, path=path, line=table.lines[0], remedy=remedy)
    _refuse_swapped(table, columns)
    places = {name: i for i, name in enumerate(columns) if name != "-"}
    time = in_unit(table, places.pop("t"), "s")
    check_time(time, path, table.lines, "record one run at a time")
    return time, {name: in_unit(table, i, "um", unit) for name, i in places.items()}


def _refuse_swapped(table: Table, columns: Sequence[str]) -> None:
    """Refuse columns that the file's head gives the name of another one."""
    head = [f"{name}_{unit}" if unit else name for name, unit in zip(table.names, table.units, strict=True)]
    for number, (own, name) in enumerate(zip(head, columns, strict=True), start=1):
        if own != name and own in columns:
            problem = f"column {number} is {shown(own)} in the file and {name} by --columns"
            order = ",".join(cell if cell in columns else "-" for cell in head)
            raise InputError(problem, path=table.path, remedy=f"write --columns {order}")


def rests_of(time: Array, readings: Array, *, dwell_s: float, reach_um: float = np.inf) -> list[Rest]:
    """Where all of the readings (N, columns) µm at `time` (N,) s stand for at least half of `dwell_s` s; those beyond `reach_um`
    are outside the sensors' range: the ball is not in its nest. Raises `InputError` where the recording is too coarse."""
    window = max(3, round(WINDOW * dwell_s / float(np.median(np.diff(time)))))
    if len(time) < 4 * window or WINDOW * dwell_s < 2.0 * float(np.median(np.diff(time))):
        problem = f"{len(time)} readings, one every {float(np.median(np.diff(time))):.3g} s"
        raise InputError(f"{problem}, show no rests of {dwell_s:g} s", remedy="record at least 10 readings a rest")
    frames = np.lib.stride_tricks.sliding_window_view(readings, window, axis=0)
    spread = frames.std(axis=2)
    usual = np.quantile(spread, QUIETEST, axis=0)
    quiet = np.all(spread <= STILL * np.maximum(usual, 1e-9), axis=1) & np.all(
        np.abs(frames).max(axis=2) <= reach_um, axis=1
    )
    edges = np.flatnonzero(np.diff(np.concatenate([[False], quiet, [False]]).astype(int)))
    found = []
    for first, beyond in zip(edges[::2], edges[1::2], strict=True):
        last = min(beyond + window - 2, len(time) - 1)
        if time[last] - time[first] >= SHORTEST * dwell_s:
            settled = slice(last - int(SETTLED * (last - first)), last + 1)
            found.append(Rest(float(time[first]), float(time[last]), np.median(readings[settled], axis=0)))
    return found


def cut_at_rests(
    machine: Machine, run: Run, time: Array, readings: Mapping[str, Array], *, dwell_s: float = 2.0
) -> Matched:
    """A static run of a plan with its readings, from one continuous recording.

    `time` (N,) s on any clock, `readings` (N,) µm by the plan's column names, `dwell_s` s of rest at each pose as the program has
    it. Raises `InputError` where the columns are not the plan's, fewer than half of the poses are found, the readings are below
    their noise (mm taken for µm), or the rests suit the plan in several ways.
    """
    names = [column.name for column in columns_of(run, machine)]
    if run.dynamic:
        raise InputError(f"run {run.id} is a recording itself", remedy="name a run whose poses are read at rest")
    if missing := [name for name in names if name not in readings]:
        raise InputError(f"the recording lacks {', '.join(missing)}", remedy=f"name the columns {', '.join(names)}")
    reach = 1e3 * instruments_of(run)[0].stroke(machine)
    table = np.stack([readings[name] for name in names], axis=1)
    rests = rests_of(np.asarray(time, dtype=float), table, dwell_s=dwell_s, reach_um=reach)
    pairs, *others = _assigned(run, rests, dwell_s)
    if 2 * len(pairs) < run.rows:
        problem = (
            f"run {run.id}: {len(rests)} rests in the recording, {len(pairs)} of {run.rows} poses found by their times"
        )
        remedy = "give the dwell of the program, and the recording of this run (--run names it) from start to end"
        raise InputError(problem, remedy=remedy)
    largest = max(float(np.abs(rests[i].values).max()) for i in pairs.values())
    noise = min(run.noise(name) for name in run.instrument)
    if largest < noise:
        problem = f"run {run.id}: no reading reaches the noise of {noise:g} µm, the largest is {largest:.2g} µm"
        raise InputError(problem, remedy="if the file has mm, give --unit mm")
    if others:
        problem = (
            f"run {run.id}: the {len(rests)} rests of the recording suit the plan's {run.rows} poses in several ways"
        )
        raise InputError(problem, remedy="record from before the first pose until after the last one")
    found, parts = [], _parts(run, sorted(pairs))
    for number, rows in enumerate(part for part in parts if len(part) > 1):
        id = run.id if number == 0 else f"{run.id}-{number + 1}"
        values = np.array([rests[pairs[row]].values for row in rows])
        piece = piece_of(run, rows, id).with_readings({name: values[:, i] for i, name in enumerate(names)})
        found.append(replace(piece, file=run.file) if number == 0 else piece)
    lost = tuple(row for row in range(run.rows) if row not in pairs)
    alone = tuple(part[0] for part in parts if len(part) == 1)
    return Matched(tuple(found), lost, alone, len(rests), len(rests) - len(pairs))


def _assigned(run: Run, rests: Sequence[Rest], dwell_s: float) -> list[dict[int, int]]:
    """Row → rest, the best assignment first, then those as good that say another row of the same rest."""
    rows, count = run.rows, len(rests)
    cost = np.full((count, rows), np.inf)
    before = np.full((count, rows, 2), -1)
    for i in range(count):
        cost[i] = REST_COST * i + POSE_COST * np.arange(rows)
        for a in range(max(0, i - MOST_LEFT - 1), i):
            passed = rests[i].start - rests[a].end
            for skipped in range(min(MOST_LEFT, rows - 1) + 1):
                planned = np.maximum(run.time[skipped + 1 :] - run.time[: rows - skipped - 1] - dwell_s, 0.0)
                off = np.abs(passed - planned) / (SLACK_S + SLACK * planned)
                more = cost[a, : rows - skipped - 1] + off**2 + REST_COST * (i - a - 1) + POSE_COST * skipped
                more[off > 1.0] = np.inf
                better = np.flatnonzero(more < cost[i, skipped + 1 :])
                cost[i, skipped + 1 + better] = more[better]
                before[i, skipped + 1 + better] = np.stack([np.full(len(better), a), better], axis=1)
    whole = cost + REST_COST * np.arange(count)[::-1, None] + POSE_COST * np.arange(rows)[::-1]
    if not whole.size:
        return [{}]
    order = sorted(np.argwhere(whole <= whole.min() + TIE).tolist(), key=lambda end: whole[end[0], end[1]])
    found = [_traced(before, i, row) for i, row in order]
    rows_of = {rest: row for row, rest in found[0].items()}
    return [found[0], *(other for other in found[1:] if any(rows_of.get(i, row) != row for row, i in other.items()))]


def _traced(before: Indices, i: int, row: int) -> dict[int, int]:
    found = {}
    while i >= 0:
        found[row] = i
        i, row = before[i, row].tolist()
    return found


def _parts(run: Run, rows: Sequence[int]) -> list[list[int]]:
    """The rows, divided where one is missing and the next would seem approached from another side than the plan says: of a part's
    first row no side is assumed."""
    q = np.stack(list(run.commands.values()), axis=1)
    sides = np.stack([approach(column) for column in q.T], axis=1)
    parts: list[list[int]] = []
    for row in rows:
        earlier = parts[-1][-1] if parts else -1
        way = q[row] - q[earlier]
        side = np.where(np.abs(way) > SAME, np.sign(way), sides[earlier])
        if parts and (row == earlier + 1 or np.array_equal(side, sides[row])):
            parts[-1].append(row)
        else:
            parts.append([row])
    return parts
