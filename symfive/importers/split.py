"""One recording over many turns or cycles, or with rests, as runs of their own.

Runs that repeat each other show what is noise and what is not (ISO 230-7: what repeats from turn to turn is synchronous).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from symfive.arrays import Array, Flags
from symfive.campaign import Campaign, Run
from symfive.circles import CircleFinder
from symfive.errors import InputError, among
from symfive.machine import Machine

Rows = slice | Flags | list[int]
SAME = 1e-3
"""Commands of two cycles so near each other (mm, degree) are one target."""
REST_S = 1.0
"""All axes stand at least so long in a rest."""
STILL_SHARE = 0.02
"""An axis stands where it moves less than this share of its fastest."""


def rows_of(run: Run, rows: Rows) -> Run:
    """The run with some of its rows only."""
    return replace(
        run, time=run.time[rows], commands={name: way[rows] for name, way in run.commands.items()},
        readings={name: values[rows] for name, values in run.readings.items()},
    )  # fmt: skip


def every(run: Run, step: int) -> Run:
    """Every `step`-th row."""
    return rows_of(run, slice(None, None, step))


def piece_of(run: Run, rows: Rows, name: str) -> Run:
    """Rows as a run of their own that begins at 0 s of its own and where it was on the campaign's clock."""
    piece = rows_of(run, rows)
    begin = float(piece.time[0])
    return replace(piece, id=name, file=f"{name}.csv", time=piece.time - begin, start_s=run.start_s + begin)


