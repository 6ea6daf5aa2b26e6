"""The set-up or machine error that limits a criterion however many poses are measured.

With more and more readings at the plan's poses the criterion falls towards that of readings without noise. Where a plan is close
to it, only knowing something else helps: each group of set-up errors, and where none matters each error of the machine, is
taken as exactly known in turn, and the one that lowers the criterion most dominates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.design._candidates import information_of
from symfive.design._space import Space
from symfive.numbers import plain_number
from symfive.optimal import Rows, Task

NOISE_HARDLY = 0.95
"""Share of a 1σ from which what is left of it counts as all of it: what went is a tenth of the variance at most."""
MORE = 4.0
"""So many times as many poses would halve every 1σ that noise causes."""


@dataclass(frozen=True)
class SetupError:
    """One error of the set-up.

    `sigma` the field of `SetupSigma` that holds its 1σ; `members` the parameters of a run that it has; `remedy` what makes it
    known.
    """

    sigma: str
    name: str
    members: tuple[str, ...]
    remedy: str


SETUP_ERRORS = (
    SetupError(
        "tool_ball", "the tool ball's run-out", ("tool_ball.x", "tool_ball.y"),
        "read it by spindle indexing (--index) or by an indicator (--tool-ball-sigma)",
    ),
    SetupError("tool_length", "the tool's length", ("tool_ball.z",), "measure it (--tool-length-sigma)"),
    SetupError(
        "table_ball", "the table ball's place", ("table_ball.x", "table_ball.y", "table_ball.z"),
        "measure it (--table-ball-sigma)",
    ),
    SetupError(
        "zero", "the nest's place in the workpiece frame", ("zero.x", "zero.y", "zero.z"),
        "put it onto a calibrated place (--zero-sigma)",
    ),
    SetupError("length", "the bar's length", ("length",), "calibrate it (--bar-length-sigma)"),
)  # fmt: skip


GROUPS = {error.name: error for error in SETUP_ERRORS}
"""Set-up errors that limit a plan, in words, with the remedy for each."""


def what_dominates(space: Space, task: Task, rows: Rows) -> list[str]:
    """One sentence where the criterion hardly moves with the number of poses; nothing where it does."""
    prior = task.prior_information(rows.groups)
    read = information_of(space, task, rows) - prior
    now = task.value(prior + read)
    more = task.value(prior + MORE * read)
    if math.exp(0.5 * (more - now)) < NOISE_HARDLY:
        return []
    known = {
        name: task.value(prior + read + np.diag(exact)) for name, exact in _exactly(space, task, rows.groups).items()
    }
    name = min((n for n in known if n in GROUPS), key=lambda n: known[n])
    if math.exp(0.5 * (known[name] - now)) > NOISE_HARDLY:  # no error of the set-up: one of the machine itself
        name = min(known, key=lambda n: known[n])
    sigma = _sizes(space, task)
    remedy = (
        GROUPS[name].remedy
        if name in GROUPS
        else "no reading of this plan separates it from the set-up; another instrument may"
    )
    return [
        f"more poses hardly help: {task.criterion.name} is {_size(task, now)}, with {MORE:g} times as many {_size(task, more)}; "
        f"{name}{sigma.get(name, '')} dominates, and exactly known leaves {_size(task, known[name])}: {remedy}"
    ]


def _exactly(space: Space, task: Task, groups: int) -> dict[str, Array]:
    """Information that makes one thing exactly known, on the diagonal (size,), by what it is."""
    layout = task.layout(groups)
    found: dict[str, Array] = {}
    for name, group in GROUPS.items():
        mine = np.array([n in group.members for n in space.own], dtype=bool)
        if mine.any():
            own = np.where(mine, EXACT / task.own_sigma**2, 0.0)
            found[name] = np.concatenate([np.zeros(layout.shared), np.tile(own, groups)])
    errors = [p.name.partition(".")[0] for p in space.shared]
    for error in dict.fromkeys(errors):
        shared = np.where(np.array(errors) == error, EXACT, 0.0)
        found[error] = np.concatenate([shared, np.zeros(layout.own * groups)])
    return found


UNKNOWN_UM = 1000.0
"""From 1 mm on a place is not known at all."""
EXACT = 1e8
"""Information of what is exactly known, in units of its prior's."""


def _sizes(space: Space, task: Task) -> dict[str, str]:
    """1σ of the set-up errors before the first reading, µm."""
    found = {}
    for name, group in GROUPS.items():
        mine = [s for n, s in zip(space.own, task.own_sigma, strict=True) if n in group.members]
        if mine:
            sigma = max(mine) * space.noise_um
            found[name] = f" ({plain_number(sigma)} µm)" if sigma < UNKNOWN_UM else " (not known)"
    return found


def _size(task: Task, value: float) -> str:
    """The criterion as 1σ: µm of the tool centre point, or per prior 1σ."""
    size = plain_number(math.exp(0.5 * value))
    return f"{size} µm" if task.criterion.name in ("V", "G") else f"{size} of the priors' 1σ"
