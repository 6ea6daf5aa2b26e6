"""Before the measurement: check the files, plan it, see what it can tell, measure it in simulation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from symfive.cli._common import (
    MOST,
    MOST_SEED,
    POSITIVE,
    CampaignPath,
    Dialects,
    Json,
    OutputPath,
    Overwrite,
    Progress,
    Quiet,
    app,
    dialects_of,
    number,
    read,
    tell,
)

if TYPE_CHECKING:
    from symfive.effects import Effect
    from symfive.machine import Machine

__all__ = ["assess", "check", "plan", "simulate", "truth_of"]


@app.command(epilog="Example: symfive check machine.toml")
def check(
    path: Annotated[Path, typer.Argument(help="A machine file, or a campaign's folder.", show_default=False)],
    as_json: Json = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Print the problems only.")] = False,
) -> None:
    """What the files declare and every problem found in them; exit code 1 if there is one."""
    from symfive.check import check as check_files

    result = check_files(path)
    if as_json or not quiet:
        tell(result.to_data(), str(result), as_json)
    elif not result.right:
        typer.echo("\n".join(map(str, result.problems)))
    if not result.right:
        raise typer.Exit(1)


@app.command(epilog="Example: symfive plan table-bc -o plan/ --instrument r_test --points 40 --nc linuxcnc")
def plan(
    machine: Annotated[str, typer.Argument(help="A machine file, or the name of a preset.", show_default=False)],
    output: OutputPath,
    instrument: Annotated[str, typer.Option(help="r_test or ball_bar.")] = "r_test",
    criterion: Annotated[str, typer.Option(help="D, A, E, G or V.")] = "D",
    points: Annotated[int, typer.Option(max=MOST, help="Number of poses.")] = 40,
    wanted: Annotated[
        str, typer.Option("--for", help="What is to be known, as EX0C,EY0C,EXC (default: everything).")
    ] = "",
    nc: Dialects = None,
    given: Annotated[Path | None, typer.Option(help="A campaign already measured, to which the plan adds.")] = None,
    minutes: Annotated[
        float | None,
        typer.Option(parser=number(POSITIVE), metavar="N", help="Time budget in minutes, set-up included."),
    ] = None,
    per_minute: Annotated[bool, typer.Option("--per-minute", help="The poses that tell most per minute.")] = False,
    setups: Annotated[int | None, typer.Option(max=MOST, help="At most so many places of nest or balls.")] = None,
    bars: Annotated[
        list[float] | None,
        typer.Option(
            "--bar", parser=number(POSITIVE), metavar="N", help="Length in mm of a bar you own; may be repeated."
        ),
    ] = None,
    repeats: Annotated[int, typer.Option(max=MOST, help="Readings of each pose.")] = 1,
    returns: Annotated[int, typer.Option(max=MOST, help="Visits back to the first pose of a run, against drift.")] = 2,
    noise_um: Annotated[
        float,
        typer.Option(parser=number(POSITIVE), metavar="N", help="1σ of one reading, from the instrument's data sheet."),
    ] = 0.3,
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
    count: Annotated[int, typer.Option(max=MOST, help="Number of circles.")] = 2,
    tool_centre_on: Annotated[
        str, typer.Option(help="Your control's line that switches tool-centre control on, as TRAORI.")
    ] = "",
    tool_centre_off: Annotated[str, typer.Option(help="The line that switches it off, as TRAFOOF.")] = "",
    reversed_axes: Annotated[
        str, typer.Option("--reversed", help="Rotary axes that turn against ISO 841, as B,C.")
    ] = "",
    machine_top: Annotated[
        float,
        typer.Option(
            parser=number(), metavar="N", help="Where the tool's axis is at its top, mm in machine coordinates."
        ),
    ] = 0.0,
    starts: Annotated[int, typer.Option(max=MOST, help="Starts of the search.")] = 6,
    seed: Annotated[int, typer.Option(min=0, max=MOST_SEED, help="Seed of the search.")] = 0,
    workers: Annotated[
        int, typer.Option(help="Processes of this computer that share the starts; 0: none but this one.")
    ] = 0,
    scheduler: Annotated[str | None, typer.Option(help="A Dask scheduler instead, as tcp://host:8786.")] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """The optimal measurement plan: a campaign without readings, certificate, NC programs, set-up sheet."""
    from symfive.design import plan as make_plan
    from symfive.design import plan_circles
    from symfive.executors import executor
    from symfive.given import machine_given
    from symfive.nc import Post
    from symfive.outputs import output_folder

    dialects = dialects_of(nc)
    with output_folder(output, overwrite=overwrite) as folder:
        data = machine_given(machine)
        post = Post(
            tool_centre_on=tool_centre_on,
            tool_centre_off=tool_centre_off,
            reversed_axes=_rotary(data, reversed_axes),
            machine_top=machine_top,
        )
        names = tuple(name.strip() for name in wanted.split(",") if name.strip())
        if circles is not None:
            result: Any = plan_circles(
                data, _effects(effects), family=circles, count=count, for_=names, criterion=criterion, robust=robust,
                per_minute=per_minute, noise_um=noise_um, radii=tuple(bars or _bars_of(data)),
            )  # fmt: skip
        else:
            with executor(workers, scheduler) as pool:
                result = make_plan(
                    data, instrument=instrument, criterion=criterion, points=points, minutes=minutes, per_minute=per_minute,
                    setups=setups, lengths=tuple(bars or ()), repeats=repeats, returns=returns, noise_um=noise_um,
                    survive=survive, robust=robust, starts=starts, seed=seed, for_=names,
                    given=None if given is None else read(given, quiet), pool=pool, progress=Progress(quiet),
                )  # fmt: skip
        result.write(folder, nc=dialects, post=post)
    tell(result.to_data(), str(result), as_json)


def _rotary(machine: Machine, names: str) -> tuple[str, ...]:
    from symfive.errors import InputError

    found = tuple(name.strip() for name in names.split(",") if name.strip())
    for name in found:
        if name not in machine.axes or not machine.axes[name].rotary:
            rotary = ", ".join(n for n, axis in machine.axes.items() if axis.rotary) or "none"
            raise InputError(f"the machine has no rotary axis {name} to reverse", remedy=f"use one of {rotary}")
    return found


def _bars_of(machine: Machine) -> tuple[float, ...]:
    return machine.workspace.bar_lengths or (50.0,)


def _effects(words: list[str] | None) -> list[Effect]:
    from symfive.effects import make_effect
    from symfive.errors import InputError

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
    from symfive.design import assess as assess_campaign

    earlier = None if given is None else read(given, quiet)
    result = assess_campaign(read(campaign, quiet), given=earlier)
    tell(result.to_data(), str(result), as_json)


def truth_of(path: Path | None) -> tuple[dict[str, float], tuple[Effect, ...]]:
    """Values and effects of a truth file: `truth.json`, `model.json` or `identification.json`."""
    from symfive.errors import InputError
    from symfive.files import shown
    from symfive.machine._checks import is_number
    from symfive.model import effects_from_data, read_json

    if path is None:
        return {}, ()
    data = read_json(path)
    parameters = data.get("parameters") if isinstance(data, dict) else None
    if not isinstance(parameters, dict):
        raise InputError("the truth has no parameters", path=path, remedy='write { "parameters": { "EX0C": 12.0 } }')
    values = {}
    for name, entry in parameters.items():
        value = entry.get("value") if isinstance(entry, dict) else entry
        if not is_number(value):
            raise InputError(f"the value of {shown(name)} is not a finite number", path=path, remedy="write a number")
        values[str(name)] = float(value)
    return values, effects_from_data(data.get("effects", []), path)


@app.command(epilog="Example: symfive simulate plan/ -o measured/ --seed 7")
def simulate(
    campaign: CampaignPath,
    output: OutputPath,
    truth: Annotated[Path | None, typer.Option(help="True parameter values (JSON); the others are drawn.")] = None,
    seed: Annotated[int, typer.Option(min=0, max=MOST_SEED, help="Seed of machine and noise.")] = 0,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Measure a plan in simulation: the campaign with readings and truth.json."""
    from symfive.campaign import write_campaign_files
    from symfive.outputs import output_folder, write_json
    from symfive.simulate import simulate as simulate_plan

    with output_folder(output, overwrite=overwrite) as folder:
        values, effects = truth_of(truth)
        result = simulate_plan(read(campaign, quiet), truth=values, effects=effects, seed=seed)
        write_campaign_files(result.campaign, folder)
        write_json(folder / "truth.json", result.to_data())
    if not quiet:
        typer.echo(f"{result.campaign.rows} rows of {len(result.campaign.runs)} runs in {output}", err=True)
