"""A touch probe corrects a trunnion table: `python -m examples.linuxcnc_probe -o RESULTS`.

1 A machine and its eight true location errors, drawn. 2 A plan of centres of a calibration sphere, and its program with G38.
3 LinuxCNC, whole and without a screen, probes a sphere that a HAL component holds behind the joints, with the true errors.
4 symfive fits the centres to the control's log and identifies. 5 The values go into the pins and LinuxCNC probes again, now under
tool-centre point control: the sphere's centre would stand still if nothing were left.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign, Run, SetupSigma, write_campaign
from symfive.design import Plan, plan
from symfive.errors import InputError
from symfive.identify import Identification, fitted_model, identify
from symfive.importers.touch_log import fitted_centres, probed_run, read_touches
from symfive.machine import Machine, machine_to_data, preset
from symfive.model import write_model
from symfive.nc import Post, Probing, program, top_of
from symfive.outputs import write_json
from symfive.procedures import Nominal

from ..linuxcnc_loop.configuration import SERVO_S, TCP_OFF, tcp_on
from ..linuxcnc_loop.controller import Controller, Recording, run_story, say, setp_lines
from .sphere import component_text, hal_lines, installed

Array = NDArray[np.float64]
LOCATION = ("EX0B", "EZ0B", "EA0B", "EC0B", "EX0C", "EY0C", "EA0C", "EB0C")
"""The eight location errors of a trunnion table B C (ISO 230-1, two of them a choice of origin)."""
SETUP = SetupSigma(table_ball=100.0, tool_ball=1.0)
"""1σ of the set-up, µm: the sphere stands where it was put; the probe's length was measured and its run-out turned out."""
PROBING = Probing(clearance=2.0, overtravel=2.0, back_off=0.3, between_feed=5000.0, slow_feed=60.0)
STARTS = 4
CENTRE_NOISE = 1.12
"""1σ of a centre's height by five touches with the radius free, per 1σ of a touch; across it is 0.71 (one height for both)."""


@dataclass(frozen=True)
class Probed:
    """What came of it: deviations of the sphere's centre in the workpiece frame (N, 3) µm, its mean taken out, before and after;
    `noise_um` 1σ of a centre's coordinate; `seconds` of machine time of each program."""

    plan: Plan
    truth: Mapping[str, float]
    identification: Identification
    before: Array
    after: Array
    noise_um: float
    seconds: tuple[float, float]

    def to_data(self) -> dict[str, Any]:
        """`result.json`."""
        found = self.identification
        return {
            "location_errors": {
                n: {"true": v, "value": found[n], "std": found.uncertainty(n)} for n, v in self.truth.items()
            },
            "deviation_rms_um": {"before": size(self.before), "after": size(self.after)},
            "noise_um": self.noise_um,
            "machine_seconds": list(self.seconds),
        }


def size(vectors: Array) -> float:
    """Root mean square of a coordinate, µm, of N vectors from which their mean was taken."""
    return float(np.sqrt(np.sum(vectors**2) / (vectors.size - 3)))


def trunnion(name: str) -> Machine:
    """The preset with its eight location errors and nothing else. Raises `InputError`."""
    machine = preset(name)
    if set(LOCATION) - set(machine.errors):
        raise InputError(f"preset {name} has not the eight location errors of a table B C", remedy="use table-bc")
    return replace(machine, errors={n: machine.errors[n] for n in LOCATION})


def probe(
    control: Controller, run: Run, post: Post, setp: Sequence[str], *, centred: bool
) -> tuple[dict[int, Array], float]:
    """One start of the control: touches by row, and how long the program took, s. `centred`: under tool-centre point control."""
    log = control.folder / f"{run.id}-touches.txt"
    log.unlink(missing_ok=True)
    own = replace(post, machine_top=top_of(control.machine))
    if centred:
        own = replace(own, tool_centre_on=tcp_on(-run.tool_ball[2]), tool_centre_off=TCP_OFF)
    text = program(control.machine, run, "linuxcnc", own, replace(PROBING, log=str(log)))
    text = text if centred else f"{TCP_OFF}\n{text}"  # the control starts with it on
    joints = len(control.letters)
    recording = _run_through(control, run.id, text, [*setp, *hal_lines(joints)])
    moving = np.flatnonzero(recording.line)
    return read_touches(log), SERVO_S * float(moving[-1] - moving[0]) if moving.size else 0.0


def _run_through(control: Controller, name: str, text: str, setp: Sequence[str]) -> Recording:
    """The program from its first touch to its last, begun again where the control's interpreter died under it."""
    start = 1
    while True:
        try:
            return control.run({name: text}, setp, feed_override=1.0)[name]
        except InputError as error:
            if "milltask" not in str(error) or start == STARTS:
                raise
            say(f"  start {start}: {error}")
        start += 1


