"""Files in and out: code for controllers, recordings of instruments and of others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from symfive.cli import _common as cli
from symfive.errors import InputError, among, inside
from symfive.outputs import output_file, output_folder

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from symfive.campaign import Campaign, Run
    from symfive.importers import Matched, Probed
    from symfive.machine import Machine


@cli.app.command(epilog="Example: symfive codegen results/model.json -o code/ --target linuxcnc")
@click.argument("model", help="A fitted model.json, a machine file, or the name of a preset.")
@cli.output_path
@click.option("--target", default="c", help="c, linuxcnc, setp, isg, or a sheet: siemens, fanuc, heidenhain, haas.")
@click.option("--prefix", default="sf", help="Prefix of every C name and file.")
@cli.overwrite
@cli.quiet
def codegen(model: str, output: Path, target: str, prefix: str, overwrite: bool, quiet: bool) -> None:
    """Generate code for controllers. C99 sources with exact Jacobians, LinuxCNC kinematics, compensation tables, sheets."""
    from symfive.codegen import codegen as generate

    written = generate(model, output, target=target, prefix=prefix, overwrite=overwrite)
    if not quiet:
        click.echo("\n".join(str(path) for path in written))


@cli.app.command(
    name="import-polar",
    epilog="Example: symfive import-polar three-axis ccw.csv cw.csv -o measured/ --radius 100 --feed 1000",
)
@click.argument("machine", help="The plan's folder, a machine file, or the name of a preset.")
@click.argument("files", type=cli.PATH, nargs=-1, required=True, help="Angle and deviation, one file per direction.")
@cli.output_path
@cli.positive("--radius", help="Radius of the circle: the bar's length, mm.")
@cli.positive("--feed", help="Feed along the circle, mm/min.")
@click.option("--columns", default="angle,deviation", help="The file's columns in order, - for what is not needed.")
@cli.direction
@click.option("--centre", help="The table ball in the workpiece frame, mm; 0,0,0 without it.")
@click.option("--plane", help="XY, YZ or ZX; XY without it.")
@click.option("--unit", help="Unit of the deviation: um, mm, in, … (default: from the header of the file, else um).")
@cli.positive("--noise-um", help="1σ of one reading, from the instrument's data sheet; 0.3 without it.")
@cli.fitted
@click.option(
    "--angle-error",
    type=cli.Number(0.0),
    default=0.5,
    help="Uncertainty of the angle in degrees: readings closer to a reversal are excluded.",
)
@cli.overwrite
@cli.quiet
def import_polar(
    machine: str, files: tuple[Path, ...], output: Path, radius: float | None, feed: float | None, columns: str,
    direction: tuple[str, ...], centre: str | None, plane: str | None, unit: str | None, noise_um: float | None,
    fitted: bool, angle_error: float, overwrite: bool, quiet: bool,
) -> None:  # fmt: skip
    """Import deviation over angle of a ball bar. A campaign; positions are reconstructed.

    For planned circles, radius, feed, centre and plane come from the plan's folder; a file has the name of its run, or
    there is one for each run, in their order.
    """

    from symfive.campaign import write_campaign_files
    from symfive.importers import FITTED, along_run, check_arc, cut_short, polar_doubts, polar_run, read_polar
    from symfive.procedures import campaign_of

    with output_folder(output, overwrite=overwrite, recorded=True) as folder:
        given = {
            "radius": radius, "feed": feed, "plane": plane, "noise_um": noise_um,
            "centre": None if centre is None else cli.point_of("--centre", centre), "setup_sigma_um": FITTED if fitted else None,
        }  # fmt: skip
        given = {name: value for name, value in given.items() if value is not None}
        data, circles, notes = _circles(machine, files, radius, plane)
        names = [name.strip() for name in columns.split(",")]
        planned = [circle.pop("direction", None) for circle in circles]
        arcs = [circle.pop("arc", None) for circle in circles]
        senses: list[str | None] = list(direction) or planned
        if len(senses) != len(files):
            problem = f"{len(files)} files have {len(senses)} directions"
            raise InputError(problem, remedy="give --direction ccw or cw once per file, in their order")
        runs, angles = [], []
        for path, sense, arc, circle in zip(files, senses, arcs, circles, strict=True):
            angle, deviation = read_polar(path, unit=unit, columns=names, direction=sense if direction else None)
            with inside(path=path):
                if not direction:
                    angle, deviation = along_run(angle, deviation, sense, circle["id"])
                if arc is not None:
                    check_arc(angle, arc, circle["id"])
                    notes += cut_short(angle, arc, circle["id"])
            angles.append(angle)
            circle = {"centre": (0.0, 0.0, 0.0), "noise_um": 0.3, **circle, **given}
            if "radius" not in circle or "feed" not in circle:
                raise _not_in_the_file(path, circle)
            with inside(path=path):
                runs.append(polar_run(data, angle, deviation, angle_error=angle_error, **circle))
        campaign = campaign_of(data, runs, output.name)
        write_campaign_files(campaign, folder)
    cli.noted([*notes, *polar_doubts(data, runs, angles, radius=circle["radius"], feed=circle["feed"])], quiet)
    near = sum(map(len, angles)) - campaign.rows
    left_out = f"; {near} readings within {angle_error:g}° of a reversal excluded (--angle-error)" if near else ""
    cli.written(campaign, output, quiet, left_out)


def _circles(
    machine: str, files: Sequence[Path], radius: float | None, plane: str | None
) -> tuple[Machine, list[dict[str, Any]], list[str]]:
    """The machine, what is known of each file's circle (of a plan what it planned, else the name alone), and the runs of the plan
    that have no file, in words."""
    from symfive.campaign import read_campaign
    from symfive.given import machine_given
    from symfive.importers import as_planned, check_other

    if not (Path(machine) / "campaign.toml").is_file():
        cli.refuse_namesakes(files)
        return machine_given(machine), [{"id": path.stem} for path in files], []
    plan = read_campaign(machine)
    ids = [run.id for run in plan.runs]
    if {path.stem for path in files} <= set(ids):
        chosen = [plan.run(path.stem) for path in files]
    elif len(files) == len(ids):
        chosen = list(plan.runs)
    else:
        problem = f"{len(files)} files, and the plan has the runs {', '.join(ids)}"
        remedy = "name each file as its run, or give one for every run in their order"
        raise InputError(problem, path=Path(machine), remedy=remedy)
    for run in chosen:
        check_other(plan.machine, run, radius, plane)
    return plan.machine, [as_planned(plan.machine, run) for run in chosen], _without(plan, [run.id for run in chosen])


def _without(plan: Campaign, ids: Sequence[str]) -> list[str]:
    """The runs of a plan that are not among these, in words."""
    missing = [run.id for run in plan.runs if run.id not in ids]
    return [f"no file for {', '.join(missing)} of the plan: not in the campaign"] if missing else []


def _not_in_the_file(path: Path, circle: Mapping[str, Any]) -> InputError:
    """What angle and deviation do not tell, and the options that do."""
    options = {"radius": "--radius 100 (mm)", "feed": "--feed 1000 (mm/min)"}
    missing = {name: option for name, option in options.items() if name not in circle}
    problem = f"angle and deviation are there, {' and '.join(missing)} not"
    turn = "the angles give the direction, rising is ccw; where they do not, add --direction cw"
    return InputError(problem, path=path, remedy=f"add {' and '.join(missing.values())} ({turn})")


of_runs = click.option(
    "--run", "names", multiple=True, help="The run of each file, in their order (default: the plan's order)."
)


@cli.app.command(
    name="import-rests",
    epilog="Example: symfive import-rests plan/ nest-1.txt nest-2.txt -o measured/ --columns t,dx_um,dy_um,dz_um",
)
@cli.campaign_path
@click.argument("files", type=cli.PATH, nargs=-1, required=True, help="Recordings of whole runs, one file per run.")
@cli.output_path
@of_runs
@click.option("--columns", default="t,dx_um,dy_um,dz_um", help="The file's columns in order, - for what is not needed.")
@click.option("--unit", help="Unit of the readings: um, mm, in, … (default: from the header of the file, else um).")
@cli.positive("--dwell", default=2.0, help="Rest at each pose in s, as in the program.")
@cli.overwrite
@cli.quiet
def import_rests(
    campaign: Path, files: tuple[Path, ...], output: Path, names: tuple[str, ...], columns: str, unit: str | None,
    dwell: float, overwrite: bool, quiet: bool,
) -> None:  # fmt: skip
    """Import recordings over whole R-test runs. Cut at the rests, which are matched with the poses of the plan."""
    from symfive.importers import cut_at_rests, read_recording

    def measured(machine: Machine, run: Run, path: Path) -> Matched:
        time, readings = read_recording(path, [word.strip() for word in columns.split(",")], unit=unit)
        return cut_at_rests(machine, run, time, readings, dwell_s=dwell)

    _import_runs(campaign, files, names, measured, output, overwrite, quiet)


@cli.app.command(name="import-touches", epilog="Example: symfive import-touches plan/ sphere-1.txt -o measured/")
@cli.campaign_path
@click.argument("files", type=cli.PATH, nargs=-1, required=True, help="Logs of the probing programs, one file per run.")
@cli.output_path
@of_runs
@cli.overwrite
@cli.quiet
def import_touches(
    campaign: Path, files: tuple[Path, ...], output: Path, names: tuple[str, ...], overwrite: bool, quiet: bool
) -> None:
    """Import logs of a touch probe's programs. One sphere is fitted to the touches of each run."""
    from symfive.importers import probed_run, read_touches

    _import_runs(
        campaign, files, names, lambda _, run, path: probed_run(run, read_touches(path)), output, overwrite, quiet
    )


