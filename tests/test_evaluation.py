"""Parameter values at which the model has no readings: said once by the model, taken by every solver as a step too far."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from symfive.campaign import Campaign
from symfive.design import discriminate
from symfive.effects import make_effect
from symfive.errors import EvaluationError
from symfive.identify import identify, predict
from symfive.inference import halved
from symfive.machine import preset
from symfive.model import FittedModel, Model
from symfive.posterior import baseline, fitted, nodes_of
from symfive.procedures import campaign_of, planar_circle
from symfive.simulate import simulate

SERVO = make_effect("servo_mismatch", "X", gains=("position_gain",))
GAIN = "servo_mismatch.X.position_gain"
TRUE, UNSTABLE = {GAIN: 42.0}, {GAIN: 1e4}


@pytest.fixture(scope="module")
def circles() -> Campaign:
    """Two circles with an encoder beside the bar; X has a higher gain than its machine file says, and the bar's clock is late."""
    machine = preset("three-axis")
    drive = replace(machine.axes["X"].drive, velocity_gain=85.0, integral_time=1e-4)  # unstable from twice TRUE on
    machine = replace(machine, axes={**machine.axes, "X": replace(machine.axes["X"], drive=drive)})
    runs = planar_circle(machine, radius=50.0, feed=3000.0)
    plan = campaign_of(machine, [replace(run, instrument=(*run.instrument, "encoder")) for run in runs])
    effects = [SERVO, make_effect("latency")]
    return simulate(plan, truth={**TRUE, "latency.delay_ms": 4.0}, effects=effects, seed=1).campaign


def model_of(circles: Campaign) -> Model:
    return Model(circles, [SERVO, make_effect("latency")])


def test_the_model_says_that_it_has_no_readings(circles: Campaign) -> None:
    model = model_of(circles)
    run = circles.runs[0]
    for evaluate in (model.predict, lambda at: model.linearise(run, at), lambda at: model.predict_run(run, at)):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with pytest.raises(EvaluationError, match=r"cannot be computed at these parameter values; see whether"):
                evaluate(model.vector(UNSTABLE))


def test_slopes_without_readings_to_differentiate_are_refused() -> None:
    """Two balls at one place: the distance is 0, its slope none."""
    machine = preset("three-axis")
    (run,) = planar_circle(machine, direction="ccw")
    still = {axis: np.zeros(run.rows) for axis in run.commands}
    plan = campaign_of(machine, [replace(run, commands=still, table_ball=run.tool_ball)])
    model = Model(plan)
    with pytest.raises(EvaluationError, match="slopes"):
        model.linearise(plan.runs[0], model.start)


def test_an_evaluation_too_far_is_brought_half_way_back_as_often_as_needed() -> None:
    def root(at: np.ndarray) -> float:
        if at[0] > 3.0:
            raise EvaluationError("too far")
        return float(at[0])

    values, found = halved(root, np.array([16.0]), np.array([0.0]))
    assert values == [2.0] and found == 2.0
    with pytest.raises(EvaluationError):
        halved(root, np.array([16.0]), np.array([8.0]))


@pytest.mark.parametrize("solver", ["gauss_newton", "ipopt"])
def test_a_fit_that_begins_where_a_drive_is_unstable_comes_to_the_same_end(circles: Campaign, solver: str) -> None:
    plain = identify(model_of(circles), noise="declared")
    found = identify(model_of(circles), start=UNSTABLE, noise="declared", solver=solver)
    assert found.converged
    for name in (GAIN, "latency.delay_ms"):
        assert abs(found[name] - plain[name]) < 0.05 * plain.uncertainty(name)


@pytest.mark.parametrize("solver", ["gauss_newton", "ipopt"])
def test_a_step_to_where_there_are_no_readings_is_shortened(circles: Campaign, solver: str) -> None:
    """Lag goes with 1/gain: from above, a whole step leads below the true gain."""
    plain = identify(model_of(circles), noise="declared")
    model, refused = model_of(circles), list[float]()
    linearise, gain = model.linearise, model.index[GAIN]

    def fenced(run, values, ahead=False):
        if values[gain] < plain[GAIN] - 2.0 * plain.uncertainty(GAIN):
            refused.append(values[gain])
            raise EvaluationError("too far")
        return linearise(run, values)

    model.linearise = fenced
    found = identify(model, start={GAIN: 80.0}, noise="declared", solver=solver)
    assert refused and found.converged
    assert abs(found[GAIN] - plain[GAIN]) < 0.05 * plain.uncertainty(GAIN)


def test_a_trial_that_begins_where_a_drive_is_unstable_is_weighed_all_the_same(circles: Campaign) -> None:
    """The latency's spline met positions that are not finite."""
    white, model = nodes_of(1.0)[0], model_of(circles)
    steady, far = (fitted(model, [start], white, 1.0, baseline(circles)) for start in (TRUE, UNSTABLE))
    assert far[GAIN] == pytest.approx(steady[GAIN], abs=0.1 * steady.uncertainty(GAIN))
    assert far.chi2_dof == pytest.approx(steady.chi2_dof, rel=1e-3) and far.chi2_dof < 2.0


def test_a_prediction_where_a_drive_is_unstable_is_one_sentence(circles: Campaign) -> None:
    effects = (SERVO,)
    fitted = FittedModel(circles.machine, effects, UNSTABLE, {GAIN: 1.0}, {GAIN: "1/s"}, (GAIN,), np.eye(1))
    with pytest.raises(EvaluationError, match=r"^run .*: the .* cannot be computed"):
        predict(fitted, circles)


def test_tests_between_rivals_do_not_ask_for_unstable_drives(circles: Campaign) -> None:
    plan = replace(circles, runs=tuple(run.with_readings({}) for run in circles.runs))
    rivals = (Model(plan, [effect]) for effect in (SERVO, make_effect("latency")))
    found = discriminate(*rivals, [plan], values_a=UNSTABLE, measured=False)
    assert np.isfinite(found.separation)
