"""A machine as plain data, in the units of the machine file (mm, degree, µm, µrad, s)."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from symfive.errors import InputError
from symfive.machine._structure import DEFAULT_DIRECTION, Structure, default_kind

__all__ = ["Axis", "Drive", "EffectEntry", "ErrorTerm", "Machine", "Workspace"]

Vector = tuple[float, float, float]
_TERM = re.compile(r"E([XYZABC])(0?)([A-Za-z][A-Za-z0-9]*)\Z")
BASES = ("polynomial", "fourier", "bspline")


def _finite(owner: str, **values: float) -> None:
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise InputError(f"{owner}: {name} = {value!r} is not a finite number", remedy="write a number")


def _positive(owner: str, **values: float | None) -> None:
    for name, value in values.items():
        if value is None:
            continue
        _finite(owner, **{name: value})
        if value <= 0.0:
            raise InputError(f"{owner}: {name} = {value} is not positive", remedy="write a number above zero")


def _freeze(extra: Mapping[str, Any]) -> Mapping[str, Any]:
    return MappingProxyType(dict(extra))


@dataclass(frozen=True, kw_only=True)
class Drive:
    """The cascaded position loop of one axis, all gains inertia-normalised (docs: conventions, section 3).

    `position_gain` 1/s, `velocity_gain` 1/s, `integral_time` s, `viscous` 1/s, `feedforward` 0..1.
    """

    position_gain: float
    velocity_gain: float
    integral_time: float
    viscous: float = 0.0
    feedforward: float = 0.0
    extra: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "extra", _freeze(self.extra))
        _positive(
            "drive", position_gain=self.position_gain, velocity_gain=self.velocity_gain, integral_time=self.integral_time
        )
        _finite("drive", viscous=self.viscous, feedforward=self.feedforward)
        if self.viscous < 0.0 or not 0.0 <= self.feedforward <= 1.5:
            raise InputError("drive: viscous must be at least 0 and feedforward from 0 to 1", remedy="correct the value")


@dataclass(frozen=True, kw_only=True)
class Axis:
    """One axis. `direction` unit vector, `origin` a point on a rotary axis in mm, `travel` in mm or degree,
    `max_feed` in mm/min or degree/min, `max_acceleration` in mm/s² or degree/s²."""

    name: str
    kind: str
    direction: Vector
    origin: Vector = (0.0, 0.0, 0.0)
    travel: tuple[float, float]
    max_feed: float | None = None
    max_acceleration: float | None = None
    drive: Drive | None = None
    extra: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "extra", _freeze(self.extra))
        owner = f"axis {self.name}"
        if self.kind not in ("linear", "rotary"):
            raise InputError(f'{owner}: kind "{self.kind}" is unknown', remedy='write kind = "linear" or "rotary"')
        for name in ("direction", "origin"):
            vector = getattr(self, name)
            if len(vector) != 3:
                raise InputError(f"{owner}: {name} has {len(vector)} numbers", remedy="write three")
            _finite(owner, **{f"{name}[{i}]": value for i, value in enumerate(vector)})
        norm = math.sqrt(sum(v * v for v in self.direction))
        if norm < 1e-9:
            raise InputError(f"{owner}: direction has no length", remedy="write a vector such as [0.0, 1.0, 1.0]")
        object.__setattr__(self, "direction", tuple(v / norm for v in self.direction) if abs(norm - 1) > 1e-15 else self.direction)
        if len(self.travel) != 2:
            raise InputError(f"{owner}: travel has {len(self.travel)} numbers", remedy="write [lowest, highest]")
        _finite(owner, lowest=self.travel[0], highest=self.travel[1])
        if self.travel[0] >= self.travel[1]:
            raise InputError(f"{owner}: travel {list(self.travel)} is not ascending", remedy="write [lowest, highest]")
        _positive(owner, max_feed=self.max_feed, max_acceleration=self.max_acceleration)

    @property
    def rotary(self) -> bool:
        """Whether the axis turns."""
        return self.kind == "rotary"

    @property
    def unit(self) -> str:
        """The unit of its coordinate in files: `mm` or `deg`."""
        return "deg" if self.rotary else "mm"

    @property
    def to_internal(self) -> float:
        """Factor from file unit to internal unit (mm, rad)."""
        return math.pi / 180.0 if self.rotary else 1.0

    @property
    def column(self) -> str:
        """Its command column in a run's CSV, as `X_mm` or `B_deg`."""
        return f"{self.name}_{self.unit}"


