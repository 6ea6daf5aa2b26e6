"""`plan`: from a machine and a wish to a measurement plan with its certificate, ready to run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign, SetupSigma
from symfive.design._anywhere import bound_anywhere
from symfive.design._assess import Assessment, assess, machine_information, workspace_places
from symfive.design._candidates import PER_SETUP, candidates_in, pose_grid, setup_options
from symfive.design._certificate import Certificate, certify
from symfive.design._criteria import criterion_of
from symfive.design._information import Task
from symfive.design._optimise import optimise, rounded, value_of
from symfive.design._refine import Rows
from symfive.design._robust import lost_pose, over_prior, survive_a_lost_pose
from symfive.design._schedule import SETUP_S, Schedule, scheduled, shortened
from symfive.design._space import Space, make_space
from symfive.errors import InputError
from symfive.files import output_folder
from symfive.machine import Machine
from symfive.nc import DIALECTS, Post
from symfive.threads import one_thread

__all__ = ["Plan", "plan"]

Array = NDArray[np.float64]
SEEN = 0.5
"""A parameter is seen by a plan where the posterior variance is below this share of its prior's."""


@dataclass(frozen=True)
class Plan:
    """A measurement plan.

    `campaign` without readings; `criterion` and the parameters `interest` it is for; `certificate` of the poses before the
    return poses were added; `assessment` of the whole; `starts` ψ of every start; `minutes` it takes; `unsafe` run → rows
    before which the spindle is drawn back; `lost` the efficiency left if the most important pose is lost;
    `over_prior` mean and worst efficiency when the machine's errors are drawn from the priors; `information_per_minute`
    nats of ψ a minute; `drift` efficiency left when a linear drift is a nuisance; `notes` in plain words.
    """

    machine: Machine
    instrument: str
    criterion: str
    interest: tuple[str, ...]
    campaign: Campaign
    certificate: Certificate
    assessment: Assessment
    starts: tuple[float, ...]
    minutes: float
    unsafe: dict[str, tuple[int, ...]]
    lost: float
    over_prior: tuple[float, float]
    information_per_minute: float
    drift: float
    notes: tuple[str, ...] = ()

    def write(self, folder: Path | str, *, nc: Iterable[str] = ("iso",), post: Post | None = None) -> None:
        """The campaign without readings, plan.json, NC programs, set-up sheet and figures, whole or not at all."""
        from symfive.design._write import write_plan

        with output_folder(Path(folder)) as target:
            write_plan(self, target, tuple(nc), post)

    def __str__(self) -> str:
        runs = [
            f"  {run.id}: {run.rows} rows, ball at {tuple(round(v) for v in run.table_ball)} mm"
            for run in self.campaign.runs
        ]
        head = (
            f"{self.instrument} plan, {self.certificate.points} poses, {self.minutes:.0f} min: {self.certificate.says}"
        )
        return "\n".join([head, *runs, str(self.assessment)])

    def to_data(self) -> dict[str, Any]:
        """plan.json as nested mappings."""
        from symfive.design._write import plan_data

        return plan_data(self)


