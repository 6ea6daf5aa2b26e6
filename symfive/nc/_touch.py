"""What a touch is, and with what sphere, tip and feeds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from symfive.errors import InputError
from symfive.machine import Machine

ON_ITS_WAY, NO_CONTACT, NO_LOG = "PROBE TOUCHED ON ITS WAY", "NO CONTACT", "LOG NOT WRITTEN"
"""What the control shows; 26 characters at most."""
STORED = {"X": "#5061", "Y": "#5062", "Z": "#5063"}
"""Where macro variables hold the place of the contact."""


@dataclass(frozen=True, kw_only=True)
class Probing:
    """Sphere, tip and feeds of a probing program, mm and mm/min.

    `clearance` off the contact before and after a touch, `overtravel` behind the expected contact until the touch has failed,
    `back_off` between the fast and the slow touch; `log` the file that the control writes, by default named by the run.
    """

    sphere_radius: float = 12.5
    tip_radius: float = 3.0
    clearance: float = 3.0
    overtravel: float = 3.0
    back_off: float = 0.5
    between_feed: float = 2000.0
    fast_feed: float = 300.0
    slow_feed: float = 30.0
    log: str = ""

    def __post_init__(self) -> None:
        sizes = {name: value for name, value in vars(self).items() if name != "log"}
        for name, value in sizes.items():
            if not value > 0.0:
                raise InputError(f"{name} = {value:g} of a probing program is not positive", remedy="give mm or mm/min")


def probing_of(machine: Machine) -> Probing:
    """The user's sphere and tip, all else as usual."""
    workspace = machine.workspace
    return Probing(sphere_radius=workspace.sphere_radius, tip_radius=workspace.tip_radius)


def touch_reach(machine: Machine) -> float:
    """How far from the sphere's centre the tip goes at most while it touches, mm: √2 times the stand-off, where it goes down
    beside the sphere."""
    probing = probing_of(machine)
    return math.sqrt(2.0) * (probing.sphere_radius + probing.tip_radius + probing.clearance)


@dataclass(frozen=True, kw_only=True)
class Move:
    """A straight move of X, Y and Z, mm in the program's words, at `feed` mm/min; `guarded`: it stops on contact."""

    start: Mapping[str, float]
    end: Mapping[str, float]
    feed: float
    guarded: bool = False

    @property
    def way(self) -> dict[str, float]:
        """From start to end, mm."""
        return {axis: value - self.start[axis] for axis, value in self.end.items()}

    @property
    def length(self) -> float:
        """Of the way, mm."""
        return math.hypot(*self.way.values())

    @property
    def seconds(self) -> float:
        """At its feed."""
        return 60.0 * self.length / self.feed


@dataclass(frozen=True, kw_only=True)
class Touch:
    """One touch: `fast` from its start to behind the sphere's surface, which is expected at `contact`, `slow` once more from
    `back_off` mm off the contact.

    `away` is the unit vector out of the sphere in the program's words (of slanted axes its length there is not one); `row` of
    the run and `number` of the touch, both from 0, stand in the log.
    """

    fast: Move
    slow: Move
    contact: Mapping[str, float]
    away: Mapping[str, float]
    back_off: float
    row: int
    number: int

    @property
    def back(self) -> float:
        """From the contact to where the slow touch begins, mm in the program's words."""
        return self.back_off * math.hypot(*self.away.values())

    @property
    def off(self) -> dict[str, str]:
        """What leads from the contact to `back_off` off it, by axis, as it is added in a program."""
        return {axis: f"{self.back_off * d:+.4f}" for axis, d in self.away.items()}

    @property
    def backed_off(self) -> str:
        """Words of the place `back_off` off the contact that macro variables hold."""
        return " ".join(f"{axis}[{STORED[axis]}{more}]" for axis, more in self.off.items())

    @property
    def seconds(self) -> float:
        """Fast to the contact, back and slowly to it again."""
        fast = replace(self.fast, end=self.contact)
        return fast.seconds + 60.0 * self.back * (1.0 / self.fast.feed + 1.0 / self.slow.feed)
