"""A touch probe's program: at every pose the sphere is touched, from a distance and never while the rotary axes move.

The tip stands off the sphere along the tool's axis, goes to the start of each touch around the sphere, touches fast, backs off,
touches slowly, and the control writes down where its axes stood. Between two poses it leaves along the ways of the plan. All
moves towards the sphere stop on contact. A control's words for that are one function and one line of `CYCLES`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Run
from symfive.errors import InputError
from symfive.instruments import touches_of
from symfive.machine import Machine
from symfive.nc._base import Step
from symfive.nc._post import Post
from symfive.nc._writer import Writer

__all__ = ["CYCLES", "Probing", "cycle_seconds", "probing_of", "probing_steps"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Probing:
    """Sphere, tip and feeds of a probing program, mm and mm/min.

    `clearance` off the contact before and after a touch, `overtravel` behind the expected contact until the touch has failed,
    `back_off` between the fast and the slow touch; `log` the file that the control writes.
    """

    sphere_radius: float = 12.5
    tip_radius: float = 3.0
    clearance: float = 3.0
    overtravel: float = 3.0
    back_off: float = 0.5
    between_feed: float = 2000.0
    fast_feed: float = 300.0
    slow_feed: float = 30.0
    log: str = "probe.txt"


@dataclass(frozen=True)
class _Touch:
    """One touch in the control's words: `way` there from the stand-off, `target` behind the contact, `label` of the log's line,
    `backed` lengths of the block from the contact."""

    way: tuple[str, ...]
    target: str
    away: Mapping[str, float]
    label: str


def _linuxcnc(touch: _Touch, probing: Probing) -> list[str]:
    """G38.3 stops on contact and G38.2 raises an error without one; #5061 … hold the words at the contact."""
    back = " ".join(f"{axis}[#{_STORED[axis]}{probing.back_off * d:+.5f}]" for axis, d in touch.away.items())
    stored = ",".join(f"#{number}" for number in _STORED.values())
    return [
        *(f"G38.3 {words} F{probing.between_feed:g}" for words in touch.way),
        f"G38.2 {touch.target} F{probing.fast_feed:g}",
        f"G1 {back} F{probing.fast_feed:g}",
        f"G38.2 {touch.target} F{probing.slow_feed:g}",
        f"(LOG,{touch.label},{stored})",
        f"G1 {touch.way[-1]} F{probing.between_feed:g}",
        *(f"G1 {words} F{probing.between_feed:g}" for words in touch.way[-2::-1]),
    ]


_STORED = {"X": 5061, "Y": 5062, "Z": 5063}
CYCLES: dict[str, Callable[[_Touch, Probing], list[str]]] = {"linuxcnc": _linuxcnc}
"""The controls for which a touch is written."""


def cycle_seconds(run: Run, probing: Probing | None = None) -> float:
    """How long the touches of one pose take, s, without the way there."""
    probing = probing or Probing()
    reach = probing.sphere_radius + probing.tip_radius + probing.clearance
    each = 60.0 * (
        probing.clearance / probing.fast_feed
        + probing.back_off * (1.0 / probing.fast_feed + 1.0 / probing.slow_feed)
        + 4.0 * reach / probing.between_feed
    )
    return len(touches_of(run)) * (each + _STARTS_S)


_STARTS_S = 0.5
"""Time of the starts and stops within one touch."""


def probing_of(post: Post) -> Probing:
    """The user's sphere and tip, all else as usual."""
    return Probing(sphere_radius=post.sphere_radius, tip_radius=post.tip_radius)


def probing_steps(machine: Machine, run: Run, dialect: str, post: Post, probing: Probing | None = None) -> list[Step]:
    """The steps of a probing program. Raises `InputError` for a control whose touch is not written, and for touches that come
    from below the stand-off."""
    if dialect not in CYCLES:
        problem = f"a touch is not written for {dialect}: its probing cycles depend on the probe and its macros"
        remedy = f"use {', '.join(CYCLES)}, or enter the poses of the sheet into the control's own cycle"
        raise InputError(problem, remedy=remedy)
    if set(machine.axis_names) & set("UVW"):
        raise InputError("a probing program moves X, Y and Z", remedy="leave U, V and W out of the machine file")
    return _Prober(machine, run, post, probing or probing_of(post), CYCLES[dialect]).steps()


