"""Expected information of a plan: by integration over one parameter on a grid, and where the readings are linear."""

import numpy as np
import pytest
from lean import varying

from symfive.campaign import Campaign
from symfive.design import Information, circle_information, expected_information
from symfive.effects import Effect, make_effect
from symfive.errors import InputError
from symfive.machine import preset
from symfive.model import Model
from symfive.procedures import campaign_of

MACHINE = preset("tsutsumi-2007")
LEAN = varying(MACHINE, "EC0Y", "EX0C", "EY0C")
PLAY = "backlash.C.width"


def planned(effects: list[Effect], noise_um: float) -> Campaign:
    circle = circle_information(LEAN, effects, ratio=1.2, radius=50.0, feed=1500.0, noise_um=noise_um, rate_hz=6.0)
    return campaign_of(LEAN, list(circle.runs), "circles")


def inside(value: float, found: Information, more: float = 0.0) -> bool:
    (low, low_error), (high, high_error) = found.lower, found.upper
    return low - 3.0 * low_error - more < value < high + 3.0 * high_error + more


def on_a_grid(plan: Campaign, effect: Effect, draws: int) -> tuple[float, float]:
    """Information about the play, nats, and its standard error: the play on a grid, dense covariance of all else."""
    model, random = Model(plan, [effect]), np.random.default_rng(5)
    prior = model.parameters[model.index[PLAY]]
    grid = np.linspace(-5.0, 5.0, 401) * prior.sigma

    def at(width: float) -> np.ndarray:
        vector = model.vector({PLAY: width})
        return np.concatenate([(model.predict_run(run, vector) / model.noise(run)).ravel() for run in plan.runs])

    readings = np.stack([at(width) for width in grid])
    covariance = np.eye(readings.shape[1])
    typical, step = model.vector(effect.typical(plan)), 1e-3
    for number, other in enumerate(model.parameters):
        if other.name != PLAY:
            up, down = typical.copy(), typical.copy()
            up[number] += step * other.sigma
            down[number] -= step * other.sigma
            ways = [
                np.concatenate([(model.predict_run(r, v) / model.noise(r)).ravel() for r in plan.runs])
                for v in (up, down)
            ]
            slope = (ways[0] - ways[1]) / (2.0 * step)
            covariance += np.outer(slope, slope)
    root = np.linalg.cholesky(covariance)
    white = np.linalg.solve(root, readings.T).T
    weight = np.exp(-0.5 * (grid / prior.sigma) ** 2)
    weight /= weight.sum()
    terms = []
    for truth in random.choice(len(grid), size=draws, p=weight):
        y = white[truth] + random.standard_normal(white.shape[1])
        logs = -0.5 * np.sum((y - white) ** 2, axis=1)
        terms.append(logs[truth] - np.log(np.sum(weight * np.exp(logs - logs.max()))) - logs.max())
    return float(np.mean(terms)), float(np.std(terms) / np.sqrt(draws))


@pytest.mark.parametrize("noise_um", [0.5, 10.0])
def test_the_bounds_hold_what_integration_over_a_grid_gives(noise_um: float) -> None:
    play = make_effect("backlash", "C")
    plan = planned([play], noise_um)
    found = expected_information(plan, [play], draws=24, samples=8)
    value, error = on_a_grid(plan, play, 2000)
    assert inside(value, found, 3.0 * error)
    assert found.upper[0] - found.lower[0] < 0.2
    assert 0.0 < found.lower[1] < 0.4 and error < 0.05


def test_where_readings_are_linear_one_guess_is_all() -> None:
    """Ball centre of the table, sought beside its location errors: the closed form is right then."""
    play = make_effect("backlash", "C")
    plan = planned([play], 2.0)
    found = expected_information(plan, [play], for_=["EX0C", "EY0C"], draws=24, samples=8)
    assert inside(found.linear, found)
    assert found.parameters == ("EX0C", "EY0C") and found.linear > 0.5


def test_more_samples_bring_the_bounds_together() -> None:
    effects = [make_effect("servo_mismatch", "C", gains=("position_gain",)), make_effect("backlash", "C")]
    plan = planned(effects, 5.0)
    few, many = (expected_information(plan, effects, draws=8, samples=samples) for samples in (2, 32))
    assert many.upper[0] - many.lower[0] < 0.5 * (few.upper[0] - few.lower[0])
    assert few.linear == many.linear


def test_an_unknown_parameter_is_refused() -> None:
    play = make_effect("backlash", "C")
    plan = planned([play], 1.0)
    with pytest.raises(InputError, match=r"there is no parameter backlash\.Q"):
        expected_information(plan, [play], for_=["backlash.Q"])
    with pytest.raises(InputError, match="at least 2"):
        expected_information(plan, [play], draws=1)
