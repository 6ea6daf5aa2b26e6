"""What a circular test promises holds on a machine whose position gains are 10 % off, with slow noise."""

from dataclasses import replace

import numpy as np
import pytest
from sweeps_world import measured

from symfive.campaign import read_campaign
from symfive.design import assess, circular_test
from symfive.identify import identify


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    folder = tmp_path_factory.mktemp("circles") / "plan"
    made = circular_test("nutating-table", planes=("XY", "ZX"), radius=100.0, rate_hz=10.0)
    made.write(folder, nc=())
    return made, folder


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_squareness_is_as_well_determined_as_promised(plan, seed):
    made, folder = plan
    sigma = made.assessment.sigma
    told = [p.name for p in made.assessment.parameters if p.kind == "location_error" and sigma[p.name] < 0.5 * p.sigma]
    campaign, truth = measured(folder, seed)
    found = identify(campaign, effects=made.effects)
    off = np.array([(found[name] - truth[name]) / sigma[name] for name in told])
    assert {"EC0X", "EB0Z"} <= set(told)
    assert np.sqrt(np.mean(off**2)) < 2.0 and np.abs(off).max() < 4.0


def test_circles_about_one_ball_share_its_errors(plan):
    """Nobody touches balls and bar between them, so their errors do not average out."""
    made, folder = plan
    assert {tuple(run.mounting.values()) for run in read_campaign(folder).runs} == {("1", "1", "1")}
    anew = tuple(replace(run, mounting={}) for run in made.campaign.runs)
    other = assess(replace(made.campaign, runs=anew), effects=made.effects, noise=made.noise).sigma
    assert max(made.assessment.sigma[name] / size for name, size in other.items() if "setup" not in name) > 1.1


def test_the_plan_says_with_what_to_identify(plan):
    made, _ = plan
    data = made.to_data()
    assert data["noise"] == {"white_um": 0.3, "coloured_um": 0.3, "correlation_s": 1.0}
    assert {effect["effect"] for effect in data["effects"]} == {"servo_mismatch"}
    assert any("--effects plan.json" in note for note in data["notes"])