@one_thread
def plan(
    machine: Machine, *, instrument: str = "r_test", criterion: str = "D", points: int = 40, for_: Iterable[str] = (),
    given: Campaign | None = None, setups: int | None = None, minutes: float | None = None, returns: int = 2,
    repeats: int = 1, noise_um: float = 0.3, setup_sigma: SetupSigma | None = None, survive: bool = False, starts: int = 6,
    anywhere: bool = True, seed: int = 0, progress: Callable[[str], None] = lambda message: None,
) -> Plan:  # fmt: skip
    """The static plan of `points` poses that makes the uncertainty of what is sought smallest.

    `instrument` `r_test` or `ball_bar`; `criterion` D, A, E, G or V (`I`); `for_` names of the parameters that count (by
    default all of the machine's), the others and every set-up error being marginalised; `given` a campaign already
    measured on this machine, to which the plan adds; `setups` at most so many places of ball or nest (default 2, ball bar
    3); `minutes` a time budget; `returns` visits back to the first pose of each run, against drift; `repeats` readings of
    each pose; `survive` prefers a plan that stays good if any one pose is lost; `starts` of the search;
    `anywhere`: whether the certificate also
    compares with all other set-ups (a few seconds).

    Raises `InputError` where no pose can be reached, no bar fits, or a parameter is seen by no plan.
    """
    _check(machine, points, setups, repeats, returns, starts)
    space = make_space(machine, instrument, noise_um=noise_um / math.sqrt(repeats), setup_sigma=setup_sigma)
    names = tuple(p.name for p in space.shared)
    wanted = _interest(names, tuple(for_))
    task = _task(space, criterion, wanted, given)
    runs = setups or (2 if instrument == "r_test" else 3)
    if minutes is not None:
        points = _affordable(machine, minutes, points, runs, returns, repeats)
    runs = min(runs, max(1, points // 2))
    _refuse_unseen(space, task, points, names)
    progress(f"{len(names)} parameters, {points} poses, at most {runs} set-ups")
    rows, values = optimise(space, task, points, runs, starts=starts, seed=seed, progress=progress)
    rows = rounded(space, rows)
    if survive:
        progress("making it survive the loss of a pose")
        rows = _surviving(space, task, rows)
    progress("certificate")
    certificate = _certified(space, task, rows, runs, anywhere)
    progress("order of poses")
    schedule = scheduled(space, rows, returns=returns, repeats=repeats, noise_um=noise_um)
    if minutes is not None:
        schedule = shortened(space, task, rows, schedule, 60.0 * minutes, returns, repeats, noise_um)
        if len(schedule.rows.z) < len(rows.z):
            rows = schedule.rows
            certificate = _certified(space, task, rows, runs, anywhere)
    return _finished(machine, space, task, rows, schedule, certificate, values, given, criterion, wanted)


def _certified(space: Space, task: Task, rows: Rows, runs: int, anywhere: bool) -> Certificate:
    certificate = certify(space, task, rows)
    if not anywhere:
        return certificate
    bound = min(certificate.bound, bound_anywhere(space, task, rows, runs))
    return replace(certificate, anywhere=min(1.0, math.exp(bound - certificate.value)))


def _check(machine: Machine, points: int, setups: int | None, repeats: int, returns: int, starts: int) -> None:
    given = {
        "points": points,
        "setups": 1 if setups is None else setups,
        "repeats": repeats,
        "returns": returns,
        "starts": starts,
    }
    for name, value in given.items():
        least = {"points": 2, "returns": 0}.get(name, 1)
        if value < least:
            raise InputError(f"{name} = {value} is too few", remedy=f"give at least {least}")
    if machine.workspace.table_radius is None:
        raise InputError(
            "the machine file has no workspace", remedy="add [workspace] with table_radius and ball_height"
        )


def _interest(names: Sequence[str], wanted: tuple[str, ...]) -> tuple[str, ...]:
    """Names or beginnings of names (`EXC` for all its coefficients) as full names."""
    if not wanted:
        return tuple(names)
    found: list[str] = []
    for name in wanted:
        matching = [n for n in names if n == name or n.startswith(name + ".")]
        if not matching:
            shown = ", ".join(names[:8]) + (", …" if len(names) > 8 else "")
            raise InputError(f"the machine's model has no parameter {name}", remedy=f"use names such as {shown}")
        found += [n for n in matching if n not in found]
    return tuple(found)


def _task(space: Space, criterion: str, wanted: Sequence[str], given: Campaign | None) -> Task:
    names = [p.name for p in space.shared]
    interest = np.array([names.index(name) for name in wanted], dtype=np.int64)
    prior = np.eye(len(names))
    if given is not None:
        if given.machine.structure != space.machine.structure:
            raise InputError("the campaign given is of another machine", remedy="give one measured on this machine")
        sigma = np.array([p.sigma for p in space.shared])
        prior = prior + machine_information(given, names) * np.outer(sigma, sigma)
    places = (
        workspace_places(space)[:, :, interest] if criterion in ("G", "V", "I") else np.zeros((0, 3, len(interest)))
    )
    return Task(criterion_of(criterion, len(interest), places), prior, space.own_sigma, interest)


def _affordable(machine: Machine, minutes: float, points: int, runs: int, returns: int, repeats: int) -> int:
    left = 60.0 * minutes - SETUP_S
    most = int(left // (machine.workspace.seconds_per_pose * repeats)) - returns
    if most < 2:
        least = math.ceil((SETUP_S + (2 + returns) * machine.workspace.seconds_per_pose * repeats) / 60.0)
        problem = f"{minutes:g} minutes are too short for one set-up and two poses"
        raise InputError(problem, remedy=f"give at least {least} minutes")
    return min(points, most)


def _refuse_unseen(space: Space, task: Task, points: int, names: Sequence[str]) -> None:
    """Refuse parameters asked for by name that even all candidate poses together do not see."""
    setups, lengths = setup_options(space)
    poses = pose_grid(space, 60)
    candidates = candidates_in(space, setups, lengths, poses)
    if len(task.interest) == len(names):
        return
    groups = len(setups)
    rich = task.information(candidates.rows, candidates.group, groups, np.full(len(candidates), points / 60.0))
    covariance = np.linalg.inv(task.marginal(rich, task.layout(groups)))
    known = np.linalg.inv(task.prior)
    for i in task.interest:
        if covariance[i, i] > SEEN * known[i, i]:
            coupled = np.abs(covariance[i]) / np.sqrt(covariance[i, i] * np.diag(covariance))
            coupled[i] = 0.0
            partner = names[int(np.argmax(coupled))] if coupled.max() > 0.5 else ""
            why = (
                f"it cannot be told apart from {partner}"
                if partner
                else "no reading depends on it, or the noise hides it"
            )
            remedy = f"leave it out, fix {partner} in the machine file" if partner else "leave it out"
            raise InputError(
                f"no {space.instrument} plan can see {names[i]}: {why}", remedy=f"{remedy}, or use another instrument"
            )


def _surviving(space: Space, task: Task, rows: Rows) -> Rows:
    setups = np.stack([rows.z[rows.group == g][0, rows.poses :] for g in range(rows.groups)])
    lengths = np.stack([rows.k[rows.group == g][0] for g in range(rows.groups)])
    grid = candidates_in(space, setups, lengths, pose_grid(space, PER_SETUP))
    return survive_a_lost_pose(space, task, rows, grid)


def _finished(
    machine: Machine, space: Space, task: Task, rows: Rows, schedule: Schedule, certificate: Certificate,
    values: tuple[float, ...], given: Campaign | None, criterion: str, wanted: tuple[str, ...],
) -> Plan:  # fmt: skip
    assessment = assess(schedule.campaign, given=given)
    value = value_of(space, task, rows)
    sensitivities = space.kernel.rows(rows.z, rows.k)
    left, _ = lost_pose(task, sensitivities, rows.group, rows.groups)
    mean, worst = over_prior(machine, space, task, rows, draws=2)
    before = task.value_of_marginal(task.prior)
    notes = [f"NC dialects: {', '.join(DIALECTS)}"]
    for run, unsafe in schedule.unsafe.items():
        notes.append(f"run {run}: the spindle is drawn back before {len(unsafe)} of its poses")
    if len(values) > 1 and max(values) - min(values) > 0.05:
        notes.append("the starts ended in different local optima; the best one is taken")
    return Plan(
        machine=machine, instrument=space.instrument, criterion=criterion, interest=wanted, campaign=schedule.campaign,
        certificate=certificate, assessment=assessment, starts=values, minutes=schedule.seconds / 60.0,
        unsafe=schedule.unsafe, lost=math.exp(value - left), over_prior=(math.exp(value - mean), math.exp(value - worst)),
        information_per_minute=(before - value) / (schedule.seconds / 60.0), drift=schedule.drift, notes=tuple(notes),
    )  # fmt: skip
