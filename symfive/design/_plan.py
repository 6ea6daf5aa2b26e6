"""`plan`: from a machine and a wish to a measurement plan with its certificate, ready to run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from symfive.campaign import Campaign, Run, SetupSigma
from symfive.design._anywhere import bound_anywhere
from symfive.design._assess import Assessment, assess
from symfive.design._budget import affordable
from symfive.design._certificate import Certificate, certify
from symfive.design._indexing import indexed, worth_indexing
from symfive.design._optimise import optimise, value_of
from symfive.design._part import part_criterion
from symfive.design._part_plan import PartPlan, compared, mountings_in, part_given
from symfive.design._plan_notes import plan_notes
from symfive.design._plan_search import PlanSearch
from symfive.design._request import check_counts, interest_of, refuse_unseen, task_of, with_bars
from symfive.design._robust import drawn_spaces, lost_pose, over_prior
from symfive.design._schedule import Schedule
from symfive.design._space import Space, make_space
from symfive.errors import InputError
from symfive.given import campaign_given, machine_given
from symfive.machine import Machine
from symfive.nc import Post
from symfive.optimal import Criterion, Rows, Task, name_of
from symfive.outputs import output_folder
from symfive.screen import OnScreen, listed
from symfive.threads import one_thread
from symfive.toolpath import ToolPath

__all__ = ["Plan", "plan"]

FRAMES = ("workpiece", "machine", "tool")
ROBUST = ("nominal", "mean", "worst")
INDEXED = (
    "the spindle is indexed in every run: for this part this gains more than one further pose (--no-index forbids it)"
)
REPORTED_DRAWS, DRAWS = 2, 6
"""Machines drawn from the priors: to report how a plan fares on them, and to choose a robust plan."""


@dataclass(frozen=True, repr=False)
class Plan(OnScreen):
    """A measurement plan.

    `campaign` without readings; `criterion` and the parameters `interest` it is for; `certificate` of the poses before the
    return poses were added; `assessment` of the whole; `starts` ψ of every design that the search began with; `minutes` it takes;
    `unsafe` run → rows before which the spindle is drawn back; `lost` the efficiency left if the most important pose is lost;
    `over_prior` mean and worst efficiency when the machine's errors are drawn from the priors; `information_per_minute`
    nats of ψ a minute; `drift` efficiency left when a linear drift is a nuisance; `post` the ways of the programs, every one of
    them clear; `part` what is expected along the part that it is for; `notes` in plain words.
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
    post: Post = field(default_factory=Post)
    part: PartPlan | None = None
    notes: tuple[str, ...] = ()

    def write(
        self,
        folder: Path | str,
        *,
        nc: Iterable[str] = ("iso",),
        post: Post | None = None,
        overwrite: bool = False,
    ) -> None:
        """The campaign without readings, plan.json, NC programs, set-up sheet and figures, whole or not at all.

        `nc` dialects of the programs."""
        from symfive.design._write import write_plan

        with output_folder(Path(folder), overwrite=overwrite) as target:
            write_plan(self, target, tuple(nc), post)

    def __str__(self) -> str:
        runs = [
            f"  {run.id}: {run.rows} rows of {_different(run)} poses, ball at {tuple(round(v) for v in run.table_ball)} mm, "
            f"tool {-run.tool_ball[2]:g} mm"
            for run in self.campaign.runs
        ]
        head = (
            f"{self.instrument} plan, {self.certificate.points} poses, {self.minutes:.0f} min: {self.certificate.says}"
        )
        notes = [*(() if self.part is None else self.part.says), *listed(self.notes, "plan.notes", 10)]
        notes = [line for note in notes for line in wrap(note, 120, subsequent_indent="    ")]
        return "\n".join([head, *listed(runs, "plan.campaign.runs", 10), str(self.assessment), *notes])

    def to_data(self) -> dict[str, Any]:
        """plan.json as nested mappings."""
        from symfive.design._write import plan_data

        return plan_data(self)


