"""`python -m tests.plan_checker DIR …`: findings of every plan in the folders given; ends with 1 where there are any."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from symfive.design import plan
from symfive.errors import InputError
from symfive.machine import read_machine

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
    options = parser.parse_args(arguments)
    if options.random:
        return 1 if _random(range(*options.random)) else 0
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


def _random(seeds: range) -> int:
    """Plans and checks the random machines of these seeds; prints findings and refusals, and returns the number of findings."""
    total = 0
    for seed in seeds:
        with TemporaryDirectory() as folder:
            file = Path(folder) / "machine.toml"
            file.write_text(random_machine(seed), encoding="utf-8")
            try:
                made = plan(read_machine(file), instrument=("r_test", "ball_bar")[seed % 2], points=10, starts=1)
                made.write(Path(folder) / "plan", nc=("iso", "siemens", "heidenhain", "linuxcnc"))
            except InputError as refusal:
                print(f"{seed}: refused: {refusal}", flush=True)
                continue
            found = check(Path(folder) / "plan")
        total += len(found)
        print(f"{seed}: {len(found)} findings", *found, sep="\n  ", flush=True)
    return total


if __name__ == "__main__":
    sys.exit(main())
