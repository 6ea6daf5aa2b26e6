"""What the user decides about the programs, which moves they make, and what their head and the set-up sheet say of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from symfive.campaign import Run
from symfive.errors import InputError, among
from symfive.instruments import has_bar, mounted
from symfive.machine import Machine
from symfive.nc._arc import circle_of
from symfive.nc._route import Way
from symfive.validation import at_most, positive

RETRACT_MM = 50.0
DWELL_S = 2.0
READ_S = 10.0
"""Time that a stop takes at which the operator reads."""
HOUR_S, MACHINE_MM = 3600.0, 1e5
"""Longest rest at a pose, and what no travel of a machine tool exceeds."""
AT_POSE = ("dwell", "stop", "trigger")
LYING = 0.1
"""Sine of the angle to the table's plane below which an axis lies in it."""
UNCHECKED = "Collisions were not checked"
CARE = "Run the program slowly, one hand on the feed override."
RECORDED = "Measure at feed override 100 percent: the feed is part of the result."
"""Instead, where the readings are those of a path at its feed."""


@dataclass(frozen=True, kw_only=True)
class Post:
    """The user's choices for the programs, and the moves between poses.

    `tool_centre`: tool-centre point control by the dialect's own words, with the length of tool `tool_number`;
    `tool_centre_on`, `tool_centre_off`: your own lines instead (TRAORI, M128, M428 …), which call the length too and may hold
    `{words}`, the place where the axes stand; without either the words are positions of the axes. `frame_of_start`: X, Y and Z
    are in the workpiece frame as the table stands where it is switched on, which the dialect knows.
    `reversed_axes`: rotary axes that the control turns against ISO 841.
    `machine_top`: where the tool's axis is at the top, mm in machine coordinates (controls with G28 need no number). `probe_on`
    and `probe_off` your own lines that switch a touch probe, `probe_tool` its number in the tool table, where it must be
    called; `retract_mm` out of the nest; `dwell_s` at each pose, long enough for machine and instrument to settle; `at_pose`
    what comes then: nothing (`dwell`), a `stop` that shows the number of the pose, or your own lines `trigger` that start a
    reading; `via` run → row → intermediate positions of the seated move to it, which is straight between them; `unsafe` run →
    rows to which the way leads around, out of the nest and over the top; `ways` run → row → the way there, from lifted pose to
    lifted pose (row 0: the lifted pose before the first one, the number of rows: that after the last one, the top, rotary axes
    home), the usual ones where nothing is given; `tested`: whether all ways were tested for collisions.
    """

    tool_centre: bool = False
    tool_number: int = 1
    probe_on: str = ""
    probe_off: str = ""
    probe_tool: int | None = None
    tool_centre_on: str = ""
    tool_centre_off: str = ""
    frame_of_start: bool | None = None
    reversed_axes: tuple[str, ...] = ()
    machine_top: float = 0.0
    retract_mm: float = RETRACT_MM
    dwell_s: float = DWELL_S
    at_pose: str = "dwell"
    trigger: str = ""
    via: Mapping[str, Mapping[int, Way]] = field(default_factory=dict)
    unsafe: Mapping[str, Sequence[int]] = field(default_factory=dict)
    ways: Mapping[str, Mapping[int, Way]] = field(default_factory=dict)
    tested: bool = False

    def __post_init__(self) -> None:
        positive("programs", dwell_s=self.dwell_s)
        at_most("programs", HOUR_S, "s", "in an hour a machine drifts by more than it settles", dwell_s=self.dwell_s)
        at_most("programs", MACHINE_MM, "mm", "no machine tool is larger than 100 m", machine_top=self.machine_top)
        among(self.at_pose, AT_POSE, f'at_pose = "{self.at_pose}" is unknown')
        if (self.at_pose == "trigger") != bool(self.trigger.strip()):
            remedy = "give both: --at-pose trigger and --trigger with your control's line, as M64 P0"
            raise InputError("a trigger needs the lines that start a reading, and lines a trigger", remedy=remedy)
        if bool(self.tool_centre_on.strip()) != bool(self.tool_centre_off.strip()):
            problem = (
                "tool-centre control that is switched on must be off on the way to the top, where rotary axes turn home"
            )
            remedy = "give both: --tool-centre-on and --tool-centre-off, as TRAORI and TRAFOOF"
            raise InputError(problem, remedy=remedy)

    @property
    def centred(self) -> bool:
        """Whether the control follows the ball."""
        return self.tool_centre or bool(self.tool_centre_on)

    @property
    def rest_s(self) -> float:
        """How long a pose takes, the operator's reading included."""
        return self.dwell_s + (READ_S if self.at_pose == "stop" else 0.0)


