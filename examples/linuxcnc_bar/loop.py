"""A circular test with play found on LinuxCNC: `python -m examples.linuxcnc_bar -o RESULTS`.

1 A circular test is planned for a machine with servo lag. 2 LinuxCNC, whole and without a screen, drives its program:
both directions by G2 and G3, the bar stays on. 3 Behind the control's joints stand servo loops with friction and play, and a ball
bar that knows its length alone. 4 Its software's export, angle and deviation, is imported. 5 The diagnosis names the play.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Run, write_campaign
from symfive.design import CircularTest, circular_test
from symfive.diagnose import Diagnosis, diagnose
from symfive.errors import InputError
from symfive.importers import polar_run, read_polar
from symfive.machine import Machine, preset
from symfive.nc import Post, top_of
from symfive.outputs import write_json
from symfive.procedures import FEED_IN_MM, campaign_of

from ..linuxcnc_loop.configuration import SERVO_S
from ..linuxcnc_loop.controller import Controller, Recording, run_story, say, setp_lines
from .plant import Axis, Bar, exported, length_um

Array = NDArray[np.float64]
RADIUS, FEED = 100.0, 2000.0
OVERSHOOT_DEG, ROWS = 180.0, 900
SQUARENESS = 20e-6
OFF_MM = (0.009, -0.006, 0.004)
"""Where the table ball stands beside its place."""
STARTS = 3


@dataclass(frozen=True)
class Found:
    """What came of it: the `true` plays by axis, µm, and the diagnosis of the imported test."""

    true: dict[str, float]
    diagnosis: Diagnosis

    @property
    def widths(self) -> dict[str, float]:
        """The plays that the diagnosis names, µm, by axis."""
        found = self.diagnosis.findings
        return {f.axis: f.parameters["width"].value for f in found if f.name == "backlash" and f.axis is not None}

    def to_data(self) -> dict[str, Any]:
        """`result.json`."""
        names = [f"{f.name}.{f.axis}" for f in self.diagnosis.findings]
        return {
            "play_um": {n: {"true": v, "found": self.widths.get(n)} for n, v in self.true.items()},
            "findings": names,
        }


def close_the_loop(
    name: str, folder: Path, *, play: dict[str, float], coulomb: float, noise_um: float, seed: int
) -> Found:
    """The whole story, its files in `folder`; `play` µm by axis, `coulomb` mm/s² of X and Y. Raises `InputError`."""
    machine = preset(name)
    test = _test(machine)
    post = Post(machine_top=top_of(machine))
    test.write(folder / "plan", nc=("linuxcnc",), post=post)
    runs = test.campaign.runs
    (program,) = (folder / "plan" / "nc" / "linuxcnc").glob("*-and-*.ngc")
    say(f"1 {machine.name}: {len(runs)} circles, radius {RADIUS:g} mm, {FEED:g} mm/min, in one program")
    with Controller.of(machine) as control:
        say("2 LinuxCNC drives it")
        recording = _driven(control, program.read_text(), setp_lines(machine))
    return measured(machine, recording.joints, folder, play=play, coulomb=coulomb, noise_um=noise_um, seed=seed)


def measured(
    machine: Machine, joints: Mapping[str, Array], folder: Path, *, play: dict[str, float], coulomb: float, noise_um: float,
    seed: int,
) -> Found:  # fmt: skip
    """What a ball bar on the machine behind the `joints` (N,), one row a servo cycle, leads to; its files in `folder`."""
    runs = _test(machine).campaign.runs
    axes = {letter: _axis(machine, letter, play.get(letter, 0.0), coulomb) for letter in "XYZ"}
    carriage = {letter: axis.carriage(joints[letter], SERVO_S) for letter, axis in axes.items()}
    nominal = _ball(runs[0])
    bar = Bar(
        length=RADIUS, ball={n: nominal[n] + off for n, off in zip("XYZ", OFF_MM, strict=True)}, squareness=SQUARENESS,
        noise_um=noise_um,
    )  # fmt: skip
    reading = length_um(bar, carriage, np.random.default_rng(seed))
    say("3, 4 The bar's software exports angle and deviation")
    imported = [
        _imported(machine, run, part, folder / f"{run.id}.txt", noise_um)
        for run, part in zip(runs, captured(reading, len(runs)), strict=True)
    ]
    campaign = campaign_of(machine, imported, "measured")
    write_campaign(campaign, folder / "measured")
    say("5 Diagnosis")
    found = Found({n: v for n, v in play.items() if v}, diagnose(campaign))
    write_json(folder / "diagnosis.json", found.diagnosis.to_data())
    return found


def _test(machine: Machine) -> CircularTest:
    return circular_test(machine, feeds=(FEED,), radius=RADIUS)


def _driven(control: Controller, text: str, setp: Sequence[str]) -> Recording:
    """The program from its first line to its last, begun again where the control's interpreter died under it."""
    for start in range(1, STARTS + 1):
        try:
            return control.run({"circles": text}, setp, feed_override=1.0)["circles"]
        except InputError as error:
            if "milltask" not in str(error) or start == STARTS:
                raise
            say(f"  start {start}: {error}")
    raise AssertionError


