"""What is asked of a plan, checked: its settings, parameters, priors, bars, and what no plan can see."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from symfive.campaign import Campaign, SetupSigma
from symfive.design._assess import machine_information, workspace_places
from symfive.design._budget import affordable
from symfive.design._candidates import candidates_in, pose_grid, setup_options
from symfive.design._space import Space, make_space
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.optimal import Criterion, Task, criterion_of
from symfive.validation import at_most, positive

__all__ = [
    "MOST", "Request", "check_counts", "check_minutes", "check_robust", "interest_of", "refuse_unseen", "task_of", "usual_setups",
    "with_bars",
]  # fmt: skip

SEEN = 0.5
"""A parameter is seen by a plan where the posterior variance is below this share of its prior's."""
LEAST = {"points": 2, "returns": 0}
MOST = {"points": 10_000, "starts": 10_000, "repeats": 1000}
DAY_MIN = 1440.0
FRAMES = ("workpiece", "machine", "tool")
ROBUST = ("nominal", "mean", "worst")
BALL_MM = 12.7
"""Diameter of the balls of the usual ball bars (half an inch)."""


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

    points: int
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
        if self.frame not in FRAMES:
            raise InputError(f'frame = "{self.frame}" is unknown', remedy=f"use one of {', '.join(FRAMES)}")
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
        return affordable(self.machine, self.minutes, self.points, runs, self.returns, self.repeats)


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
    if robust not in ROBUST:
        raise InputError(f'robust = "{robust}" is unknown', remedy=f"use one of {', '.join(ROBUST)}")


def with_bars(machine: Machine, lengths: Sequence[float]) -> Machine:
    """The machine with the bars that the user owns in place of its file's."""
    if not lengths:
        return machine
    for length in lengths:
        if 0.0 < length <= BALL_MM:
            raise InputError(
                f"a bar of {length:g} mm is impossible: its balls touch at {BALL_MM} mm",
                remedy="give its length in mm",
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


def task_of(space: Space, criterion: str | Criterion, wanted: Sequence[str], given: Campaign | None) -> Task:
    """The task of a plan in this space, with the information of an earlier campaign; `criterion` itself or its name."""
    names = [p.name for p in space.shared]
    interest = np.array([names.index(name) for name in wanted], dtype=np.int64)
    prior = np.eye(len(names))
    if given is not None:
        if given.machine.structure != space.machine.structure:
            raise InputError("the campaign given is of another machine", remedy="give one measured on this machine")
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
