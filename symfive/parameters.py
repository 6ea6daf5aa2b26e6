"""A parameter of the model: its name, unit, prior and bounds, as plain data."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from symfive.errors import InputError
from symfive.numbers import enumerated

UNIT_SCALE = {
    "um": 1e-3, "urad": 1e-6, "mm": 1.0, "deg": math.pi / 180.0, "rad": 1.0, "s": 1.0, "ms": 1e-3, "ppm": 1e-6,
    "deg/s": math.pi / 180.0, "um/mm": 1e-3, "urad/deg": 1e-6 * 180.0 / math.pi, "um/h": 1e-3 / 3600.0,
    "urad/m": 1e-9, "urad/m^2": 1e-12, "um/(m/s^2)": 1e-6, "um/(rad/s^2)": 1e-3,
    "1": 1.0, "1/s": 1.0, "Hz": 1.0, "mm/s": 1.0, "rad/s": 1.0, "mm/s^2": 1.0, "rad/s^2": 1.0,
    "kg": 1.0, "N": 1.0, "N/m": 1.0, "N s/m": 1.0, "kg m^2": 1.0, "Nm": 1.0, "Nm/rad": 1.0, "Nm s/rad": 1.0,
}  # fmt: skip
"""Internal value (mm, rad, s) = scale × value in the file unit, of every unit that a parameter may have."""

SHOWN_OWNERS = 4
"""Runs or mountings that are named of one quantity, at most."""
DETERMINED = 2.0**-0.5
"""The readings determine a parameter whose 1σ is below this share of its prior 1σ."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One unknown. `sigma` and `mean` describe its Gaussian prior in `unit`; `lower` and `upper` are hard bounds. Raises
    `InputError` for a unit without a scale.

    `kind` is `location_error`, `error_motion`, `setup`, `drive`, `instrument` or `effect`; `run` the run or `mounting` the
    mounting of several runs that it belongs to (both None: the machine); `start` where estimation begins if not at the prior
    mean; `called` in words, where its name does not say it, or what says its `quantity` in words when asked.
    """

    name: str
    unit: str
    sigma: float
    mean: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    kind: str = "effect"
    run: str | None = None
    mounting: str | None = None
    start: float | None = None
    called: str | Callable[[str], str] = field(default="", compare=False, repr=False)

    def __post_init__(self) -> None:
        if self.unit not in UNIT_SCALE:
            remedy = f"use one of {', '.join(UNIT_SCALE)}, or give it a scale in symfive.parameters.UNIT_SCALE"
            raise InputError(f"parameter {self.name} has the unit '{self.unit}', which is unknown", remedy=remedy)

    @property
    def what(self) -> str:
        """What it is, in words, without its run: `backlash of axis X (width)`, `EX0C`, `tool ball x`."""
        if callable(self.called):
            return self.called(self.quantity)
        if self.called or not self.of_setup:
            return self.called or self.name
        return self.quantity.replace("_", " ").replace(".", " ")

    @property
    def words(self) -> str:
        """What it is, in a sentence: of set-up as `tool ball x of run nest1` or `… of mounting A`."""
        return said_together([self])[0]

    @property
    def scale(self) -> float:
        """Internal value = scale × value in `unit`."""
        return UNIT_SCALE[self.unit]

    @property
    def of_setup(self) -> bool:
        """Whether it belongs to a run or a mounting, and not to the machine."""
        return self.owner is not None

    @property
    def owner(self) -> str | None:
        """The run or mounting that it belongs to."""
        return self.run if self.mounting is None else self.mounting

    @property
    def owner_words(self) -> str:
        """The run or `mounting …` that it belongs to, as a heading."""
        return str(self.run) if self.mounting is None else f"mounting {self.mounting}"

    @property
    def quantity(self) -> str:
        """Its name without its run or mounting: `tool_ball.x`."""
        return self.name.removeprefix(f"{'setup' if self.mounting is None else 'mounting'}.{self.owner}.")

    def drawn(self, generator: np.random.Generator) -> float:
        """One draw from its prior, kept within its bounds."""
        return min(max(self.mean + self.sigma * generator.standard_normal(), self.lower), self.upper)

    @property
    def initial(self) -> float:
        """Where estimation begins."""
        return self.mean if self.start is None else self.start


def said_together(parameters: Iterable[Parameter]) -> list[str]:
    """Parameters in a sentence; those that differ in their run alone together, as `tool ball x of runs nest1 and nest2`."""
    owners: dict[tuple[str, str], list[str]] = {}
    for p in parameters:
        kind = "" if not p.of_setup else "run" if p.mounting is None else "mounting"
        owners.setdefault((p.what, kind), []).append(str(p.owner))
    said = []
    for (what, kind), names in owners.items():
        more = len(names) - SHOWN_OWNERS + 1
        shown = names if more < 2 else [*names[: SHOWN_OWNERS - 1], f"{more} more"]
        whose = f" of {kind}{'s' if shown[1:] else ''} {enumerated(shown)}"
        said.append(what + (whose if kind else ""))
    return said
