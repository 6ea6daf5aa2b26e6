"""Circular blocks: centre by I J K (from the start) or radius R, in the planes XY, ZX and YZ, with whatever else moves."""

from __future__ import annotations

import math

import numpy as np

from symfive.arrays import Array
from symfive.errors import InputError

PLANES = {"G17": ("X", "Y"), "G18": ("Z", "X"), "G19": ("Y", "Z")}
CENTRE = {"X": "I", "Y": "J", "Z": "K"}
OFF_MM, OFF_SHARE = 0.01, 1e-3
"""By so much may start and end differ in their distance from the centre: controls allow about as much."""


def arc(
    start: dict[str, float], end: dict[str, float], plane: tuple[str, str], words: dict[str, float], clockwise: bool
) -> tuple[dict[str, float], float, float]:
    """The centre (the plane's two axes), radius and signed angle (rad) of an arc. Raises `InputError` for one that is none."""
    a, b = (np.array([p[name] for name in plane]) for p in (start, end))
    if "R" in words:
        centre = _centre_by_radius(a, b, words["R"], clockwise)
    else:
        centre = a + np.array([words.get(CENTRE[name], 0.0) for name in plane])
    radius, other = float(np.hypot(*(a - centre))), float(np.hypot(*(b - centre)))
    if radius == 0.0:
        raise InputError("the arc has no radius", remedy="give its centre by I, J, K from the start, or R")
    if abs(radius - other) > max(OFF_MM, OFF_SHARE * radius):
        problem = f"the arc begins {radius:.4g} mm from its centre and ends {other:.4g} mm from it"
        raise InputError(problem, remedy="give the centre by I, J, K from the start (G91.1)")
    begin, last = (math.atan2(*(p - centre)[::-1]) for p in (a, b))
    turn = (begin - last if clockwise else last - begin) % (2.0 * math.pi)
    turn = 2.0 * math.pi if np.allclose(a, b, atol=1e-9) else turn
    return dict(zip(plane, map(float, centre), strict=True)), radius, -turn if clockwise else turn


def _centre_by_radius(a: Array, b: Array, radius: float, clockwise: bool) -> Array:
    """R > 0: the arc of at most half a turn, R < 0: the other one."""
    chord = b - a
    length = float(np.hypot(*chord))
    if length < 1e-9:
        raise InputError("an arc with R ends where it begins", remedy="give a whole circle by I, J, K")
    if 0.5 * length > abs(radius) + OFF_MM:
        problem = f"the arc's ends are {length:.4g} mm apart, more than twice its radius R of {abs(radius):.4g} mm"
        raise InputError(problem, remedy="correct R or the end")
    height = math.sqrt(max(radius**2 - 0.25 * length**2, 0.0))
    left = np.array([-chord[1], chord[0]]) / length
    side = -1.0 if clockwise == (radius > 0.0) else 1.0
    return np.asarray(0.5 * (a + b) + side * height * left)
