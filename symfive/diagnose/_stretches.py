"""Subsets of rows of long recordings, used by the search.

What a search takes grows with the rows, what they tell of an effect's form soon does not: it is the same motion again. So of
recordings that are long together it sees some rows of some stretches, chosen so that every place of every axis, from either side,
every speed and every part of the time comes up as evenly as can be. Drives, plays and friction follow the motion row by row.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from symfive.arrays import Array, Flags, Indices
from symfive.campaign import Campaign, Run
from symfive.disk import release
from symfive.motion import approach
from symfive.runs import Piece

LONG, SEEN = 20_000, 8_000
"""Rows of all recordings up to which the search sees every one, which takes 1 GB; and about how many it sees of more."""
MOST_STEP = 8
"""It sees every second to every eighth row: so much more of the motion for the same rows."""
STRETCH, SHORTEST = 512, 64
"""Rows that are seen in a stretch, and in one of a campaign of so many runs that each has two short ones only; the noise's
correlation over the seams is lost."""
SETTLED_S, MOST_LEAD = 2.5, 8192
"""A stretch is led to from where every axis has last turned round, so that plays and friction know their side, and from fifty
time constants of a slow position loop (20 1/s) before that; an axis that has not turned for so many rows keeps its side."""
PLACES, SPEEDS, TIMES = 16, 8, 16
"""Cells into which the travel of an axis, its speed and the time of a run are cut."""


def stretches_of(campaign: Campaign) -> tuple[Campaign, Mapping[str, Flags]]:
    """The campaign as the search sees it, and of every run which of its rows (N,) these are. The same campaign where its
    recordings are not long.

    Runs at rest, and those whose motion is what an encoder recorded, stay whole.
    """
    seen = {run.id: np.ones(run.rows, dtype=bool) for run in campaign.runs}
    long = [run for run in campaign.runs if run.dynamic and not run.encoder_is_motion]
    every = sum(run.rows for run in long)
    if every <= LONG:
        return campaign, seen
    runs, step = {run.id: run for run in campaign.runs}, min(MOST_STEP, -(-every // SEEN))
    for run in long:
        share = SEEN * run.rows / every
        size = min(STRETCH, max(SHORTEST, round(0.5 * share)))
        length, wanted = size * step, max(2, round(share / size))
        last = max(run.rows // length, 1) - 1  # it takes what is left over
        stretches = np.minimum(np.arange(run.rows) // length, last)
        chosen = _chosen(_shares(run, stretches), min(wanted, last + 1))
        runs[run.id], seen[run.id] = _cut(run, np.isin(stretches, chosen), step)
    return replace(campaign, runs=tuple(runs.values())), seen


def _cut(run: Run, rows: Flags, step: int) -> tuple[Run, Flags]:
    """Every `step`th of these rows of a run, in pieces each of which is led to; and which they are (N,)."""
    turned, margin = _since_reversals(run), int(np.ceil(SETTLED_S / run.interval))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]])))
    pieces, kept = list[Piece](), np.zeros(run.rows, dtype=bool)
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        begin = max(0, min(first, max(int(turned[first]), first - MOST_LEAD)) - margin)
        pieces.append(Piece(run=run.part(begin, last).with_readings({}), lead=first - begin, step=step))
        kept[first:last:step] = True

    def of(columns: Mapping[str, Array]) -> dict[str, Array]:
        found = {name: np.asarray(column)[kept] for name, column in columns.items()}
        release(*columns.values())
        return found

    time = np.asarray(run.time)[kept]
    return replace(run, time=time, commands=of(run.commands), readings=of(run.readings), pieces=tuple(pieces)), kept


def _since_reversals(run: Run) -> Indices:
    """The row (N,) before each one since which every axis that moves has turned round, its first one where one has not."""
    found = np.arange(run.rows)
    for command in run.commands.values():
        way = np.asarray(command)
        if np.ptp(way) > 0.0:
            side = approach(way)
            turns = np.where(np.diff(side, prepend=side[0]) != 0.0, np.arange(run.rows), 0)
            found = np.minimum(found, np.maximum.accumulate(turns))
        release(command)
    return found


def _chosen(shares: Array, count: int) -> list[int]:
    """So many stretches, of which `shares` (stretches, cells) says how many rows they have in each cell: the first, the last, and
    each time that which adds most to Σ √rows over the cells."""
    chosen = sorted({0, len(shares) - 1})
    total = shares[chosen].sum(axis=0)
    while len(chosen) < count:
        gain = np.sum(np.sqrt(total + shares), axis=1)
        gain[chosen] = -np.inf
        chosen.append(int(np.argmax(gain)))
        total += shares[chosen[-1]]
    return chosen


def _shares(run: Run, stretches: Indices) -> Array:
    """How many rows of each stretch fall into each cell (stretches, cells)."""
    tables = [_counted(stretches, _cells(np.asarray(run.time), TIMES), TIMES)]
    for command in run.commands.values():
        way = np.asarray(command)
        if np.ptp(way) > 0.0:
            speed = np.gradient(way, run.time)
            sides = _cells(way, PLACES) + PLACES * (speed > 0.0)
            tables.append(_counted(stretches, sides, 2 * PLACES))
            tables.append(_counted(stretches, _cells(np.abs(speed), SPEEDS), SPEEDS))
        release(command)
    return np.concatenate(tables, axis=1)


def _cells(values: Array, count: int) -> Indices:
    """Index of the equal-width cell in which each value lies."""
    low, reach = float(values.min()), max(float(np.ptp(values)), 1e-300)
    return np.minimum((values - low) * (count / reach), count - 1).astype(np.int64)


def _counted(stretches: Indices, cells: Indices, size: int) -> Array:
    count = int(stretches[-1]) + 1
    return np.bincount(stretches * size + cells, minlength=count * size).reshape(count, size).astype(float)
