"""Faults far from the usual size of a machine tool's, and of a course that no single body has."""

import numpy as np
import pytest
from laser_world import laser_run

from symfive.campaign import Campaign, Run
from symfive.diagnose import Diagnosis, diagnose
from symfive.machine import machine_from_data

SERVO = machine_from_data(
    {"schema": "symfive.machine/1", "name": "servo", "structure": "w C' b t", "axes": {"C": {"travel": [-20.0, 20.0]}}}
)
STAGE = machine_from_data(
    {"schema": "symfive.machine/1", "name": "stage", "structure": "w b X t", "axes": {"X": {"travel": [-100.0, 100.0]}}}
)
COLUMN = machine_from_data(
    {"schema": "symfive.machine/1", "name": "column", "structure": "w b Z t", "axes": {"Z": {"travel": [0.0, 300.0]}}}
)


def _stops_short(size: float) -> Diagnosis:
    """A rotary axis that stops `size` µrad short from either side, seen at 1 m by a sensor along its circle."""
    ways = np.tile([0.0, 8.0, 0.0, -8.0], 3)
    noise = np.random.default_rng(5).normal(0.0, 0.03 * size, len(ways))
    came = np.sign(np.diff(ways, prepend=-1.0))
    run = Run(
        id="stops", instrument=("displacement",), sampling="static", time=np.arange(len(ways), dtype=float),
        commands={"C": ways}, readings={"s1_um": -0.5 * size * came + noise}, noise_um=0.03 * size,
        options={"sensors": [{"direction": [0.0, -1.0, 0.0], "position": [1000.0, 0.0, 0.0]}]},
    )  # fmt: skip
    return diagnose(Campaign(machine=SERVO, runs=(run,)))


@pytest.mark.parametrize(
    "size", [17000.0, 17.0, *(pytest.param(size, marks=pytest.mark.slow) for size in (1700.0, 170.0))]
)
def test_backlash_is_found_at_any_size(size: float) -> None:
    """A servo that misses a degree was no backlash: the width of its prior was guessed from what the usual one leaves."""
    (found,) = _stops_short(size).findings
    assert (found.name, found.axis) == ("backlash", "C")
    assert found.confidence > 0.7
    assert abs(found.parameters["width"].value) == pytest.approx(size, rel=0.1)


@pytest.mark.parametrize(
    ("sign", "word"),
    [(1.0, "reduce the backlash compensation"),
     pytest.param(-1.0, "enter it as backlash compensation", marks=pytest.mark.slow)],
)  # fmt: skip
def test_an_axis_that_goes_too_far_is_not_advised_to_be_compensated_more(sign: float, word: str) -> None:
    """A negative width: the compensation in the control is too large."""
    ways = np.tile(np.r_[np.arange(-80.0, 81.0, 40.0), np.arange(80.0, -81.0, -40.0) - 1e-6], 4)
    came = np.sign(np.diff(ways, prepend=-120.0))  # 80 mm is read from both sides, as after an overrun
    readings = sign * came + np.random.default_rng(2).normal(0.0, 0.1, len(ways))
    run = laser_run("laser", ways, readings, time=4.0 * np.arange(len(ways)), noise_um=0.1)
    result = diagnose(Campaign(machine=STAGE, runs=(run,)))
    (found,) = result.findings
    assert found.name == "backlash"
    assert word in " ".join(str(result).split())


@pytest.mark.slow
def test_two_bodies_that_grow_in_opposite_ways_are_one_drift() -> None:
    """A bed warms up in minutes and its frame later: the straight line that was found first left a third of it."""
    time = np.repeat(60.0 * np.arange(44.0), 3) + np.tile([0.0, 4.0, 8.0], 44)
    rises = [size * (1.0 - np.exp(-time / tau)) for size, tau in ((450.0, 280.0), (-600.0, 900.0))]
    read = sum(rises) + np.random.default_rng(3).normal(0.0, 1.5, len(time))
    run = laser_run("standing", np.zeros(len(time)), read, "Z", time=time, noise_um=1.5)
    result = diagnose(Campaign(machine=COLUMN, runs=(run,)))
    (found,) = result.findings
    assert found.name == "thermal_drift"
    assert result.fit.rms_after_um < 2.0
    assert found.parameters["time_constant_s"].value == pytest.approx(280.0, rel=0.2)
    assert found.parameters["slow_time_constant_s"].value == pytest.approx(900.0, rel=0.2)


@pytest.mark.parametrize("sampling", ["dynamic", pytest.param("static", marks=pytest.mark.slow)])
def test_a_recording_in_which_nothing_moves_is_diagnosed(sampling: str) -> None:
    """The next test was planned at the feed of axes that stand: a traceback, and nothing was written."""
    time = 2.0 * np.arange(200.0)
    drift = 80.0 * (1.0 - np.exp(-time / 150.0)) + np.random.default_rng(8).normal(0.0, 1.0, len(time))
    run = laser_run("standing", np.zeros(len(time)), drift, "Z", sampling=sampling, time=time, noise_um=1.0)
    (found,) = diagnose(Campaign(machine=COLUMN, runs=(run,))).findings
    assert found.coordinate == "t"


def test_a_run_without_an_unknown_of_its_own_is_diagnosed() -> None:
    """An encoder whose zero is known: a table without columns was folded, a traceback."""
    time = 0.02 * np.arange(300.0)
    ways = 10.0 * np.sin(1.3 * time)
    noise = np.random.default_rng(9).normal(0.0, 0.001, len(time))
    run = Run(
        id="servo", instrument=("encoder",), sampling="dynamic", time=time, commands={"C": ways},
        readings={"C_act_deg": ways + noise}, noise_um=0.001, options={"encoder_axes": ["C"]},
    )  # fmt: skip
    assert not diagnose(Campaign(machine=SERVO, runs=(run,))).findings
