"""Contacts in motion: the slope of a play that begins at a flank, and the rows from which on an axis counts as turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from symfive.campaign import Run
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


@pytest.mark.parametrize("late", [0.1, 0.4, 0.9])
def test_an_axis_has_turned_where_it_stood_still_between_two_rows(late: float) -> None:
    machine = preset("three-axis")
    machine = replace(machine, axes={name: replace(axis, drive=None) for name, axis in machine.axes.items()})
    [plan, *_] = planar_circle(machine, plane="XY", feed=1000.0, rate_hz=20.0)
    angle = np.radians(
        np.arange(10.0, 350.0, 2.0) + 2.0 * (1.0 - late)
    )  # X turns at 180 degrees, `late` in its interval
    place = plan.commands["X"].mean(), plan.commands["Y"].mean()
    commands = {name: np.full(len(angle), way[0]) for name, way in plan.commands.items()}
    commands |= {"X": place[0] + 50.0 * np.cos(angle), "Y": place[1] + 50.0 * np.sin(angle)}
    run: Run = replace(plan, time=0.05 * np.arange(len(angle)), commands=commands, readings={}, length=50.0)
    model = Model(campaign_of(machine, [run]), [make_effect("lateral_play", component="EYX")])
    moved = model.predict_run(run.id, model.vector({"lateral_play.EYX.width": 10.0}))[:, 0]
    moved = (moved - model.predict_run(run.id, model.prior_mean)[:, 0]) / np.sin(angle)
    np.testing.assert_array_equal(np.sign(moved), np.sign(moved[0]) * np.sign(np.sin(angle)))
