"""Where in its play an axis is before it moves: at a flank the slope is that from within, the only side from which it can be
approached."""

from dataclasses import replace

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


@pytest.mark.parametrize("sampling", ["dynamic", "static"])
@pytest.mark.parametrize("shape", ["play", "pre_sliding", "step", "gradual", "wind_up"])
def test_an_axis_that_stands_throughout_a_run_stands_somewhere_in_its_play(shape: str, sampling: str) -> None:
    """Its state there is as unknown as before a first motion: the reading is that of the axis held half the play away."""
    machine = preset("three-axis")
    plan = campaign_of(machine, planar_circle(machine, plane="YZ", feed=1000.0, rate_hz=20.0))
    stands = np.full(plan.runs[0].rows, 2.0)
    run = replace(plan.runs[0], sampling=sampling, commands={**plan.runs[0].commands, "X": stands})
    shifted = replace(run, commands={**run.commands, "X": stands - 0.5 * 0.75 * 8e-3})
    model = Model(replace(plan, runs=(run,)), [make_effect("backlash", "X", shape=shape)])
    values = {"backlash.X.width": 8.0, "backlash.X.slope": 0.0, f"setup.{run.id}.backlash.X.start": 0.75}
    found = model.predict_run(run.id, model.vector({n: v for n, v in values.items() if n in model.index}))
    held = Model(replace(plan, runs=(shifted,)))
    np.testing.assert_allclose(found, held.predict_run(run.id, held.vector({})), atol=1e-6)
    inside = model.vector({"backlash.X.width": 8.0, f"setup.{run.id}.backlash.X.start": 0.75})
    beside = model.vector({"backlash.X.width": 8.0, f"setup.{run.id}.backlash.X.start": 0.7501})
    slope = (model.predict_run(run.id, beside) - model.predict_run(run.id, inside)) / 1e-4
    line = model.linearise(run, inside)
    column = line.jacobian[:, :, list(line.columns).index(model.index[f"setup.{run.id}.backlash.X.start"])]
    np.testing.assert_allclose(column, slope, atol=1e-5)
