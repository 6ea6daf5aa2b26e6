"""A plate laid with a little yaw: (10) reads it as roll. What the joint estimate and the diagnosis say of the same readings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from symfive.diagnose import Diagnosis, diagnose
from symfive.identify import Identification, identify
from symfive.machine import Machine
from symfive.procedures import campaign_of

from .estimators import six_motions
from .machine import grid_tests, measured, paper_machine, readings_of

YAW_URAD = 60.0
"""Yaw of the plate under the second line, µrad."""
OF_X = {"EXX.P2": 4.0, "EYX.P2": 3.0, "EZX.P3": -2.0, "EBX.P1": 12.0, "ECX.P1": -9.0}
"""Error motions of X, µm and µrad: straightness, pitch and yaw, but no roll."""


@dataclass(frozen=True)
class Yawed:
    """Lines along X on a machine that does not roll, `YAW_URAD` of yaw in one plate.

    `false_roll` by (10) at the ends of the line, µrad; `believed` and `diagnosis`: plates taken as aligned; `known` with
    their orientation as an unknown of the set-up.
    """

    false_roll: float
    believed: Identification
    diagnosis: Diagnosis
    known: Identification
    clean: Diagnosis

    @property
    def says(self) -> tuple[str, ...]:
        """What the joint estimate cannot distinguish from roll."""
        return tuple(c.words for c in self.known.confounded if any(name.startswith("EAX") for name in c.names))


def yawed(*, pitch: float = 10.0, seed: int = 3) -> Yawed:
    """Measure and evaluate; the truth is `OF_X`."""
    machine = only_x()
    runs = tuple(run for run in grid_tests(machine, pitch=pitch) if run.id.startswith("x-line"))
    campaign = campaign_of(machine, runs, "plates")
    truth = OF_X | {"setup.x-line2-xy.plate.c": YAW_URAD}
    readings = measured(campaign, truth, seed=seed)
    aligned = replace(
        readings, runs=tuple(replace(r, setup_sigma_um=replace(r.setup_sigma_um, plate=0.0)) for r in readings.runs)
    )
    exact, nominal = (readings_of(campaign, {n: np.array([v]) for n, v in t.items()}, 1) for t in (truth, {}))
    found = six_motions(campaign, "X", {run: y - nominal[run] for run, y in exact.items()})
    roll = 1e6 * found[0, :, 3]
    believed = diagnose(aligned)
    return Yawed(float(np.abs(roll).max()), believed.before, believed, identify(readings), diagnose(readings))


def only_x() -> Machine:
    """The paper's machine with the errors of X alone."""
    machine = paper_machine()
    return replace(machine, errors={name: term for name, term in machine.errors.items() if term.axis == "X"})
