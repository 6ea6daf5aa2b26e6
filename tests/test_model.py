"""The model against the independent plant: readings, exact sensitivities, first order, effects from the machine file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import plant
import pytest

from symfive.campaign import Campaign, read_campaign
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.machine import EffectEntry, ErrorTerm
from symfive.model import Model
from symfive.motion import drive_response
from symfive.motion._gaps import filled  # a model reads rows, not what it fills in

CAMPAIGNS = Path(__file__).parent / "data" / "campaigns"
ERRORS = ("EX0B", "EZ0B", "EA0B", "EC0B", "EX0C", "EY0C", "EA0C", "EB0C")


@pytest.fixture(scope="module")
def static() -> Campaign:
    return read_campaign(CAMPAIGNS / "static-none" / "fit")


def _plant_readings(campaign: Campaign, run_id: str, errors: dict[str, float]) -> np.ndarray:
    """The R-test of the independent plant: numpy only, exact chain, nominal set-up (µm)."""
    run = campaign.run(run_id)
    structure = campaign.machine.structure.code
    tables = {n: {"origin": list(a.origin)} for n, a in campaign.machine.axes.items()}
    chain = plant.parse_structure(structure, tables)
    command = {n: run.commands[n] * campaign.machine.axes[n].to_internal for n in campaign.machine.axis_names}
    scale = {n: 1e-3 if n[1] in "XYZ" else 1e-6 for n in errors}
    location = {n: v * scale[n] for n, v in errors.items()}
    ball = plant.ball_in_workpiece(chain, command, np.array(run.tool_ball), location, {})
    return (ball - np.array(run.table_ball)) * 1e3


def test_readings_agree_with_the_plant_to_a_nanometre_of_a_nanometre(static):
    model = Model(static)
    rng = np.random.default_rng(0)
    errors = dict(zip(ERRORS, rng.normal(0.0, 50.0, len(ERRORS)), strict=True))
    np.testing.assert_allclose(
        model.predict_run("nest1", errors), _plant_readings(static, "nest1", errors), rtol=0.0, atol=1e-6
    )


def test_sensitivities_agree_with_differences_of_the_plant_to_1e_6(static):
    model = Model(static)
    rng = np.random.default_rng(1)
    errors = dict(zip(ERRORS, rng.normal(0.0, 50.0, len(ERRORS)), strict=True))
    line = model.linearise("nest2", errors)
    for name in ERRORS:
        step = 50.0
        up = _plant_readings(static, "nest2", {**errors, name: errors[name] + step})
        down = _plant_readings(static, "nest2", {**errors, name: errors[name] - step})
        difference = (up - down) / (2.0 * step)
        exact = line.jacobian[:, :, list(line.columns).index(model.index[name])]
        scale = max(np.abs(exact).max(), 1e-12)
        assert np.abs(exact - difference).max() / scale < 1e-6, name


def test_first_order_model_is_the_tangent_of_the_exact_one(static):
    exact, linear = Model(static), Model(static, linear=True)
    line = exact.linearise("nest1", exact.start)
    errors = {"EA0B": 30.0, "EX0C": -20.0, "EC0B": 55.0}
    expected = line.prediction.copy()
    for name, value in errors.items():
        expected += line.jacobian[:, :, list(line.columns).index(exact.index[name])] * value
    np.testing.assert_allclose(linear.predict_run("nest1", errors), expected, atol=1e-9)
    second_order = np.abs(exact.predict_run("nest1", errors) - expected).max()
    assert 1e-6 < second_order < 0.1


def test_baseline_effects_come_from_the_machine_file(static):
    entry = EffectEntry(effect="backlash", axis="C")
    campaign = static.with_machine(replace(static.machine, effects=(entry,)))
    assert "backlash.C.width" in Model(campaign).index
    with pytest.raises(InputError, match="twice"):
        Model(campaign, [make_effect("backlash", "C")])


def test_models_that_ask_for_the_same_function_share_it(static):
    play, other = make_effect("backlash", "C"), make_effect("backlash", "B")
    run = static.runs[0]
    one = Model(static, [play])._function(run)
    assert Model(static, [replace(play, spread=3.0)])._function(run) is one
    assert Model(static, [other])._function(run) is not one
    assert Model(replace(static, machine=replace(static.machine)), [play])._function(run) is not one


def test_short_runs_computed_together_are_those_computed_alone(static):
    """To the last bit, in any order, at values that change, trackers that stand elsewhere among them."""
    nest, runs = static.runs[0], []
    for k in range(12):
        option = {"placement": [100.0 * k, 50.0, -30.0 * k, 1.0 * k, 0.0, 10.0]}
        more = {"instrument": ("tracker",), "options": option} if k % 3 == 0 else {}
        runs.append(
            replace(nest, id=f"run{k}", file=f"run{k}.csv", readings={}, tool_ball=(0.0, 0.0, -150.0 - k), **more)
        )
    model = Model(
        replace(static, runs=tuple(runs)),
        [make_effect("backlash", "C"), make_effect("gravity_sag", "B", component="EZB")],
    )
    rng = np.random.default_rng(4)
    for order in (range(12), (3, 3, 1, 11, 0, 5)):
        values = model.start + 0.1 * rng.normal(size=len(model.parameters))
        for k in order:
            alone, together = (model.linearise(f"run{k}", values, ahead=ahead) for ahead in (False, True))
            assert np.array_equal(alone.columns, together.columns)
            assert np.array_equal(alone.prediction, together.prediction)
            assert np.array_equal(alone.jacobian, together.jacobian)


def test_error_motion_over_two_axes(static):
    term = ErrorTerm(name="EAC", sigma=20.0, over=("B", "C"), basis=("polynomial", "fourier"), order=(2, 1))
    campaign = static.with_machine(replace(static.machine, errors={**static.machine.errors, "EAC": term}))
    names = [n for n in Model(campaign).index if n.startswith("EAC.")]
    assert len(names) == 3 * 3 - 1
    assert "EAC.P2(B)*sin1(C)" in names


def test_the_constant_of_an_error_motion_never_doubles_a_location_error(static):
    errors = {**static.machine.errors}
    errors["EXC"] = ErrorTerm(name="EXC", sigma=5.0, basis=("fourier",), order=(3,))
    errors["EZB"] = ErrorTerm(name="EZB", sigma=5.0, basis=("polynomial",), order=(3,))
    errors["EXB"] = ErrorTerm(name="EXB", sigma=5.0, basis=("bspline",), order=(3,))
    model = Model(static.with_machine(replace(static.machine, errors=errors)))
    line = model.linearise("nest1", model.start)
    constant = line.jacobian[:, :, list(line.columns).index(model.index["EX0B"])].ravel()
    own = [i for i, c in enumerate(line.columns) if model.parameters[c].name.startswith("EXB.")]
    columns = line.jacobian[:, :, own].reshape(-1, len(own))
    left = constant - columns @ np.linalg.lstsq(columns, constant, rcond=None)[0]
    assert np.linalg.norm(left) > 0.2 * np.linalg.norm(constant)


def test_missing_rows_of_a_recording_do_not_shift_the_drive(static):
    campaign = read_campaign(CAMPAIGNS / "dynamic-none" / "fit")
    run = campaign.run("x110-f1600-ccw")
    kept = np.r_[0:400, 403 : run.rows]
    gappy = replace(
        run,
        time=run.time[kept],
        commands={a: c[kept] for a, c in run.commands.items()},
        readings={n: v[kept] for n, v in run.readings.items()},
    )
    whole = Model(replace(campaign, runs=(run,)))
    part = Model(replace(campaign, runs=(gappy,)))
    assert np.abs(whole.predict_run(run, whole.start)[kept] - part.predict_run(gappy, part.start)).max() < 0.02


def test_drive_against_the_plants_fine_integration():
    gains = {"position_gain": 40.0, "velocity_gain": 260.0, "integral_time": 0.05, "viscous": 8.0, "feedforward": 0.3}
    time = np.arange(1000) * 0.01
    command = 50.0 * np.sin(0.8 * time)
    motion = drive_response(command, 0.01, gains, ())
    expected = plant.follow(plant.Drive(**gains), command, 0.01)
    assert np.abs(motion[:, 0, 0] - expected.x).max() < 1e-9


def test_an_axis_with_friction_sticks_and_its_sensitivities_hold():
    gains = {"position_gain": 40.0, "velocity_gain": 260.0, "integral_time": 0.05, "viscous": 8.0, "feedforward": 0.0}
    time = np.arange(600) * 0.01
    command = 20.0 * np.sin(time)
    motion = drive_response(command, 0.01, {**gains, "coulomb": 150.0}, ("coulomb",))
    expected = (
        plant.follow(plant.Drive(**gains, friction=plant.Friction(coulomb=150.0)), command, 0.01)
        if ("friction" in plant.Drive.__dataclass_fields__)
        else None
    )
    step = 0.5
    up = drive_response(command, 0.01, {**gains, "coulomb": 150.0 + step}, ("coulomb",))[:, 0, 0]
    down = drive_response(command, 0.01, {**gains, "coulomb": 150.0 - step}, ("coulomb",))[:, 0, 0]
    error = np.abs((up - down) / (2 * step) - motion[:, 0, 1])
    assert np.quantile(error, 0.98) < 1e-6 * np.abs(motion[:, 0, 1]).max() + 1e-12
    assert (np.abs(motion[:, 1, 0]) < 1e-9).sum() >= 2
    if expected is not None:
        assert np.abs(motion[:, 0, 0] - expected.x).max() < 1e-3


LOOP_GAINS = {"position_gain": 40.0, "velocity_gain": 260.0, "integral_time": 0.05, "viscous": 8.0, "feedforward": 0.3}
RUBBING = [
    {"coulomb": 150.0},
    {"coulomb": 100.0, "stiction": 30.0, "stribeck_speed": 2.0},
    {"coulomb": 70.0, "stiction": 30.0, "stribeck_speed": 2.0, "pre_sliding": 7e-4},
]


@pytest.mark.parametrize("friction", RUBBING, ids=["coulomb", "stribeck", "lugre"])
def test_rows_in_closed_form_are_those_of_substeps(monkeypatch, friction):
    """Where an axis slides at its full force the loop is linear: the same to rounding, values and derivatives."""
    from symfive.motion import _friction  # the closed form switched off

    command = 100.0 * np.sin(0.7 * 0.004 * np.arange(1200))
    wanted = ("position_gain", *friction)
    fast = drive_response(command, 0.004, {**LOOP_GAINS, **friction}, wanted)
    slid = []
    monkeypatch.setattr(_friction._Rows, "slide", lambda self, first: slid.append(first) or first)
    slow = drive_response(command, 0.004, {**LOOP_GAINS, **friction}, wanted)
    assert slid
    assert np.abs(fast - slow).max(axis=0) == pytest.approx(0.0, abs=1e-9 * np.abs(slow).max())


@pytest.mark.parametrize("friction", RUBBING, ids=["coulomb", "stribeck", "lugre"])
def test_derivatives_of_a_rubbing_axis_are_those_of_differences(friction):
    """But where it starts and stops to slide: there the rows of a difference jump."""
    command = 60.0 * np.sin(0.01 * np.arange(700))
    wanted = ("velocity_gain", *friction)
    given = {**LOOP_GAINS, **friction}
    exact = drive_response(command, 0.01, given, wanted)
    for i, name in enumerate(wanted):
        step = 1e-5 * given[name]
        up, down = (drive_response(command, 0.01, {**given, name: given[name] + d}, ())[:, :, 0] for d in (step, -step))
        difference = (up - down) / (2.0 * step)
        error = np.abs(difference - exact[:, :, 1 + i]) / np.abs(difference).max(axis=0)
        assert np.quantile(error, 0.98) < 1e-4, name


@pytest.mark.parametrize("way", [1e-6, 1e-5, 4e-5, 2e-4])
def test_a_contact_too_stiff_to_be_seen_still_has_a_slope_towards_a_softer_one(way):
    """Substeps of 1 ms follow no stiffness above 0.5/ms²: 25 rad/s² over 50 µrad. A search begun there must not stand still."""
    command = 0.5 * np.sin(0.01 * np.arange(700))
    given = {**LOOP_GAINS, "coulomb": 25.0, "stiction": 5.0, "stribeck_speed": 0.02, "pre_sliding": way}
    slope = drive_response(command, 0.01, given, ("pre_sliding",))[:, 0, 1]
    away = drive_response(command, 0.01, {**given, "pre_sliding": 1.1 * way}, ())[:, 0, 0]
    stiff = drive_response(command, 0.01, given, ())[:, 0, 0]
    predicted = slope * 0.1 * way
    assert np.abs(predicted).max() > 0.0
    assert predicted @ (away - stiff) > 0.9 * np.linalg.norm(predicted) * np.linalg.norm(away - stiff)


@pytest.mark.parametrize("stiffness", [1e4, 1e5, 1e6])
def test_a_contact_that_yields_against_the_plants_fine_integration(stiffness):
    """The plant's LuGre friction in substeps of 0.1 ms, its damping that of C. Canudas de Wit et al. 1995."""
    time = np.arange(1500) * 0.004
    command = 100.0 * np.sin(0.7 * time)
    friction = {"coulomb": 70.0, "stiction": 30.0, "stribeck_speed": 2.0}
    motion = drive_response(command, 0.004, {**LOOP_GAINS, **friction, "pre_sliding": 70.0 / stiffness}, ())
    rubs = plant.Friction(
        coulomb=70.0, breakaway=100.0, stribeck_speed=2.0, stiffness=stiffness, damping=stiffness**0.5
    )
    expected = plant.follow(plant.Drive(**LOOP_GAINS, friction=rubs), command, 0.004)
    without = drive_response(command, 0.004, LOOP_GAINS, ())
    left = np.abs(motion[:, 0, 0] - expected.x).max()
    assert left < 0.03 * np.abs(without[:, 0, 0] - expected.x).max()