@dataclass(frozen=True, kw_only=True)
class ErrorTerm:
    """An error that the baseline model may vary: a location error (`EX0C`) or an error motion (`EXC`).

    `sigma` prior standard deviation (µm or µrad, of each coefficient of an error motion), `mean` prior mean,
    `over` the axes of whose coordinates it is a function, `basis` and `order` one entry per axis in `over`,
    `knots` the interior and end knots of a `bspline` basis (mm or degree).
    """

    name: str
    sigma: float
    mean: float = 0.0
    basis: tuple[str, ...] = ()
    order: tuple[int, ...] = ()
    over: tuple[str, ...] = ()
    knots: tuple[tuple[float, ...], ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "extra", _freeze(self.extra))
        match = _TERM.match(self.name)
        if match is None:
            raise InputError(
                f'"{self.name}" is not an error of ISO 230-1', remedy="write EX0C for a location error, EXC for an error motion"
            )
        _positive(self.name, sigma=self.sigma)
        _finite(self.name, mean=self.mean)
        if self.is_location and (self.basis or self.order or self.over):
            raise InputError(f"location error {self.name} takes no basis", remedy=f"write {self.name} = {{ sigma = … }}")
        if self.is_location:
            return
        if not self.over:
            object.__setattr__(self, "over", (self.axis,))
        if not self.basis:
            raise InputError(f"error motion {self.name} has no basis", remedy='add basis = "polynomial" and order = 3')
        if not len(self.basis) == len(self.order) == len(self.over):
            raise InputError(
                f"error motion {self.name}: basis, order and over differ in length", remedy="give one entry per axis in over"
            )
        for basis, order in zip(self.basis, self.order, strict=True):
            if basis not in BASES:
                raise InputError(f'error motion {self.name}: basis "{basis}" is unknown', remedy=f"use one of {', '.join(BASES)}")
            if isinstance(order, bool) or not isinstance(order, int) or not 1 <= order <= 60:
                raise InputError(f"error motion {self.name}: order {order!r} is not a whole number from 1 to 60")

    @property
    def is_location(self) -> bool:
        """Whether it is a location error (position-independent)."""
        match = _TERM.match(self.name)
        return match is not None and match.group(2) == "0"

    @property
    def component(self) -> str:
        """`X Y Z` (a displacement) or `A B C` (a rotation)."""
        return self.name[1]

    @property
    def axis(self) -> str:
        """The axis it belongs to."""
        return self.name[3:] if self.is_location else self.name[2:]

    @property
    def angular(self) -> bool:
        """Whether it is a rotation (µrad) and not a displacement (µm)."""
        return self.component in "ABC"


@dataclass(frozen=True, kw_only=True)
class Workspace:
    """What a measurement plan may use; every field is optional (mm, s)."""

    table_radius: float | None = None
    ball_height: tuple[float, float] | None = None
    tool_length: tuple[float, float] | None = None
    bar_lengths: tuple[float, ...] = ()
    bar_stroke: float = 1.0
    sensor_range: float = 1.0
    seconds_per_pose: float = 6.0
    spindle_nose: Mapping[str, float] | None = None
    extra: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "extra", _freeze(self.extra))
        _positive(
            "workspace",
            table_radius=self.table_radius,
            bar_stroke=self.bar_stroke,
            sensor_range=self.sensor_range,
            seconds_per_pose=self.seconds_per_pose,
            **{f"bar_lengths[{i}]": length for i, length in enumerate(self.bar_lengths)},
        )
        for name in ("ball_height", "tool_length"):
            pair = getattr(self, name)
            if pair is not None and (len(pair) != 2 or pair[0] > pair[1]):
                raise InputError(f"workspace: {name} = {list(pair)} is not [lowest, highest]", remedy="write two numbers")
        if self.spindle_nose is not None:
            object.__setattr__(self, "spindle_nose", _freeze(self.spindle_nose))


