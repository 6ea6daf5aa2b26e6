"""The command line: every verb of the Python API, with clear errors and exit codes (conventions, section 6)."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from symfive import __version__
from symfive.campaign import Campaign, read_campaign, write_campaign_files
from symfive.design import assess as assess_campaign
from symfive.effects import Effect, make_effect
from symfive.errors import InputError
from symfive.files import output_folder, write_json
from symfive.identify import identify as identify_campaign
from symfive.identify import predict as predict_campaign
from symfive.machine import Machine, preset, presets, read_machine
from symfive.model import effects_from_data, read_json, read_model
from symfive.results import write_diagnosis, write_identification
from symfive.simulate import simulate as simulate_plan

__all__ = ["app", "main"]

app = typer.Typer(
    name="symfive",
    help="One symbolic model of five-axis machine tools: plan, measure, identify, diagnose, predict, generate code.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

CampaignPath = Annotated[Path, typer.Argument(help="A campaign's folder, or its campaign.toml.", show_default=False)]
OutputPath = Annotated[Path, typer.Option("-o", "--output", help="The folder for the results.", show_default=False)]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print nothing but errors and the result.")]


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"symfive {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def _machine(name: str) -> Machine:
    """A machine file, or a preset by its name."""
    return read_machine(name) if Path(name).suffix == ".toml" or name not in presets() else preset(name)


class _Progress:
    """Plain lines on standard error, from two seconds on."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._begin = time.monotonic()

    def __call__(self, message: str) -> None:
        elapsed = time.monotonic() - self._begin
        if not self._quiet and elapsed > 2.0:
            typer.echo(f"{elapsed:5.1f} s  {message}", err=True)


def _read(path: Path, quiet: bool, *, measured: bool = False) -> Campaign:
    campaign = read_campaign(path)
    if not quiet:
        for note in campaign.notes:
            typer.echo(f"note: {note}", err=True)
    if measured and not campaign.measured:
        empty = next(run.id for run in campaign.runs if not run.measured)
        raise InputError(f"run {empty} has no readings", path=path, remedy="measure or simulate the plan first")
    return campaign


def _joined(path: Path, also: list[Path] | None, quiet: bool) -> Campaign:
    """A measured campaign, joined with further ones of the same machine."""
    data = _read(path, quiet, measured=True)
    for number, more in enumerate(also or [], start=2):
        data = data.joined(_read(more, quiet, measured=True), prefix=f"c{number}-")
    return data


def _tell(data: dict[str, Any], text: str, as_json: bool) -> None:
    typer.echo(json.dumps(data, indent=1) if as_json else text)


