"""What one run's simulation carries from stage to stage; every effect is a function that changes it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .chain import COMPONENTS, Array, Axis, Chain
from .drives import Drive

Spec = Mapping[str, Any]
"""One effect as plain data: FORMATS.md section 7 keys plus `form`; magnitudes in um, urad, ms, Hz."""

UM = 1e-3
"""mm per um."""
URAD = 1e-6
"""rad per urad."""


@dataclass
class RunState:
    """Poses, errors and set-up of one run inside the plant (mm, rad, s), N instants."""

    chain: Chain
    travel: dict[str, float]
    run_id: str
    dynamic: bool
    t: Array
    clock: Array
    command: dict[str, Array]
    drives: dict[str, Drive]
    rng: np.random.Generator
    table_ball: Array
    tool_ball: Array
    length: Array
    x: dict[str, Array] = field(default_factory=dict)
    v: dict[str, Array] = field(default_factory=dict)
    a: dict[str, Array] = field(default_factory=dict)
    encoder: dict[str, Array] = field(default_factory=dict)
    location: dict[str, Array] = field(default_factory=dict)
    motion: dict[str, Array] = field(default_factory=dict)
    tool_shift: Array = field(default_factory=lambda: np.zeros(3))
    gain: Array = field(default_factory=lambda: np.eye(3))
    sensor: list[Spec] = field(default_factory=list)
    delay_s: float | Array = 0.0
    low_pass_hz: float = 0.0

    @property
    def dt(self) -> float:
        """Row spacing in s."""
        return float(self.t[1] - self.t[0])

    def axis(self, name: str) -> Axis:
        """The axis of that name."""
        return self.chain.axis(name)

    def small(self, name: str) -> float:
        """mm per um of a linear axis, rad per urad of a rotary axis: the unit of its magnitudes."""
        return URAD if self.axis(name).rotary else UM

    def coordinate(self, name: str, values: Array | None = None) -> Array:
        """The axis' coordinate in file units (mm or degree)."""
        q = self.x[name] if values is None else values
        return np.rad2deg(q) if self.axis(name).rotary else q

    def approach(self, name: str) -> Array:
        """Sign of the last motion of the axis at each instant, (N,); rows before the first motion count like
        it.
        """
        return last_sign(self.x[name])

    def add_motion(self, component: str, value: Array) -> None:
        """Adds `value` (N,), um or urad, to an error motion such as ``EYX``."""
        name, index = component[2:], COMPONENTS.index(component[:2])
        rows = self.motion.setdefault(name, np.zeros((len(self.t), 6)))
        rows[:, index] += np.asarray(value) * (UM if index < 3 else URAD)

    def shift_tool(self, direction: Array | list[float], value: Array) -> None:
        """Moves the tool relative to the table by `value` (N,) um along `direction`, machine frame."""
        unit = np.asarray(direction, float)
        self.tool_shift = self.tool_shift + UM * np.asarray(value)[:, None] * unit / np.linalg.norm(unit)


def last_sign(x: Array, dead: float = 1e-9) -> Array:
    """Sign of the last motion larger than `dead`, (N,); all +1 if nothing ever moves."""
    step = np.diff(x, prepend=x[:1])
    moved = np.where(np.abs(step) > dead, np.sign(step), 0.0)
    index = np.maximum.accumulate(np.where(moved != 0.0, np.arange(len(x)), -1))
    first = moved[moved != 0.0][:1]
    return np.where(index >= 0, moved[index], first[0] if len(first) else 1.0)


def since_reversal(x: Array, sign: Array) -> Array:
    """Distance travelled since the last reversal, (N,), in the unit of `x`."""
    turned = np.flatnonzero(np.diff(sign, prepend=sign[:1]) != 0.0) - 1
    start = np.zeros(len(x), int)
    start[turned + 1] = turned
    return np.abs(x - x[np.maximum.accumulate(start)])
