"""A machine as plain data, in the units of the machine file (mm, degree, µm, µrad, s)."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from symfive.errors import InputError, inside
from symfive.files import shown
from symfive.machine._axis import UNREAD, Axis
from symfive.machine._errors import ErrorTerm
from symfive.machine._structure import Structure
from symfive.machine._suggest import nearest_error
from symfive.numbers import plain_number, unit_words
from symfive.screen import OnScreen
from symfive.validation import as_lists, at_most, freeze, numbers, only, positive

ARTEFACT_MM = 1e3


@dataclass(frozen=True, kw_only=True)
class Workspace:
    """What a measurement plan may use; every field is optional (mm, s).

    `table_centre` in the workpiece frame; where it is None it follows from the axes (`Machine.table_centre`).
    `clearance` is what bodies keep off each other and linear axes off the ends of their travel: a ball stands within 1 mm of its
    place, and so is the tool's length. `sphere_radius` and `tip_radius` are those of a touch probe's sphere and tip;
    `nest_opening` (degree) is how far the tool may lean from the axis of an R-test's nest. `obstacles` name → lowest and highest
    corner of a box along the axes of the workpiece frame, which turns with the table.
    """

    table_radius: float | None = None
    table_centre: tuple[float, float] | None = None
    ball_height: tuple[float, float] | None = None
    tool_length: tuple[float, float] | None = None
    bar_lengths: tuple[float, ...] = ()
    bar_stroke: float = 1.0
    sensor_range: float = 1.0
    seconds_per_pose: float = 6.0
    spindle_nose: Mapping[str, float] | None = None
    post_radius: float | None = None
    tool_radius: float | None = None
    bar_radius: float | None = None
    clearance: float = 2.0
    sphere_radius: float = 12.5
    tip_radius: float = 3.0
    nest_opening: float | None = None
    obstacles: Mapping[str, tuple[Sequence[float], Sequence[float]]] | None = None
    extra: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "extra", freeze(self.extra))
        sizes = [f.name for f in fields(self) if f.type in ("float", "float | None")]
        positive("workspace", **{name: getattr(self, name) for name in sizes})
        radii = {"sphere_radius": self.sphere_radius, "tip_radius": self.tip_radius}
        at_most("workspace", ARTEFACT_MM, "mm", "no sphere or tip of a touch probe is larger", **radii)
        if self.nest_opening is not None:
            at_most("workspace", 180.0, "degree", "no nest opens wider", nest_opening=self.nest_opening)
        numbers("workspace", "bar_lengths", self.bar_lengths, example="bar_lengths = [100.0, 150.0]")
        for length in self.bar_lengths:
            positive("workspace", bar_lengths=length)
        if self.table_centre is not None:
            numbers("workspace", "table_centre", self.table_centre, 2, example="table_centre = [x, y]")
        for name in ("ball_height", "tool_length"):
            pair = getattr(self, name)
            if pair is None:
                continue
            numbers("workspace", name, pair, 2, example=f"{name} = [lowest, highest]")
            if pair[0] > pair[1]:
                problem = f"workspace: {name} = {list(pair)} is not [lowest, highest]"
                raise InputError(problem, remedy="put the lower one first", keys=(name,))
        if self.obstacles is not None:
            with inside("obstacles"):
                object.__setattr__(self, "obstacles", _boxes(self.obstacles))
        if self.tool_length is not None:
            positive("workspace", tool_length=self.tool_length[0])
        if self.spindle_nose is not None:
            if not isinstance(self.spindle_nose, Mapping):
                problem = f"workspace: spindle_nose = {shown(self.spindle_nose)} is not a table"
                raise InputError(problem, remedy="write { radius = 40.0, above_ball = 60.0 }", keys=("spindle_nose",))
            with inside("spindle_nose"):
                only("workspace: spindle_nose", self.spindle_nose, ("radius", "above_ball"))
                positive("workspace: spindle_nose", **self.spindle_nose)
                above, shortest = self.spindle_nose["above_ball"], (self.tool_length or (math.inf,))[0]
                if above > shortest:
                    problem = f"workspace: spindle_nose: above_ball = {above:g} is more than the tool length of {shortest:g} mm"
                    remedy = "give the height of the spindle nose over the tool ball, or correct tool_length"
                    raise InputError(problem, remedy=remedy, keys=("above_ball",))
            object.__setattr__(self, "spindle_nose", freeze(self.spindle_nose))


def _boxes(table: Any) -> Mapping[str, tuple[Sequence[float], Sequence[float]]]:
    """Corners of the obstacles by name. Raises `InputError`."""
    example = "vice = [[60.0, -50.0, 0.0], [160.0, 50.0, 80.0]]"
    if not isinstance(table, Mapping):
        raise InputError(
            f"workspace: obstacles = {shown(as_lists(table))} is not a table",
            remedy=f"write [workspace.obstacles] {example}",
        )
    found = {}
    for name, corners in table.items():
        if not isinstance(corners, (list, tuple)) or len(corners) != 2:
            problem = f"obstacle {shown(name)} is not two corners"
            raise InputError(problem, remedy=f"write lowest and highest x, y, z in mm: {example}", keys=(name,))
        for corner in corners:
            numbers(f"obstacle {name}", name, corner, 3, example=example)
        low, high = (tuple(map(float, corner)) for corner in corners)
        if not all(a < b for a, b in zip(low, high, strict=True)):
            problem = f"obstacle {name}: {list(low)} is not below {list(high)} in x, y and z"
            raise InputError(problem, remedy="put the lowest x, y, z first, then the highest", keys=(name,))
        found[name] = (low, high)
    return freeze(found)


@dataclass(frozen=True, kw_only=True)
class EffectEntry:
    """An effect of the vocabulary that the baseline model already holds: its id, axis and further keys."""

    effect: str
    axis: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "options", freeze(self.options))
        if not isinstance(self.effect, str) or not isinstance(self.axis, (str, type(None))):
            problem = f"effect {shown(self.effect)} of axis {shown(self.axis)} is not two names"
            raise InputError(problem, remedy='write { effect = "backlash", axis = "C" }')


@dataclass(frozen=True, kw_only=True, repr=False)
class Machine(OnScreen):
    """A machine: its structural code, its axes, the errors that its baseline model estimates, its workspace.

    Validates itself on construction and raises `InputError`. Vectors are in the machine frame with all axes at
    zero. `text` is the text of its file, so that writing keeps comments and layout; `comments` are
    its comments alone.
    """

    name: str
    structure: Structure
    axes: Mapping[str, Axis]
    errors: Mapping[str, ErrorTerm] = field(default_factory=dict)
    workspace: Workspace = field(default_factory=Workspace)
    effects: tuple[EffectEntry, ...] = ()
    comments: tuple[str, ...] = field(default=(), compare=False)
    extra: Mapping[str, Any] = field(default_factory=dict, repr=False)
    text: str = field(default="", repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("axes", "errors", "extra"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        if not isinstance(self.name, str) or not self.name.isprintable():  # it stands in files that end a line with it
            problem = f"the machine's name {shown(self.name)} is not one line of printed text"
            raise InputError(problem, remedy='write name = "…" without line feeds and control characters')
        code = self.structure.code
        for name in self.structure.axes:
            if name not in self.axes:
                problem = f'axis {name} of the structure "{code}" has no table'
                raise InputError(problem, remedy=f"add [axes.{name}] with its travel", keys=("axes", name))
        for name in self.axes:
            if name not in self.structure.axes:
                problem = f'axis {shown(name)} is not in the structure "{code}"'
                raise InputError(problem, remedy=f"add it there or remove [axes.{name}]", keys=("axes", name))
        for term in self.errors.values():
            with inside("errors", term.name):
                check_error(term, self.axes)
        for number, entry in enumerate(self.effects):
            if entry.axis is not None and entry.axis not in self.axes:
                with inside("model", "effects", number):
                    raise unknown_axis(f"effect {entry.effect}", entry.axis, self.structure.axes, "axis")

    def __str__(self) -> str:
        lines = machine_lines(self)
        return "\n".join([lines[0], *(textwrap.fill(line, 100, subsequent_indent="  ") for line in lines[1:])])

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Every axis from the bed outward, workpiece side first."""
        return self.structure.axes

    @property
    def rotary_axes(self) -> tuple[str, ...]:
        """Those of them that turn."""
        return tuple(name for name in self.structure.axes if self.axes[name].rotary)

    @property
    def linear_axes(self) -> tuple[str, ...]:
        """Those of them that move straight."""
        return tuple(name for name in self.structure.axes if not self.axes[name].rotary)

    @property
    def table_axis(self) -> str | None:
        """The rotary axis that carries the table: of those on the workpiece side the one next to the workpiece."""
        return next((name for name in self.structure.workpiece if self.axes[name].rotary), None)

    def reach(self, name: str) -> tuple[float, float]:
        """What plans use of an axis' travel, mm or degree: linear axes keep the workspace's clearance off its ends."""
        axis = self.axes[name]
        low, high = axis.travel
        inside = 0.0 if axis.rotary else min(self.workspace.clearance, 0.1 * (high - low))
        return low + inside, high - inside

    def home(self, name: str) -> float:
        """Where an axis stands that a test does not use, mm or degree: at 0, or where its `reach` comes nearest to 0."""
        low, high = self.reach(name)
        return min(max(low, 0.0), high)

    @property
    def table_centre(self) -> tuple[float, float]:
        """x and y of the table's centre in the workpiece frame, mm, from where `table_radius` counts.

        As the workspace gives it; else the point of `table_axis` nearest to the workpiece frame's origin with all axes at zero;
        without such an axis that origin.
        """
        if self.workspace.table_centre is not None:
            return self.workspace.table_centre
        if self.table_axis is None:
            return 0.0, 0.0
        axis = self.axes[self.table_axis]
        along = sum(o * d for o, d in zip(axis.origin, axis.direction, strict=True))
        x, y, _ = (o - along * d for o, d in zip(axis.origin, axis.direction, strict=True))
        return x, y

    @property
    def location_errors(self) -> tuple[ErrorTerm, ...]:
        """The location errors the baseline varies."""
        return tuple(term for term in self.errors.values() if term.is_location)

    @property
    def error_motions(self) -> tuple[ErrorTerm, ...]:
        """The error motions the baseline varies."""
        return tuple(term for term in self.errors.values() if not term.is_location)


