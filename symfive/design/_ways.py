"""Whether a run's program can be driven: every move of it sampled and tested against the clearances and the travel.

Moves are straight in the axes between the program's blocks. Where the ball is out of its nest it must also keep `KEPT_OFF` mm
from it on rapid moves. The way from wherever the machine stands to the first pose is the operator's.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Run
from symfive.design._bodies import Clearances
from symfive.machine import Machine
from symfive.nc import Post, Step, program_steps

__all__ = ["blocked_moves", "cleared"]

Array = NDArray[np.float64]
LINEAR_MM, ROTARY_DEG = 4.0, 1.0
"""A move is tested at least so densely."""
KEPT_OFF = 15.0
ROUNDING_MM = 1e-3
RETRACTS_MM = (50.0, 80.0, 120.0, 200.0)


def blocked_moves(machine: Machine, run: Run, steps: Sequence[Step]) -> list[tuple[int, str]]:
    """Moves of a program on which bodies meet or an axis leaves its travel: (the row they lead to, what meets)."""
    clearances = Clearances(machine, run)
    moves = [step for step in steps if step.commands or step.by_hand]
    nest = np.asarray(run.table_ball)
    rows = _leading_to(moves)
    found: list[tuple[int, str]] = []
    for before, after, row in zip(moves, moves[1:], rows[1:], strict=False):
        if before.by_hand or after.by_hand:
            continue
        commands = _between(machine, before.commands, after.commands)
        values = clearances(commands, bar=after.seated)
        bad = np.flatnonzero((values < -ROUNDING_MM).any(axis=0))
        if bad.size:
            found.append((row, clearances.names[int(bad[np.argmin(values[:, bad].min(axis=0))])]))
        elif after.kind == "rapid":
            off = np.linalg.norm(clearances.places(commands) - nest, axis=1).min()
            if off < KEPT_OFF:
                found.append((row, "tool ball and nest"))
    return found


def _leading_to(moves: Sequence[Step]) -> list[int]:
    """The row to which each move leads: its own or the next one's (the last one's after that)."""
    rows, following = [], -1
    last = max((move.row for move in moves if move.row is not None), default=0)
    for move in reversed(moves):
        following = move.row if move.row is not None else following
        rows.append(last if following < 0 else following)
    return rows[::-1]


def _between(machine: Machine, before: Mapping[str, float], after: Mapping[str, float]) -> Array:
    """Positions along a straight move (N, axes), the first one left out."""
    names = machine.axis_names
    a, b = (np.array([step[name] for name in names]) for step in (before, after))
    grain = np.array([ROTARY_DEG if machine.axes[name].rotary else LINEAR_MM for name in names])
    count = max(1, int(np.ceil(np.max(np.abs(b - a) / grain))))
    return np.asarray(a + np.outer(np.arange(1, count + 1) / count, b - a))


def cleared(
    machine: Machine, runs: Iterable[Run], unsafe: Mapping[str, Sequence[int]]
) -> tuple[Post, dict[str, list[tuple[int, str]]]]:
    """The programs' retract and what is driven by hand, so that every move is clear; by run what stays blocked even so.

    The shortest retract with which the fewest ways are blocked is taken; ways around that stay blocked are left to the operator.
    """
    runs = tuple(runs)
    tested = machine.workspace.spindle_nose is not None
    posts = [Post(unsafe=unsafe, retract_mm=retract, tested=tested) for retract in RETRACTS_MM]
    best, left = posts[0], _blocked(machine, runs, posts[0])
    for post in posts[1:] if left else ():
        found = _blocked(machine, runs, post)
        if sum(map(len, found.values())) < sum(map(len, left.values())):
            best, left = post, found
    if left:
        rows = {run: tuple(sorted({row for row, _ in moves})) for run, moves in left.items()}
        best = replace(best, by_hand={run: [r for r in rows[run] if r in unsafe.get(run, ())] for run in rows})
        left = _blocked(machine, runs, best)
    return replace(best, blocked={run: [row for row, _ in moves] for run, moves in left.items()}), left


def _blocked(machine: Machine, runs: Sequence[Run], post: Post) -> dict[str, list[tuple[int, str]]]:
    found = {run.id: blocked_moves(machine, run, program_steps(machine, run, post)) for run in runs}
    return {run: moves for run, moves in found.items() if moves}
