"""Campaigns from exported files of instruments and controls."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from symfive.cli import _common as cli
from symfive.errors import InputError, among, inside
from symfive.outputs import output_folder

if TYPE_CHECKING:
    from symfive.campaign import Run
    from symfive.importers import Meaning, Table
    from symfive.machine import Machine


@cli.app.command(
    name="import",
    epilog="Example: symfive import three-axis x-laser.csv -o measured/ --map target=1:mm --map up=2-6:um --map down=7-11:um",
)
@click.argument("machine", help="A machine file, or the name of a preset.")
@click.argument("files", type=cli.PATH, nargs=-1, required=True, help="Exported tables of an instrument, one per run.")
@cli.output_path
@click.option(
    "--map", "entries", multiple=True,
    help="NAME=COLUMN:UNIT: a column by number, range (2-6) or name is time, angle, deviation, radius, target, measured, up, "
    "down, an axis, X_found, or a reading (dL, dx, X_dev, X_act, …).",
)  # fmt: skip
@cli.flag("--yes", help="Accept the columns guessed from the header without asking.")
@click.option("--axis", default="X", help="Axis of a positioning test.")
@click.option("--centre", default="0,0,0", help="The table ball or sphere in the workpiece frame, mm.")
@click.option(
    "--tool-ball", help="The tool ball or the probe's tip in the tool frame, mm (default: the machine file's)."
)
@cli.positive("--radius", help="Radius of the circle, length of the bar, mm.")
@cli.positive("--feed", help="Feed along the circle, mm/min.")
@click.option("--plane", default="XY", help="XY, YZ or ZX.")
@cli.direction
@click.option("--hold", multiple=True, help="AXIS=POSITION of an axis without a column; may be repeated.")
@cli.positive(
    "--noise-um", default=0.3, help="1σ of one reading in µm or µrad (of a force N or Nm), from the data sheet."
)
@cli.flag("--static", help="The axes are at rest at each row of a recording with a time.")
@cli.fitted
@click.option("--angle-error", type=cli.Number(0.0), default=0.5, help="Uncertainty of the angle in degrees.")
@cli.cut
@cli.overwrite
@cli.quiet
def import_table(
    machine: str, files: tuple[Path, ...], output: Path, entries: tuple[str, ...], yes: bool, axis: str, centre: str,
    tool_ball: str | None, radius: float | None, feed: float | None, plane: str, direction: tuple[str, ...],
    hold: tuple[str, ...], noise_um: float, static: bool, fitted: bool, angle_error: float, how: str | None,
    step_deg: float | None, step: int, overwrite: bool, quiet: bool,
) -> None:  # fmt: skip
    """Import tables of an instrument. Columns, units and separators are guessed, shown and confirmed."""
    from dataclasses import replace

    from symfive.campaign import write_campaign_files
    from symfive.given import machine_given
    from symfive.importers import Setting, meanings, prepared, read_table, runs_of, shown_meanings, taken
    from symfive.importers.polar import DIRECTIONS
    from symfive.procedures import PLANES, campaign_of

    among(plane, PLANES, f'plane "{plane}" is unknown')
    if direction and (len(direction) != len(files) or not set(direction) <= set(DIRECTIONS)):
        problem = f"{len(files)} files have the directions {', '.join(direction)}"
        raise InputError(problem, remedy="give --direction ccw or cw once per file, in their order")
    cli.refuse_namesakes(files)
    with output_folder(output, overwrite=overwrite, recorded=True) as folder:
        data = machine_given(machine)
        setting = Setting(
            centre=cli.point_of("--centre", centre),
            tool_ball=None if tool_ball is None else cli.point_of("--tool-ball", tool_ball), radius=radius, feed=feed,
            plane=plane, axis=axis, hold=cli.numbers_of("--hold", hold, "Z=150"), noise_um=noise_um, static=static,
            fitted=fitted, angle_error=angle_error,
        )  # fmt: skip
        runs: list[Run] = []
        for number, path in enumerate(files):
            table = read_table(path)
            found = meanings(table, data, entries, axis)
            _confirm(table, found, shown_meanings(table, found), yes=yes, quiet=quiet)
            own = replace(setting, direction=direction[number]) if direction else setting
            with inside(path=path):
                runs += runs_of(data, taken(table, found, data, axis), own, path.stem)
        campaign = prepared(campaign_of(data, runs, output.name), step=step, how=how, step_deg=step_deg)
        write_campaign_files(campaign, folder)
    cli.noted(_doubts(data, runs, radius, feed), quiet)
    cli.written(campaign, output, quiet)


def _doubts(machine: Machine, runs: Sequence[Run], radius: float | None, feed: float | None) -> tuple[str, ...]:
    """What is odd about reconstructed circles."""
    import numpy as np

    from symfive.circles import CircleFinder
    from symfive.importers import polar_doubts
    from symfive.motion import is_moving

    finder = CircleFinder(machine)
    circles = [(run, circle) for run in runs if is_moving(run) and (circle := finder.find(run))]
    if not circles or radius is None or feed is None:
        return ()
    angles = [np.degrees(circle.angle) for _, circle in circles]
    return polar_doubts(machine, [run for run, _ in circles], angles, radius=radius, feed=feed)


def _confirm(table: Table, found: Sequence[Meaning], shown: str, *, yes: bool, quiet: bool) -> None:
    """Show what the columns are taken for; ask where some of it is guessed. Raises `InputError` where nobody can answer."""
    if not quiet:
        click.echo(shown, err=True)
    if yes or not any(m.guessed for m in found):
        return
    said = " ".join(f"--map {m.name}={m.column + 1}:{m.unit}" for m in found)
    if not sys.stdin.isatty():
        problem = "the meaning of the columns is guessed from the header and cannot be confirmed here"
        raise InputError(problem, path=table.path, remedy=f"add --yes, or {said}")
    click.confirm("Is that right?", default=True, abort=True, err=True)
