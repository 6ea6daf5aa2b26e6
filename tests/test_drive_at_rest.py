"""A drive that stands between its motions: friction holds it there with any force up to its level.

Force and motion are written by Newton's law; no part of symfive writes them.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from laser_world import axis_alone

from symfive.campaign import Campaign, Run
from symfive.diagnose import amend, diagnose
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.identify import fitted_model, identify, predict
from symfive.model import read_model, write_model
from symfive.posterior import baseline

RATE, NOISE = 32.0, 0.3
MASS, VISCOUS, COULOMB, OFFSET = 95.0, 200.0, 20.0, -3.0


def motion() -> tuple[np.ndarray, np.ndarray]:
    """Time (N,) s and position (N,) mm: moves of 0.8 s to and fro (polynomials of order 7), 0.5 s of rest after
    each."""
    goals = np.tile([0.0, 200.0, 40.0, 160.0, 10.0, 120.0], 2)
    time = np.arange(int(1.3 * (len(goals) - 1) * RATE)) / RATE
    number = np.minimum((time / 1.3).astype(int), len(goals) - 2)
    x = np.minimum((time - 1.3 * number) / 0.8, 1.0)
    share = x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)
    return time, goals[number] + share * (goals[number + 1] - goals[number])


def recorded(seed: int = 0, periodic: tuple[float, float] = (0.0, 1.0), **more: str) -> Campaign:
    """Drive force and encoder of one axis, `more` options; `periodic`: amplitude N and frequency Hz of a force in time that the
    drive holds."""
    rng = np.random.default_rng(seed)
    time, position = motion()
    speed = np.gradient(position, time)
    force = MASS * 1e-3 * np.gradient(speed, time) + VISCOUS * 1e-3 * speed + COULOMB * np.sign(speed) + OFFSET
    rests = np.abs(speed) < 1e-9
    stands = np.cumsum(np.diff(rests.astype(int), prepend=0) == 1)
    held = rng.uniform(-COULOMB, COULOMB, stands.max() + 1)  # what friction holds in each rest
    force = np.where(rests, held[stands], force) + periodic[0] * np.sin(2.0 * np.pi * periodic[1] * time + 0.4)
    run = Run(
        id="moves", instrument=("encoder", "drive_force"), sampling="dynamic", time=time, commands={"X": position},
        readings={"X_act_mm": position, "X_force_N": force + NOISE * rng.standard_normal(len(time))},
        noise_um={"encoder": 1e-4, "drive_force": NOISE},
        options={"axis": "X", "encoder_axes": ["X"], "motion_from": "encoder"} | more,
    )  # fmt: skip
    return Campaign(machine=axis_alone(-50.0, 350.0), runs=(run,))


def test_what_friction_holds_at_rest_may_count_nowhere() -> None:
    campaign = recorded(at_rest="ignored")
    fit = identify(campaign)
    true = {"mass": MASS, "viscous": VISCOUS, "coulomb": COULOMB, "offset": OFFSET}
    for name, value in true.items():
        assert fit[f"drive_force.X.{name}"] == pytest.approx(value, rel=0.01)
    assert fit.chi2_dof < 2.0 and not fit.outliers
    speed = np.abs(np.gradient(campaign.runs[0].commands["X"], campaign.runs[0].time))
    (note,) = (note for note in fit.notes if "at rest" in note)
    assert abs(int(note.split()[2]) - int(np.sum(speed < 0.1))) <= 2 * 11
    counted = identify(recorded())
    assert counted.chi2_dof > 100.0
    assert any('at_rest = "ignored" leaves them out' in note for note in counted.notes)


def test_a_residual_far_above_the_noise_spends_no_degrees_of_freedom() -> None:
    """χ²/dof of the plain model under the declared noise: mean square of the residual over that of the noise."""
    campaign = recorded()
    fit = baseline(campaign)
    assert not fit.outliers and fit.dof == pytest.approx(campaign.rows - len(fit.model.parameters), abs=0.1)
    left = fit.residuals["moves"][:, 1]
    assert fit.chi2_dof == pytest.approx(np.sum(left**2) / NOISE**2 / fit.dof)
    assert not [note for note in fit.notes if "no more readings than parameters" in note]


def test_a_drive_that_only_holds_reads_what_it_holds() -> None:
    run = recorded().runs[0]
    still = np.full(run.rows, 20.0)
    rng = np.random.default_rng(1)
    rests = replace(
        run, commands={"X": still},
        readings={"X_act_mm": still, "X_force_N": OFFSET + NOISE * rng.standard_normal(run.rows)},
    )  # fmt: skip
    fit = identify(Campaign(machine=recorded().machine, runs=(rests,)))
    assert fit["drive_force.X.offset"] == pytest.approx(OFFSET, abs=0.1)
    assert not [note for note in fit.notes if "at rest" in note]


def test_a_force_of_the_opposite_sign_is_noted() -> None:
    campaign = recorded(at_rest="ignored")
    run = campaign.runs[0]
    readings = {**run.readings, "X_force_N": -run.readings["X_force_N"]}
    notes = identify(replace(campaign, runs=(run.with_readings(readings),))).notes
    assert any("drive_force.X.mass is -95" in note and "reversed in sign" in note for note in notes)
    assert not any("reversed in sign" in note for note in identify(campaign).notes)


@pytest.mark.parametrize(("jitter", "noted"), [(0.0, False), (0.05, True)])
def test_uneven_times_are_noted_and_lost_rows_are_not(jitter: float, noted: bool) -> None:
    """Times of arrival 5 % of a row off: the mass comes out too small."""
    campaign = recorded(at_rest="ignored")
    run = campaign.runs[0]
    kept = np.delete(np.arange(run.rows), [100, 101, 230])
    time = run.time[kept] + jitter / RATE * np.random.default_rng(1).standard_normal(len(kept))
    readings = {name: values[kept] for name, values in run.readings.items()}
    part = replace(run, time=time - time[0], commands={"X": run.commands["X"][kept]}, readings=readings)
    fit = identify(replace(campaign, runs=(part,)))
    assert any("the times of the rows are uneven" in note for note in fit.notes) is noted
    assert (fit["drive_force.X.mass"] < 0.98 * MASS) is noted


def test_what_friction_holds_at_rest_is_found_where_it_counts() -> None:
    """Each rest has its force; the friction of the moving axis, biased before (15 N), is then right."""
    found = diagnose(recorded(seed=0))
    (held,) = found.findings
    assert held.title == "Friction of axis X at rest"
    assert (held.name, held.axis, held.effect.key) == (
        "friction",
        "X",
        "held_friction.X.each",
    ) and held.confidence > 0.99
    forces = np.random.default_rng(0).uniform(-COULOMB, COULOMB, 12)[1:]
    largest = np.max(np.abs(forces - OFFSET))
    hold = held.parameters["largest_hold"]
    assert held.parameters["rests"].value == 11 and hold.unit == "N"
    assert abs(abs(hold.value) - largest) < 0.3 and hold.std < 0.15
    true = {"mass": MASS, "viscous": VISCOUS, "coulomb": COULOMB, "offset": OFFSET}
    for name, value in true.items():
        fitted, std = found.after[f"drive_force.X.{name}"], found.after.uncertainty(f"drive_force.X.{name}")
        assert abs(fitted - value) < 3.0 * std and std < 0.05 * abs(value)


def test_friction_that_stays_as_the_axis_came_to_rest_has_a_side() -> None:
    made = recorded()
    run = made.runs[0]
    position, force = run.commands["X"], np.array(run.readings["X_force_N"])
    speed = np.gradient(position, run.time)
    rests = np.abs(speed) < 1e-9
    last = np.maximum.accumulate(np.where(rests, 0, np.arange(run.rows)))  # the row at which it last moved
    force[rests] = (
        14.0 * np.sign(speed[last[rests]]) + OFFSET + NOISE * np.random.default_rng(4).standard_normal(rests.sum())
    )
    readings = {**run.readings, "X_force_N": force}
    plain = baseline(replace(made, runs=(run.with_readings(readings),)))
    fit = amend(plain, make_effect("held_friction", "X").prepare(plain.model.campaign))
    assert fit["held_friction.X.hold"] == pytest.approx(14.0, abs=0.3)
    assert fit.rms_kept["N"] < 2.0 * NOISE and plain.rms_kept["N"] > 10.0 * NOISE


@pytest.mark.slow
def test_friction_at_rest_and_in_motion_act_together() -> None:
    """Readings whose baseline has no friction need both."""
    made = recorded()
    (run,) = made.runs
    bare = replace(made, runs=(replace(run, options={**run.options, "force_terms": ("mass", "viscous")}),))
    found = {f.effect.key: f for f in diagnose(bare).findings}
    assert set(found) == {"force_friction.X", "held_friction.X.each"}
    assert found["force_friction.X"].parameters["coulomb"].value == pytest.approx(COULOMB, abs=0.5)


def test_a_drive_that_never_rests_holds_nothing() -> None:
    run = recorded().runs[0]
    moving = replace(run, commands={"X": 100.0 * np.sin(run.time)}, options={"axis": "X"})
    with pytest.raises(InputError, match="axis X never rests between motions"):
        make_effect("held_friction", "X").prepare(Campaign(machine=recorded().machine, runs=(moving,)))
    ignored = recorded(at_rest="ignored")
    with pytest.raises(InputError, match="never rests"):
        make_effect("held_friction", "X").prepare(ignored)


def test_rest_is_no_fault_of_a_drive() -> None:
    assert not diagnose(recorded(seed=2, at_rest="ignored")).findings


def test_a_periodic_force_in_time_is_a_vibration_with_its_frequency() -> None:
    (found,) = diagnose(recorded(seed=3, periodic=(1.5, 7.3), at_rest="ignored")).findings
    assert (found.name, found.axis) == ("vibration", "X") and found.confidence > 0.9
    assert found.parameters["frequency_hz"].value == pytest.approx(7.3, abs=0.01)
    amplitude = found.parameters["amplitude"]
    assert amplitude.unit == "N" and amplitude.value == pytest.approx(1.5, abs=4.0 * float(amplitude.std))


def test_a_force_vibration_needs_a_drives_force() -> None:
    effect = make_effect("force_vibration", "X", frequency_hz=7.3).prepare(recorded())
    assert effect.applies(recorded().runs[0])
    bare = replace(recorded().runs[0], instrument=("encoder",), options={}, readings={}, noise_um={"encoder": 1.0})
    with pytest.raises(Exception, match="no run records the drive force of X"):
        make_effect("force_vibration", "X", frequency_hz=7.3).prepare(
            Campaign(machine=recorded().machine, runs=(bare,))
        )


def test_the_rests_of_a_diagnosis_survive_the_disk(tmp_path: Path) -> None:
    campaign = recorded()
    effect = make_effect("held_friction", "X", shape="each").prepare(campaign)
    fit = amend(identify(campaign), effect)
    write_model(fitted_model(fit), tmp_path / "model.json")
    again = read_model(tmp_path / "model.json")
    assert again.effects == (effect,)
    assert predict(again, campaign).rms["moves"] == pytest.approx(fit.rms["N"], rel=1e-6)
