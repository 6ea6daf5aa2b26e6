"""Stretches: of long recordings the rows that the search for names sees.

What a search takes grows with the rows, what they tell of an effect's form soon does not: it is the same motion again. So of
recordings that are long together it sees some stretches at the full rate, chosen so that every place of every axis, from either
side, every speed and every part of the time comes up as evenly as can be. Drives, plays and friction follow the whole motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign, Run
from symfive.disk import release
from symfive.motion import approach
from symfive.runs import Piece

__all__ = ["LONG", "stretches_of"]

Array = NDArray[np.float64]
LONG, SEEN = 20_000, 10_000
"""Rows of all recordings up to which the search sees every one, which takes 1 GB; and how many it sees of more."""
STRETCH = 512
"""Rows; the noise's correlation over the seams, a fiftieth of the rows at most ten apart, is lost."""
SETTLED_S, MOST_LEAD = 2.5, 8192
"""A stretch is led to from where every axis has last turned round, so that plays and friction know their side, and from fifty
time constants of a slow position loop (20 1/s) before that; an axis that has not turned for so many rows keeps its side."""
PLACES, SPEEDS, TIMES = 16, 8, 16
"""Cells into which the travel of an axis, its speed and the time of a run are cut."""


def stretches_of(campaign: Campaign) -> tuple[Campaign, Mapping[str, NDArray[np.bool_]]]:
    """The campaign as the search sees it, and of every run which of its rows (N,) these are. The same campaign where its
    recordings are not long.

    Runs at rest, and those whose motion is what an encoder recorded, stay whole.
    """
    seen = {run.id: np.ones(run.rows, dtype=bool) for run in campaign.runs}
    long = [run for run in campaign.runs if run.dynamic and run.options.get("motion_from") != "encoder"]
    every = sum(run.rows for run in long)
    if every <= LONG:
        return campaign, seen
    runs = {run.id: run for run in campaign.runs}
    for run in long:
        stretches, wanted = _stretches(run), max(2, round(SEEN * run.rows / every / STRETCH))
        if wanted <= stretches[-1]:
            seen[run.id] = np.isin(stretches, _chosen(_shares(run, stretches), wanted))
            runs[run.id] = _cut(run, seen[run.id])
    return replace(campaign, runs=tuple(runs.values())), seen


def _stretches(run: Run) -> NDArray[np.int64]:
    """The number of the stretch of each row (N,); what is left over belongs to the last one."""
    return np.minimum(np.arange(run.rows) // STRETCH, max(run.rows // STRETCH, 1) - 1)


def _cut(run: Run, rows: NDArray[np.bool_]) -> Run:
    """These rows of a run, in pieces each of which is led to."""

    def of(columns: Mapping[str, Array]) -> dict[str, Array]:
        found = {name: np.asarray(column)[rows] for name, column in columns.items()}
        release(*columns.values())
        return found

    turned, margin = _since_reversals(run), int(np.ceil(SETTLED_S / run.interval))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]])))
    pieces = []
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        begin = max(0, min(int(first), max(int(turned[first]), int(first) - MOST_LEAD)) - margin)
        part = run.part(begin, int(last)).with_readings({})
        pieces.append(Piece(run=part, lead=int(first) - begin))
    return replace(
        run, time=np.asarray(run.time)[rows], commands=of(run.commands), readings=of(run.readings), pieces=tuple(pieces)
    )


def _since_reversals(run: Run) -> NDArray[np.int64]:
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
    chosen = [0, len(shares) - 1]
    total = shares[chosen].sum(axis=0)
    while len(chosen) < count:
        gain = np.sum(np.sqrt(total + shares), axis=1)
        gain[chosen] = -np.inf
        chosen.append(int(np.argmax(gain)))
        total += shares[chosen[-1]]
    return chosen


def _shares(run: Run, stretches: NDArray[np.int64]) -> Array:
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


def _cells(values: Array, count: int) -> NDArray[np.int64]:
    """The number of the cell, of so many equal ones, in which each value lies."""
    low, reach = float(values.min()), max(float(np.ptp(values)), 1e-300)
    return np.minimum((values - low) * (count / reach), count - 1).astype(np.int64)


def _counted(stretches: NDArray[np.int64], cells: NDArray[np.int64], size: int) -> Array:
    count = int(stretches[-1]) + 1
    return np.bincount(stretches * size + cells, minlength=count * size).reshape(count, size).astype(float)