def _import_runs(
    campaign: Path, files: Sequence[Path], names: Sequence[str], measured: Callable[[Machine, Run, Path], Matched | Probed],
    output: Path, overwrite: bool, quiet: bool,
) -> None:  # fmt: skip
    """The campaign of the runs of a plan that `measured` makes of the machine, a planned run and its file."""
    from symfive.campaign import write_campaign_files

    with output_folder(output, overwrite=overwrite, recorded=True) as folder:
        plan = cli.read(campaign, quiet)
        found, chosen = [], _of_the_plan(plan, campaign, files, names)
        for path, run in chosen:
            with inside(path=path):
                found.append(measured(plan.machine, run, path))
        whole = replace(plan, runs=tuple(run for each in found for run in each.runs))
        write_campaign_files(whole, folder)
    cli.noted([*found, *_without(plan, [run.id for _, run in chosen])], quiet)
    cli.written(whole, output, quiet)


def _of_the_plan(plan: Campaign, path: Path, files: Sequence[Path], names: Sequence[str]) -> list[tuple[Path, Run]]:
    """Each file with its run: the one named, else the static ones in their order. Raises `InputError`."""
    from symfive.screen import plural

    runs = {run.id: run for run in plan.runs}
    wanted = names or tuple(run.id for run in plan.runs if not run.dynamic)[: len(files)]
    if len(wanted) != len(files) or len(set(wanted)) < len(wanted):
        problem = f"{plural(len(files), 'file')} for {plural(len(wanted), 'run')} ({', '.join(wanted) or 'none'})"
        raise InputError(problem, remedy="give one file a run, or --run once per file, in their order")
    for name in wanted:
        among(name, runs, f"the plan has no run {name}", path=path)
    return [(file, runs[name]) for file, name in zip(files, wanted, strict=True)]