def in_workpiece(machine: Machine, run: Run, centres: Array) -> Array:
    """Found axis coordinates (N, 3) as the tip's nominal place in the workpiece frame (N, 3), mm."""
    found = {**run.commands, **{axis: centres[:, i] for i, axis in enumerate("XYZ")}}
    return np.asarray(Nominal(machine).ball(found, run.tool_ball))


def close_the_loop(name: str, folder: Path, *, poses: int, noise_um: float, seed: int) -> Probed:
    """The whole story, its files in `folder`; `noise_um` 1σ of a touch. Raises `InputError`."""
    machine = trunnion(name)
    rng = np.random.default_rng(seed)
    truth = {n: float(rng.normal(0.0, machine.errors[n].sigma)) for n in LOCATION}
    latch = 1e3 * PROBING.slow_feed / 60.0 * SERVO_S / np.sqrt(12.0)
    noise = CENTRE_NOISE * float(np.hypot(noise_um, latch))
    chosen = plan(
        machine, instrument="touch_probe", points=poses, setups=1, starts=1, returns=0, anywhere=False, noise_um=noise,
        setup_sigma=SETUP, seed=seed,
    )  # fmt: skip
    run = chosen.campaign.runs[0]
    chosen.write(folder / "plan", nc=("linuxcnc",))
    say(f"1, 2 {machine.name}: plan of {run.rows} centres, five touches each")

    off_um = rng.normal(0.0, 1.0, 6) * np.repeat([SETUP.table_ball, SETUP.tool_ball], 3)
    text = component_text(
        machine_to_data(machine), truth, [n for n in "XYZABC" if n in machine.axes],
        ball=np.asarray(run.table_ball) + 1e-3 * off_um[:3], tool=np.asarray(run.tool_ball) + 1e-3 * off_um[3:],
        radius=PROBING.sphere_radius + PROBING.tip_radius, noise_um=noise_um, seed=seed + 1,
    )  # fmt: skip
    with Controller.of(machine) as control, installed(text, control.folder):
        say("3 LinuxCNC probes, every pin at 0")
        touches, first = probe(control, run, chosen.post, setp_lines(machine), centred=False)
        measured = probed_run(run, touches).run
        campaign = Campaign(machine=machine, runs=(measured,), name="probed")
        write_campaign(campaign, folder / "before")
        result = identify(campaign)
        model = fitted_model(result)
        write_json(folder / "identification.json", result.to_data())
        write_model(model, folder / "model.json")
        centres, radius, rms = fitted_centres(touches)
        say(
            f"  {first:.0f} s of machine time; effective radius {radius:.4f} mm, touches {1e3 * rms:.2f} µm off spheres"
        )
        say(f"4 Identified: residual rms {result.rms_um:.2f} µm, noise of a centre {noise:.2f} µm")
        say("5 LinuxCNC probes again under tool-centre point control, the values in its pins")
        again, second = probe(control, run, chosen.post, setp_lines(model), centred=True)
    before = _about_mean(in_workpiece(machine, run, centres))
    after = _about_mean(fitted_centres(again)[0])
    return Probed(chosen, truth, result, before, after, noise, (first, second))


def _about_mean(places: Array) -> Array:
    """µm about the mean place: the sphere stands where it stands."""
    return np.asarray(1e3 * (places - places.mean(axis=0)))


def lines_of(probed: Probed) -> list[str]:
    """The result in words."""
    found, lines = probed.identification, []
    for name, value in probed.truth.items():
        std = found.uncertainty(name)
        lines.append(
            f"  {name}  true {value:7.2f}  found {found[name]:7.2f} ± {std:.2f}  ({(found[name] - value) / std:+.1f} σ)"
        )
    before, after = size(probed.before), size(probed.after)
    lines.append(
        f"Sphere's centre under rotation, rms of a coordinate: {before:.2f} → {after:.2f} µm "
        f"({before / after:.0f} times smaller; noise of a centre {probed.noise_um:.2f} µm)"
    )
    return [*lines, f"Machine time: {probed.seconds[0]:.0f} s and {probed.seconds[1]:.0f} s"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the story; 0 done, 2 where the user has to do something first."""
    parser = argparse.ArgumentParser(prog="python -m examples.linuxcnc_probe", description=__doc__.split("\n\n")[0])
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="RESULTS", help="folder for the results")
    parser.add_argument("--poses", type=int, default=6, metavar="N", help="poses of the plan")
    parser.add_argument("--noise", type=float, default=0.3, metavar="UM", help="1σ of one touch, µm")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="decides the true machine and all noise")
    options = parser.parse_args(arguments)
    asked = {"poses": options.poses, "noise_um": options.noise, "seed": options.seed}
    return run_story(options.output, lambda folder: close_the_loop("table-bc", folder, **asked), lines_of)
