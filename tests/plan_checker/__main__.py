"""`python -m tests.plan_checker DIR …`: findings of every plan in the folders given; ends with 1 where there are any."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from . import check


def main(arguments: list[str] | None = None) -> int:
    """Every folder that holds a campaign.toml, itself or below; the number of findings decides the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.plan_checker", description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, help="plans, or folders of them")
    parser.add_argument("--reversed", default="", help="rotary axes that the control turns against ISO 841, as B,C")
    options = parser.parse_args(arguments)
    reversed_axes = tuple(filter(None, options.reversed.split(",")))
    plans = [path.parent for folder in options.folders for path in sorted(folder.glob("**/campaign.toml"))]
    total = 0
    for plan in plans:
        found = check(plan, reversed_axes)
        total += len(found)
        print(f"{plan}: {len(found)} finding{'' if len(found) == 1 else 's'}", flush=True)
        for finding in found:
            print(f"  {finding}")
    print(f"{len(plans)} plans, {total} findings")
    return 1 if total or not plans else 0


if __name__ == "__main__":
    sys.exit(main())