@cli.app.command(name="import-mtconnect", epilog="Example: symfive import-mtconnect probe.xml -o machine.toml")
@click.argument("probe", type=cli.PATH, help="The answer of the agent to …/probe, as a file.")
@click.option("-o", "--output", type=cli.PATH, required=True, help="The machine file.")
@cli.text("--device", help="Name, uuid or id of the device, where there are several.")
@cli.text("--code", help="The structural code, as \"w C' B' X' Y' b Z t\", where the document has none.")
@cli.quiet
def import_mtconnect(probe: Path, output: Path, device: str, code: str, quiet: bool) -> None:
    """Start a machine file from an MTConnect probe. Comments mark missing values."""
    from symfive.importers import read_mtconnect
    from symfive.importers.mtconnect import TO_DO
    from symfive.machine import write_machine

    with output_file(output) as path:
        machine = read_mtconnect(probe, device=device, code=code)
        write_machine(machine, path)
    cli.noted((comment for comment in machine.comments if comment.startswith(TO_DO)), quiet)
    if not quiet:
        click.echo(f"{machine.structure.code} in {output}", err=True)


@cli.app.command(epilog="Example: symfive convert emps -o emps/ && symfive identify emps/ -o results/")
@click.argument("name", help="A real recording: emps, ess-xyz, irb120-tracker, …")
@cli.output_path
@click.option("--data", type=cli.PATH, help="Folder of the recordings (default: $SYMFIVE_DATA).")
@cli.cut
@cli.overwrite
@cli.quiet
def convert(
    name: str, output: Path, data: Path | None, how: str | None, step_deg: float | None, step: int, overwrite: bool,
    quiet: bool,
) -> None:  # fmt: skip
    """Convert a public recording. docs/recordings.md lists them with their licences."""
    from symfive.campaign import write_campaign_files
    from symfive.convert import convert as convert_recording
    from symfive.importers import prepared

    with output_folder(output, overwrite=overwrite, recorded=True) as folder:
        campaign = prepared(convert_recording(name, data), step=step, how=how, step_deg=step_deg)
        write_campaign_files(campaign, folder)
    cli.written(campaign, output, quiet)