def collision_warning(machine: Machine, post: Post, runs: Sequence[Run]) -> tuple[str, ...]:
    """Sentences for the head of a program of some runs and for the set-up sheet."""
    recorded = any(run.dynamic for run in runs)
    care = RECORDED if recorded else CARE
    if machine.workspace.spindle_nose is None:
        return f"{UNCHECKED}: the machine file names no spindle nose.", care
    if not post.tested:
        return f"{UNCHECKED} for the path of this program.", care
    bar = ["bar"] if any(map(has_bar, runs)) else []
    bodies = f"{', '.join(['post', *bar, *(machine.workspace.obstacles or {})])} and table"
    where = "at every pose and on every move after the stop before the first one"
    tested = f"Tested: spindle nose, tool, {bodies} as simple bodies, {where}."
    assumed = [f"{said[0].upper()}{said[1:]}." for said in table_assumed(machine)]
    return tested, f"Not tested: {', '.join(_untested(machine, runs))}.", *assumed, *((RECORDED,) if recorded else ())


def table_assumed(machine: Machine) -> tuple[str, ...]:
    """A sentence where the axis that carries the table lies in the plane for which the table is taken."""
    axis = machine.table_axis
    if axis is None or abs(machine.axes[axis].direction[2]) >= LYING:
        return ()
    return (
        f"the table is assumed to be the plane z = 0, which contains axis {axis}: correct for a tilting table; a table square to "
        f"{axis} (horizontal spindle) was not tested, and up, down and top mean along the tool's axis there",
    )


def _untested(machine: Machine, runs: Sequence[Run]) -> list[str]:
    """Bodies that the tests do not know, and moves whose beginning nobody knows."""
    below = [name for name in machine.structure.workpiece if machine.axes[name].rotary]
    above = [name for name in machine.structure.tool if machine.axes[name].rotary]
    cradle = [f"cradle and drives of {', '.join(below)}"] if below else []
    head = [f"the head of {', '.join(above)} above the spindle nose"] if above else []
    mounts = dict.fromkeys(word for run in runs for word in mounted(run))
    sensors = [f"sensors of the {word}" for word in mounts if word.endswith(("nest", "head"))]
    return [
        *cradle,
        *head,
        "clamps",
        "cables",
        *sensors,
        "covers",
        "the first moves from the start position",
    ]


def which_point(machine: Machine, run: Run, post: Post) -> str:
    """Which point the words X, Y and Z of a program mean."""
    length = f"{-run.tool_ball[2]:g} mm"
    above = any(machine.axes[name].rotary for name in machine.structure.tool)
    held = mounted(run)[1] or "tool ball"
    nose = "the spindle nose" + (" with all rotary axes at 0" if above else "")
    if not post.centred or circle_of(machine, run) is not None:
        return f"X Y Z are positions of {nose}, without a tool length; the {held} is {length} below it"
    table = any(machine.axes[name].rotary for name in machine.structure.workpiece)
    if not post.tool_centre_on:
        head = " (the head of each program says for which position of the table)" if table else ""
        return (
            f"while tool-centre control is on, X Y Z are positions of the {held} in the workpiece frame{head}, and its length "
            f"{length} is called with it; elsewhere they are positions of {nose}, without a tool length"
        )
    on, off = (" ".join(text.replace("{words}", "").split()) for text in (post.tool_centre_on, post.tool_centre_off))
    stands = {None: "", True: f" as the table stands at {on}", False: " with the table at 0"}[post.frame_of_start]
    frame = f"{stands}, and turn with it" if table and stands else ""
    return (
        f"from {on} to {off}, X Y Z are positions of the {held} in the workpiece frame{frame}; these lines also call "
        f"its length {length}; elsewhere they are positions of {nose}, without a tool length"
    )


def turned_against(post: Post) -> tuple[str, ...]:
    """A sentence on the axes whose angles have the other sign in the programs than in the files and on the sheet."""
    if not post.reversed_axes:
        return ()
    names = " and ".join(post.reversed_axes)
    return (
        f"The control turns {names} against ISO 841: program and control have the opposite sign of the plan's angles",
    )