def cycles_of(run: Run) -> list[Run]:
    """The cycles of a test at rest whose targets repeat (ISO 230-2): the shortest sequence that the whole run consists of.

    What follows the last whole cycle (as an overrun at the end) is left out. Raises `InputError` where nothing repeats.
    """
    ways = np.stack(list(run.commands.values()), axis=1)
    for period in range(2, run.rows // 2 + 1):
        if np.abs(ways[period:] - ways[:-period]).max() <= SAME and np.ptp(ways[:period], axis=0).max() > SAME:
            count = run.rows // period
            return [piece_of(run, slice(k * period, (k + 1) * period), f"{run.id}-cycle-{k + 1}") for k in range(count)]
    raise InputError(f"run {run.id}: no sequence of targets repeats", remedy="import it without --split cycles")


def turns_of(run: Run, machine: Machine, *, axis: str | None = None, step_deg: float | None = None) -> list[Run]:
    """The full revolutions: of the rotary axis that turns farthest (or of `axis`), else of the circle that the ball describes.

    With `step_deg` the rows of a rotary axis at constant speed are interpolated to every so many degrees from 0 on and the times
    are those of a uniform motion at its mean speed (two digits, as it was programmed), so that turns repeat each other row by
    row. Raises `InputError` where there is no whole turn.
    """
    rotary = [name for name in machine.rotary_axes if axis in (None, name)]
    turning = max(rotary, key=lambda name: float(np.ptp(run.commands[name])), default=None)
    if turning is not None and float(np.ptp(run.commands[turning])) >= 360.0:
        angle = np.asarray(run.commands[turning])
    else:
        circle = CircleFinder(machine).find(run)
        angle, turning = (np.zeros(1), None) if circle is None else (np.degrees(circle.angle), None)
    if step_deg is not None and turning is not None:
        return _even_turns(run, angle, turning, step_deg)
    travelled = np.abs(angle - angle[0])
    count = int((travelled.max() + 1e-6) // 360.0)
    if count == 0:
        raise InputError(
            f"run {run.id}: no axis and no circle makes a whole revolution", remedy="import it without --split turns"
        )
    masks = [(travelled >= 360.0 * k - 1e-9) & (travelled < 360.0 * (k + 1) - 1e-9) for k in range(count)]
    return [piece_of(run, mask, f"{run.id}-turn-{k}") for k, mask in enumerate(masks, start=1)]


def _even_turns(run: Run, angle: Array, axis: str, step_deg: float) -> list[Run]:
    order = np.argsort(angle, kind="stable")
    forward = angle[-1] >= angle[0]
    speed = float(f"{np.ptp(angle) / (run.time[-1] - run.time[0]):.2g}")
    grid = np.arange(0.0, 360.0, step_deg)
    first, last = int(np.ceil(angle.min() / 360.0)), int(np.floor(angle.max() / 360.0))
    pieces: list[Run] = []
    for k in range(first, last) if forward else range(last - 1, first - 1, -1):
        at = (grid if forward else grid[::-1]) + 360.0 * k
        name = f"{run.id}-turn-{len(pieces) + 1}"

        def drawn(values: Array, at: Array = at) -> Array:
            return np.asarray(np.interp(at, angle[order], values[order]))

        pieces.append(replace(
            run, id=name, file=f"{name}.csv", time=grid / speed, start_s=float(drawn(run.time)[0]),
            commands={n: at - 360.0 * k if n == axis else drawn(way) for n, way in run.commands.items()},
            readings={n: drawn(values) for n, values in run.readings.items()},
        ))  # fmt: skip
    if not pieces:
        problem = f"run {run.id}: {axis} makes no whole revolution from a multiple of 360° on"
        raise InputError(problem, remedy="leave --step-deg out")
    return pieces


def moved_pieces(run: Run) -> list[Run]:
    """The motions between the rests of a recording. Raises `InputError` if it is not a recording or nothing moves."""
    if not run.dynamic:
        raise InputError(f"run {run.id} has static readings", remedy="use --split cycles, or import it as it is")
    speeds = np.stack([np.abs(np.gradient(way, run.time)) for way in run.commands.values()], axis=1)
    moves = np.any(speeds > np.maximum(STILL_SHARE * speeds.max(axis=0), SAME), axis=1)
    if not moves.any():
        raise InputError(f"run {run.id}: no axis moves", remedy="import it without --split moves")
    edges = np.flatnonzero(np.diff(moves.astype(int))) + 1
    spans = np.split(np.arange(run.rows), edges)
    pieces: list[list[int]] = []
    resting = np.inf
    for span in spans:
        length = float(run.time[span[-1]] - run.time[span[0]])
        if not moves[span[0]]:
            resting = length
        elif resting >= REST_S or not pieces:
            pieces.append([int(span[0]), int(span[-1]) + 1])
        else:
            pieces[-1][1] = int(span[-1]) + 1  # a short stand, as at a reversal, is no rest
    return [piece_of(run, slice(*piece), f"{run.id}-{k}") for k, piece in enumerate(pieces, start=1)]


SPLITS: dict[str, Callable[[Run, Machine, float | None], list[Run]]] = {
    "turns": lambda run, machine, step: turns_of(run, machine, step_deg=step),
    "cycles": lambda run, machine, step: cycles_of(run),
    "moves": lambda run, machine, step: moved_pieces(run),
}
SPLITS["rests"] = SPLITS["moves"]
"""The ways to cut a recording, by the word of the command line. `rests`, an older word for `moves`, keeps what lies between
rests; what is read at the rests of a planned run is `symfive.importers.rests`."""


def split(
    campaign: Campaign, how: str, *, step_deg: float | None = None, only: Iterable[str] | None = None
) -> Campaign:
    """Every run (or `only` those of these ids) cut into runs. Raises `InputError` for an unknown way, or where one is not cut."""
    among(how, SPLITS, f'there is no split "{how}"')
    chosen = {run.id for run in campaign.runs} if only is None else set(only)
    runs: list[Run] = []
    for run in campaign.runs:
        runs += SPLITS[how](run, campaign.machine, step_deg) if run.id in chosen else [run]
    return replace(campaign, runs=tuple(runs))


def prepared(campaign: Campaign, *, step: int = 1, how: str | None = None, step_deg: float | None = None) -> Campaign:
    """Every `step`-th row of all runs, then each of them cut as `split` does where `how` says it."""
    thinned = replace(campaign, runs=tuple(every(run, step) for run in campaign.runs)) if step > 1 else campaign
    return thinned if how is None else split(thinned, how, step_deg=step_deg)
