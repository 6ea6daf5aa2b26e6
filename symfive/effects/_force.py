"""What effects in the recorded force of a drive share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symfive.effects._base import DRIVE, Effect
from symfive.effects._form import Form, Forms
from symfive.instruments.drive_force import DriveForce, driven_axis
from symfive.runs import Campaign, Run

FORCE_SHARE = 0.05
"""The share of a drive's force (rms) that a term is expected to have."""


def driven_axes(campaign: Campaign) -> tuple[str, ...]:
    """The axes whose drive force is recorded, by name."""
    return tuple(sorted({axis for run in campaign.runs if (axis := driven_axis(run)) is not None}))


def usual_force(campaign: Campaign, axis: str, share: float) -> float:
    """A share of the rms of the recorded force of an axis, N or Nm; 1 in a plan."""
    force, machine = DriveForce(), campaign.machine
    runs = [run for run in campaign.runs if driven_axis(run) == axis]
    seen = [(run, column.name) for run in runs for column in force.columns(run, machine)]
    read = [run.readings[name] for run, name in seen if name in run.readings]
    return share * float(np.sqrt(np.mean(np.concatenate(read) ** 2))) if read else 1.0


@dataclass(frozen=True, kw_only=True)
class ForceEffect(Effect):
    """An effect in the recording of an axis' drive force; by itself, one form for every axis whose force is recorded."""

    stage = "reading"
    acts_in = DRIVE
    needs_axis = True

    def _seen(self, run: Run) -> bool:
        """Whether a run records the force that it changes."""
        return driven_axis(run) == self.axis

    def applies(self, run: Run) -> bool:
        return super().applies(run) and self._seen(run)

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        yield from (Form(effect=cls(axis=axis)) for axis in driven_axes(campaign))
