"""`plan`: from a machine and a wish to a measurement plan with its certificate, ready to run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import numpy as np

from symfive.campaign import Campaign, SetupSigma
from symfive.design._anywhere import bound_anywhere
from symfive.design._assess import assess
from symfive.design._candidates import value_of
from symfive.design._certificate import Certificate, certify
from symfive.design._optimise import optimise
from symfive.design._part import Part, part_criterion
from symfive.design._plan_notes import plan_notes
from symfive.design._plan_search import PlanSearch
from symfive.design._request import Request, indexed, interest_of, refuse_unseen, task_of, with_bars, worth_indexing
from symfive.design._result import Left, PartPlan, Plan
from symfive.design._robust import drawn_spaces, lost_pose, over_prior
from symfive.design._schedule import SETUP_S, Schedule
from symfive.design._space import Space
from symfive.errors import InputError
from symfive.given import campaign_given, machine_given
from symfive.machine import Machine
from symfive.nc import Post
from symfive.optimal import Criterion, Rows, Task, inverse, name_of
from symfive.threads import one_thread
from symfive.toolpath import ToolPath, read_tool_path

INDEXED = (
    "the spindle is indexed in every run: for this part this gains more than one further pose (--no-index forbids it)"
)
USUAL_POINTS = 40
"""Poses of a plan where neither their number nor its time is given."""
REPORTED_DRAWS, DRAWS = 2, 6
"""Machines drawn from the priors: to report how a plan fares on them, and to choose a robust plan."""


@one_thread
def plan(
    machine: Machine | Path | str, *, instrument: str = "r_test", criterion: str | Criterion | None = None,
    points: int | None = None, for_: Iterable[str] = (), part: ToolPath | Path | str | None = None,
    given: Campaign | Path | str | None = None, setups: int | None = None,
    lengths: Sequence[float] = (), minutes: float | None = None,
    per_minute: bool = False, returns: int = 2, repeats: int = 1, noise_um: float = 0.3,
    setup_sigma: SetupSigma | None = None, frame: str = "workpiece", index: bool | None = None, survive: bool = False,
    robust: str = "nominal", starts: int = 2, anywhere: bool = True, prove: bool = True, seed: int = 0,
    pool: Executor | None = None,
    progress: Callable[[str], None] = lambda message: None,
) -> Plan:  # fmt: skip
    """The static plan of `points` poses with the smallest uncertainty of the parameters `for_`.

    - `machine`: a machine, the path of its file, or the name of a preset. `instrument`: `r_test`, `touch_probe` or `ball_bar`.
    - `points`: number of poses (default 40, with `minutes` as many as fit). `minutes`: time budget. `per_minute`: the poses and
      runs with most information per minute.
    - `criterion`: D (default), A, E, G or V (`I`), or one of your own. `for_`: names of the parameters to determine (default: all
      of the machine's); the others and every set-up error are marginalised.
    - `part`: a tool path or its file (`symfive.toolpath`). G (default) and V are then the worst and the mean expected error of
      the tool along it. The plan has as many set-ups as fit into `minutes` (default: those of the D plan, which is made for
      comparison), and indexes the spindle where that gains information.
    - `given`: a campaign already measured on this machine, which the plan complements. `setups`: largest number of positions of
      ball or nest (default 2, ball bar 3). `lengths`: bars that the user owns, mm (default: the machine file's).
    - `returns`: to the first pose of each run, against drift. `repeats`: readings of each pose. `index`: the first pose of each
      run is read with the spindle at 0° and 180°, which determines the run-out of the tool ball.
    - `setup_sigma`: 1σ of set-up errors. `frame` of an R-test's readings: `workpiece` (nest on the table), `machine` or `tool`
      (head in the spindle).
    - `survive`: optimise for the loss of any one pose. `robust`: `nominal`, or the `mean` or `worst` case over machines drawn
      from the priors. `starts`: of the search. `pool`: any executor (`symfive.executors`); its workers share the starts.
    - `anywhere`: the certificate also compares with all other set-ups (a few seconds). `prove`: its bound is proved (seconds, for
      some ball bars a quarter of a minute).

    Raises `InputError` where no pose can be reached, no bar fits, or no plan determines a parameter.
    """
    machine = with_bars(machine_given(machine), lengths)
    request = Request(
        criterion=criterion or ("D" if part is None else "G"), for_=tuple(for_),
        given=None if given is None else campaign_given(given), robust=robust, survive=survive,
        machine=machine, instrument=instrument, setups=setups, noise_um=noise_um, setup_sigma=setup_sigma, frame=frame,
        index=index, returns=returns, repeats=repeats,
        points=USUAL_POINTS if points is None and minutes is None else points, minutes=minutes, per_minute=per_minute,
        starts=starts, anywhere=anywhere, prove=prove, seed=seed, pool=pool, progress=progress,
    )  # fmt: skip
    route = _part_given(machine, part, request.for_)
    return _planned(request) if route is None else _planned_for(request, route)


def _part_given(machine: Machine, part: ToolPath | Path | str | None, wanted: tuple[str, ...]) -> Part | None:
    """The part that a plan is for. Raises `InputError` for one with errors named beside it."""
    if part is None:
        return None
    if wanted:
        raise InputError("a part counts every error of the machine", remedy="leave out --for, or --part")
    return Part(machine, part if isinstance(part, ToolPath) else read_tool_path(part, machine))


def _mountings_in(minutes: float) -> int:
    """As many set-ups as fit into the time: what they share is averaged by mounting anew."""
    return max(1, int(60.0 * minutes // SETUP_S))


def _planned(request: Request) -> Plan:
    """The plan for the parameters that are asked for."""
    space = request.space()
    wanted = interest_of([p.name for p in space.shared], request.for_)
    task = task_of(space, request.criterion, wanted, request.given)
    return _searched(request, space, indexed(space, task) if request.index else task)


def _planned_for(request: Request, part: Part) -> Plan:
    """The plan for a part, compared with the D plan in the same time."""
    space, minutes = request.space(), request.minutes
    criterion = part_criterion(part, space, name_of(request.criterion))
    if minutes is not None:
        request = replace(request, setups=request.setups or _mountings_in(minutes))
    request.progress("D plan for comparison")
    ordinary = _planned(
        replace(
            request, criterion="D", index=bool(request.index), per_minute=False, survive=False, robust="nominal", anywhere=False,
            prove=False,
        )
    )  # fmt: skip
    minutes = minutes or ordinary.minutes
    request = replace(request, minutes=minutes, setups=request.setups or _mountings_in(minutes))
    task, notes = task_of(space, criterion, [p.name for p in space.shared], request.given), list[str]()
    if request.index is None:
        design, _ = optimise(space, task, *request.shares[-1], starts=1, seed=request.seed)
        request = replace(request, index=worth_indexing(space, task, design))
        notes += [INDEXED] if request.index else []
    task = indexed(space, task) if request.index else task
    made = _searched(request, space, task)
    return replace(made, part=_compared(part, space, task, ordinary, made), notes=(*notes, *made.notes))


def _compared(part: Part, space: Space, task: Task, ordinary: Plan, made: Plan) -> PartPlan:
    """What is expected along the part before, with the ordinary plan, and after the one made for it."""
    places = [[p.name for p in space.shared].index(name) for name in part.names]
    before = part.expected(inverse(task.prior)[np.ix_(places, places)])
    return PartPlan(part, before, ordinary, Left.by(ordinary, part), Left.by(made, part))


def _searched(request: Request, space: Space, task: Task) -> Plan:
    """The plan for a task: search, moves, certificate, and what is expected of it."""
    names = [p.name for p in space.shared]
    points, runs = request.shares[-1]
    refuse_unseen(space, task, points, names)
    request.progress(f"{len(names)} parameters, {points} poses, at most {runs} set-ups")
    search = PlanSearch(request, space, task)
    rows, values = search.best(request.shares)
    drawn = drawn_spaces(space, REPORTED_DRAWS if request.robust == "nominal" else DRAWS)
    if request.per_minute:
        rows, values = search.most_per_minute(rows, values)
    if request.robust != "nominal":
        rows = search.robust(rows, drawn, request.robust)
    if request.survive:
        rows = search.surviving(rows)
    schedule, post = search.driven(rows)
    request.progress("computing the certificate")
    certificate = _certified(request, space, task, schedule.rows)
    return _finished(search, schedule, post, certificate, values, over_prior(drawn, task, schedule.rows))


def _certified(request: Request, space: Space, task: Task, rows: Rows) -> Certificate:
    certificate = certify(space, task, rows, prove=request.prove)
    if not request.anywhere:
        return certificate
    bound = min(certificate.bound, bound_anywhere(space, task, rows, request.shares[-1][1]))
    return replace(certificate, anywhere=min(1.0, math.exp(bound - certificate.value)))


def _finished(
    search: PlanSearch, schedule: Schedule, post: Post, certificate: Certificate, values: tuple[float, ...],
    drawn: tuple[float, float],
) -> Plan:  # fmt: skip
    request, space, task, rows = search.request, search.space, search.task, schedule.rows
    value, before = value_of(space, task, rows), task.value(task.prior)
    expected = assess(schedule.campaign, given=request.given)
    left, _ = lost_pose(task, space.kernel.rows(rows.z, rows.k), rows.group, rows.groups)
    return Plan(
        machine=request.machine, instrument=request.instrument, criterion=name_of(request.criterion),
        interest=tuple(space.shared[i].name for i in task.interest), campaign=schedule.campaign, certificate=certificate,
        assessment=expected, starts=values, minutes=schedule.seconds / 60.0, unsafe=schedule.unsafe, lost=math.exp(value - left),
        over_prior=(math.exp(value - drawn[0]), math.exp(value - drawn[1])),
        information_per_minute=(before - value) / (schedule.seconds / 60.0), drift=schedule.drift, post=post,
        notes=plan_notes(space, task, schedule, certificate, expected, request.given),
    )  # fmt: skip
