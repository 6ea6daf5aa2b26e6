"""One axis of a machine and its drive, in the units of the machine file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from symfive.errors import InputError
from symfive.files import shown
from symfive.machine._structure import DEFAULT_DIRECTION, default_kind
from symfive.validation import finite, freeze, numbers, one_of, positive

Vector = tuple[float, float, float]
UNREAD = (-1e9, 1e9)
"""What stands for the travel of an axis whose table is wrong."""


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
        object.__setattr__(self, "extra", freeze(self.extra))
        gains = {name: getattr(self, name) for name in ("position_gain", "velocity_gain", "integral_time")}
        positive("drive", **gains)
        finite("drive", viscous=self.viscous, feedforward=self.feedforward)
        if self.viscous < 0.0:
            problem = f"drive: viscous = {self.viscous} is negative"
            raise InputError(problem, remedy="write 1/s, at least 0", keys=("viscous",))
        if not 0.0 <= self.feedforward <= 1.5:
            problem = f"drive: feedforward = {self.feedforward} is not a share"
            raise InputError(problem, remedy="write 0.0 to 1.0", keys=("feedforward",))


@dataclass(frozen=True, kw_only=True)
class Axis:
    """One axis of the machine: direction, origin, travel and limits of motion.

    `direction` unit vector, `origin` a point on a rotary axis in mm, `travel` in mm or degree, `max_feed` in
    mm/min or degree/min, `max_acceleration` in mm/s² or degree/s².
    """

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
        object.__setattr__(self, "extra", freeze(self.extra))
        owner = f"axis {self.name}"
        one_of(owner, "kind", self.kind, ("linear", "rotary"))
        for name in ("direction", "origin"):
            numbers(owner, name, getattr(self, name), 3, example="[x, y, z]")
        norm = math.hypot(*self.direction)
        if not 1e-9 < norm < 1e150:
            problem = f"{owner}: direction {list(self.direction)} has no usable length"
            raise InputError(problem, remedy="write a vector such as [0.0, 1.0, 1.0]", keys=("direction",))
        if abs(norm - 1.0) > 1e-15:
            object.__setattr__(self, "direction", tuple(v / norm for v in self.direction))
        numbers(owner, "travel", self.travel, 2, example="[lowest, highest]")
        if self.travel[0] >= self.travel[1]:
            problem = f"{owner}: travel {list(self.travel)} is not ascending"
            raise InputError(problem, remedy="write [lowest, highest]", keys=("travel",))
        positive(owner, max_feed=self.max_feed, max_acceleration=self.max_acceleration)

    @property
    def rotary(self) -> bool:
        """Whether the axis turns."""
        return self.kind == "rotary"

    @property
    def unit(self) -> str:
        """The unit of its coordinate in files: `mm` or `deg`."""
        return "deg" if self.rotary else "mm"

    @property
    def error_unit(self) -> str:
        """The unit of deviations along (about) it: `um` or `urad`."""
        return "urad" if self.rotary else "um"

    @property
    def to_internal(self) -> float:
        """Factor from file unit to internal unit (mm, rad)."""
        return math.pi / 180.0 if self.rotary else 1.0

    @property
    def column(self) -> str:
        """Its command column in a run's CSV, as `X_mm` or `B_deg`."""
        return f"{self.name}_{self.unit}"


def make_axis(name: str, **fields: Any) -> Axis:
    """An `Axis` whose kind and direction default to what its letter means (ISO 841), travel to ±1000 mm or
    ±360°."""
    kind = fields.pop("kind", default_kind(name))
    if kind is None:
        remedy = f'add kind = "linear" or "rotary" to [axes.{name}]'
        raise InputError(f"axis {shown(name)} has no kind", remedy=remedy, keys=("kind",))
    direction = fields.pop("direction", DEFAULT_DIRECTION.get(name))
    if direction is None:
        remedy = f"add direction = [x, y, z] to [axes.{name}]"
        raise InputError(f"axis {shown(name)} has no direction", remedy=remedy, keys=("direction",))
    travel = fields.pop("travel", (-360.0, 360.0) if kind == "rotary" else (-1000.0, 1000.0))
    return Axis(name=name, kind=kind, direction=direction, travel=travel, **fields)
