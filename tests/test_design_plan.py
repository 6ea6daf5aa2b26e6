"""Plans: what they promise agrees with the model, their certificate holds, what cannot be done is said in one sentence."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from symfive.campaign import Campaign, read_campaign
from symfive.design import Plan, assess, best_ratio, circle_information, discriminate, plan, plan_circles
from symfive.design._certificate import certify
from symfive.design._optimise import value_of
from symfive.design._order import round_trip, there_and_back
from symfive.design._plan import _task
from symfive.design._refine import Rows
from symfive.design._space import make_space
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.machine import Machine, Workspace, preset, presets
from symfive.model import Model
from symfive.procedures import campaign_of, planar_circle, r_test_grid


def _location_only(name: str) -> Machine:
    machine = preset(name)
    return replace(machine, errors={k: v for k, v in machine.errors.items() if v.is_location}, text="")


OYAMA = _location_only("oyama-2010")


@pytest.fixture(scope="module")
def made() -> Plan:
    return plan(OYAMA, points=20, starts=2, returns=2)


def test_certificate_of_twenty_poses(made: Plan) -> None:
    assert made.certificate.efficiency >= 0.99
    assert made.certificate.rigour.startswith("branch and bound")
    assert made.certificate.anywhere is not None and made.certificate.anywhere > 0.8
    assert made.certificate.anywhere <= made.certificate.efficiency
    assert made.certificate.bound <= made.certificate.relaxed + 1e-9 <= made.certificate.value + 2e-9


def test_no_random_plan_beats_the_bound() -> None:
    space = make_space(OYAMA, "r_test")
    task = _task(space, "A", [p.name for p in space.shared], None)
    generator = np.random.default_rng(2)
    z = space.lower + (space.upper - space.lower) * generator.random((4000, len(space.names)))
    z[:, space.poses :] = [1.0, 0.3, 0.9, 1.5]
    z = z[space.feasible(z, np.zeros((len(z), 1)))]
    rows = Rows.of(z[:12], np.zeros((12, 1)), np.zeros(12, dtype=np.int64), space.poses)
    certificate = certify(space, task, rows)
    for _ in range(100):
        some = z[generator.choice(len(z), 12)]
        assert value_of(space, task, replace(rows, z=some)) > certificate.bound


def test_rows_agree_with_the_model(made: Plan) -> None:
    """The kernel that was optimised and the model of the written campaign promise the same uncertainties."""
    space = make_space(OYAMA, "r_test")
    model = Model(made.campaign)
    run = made.campaign.runs[0]
    line = model.linearise(run, model.prior_mean)
    angles = np.radians(np.stack([run.commands["B"], run.commands["C"]], axis=1))
    x, y, h = run.table_ball
    setup = [np.hypot(x, y) / 100.0, np.arctan2(y, x), h / 100.0, -run.tool_ball[2] / 100.0]
    z = np.concatenate([angles, np.tile(setup, (run.rows, 1))], axis=1)
    rows = space.kernel.rows(z, np.zeros((run.rows, 1)))[:, : len(space.shared)]
    index = [line.columns.tolist().index(model.index[p.name]) for p in space.shared]
    expected = line.jacobian[:, :, index] * [p.sigma for p in space.shared] / 0.3
    assert rows.transpose(0, 2, 1) == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_plan_is_a_campaign_with_all_that_is_needed(made: Plan, tmp_path: Path) -> None:
    named = replace(made, machine=replace(OYAMA, name='<script>"x"</script>', text=""))
    named.write(tmp_path / "plan", nc=("iso", "linuxcnc"))
    campaign = read_campaign(tmp_path / "plan")
    assert not campaign.measured and not campaign.notes
    assert campaign.rows == 20 + 2 * len(campaign.runs)
    data = json.loads((tmp_path / "plan" / "plan.json").read_text())
    assert data["schema"] == "symfive.plan/1" and data["certificate"]["efficiency"] >= 0.99
    assert data["expected"]["EX0C"]["std"] < data["expected"]["EX0C"]["prior_std"]
    assert set(data["valuation"]) == {"B", "C"} and min(data["valuation"].values()) > 2.0
    page = (tmp_path / "plan" / "setup.html").read_text()
    assert "<script" not in page and "&lt;script&gt;" in page and "<svg" in page
    for file in ("nc/iso/nest-1.nc", "nc/linuxcnc/nest-1.ngc",
                 "figures/poses-nest-1.svg", "figures/uncertainty.svg", "figures/worth.svg"):  # fmt: skip
        assert (tmp_path / "plan" / file).stat().st_size > 100


def test_plan_is_the_same_every_time() -> None:
    first, again = (plan(OYAMA, points=8, setups=1, starts=1, anywhere=False) for _ in range(2))
    assert json.dumps(again.to_data()) == json.dumps(first.to_data())


def test_return_poses_keep_a_drift_apart(made: Plan) -> None:
    assert made.drift > 0.9
    for run in made.campaign.runs:
        commands = np.stack([run.commands[n] for n in ("B", "C")], axis=1)
        assert np.sum(np.all(commands == commands[0], axis=1)) >= 2 and np.all(commands[-1] == commands[0])


def test_fewer_poses_do_the_work_of_the_usual_grid() -> None:
    """96 chosen poses against the two-nest grid of paper 2 with 168, 8 location errors, the same noise."""
    grid = assess(campaign_of(OYAMA, r_test_grid(OYAMA, returning=False, noise_um=0.3)))
    chosen = plan(OYAMA, points=96, starts=1, returns=0, noise_um=0.3, anywhere=False)
    assert sum(len(worth) for worth in grid.worth.values()) == 168
    assert chosen.assessment.value < grid.value


def test_plan_for_chosen_parameters_and_in_addition_to_a_campaign(made: Plan) -> None:
    for_centre = plan(
        OYAMA, points=8, setups=1, for_=("EX0C", "EY0C"), criterion="A", starts=1, returns=0, anywhere=False
    )
    assert for_centre.interest == ("EX0C", "EY0C")
    more = plan(OYAMA, points=8, setups=1, given=made.campaign, starts=1, returns=0, anywhere=False)
    for name in ("EA0B", "EX0C", "EB0C"):
        assert more.assessment.sigma[name] < made.assessment.sigma[name]


def test_time_budget_and_a_lost_pose() -> None:
    short = plan(OYAMA, points=24, minutes=7.5, setups=1, starts=1, anywhere=False)
    assert short.minutes <= 7.5 and short.certificate.points < 24
    robust = plan(OYAMA, points=7, setups=1, starts=1, survive=True, returns=0, anywhere=False)
    usual = plan(OYAMA, points=7, setups=1, starts=1, returns=0, anywhere=False)
    assert robust.lost * np.exp(-robust.certificate.value) >= usual.lost * np.exp(-usual.certificate.value) * (
        1.0 - 1e-6
    )


def test_ball_bar_plan_chooses_bars_of_the_list() -> None:
    machine = _location_only("wang-li-2016")
    made = plan(machine, instrument="ball_bar", points=20, starts=1, setups=1, anywhere=False)
    assert {run.length for run in made.campaign.runs} <= set(machine.workspace.bar_lengths)
    assert made.certificate.efficiency > 0.7 and "not proved" in made.certificate.rigour
    assert all(np.all(np.diff(run.time) > 0.0) for run in made.campaign.runs)


@pytest.mark.parametrize("name", presets())
def test_every_preset_machine_has_a_space(name: str) -> None:
    machine = preset(name)
    rotary = any(axis.rotary for axis in machine.axes.values())
    for instrument in ("ball_bar", *(("r_test",) if rotary else ())):
        space = make_space(machine, instrument)
        middle = 0.5 * (space.lower + space.upper)[None, :]
        commands = space.commands(middle, np.array([[space.lengths[0]]]))
        assert all(np.isfinite(v).all() for v in commands.values())


@pytest.mark.parametrize(
    ("change", "options", "says"),
    [
        ({"bar_lengths": ()}, {"instrument": "ball_bar"}, "the workspace lists no bar; add bar_lengths"),
        ({"sensor_range": 1e-3}, {}, "leave the sensor_range at every pose; raise sensor_range"),
        ({"tool_length": (900.0, 950.0)}, {}, "travel of Z is in the way everywhere; move the nest or balls"),
        ({}, {"for_": ("EXQ",)}, "has no parameter EXQ; use names such as EX0B"),
        ({}, {"points": 1}, "points = 1 is too few; give at least 2"),
        ({}, {"minutes": 1.0}, "1 minutes are too short"),
        ({}, {"instrument": "laser"}, "plans with laser are not designed; use r_test or ball_bar"),
        ({}, {"criterion": "Q"}, 'criterion "Q" is unknown'),
    ],
)
def test_what_cannot_be_done_is_said_in_one_sentence(
    change: dict[str, object], options: dict[str, object], says: str
) -> None:
    workspace = replace(OYAMA.workspace, **change)  # type: ignore[arg-type]
    with pytest.raises(InputError) as caught:
        plan(replace(OYAMA, workspace=workspace, text=""), starts=1, **options)  # type: ignore[arg-type]
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_a_parameter_that_no_plan_can_see_is_named() -> None:
    machine = preset("oyama-2010")
    term = replace(machine.errors["EX0C"], name="EC0C")
    blind = replace(machine, errors={"EX0C": machine.errors["EX0C"], "EC0C": replace(term, sigma=1e-3)}, text="")
    with pytest.raises(InputError, match="no r_test plan can see EC0C"):
        plan(blind, for_=("EC0C",), starts=1)
    with pytest.raises(InputError, match="no workspace; add"):
        plan(replace(OYAMA, workspace=Workspace(), text=""), starts=1)


def test_orders_visit_every_pose_once() -> None:
    places = np.random.default_rng(0).random((30, 2))
    times = np.linalg.norm(places[:, None] - places[None, :], axis=2)
    order = round_trip(times)
    assert sorted(order.tolist()) == list(range(30)) == sorted(there_and_back(order).tolist())
    length = times[order[:-1], order[1:]].sum()
    assert length < 0.5 * np.mean(
        [times[p[:-1], p[1:]].sum() for p in (np.random.default_rng(i).permutation(30) for i in range(20))]
    )


def test_assessment_names_the_worthless_row() -> None:
    (run,) = r_test_grid(OYAMA, grid={"B": (0.0, 60.0), "C": (0.0, 90.0)}, nests=((80.0, 0.0, 60.0),), returning=False)
    found = assess(Campaign(machine=OYAMA, runs=(run,)))
    assert found.rank < len(found.parameters) and found.confounded
    assert found.run_worth[run.id] > 0.0 and found.worth[run.id].shape == (4,)
    assert found.most()[0] == run.id


TSUTSUMI = preset("tsutsumi-2007")
PLAY = [make_effect("servo_mismatch", "C", gains=("position_gain",)), make_effect("backlash", "C")]


def test_circle_information_over_the_ratio() -> None:
    """Backlash is seen best where C reverses (X_T > r), the servo mismatch about twice as well as at X_T/r = 0.3."""
    found = {u: circle_information(TSUTSUMI, PLAY, ratio=u, radius=50.0, feed=500.0).sigma for u in (0.3, 0.9, 1.25)}
    width, gain = "backlash.C.width", "servo_mismatch.C.position_gain"
    assert found[1.25][width] < 0.5 * found[0.9][width] < found[0.3][width]
    assert found[0.9][gain] < 0.6 * found[0.3][gain]
    best = best_ratio(TSUTSUMI, PLAY[1:], width, radius=50.0, feed=500.0, low=1.1, high=1.6)
    assert best.sigma[width] <= found[1.25][width]


def test_circles_are_chosen_together() -> None:
    chosen = plan_circles(TSUTSUMI, PLAY, count=2, ratios=(0.5, 1.2), feeds=(500.0,))
    assert len(chosen.campaign.runs) == 4 and len({run.id for run in chosen.campaign.runs}) == 4
    assert any(circle.ratio > 1.0 for circle in chosen.circles)
    with pytest.raises(InputError, match="no circle can be run"):
        plan_circles(TSUTSUMI, PLAY, ratios=(0.999,), feeds=(5000.0,))


def test_discrimination_finds_the_test_that_an_expert_would_take() -> None:
    """A bow of Y across X and a scale error of X quadratic in x look alike on one circle (EFFECTS.md 2.2): a repeat tells
    nothing, a circle elsewhere does."""
    machine = preset("three-axis")
    machine = replace(machine, errors={k: v for k, v in machine.errors.items() if v.is_location}, text="")
    options = {"basis": "polynomial", "order": 2}
    here = planar_circle(machine, plane="XY", feed=2000.0, direction="ccw", rate_hz=20.0)
    there = planar_circle(machine, plane="XY", feed=2000.0, direction="ccw", rate_hz=20.0, centre=(0.0, 100.0, 80.0))
    given = Campaign(machine=machine, runs=here)
    bow = Model(given, [make_effect("error_motion", "Y", component="EXY", **options)])
    quadratic = Model(given, [make_effect("error_motion", "X", component="EXX", **options)])
    found = discriminate(bow, quadratic, [here, there])
    assert found.test.runs == there and found.useful
    assert found.separation > 1.5 * found.before
    averaged = discriminate(bow, quadratic, [here, there], draws=2)
    assert averaged.test.runs == there and "separates" in averaged.says
    with pytest.raises(InputError, match="there is no test to choose from"):
        discriminate(bow, quadratic, [])
