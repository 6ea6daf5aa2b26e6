"""Circular test in a plane of two linear axes (ISO 230-4), with a ball bar or a grid encoder.

The axes get up to the feed with half of their acceleration, within the overshoot, as under the control's circular interpolation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run, SetupSigma
from symfive.errors import InputError, among
from symfive.machine import Machine
from symfive.procedures._limits import checked, within_travel
from symfive.procedures._nominal import Nominal
from symfive.procedures._path import DIRECTIONS, along, check_spacing, ramp_of, senses
from symfive.procedures._setting import (
    BALL_SETUP,
    circle_radius,
    one_after_another,
    table_ball_of,
    tool_ball_of,
    vector,
)

PLANES = {"XY": (0, 1), "YZ": (1, 2), "ZX": (2, 0)}
FEED_IN_MM, FEED_IN_STROKES = 1.5, 1.5
"""How far a bar is pulled out at most when it is mounted, mm and in strokes to one side: its software sees the path into the
circle and out of it, and a bar reaches half as far again as it measures."""
PARTIAL_DEG = 220.0
"""Arc of a bar over what carries its ball: it dips by 20° below the ball's height at either end."""
OVERSHOOT_DEG, SHORT_DEG = 180.0, 2.0
"""Before and after the data: of a whole circle, of a partial arc."""
ROWS_A_RAMP = 50
"""In which the greatest acceleration of an axis is sought."""
UPRIGHT = {"XY": None, "YZ": 90.0, "ZX": 0.0}
"""Angle of +Z in each plane, degree."""


@dataclass(frozen=True)
class _Arc:
    """Degrees: `start` and `sweep` of the data, `overshoot` at either end."""

    start: float
    sweep: float
    overshoot: float


