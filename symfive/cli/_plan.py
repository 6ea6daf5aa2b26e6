"""The plan of a measurement: its options, and which planner they ask for."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click

from symfive.cli import _common as cli
from symfive.cli import _plan_words as words
from symfive.errors import InputError
from symfive.outputs import output_folder
from symfive.separated import SMALLEST


@cli.app.command(epilog="Example: symfive plan table-bc -o plan/ --instrument r_test --points 40 --nc linuxcnc")
@click.argument("machine", help="A machine file, or the name of a preset.")
@cli.output_path
@click.option(
    "--instrument", default="r_test", help="r_test, touch_probe or ball_bar; several share --minutes: r_test,ball_bar."
)
@click.option("--criterion", help="D (default), A, E, G (with --part the default) or V.")
@click.option("--points", type=cli.COUNT, help="Number of poses (default: 40, with --minutes as many as fit).")
@cli.text("--for", "wanted", help="Errors to determine, e.g. EX0C,EY0C,EXC (default: all).")
@click.option(
    "--part",
    type=cli.PATH,
    help="Smallest expected tool error along this tool path: an NC program (ISO, LinuxCNC) or a CSV of poses.",
)
@cli.positive("--part-tool", help="With --part: mm from spindle nose to tip (default: middle of tool_length).")
@click.option(
    "--part-zero", default=words.NO_SHIFT, help="With --part: the program's zero in the workpiece frame, X,Y,Z in mm."
)
@cli.flag(
    "--part-tool-centre",
    help="With --part: X, Y and Z are the position of the tip in the workpiece even without G43.4.",
)
@cli.flag(
    "--part-datum", help="With --part: its zero is probed on the machine, rotary axes at 0; the error there cancels."
)
@cli.dialects
@click.option("--given", type=cli.PATH, help="A campaign already measured; the plan complements it.")
@click.option(
    "--until",
    multiple=True,
    help="Fewest poses (at most --points) until NAME=1σ is expected, e.g. EX0C=2um; may be repeated.",
)
@cli.positive("--minutes", help="Time budget in minutes, set-up included.")
@cli.flag("--per-minute", help="The poses with most information per minute.")
@click.option("--setups", type=cli.COUNT, help="Most mountings (positions of nest or balls), all instruments together.")
@cli.positive("--bar", "bars", multiple=True, help="Length in mm of a bar you own; may be repeated.")
@click.option("--repeats", type=cli.COUNT, default=1, help="Readings of each pose.")
@click.option("--returns", type=cli.COUNT, default=2, help="Returns to the first pose of each run, against drift.")
@cli.positive("--noise-um", default=0.3, help="1σ of one reading, from the instrument's data sheet.")
@cli.positive("--tool-ball-sigma", help="1σ of the tool ball across the spindle's axis, µm (usual: 20).")
@cli.positive("--tool-length-sigma", help="1σ of the tool ball along the spindle's axis, µm (usual: as across).")
@cli.positive("--table-ball-sigma", help="1σ of the position of table ball or sphere, µm (usual: 20).")
@cli.positive("--zero-sigma", help="1σ of the position of an R-test nest in the workpiece frame, µm (usual: unknown).")
@cli.positive("--bar-length-sigma", "length_sigma", help="1σ of the bar's length, µm (usual: 0.5).")
@click.option(
    "--index/--no-index",
    default=None,
    help="Read the first pose of a run with the spindle at 0° and 180° (R-test; with --part where it gains information).",
)
@cli.flag("--survive", help="Optimise for the loss of any one pose.")
@click.option("--robust", default="nominal", help="nominal, or mean or worst over machines drawn from the priors.")
@click.option(
    "--circles",
    help="Instead of poses, circles: iso-230-4 (the circular test), or synchronous or planar (chosen for --effect).",
)
@click.option("--plane", "planes", multiple=True, help="With --circles: XY (default), YZ or ZX; may be repeated.")
@cli.positive("--feed", "feeds", multiple=True, help="With --circles: mm/min along the circle; may be repeated.")
@click.option(
    "--sweep",
    type=cli.Number(SMALLEST, 360.0),
    help="With --circles iso-230-4: arc in degrees, 360 or less, e.g. 220.",
)
@cli.flag(
    "--in-motion",
    help="Instead of poses at rest, sweeps in one recording of --minutes (default 8); R-test or ball bar.",
)
@cli.positive(
    "--speed", "speeds", multiple=True, help="With --in-motion: °/s to choose from (5, 10, 20); may be repeated."
)
@cli.positive(
    "--slow-noise-um",
    "coloured_um",
    help="With --in-motion or --circles iso-230-4: 1σ of the slow noise (default: as --noise-um).",
)
@cli.positive(
    "--correlation-s",
    help="With --in-motion or --circles iso-230-4: correlation time of the slow noise, s (default 1).",
)
@click.option(
    "--effect", "effects", multiple=True, help="Effect that the circles determine, e.g. backlash:C; may be repeated."
)
@click.option("--count", type=cli.COUNT, default=2, help="Number of circles.")
@cli.text("--tool-centre-on", help="Your control's line that switches tool-centre control on, e.g. TRAORI.")
@cli.text("--tool-centre-off", help="The line that switches it off, e.g. TRAFOOF.")
@cli.flag("--tool-centre", help="Tool-centre control in the dialect's own words (iso: G43.4 H, siemens: TRAORI).")
@click.option(
    "--tool",
    "tool_number",
    type=cli.Whole(1, 9999),
    default=1,
    help="With --tool-centre: number of the tool that has the length of the tool ball.",
)
@cli.text("--reversed", "reversed_axes", help="Rotary axes that turn against ISO 841, e.g. B,C.")
@click.option("--machine-top", type=cli.Number(), default=0.0, help="Top of the tool axis, mm in machine coordinates.")
@cli.positive(
    "--dwell", "dwell_s", default=2.0, help="Rest at each pose in s, until machine and instrument have settled."
)
@click.option(
    "--at-pose",
    default="dwell",
    help="After the dwell: dwell (continue), stop (show the number of the pose) or trigger.",
)
@cli.text("--trigger", help="Your control's line that starts a reading, e.g. M64 P0 (with trigger).")
@click.option(
    "--frame",
    default="workpiece",
    help="Frame of the R-test readings: workpiece (nest on the table), machine or tool (head in the spindle).",
)
@cli.positive("--sphere-radius", help="Radius of the sphere to probe, mm (default: the machine file's, 12.5).")
@cli.positive("--tip-radius", help="Radius of the probe tip, mm (default: the machine file's, 3).")
@cli.text("--probe-on", help="Your control's line that switches a touch probe on.")
@cli.text("--probe-off", help="The line that switches it off.")
@click.option("--probe-tool", type=cli.Whole(1, 9999), help="Number of the probe in the tool table (Heidenhain).")
@cli.flag("--no-proof", help="A certificate by search alone, which takes seconds; circles: none.")
@click.option("--starts", type=cli.COUNT, default=2, help="Starts of the search.")
@click.option("--seed", type=cli.SEED, default=0, help="Seed of the search.")
@click.option("--workers", default=0, help="Processes of this computer that share the starts; 0: only this one.")
@cli.scheduler
@cli.overwrite
@cli.as_json
@cli.quiet
@cli.gathered(
    "poses", "instrument", "points", "minutes", "setups", "repeats", "returns", "frame", "index", "survive", "starts", "seed",
)  # fmt: skip
@cli.gathered("radii", "sphere_radius", "tip_radius")
@cli.gathered("motion", "in_motion", "speeds", "coloured_um", "correlation_s")
@cli.gathered("part_options", "part_tool", "part_zero", "part_tool_centre", "part_datum")
@cli.gathered("sigmas", *words.SIGMAS)
@cli.gathered(
    "programs", "tool_centre", "tool_number", "tool_centre_on", "tool_centre_off", "reversed_axes", "machine_top", "dwell_s",
    "at_pose", "trigger", "probe_on", "probe_off", "probe_tool",
)  # fmt: skip
def plan(
    machine: str, output: Path, poses: dict[str, Any], criterion: str | None, wanted: str, part: Path | None,
    part_options: dict[str, Any], nc: tuple[str, ...], given: Path | None, until: tuple[str, ...], per_minute: bool,
    bars: tuple[float, ...], noise_um: float, sigmas: dict[str, float | None], robust: str, circles: str | None,
    planes: tuple[str, ...], feeds: tuple[float, ...], sweep: float | None, effects: tuple[str, ...], count: int,
    motion: dict[str, Any], programs: dict[str, Any], radii: dict[str, Any], no_proof: bool, workers: int,
    scheduler: str | None, overwrite: bool, as_json: bool, quiet: bool,
) -> None:  # fmt: skip
    """Plan a measurement. A campaign without readings, certificate, NC programs, set-up sheet."""
    from symfive.design import circular_test, plan_circles, plan_sweeps, plan_together, plan_until
    from symfive.design import plan as make_plan
    from symfive.executors import executor
    from symfive.given import machine_given
    from symfive.machine import unknown_keys
    from symfive.nc import Post, can_write, check_addresses
    from symfive.validation import unknown_notes

    dialects = cli.dialects_of(nc)
    with output_folder(output, overwrite=overwrite) as folder:
        data = machine_given(machine)
        cli.noted(unknown_notes(unknown_keys(data), machine), quiet)
        own = {name: mm for name, mm in radii.items() if mm is not None}
        data = replace(data, workspace=replace(data.workspace, **own))
        try:
            check_addresses(data)
        except InputError as error:
            if nc:
                raise
            cli.noted([f"no programs: {error}"], quiet)
            dialects = ()
        post = Post(**{**programs, "reversed_axes": words.rotary_of(data, programs["reversed_axes"])})
        instruments = words.names_in(poses["instrument"])
        words.refuse_unused(click.get_current_context(), instruments)
        poses["instrument"] = ",".join(instruments)
        for dialect in dialects:
            can_write(data, dialect, post, probing="touch_probe" in instruments)
        names = words.names_in(wanted)
        wished = words.until_of(until)
        in_motion = motion.pop("in_motion")
        route = words.part_of(data, part, **part_options)
        earlier = None if given is None else cli.read(given, quiet)
        setup_sigma, progress = words.setup_sigma_of(sigmas), cli.Progress(quiet)
        result: Any
        if in_motion:
            result = plan_sweeps(
                data, instrument=poses["instrument"], minutes=poses["minutes"] or 8.0, criterion=criterion or "D", for_=names,
                given=earlier, setups=poses["setups"], lengths=bars, noise_um=noise_um, setup_sigma=setup_sigma,
                certify=not no_proof, progress=progress,
                **{name: value for name, value in motion.items() if value},
            )  # fmt: skip
        elif circles == words.CIRCULAR_TEST:
            result = circular_test(
                data, planes=planes or ("XY",), feeds=feeds or (1000.0,), radius=words.one_bar(bars), sweep_deg=sweep,
                noise_um=noise_um, **{name: motion[name] for name in ("coloured_um", "correlation_s") if motion[name]},
            )  # fmt: skip
        elif circles is not None:
            result = plan_circles(
                data, words.effects_of(effects, circles), family=circles, count=count, for_=names, criterion=criterion or "D",
                robust=robust, per_minute=per_minute, noise_um=noise_um, radii=bars or words.bars_of(data),
                planes=planes or ("XY",), feeds=feeds or None, certify=not no_proof,
            )  # fmt: skip
        elif len(instruments) > 1:
            if poses["minutes"] is None:
                raise InputError("several instruments need minutes to share", remedy="add --minutes, as --minutes 20")
            with executor(workers, scheduler) as pool:
                result = plan_together(
                    data, instruments, minutes=poses["minutes"], criterion=criterion or "A", for_=names, given=earlier,
                    noise_um=noise_um, setup_sigma=setup_sigma, setups=poses["setups"], returns=poses["returns"],
                    starts=poses["starts"], certify=not no_proof, seed=poses["seed"], pool=pool, progress=progress,
                )  # fmt: skip
        else:
            with executor(workers, scheduler) as pool:
                result = (partial(plan_until, asked=wished) if wished else make_plan)(
                    data, **poses, criterion=criterion, per_minute=per_minute, lengths=bars, noise_um=noise_um,
                    setup_sigma=setup_sigma, robust=robust, prove=not no_proof, for_=names, part=route, given=earlier,
                    pool=pool, progress=progress,
                )  # fmt: skip
        result.write(folder, nc=dialects, post=post)
    cli.tell(result.to_data(), str(result), as_json)
