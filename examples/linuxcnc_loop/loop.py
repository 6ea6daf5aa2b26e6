"""A real control closes the loop: `python -m examples.linuxcnc_loop -o RESULTS [--preset NAME ...]`.

1 A machine, and a true one of its kind in the independent plant. 2 A certified R-test plan for the tool centre point in the
whole workspace. 3 LinuxCNC, whole and without a screen, runs its NC programmes and one with poses that the plan does not
visit, with generated kinematics that know no error; the plant reads the R-test at the joints that the control recorded.
4 symfive identifies from the plan's poses. 5 The identified values go into the pins, LinuxCNC runs the same programmes
again, and the plant says how far the tool is off before and after.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from symfive.campaign import Run, SetupSigma, read_campaign
from symfive.design import plan
from symfive.errors import InputError
from symfive.identify import fitted_model, identify
from symfive.machine import machine_to_data, preset
from symfive.model import write_model
from symfive.nc import Post
from symfive.outputs import output_folder, write_json

from .baseline import with_error_motions
from .controller import Controller, require_linuxcnc, say, setp_lines
from .deviation import measured_deviation, rest_of, true_deviation, true_geometry, true_with_offset
from .poses import held_out_run, joints_at_poses, plant_run, programme
from .result import Loop, Passage
from .truth import TrueMachine, drawn_machine, measure
from .write import lines_of_loop, write_loop, write_summary

FEED_OVERRIDE = 10.0
"""Nothing can break here, so that the slow ways of a measuring programme are run faster; limits of the axes stay."""
SETUP = SetupSigma(table_ball=20.0, tool_ball=1.0)
"""1σ of the set-up, µm: the nest stands where it was put; the ball's run-out was turned out and its length measured."""
SETUPS = 3
"""Nests: the tool centre point is compensated in a volume, so that it is measured at several radii and heights."""
PlantRun = dict[str, Any]
Say = Callable[[str], None]


def drive(control: Controller, runs: Sequence[Run], post: Post, setp: Sequence[str]) -> list[PlantRun]:
    """One start of the control with these pins, all programmes: the runs at the joints that were recorded."""
    programmes = {run.id: programme(control.machine, run, post) for run in runs}
    recordings = control.run(programmes, setp, feed_override=FEED_OVERRIDE)
    return [plant_run(run, joints_at_poses(programmes[run.id], recordings[run.id])) for run in runs]


def passage(
    truth: TrueMachine, runs: Sequence[PlantRun], folder: Path, *, seed: int, pins: Mapping[str, float]
) -> Passage:
    """The plant measures runs with the noise and the set-up of this seed; the campaign goes into `folder`."""
    measure(truth, runs, folder, seed=seed)
    campaign = read_campaign(folder)
    return Passage(
        campaign=campaign, measured=measured_deviation(campaign, truth.table), true=true_with_offset(truth, runs),
        whole=true_deviation(truth, runs), geometry=true_geometry(truth, runs),
        rest=rest_of(truth, runs, campaign, pins),
    )  # fmt: skip


def close_the_loop(
    name: str, folder: Path, *, points: int, held_out: int, noise_um: float, seed: int, drift_um: float, say: Say
) -> Loop:
    """The whole story on the preset of that name, its files in `folder`. Raises `InputError`."""
    begin = time.perf_counter()
    machine = with_error_motions(preset(name))
    truth = drawn_machine(machine_to_data(machine), seed=seed, drift_um=drift_um)
    say(f"1 Machine: {machine.name}, {machine.structure.code}")
    say(f"  true errors drawn: {len(truth.location_errors)} of location, {len(truth.error_motions)} error motions")

    chosen = plan(
        machine, criterion="V", points=points, setups=SETUPS, noise_um=noise_um, setup_sigma=SETUP, starts=1,
        anywhere=False, seed=seed,
    )  # fmt: skip
    runs = chosen.campaign.runs
    other = held_out_run(machine, runs[0], poses=held_out, seed=seed)
    chosen.write(folder / "plan", nc=("linuxcnc",))
    say(f"2 Plan: {sum(run.rows for run in runs)} poses in {len(runs)} set-ups, and {held_out} held-out poses")

    seeds = iter(range(4 * seed + 1, 4 * seed + 5))
    with Controller.of(machine) as control:
        say("3 LinuxCNC runs the programmes, every pin at 0, and the plant reads the R-test")
        *planned, last = drive(control, (*runs, other), chosen.post, setp_lines(machine))
        before = passage(truth, planned, folder / "before", seed=next(seeds), pins={})
        held_out_before = passage(truth, [last], folder / "held-out-before", seed=next(seeds), pins={})

        result = identify(before.campaign)
        model = fitted_model(result)
        write_json(folder / "identification.json", result.to_data())
        write_model(model, folder / "model.json")
        say(f"4 Identified {len(model.names)} errors: residual rms {result.rms_um:.3f} µm, noise {noise_um:g} µm")

        say("5 LinuxCNC runs the same programmes with the identified errors in its pins")
        *planned, last = drive(control, (*runs, other), chosen.post, setp_lines(model))
        after = passage(truth, planned, folder / "after", seed=next(seeds), pins=model.values)
        held_out_after = passage(truth, [last], folder / "held-out-after", seed=next(seeds), pins=model.values)
    return Loop(
        preset=name, control=f"LinuxCNC {control.version}",
        machine=machine, truth=truth, identification=result, noise_um=noise_um, before=before, after=after,
        held_out_before=held_out_before, held_out_after=held_out_after, seconds=time.perf_counter() - begin,
    )  # fmt: skip


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m examples.linuxcnc_loop", description=__doc__.split("\n\n")[0])
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="RESULTS", help="folder for the results")
    parser.add_argument("--preset", action="append", metavar="NAME", help="machine (repeat); default table-bc")
    parser.add_argument("--points", type=int, default=60, metavar="N", help="poses of the plan")
    parser.add_argument("--held-out", type=int, default=16, metavar="N", help="poses that the plan does not visit")
    parser.add_argument("--noise", type=float, default=0.4, metavar="UM", help="1σ of one reading, µm")
    parser.add_argument("--drift", type=float, default=0.0, metavar="UM", help="thermal drift of the tool, µm")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="decides the true machine and all noise")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the story on every machine; 0 done, 2 where the user has to do something first."""
    options = parse(arguments)
    try:
        require_linuxcnc()
        with output_folder(options.output, overwrite=True) as folder:
            loops = []
            for name in options.preset or ["table-bc"]:
                own = folder / name
                loop = close_the_loop(
                    name, own, points=options.points, held_out=options.held_out, noise_um=options.noise,
                    seed=options.seed, drift_um=options.drift, say=say,
                )  # fmt: skip
                write_loop(loop, own)
                say("\n".join(lines_of_loop(loop)))
                loops.append(loop)
            write_summary(loops, folder)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"Figures, data and tables: {options.output.resolve()}")
    return 0