@dataclass(frozen=True, kw_only=True)
class EffectEntry:
    """An effect of the vocabulary that the baseline model already holds: its id, axis and further keys."""

    effect: str
    axis: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "options", _freeze(self.options))


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A machine: its structural code, its axes, the errors its baseline model may vary, its workspace.

    Validates itself on construction and raises `InputError`. Vectors are in the machine frame, all axes at zero.
    """

    name: str
    structure: Structure
    axes: Mapping[str, Axis]
    errors: Mapping[str, ErrorTerm] = field(default_factory=dict)
    workspace: Workspace = field(default_factory=Workspace)
    effects: tuple[EffectEntry, ...] = ()
    comments: tuple[str, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        for name in ("axes", "errors", "extra"):
            object.__setattr__(self, name, _freeze(getattr(self, name)))
        for name in self.structure.axes:
            if name not in self.axes:
                raise InputError(
                    f'axis {name} of the structure "{self.structure.code}" has no table', remedy=f"add [axes.{name}] with its travel"
                )
        for name in self.axes:
            if name not in self.structure.axes:
                raise InputError(
                    f'axis {name} is not in the structure "{self.structure.code}"',
                    remedy=f"add it there or remove [axes.{name}]",
                )
        for term in self.errors.values():
            for axis in (term.axis, *term.over):
                if axis not in self.axes:
                    raise InputError(
                        f"error {term.name} speaks of axis {axis}, which the machine lacks",
                        remedy=f"use one of {', '.join(self.structure.axes)}",
                    )
            if term.is_location and not self.axes[term.axis].rotary and not term.angular:
                raise InputError(
                    f"{term.name}: a linear axis has no position of its own, only a direction",
                    remedy=f"remove it; EA0{term.axis}, EB0{term.axis}, EC0{term.axis} tilt the direction of travel",
                )
        for entry in self.effects:
            if entry.axis is not None and entry.axis not in self.axes:
                raise InputError(
                    f"effect {entry.effect} speaks of axis {entry.axis}, which the machine lacks",
                    remedy=f"use one of {', '.join(self.structure.axes)}",
                )

    @property
    def axis_names(self) -> tuple[str, ...]:
        """Every axis from the bed outward, workpiece side first."""
        return self.structure.axes

    @property
    def location_errors(self) -> tuple[ErrorTerm, ...]:
        """The location errors the baseline varies."""
        return tuple(term for term in self.errors.values() if term.is_location)

    @property
    def error_motions(self) -> tuple[ErrorTerm, ...]:
        """The error motions the baseline varies."""
        return tuple(term for term in self.errors.values() if not term.is_location)


def make_axis(name: str, **fields: Any) -> Axis:
    """An `Axis` whose kind and direction default to what its letter means (ISO 841), travel to ±1000 mm or ±360°."""
    kind = fields.pop("kind", None) or default_kind(name)
    if kind is None:
        raise InputError(f"axis {name} has no kind", remedy=f'add kind = "linear" or "rotary" to [axes.{name}]')
    direction = fields.pop("direction", None) or DEFAULT_DIRECTION.get(name)
    if direction is None:
        raise InputError(f"axis {name} has no direction", remedy=f"add direction = [x, y, z] to [axes.{name}]")
    travel = fields.pop("travel", None) or ((-360.0, 360.0) if kind == "rotary" else (-1000.0, 1000.0))
    return Axis(name=name, kind=kind, direction=direction, travel=travel, **fields)
