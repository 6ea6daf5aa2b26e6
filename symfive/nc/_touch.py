"""What a touch is, and the contract of a control's words for it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from symfive.errors import InputError
from symfive.machine import Machine
from symfive.nc._base import Dialect, word
from symfive.nc._post import Post

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

    def words(self, dialect: Dialect) -> str:
        """Where it ends, as the dialect writes it."""
        return " ".join(word(dialect, axis, value) for axis, value in self.end.items())

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
    def backed_off(self) -> str:
        """Words of the place `back_off` off the contact that macro variables hold."""
        return " ".join(f"{axis}[{STORED[axis]}{self.back_off * d:+.5f}]" for axis, d in self.away.items())

    @property
    def seconds(self) -> float:
        """Fast to the contact, back and slowly to it again."""
        fast = replace(self.fast, end=self.contact)
        return fast.seconds + 60.0 * self.back * (1.0 / self.fast.feed + 1.0 / self.slow.feed)


def _as_it_is(dialect: Dialect, post: Post) -> Dialect:
    return dialect


@dataclass(frozen=True, kw_only=True)
class Cycle:
    """How a control probes, in the words of its dialect.

    What is stored is where the axes stood, in the words of the program and not corrected for the tip. A servo lag or a delay of
    the signal is the same in all slow touches, along their direction: the effective radius of the sphere takes it.
    docs/howto/touch-probe.md has the table of the controls.

    `guarded` a move that stops on contact, after which the program goes no further; `touched` fast touch, back, slow touch, the
    line of the log called by the name given; `opening` and `closing` lines around all touches; `prepared` the dialect with what
    has to stand before the first move and behind the last one; `log` the log's name from the `{run}` or the program's `{name}`,
    `says` where it is written, `cautions` what the operator has to know; `beside` further files that the program needs on the
    control, name → text; `centred`: whether it may probe under tool-centre control; `calls_probe`: whether it probes only with
    the probe's tool called.
    """

    guarded: Callable[[Dialect, Move], Sequence[str]]
    touched: Callable[[Dialect, Touch, str], Sequence[str]]
    opening: Sequence[str] = ()
    closing: Sequence[str] = ()
    says: str
    log: str = ""
    prepared: Callable[[Dialect, Post], Dialect] = _as_it_is
    cautions: Sequence[str] = ()
    beside: Mapping[str, str] = field(default_factory=dict)
    centred: bool = False
    calls_probe: bool = False