@app.command(epilog="Example: symfive plan table-bc -o plan/ --instrument r_test --points 40 --nc linuxcnc")
def plan(
    machine: Annotated[str, typer.Argument(help="A machine file, or the name of a preset.", show_default=False)],
    output: OutputPath,
    instrument: Annotated[str, typer.Option(help="r_test or ball_bar.")] = "r_test",
    criterion: Annotated[str, typer.Option(help="D, A, E, G or V.")] = "D",
    points: Annotated[int, typer.Option(help="Number of poses.")] = 40,
    wanted: Annotated[
        str, typer.Option("--for", help="What is to be known, as EX0C,EY0C,EXC (default: everything).")
    ] = "",
    nc: Annotated[list[str] | None, typer.Option(help="Dialect of the NC programs; may be repeated.")] = None,
    given: Annotated[Path | None, typer.Option(help="A campaign already measured, to which the plan adds.")] = None,
    minutes: Annotated[float | None, typer.Option(help="Time budget in minutes, set-up included.")] = None,
    per_minute: Annotated[bool, typer.Option("--per-minute", help="The poses that tell most per minute.")] = False,
    setups: Annotated[int | None, typer.Option(help="At most so many places of nest or balls.")] = None,
    bars: Annotated[
        list[float] | None, typer.Option("--bar", help="Length in mm of a bar you own; may be repeated.")
    ] = None,
    repeats: Annotated[int, typer.Option(help="Readings of each pose.")] = 1,
    returns: Annotated[int, typer.Option(help="Visits back to the first pose of a run, against drift.")] = 2,
    noise_um: Annotated[float, typer.Option(help="1σ of one reading, from the instrument's data sheet.")] = 0.3,
    survive: Annotated[bool, typer.Option("--survive", help="Stay good if any one pose is lost.")] = False,
    robust: Annotated[
        str, typer.Option(help="nominal, or mean or worst over machines drawn from the priors.")
    ] = "nominal",
    circles: Annotated[
        str | None, typer.Option(help="Instead of poses, circles: synchronous or planar (needs --effect).")
    ] = None,
    effects: Annotated[
        list[str] | None, typer.Option("--effect", help="What circles are to find, as backlash:C; may be repeated.")
    ] = None,
    count: Annotated[int, typer.Option(help="Number of circles.")] = 2,
    tool_centre_on: Annotated[
        str, typer.Option(help="Your control's line that switches tool-centre control on, as TRAORI.")
    ] = "",
    tool_centre_off: Annotated[str, typer.Option(help="The line that switches it off, as TRAFOOF.")] = "",
    reversed_axes: Annotated[
        str, typer.Option("--reversed", help="Rotary axes that turn against ISO 841, as B,C.")
    ] = "",
    starts: Annotated[int, typer.Option(help="Starts of the search.")] = 6,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the search.")] = 0,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """The optimal measurement plan: a campaign without readings, certificate, NC programs, set-up sheet."""
    from symfive.design import plan as make_plan
    from symfive.design import plan_circles
    from symfive.nc import Post, dialect_of

    dialects = tuple(nc or ("iso",))
    for name in dialects:
        dialect_of(name)
    data = _machine(machine)
    post = Post(
        tool_centre_on=tool_centre_on, tool_centre_off=tool_centre_off, reversed_axes=_rotary(data, reversed_axes)
    )
    names = tuple(name.strip() for name in wanted.split(",") if name.strip())
    if circles is not None:
        result: Any = plan_circles(
            data, _effects(effects), family=circles, count=count, for_=names, criterion=criterion, robust=robust,
            per_minute=per_minute, noise_um=noise_um, radii=tuple(bars or _bars_of(data)),
        )  # fmt: skip
    else:
        result = make_plan(
            data, instrument=instrument, criterion=criterion, points=points, minutes=minutes, per_minute=per_minute,
            setups=setups, lengths=tuple(bars or ()), repeats=repeats, returns=returns, noise_um=noise_um,
            survive=survive, robust=robust, starts=starts, seed=seed, for_=names,
            given=None if given is None else _read(given, quiet), progress=_Progress(quiet),
        )  # fmt: skip
    result.write(output, nc=dialects, post=post)
    _tell(result.to_data(), str(result), as_json)


def _rotary(machine: Machine, names: str) -> tuple[str, ...]:
    found = tuple(name.strip() for name in names.split(",") if name.strip())
    for name in found:
        if name not in machine.axes or not machine.axes[name].rotary:
            rotary = ", ".join(n for n, axis in machine.axes.items() if axis.rotary) or "none"
            raise InputError(f"the machine has no rotary axis {name} to reverse", remedy=f"use one of {rotary}")
    return found


def _bars_of(machine: Machine) -> tuple[float, ...]:
    return machine.workspace.bar_lengths or (50.0,)


def _effects(words: list[str] | None) -> list[Effect]:
    if not words:
        raise InputError("circles are chosen for effects and none is named", remedy="add --effect backlash:C")
    return [make_effect(name, axis or None) for name, _, axis in (word.partition(":") for word in words)]


@app.command(epilog="Example: symfive assess designs/plans/r-test-grid")
def assess(
    campaign: CampaignPath,
    given: Annotated[Path | None, typer.Option(help="A campaign that was measured before on this machine.")] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """What a plan or campaign can tell: expected 1σ, rank, combinations that cannot be told apart."""
    earlier = None if given is None else _read(given, quiet)
    result = assess_campaign(_read(campaign, quiet), given=earlier)
    _tell(result.to_data(), str(result), as_json)


def _truth(path: Path | None) -> tuple[dict[str, float], tuple[Effect, ...]]:
    """Values and effects of a truth file: `truth.json`, `model.json` or `identification.json`."""
    if path is None:
        return {}, ()
    data = read_json(path)
    parameters = data.get("parameters") if isinstance(data, dict) else None
    if not isinstance(parameters, dict):
        raise InputError("the truth has no parameters", path=path, remedy='write { "parameters": { "EX0C": 12.0 } }')
    values = {}
    for name, entry in parameters.items():
        value = entry.get("value") if isinstance(entry, dict) else entry
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not np.isfinite(value):
            raise InputError(f"the value of {name} is not a finite number", path=path, remedy="write a number")
        values[str(name)] = float(value)
    return values, effects_from_data(data.get("effects", []), path)


@app.command(epilog="Example: symfive simulate plan/ -o measured/ --seed 7")
def simulate(
    campaign: CampaignPath,
    output: OutputPath,
    truth: Annotated[Path | None, typer.Option(help="True parameter values (JSON); the others are drawn.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of machine and noise.")] = 0,
    quiet: Quiet = False,
) -> None:
    """Measure a plan in simulation: the campaign with readings and truth.json."""
    values, effects = _truth(truth)
    result = simulate_plan(_read(campaign, quiet), truth=values, effects=effects, seed=seed)
    with output_folder(output) as folder:
        write_campaign_files(result.campaign, folder)
        write_json(folder / "truth.json", result.to_data())
    if not quiet:
        typer.echo(f"{result.campaign.rows} rows of {len(result.campaign.runs)} runs in {output}", err=True)


@app.command(epilog="Example: symfive identify measured/ -o results/")
def identify(
    campaign: CampaignPath,
    output: OutputPath,
    also: Annotated[list[Path] | None, typer.Option("--with", help="A further campaign of the same machine.")] = None,
    noise: Annotated[str, typer.Option(help="estimate, or declared (believe the data sheet).")] = "estimate",
    loss: Annotated[str, typer.Option(help="square, or huber (by IPOPT).")] = "square",
    figures: Annotated[bool, typer.Option(help="Draw the figures.")] = True,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Identify the machine's errors: identification.json, model.json, identification.html and figures."""
    progress = _Progress(quiet)
    data = _joined(campaign, also, quiet)
    result = identify_campaign(data, noise=noise, loss=loss, progress=progress)
    with output_folder(output) as folder:
        write_identification(result, folder, figures=figures, progress=progress)
    if not quiet:
        for note in result.notes:
            typer.echo(f"note: {note}", err=True)
    _tell(result.to_data(), str(result), as_json)


@app.command(epilog="Example: symfive predict results/model.json heldout/ -o predicted/")
def predict(
    model: Annotated[Path, typer.Argument(help="A fitted model.json (or its folder).", show_default=False)],
    campaign: CampaignPath,
    output: OutputPath,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Predict the readings of a plan or campaign; a run's own set-up is fitted where it has readings."""
    result = predict_campaign(read_model(model), _read(campaign, quiet))
    with output_folder(output) as folder:
        write_campaign_files(result.campaign, folder)
        setup = {run: dict(values) for run, values in result.setup.items()}
        summary = {"schema": "symfive.prediction/1", "rms": dict(result.rms), "setup": setup}
        write_json(folder / "prediction.json", summary)
    lines = [
        f"{run}: rms of measured minus predicted {rms:.4g} (its readings' unit)" for run, rms in result.rms.items()
    ]
    _tell(summary, "\n".join(lines) or "no run has readings: nothing to compare with", as_json)


@app.command(epilog="Example: symfive diagnose measured/ -o diagnosis/")
def diagnose(
    campaign: CampaignPath,
    output: OutputPath,
    also: Annotated[list[Path] | None, typer.Option("--with", help="A further campaign of the same machine.")] = None,
    false_alarms: Annotated[
        float, typer.Option(min=1e-6, max=0.5, help="False-alarm rate over the whole catalogue.")
    ] = 0.01,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Where the model is wrong: locate the mismatch, name the physics left out, model it and show the fit improve."""
    from symfive.diagnose import diagnose as diagnose_campaign

    progress = _Progress(quiet)
    data = _joined(campaign, also, quiet)
    result = diagnose_campaign(data, false_alarms=false_alarms, progress=progress)
    with output_folder(output) as folder:
        write_diagnosis(result, folder, progress=progress)
    _tell(result.to_data(), str(result), as_json)


@app.command(epilog="Example: symfive fleet machines/ -o results/ --workers 4")
def fleet(
    campaigns: Annotated[
        list[Path], typer.Argument(help="Campaigns' folders, or folders that hold some.", show_default=False)
    ],
    output: OutputPath,
    diagnose: Annotated[bool, typer.Option("--diagnose", help="Diagnose instead of identify.")] = False,
    workers: Annotated[int, typer.Option(help="Processes of this computer; 0: none but this one.")] = 1,
    scheduler: Annotated[str | None, typer.Option(help="A Dask scheduler instead, as tcp://host:8786.")] = None,
    figures: Annotated[bool, typer.Option(help="Draw the figures (a diagnosis always does).")] = True,
    redo: Annotated[bool, typer.Option("--redo", help="Begin anew what is complete already.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Identify or diagnose many campaigns: a folder of results each, and one table of all (CSV and text)."""
    from symfive.executors import executor
    from symfive.fleet import fleet as fleet_of

    with executor(workers, scheduler) as pool:
        table = fleet_of(
            campaigns, output, diagnose=diagnose, figures=figures, redo=redo, pool=pool, progress=_Progress(quiet)
        )
    _tell(table.to_data(), str(table), as_json)
    if any(row.failed for row in table.rows):
        raise typer.Exit(2)


@app.command(epilog="Example: symfive codegen results/model.json -o code/ --target linuxcnc")
def codegen(
    model: Annotated[
        str, typer.Argument(help="A fitted model.json, a machine file, or the name of a preset.", show_default=False)
    ],
    output: OutputPath,
    target: Annotated[
        str, typer.Option(help="c, linuxcnc, setp, isg, or a sheet: siemens, fanuc, heidenhain, haas.")
    ] = "c",
    prefix: Annotated[str, typer.Option(help="What every C name and file begins with.")] = "sf",
    quiet: Quiet = False,
) -> None:
    """Code for controllers: C99 sources with exact Jacobians, LinuxCNC kinematics, compensation tables, sheets."""
    from symfive.codegen import codegen as generate

    written = generate(model, output, target=target, prefix=prefix)
    if not quiet:
        typer.echo("\n".join(str(path) for path in written))


@app.command(
    name="import-polar",
    epilog="Example: symfive import-polar three-axis ccw.csv cw.csv -o measured/ --radius 100 --feed 1000",
)
def import_polar(
    machine: Annotated[str, typer.Argument(help="A machine file, or the name of a preset.", show_default=False)],
    files: Annotated[list[Path], typer.Argument(help="Angle and deviation, one file per sense.", show_default=False)],
    output: OutputPath,
    radius: Annotated[float, typer.Option(help="Radius of the circle: the bar's length, mm.", show_default=False)],
    feed: Annotated[float, typer.Option(help="Feed along the circle, mm/min.", show_default=False)],
    centre: Annotated[str, typer.Option(help="The table ball in the workpiece frame, mm.")] = "0,0,0",
    plane: Annotated[str, typer.Option(help="XY, YZ or ZX.")] = "XY",
    unit: Annotated[str, typer.Option(help="Unit of the deviation: um or mm.")] = "um",
    noise_um: Annotated[float, typer.Option(help="1σ of one reading, from the instrument's data sheet.")] = 0.3,
    quiet: Quiet = False,
) -> None:
    """A campaign from what a ball bar's software exports: deviation over angle, the positions reconstructed."""
    from symfive.importers import polar_run, read_polar
    from symfive.procedures import campaign_of

    data = _machine(machine)
    try:
        place = [float(word) for word in centre.split(",")]
        if len(place) != 3:
            raise ValueError
    except ValueError:
        raise InputError(f'--centre "{centre}" is no place', remedy="write --centre 0,0,50") from None
    runs = []
    for path in files:
        angle, deviation = read_polar(path, unit=unit)
        if unit == "um" and float(np.abs(deviation).max()) < noise_um:
            typer.echo(
                f"note: {path.name}: no deviation reaches {noise_um:g} µm; if they are mm, give --unit mm", err=True
            )
        try:
            runs.append(
                polar_run(
                    data,
                    angle,
                    deviation,
                    centre=place,
                    radius=radius,
                    feed=feed,
                    id=path.stem,
                    plane=plane,
                    noise_um=noise_um,
                )
            )
        except InputError as error:
            raise error.at(path) from None
    campaign = campaign_of(data, runs, output.name)
    with output_folder(output) as folder:
        write_campaign_files(campaign, folder)
    if not quiet:
        typer.echo(f"{campaign.rows} rows of {len(campaign.runs)} runs in {output}", err=True)


@app.command(name="import-mtconnect", epilog="Example: symfive import-mtconnect probe.xml -o machine.toml")
def import_mtconnect(
    probe: Annotated[Path, typer.Argument(help="What the agent answers to …/probe, as a file.", show_default=False)],
    output: Annotated[Path, typer.Option("-o", "--output", help="The machine file.", show_default=False)],
    device: Annotated[str, typer.Option(help="Name, uuid or id of the device, where there are several.")] = "",
    code: Annotated[
        str, typer.Option(help="The structural code, as \"w C' B' X' Y' b Z t\", where the document tells none.")
    ] = "",
    quiet: Quiet = False,
) -> None:
    """A machine file's skeleton from an MTConnect probe; what the document does not tell is asked for in comments."""
    from symfive.importers import read_mtconnect
    from symfive.importers.mtconnect import TO_DO
    from symfive.machine import write_machine

    machine = read_mtconnect(probe, device=device, code=code)
    write_machine(machine, output)
    if not quiet:
        for comment in machine.comments:
            if comment.startswith(TO_DO):
                typer.echo(f"note: {comment}", err=True)
        typer.echo(f"{machine.structure.code} in {output}", err=True)


@app.command(epilog="Example: symfive convert emps -o emps/ && symfive identify emps/ -o results/")
def convert(
    name: Annotated[str, typer.Argument(help="A real recording: emps, ess-xyz, irb120-tracker, …", show_default=False)],
    output: OutputPath,
    data: Annotated[Path | None, typer.Option(help="Where the recordings lie (default: $SYMFIVE_DATA).")] = None,
    quiet: Quiet = False,
) -> None:
    """Turn a public real recording into a campaign (docs/recordings.md says which, and under which licence)."""
    from symfive.convert import convert as convert_recording

    campaign = convert_recording(name, data)
    with output_folder(output) as folder:
        write_campaign_files(campaign, folder)
    if not quiet:
        typer.echo(f"{campaign.rows} rows of {len(campaign.runs)} runs in {output}", err=True)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code (0 done, 2 bad input, 130 interrupted)."""
    code = _guarded(lambda: app(arguments, standalone_mode=True))
    if arguments is None:
        sys.exit(code)
    return code


def _guarded(run: Callable[[], Any]) -> int:
    try:
        run()
    except SystemExit as end:
        return int(end.code or 0) if not isinstance(end.code, str) else 2
    except InputError as error:
        typer.echo(f"symfive: {error}", err=True)
        return 2
    except np.linalg.LinAlgError as error:
        typer.echo(f"symfive: the equations cannot be solved ({error}); check priors and noise in the files.", err=True)
        return 2
    except MemoryError:
        typer.echo("symfive: the recording does not fit into memory; split the campaign.", err=True)
        return 2
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        typer.echo(f"symfive: {place}{error.strerror or error}; check the disk and your rights.", err=True)
        return 2
    except KeyboardInterrupt:
        typer.echo("symfive: interrupted; nothing was written.", err=True)
        return 130
    return 0
