"""Geometry and set-up far beyond their stated priors: an effect, which may have any size, is not named for that."""

from __future__ import annotations

from functools import cache

import numpy as np
from laser_world import laser_run

from symfive.campaign import Campaign
from symfive.diagnose import Diagnosis, diagnose
from symfive.machine import preset
from symfive.model import Model
from symfive.posterior import baseline, log_priors, widened
from symfive.procedures import campaign_of, planar_circle, r_test_grid
from symfive.simulate import simulate

TABLE = preset("table-bc")


@cache
def table_elsewhere(off_um: float) -> Campaign:
    """An R-test in two nests; the axis of C is so far from where the machine file has it, within ±50 µm (1σ)."""
    plan = campaign_of(TABLE, r_test_grid(TABLE, step_deg=45.0))
    exact = dict.fromkeys((p.name for p in Model(plan).parameters), 0.0)
    return simulate(plan, truth=exact | {"EX0C": off_um}, seed=1).campaign


def laser_test(ppm: float) -> Diagnosis:
    """Five cycles of 15 targets on X, a backlash of 1.6 µm, noise as declared."""
    machine, rng = preset("three-axis"), np.random.default_rng(9)
    up = np.linspace(-350.0, 350.0, 15)
    way = np.tile(np.concatenate([up, up[::-1] - 1e-6]), 5)
    side = np.tile(np.repeat([1.0, -1.0], 15), 5)
    read = 1e-3 * ppm * way - 0.8 * side + rng.normal(0.0, 0.2, way.size)
    held = {axis: np.zeros(way.size) for axis in "YZ"}
    run = laser_run("x", way, read, commands={"X": way, **held}, noise_um=0.2, clock="none")
    return diagnose(Campaign(machine=machine, runs=(run,)))


def test_priors_are_as_wide_as_the_errors() -> None:
    stated = table_elsewhere(1500.0)
    wide = widened(baseline(stated), stated)
    wider = {name: term.sigma / TABLE.errors[name].sigma for name, term in wide.machine.errors.items()}
    assert wider.pop("EX0C") == 30.0 and set(wider.values()) == {1.0}
    assert [run.setup_sigma_um for run in wide.runs] == [run.setup_sigma_um for run in stated.runs]
    assert -8.0 < log_priors(wide, stated) < 0.0
    assert widened(baseline(wide), stated) is wide


def test_priors_are_as_stated_where_the_errors_are() -> None:
    stated = table_elsewhere(60.0)
    assert widened(baseline(stated), stated) is stated
    assert log_priors(stated, stated) == 0.0


def test_a_ball_far_off_its_place_widens_its_own_prior_alone() -> None:
    plan = campaign_of(TABLE, planar_circle(TABLE, rate_hz=5.0))
    exact = dict.fromkeys((p.name for p in Model(plan).parameters), 0.0)
    first, second = plan.runs
    stated = simulate(plan, truth=exact | {f"setup.{first.id}.table_ball.x": 400.0}, seed=1).campaign
    wide = widened(baseline(stated), stated)
    assert wide.run(first.id).setup_sigma_um.table_ball + wide.run(first.id).setup_sigma_um.tool_ball > 200.0
    assert wide.run(second.id).setup_sigma_um == second.setup_sigma_um
    assert wide.machine.errors == TABLE.errors


def test_an_axis_far_from_its_stated_place_is_no_noise() -> None:
    """The distance from the prior had been taken for noise, 2.5 times that of the data sheet."""
    found = diagnose(table_elsewhere(1500.0))
    assert not found.findings and "EX0C is 30" in found.doubts[0]
    assert found.noise_um < 1.1 * table_elsewhere(1500.0).runs[0].noise_um


def test_a_large_pitch_error_is_no_further_effect() -> None:
    """An unidentified effect had been found with 99.9 % beside the backlash: it brought EXX nearer to its prior."""
    (finding,) = laser_test(600.0).findings
    assert (finding.name, finding.axis) == ("backlash", "X")
    width = finding.parameters["width"]
    assert abs(width.value - 1.6) < 3.0 * width.std