def _different(run: Run) -> int:
    """How many of a run's poses are different."""
    return len(np.unique(np.stack(list(run.commands.values()), axis=1), axis=0))


@one_thread
def plan(
    machine: Machine | Path | str, *, instrument: str = "r_test", criterion: str | Criterion | None = None, points: int = 40,
    for_: Iterable[str] = (), part: ToolPath | Path | str | None = None,
    given: Campaign | Path | str | None = None, setups: int | None = None,
    lengths: Sequence[float] = (), minutes: float | None = None,
    per_minute: bool = False, returns: int = 2, repeats: int = 1, noise_um: float = 0.3,
    setup_sigma: SetupSigma | None = None, frame: str = "workpiece", index: bool | None = None, survive: bool = False,
    robust: str = "nominal", starts: int = 2, anywhere: bool = True, prove: bool = True, seed: int = 0,
    pool: Executor | None = None,
    progress: Callable[[str], None] = lambda message: None,
) -> Plan:  # fmt: skip
    """The static plan of `points` poses that makes the uncertainty of what is sought smallest.

    `machine` a machine, the path of its file, or the name of a preset;
    `instrument` `r_test`, `touch_probe` or `ball_bar`; `criterion` D (default), A, E, G or V (`I`), or one of your own; `for_`
    names of the parameters that count (by default all of the machine's), the others and every set-up error being marginalised;
    `part` a tool path or its file (`symfive.toolpath`): G (default) and V are then the worst and the mean expected error of the
    tool along it, with as many set-ups as fit into `minutes` (default: those of the D plan, which is made too and compared), and
    the spindle is indexed where that is worth it; `given` a campaign already
    measured on this machine, to which the plan adds; `setups` at most so many places of ball or nest (default 2, ball bar
    3); `lengths` the bars that the user owns, mm (default: the machine file's); `minutes` a time budget; `per_minute`: as
    many of the poses and runs as are most informative per minute; `returns` to the first pose of each run, against drift;
    `repeats` readings of each pose; `setup_sigma` 1σ of set-up errors; `frame` of an R-test's readings, `workpiece` of a nest on
    the table, `machine` or `tool` of a head in the spindle; `index`: the first pose of every run is read with the spindle at 0°
    and 180°, which determines the tool ball's run-out; `survive` optimises for the loss of any one pose; `robust`
    `nominal`, or the `mean` or `worst` case over machines drawn from the priors; `starts` of the search; `anywhere`: whether the
    certificate also compares with all other set-ups (a few seconds); `prove`: whether its bound is proved (seconds, for some
    ball bars a quarter of a minute); `pool` any executor (`symfive.executors`), whose workers share the starts.

    Raises `InputError` where no pose can be reached, no bar fits, or a parameter is seen by no plan.
    """
    machine = with_bars(machine_given(machine), lengths)
    given = None if given is None else campaign_given(given)
    check_counts(
        machine, {"points": points, "setups": setups, "repeats": repeats, "returns": returns, "starts": starts}
    )
    if robust not in ROBUST:
        raise InputError(f'robust = "{robust}" is unknown', remedy=f"use one of {', '.join(ROBUST)}")
    if not (noise_um > 0.0 and math.isfinite(noise_um)):
        raise InputError(f"noise_um = {noise_um:g} is not positive", remedy="give the instrument's 1σ in µm")
    options = _options_of(instrument, frame)
    route = part_given(machine, part, tuple(for_))
    criterion = criterion or ("D" if route is None else "G")
    space = make_space(
        machine, instrument, noise_um=noise_um / math.sqrt(repeats), setup_sigma=setup_sigma, options=options
    )
    sought = None if route is None else part_criterion(route, space, name_of(criterion))
    ordinary = None
    if route is not None:
        setups = setups if minutes is None or setups is not None else mountings_in(minutes)
        progress("D plan for comparison")
        ordinary = plan(
            machine, instrument=instrument, points=points, given=given, setups=setups, minutes=minutes, returns=returns,
            repeats=repeats, noise_um=noise_um, setup_sigma=setup_sigma, frame=frame, index=bool(index), starts=starts,
            anywhere=False, prove=False, seed=seed, pool=pool, progress=progress,
        )  # fmt: skip
        minutes = minutes or ordinary.minutes
        setups = setups or mountings_in(minutes)
    names = tuple(p.name for p in space.shared)
    wanted = interest_of(names, tuple(for_))
    task = task_of(space, criterion if sought is None else sought, wanted, given)
    shares = affordable(machine, minutes, points, setups or (3 if instrument == "ball_bar" else 2), returns, repeats)
    points, runs = shares[-1]
    decided = index is None and route is not None
    if decided:
        index = worth_indexing(space, task, optimise(space, task, points, runs, starts=1, seed=seed)[0])
    index = bool(index)
    task = indexed(space, task) if index else task
    refuse_unseen(space, task, points, names)
    progress(f"{len(names)} parameters, {points} poses, at most {runs} set-ups")

    search = PlanSearch(
        space, task, minutes, returns=returns, repeats=repeats, noise_um=noise_um, index=index, starts=starts, seed=seed,
        pool=pool, progress=progress,
    )  # fmt: skip
    rows, values = search.best(shares)
    drawn = drawn_spaces(machine, space, REPORTED_DRAWS if robust == "nominal" else DRAWS)
    if per_minute:
        rows, values = search.most_per_minute(rows, values)
    if robust != "nominal":
        rows = search.robust(rows, drawn, robust)
    if survive:
        rows = search.surviving(rows)
    schedule, post = search.driven(rows)
    progress("computing the certificate")
    certificate = _certified(space, task, schedule.rows, runs, anywhere, prove)
    made = _finished(
        space,
        task,
        schedule,
        post,
        certificate,
        values,
        given,
        name_of(criterion),
        wanted,
        over_prior(drawn, task, schedule.rows),
    )
    if route is None or ordinary is None:
        return made
    chosen = (INDEXED,) if decided and index else ()
    return replace(made, part=compared(route, space, task, ordinary, made), notes=(*chosen, *made.notes))


