"""Where in the machine a test was run, as ISO 230-1 wants it reported."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from symfive.campaign import Run
from symfive.disk import release
from symfive.machine import Machine
from symfive.numbers import plain_number

STILL = 1e-6
"""An axis that moves less (mm, degree) stands still."""


def moved(run: Run) -> set[str]:
    """The axes that a run moves; a column that lies on disk is in memory by itself."""
    found = set[str]()
    for name, way in run.commands.items():
        if float(np.ptp(way)) > STILL:
            found.add(name)
        release(way)
    return found


def place_of(machine: Machine, run: Run) -> dict[str, str]:
    """The axes that moved, the place of the balls or the reflector, the positions of all axes that stood."""
    moving = moved(run)
    standing = [f"{n} {plain_number(run.commands[n][0])}" for n in machine.axis_names if n not in moving]
    place = {"axes moved": ", ".join(n for n in machine.axis_names if n in moving) or "none"}
    if "laser" not in run.instrument:
        place["centre"] = f"({_listed(run.table_ball)}) mm in the workpiece frame"
    place["tool reference"] = f"({_listed(run.tool_ball)}) mm in the tool frame"
    return place | ({"axes at rest": f"{', '.join(standing)} (mm, °)"} if standing else {})


def _listed(vector: Iterable[float]) -> str:
    return ", ".join(plain_number(value) for value in vector)