def test_rows_that_the_recorder_lost_are_filled_smoothly_and_round_corners():
    """A programme that stops abruptly: a spline over all rows misses by a row's whole way where the stop was lost."""
    time = 0.03 * np.arange(657)
    command = 100.0 * np.sin(0.33 * np.minimum(time, 19.3))
    for first, count, most in ((300, 3, 1e-4), (640, 2, 0.05), (642, 4, 0.05), (646, 3, 1e-9)):
        steps = np.delete(np.arange(657), np.arange(first, first + count))
        assert np.abs(filled(steps, command[steps]) - command).max() < most, first


def test_rows_lost_while_an_axis_accelerates_are_filled_along_its_ramp():
    """A steady acceleration is no corner, however much the speed changes over the gap."""
    time = 0.03 * np.arange(60)
    ramp = 70.0 * np.where(time < 0.6, time**2, 1.2 * time - 0.36)
    for first in (4, 8, 12, 30):
        steps = np.delete(np.arange(60), [first, first + 4])
        assert np.abs(filled(steps, ramp[steps]) - ramp).max() < 1e-9, first


def test_names_and_vectors_are_checked(static):
    model = Model(static)
    with pytest.raises(InputError, match='no parameter "EX0Q"'):
        model.predict({"EX0Q": 1.0})
    with pytest.raises(InputError, match="values for"):
        model.predict(np.zeros(3))
    with pytest.raises(InputError, match="needs the drive"):
        Model(static, [make_effect("servo_mismatch", "C")])
