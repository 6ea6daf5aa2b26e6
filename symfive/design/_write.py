"""A plan as files: campaign without readings, plan.json, NC programs, set-up sheet, figures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from symfive.campaign import FIRST_LINE, Campaign, Run, write_campaign_files
from symfive.design._assess import Assessment, assessment_data
from symfive.design._digits import six_digits
from symfive.design._schedule import on_ways
from symfive.design._sheet import Sheet, setup_sheet
from symfive.errors import InputError
from symfive.instruments import has_post
from symfive.moves import cleared
from symfive.nc import DIALECTS, Post, addressed, write_programs
from symfive.outputs import output_folder, write_json, write_text
from symfive.screen import OnScreen

if TYPE_CHECKING:
    from symfive.design._discriminate import Discrimination
    from symfive.design._plan import Plan
    from symfive.design._together import JointPlan

SCHEMA = "symfive.plan/1"
DRAWN = 36
"""Rows of a recording that its picture shows."""


class Written(OnScreen):
    """A plan that can be written as files, ready to run."""

    def write(
        self, folder: Path | str, *, nc: Iterable[str] = ("iso",), post: Post | None = None, overwrite: bool = False
    ) -> None:
        """The campaign without readings, plan.json, NC programs in the dialects `nc`, set-up sheet and figures, whole or not at
        all."""
        with output_folder(Path(folder), overwrite=overwrite) as target:
            self._write_into(target, tuple(nc), post)

    def _write_into(self, folder: Path, nc: tuple[str, ...], post: Post | None) -> None:
        raise NotImplementedError


def plan_data(plan: Plan) -> dict[str, Any]:
    """plan.json: criterion, certificate and the assessment."""
    certificate = plan.certificate
    return {
        "schema": SCHEMA,
        "machine": plan.machine.name,
        "structure": plan.machine.structure.code,
        "instrument": plan.instrument,
        "criterion": {"name": plan.criterion, "for": list(plan.interest), "value": six_digits(certificate.value)},
        "certificate": {
            "says": certificate.says,
            **({} if plan.part is None else {"part": list(plan.part.says)}),
            "efficiency": six_digits(certificate.efficiency),
            "efficiency_any_setup": None if certificate.anywhere is None else six_digits(certificate.anywhere),
            "bound": six_digits(certificate.bound),
            "relaxed": six_digits(certificate.relaxed),
            "poses": certificate.points,
            "rigour": certificate.rigour,
            "starts": [six_digits(v) for v in plan.starts],
        },
        **assessment_data(plan.assessment),
        "minutes": six_digits(plan.minutes),
        "information_per_minute": six_digits(plan.information_per_minute),
        "efficiency_with_drift": six_digits(plan.drift),
        "efficiency_without_the_most_important_pose": six_digits(plan.lost),
        "efficiency_over_the_prior": {"mean": six_digits(plan.over_prior[0]), "worst": six_digits(plan.over_prior[1])},
        **({} if plan.part is None else {"part": plan.part.to_data()}),
        "retract_mm": plan.post.retract_mm,
        "spindle_drawn_back_before_rows": {run: [i + FIRST_LINE for i in rows] for run, rows in plan.unsafe.items()},
        "seated_moves_by_way_of_further_positions_before_rows": {
            run: [i + FIRST_LINE for i in sorted(rows)] for run, rows in plan.post.via.items()
        },
        "notes": list(plan.notes),
    }


def write_plan(plan: Plan, folder: Path, nc: tuple[str, ...], post: Post | None) -> None:
    """Everything into a folder that exists."""
    from symfive.design._figures import svg, uncertainty_figure, worth_figure

    plan = plan if post is None else driven(plan, post)
    counts = f"{plan.certificate.points} poses, {plan.campaign.rows} readings with return poses"
    facts = f"{counts} · about {plan.minutes:.0f} min with set-up"
    ways = [note for note in plan.notes if note.startswith("run ")]
    others = [note for note in plan.notes if note not in ways]
    worth = ". ".join([f"Certificate: {plan.certificate.says}", *(note[:1].upper() + note[1:] for note in others)])
    sheet = Sheet(
        campaign=plan.campaign, post=plan.post, facts=facts, worth=worth, assessment=plan.assessment, notes=ways,
        part=None if plan.part is None else plan.part.shown(),
    )  # fmt: skip
    _write_files(sheet, folder, nc)
    write_json(folder / "plan.json", plan_data(plan))
    write_text(folder / "figures" / "uncertainty.svg", svg(uncertainty_figure(plan)))
    write_text(folder / "figures" / "worth.svg", svg(worth_figure(plan)))


def driven(plan: Plan, post: Post) -> Plan:
    """The plan with what the user decided about its programs: the same ways unless another retract is wished, its own times."""
    ways = plan.post
    own = replace(post, via=ways.via, unsafe=ways.unsafe, ways=ways.ways, tested=ways.tested)
    if post.retract_mm != plan.post.retract_mm:
        own = cleared(plan.machine, plan.campaign.runs, plan.unsafe, own)
    if not addressed(plan.machine):
        return replace(plan, post=own)
    campaign, seconds = on_ways(plan.campaign, own)
    return replace(
        plan,
        post=own,
        unsafe={run: tuple(rows) for run, rows in own.unsafe.items()},
        campaign=campaign,
        minutes=seconds / 60.0,
    )


def write_joint(plan: JointPlan, folder: Path, nc: tuple[str, ...]) -> None:
    """One campaign, plan.json, the programs of all runs and one set-up sheet into a folder that exists."""
    ways = [note for note in plan.notes if ": run " in note]
    certificate = [] if plan.certificate is None else [f"Certificate: {plan.certificate.says}"]
    worth = ". ".join([*certificate, *(note for note in plan.notes if note not in ways)])
    facts = f"{', then '.join(plan.steps)} with set-up"
    sheet = Sheet(
        campaign=plan.campaign, post=plan.post, facts=facts, worth=worth, assessment=plan.assessment, notes=ways
    )
    _write_files(sheet, folder, nc)
    write_json(folder / "plan.json", plan.to_data())


def write_recordings(
    campaign: Campaign, expected: Assessment, data: Mapping[str, Any], folder: Path, nc: tuple[str, ...], post: Post | None,
    worth: str = "",
) -> None:  # fmt: skip
    """Recordings as a plan: campaign, plan.json of `data`, programs and set-up sheet with `worth`. Raises `InputError`
    where a program has no clear way."""
    machine = campaign.machine
    own = cleared(machine, campaign.runs, {}, post) if addressed(machine) else post
    _write_files(Sheet(campaign=campaign, post=own or Post(), assessment=expected, worth=worth), folder, nc)
    write_json(folder / "plan.json", data)


def write_test(test: Discrimination, folder: Path, nc: tuple[str, ...] = ("iso",), post: Post | None = None) -> None:
    """The plan of a further test into a folder that exists: campaign, programs (where all axes have an NC address), and the
    set-up sheet, which states the purpose of the test. A test without a clear path has no program: the sheet names what meets."""
    campaign, notes = test.test, []
    if not addressed(campaign.machine):
        nc = ()
    elif nc:
        try:
            post = cleared(campaign.machine, campaign.runs, {}, post)
        except InputError as error:
            nc, notes = (), [f"No program: {error.problem}"]
    sheet = Sheet(campaign=campaign, post=post or Post(), worth=f"Purpose: {test.says}", notes=notes)
    _write_files(sheet, folder, nc)


def _write_files(sheet: Sheet, folder: Path, nc: tuple[str, ...]) -> None:
    """The campaign, its programs and its sheet."""
    write_campaign_files(sheet.campaign, folder)
    write_programs(sheet.campaign, folder / "nc", nc, sheet.post)
    write_sheet(sheet, folder, nc)


def write_sheet(sheet: Sheet, folder: Path, nc: tuple[str, ...] = ()) -> None:
    """setup.html of any campaign and its pictures, a run each, into a folder that exists; `nc` dialects of its programs."""
    from symfive.design._figures import pose_figure, svg

    machine = sheet.campaign.machine
    with_ball = [run for run in sheet.campaign.runs if has_post(run)]
    pictures = {run.id: svg(pose_figure(machine, _thinned(run))) for run in with_ball}
    for run, picture in pictures.items():
        write_text(folder / "figures" / f"poses-{run}.svg", picture)
    programs = [f"nc/{name}/*{DIALECTS[name].suffix}" for name in nc if name in DIALECTS]
    write_text(folder / "setup.html", setup_sheet(sheet, pictures, programs))


def _thinned(run: Run) -> Run:
    """A recording with as many rows as a picture can show."""
    if not run.dynamic or run.rows <= DRAWN:
        return run
    rows = np.linspace(0, run.rows - 1, DRAWN).round().astype(int)
    return replace(run, time=run.time[rows], commands={name: q[rows] for name, q in run.commands.items()}, readings={})
