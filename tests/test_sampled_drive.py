"""A drive whose loop is not quite what the machine file states, as that of a control that samples."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import plant
import pytest
from plant.campaign import machine_toml

from symfive.arrays import Array
from symfive.campaign import Campaign, Run
from symfive.diagnose import diagnose
from symfive.effects import make_effect
from symfive.identify import identify
from symfive.machine import read_machine

FINE_S, SAMPLE_S, ROW_S, NOISE_UM = 1e-4, 1e-3, 0.01, 0.2
RADIUS, FEED, RAMP = 80.0, 50.0, 3000.0
GAINS = {"position_gain": 45.0, "velocity_gain": 280.0, "integral_time": 0.03, "viscous": 4.0, "feedforward": 0.0}


def sampled(command: Array) -> Array:
    """The loop of `GAINS` as a control runs it: every millisecond it reads the position and sets an acceleration."""
    kp, kv, ti, damping, _ = GAINS.values()
    position, speed, integral, pull, way = command[0], 0.0, 0.0, 0.0, np.empty(len(command))
    every = round(SAMPLE_S / FINE_S)
    for i, wanted in enumerate(command):
        if i % every == 0:
            error = kp * (wanted - position) - speed
            pull = kv * (error + integral / ti)
            integral += error * SAMPLE_S
        way[i] = position
        acceleration = pull - damping * speed
        position += speed * FINE_S + 0.5 * acceleration * FINE_S**2
        speed += acceleration * FINE_S
    return way


def circles(folder: Path) -> Campaign:
    """Both ways on a grid encoder, from rest to rest; the machine file states the gains exactly."""
    machine = plant.planar_table()
    for name, axis in machine["axes"].items():
        axis.pop("drive", None)
        if name in "XY":
            axis["drive"] = GAINS
    (folder / "machine.toml").write_text(machine_toml(machine))
    told, rng, runs = read_machine(folder / "machine.toml"), np.random.default_rng(3), list[Run]()
    ramp, length = FEED / RAMP, 2.0 * np.pi * RADIUS
    time = np.arange(-0.3, length / FEED + ramp + 0.3, FINE_S)
    speed = np.clip(np.minimum(time, length / FEED + ramp - time) * RAMP, 0.0, FEED)
    rows = np.arange(37, len(time), round(ROW_S / FINE_S))
    for name, sign in (("ccw", 1.0), ("cw", -1.0)):
        angle = sign * np.cumsum(speed) * FINE_S / RADIUS
        x, y = RADIUS * np.cos(angle), RADIUS * np.sin(angle)
        seen = {"du_um": 1e3 * sampled(x)[rows], "dv_um": 1e3 * sampled(y)[rows]}
        still = {axis: np.zeros(len(rows)) for axis in told.axes}
        runs.append(Run(
            id=name, instrument=("grid_encoder",), sampling="dynamic", time=ROW_S * np.arange(len(rows)),
            commands=still | {"X": x[rows], "Y": y[rows], "Z": np.full(len(rows), 150.0)}, noise_um=NOISE_UM,
            readings={column: way + rng.normal(0.0, NOISE_UM, len(rows)) for column, way in seen.items()},
            tool_ball=(0.0, 0.0, -150.0), u=(1.0, 0.0, 0.0), v=(0.0, 1.0, 0.0), options={"between": "curve"},
        ))  # fmt: skip
    return Campaign(machine=told, runs=tuple(runs))


def test_all_gains_explain_a_sampled_loop_down_to_the_noise(tmp_path: Path) -> None:
    """χ²/dof of 1.039 ± 0.022 by position gain, velocity gain and feed-forward alone, 137 more in χ²."""
    campaign = circles(tmp_path)
    whole, some = (
        identify(campaign, effects=[make_effect("servo_mismatch", axis, **gains) for axis in "XY"], noise="declared")
        for gains in ({}, {"gains": ("position_gain", "velocity_gain", "feedforward")})
    )
    assert whole.chi2_dof == pytest.approx(1.0, abs=0.02)
    assert some.chi2_dof * some.dof > whole.chi2_dof * whole.dof + 100.0


def test_a_finding_lists_the_gains_that_the_readings_determine(tmp_path: Path) -> None:
    campaign = circles(tmp_path)
    mismatch = make_effect("servo_mismatch", "X").prepare(campaign)
    values = {p.name: p.mean for p in mismatch.parameters(campaign)}
    share = {"position_gain": 0.1, "velocity_gain": 0.9, "integral_time": 0.2, "viscous": 0.99, "feedforward": 0.71}
    covariance = {
        (p.name, p.name): (share[p.name.split(".")[-1]] * p.sigma) ** 2 for p in mismatch.parameters(campaign)
    }
    assert list(mismatch.describe(campaign, values, covariance)) == ["position_gain", "integral_time"]
    none = {pair: 100.0 * variance for pair, variance in covariance.items()}
    assert list(mismatch.describe(campaign, values, none)) == list(share)


@pytest.mark.slow
def test_what_sampling_leaves_of_a_stated_loop_is_no_compliance(tmp_path: Path) -> None:
    """An inertial compliance of Y at 99.7 %: integral time and dead time of the loop were not free."""
    found = diagnose(circles(tmp_path))
    assert {f.name for f in found.findings} <= {"servo_mismatch"}
    assert found.fit.rms_after_um == pytest.approx(NOISE_UM, rel=0.05)
