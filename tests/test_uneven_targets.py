"""Targets of ISO 230-2 are uneven so that a screw's pitch shows: a positioning test of them resolves periods below its step."""

from dataclasses import replace

import numpy as np
import pytest
from laser_world import axis_alone, laser_run

from symfive.campaign import Campaign
from symfive.diagnose import Diagnosis, diagnose
from symfive.effects import Tone
from symfive.effects.transmission_error import TransmissionError
from symfive.machine import ErrorTerm

NOISE_UM, PITCH, AMPLITUDE = 0.4, 10.0, 3.0


def campaign(way: np.ndarray) -> Campaign:
    """Positions of an axis with a sine of its screw, read by a laser."""
    rng = np.random.default_rng(4)
    read = AMPLITUDE * np.sin(2.0 * np.pi * way / PITCH + 0.5) + NOISE_UM * rng.standard_normal(len(way))
    return Campaign(machine=axis_alone(-320.0, 320.0), runs=(laser_run("laser", way, read, noise_um=NOISE_UM),))


def diagnosed(targets: np.ndarray) -> Diagnosis:
    """Five cycles up and down."""
    return diagnose(campaign(np.tile(np.concatenate([targets, targets[::-1] - 1e-6]), 5)))


def test_the_pitch_is_found_below_the_step_of_uneven_targets() -> None:
    """Found as a period of 104.2 ± 0.4 mm with eight harmonics above 99.9 %, while no shorter one than 75 mm was looked at."""
    step = 30.0
    targets = -300.0 + step * np.arange(21) + np.random.default_rng(9).uniform(-4.0, 4.0, 21)
    (finding,) = diagnosed(np.round(targets, 2)).findings
    period, amplitude = finding.parameters["period"], finding.parameters["amplitude"]
    assert (finding.name, finding.axis) == ("transmission_error", "X")
    assert period.std < 0.01
    assert period.value == pytest.approx(PITCH, abs=3.0 * period.std)
    assert amplitude.value == pytest.approx(AMPLITUDE, abs=3.0 * amplitude.std)


def test_the_pitch_is_found_beside_errors_that_few_targets_hardly_tell_from_it() -> None:
    """At 11 targets a cubic positioning error takes a third of a sine, of every pitch another share: a wrong one came first, as
    149 mm above 99.9 % beside a step of the scale that is none."""
    targets = -320.0 + 64.0 * np.arange(11) + np.random.default_rng(3).uniform(-15.0, 15.0, 11)
    targets = np.round(np.clip(targets, -320.0, 320.0), 1)
    made = campaign(np.tile(np.concatenate([targets, targets[::-1] - 1e-6]), 5))
    errors = {"EXX": ErrorTerm(name="EXX", sigma=8.0, basis=("polynomial",), order=(3,), over=("X",))}
    (finding,) = diagnose(replace(made, machine=replace(made.machine, errors=errors))).findings
    assert finding.parameters["period"].value == pytest.approx(PITCH, abs=3.0 * finding.parameters["period"].std)


def test_even_targets_say_nothing_of_a_pitch_below_their_step() -> None:
    """At every target of a step of three pitches the screw is in the same place."""
    assert diagnosed(-300.0 + 30.0 * np.arange(21.0)).findings == ()


def test_positions_in_clusters_are_no_targets() -> None:
    """Poses of an arm, some 10 µm apart, were compared with every frequency up to 8 periods a step: a minute."""
    rng = np.random.default_rng(1)
    way = np.repeat(rng.uniform(-300.0, 300.0, 30), 10) + rng.uniform(-0.01, 0.01, 300)
    tone = next(one for one in TransmissionError.candidates(campaign(way)) if isinstance(one, Tone))
    steps = np.abs(np.diff(way))
    assert tone.highest == pytest.approx(1.0 / (2.5 * np.median(steps[steps > 1e-5])))
