"""A screw's periodic error: the paper's readings every 5 mm fall on one phase of a 5 mm screw. Denser ones, and what is found."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from symfive.campaign import Campaign
from symfive.diagnose import Diagnosis, Finding, diagnose
from symfive.procedures import campaign_of

from .machine import grid_tests, measured
from .plates import OF_X, only_x

LEAD_MM, SIZE_UM = 5.0, 3.0
"""The paper's pitch of the screw, and the amplitude of the periodic error."""


@dataclass(frozen=True)
class Screw:
    """Line 1 along X read every 5 mm as in the paper, and every 2 mm: what the diagnosis finds in each."""

    paper: Diagnosis
    denser: Diagnosis

    @property
    def named(self) -> Finding | None:
        """The periodic error, where the denser line shows it."""
        return next((f for f in self.denser.findings if f.name == "transmission_error" and f.axis == "X"), None)


def screw(*, seed: int = 3) -> Screw:
    """Measure by the plant and diagnose."""
    return Screw(*(diagnose(_recorded(pitch, seed)) for pitch in (5.0, 2.0)))


def _recorded(pitch: float, seed: int) -> Campaign:
    machine = only_x()
    line = tuple(run for run in grid_tests(machine, pitch=pitch) if run.id.startswith("x-line1"))
    campaign = campaign_of(machine, line, f"line 1 every {pitch:g} mm")
    # where X is when it is commanded to x
    there = {
        run.id: run.commands["X"] + 1e-3 * SIZE_UM * np.sin(2.0 * np.pi * run.commands["X"] / LEAD_MM) for run in line
    }
    moved = replace(campaign, runs=tuple(replace(r, commands={**r.commands, "X": there[r.id]}) for r in campaign.runs))
    seen = measured(moved, OF_X, seed=seed)
    return replace(
        campaign, runs=tuple(r.with_readings(s.readings) for r, s in zip(campaign.runs, seen.runs, strict=True))
    )
