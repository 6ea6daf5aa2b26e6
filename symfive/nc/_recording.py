"""How a recording is driven: a circle of two linear axes by the control's own interpolation, any other path in straight blocks.

On a circle the bar is mounted pulled out, fed in radially, which starts its software, and out again after the
arc, at one feed and without a rest in between. The blocks of another path are as few as stay within a stated error of the
model's path at every instant: that is a straight line between two rows, so the error is known at the rows. Words are the
ball's place where the control follows it: linear axes that follow a turning table are then one block.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run
from symfive.nc._arc import Circle
from symfive.nc._base import Step
from symfive.procedures import Nominal

STANDSTILL = 1e-4
"""mm or degree: the last digit that every control reads."""
CHORD_MM, CHORD_DEG = 5e-4, 1e-3
"""How far a block may lead the tool ball from its path in the workpiece frame, and a rotary axis from its position."""
BEFORE_FEED_IN_S = 1.0
"""Rest before the feed-in."""


def pulled_out(run: Run, circle: Circle, row: int) -> dict[str, float]:
    """Positions of the axes at the first or the last row with the bar pulled out."""
    angle = circle.start + (circle.sweep if row else 0.0)
    return {**pose_of(run, row), **circle.at(angle, circle.radius + circle.out)}


def circular(run: Run, circle: Circle, *, bar: bool) -> list[Step]:
    """A bar radially in, around, radially out; a reading head goes around only."""
    last = run.rows - 1
    sense = "counter-clockwise" if circle.sweep > 0.0 else "clockwise"
    path = f"{abs(circle.sweep):g} deg {sense} in {circle.plane} with run-up and run-out, radius {circle.radius:g} mm"
    end = pose_of(run, last)
    arc = Step(
        kind="arc", positions={n: end[n] for n in circle.plane}, commands=end, seconds=circle.seconds, row=last,
        towards=last, seated=True, feed=circle.feed, centre=circle.centre, sweep=circle.sweep,
        way={row: pose_of(run, row) for row in circle.way},
    )  # fmt: skip
    radial = [
        Step(
            kind="feed", positions={n: there[n] for n in sorted(circle.plane)}, commands=there, towards=row,
            seconds=60.0 * circle.out / circle.feed, seated=True, feed=circle.feed,
        )
        for there, row in ((pose_of(run, 0), 0), (pulled_out(run, circle, last), last))
        if bar
    ]  # fmt: skip
    return [
        Step(kind="comment", text=f"{path}, the feed is the test's: override 100 percent"),
        Step(kind="dwell", seconds=BEFORE_FEED_IN_S),
        *radial[:1],
        arc,
        *radial[1:],
    ]


def pose_of(run: Run, row: int) -> dict[str, float]:
    """Positions of all axes in a row."""
    return {name: float(q[row]) for name, q in run.commands.items()}


def straight_blocks(run: Run, nominal: Nominal, places: Array, *, centred: bool) -> list[tuple[int, float]]:
    """Row at which each block ends and its time, s. `places` (rows, 3) mm of the ball in the workpiece frame; `centred`: these
    are the words. A rest at the end is the last one."""
    moved = np.any([np.diff(q) != 0.0 for q in run.commands.values()], axis=0)
    last = int(np.flatnonzero(moved)[-1]) + 1 if moved.any() else 0
    ends = [0, *_ends(last, _chord(run, nominal, places, centred=centred))]
    ends += [run.rows - 1] if last < run.rows - 1 else []
    return [(b, float(run.time[b] - run.time[a])) for a, b in itertools.pairwise(ends)]


def said(blocks: Sequence[tuple[int, float]]) -> str:
    """How the blocks keep to the path, for the program."""
    shortest = 1e3 * min(seconds for _, seconds in blocks)
    kept = f"ball within {1e3 * CHORD_MM:g} um and rotary axes within {CHORD_DEG:g} deg of the path"
    return f"no arc: {len(blocks)} straight blocks, {kept}, shortest block {shortest:.0f} ms"


def _ends(last: int, error: Callable[[int, int], float]) -> list[int]:
    """The rows at which the blocks from row 0 to row `last` end. `error` of a block between two rows as a share of what is
    allowed, 0 between neighbours: a block is doubled while that is at most 1, then halved in between."""
    ends = [0]
    while (start := ends[-1]) < last:
        good, bad = start + 1, last + 1
        while good < bad - 1:
            trial = min(start + 2 * (good - start), last) if bad > last else (good + bad) // 2
            good, bad = (trial, bad) if error(start, trial) <= 1.0 else (good, trial)
        ends.append(good)
    return ends[1:]


def _chord(run: Run, nominal: Nominal, places: Array, *, centred: bool) -> Callable[[int, int], float]:
    """Error of one straight block between two rows as a share of what is allowed, at the rows between them."""
    time, rotary = run.time, nominal.machine.rotary_axes
    named = [run.commands[name] for name in (rotary if centred else run.commands)]
    words = np.stack([*named, *(places.T if centred else ())], axis=1)

    def error(first: int, last: int) -> float:
        if last - first < 2:
            return 0.0
        if np.abs(words[last] - words[first]).max() < STANDSTILL <= np.ptp(words[first : last + 1], axis=0).max():
            return math.inf  # out and back: a block that leads nowhere takes no time
        rows = slice(first + 1, last)
        share = (time[rows] - time[first]) / (time[last] - time[first])

        def straight(values: Array) -> Array:
            return np.asarray(values[first] + np.multiply.outer(share, values[last] - values[first]))

        there = {name: straight(q) for name, q in run.commands.items()}
        turned = max((float(np.abs(there[n] - run.commands[n][rows]).max()) for n in rotary), default=0.0)
        if turned > CHORD_DEG:
            return turned / CHORD_DEG
        ball = straight(places) if centred else nominal.ball(there, run.tool_ball)
        away = float(np.linalg.norm(ball - places[rows], axis=1).max())
        return max(turned / CHORD_DEG, away / CHORD_MM)

    return error