def _options_of(instrument: str, frame: str) -> dict[str, str]:
    """The instrument's options in a campaign. Raises `InputError`."""
    if frame not in FRAMES:
        raise InputError(f'frame = "{frame}" is unknown', remedy=f"use one of {', '.join(FRAMES)}")
    if frame == FRAMES[0]:
        return {}
    if instrument != "r_test":
        raise InputError(f"readings of {instrument} have no frame", remedy="use instrument r_test")
    return {"frame": frame}


def _certified(space: Space, task: Task, rows: Rows, runs: int, anywhere: bool, prove: bool) -> Certificate:
    certificate = certify(space, task, rows, prove=prove)
    if not anywhere:
        return certificate
    bound = min(certificate.bound, bound_anywhere(space, task, rows, runs))
    return replace(certificate, anywhere=min(1.0, math.exp(bound - certificate.value)))


def _finished(
    space: Space, task: Task, schedule: Schedule, post: Post, certificate: Certificate, values: tuple[float, ...],
    given: Campaign | None, criterion: str, wanted: tuple[str, ...], drawn: tuple[float, float],
) -> Plan:  # fmt: skip
    rows, machine = schedule.rows, space.machine
    value = value_of(space, task, rows)
    expected = assess(schedule.campaign, given=given)
    left, _ = lost_pose(task, space.kernel.rows(rows.z, rows.k), rows.group, rows.groups)
    before = task.value_of_marginal(task.prior)
    return Plan(
        machine=machine, instrument=space.instrument, criterion=criterion, interest=wanted, campaign=schedule.campaign,
        certificate=certificate, assessment=expected, starts=values,
        minutes=schedule.seconds / 60.0, unsafe=schedule.unsafe, lost=math.exp(value - left),
        over_prior=(math.exp(value - drawn[0]), math.exp(value - drawn[1])),
        information_per_minute=(before - value) / (schedule.seconds / 60.0), drift=schedule.drift, post=post,
        notes=plan_notes(space, task, schedule, certificate, expected, given),
    )  # fmt: skip
