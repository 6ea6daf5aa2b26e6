"""A plan as files: campaign without readings, plan.json, NC programs, set-up sheet, figures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from symfive.campaign import Campaign, Run, write_campaign_files
from symfive.design._assess import Assessment
from symfive.design._discriminate import Discrimination
from symfive.design._sheet import Sheet, setup_sheet
from symfive.errors import InputError
from symfive.instruments import has_post
from symfive.moves import cleared
from symfive.nc import DIALECTS, Post, addressed, write_programs
from symfive.outputs import output_folder, write_json, write_text
from symfive.screen import OnScreen

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


def write_plan(sheet: Sheet, data: Mapping[str, Any], folder: Path, nc: tuple[str, ...]) -> None:
    """Campaign, programs, set-up sheet and plan.json of `data` into a folder that exists."""
    _write_files(sheet, folder, nc)
    write_json(folder / "plan.json", data)


def write_recordings(
    campaign: Campaign, expected: Assessment, data: Mapping[str, Any], folder: Path, nc: tuple[str, ...], post: Post | None,
    worth: str = "",
) -> None:  # fmt: skip
    """Recordings as a plan: campaign, plan.json of `data`, programs and set-up sheet with `worth`. Raises `InputError`
    where a program has no clear way."""
    machine = campaign.machine
    own = cleared(machine, campaign.runs, {}, post) if addressed(machine) else post
    write_plan(Sheet(campaign=campaign, post=own or Post(), assessment=expected, worth=worth), data, folder, nc)


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
