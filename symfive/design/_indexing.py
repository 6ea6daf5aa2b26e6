"""What is learnt of the tool ball's run-out by reading one pose with the spindle at 0° and at 180°.

The ball's offset across the spindle's axis turns with the spindle. Two readings of one pose have half their difference as the
offset, whatever the machine does, with 1σ = noise/√2 in every direction; added to the prior's that leaves (1/σ² + 2/noise²)^-½.
Along the axis nothing is learnt: that takes a tool of known length.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from symfive.design._candidates import value_of
from symfive.design._space import Space
from symfive.errors import InputError
from symfive.optimal import Rows, Task

ACROSS = ("tool_ball.x", "tool_ball.y")


def indexed(space: Space, task: Task) -> Task:
    """The task after the tool ball's run-out has been read in every run. Raises `InputError` where a pose has fewer than three
    readings, and where the R-test's head turns with the spindle."""
    if space.instrument != "r_test":
        raise InputError(
            f"spindle indexing with {space.instrument} is not written: it needs three readings of each pose",
            remedy="use instrument r_test, or give the run-out as tool_ball sigma (--tool-ball-sigma)",
        )
    if space.options.get("frame", "workpiece") != "workpiece":
        raise InputError(
            "spindle indexing with the R-test's head in the spindle is not written: its zeros turn with it",
            remedy="use frame workpiece, or give the run-out as tool_ball sigma (--tool-ball-sigma)",
        )
    sigma = task.own_sigma.copy()
    across = np.array([name in ACROSS for name in space.own])
    sigma[across] = (sigma[across] ** -2.0 + 2.0) ** -0.5
    return replace(task, own_sigma=sigma)


def worth_indexing(space: Space, task: Task, rows: Rows) -> bool:
    """Whether the run-out, read once a run, lowers ψ of a design by more than one pose a run less can raise it.

    Of n poses in so many runs that is n/(n - runs) in the variance, where all of it is noise."""
    try:
        known = indexed(space, task)
    except InputError:
        return False
    n, left = len(rows.z), len(rows.z) - rows.groups
    return left > 0 and value_of(space, known, rows) + math.log(n / left) < value_of(space, task, rows)