def check_error(term: ErrorTerm, axes: Mapping[str, Axis]) -> None:
    """Raise `InputError` for an error that no machine with these axes can have."""
    if term.axis not in axes:
        raise unknown_axis(f"error {term.name}", term.axis, axes, remedy=nearest_error(term.name, axes))
    for axis in term.over:
        if axis not in axes:
            raise unknown_axis(f"error {term.name}", axis, axes, "over")
    if term.is_location and not axes[term.axis].rotary and not term.angular:
        problem = f"error {term.name}: a linear axis has no position of its own, only a direction"
        tilts = ", ".join(f"E{c}0{term.axis}" for c in "ABC")
        raise InputError(problem, remedy=f"remove it; {tilts} tilt the direction of travel")


def unknown_axis(owner: str, axis: str | None, axes: Iterable[str], *keys: str, remedy: str = "") -> InputError:
    """What is wrong where `owner` (an error, an effect) names an axis that is none of the machine's `axes`."""
    problem = f"{owner} speaks of axis {shown(axis)}, which the machine lacks"
    return InputError(problem, remedy=remedy or f"use one of {', '.join(axes)}", keys=keys)


def machine_lines(machine: Machine) -> list[str]:
    """Name and structure, axes with their travels, errors with their priors, effects of the model."""
    effects = ", ".join(
        e.effect.replace("_", " ") + ("" if e.axis is None else f" of axis {e.axis}") for e in machine.effects
    )
    return [
        f"machine {machine.name}: {machine.structure.code}",
        f"axes: {', '.join(_axis_words(machine.axes[name]) for name in machine.axis_names)}",
        *_table_lines(machine),
        f"errors, prior 1σ: {', '.join(map(_error_words, machine.errors.values())) or 'none'}",
        *([f"effects in the model: {effects}"] if effects else []),
    ]


