"""What is legal in a campaign but hardly meant: places, feeds, readings, priors that do not fit instrument or machine."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from symfive.instruments import INSTRUMENTS
from symfive.machine import Machine, designed_ball
from symfive.numbers import plain_number
from symfive.runs import Campaign, Run

__all__ = ["doubts"]

TINY, SLIP = 0.1, 10.0
"""Readings that scatter by less than this part of their noise; an axis faster than its max_feed by this factor (slips of
units are 57, 60 and 1000)."""
ROUNDING = 1e-6
MOST_ROWS = 100_000
"""Of a longer run only the first rows are looked at."""
WHAT = {"ball_bar": "the bar", "r_test": "the ball", "touch_probe": "the sphere"}


def doubts(campaign: Campaign) -> tuple[str, ...]:
    """What to look at before anything is measured or believed, in words; nothing where all is plausible.

    A prior 1σ smaller than the noise (mm or rad instead of µm or µrad?); an axis commanded faster than it can go; a ball or
    nest beside the table; a ball bar or an R-test that would be beyond its stroke on the machine as the file has it; readings
    beyond that stroke, or that hardly change (a wrong unit).
    """
    runs = (run if run.rows <= MOST_ROWS else run.part(0, MOST_ROWS) for run in campaign.runs)
    return (*_small_priors(campaign), *(said for run in runs for said in _of_run(campaign.machine, run)))


def _small_priors(campaign: Campaign) -> Iterator[str]:
    noise = min(run.noise(name) for run in campaign.runs for name in run.instrument)
    for term in campaign.machine.errors.values():
        if 0.0 < term.sigma < TINY * noise:
            unit = "µrad, not rad" if term.angular else "µm, not mm"
            yield f"{term.name}: the prior 1σ {plain_number(term.sigma)} is far below the noise; it is in {unit}"


def _of_run(machine: Machine, run: Run) -> Iterator[str]:
    for name in machine.axis_names if run.dynamic else ():
        axis, speed = machine.axes[name], run.fastest(run.commands[name])
        if axis.max_feed is not None and speed > SLIP * axis.max_feed:
            sizes = f"{plain_number(speed)} {axis.unit}/min where its max_feed is {plain_number(axis.max_feed)}"
            yield f"run {run.id}: {name} is commanded at up to {sizes}; look at t_s and the units of {name}"
    instrument = next((name for name in run.instrument if name in WHAT), None)
    if instrument is not None:
        yield from _beside_the_table(machine, run)
        yield from _of_stroke(machine, run, instrument)


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
            f"run {run.id}: table_ball stands {plain_number(away)} mm from the table's centre {place}, the table ends at "
            f"table_radius = {plain_number(radius)} mm; look at table_ball and {by}"
        )


def _of_stroke(machine: Machine, run: Run, instrument: str) -> Iterator[str]:
    stroke = machine.workspace.stroke(bar=instrument == "ball_bar")
    columns = [column.name for column in INSTRUMENTS[instrument].columns(run, machine)]
    away = designed_ball(machine, run.commands, run.tool_ball) - np.array(run.table_ball)
    if instrument == "ball_bar":
        away = np.linalg.norm(away, axis=1, keepdims=True) - (run.length or 0.0)
    predicted = 1e3 * away
    row, _ = np.unravel_index(int(np.argmax(np.abs(predicted))), predicted.shape)
    most = 1e-3 * float(np.max(np.abs(predicted)))
    what, limit = WHAT[instrument], f"{plain_number(stroke)} mm"
    if most > stroke:
        yield (
            f"run {run.id}: with its balls and commands {what} would be {plain_number(most)} mm off at row {row + 1} "
            f"(stroke ±{limit}); look at table_ball, tool_ball, length, the feed and the units of the commands"
        )
        return
    if not run.measured:
        return
    readings = np.stack([run.readings[name] for name in columns], axis=1)
    largest = 1e-3 * float(np.max(np.abs(readings)))
    if largest > 2.0 * stroke:
        yield f"run {run.id}: readings of up to {plain_number(largest)} mm are beyond the stroke of ±{limit}; they are in µm"
    scatter, noise = float(np.std(readings - predicted)), run.noise(instrument)
    if len(readings) > 2 and scatter < TINY * noise:
        sizes = f"by {plain_number(scatter)} µm only where noise_um is {plain_number(noise)}"
        yield f"run {run.id}: the readings depart from the machine's {sizes}; they are in µm, not mm"
