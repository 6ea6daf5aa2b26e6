"""What is asked of a plan, checked: its settings, parameters, priors, bars, indexing of the spindle, and what no plan can see.

The ball's offset across the spindle's axis turns with the spindle. Two readings of one pose have half their difference as the
offset, whatever the machine does, with 1σ = noise/√2 in every direction; added to the prior's that leaves (1/σ² + 2/noise²)^-½.
Along the axis nothing is learnt: that takes a tool of known length.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from symfive.campaign import Campaign, SetupSigma
from symfive.design._assess import machine_information, workspace_places
from symfive.design._candidates import candidates_in, pose_grid, setup_options, value_of
from symfive.design._schedule import affordable
from symfive.design._space import Space, make_space
from symfive.errors import InputError, among
from symfive.machine import Machine
from symfive.optimal import Criterion, Rows, Task, criterion_of
from symfive.validation import at_most, positive

SEEN = 0.5
"""A parameter is seen by a plan where the posterior variance is below this share of its prior's."""
LEAST = {"points": 2, "returns": 0}
MOST = {"points": 10_000, "starts": 10_000, "repeats": 1000}
DAY_MIN = 1440.0
FRAMES = ("workpiece", "machine", "tool")
ROBUST = ("nominal", "mean", "worst")
BALL_MM = 12.7
"""Diameter of the balls of the usual ball bars (half an inch)."""
ACROSS = ("tool_ball.x", "tool_ball.y")


@dataclass(frozen=True, kw_only=True)
class Request:
    """A plan as it is asked for, by the arguments of `plan`: what is to be known, with what, and at what effort.

    Raises `InputError` for settings that no plan has.
    """

    criterion: str | Criterion
    for_: tuple[str, ...]
    given: Campaign | None
    robust: str
    survive: bool

    machine: Machine
    instrument: str
    setups: int | None
    noise_um: float
    setup_sigma: SetupSigma | None
    frame: str
    index: bool | None
    returns: int
    repeats: int

    points: int | None
    minutes: float | None
    per_minute: bool
    starts: int
    anywhere: bool
    prove: bool
    seed: int
    pool: Executor | None
    progress: Callable[[str], None]

    def __post_init__(self) -> None:
        counts = ("points", "setups", "repeats", "returns", "starts")
        check_counts(self.machine, {name: getattr(self, name) for name in counts})
        check_robust(self.robust)
        check_minutes(self.minutes)
        if not (self.noise_um > 0.0 and math.isfinite(self.noise_um)):
            raise InputError(f"noise_um = {self.noise_um:g} is not positive", remedy="give the instrument's 1σ in µm")
        among(self.frame, FRAMES, f'frame = "{self.frame}" is unknown')
        if self.frame != FRAMES[0] and self.instrument != "r_test":
            raise InputError(f"readings of {self.instrument} have no frame", remedy="use instrument r_test")

    def space(self) -> Space:
        """All poses and set-ups that the plan may choose from. Raises `InputError` where there is none."""
        options = {} if self.frame == FRAMES[0] else {"frame": self.frame}
        noise_um = self.noise_um / math.sqrt(self.repeats)
        return make_space(
            self.machine, self.instrument, noise_um=noise_um, setup_sigma=self.setup_sigma, options=options
        )

    @property
    def shares(self) -> list[tuple[int, int]]:
        """Numbers of poses and of runs that fit into the time, for every number of runs. Raises `InputError` for none."""
        runs = self.setups or usual_setups(self.instrument)
        return affordable(self.machine, self.minutes, self.points or MOST["points"], runs, self.returns, self.repeats)


def usual_setups(instrument: str) -> int:
    """So many mountings at most where nobody says how many."""
    return 3 if instrument == "ball_bar" else 2


def check_minutes(minutes: float | None) -> None:
    """Refuse times that no plan has."""
    if minutes is not None:
        positive("plan", minutes=minutes)
        at_most("plan", DAY_MIN, "min", "over a day no temperature, and no machine, stays the same", minutes=minutes)


def check_robust(robust: str) -> None:
    """Refuse what a plan cannot be robust for."""
    among(robust, ROBUST, f'robust = "{robust}" is unknown')


def with_bars(machine: Machine, lengths: Sequence[float]) -> Machine:
    """The machine with the bars that the user owns in place of its file's."""
    if not lengths:
        return machine
    for length in lengths:
        if 0.0 < length <= BALL_MM:
            raise InputError(
                f"a bar of {length:g} mm is impossible: its balls touch at {BALL_MM} mm", remedy="give its length in mm"
            )
    return replace(machine, workspace=replace(machine.workspace, bar_lengths=tuple(float(v) for v in lengths)))


def check_counts(machine: Machine, counts: Mapping[str, int | None]) -> None:
    """Refuse numbers that are too small and machines without a workspace."""
    for name, value in counts.items():
        least = LEAST.get(name, 1)
        if value is not None and value < least:
            raise InputError(f"{name} = {value} is too few", remedy=f"give at least {least}")
        if value is not None and value > MOST.get(name, value):
            raise InputError(f"{name} = {value} is too many", remedy=f"give at most {MOST[name]}")
    if machine.workspace.table_radius is None:
        raise InputError(
            "the machine file has no workspace", remedy="add [workspace] with table_radius and ball_height"
        )


def interest_of(names: Sequence[str], wanted: tuple[str, ...]) -> tuple[str, ...]:
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


def check_given(given: Campaign, machine: Machine) -> None:
    """Refuse a campaign of another machine."""
    if given.machine.structure != machine.structure:
        raise InputError("the campaign given is of another machine", remedy="give one measured on this machine")


def task_of(space: Space, criterion: str | Criterion, wanted: Sequence[str], given: Campaign | None) -> Task:
    """The task of a plan in this space, with the information of an earlier campaign; `criterion` itself or its name."""
    names = [p.name for p in space.shared]
    interest = np.array([names.index(name) for name in wanted], dtype=np.int64)
    prior = np.eye(len(names))
    if given is not None:
        check_given(given, space.machine)
        sigma = np.array([p.sigma for p in space.shared])
        prior = prior + machine_information(given, names) * np.outer(sigma, sigma)
    if not isinstance(criterion, str):
        return Task(criterion, prior, space.own_sigma, interest)
    places = (
        workspace_places(space)[:, :, interest] if criterion in ("G", "V", "I") else np.zeros((0, 3, len(interest)))
    )
    return Task(criterion_of(criterion, len(interest), places), prior, space.own_sigma, interest)


def refuse_unseen(space: Space, task: Task, points: int, names: Sequence[str]) -> None:
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
                f"it cannot be separated from {partner}"
                if partner
                else "no reading depends on it, or only below the noise"
            )
            remedy = f"leave it out, fix {partner} in the machine file" if partner else "leave it out"
            raise InputError(
                f"no {space.instrument} plan determines {names[i]}: {why}",
                remedy=f"{remedy}, or use another instrument",
            )


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
