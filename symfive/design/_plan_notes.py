"""What a plan says of itself in plain words."""

from __future__ import annotations

from symfive.campaign import Campaign
from symfive.design._assess import Assessment, assess
from symfive.design._certificate import Certificate
from symfive.design._dominance import what_dominates
from symfive.design._rounding import not_rounded
from symfive.design._schedule import Schedule
from symfive.design._space import Space
from symfive.instruments import mounted
from symfive.numbers import with_unit
from symfive.optimal import Task


def plan_notes(
    space: Space, task: Task, schedule: Schedule, certificate: Certificate, expected: Assessment, given: Campaign | None
) -> tuple[str, ...]:
    """Why its certificate is low, what dominates, what it counts on, what could not be rounded, where the instrument comes off,
    what the machine file lacks."""
    return (
        *_why_low(certificate, space.instrument, expected), *what_dominates(space, task, schedule.rows),
        *_counts_on(schedule.campaign, expected, given), *_rounding_notes(space, schedule), *_notes(schedule),
    )  # fmt: skip


def _why_low(certificate: Certificate, instrument: str, assessment: Assessment) -> list[str]:
    """Why a plan stays far from its bound, where it does: fewer readings than unknowns, or whole poses."""
    if not certificate.why_low:
        return []
    points = certificate.points
    readings, unknowns = points * (1 if instrument == "ball_bar" else 3), len(assessment.parameters)
    if readings >= unknowns:
        return [certificate.why_low]
    return [
        f"{readings} readings for {unknowns} unknowns of machine and set-up: they determine {assessment.rank} combinations, the "
        f"priors the others; the bound allows more than {points} poses, so the certificate is low; more poses raise it"
    ]


def _counts_on(campaign: Campaign, expected: Assessment, given: Campaign | None) -> list[str]:
    """How much larger 1σ are if tool ball and bar are not mounted anew, where that shows."""
    staying = campaign.staying("tool_ball", "length")
    if all(before is after for before, after in zip(campaign.runs, staying.runs, strict=True)):
        return []
    sigma = assess(staying, given=given).sigma
    ratio = {p.name: sigma[p.name] / expected.sigma[p.name] for p in expected.parameters if not p.of_setup}
    name = max(ratio, key=lambda name: ratio[name])
    unit = next(p.unit for p in expected.parameters if p.name == name)
    before, after = with_unit(expected.sigma[name], unit), with_unit(sigma[name], unit)
    if before == after:
        return []
    what = "tool ball and bar are" if campaign.runs[0].length is not None else "the tool ball is"
    return [f"expected 1σ hold if {what} mounted anew for every run; otherwise 1σ of {name} is {after}, not {before}"]


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
        f"run {name}: {what} before {count} of the poses{stops}; no clear move with the {seated} was found, and another pose "
        "would cost more information than time"
    )


def _notes(schedule: Schedule) -> tuple[str, ...]:
    notes = [
        _removals(schedule, run, len(rows))
        for run, rows in schedule.unsafe.items()
        if schedule.moves[run].seated.follows
    ]
    if schedule.campaign.machine.workspace.spindle_nose is None:
        notes.append("collisions were not checked: the machine file names no spindle nose ([workspace] spindle_nose)")
    axes = schedule.campaign.machine.axes.items()
    if silent := [name for name, axis in axes if axis.max_feed is None or axis.max_acceleration is None]:
        notes.append(
            f"the machine file names no max_feed or max_acceleration of {', '.join(silent)}: programs move as on a slow machine"
        )
    return tuple(notes)