class _Prober(Writer):
    def __init__(
        self,
        machine: Machine,
        run: Run,
        post: Post,
        probing: Probing,
        cycle: Callable[[_Touch, Probing], Sequence[str]],
    ) -> None:
        super().__init__(machine, run, post)
        self.probing, self.cycle = probing, cycle
        self.reach = probing.sphere_radius + probing.tip_radius

    def steps(self) -> list[Step]:
        first = self._way_to(0)[-1]
        found = [
            *self._what_it_is(),
            Step(kind="stop", text=f"CLEAR? {self.upright} GOES TO TOP FIRST"),
            Step(kind="text", text=f"G61 G94\n(LOGOPEN,{self.probing.log})"),
            *self._centred(False, {}),
            self._to_the_top(0),
            *self._alone(first, 0),
        ]
        for row in range(self.run.rows):
            if row:
                found += [self._rapid(a, b, row) for a, b in itertools.pairwise(self._way_to(row))]
            arrived = self._way_to(row)[-1]
            left = self._way_to(row + 1)[0]
            found += self._centred(True, arrived)
            if row == 0:
                found.append(Step(kind="stop", text="PROBE ABOVE THE SPHERE?"))
            found += [Step(kind="text", text="\n".join(self._touches(row, left))), *self._centred(False, left)]
        lifted, top, *turned = self._way_to(self.run.rows)
        found.append(replace(self._to_the_top(self.run.rows, top), seconds=self._rapidly(lifted, top)))
        found += [self._rapid(a, b, self.run.rows) for a, b in itertools.pairwise([top, *turned])]
        return [*found, Step(kind="text", text="(LOGCLOSE)")]

    def _what_it_is(self) -> list[Step]:
        probing = self.probing
        said = (
            f"run {self.run.id}, {self.run.rows} centres of a sphere, {len(touches_of(self.run))} touches each",
            f"sphere radius {probing.sphere_radius:g}, tip radius {probing.tip_radius:g}",
            f"probe length {-self.run.tool_ball[2]:g}",
            f"sphere at {' '.join(f'{v:g}' for v in self.run.table_ball)} in the workpiece frame",
            "work offset: the workpiece frame's origin, all rotary axes at 0",
        )
        return [Step(kind="comment", text=text) for text in said]

    def _touches(self, row: int, left: Mapping[str, float]) -> list[str]:
        """All touches of a pose from the stand-off above the sphere, and the way to where it is left."""
        off = self.reach + self.probing.clearance
        above = np.array([0.0, 0.0, off])
        lines = [f"G38.3 {self._line(row, above)} F{self.probing.between_feed:g}"]
        for number, touch in enumerate(touches_of(self.run)):
            n = self._in_tool_frame(row, np.asarray(touch))
            if n[2] < -1e-9:
                problem = f"run {self.run.id}: touch {number + 1} comes from below the sphere's equator"
                raise InputError(problem, remedy="touch the half of the sphere that faces the tool", keys=("touches",))
            start = off * n
            beside = np.array([start[0], start[1], off])
            way = (beside, start) if np.hypot(*start[:2]) > 1e-9 else (above,)
            here, there = (self._place_words(row, k * n) for k in (0.0, 1.0))
            lines += self.cycle(
                _Touch(
                    tuple(self._line(row, place) for place in way),
                    self._line(row, (self.reach - self.probing.overtravel) * n),
                    {axis: there[axis] - here[axis] for axis in "XYZ"},
                    f"{row},{number}",
                ),
                self.probing,
            )
            lines.append(f"G1 {self._line(row, above)} F{self.probing.between_feed:g}")
        words = self._words(left, self._place(left))
        away = " ".join(f"{axis}{words[axis]:.5f}" for axis in "XYZ")
        return [*lines, f"G1 {away} F{self.probing.between_feed:g}"]

    def _in_tool_frame(self, row: int, touch: Array) -> Array:
        if self.run.options.get("touch_frame") != "machine":
            return touch
        return np.asarray(self.nominal.tool_rotation(self._one(row))[0].T @ touch)

    def _one(self, row: int) -> dict[str, Array]:
        return {name: np.array([self.run.commands[name][row]]) for name in self.names}

    def _line(self, row: int, offset: Array) -> str:
        return " ".join(f"{axis}{value:.5f}" for axis, value in self._place_words(row, offset).items())

    def _place_words(self, row: int, offset: Array) -> dict[str, float]:
        """X Y Z that bring the tip so far (tool frame, mm) from the sphere's centre."""
        pose = self._one(row)
        turn = self.nominal.workpiece_rotation(pose)[0].T @ self.nominal.tool_rotation(pose)[0]
        place = np.asarray(self.run.table_ball) + turn @ offset
        fixed = {name: pose[name] for name in self.rotary}
        commands = self.nominal.follow(place[None], self.run.tool_ball, fixed, f"a touch of run {self.run.id}")
        words = self._words({name: float(q[0]) for name, q in commands.items()}, place)
        return {axis: words[axis] for axis in "XYZ"}
