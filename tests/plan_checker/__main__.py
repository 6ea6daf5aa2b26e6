"""`python -m tests.plan_checker DIR …`: findings of every plan in the folders given; ends with 1 where there are any."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from symfive.campaign import Run, write_campaign
from symfive.design import plan, plan_sweeps
from symfive.errors import InputError
from symfive.machine import Machine, read_machine
from symfive.moves import cleared
from symfive.nc import DIALECTS, Post, write_programs
from symfive.procedures import campaign_of, planar_circle, rotary_circle

from . import check
from .machines import random_machine


def main(arguments: list[str] | None = None) -> int:
    """Every folder that holds a campaign.toml, itself or below; the number of findings decides the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.plan_checker", description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path, help="plans, or folders of them")
    parser.add_argument("--reversed", default="", help="rotary axes that the control turns against ISO 841, as B,C")
    parser.add_argument(
        "--random", nargs=2, type=int, metavar=("FIRST", "END"), help="plan and check random machines instead"
    )
    parser.add_argument(
        "--circles", action="store_true", help="of random machines: circles of linear and rotary axes, no poses"
    )
    parser.add_argument("--probes", action="store_true", help="of random machines: spheres touched by a probe")
    parser.add_argument(
        "--in-motion", action="store_true", help="of random machines: sweeps of an R-test or a ball bar"
    )
    options = parser.parse_args(arguments)
    if options.random:
        make = _circles if options.circles else _probes if options.probes else _sweeps if options.in_motion else _poses
        return 1 if _random(range(*options.random), make) else 0
    reversed_axes = tuple(filter(None, options.reversed.split(",")))
    plans = [path.parent for folder in options.folders for path in sorted(folder.glob("**/campaign.toml"))]
    total = 0
    for folder in plans:
        found = check(folder, reversed_axes)
        total += len(found)
        print(f"{folder}: {len(found)} finding{'' if len(found) == 1 else 's'}", flush=True)
        for finding in found:
            print(f"  {finding}")
    print(f"{len(plans)} plans, {total} findings")
    return 1 if total or not plans else 0


def _poses(machine: Machine, seed: int, folder: Path) -> None:
    """An optimised plan, read at a stop every third time and by a trigger every other third."""
    at_pose = ("dwell", "stop", "trigger")[seed % 3]
    post = Post(at_pose=at_pose, trigger="M64 P0" if at_pose == "trigger" else "")
    made = plan(machine, instrument=("r_test", "ball_bar")[seed % 2], points=10, starts=1)
    made.write(folder, nc=tuple(DIALECTS) if at_pose != "trigger" else ("linuxcnc",), post=post)


def _probes(machine: Machine, seed: int, folder: Path) -> None:
    """A sphere touched by a probe."""
    made = plan(machine, instrument="touch_probe", points=6, setups=1, starts=1, prove=False)
    made.write(folder, nc=tuple(DIALECTS), post=Post(probe_tool=30))


def _sweeps(machine: Machine, seed: int, folder: Path) -> None:
    """Sweeps of an R-test or a ball bar, every third time in two mountings; two of six under tool-centre control."""
    minutes, criterion = (10.8, "A") if seed % 3 == 2 else (5.4, "D")
    made = plan_sweeps(
        machine, instrument=("r_test", "ball_bar")[seed % 2], minutes=minutes, criterion=criterion, setups=2, certify=False,
    )  # fmt: skip
    centred = seed % 6 in (3, 4)  # the lines of other controls depend on the machine
    made.write(folder, nc=("iso", "siemens") if centred else tuple(DIALECTS), post=Post(tool_centre=centred))


def _circles(machine: Machine, seed: int, folder: Path) -> None:
    """Circles in one plane at two feeds, and one while a rotary axis turns, of those that have a clear way."""
    runs: list[Run] = []
    rotary = [name for name in machine.axis_names if machine.axes[name].rotary]
    arrangement = ("radial", "tangential", "axial")[seed % 3]
    makers = [
        lambda: planar_circle(
            machine, plane=("XY", "YZ", "ZX")[seed % 3], radius=50.0, feed=(500.0, 2000.0), rate_hz=20.0
        )
    ]
    makers += (
        [lambda: rotary_circle(machine, axis=rotary[seed % len(rotary)], arrangement=arrangement)] if rotary else []
    )
    refusals = []
    for make in makers:
        try:
            found = make()
            cleared(machine, found, {})
            runs += found
        except InputError as refusal:
            refusals.append(refusal)
    if not runs:
        raise refusals[0]
    write_campaign(campaign_of(machine, runs), folder)
    write_programs(campaign_of(machine, runs), folder / "nc", DIALECTS, cleared(machine, runs, {}))


def _random(seeds: range, make: Callable[[Machine, int, Path], None]) -> int:
    """Plans and checks the random machines of these seeds; prints findings and refusals, and returns the number of findings."""
    total = 0
    for seed in seeds:
        with TemporaryDirectory() as folder:
            file = Path(folder) / "machine.toml"
            file.write_text(random_machine(seed), encoding="utf-8")
            try:
                make(read_machine(file), seed, Path(folder) / "plan")
            except InputError as refusal:
                print(f"{seed}: refused: {refusal}", flush=True)
                continue
            found = check(Path(folder) / "plan")
        total += len(found)
        print(f"{seed}: {len(found)} findings", *found, sep="\n  ", flush=True)
    return total


if __name__ == "__main__":
    sys.exit(main())