def _axis(machine: Machine, letter: str, play: float, coulomb: float) -> Axis:
    drive = machine.axes[letter].drive
    assert drive is not None  # the presets have drives
    return Axis(
        position_gain=drive.position_gain, velocity_gain=drive.velocity_gain, integral_time=drive.integral_time,
        viscous=drive.viscous, feedforward=drive.feedforward, coulomb=coulomb, play=1e-3 * play,
    )  # fmt: skip


def _ball(run: Run) -> dict[str, float]:
    """Positions of the linear axes at which the tool ball stands in the middle of the circle."""
    return {n: 0.5 * float(run.commands[n].max() + run.commands[n].min()) for n in "XYZ"}


def captured(reading: Array, count: int) -> list[Array]:
    """The recordings that the software makes: from where the bar is fed in to where it is out again."""
    inside = np.concatenate([[False], np.abs(reading) < 1e3 * FEED_IN_MM - 200.0, [False]])
    edges = np.flatnonzero(np.diff(inside.astype(int)))
    spans = sorted(zip(edges[::2], edges[1::2], strict=True), key=lambda span: span[0] - span[1])[:count]
    return [reading[max(a - 1, 0) : b + 1] for a, b in sorted(spans)]


def _imported(machine: Machine, run: Run, reading: Array, path: Path, noise_um: float) -> Run:
    """What the export of a recording is to symfive."""
    sweep = (1.0 if run.id.endswith("-ccw") else -1.0) * (360.0 + 2.0 * OVERSHOOT_DEG)
    start = -OVERSHOOT_DEG if sweep > 0.0 else 360.0 + OVERSHOOT_DEG
    angle, deviation = exported(reading, SERVO_S, start_deg=start, sweep_deg=sweep, rows=ROWS)
    head = f"Radius (mm);{RADIUS:g}\nFeed (mm/min);{FEED:g}\nangle (deg);deviation (um)\n"
    rows = "".join(f"{a:.3f};{d:.2f}\n" for a, d in zip(angle, deviation, strict=True))
    path.write_text(head + rows.replace(".", ","))
    return polar_run(
        machine, *read_polar(path), centre=run.table_ball, radius=RADIUS, feed=FEED, id=run.id, noise_um=noise_um
    )


def lines_of(found: Found) -> list[str]:
    """The result in words."""
    lines = [f.says for f in found.diagnosis.findings]
    for axis, true in found.true.items():
        width = found.widths.get(axis)
        share = "" if width is None else f" ({100.0 * (width / true - 1.0):+.1f} %)"
        lines.append(f"Play of {axis}: true {true:g} µm, found {'none' if width is None else f'{width:.2f} µm'}{share}")
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the story; 0 done, 2 where the user has to do something first."""
    parser = argparse.ArgumentParser(prog="python -m examples.linuxcnc_bar", description=__doc__.split("\n\n")[0])
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="RESULTS", help="folder for the results")
    parser.add_argument("--play", nargs=2, type=float, default=(12.0, 8.0), metavar=("X", "Y"), help="true plays, µm")
    parser.add_argument("--friction", type=float, default=20.0, metavar="A", help="Coulomb friction of an axis, mm/s²")
    parser.add_argument("--noise", type=float, default=0.3, metavar="UM", help="1σ of one reading, µm")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="decides the noise")
    options = parser.parse_args(arguments)
    play = dict(zip("XY", options.play, strict=True))
    asked = {"play": play, "coulomb": options.friction, "noise_um": options.noise, "seed": options.seed}
    return run_story(options.output, lambda folder: close_the_loop("three-axis", folder, **asked), lines_of)
