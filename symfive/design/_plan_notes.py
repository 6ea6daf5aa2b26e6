"""What a plan says of itself in plain words, and the set-up or machine error that limits it however many poses are measured.

With more and more readings at the plan's poses the criterion falls towards that of readings without noise. Where a plan is close
to it, only knowing something else helps: each group of set-up errors, and where none matters each error of the machine, is
taken as exactly known in turn, and the one that lowers the criterion most dominates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Campaign
from symfive.design._assess import Assessment, assess
from symfive.design._candidates import information_of
from symfive.design._certificate import Certificate
from symfive.design._rounding import not_rounded
from symfive.design._schedule import Schedule
from symfive.design._space import Space
from symfive.instruments import is_probed, mounted
from symfive.nc import table_assumed
from symfive.numbers import plain_number, with_unit
from symfive.optimal import Rows, Task

NOISE_HARDLY = 0.95
"""Share of a 1σ from which what is left of it counts as all of it: what went is a tenth of the variance at most."""
MORE = 4.0
"""So many times as many poses would halve every 1σ that noise causes."""


def plan_notes(
    space: Space, task: Task, schedule: Schedule, certificate: Certificate, expected: Assessment, given: Campaign | None
) -> tuple[str, ...]:
    """Why its certificate is low, what dominates, what it counts on, what could not be rounded, where the instrument comes off,
    what the machine file lacks."""
    indexed = any(run.spindle is not None for run in schedule.campaign.runs)
    return (
        *_why_low(certificate, space.kernel.readings, expected, given),
        *what_dominates(space, task, schedule.rows, indexed=indexed),
        *_counts_on(schedule.campaign, expected, given), *_rounding_notes(space, schedule), *_notes(schedule),
    )  # fmt: skip


def _why_low(certificate: Certificate, of_a_pose: int, assessment: Assessment, given: Campaign | None) -> list[str]:
    """Why a plan stays far from its bound, where it does: fewer readings, so many `of_a_pose`, than unknowns, or whole poses."""
    if not certificate.why_low:
        return []
    points = certificate.points
    readings, unknowns = points * of_a_pose, len(assessment.parameters)
    if readings >= unknowns:
        return [certificate.why_low]
    earlier = "" if given is None else " and the earlier ones"
    return [
        f"{readings} readings{earlier} for {unknowns} unknowns of machine and set-up determine {assessment.rank} combinations; "
        f"the priors determine the rest. The bound may spread the readings over more than {points} poses, so the certificate is "
        "low; more poses raise it"
    ]


def _counts_on(campaign: Campaign, expected: Assessment, given: Campaign | None) -> list[str]:
    """How much larger 1σ are if tool ball and bar are not mounted anew, where that shows."""
    staying = campaign.staying("tool_ball", "length")
    if all(before is after for before, after in zip(campaign.runs, staying.runs, strict=True)):
        return []
    sigma = assess(staying, given=given).sigma
    ratio = {p.name: sigma[p.name] / expected.sigma[p.name] for p in expected.parameters if not p.of_setup}
    name = max(ratio, key=lambda name: ratio[name])
    worst = next(p for p in expected.parameters if p.name == name)
    before, after = with_unit(expected.sigma[name], worst.unit), with_unit(sigma[name], worst.unit)
    if before == after:
        return []
    first = campaign.runs[0]
    what = "tool ball and bar are remounted" if first.length is not None else "the tool ball is remounted"
    what = "the probe is calibrated again" if is_probed(first) else what
    return [f"the expected 1σ assume that {what} for every run; otherwise 1σ of {worst.words} is {after}, not {before}"]


def _rounding_notes(space: Space, schedule: Schedule) -> list[str]:
    """What of the plan is not on the grid of 0.01° and 1 mm."""
    setups, poses = not_rounded(space, schedule.rows)
    notes = [
        f"run {schedule.campaign.runs[g - 1].id}: ball and tool length could not be rounded to 1 mm within the limits"
        for g in setups
    ]
    if poses:
        notes.append(f"{poses} poses could not be rounded to 0.01° within the limits")
    return notes


def _removals(schedule: Schedule, name: str, count: int) -> str:
    """How often the instrument comes off within a run, and why."""
    run = next(run for run in schedule.campaign.runs if run.id == name)
    bar = run.length is not None
    stands, held = mounted(run)
    what = "remove the bar" if bar else f"leave the {stands}"
    stops = " (program stops there)" if bar else ""
    seated = "bar on" if bar else f"{held.split()[-1]} in the nest" if stands == "nest" else f"{held} at the {stands}"
    return (
        f"run {name}: {what} before {count} of the poses{stops}; no collision-free move with the {seated} was found, and other "
        "poses would lose more information than they save time"
    )


def _notes(schedule: Schedule) -> tuple[str, ...]:
    notes = [
        _removals(schedule, run, len(rows))
        for run, rows in schedule.unsafe.items()
        if schedule.moves[run].seated.follows
    ]
    if schedule.campaign.machine.workspace.spindle_nose is None:
        notes.append("collisions were not checked: the machine file names no spindle nose ([workspace] spindle_nose)")
    machine = schedule.campaign.machine
    notes += table_assumed(machine)
    axes = machine.axes.items()
    if silent := [name for name, axis in axes if axis.max_feed is None or axis.max_acceleration is None]:
        notes.append(
            f"the machine file states no max_feed or max_acceleration of {', '.join(silent)}: "
            "programs use those of a slow machine"
        )
    return tuple(notes)


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
        "table_ball", "the table ball's position", ("table_ball.x", "table_ball.y", "table_ball.z"),
        "measure it (--table-ball-sigma)",
    ),
    SetupError(
        "zero", "the nest's position in the workpiece frame", ("zero.x", "zero.y", "zero.z"),
        "mount it at a calibrated position (--zero-sigma)",
    ),
    SetupError("length", "the bar's length", ("length",), "calibrate it (--bar-length-sigma)"),
)  # fmt: skip


GROUPS = {error.name: error for error in SETUP_ERRORS}
"""Set-up errors that limit a plan, in words, with the remedy for each."""


def what_dominates(space: Space, task: Task, rows: Rows, *, indexed: bool = False) -> list[str]:
    """One sentence where the criterion hardly moves with the number of poses; nothing where it does, nor where there are fewer
    readings than unknowns: further poses then determine what repeated ones do not."""
    prior, count = task.prior_information(rows.groups), len(rows.z)
    least = math.ceil(len(prior) / space.kernel.readings)
    if count < least:
        return []
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
    if indexed and name == SETUP_ERRORS[0].name:
        remedy = "the noise of the spindle indexing limits it; more set-ups average it (--setups)"
    worst = now - 2.0 * math.log(NOISE_HARDLY)
    few = next((n for n in range(least, count) if task.value(prior + n / count * read) <= worst), count)
    enough = f", {few} of the {count} do as well" if 2 * few <= count else ""
    return [
        f"more poses in these set-ups hardly help{enough}: {task.criterion.name} is {_size(task, now)}, with {MORE:g} times as "
        f"many {_size(task, more)}; {name}{sigma.get(name, '')} dominates; if it were known exactly, {_size(task, known[name])} "
        f"would remain: {remedy}"
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
