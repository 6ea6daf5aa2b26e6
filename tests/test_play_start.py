"""A play that begins at a flank: its slope is that from within, the only side from which it can be approached."""

from __future__ import annotations

import numpy as np
import pytest

from symfive.effects import make_effect
from symfive.machine import preset
from symfive.model import Model
from symfive.procedures import campaign_of, planar_circle


@pytest.mark.parametrize("flank", [-1.0, 1.0])
def test_the_slope_at_a_flank_is_the_one_from_within(flank: float) -> None:
    machine = preset("three-axis")
    plan = campaign_of(machine, planar_circle(machine, plane="XY", feed=1000.0, rate_hz=20.0))
    model = Model(plan, [make_effect("backlash", "X")])
    moved = 0
    for run in plan.runs:
        start = f"setup.{run.id}.backlash.X.start"
        values = model.vector({"backlash.X.width": 8.0, start: flank})
        inside = model.vector({"backlash.X.width": 8.0, start: flank * (1.0 - 1e-4)})
        change = (model.predict_run(run.id, inside) - model.predict_run(run.id, values)) / (-1e-4 * flank)
        line = model.linearise(run, values)
        slope = line.jacobian[:, :, list(line.columns).index(model.index[start])]
        np.testing.assert_allclose(slope, change, atol=2e-2 * max(1.0, float(np.abs(change).max())))
        moved += int(np.abs(change).max() > 1.0)
    assert moved
