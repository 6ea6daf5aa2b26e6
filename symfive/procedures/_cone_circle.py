"""Cone frustum: a circle about the table ball on a tilted base while the tool leans along the cone, all axes together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run, SetupSigma
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.procedures._limits import checked
from symfive.procedures._nominal import Nominal
from symfive.procedures._path import DIRECTIONS, along, check_spacing, senses
from symfive.procedures._setting import BALL_SETUP, circle_radius, one_after_another, table_ball_of, tool_ball_of

SENSITIVE = ("base", "surface")


def cone_circle(
    machine: Machine, *, radius: float | None = None, half_angle_deg: float = 15.0, inclination_deg: float = 10.0,
    sensitive: str = "base", feed: float = 500.0, direction: str = "both", centre: Sequence[float] | None = None,
    start_deg: float = 0.0, run_up_deg: float = 45.0, tool_ball: Sequence[float] | None = None, rate_hz: float = 50.0,
    noise_um: float = 0.3, setup_sigma_um: SetupSigma = BALL_SETUP,
) -> tuple[Run, ...]:  # fmt: skip
    """The path once around a cone frustum, as in the milling test (NAS 979; with a ball bar: Y. Ihara & K. Tanaka 2005; the tests
    AK4, BK4, CK4 of ISO 10791-6), one run per direction.

    The tool axis is tilted by `half_angle_deg` towards the cone axis, and the cone axis by `inclination_deg` (about Y of the
    tool) from the tool direction with all rotary axes at home. If the inclination is smaller than the half angle, the turning
    axis makes a full revolution, otherwise it swings. The bar of `radius` mm is `sensitive` in the plane of the `base` or normal
    to the `surface` of the cone. `feed` mm/min of the tool ball; `centre` mm, position of the table ball; φ runs from `start_deg`
    once around, and `run_up_deg` more at either end. Raises `InputError` where the axes cannot follow.
    """
    if sensitive not in SENSITIVE:
        raise InputError(f'sensitive = "{sensitive}" is unknown', remedy='use "base" or "surface"')
    if not 0.0 <= half_angle_deg < 90.0:
        raise InputError(f"a half angle of {half_angle_deg:g}° makes no cone", remedy="give 0° or more and below 90°")
    size, middle = circle_radius(machine, radius), table_ball_of(machine, centre)
    ball, nominal = tool_ball_of(machine, tool_ball), Nominal(machine)
    u, v, n = _base(nominal, np.radians(inclination_deg))
    beta = np.radians(half_angle_deg)
    lift = np.sin(beta) if sensitive == "surface" else 0.0
    ring = size * np.sqrt(1.0 - lift**2)
    run_up = np.radians(run_up_deg)
    reach, first = 2.0 * np.pi + 2.0 * run_up, np.radians(start_deg) - run_up
    speed = feed / 60.0 / ring
    time, way = along(reach, speed, run_up, rate_hz)
    runs = []
    for sense in senses(direction):
        phi = first + way if DIRECTIONS[sense] > 0 else first + reach - way
        outward = np.outer(np.cos(phi), u) + np.outer(np.sin(phi), v)
        turned = nominal.pointing(np.cos(beta) * n - np.sin(beta) * outward, "cone")
        target = np.asarray(middle) + ring * outward + size * lift * n
        run = Run(
            id=f"cone-{half_angle_deg:g}-{inclination_deg:g}-f{feed:g}-{sense}", instrument=("ball_bar",),
            sampling="dynamic", time=time, commands=nominal.follow(target, ball, turned, "cone"), table_ball=middle,
            tool_ball=ball, length=size, noise_um=noise_um, setup_sigma_um=setup_sigma_um,
        )  # fmt: skip
        runs.append(checked(machine, run, feed=feed, place="the angles, the radius, the centre or the tool length"))
    check_spacing(speed, rate_hz)
    return one_after_another(runs)


def _base(nominal: Nominal, inclination: float) -> tuple[Array, Array, Array]:
    """Two directions in the cone's base and its axis, workpiece frame."""
    at_home = nominal.commands({}, 1)
    tool = nominal.workpiece_rotation(at_home)[0].T @ nominal.tool_rotation(at_home)[0]
    c, s = np.cos(inclination), np.sin(inclination)
    u, v, n = tool @ np.array([c, 0.0, -s]), tool[:, 1], tool @ np.array([s, 0.0, c])
    return u, v, n
