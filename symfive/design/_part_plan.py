"""A plan for a part beside the ordinary one: what both leave of the error along the part's path, in the same time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from symfive.design._digits import six_digits
from symfive.design._part import Expected, Part
from symfive.design._schedule import SETUP_S
from symfive.design._space import Space
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.numbers import plain_number
from symfive.optimal import Task, inverse
from symfive.toolpath import ToolPath, read_tool_path

if TYPE_CHECKING:
    from pathlib import Path

    from symfive.design._plan import Plan


@dataclass(frozen=True)
class Left:
    """What a plan of so many `poses`, `runs` and `minutes` leaves along a part."""

    expected: Expected
    poses: int
    runs: int
    minutes: float

    @classmethod
    def by(cls, plan: Plan, part: Part) -> Left:
        """What a plan leaves."""
        expected = part.left_by(plan.assessment)
        return cls(expected, plan.certificate.points, len(plan.campaign.runs), plan.minutes)

    def words(self) -> str:
        """Its size in words."""
        return f"{self.poses} poses in {self.runs} set-up{'s' if self.runs > 1 else ''}, {self.minutes:.0f} min"


@dataclass(frozen=True)
class PartPlan:
    """The expected error of the tool along `part`: `before` the first reading, with the `ordinary` D plan in the same time
    (`ordinary_plan`), and `after` the plan made for it."""

    part: Part
    before: Expected
    ordinary_plan: Plan
    ordinary: Left
    after: Left

    @property
    def ratio(self) -> float:
        """The worst expected error over that of the ordinary plan."""
        return self.after.expected.worst / self.ordinary.expected.worst

    @property
    def what(self) -> str:
        """What is expected, in one sentence."""
        path = self.part.path
        where = (
            "in the workpiece frame"
            if path.datum is None
            else "relative to the part zero, probed with the rotary axes at 0"
        )
        return (
            f"Part {path.path.name}: expected error of the tool ({path.tool_length:g} mm) {where}, after compensation, 1σ at "
            f"{len(path)} points of its path"
        )

    @property
    def rows(self) -> tuple[tuple[str, Expected], ...]:
        """The expected errors with what leaves them."""
        return (
            ("before the measurement", self.before),
            (f"ordinary D plan ({self.ordinary.words()})", self.ordinary.expected),
            (f"this plan ({self.after.words()})", self.after.expected),
        )

    @property
    def says(self) -> tuple[str, ...]:
        """Sentences for the screen and plan.json."""
        lines = [f"  {name}: {self.part.words(expected)}" for name, expected in self.rows]
        return (f"{self.what}:", *lines, f"  {self.verdict}", *self.part.path.notes)

    @property
    def verdict(self) -> str:
        """How this plan compares with the ordinary one."""
        return f"at the worst point {plain_number(self.ratio)} times the error of the ordinary plan"

    def shown(self) -> dict[str, Any]:
        """What the sheet shows."""
        rows = [
            (name, plain_number(left.worst), plain_number(left.mean), self.part.path.at(left.row))
            for name, left in self.rows
        ]
        return {
            "what": self.what,
            "rows": rows,
            "notes": [f"Expected error of this plan: {self.verdict}.", *self.part.path.notes],
        }

    def to_data(self) -> dict[str, Any]:
        """As written to plan.json."""
        path = self.part.path
        plans = {
            name: self.part.data(left.expected)
            | {"poses": left.poses, "runs": left.runs, "minutes": six_digits(left.minutes)}
            for name, left in (("ordinary_d_plan", self.ordinary), ("this_plan", self.after))
        }
        return {
            "file": path.path.name, "places": len(path), "tool_length_mm": path.tool_length,
            "datum_mm": None if path.datum is None else list(path.datum),
            "before": self.part.data(self.before), **plans, "worst_over_ordinary": six_digits(self.ratio),
        }  # fmt: skip


def part_given(machine: Machine, part: ToolPath | Path | str | None, wanted: tuple[str, ...]) -> Part | None:
    """The part that a plan is for. Raises `InputError` for one with errors named beside it."""
    if part is None:
        return None
    if wanted:
        raise InputError("a part counts every error of the machine", remedy="leave out --for, or --part")
    return Part(machine, part if isinstance(part, ToolPath) else read_tool_path(part, machine))


def mountings_in(minutes: float) -> int:
    """As many set-ups as fit into the time: what they share is averaged by mounting anew."""
    return max(1, int(60.0 * minutes // SETUP_S))


def compared(part: Part, space: Space, task: Task, ordinary: Plan, made: Plan) -> PartPlan:
    """What is expected along the part before, with the ordinary plan, and after the one made for it."""
    places = [[p.name for p in space.shared].index(name) for name in part.names]
    before = part.expected(inverse(task.prior)[np.ix_(places, places)])
    return PartPlan(part, before, ordinary, Left.by(ordinary, part), Left.by(made, part))
