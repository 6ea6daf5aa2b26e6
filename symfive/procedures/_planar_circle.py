"""Circular test in a plane of two linear axes (ISO 230-4), with a ball bar or a grid encoder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from symfive.campaign import Run, SetupSigma
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.procedures._limits import checked
from symfive.procedures._nominal import Nominal
from symfive.procedures._path import DIRECTIONS, along, check_spacing, senses
from symfive.procedures._setting import (
    BALL_SETUP,
    bar_length,
    one_after_another,
    over_the_table,
    tool_ball_of,
    vector,
)

__all__ = ["PLANES", "planar_circle"]

PLANES = {"XY": (0, 1), "YZ": (1, 2), "ZX": (2, 0)}


def planar_circle(
    machine: Machine,
    *,
    plane: str = "XY",
    instrument: str = "ball_bar",
    radius: float | None = None,
    feed: float = 1000.0,
    direction: str = "both",
    centre: Sequence[float] | None = None,
    start_deg: float = 0.0,
    sweep_deg: float = 360.0,
    run_up_deg: float = 90.0,
    hold: Mapping[str, float] | None = None,
    tool_ball: Sequence[float] | None = None,
    rate_hz: float = 50.0,
    noise_um: float = 0.3,
    setup_sigma_um: SetupSigma = BALL_SETUP,
) -> tuple[Run, ...]:
    """Circles about `centre` in a plane of the machine frame, one run per direction.

    `plane` `XY`, `YZ` or `ZX`; `instrument` `ball_bar` (its length is the radius) or `grid_encoder`; `radius`
    mm; `feed` mm/min; `direction` `ccw`, `cw` or `both`, seen against the plane's normal; `centre` mm in the
    workpiece frame (where the table ball stands); the arc from `start_deg` over `sweep_deg`, lengthened at
    both ends by `run_up_deg`, in which the feed rises and falls; `hold` positions of rotary axes; `rate_hz`
    rows per second. Raises `InputError` where an axis cannot follow.
    """
    if plane not in PLANES:
        raise InputError(f'plane "{plane}" is unknown', remedy=f"use one of {', '.join(PLANES)}")
    if instrument not in ("ball_bar", "grid_encoder"):
        raise InputError(f"a planar circle is not read by {instrument}", remedy="use ball_bar or grid_encoder")
    size = bar_length(machine, radius)
    middle = vector(centre if centre is not None else over_the_table(machine))
    ball = tool_ball_of(machine, tool_ball)
    nominal = Nominal(machine)
    at_rest = nominal.commands(hold or {}, 1)
    u, v = (nominal.seen_from_workpiece(at_rest, np.eye(3)[i])[0] for i in PLANES[plane])
    reach = np.radians(sweep_deg + 2.0 * run_up_deg)
    if not size > 0.0:
        raise InputError(f"a circle of radius {size:g} mm is none", remedy="give a radius above 0")
    speed = feed / 60.0 / size
    time, way = along(reach, speed, np.radians(run_up_deg), rate_hz)
    first = np.radians(start_deg - run_up_deg)
    runs = []
    for sense in senses(direction):
        phi = first + way if DIRECTIONS[sense] > 0 else first + reach - way
        target = np.asarray(middle) + size * (np.outer(np.cos(phi), u) + np.outer(np.sin(phi), v))
        grid = instrument == "grid_encoder"
        run = Run(
            id=f"{plane.lower()}-{sense}", instrument=(instrument,), sampling="dynamic", time=time,
            commands=nominal.follow(target, ball, hold or {}, f"circle in {plane}"), table_ball=middle, tool_ball=ball,
            length=None if grid else size, u=vector(u) if grid else None, v=vector(v) if grid else None,
            noise_um=noise_um, setup_sigma_um=setup_sigma_um,
        )  # fmt: skip
        runs.append(checked(machine, run, feed=feed, place="the radius, the centre or the tool length"))
    check_spacing(speed, rate_hz)
    return one_after_another(runs)
