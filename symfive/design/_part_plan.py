"""A plan for a part beside the ordinary one: what both leave of the error along the part's path, in the same time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from symfive.design._assessment_data import six_digits
from symfive.design._information import Task, inverse
from symfive.design._part import Expected, Part
from symfive.design._schedule import SETUP_S
from symfive.design._space import Space
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.numbers import plain_number
from symfive.toolpath import ToolPath, read_tool_path

if TYPE_CHECKING:
    from pathlib import Path

    from symfive.design._plan import Plan

__all__ = ["PartPlan", "compared", "mountings_in", "part_given"]


@dataclass(frozen=True)
class PartPlan:
    """The expected error of the tool along `part`: `before` the first reading, with the `ordinary` D plan (`ordinary_facts`:
    its poses, runs and minutes) and `after` this one, of `facts`."""

    part: Part
    before: Expected
    ordinary: Expected
    ordinary_facts: tuple[int, int, float]
    after: Expected
    facts: tuple[int, int, float]

    @property
    def ratio(self) -> float:
        """The worst expected error over that of the ordinary plan."""
        return self.after.worst / self.ordinary.worst

    @property
    def says(self) -> tuple[str, ...]:
        """Sentences for screen, sheet and plan.json."""
        path = self.part.path
        return (
            f"part {path.path.name}: expected error of a tool of {path.tool_length:g} mm in the workpiece frame after compensation, "
            f"1σ, at {len(path)} places of its path:",
            f"  before the measurement: {self.part.words(self.before)}",
            f"  ordinary D plan ({_facts(self.ordinary_facts)}): {self.part.words(self.ordinary)}",
            f"  this plan ({_facts(self.facts)}): {self.part.words(self.after)}, {plain_number(self.ratio)} × the ordinary worst",
            *path.notes,
        )

    def to_data(self) -> dict[str, Any]:
        """As it stands in plan.json."""
        path = self.part.path
        return {
            "file": path.path.name,
            "places": len(path),
            "tool_length_mm": path.tool_length,
            "before": self.part.data(self.before),
            "ordinary_d_plan": self.part.data(self.ordinary) | _numbers(self.ordinary_facts),
            "this_plan": self.part.data(self.after) | _numbers(self.facts),
            "worst_over_ordinary": six_digits(self.ratio),
        }


def _facts(facts: tuple[int, int, float]) -> str:
    poses, runs, minutes = facts
    return f"{poses} poses in {runs} set-up{'s' if runs > 1 else ''}, {minutes:.0f} min"


def _numbers(facts: tuple[int, int, float]) -> dict[str, float]:
    return {"poses": facts[0], "runs": facts[1], "minutes": six_digits(facts[2])}


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
    plain, own = ((p.certificate.points, len(p.campaign.runs), p.minutes) for p in (ordinary, made))
    return PartPlan(part, before, part.left_by(ordinary.assessment), plain, part.left_by(made.assessment), own)