def planar_circle(
    machine: Machine, *, plane: str = "XY", instrument: str = "ball_bar", radius: float | None = None,
    feed: float | Sequence[float] = 1000.0, direction: str = "both", centre: Sequence[float] | None = None,
    start_deg: float | None = None, sweep_deg: float | None = None, run_up_deg: float | None = None,
    hold: Mapping[str, float] | None = None, tool_ball: Sequence[float] | None = None, rate_hz: float = 50.0,
    noise_um: float = 0.3, setup_sigma_um: SetupSigma = BALL_SETUP,
) -> tuple[Run, ...]:  # fmt: skip
    """Circles about `centre` in a plane of the machine frame, one run per feed and direction.

    `plane` `XY`, `YZ` or `ZX`; `instrument` `ball_bar` (its length is the radius) or `grid_encoder`; `radius`
    mm; `feed` mm/min, one or several (a low one shows geometry, a high one the drives); `direction` `ccw`, `cw` or `both`, seen
    against the plane's normal; `centre` mm in the workpiece frame (the table ball); the arc from `start_deg` over
    `sweep_deg`, by default the whole circle, but 220° for a bar in a vertical plane, whose ball stands on a post, and where an
    axis reaches the end of its travel. Both ends are lengthened by `run_up_deg` (180° for a whole circle, 2° for an arc);
    `hold` positions of rotary axes; `rate_hz` rows per second. Only 360° are a circular test to ISO 230-4. Raises `InputError`
    where an axis cannot follow.
    """
    among(plane, PLANES, f'plane "{plane}" is unknown')
    if instrument not in ("ball_bar", "grid_encoder"):
        raise InputError(f"a planar circle is not read by {instrument}", remedy="use ball_bar or grid_encoder")
    size, middle = circle_radius(machine, radius), table_ball_of(machine, centre)
    ball = tool_ball_of(machine, tool_ball)
    nominal, grid = Nominal(machine), instrument == "grid_encoder"
    at_rest = nominal.commands(hold or {}, 1)
    u, v = (nominal.seen_from_workpiece(at_rest, np.eye(3)[i])[0] for i in PLANES[plane])

    def run_of(id: str, time: Array, phi: Array, length: float) -> Run:
        target = np.asarray(middle) + length * (np.outer(np.cos(phi), u) + np.outer(np.sin(phi), v))
        return Run(
            id=id, instrument=(instrument,), sampling="dynamic", time=time,
            commands=nominal.follow(target, ball, hold or {}, f"circle in {plane}"), table_ball=middle, tool_ball=ball,
            length=None if grid else size, u=vector(u) if grid else None, v=vector(v) if grid else None,
            noise_um=noise_um, setup_sigma_um=setup_sigma_um,
        )  # fmt: skip

    used = replace(machine, axes={n: replace(axis, travel=machine.reach(n)) for n, axis in machine.axes.items()})

    def fits(arc: _Arc) -> bool:
        """Whether every axis gets around, and the pulled-out bar onto the arc's ends."""
        ends = np.radians([arc.start - arc.overshoot, arc.start + arc.sweep + arc.overshoot])
        around = np.linspace(ends[0], ends[1], 721)
        try:
            for phi, length in ((around, size), (ends, size + (0.0 if grid else feed_in(machine)))):
                within_travel(used, run_of("arc", np.arange(len(phi), dtype=float), phi, length), place="the arc")
        except InputError:
            return False
        return True

    arcs = list(_arcs(plane, start_deg, sweep_deg, run_up_deg, whole=grid or UPRIGHT[plane] is None))
    arc = arcs[0] if len(arcs) == 1 else next(filter(fits, arcs), arcs[0])
    feeds = [float(feed)] if isinstance(feed, (int, float)) else [float(value) for value in feed]
    run_up = np.radians(arc.overshoot)
    reach, first = np.radians(arc.sweep) + 2.0 * run_up, np.radians(arc.start) - run_up
    runs = []
    for mm_per_min in feeds:
        speed = mm_per_min / 60.0 / size
        ramp = float(ramp_of(machine, speed, size, run_up))
        time, way = along(reach, speed, ramp, rate_hz)
        around = np.linspace(ramp, reach - ramp, 361)
        close = [(around / speed, around)]
        if ramp == run_up:  # cut short, or it would take `CAUTION` of the acceleration
            near, turned = along(2.0 * ramp, speed, ramp, ROWS_A_RAMP * speed / ramp)  # up and down again
            up = near <= 2.0 * ramp / speed
            close += [(near[up], turned[up]), (near[~up], reach - 2.0 * ramp + turned[~up])]
        for sense in senses(direction):
            id = f"{plane.lower()}-{sense}" if len(feeds) == 1 else f"{plane.lower()}-f{mm_per_min:g}-{sense}"
            for times, part in (*close, (time, way)):  # few rows miss what an axis needs between them
                phi = first + part if DIRECTIONS[sense] > 0 else first + reach - part
                run = run_of(id, times, phi, size)
                checked(machine, run, feed=mm_per_min, place="the radius, the centre or the tool length")
            runs.append(run)
        check_spacing(speed, rate_hz)
    return one_after_another(runs)


def feed_in(machine: Machine) -> float:
    """Distance, mm, by which the machine's bar is pulled out when it is mounted for a circle."""
    return min(FEED_IN_MM, FEED_IN_STROKES * machine.workspace.bar_stroke)


def _arcs(
    plane: str, start: float | None, sweep: float | None, overshoot: float | None, *, whole: bool
) -> Iterator[_Arc]:
    """The arcs that are tried: the one that is wanted, else the whole circle (if it is to be), then those of 220°, first about
    the direction away from the table."""
    if sweep is not None or whole:
        size = 360.0 if sweep is None else sweep
        usual = OVERSHOOT_DEG if size >= 360.0 else SHORT_DEG
        yield _Arc(start or 0.0, size, usual if overshoot is None else overshoot)
    if sweep is None:
        up = UPRIGHT[plane] or 0.0
        middles = [up, up + 90.0, up + 180.0, up - 90.0] if start is None else [start + 0.5 * PARTIAL_DEG]
        for middle in middles:
            yield _Arc(middle - 0.5 * PARTIAL_DEG, PARTIAL_DEG, SHORT_DEG if overshoot is None else overshoot)