def _table_lines(machine: Machine) -> list[str]:
    """Which centre the table's radius counts from."""
    radius, (x, y) = machine.workspace.table_radius, machine.table_centre
    if radius is None:
        return []
    given, axis = machine.workspace.table_centre, machine.table_axis
    source = "table_centre" if given is not None else "the workpiece frame's origin" if axis is None else f"axis {axis}"
    about = f"x = {plain_number(x)}, y = {plain_number(y)} mm of the workpiece frame ({source})"
    return [f"table: plane z = 0, radius {plain_number(radius)} mm about {about}"]


def _axis_words(axis: Axis) -> str:
    if axis.travel == UNREAD:
        return f"{axis.name} (not read)"
    low, high = (f"{v:.9g}".replace("-", "−") for v in axis.travel)
    drive = " with drive" if axis.drive is not None else ""
    return f"{axis.name} {low}…{high} {unit_words(axis.unit)}{drive}"


def _error_words(term: ErrorTerm) -> str:
    bases = (f"{basis} of order {order}" for basis, order in zip(term.basis, term.order, strict=True))
    form = "" if term.is_location else f" ({' × '.join(bases)})"
    over = "" if term.over in ((), (term.axis,)) else f" over {', '.join(term.over)}"
    return f"{term.name}{form}{over} ±{plain_number(term.sigma)} {'µrad' if term.angular else 'µm'}"
