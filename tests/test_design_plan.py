"""Plans: what they promise agrees with the model, their certificate holds, what cannot be done is said in one sentence."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from lean import location_only

from symfive.campaign import Campaign, Run, read_campaign
from symfive.cli import main
from symfive.design import (
    APART,
    Discrimination,
    Plan,
    Separation,
    assess,
    best_ratio,
    circle_information,
    discriminate,
    in_addition,
    in_common,
    plan,
    plan_circles,
    write_test,
)
from symfive.design._candidates import candidates_in, pose_grid
from symfive.design._certificate import certify
from symfive.design._discriminate import _Explained
from symfive.design._optimise import value_of
from symfive.design._pose_table import mounted_before, pose_table
from symfive.design._request import task_of
from symfive.design._robust import over_prior, robust_exchange
from symfive.design._rounding import not_rounded, rounded
from symfive.design._space import Space, make_space
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.machine import Machine, Workspace, preset, presets, write_machine
from symfive.model import Model
from symfive.moves import Clearances, blocked_moves, cleared, kept_apart, out_and_back, round_trip, there_and_back
from symfive.nc import Post, Step, program_steps
from symfive.optimal import Rows
from symfive.procedures import campaign_of, planar_circle, r_test_grid, static_ball_bar

OYAMA = location_only("oyama-2010")


@pytest.fixture(scope="module")
def made() -> Plan:
    return plan(OYAMA, points=20, starts=1, returns=2)


@pytest.fixture(scope="module")
def rounded_plans() -> dict[str, Plan]:
    """A plan for each instrument, with tools of which not every length is allowed."""
    found = {}
    for instrument, name, points in (("r_test", "oyama-2010", 8), ("ball_bar", "wang-li-2016", 14)):
        machine = location_only(name)
        machine = replace(machine, workspace=replace(machine.workspace, tool_length=(110.0, 180.0)), text="")
        options = {"points": points, "setups": 2, "starts": 1, "anywhere": False, "prove": False}
        found[instrument] = plan(machine, instrument=instrument, **options)
    return found


@pytest.mark.slow
def test_certificate_of_twenty_poses(made: Plan) -> None:
    assert made.certificate.efficiency >= 0.99
    assert made.certificate.rigour.startswith("branch and bound")
    assert made.certificate.anywhere is not None and made.certificate.anywhere > 0.8
    assert made.certificate.anywhere <= made.certificate.efficiency
    assert made.certificate.bound <= made.certificate.relaxed + 1e-9 <= made.certificate.value + 2e-9


def test_no_random_plan_beats_the_bound() -> None:
    space = make_space(OYAMA, "r_test")
    task = task_of(space, "A", [p.name for p in space.shared], None)
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
    odd = replace(OYAMA, name='<script>"x"</script>', text="")
    named = replace(made, machine=odd, campaign=made.campaign.with_machine(odd))
    named.write(tmp_path / "plan", nc=("iso", "linuxcnc"))
    campaign = read_campaign(tmp_path / "plan")
    assert not campaign.measured and not campaign.notes
    assert campaign.rows == 20 + 2 * len(campaign.runs)
    data = json.loads((tmp_path / "plan" / "plan.json").read_text())
    assert data["schema"] == "symfive.plan/1" and data["certificate"]["efficiency"] >= 0.99
    assert data["expected"]["EX0C"]["std"] < data["expected"]["EX0C"]["prior_std"]
    assert set(data["valuation"]) == {"B", "C"} and min(data["valuation"].values()) > 2.0
    page = (tmp_path / "plan" / "setup.html").read_text()
    assert page.count("<script") == 1 and "&lt;script&gt;" in page and "<svg" in page
    assert page.count("<caption>The nest</caption>") == len(campaign.runs) == page.count("from axis C")
    assert page.count('<table class="poses-list">') == len(campaign.runs) and "then read dx_um, dy_um, dz_um" in page
    assert page.count("again pose 1, reading 2") == len(campaign.runs), "the return to the first pose"
    assert page.count("within 1 mm: the readings determine its exact place") == len(campaign.runs)
    assert page.count("positive where the tool ball moves towards +x, +y and +z of the workpiece frame") == len(
        campaign.runs
    )
    assert "NOT TESTED: CRADLE AND DRIVES OF C, B, CLAMPS" in (tmp_path / "plan" / "nc/iso/nest-1.nc").read_text()
    for file in ("nc/iso/nest-1.nc", "nc/linuxcnc/nest-1.ngc",
                 "figures/poses-nest-1.svg", "figures/uncertainty.svg", "figures/worth.svg"):  # fmt: skip
        assert (tmp_path / "plan" / file).stat().st_size > 100


def test_the_sheet_says_what_to_mount_again() -> None:
    runs = static_ball_bar(OYAMA)[:2]
    first, second = (replace(r, table_ball=runs[0].table_ball, tool_ball=runs[0].tool_ball, length=100.0) for r in runs)
    campaign = campaign_of(OYAMA, (first, second))
    first, second = campaign.runs
    assert mounted_before(campaign.runs, first) is None and mounted_before(campaign.runs, second) is first
    table = pose_table(campaign, first, Post(unsafe={first.id: (2,)}, dwell_s=3.0))
    assert [row for row, (_, before) in enumerate(table["rows"]) if "remove the bar, mount it again" in before] == [2]
    assert "bar of 100 mm; 3 s at rest, then read dL_um" in table["what"] and len(table["rows"]) == first.rows
    nest = r_test_grid(OYAMA)[0]
    table = pose_table(campaign_of(OYAMA, (nest,)), nest, Post(unsafe={nest.id: (1,)}))
    assert "leaves the nest; seat it again" in table["rows"][1][1]


@pytest.mark.slow
def test_plan_is_the_same_every_time() -> None:
    first, again = (plan(OYAMA, points=8, setups=1, starts=1, anywhere=False) for _ in range(2))
    assert json.dumps(again.to_data()) == json.dumps(first.to_data())


def test_return_poses_keep_a_drift_apart(made: Plan) -> None:
    assert made.drift > 0.9
    for run in made.campaign.runs:
        commands = np.stack([run.commands[n] for n in ("B", "C")], axis=1)
        assert np.sum(np.all(commands == commands[0], axis=1)) >= 2 and np.all(commands[-1] == commands[0])


@pytest.mark.slow
def test_fewer_poses_do_the_work_of_the_usual_grid() -> None:
    """96 chosen poses against the two-nest grid of paper 2 with 168, 8 location errors, the same noise."""
    grid = assess(campaign_of(OYAMA, r_test_grid(OYAMA, returning=False, noise_um=0.3)))
    chosen = plan(OYAMA, points=96, starts=1, returns=0, noise_um=0.3, anywhere=False)
    assert sum(len(worth) for worth in grid.worth.values()) == 168
    assert chosen.assessment.value < grid.value


def test_plan_for_chosen_parameters_and_in_addition_to_a_campaign(made: Plan) -> None:
    for_centre = plan(
        OYAMA,
        points=8,
        setups=1,
        for_=("EX0C", "EY0C"),
        criterion="A",
        starts=1,
        returns=0,
        anywhere=False,
        prove=False,
    )
    assert for_centre.interest == ("EX0C", "EY0C")
    more = plan(OYAMA, points=8, setups=1, given=made.campaign, starts=1, returns=0, anywhere=False, prove=False)
    for name in ("EA0B", "EX0C", "EB0C"):
        assert more.assessment.sigma[name] < made.assessment.sigma[name]


@pytest.mark.slow
def test_time_budget_and_a_lost_pose() -> None:
    short = plan(OYAMA, points=24, minutes=7.5, setups=1, starts=1, anywhere=False)
    assert short.minutes <= 7.5 and short.certificate.points < 24
    robust = plan(OYAMA, points=7, setups=1, starts=1, survive=True, returns=0, anywhere=False)
    usual = plan(OYAMA, points=7, setups=1, starts=1, returns=0, anywhere=False)
    assert robust.lost * np.exp(-robust.certificate.value) >= usual.lost * np.exp(-usual.certificate.value) * (
        1.0 - 1e-6
    )


@pytest.mark.slow
def test_ball_bar_plan_chooses_bars_of_the_list(rounded_plans: dict[str, Plan]) -> None:
    made = rounded_plans["ball_bar"]
    assert {run.length for run in made.campaign.runs} <= set(made.machine.workspace.bar_lengths)
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
        ({}, {"instrument": "laser"}, "plans with laser are not designed; use r_test, touch_probe or ball_bar"),
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
    with pytest.raises(InputError, match="no r_test plan determines EC0C"):
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


@pytest.mark.slow
def test_circle_information_over_the_ratio() -> None:
    """Backlash is seen best where C reverses (X_T > r), the servo mismatch about twice as well as at X_T/r = 0.3."""
    found = {u: circle_information(TSUTSUMI, PLAY, ratio=u, radius=50.0, feed=500.0).sigma for u in (0.3, 0.9, 1.25)}
    width, gain = "backlash.C.width", "servo_mismatch.C.position_gain"
    assert found[1.25][width] < 0.5 * found[0.9][width] < found[0.3][width]
    assert found[0.9][gain] < 0.6 * found[0.3][gain]
    best = best_ratio(TSUTSUMI, PLAY[1:], width, radius=50.0, feed=500.0, low=1.1, high=1.6)
    assert best.sigma[width] <= found[1.25][width]


def test_circles_are_chosen_together() -> None:
    chosen = plan_circles(TSUTSUMI, PLAY, count=2, ratios=(0.5, 1.2), feeds=(500.0,), refine=False, certify=False)
    assert len(chosen.campaign.runs) == 4 and len({run.id for run in chosen.campaign.runs}) == 4
    assert any(circle.ratio > 1.0 for circle in chosen.circles)
    with pytest.raises(InputError, match="no circle can be run"):
        plan_circles(TSUTSUMI, PLAY, ratios=(0.999,), feeds=(5000.0,))


def test_a_rival_whose_steps_lead_beyond_the_readings_is_judged_by_the_best_of_them() -> None:
    """Readings that level off (tanh): whole steps from 3 lead to -98 and 1e84, where no slope is left to solve with."""
    bounds = SimpleNamespace(lower=-np.inf, upper=np.inf)

    def linearise(run: str, values: np.ndarray) -> SimpleNamespace:
        with np.errstate(over="ignore"):
            jacobian = np.array([[[100.0 / np.cosh(values[0]) ** 2]]])
        return SimpleNamespace(prediction=100.0 * np.tanh(values)[None], jacobian=jacobian, columns=np.array([0]))

    readings: Any = SimpleNamespace(
        predict_run=lambda run, truth: np.zeros((1, 1)),
        noise=lambda run: np.ones(1),
        start=np.zeros(1),
        campaign=SimpleNamespace(runs=[SimpleNamespace(id="run")]),
    )
    rival: Any = SimpleNamespace(
        prior_sigma=np.full(1, 1e200), prior_mean=np.zeros(1), start=np.full(1, 3.0), parameters=[bounds],
        linearise=linearise, noise=lambda run: np.ones(1),
    )  # fmt: skip
    assert _Explained(readings, np.zeros(1), rival, {}).left(["run"]) == pytest.approx((100.0 * np.tanh(3.0)) ** 2)


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


def test_a_rival_that_only_the_priors_make_improbable_spoils_no_test_against_the_others():
    """A cubic holds a straight line: nothing parts them, and 3.2σ of prior are no reason to call all tests useless."""
    machine = preset("three-axis")
    runs = [
        replace(run, id=f"t{k}", file=f"t{k}.csv") for k in range(2) for run in planar_circle(machine, direction="ccw")
    ]
    plain = Campaign(machine=machine, runs=tuple(runs), name="plan")

    def part(before: float, *sigmas: float) -> Discrimination:
        table = [Separation(run.id, s, s, s, 1.0) for run, s in zip(runs, sigmas, strict=True)]
        return Discrimination(plain, max(sigmas), before, tuple(sorted(table, key=lambda row: -row.sigmas)))

    both = in_common({"cubic": part(3.2, 3.3, 3.25), "sag": part(3.2, 3.25, 11.0)}, runs)
    assert both.useful and both.test.runs[0].id == "t1"
    assert both.separation == 11.0 and both.before == 3.2
    assert dict(both.each)["sag"] == pytest.approx(10.5, abs=0.05) and dict(both.each)["cubic"] < APART
    assert "sag by 10.5σ" in both.says and "cubic" in both.says
    assert not in_common({"cubic": part(3.2, 3.3, 3.25)}, runs).useful


def test_further_tests_are_those_that_part_what_the_first_leaves():
    machine = preset("three-axis")
    plain = campaign_of(machine, planar_circle(machine, direction="ccw"))

    def part(before: float, **sigmas: float) -> Discrimination:
        table = tuple(Separation(name, s, s, s, 1.0) for name, s in sigmas.items())
        return Discrimination(plain, max(sigmas.values()), before, table)

    one, two, three = part(0.0, a=9.0, b=1.0, c=0.0), part(4.0, a=4.1, b=5.5, c=4.0), part(0.0, a=0.0, b=4.0, c=9.0)
    assert in_addition({"one": one}, "a") == ["a"]
    assert in_addition({"one": one, "two": two, "three": three}, "a") == ["a", "b"]
    assert in_addition({"one": one, "three": three}, "a") == ["a", "c"]
    assert in_addition({"one": one, "known": part(4.0, a=4.5, b=4.9, c=4.0)}, "a") == ["a"]  # 2.8σ more at most


def test_a_further_test_is_a_plan_with_programs_and_a_sheet_that_says_what_it_is_for(tmp_path: Path) -> None:
    asked = campaign_of(preset("three-axis"), planar_circle(preset("three-axis"), direction="ccw"))
    test = Discrimination(asked, 41.2, 2.0, (Separation("xy-ccw", 41.2, 40.0, 42.0, 3.0),))
    write_test(test, tmp_path, nc=("linuxcnc", "heidenhain"))
    assert read_campaign(tmp_path).runs[0].rows == asked.rows
    assert [p.parent.name for p in sorted(tmp_path.glob("nc/*/*"))] == ["heidenhain", "linuxcnc"]
    sheet = (tmp_path / "setup.html").read_text(encoding="utf-8")
    assert "xy-ccw separates the two by 41.2σ" in sheet and "nc/linuxcnc/*.ngc" in sheet
    assert "drive the tool ball there and lock the table ball under it" in sheet and "known to 20 µm (1σ)" in sheet


def test_a_further_test_without_a_clear_way_gets_no_program(tmp_path: Path) -> None:
    """A whole circle in YZ carries the bar through what stands under the table ball: the sheet says so in a program's place."""
    machine = preset("three-axis")
    asked = campaign_of(machine, planar_circle(machine, plane="YZ", sweep_deg=360.0, direction="ccw"))
    write_test(
        Discrimination(asked, 41.2, 2.0, (Separation("yz-ccw", 41.2, 40.0, 42.0, 3.0),)), tmp_path, nc=("linuxcnc",)
    )
    assert not list(tmp_path.glob("nc/*/*"))
    sheet = (tmp_path / "setup.html").read_text(encoding="utf-8")
    assert "No program: run yz-ccw: bar and" in sheet and "along the recording at line" in sheet


@pytest.mark.slow
def test_ninety_poses_for_the_worst_known_direction() -> None:
    """Most poses tell nothing about a single direction: their sensitivity is 0 but for rounding, on either side of it."""
    made = plan(location_only("table-bc"), criterion="E", points=90, setups=1, starts=1, anywhere=False, prove=False)
    assert made.certificate.efficiency > 0.99


# --- what may not meet --------------------------------------------------------------------------------------------


def _low_ball() -> Machine:
    return replace(OYAMA, workspace=replace(OYAMA.workspace, ball_height=(40.0, 160.0)), text="")


def _set_up(space: Space, height: float) -> list[float]:
    return [0.5, 0.0, height / 100.0, 1.5]


def test_a_pose_whose_nose_would_meet_the_table_is_refused() -> None:
    """At B = 90° the nose (radius 40 mm) lies beside the table: its lower edge is 40 mm under the ball."""
    space = make_space(_low_ball(), "r_test")
    z = np.array(
        [[np.radians(b), 0.0, *_set_up(space, height)] for b, height in ((0.0, 45.0), (90.0, 45.0), (90.0, 35.0))]
    )
    limits = space.kernel.limits(z, np.zeros((3, 1)))
    nose = [i for i, name in enumerate(space.limit_names) if name == "spindle nose and table"]
    assert (limits[:, nose].min(axis=1) >= 0.0).tolist() == [True, True, False]
    table, nest = (Clearances(OYAMA, run) for run in _two_runs())
    assert "tool and post" in table.names and "spindle nose and table" in nest.names


def _two_runs() -> tuple[Run, Run]:
    grid = {"B": (-60.0, 60.0), "C": (0.0, 90.0)}
    first, second = r_test_grid(OYAMA, grid=grid, nests=((80.0, 0.0, 60.0), (0.0, 0.0, 120.0)), returning=False)
    return first, second


def test_a_spindle_that_stands_lower_comes_nearer_to_what_is_in_its_way() -> None:
    """Two free poses beside a thick post; 70 mm lower the clearance is smaller."""
    machine = replace(OYAMA, workspace=replace(OYAMA.workspace, post_radius=30.0), text="")
    rest = {"B": np.array([90.0, -90.0]), "C": np.array([0.0, 0.0])}
    run = static_ball_bar(
        machine, poses=rest, direction=((0.0, 0.0, 1.0), (0.0, 0.0, 1.0)), table_balls=((60.0, 0.0, 120.0),), length=100.0,
        seconds_per_pose=60.0,
    )[0]  # fmt: skip
    clear = Clearances(machine, run)
    at_rest = np.stack([run.commands[n] for n in machine.axis_names], axis=1)
    values = clear(at_rest)
    free = [i for i, name in enumerate(clear.names) if name == "tool and post"]
    assert np.all(values[:, free] > 0.0)
    low = replace(run, commands={**run.commands, "Z": run.commands["Z"] - 70.0})
    assert clear(np.stack([low.commands[n] for n in machine.axis_names], axis=1)).min() < values.min()


@pytest.mark.slow
def test_ways_are_clear_or_led_around() -> None:
    """Every move of the programs, sampled again: approach, ways, detours over the top, retract."""
    machine = location_only("tsutsumi-2007")
    made = plan(machine, instrument="ball_bar", points=16, starts=1, anywhere=False, prove=False)
    for run in made.campaign.runs:
        assert not blocked_moves(machine, run, program_steps(machine, run, made.post))


def test_a_way_through_the_table_is_found() -> None:
    """A nest low over the table, at B = -90° and at +90°: both free, but a rapid straight between them meets the table."""
    (run,) = r_test_grid(
        OYAMA, grid={"B": (-90.0, 90.0), "C": (0.0,)}, nests=((0.0, 0.0, 60.0),), returning=False, seconds_per_pose=60.0
    )
    names = OYAMA.axis_names
    ends = [{n: float(run.commands[n][i]) for n in names} for i in range(2)]
    assert Clearances(OYAMA, run)(np.array([[e[n] for n in names] for e in ends])).min() >= 0.0
    straight = [Step(kind="feed", commands=ends[0], towards=0), Step(kind="rapid", commands=ends[1], towards=1)]
    found = blocked_moves(OYAMA, run, straight)
    assert found and found[0][0] == 1
    around = program_steps(OYAMA, run, cleared(OYAMA, (run,), {run.id: (1,)}))
    assert not blocked_moves(OYAMA, run, around)
    named = [set(step.positions) for step in around if step.kind == "rapid"]
    assert named == [{"B", "C"}, {"X", "Y"}, {"Z"}, {"Z"}, {"B"}, {"X"}, {"Z"}, {"B"}]


# --- what the user may decide -------------------------------------------------------------------------------------


@pytest.mark.slow
def test_robust_plans_and_information_per_minute() -> None:
    usual = plan(OYAMA, points=24, starts=1, anywhere=False)
    quick = plan(OYAMA, points=24, starts=1, anywhere=False, per_minute=True)
    assert quick.information_per_minute > usual.information_per_minute and quick.minutes < usual.minutes
    worst = plan(OYAMA, points=8, setups=1, starts=1, returns=0, anywhere=False, robust="worst")
    assert worst.over_prior[1] > 0.99
    with pytest.raises(InputError, match=r"is unknown; use one of nominal, mean, worst"):
        plan(OYAMA, points=8, robust="best")


def test_robust_exchange_lowers_the_worst_case() -> None:
    """On two machines far apart, the worst of them is better off after the exchange, and never worse."""
    spaces = [make_space(replace(OYAMA, errors={"EX0C": OYAMA.errors["EX0C"], "EB0C": replace(OYAMA.errors["EB0C"], mean=m)},
                                 text=""), "r_test") for m in (-4e5, 4e5)]  # fmt: skip
    space = spaces[0]
    task = task_of(space, "D", [p.name for p in space.shared], None)
    grid = candidates_in(space, np.array([_set_up(space, 90.0)]), np.zeros((1, 1)), pose_grid(space, 200))
    rows = Rows.of(grid.z[:5], grid.k[:5], grid.group[:5], space.poses)
    before = over_prior(spaces, task, rows)
    for how, place in (("mean", 0), ("worst", 1)):
        after = over_prior(spaces, task, robust_exchange(spaces, task, rows, grid, how))
        assert after[place] < before[place]


def test_lines_are_counted_as_an_editor_does() -> None:
    (run,) = r_test_grid(OYAMA, grid={"B": (0.0, 60.0), "C": (0.0, 90.0)}, nests=((80.0, 0.0, 60.0),), returning=False)
    found = assess(Campaign(machine=OYAMA, runs=(run,)))
    _, row = found.most()
    assert found.to_data()["tells_most"]["row"] == row + 2
    assert f"line {row + 2} of run {run.id}" in str(found)


def test_a_time_budget_is_used_up() -> None:
    """A budget for two set-ups or for more poses in one: the better of the two is taken, and little time is left over."""
    made = plan(OYAMA, points=80, minutes=9.0, starts=1, anywhere=False, prove=False)
    assert 8.0 <= made.minutes <= 9.0


@pytest.mark.slow
def test_options_of_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_machine(OYAMA, tmp_path / "machine.toml")
    words = [
        "plan",
        tmp_path / "machine.toml",
        "-o",
        tmp_path / "plan",
        "--instrument",
        "ball_bar",
        "--points",
        8,
        "-q",
    ]
    words += ["--setups", 1, "--bar", 120, "--bar", 200, "--repeats", 2, "--returns", 1, "--noise-um", 0.5, "--survive"]
    words += ["--robust", "mean", "--starts", 1, "--nc", "siemens", "--tool-centre-on", "TRAORI"]
    assert main([str(w) for w in [*words, "--tool-centre-off", "TRAFOOF", "--reversed", "C", "--json"]]) == 0
    assert json.loads(capsys.readouterr().out)["certificate"]["poses"] == 8
    campaign = read_campaign(tmp_path / "plan")
    (run,) = campaign.runs
    assert run.length in (120.0, 200.0) and run.noise_um == 0.5 and run.rows == 2 * 9
    assert tuple(campaign.machine.workspace.bar_lengths) == (120.0, 200.0)
    text = (tmp_path / "plan" / "nc" / "siemens" / f"{run.id}.mpf").read_text()
    code = "\n".join(line for line in text.split("\n") if not line.startswith(";"))
    assert code.index("TRAFOOF") < code.index("G0 ") < code.index("TRAORI") < code.rindex("TRAFOOF")
    quick = [
        "plan",
        str(tmp_path / "machine.toml"),
        "-o",
        str(tmp_path / "quick"),
        "--points",
        "12",
        "--starts",
        "1",
        "-q",
    ]
    assert main([*quick, "--per-minute", "--minutes", "12"]) == 0
    assert main(["assess", str(tmp_path / "quick"), "--given", str(tmp_path / "plan"), "-q"]) == 0
    said = capsys.readouterr().out
    assert all(f"{name} " in said for name in campaign.machine.errors)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--nc", "okuma"], 'NC dialect "okuma" is unknown'),
        (["--reversed", "X"], "the machine has no rotary axis X to reverse; use one of B, C"),
        (["--bar", "-5", "--instrument", "ball_bar"], "Invalid value for '--bar': '-5' is not a number from 1e-12"),
        (["--bar", "900", "--instrument", "ball_bar"], "the shortest bar is 900 mm"),
        (["--noise-um", "0"], "Invalid value for '--noise-um': '0' is not a number from 1e-12"),
        (["--minutes", "4"], "4 minutes are too short for one set-up (5 min) and two poses; give at least 6 minutes"),
        (["--circles", "synchronous"], "none is named; add --effect backlash:C"),
        (["--circles", "synchronous", "--effect", "backlash:Q"], "speaks of axis 'Q'"),
        (["--circles", "square", "--effect", "backlash:C"], "use one of iso-230-4, synchronous, planar"),
    ],
)
def test_the_command_line_says_what_to_change(
    words: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plan", "oyama-2010", "-o", str(tmp_path / "p"), "-q", *words]) == 2
    said = capsys.readouterr()
    assert says in said.err and said.err.count("\n") == 1 and said.out == "" and not (tmp_path / "p").exists()


@pytest.mark.slow
def test_circles_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = preset("tsutsumi-2007")
    write_machine(
        replace(whole, errors={n: whole.errors[n] for n in ("EX0C", "EY0C")}, text=""), tmp_path / "machine.toml"
    )
    words = [
        "--circles",
        "planar",
        "--effect",
        "backlash:X",
        "--count",
        "1",
        "--bar",
        "50",
        "--nc",
        "linuxcnc",
        "-q",
        "--no-proof",
    ]
    assert main(["plan", str(tmp_path / "machine.toml"), "-o", str(tmp_path / "plan"), *words]) == 0
    assert "backlash.X.width" in capsys.readouterr().out
    programs = {path.stem for path in (tmp_path / "plan" / "nc" / "linuxcnc").glob("*.ngc")}
    assert len(programs) == 3 and any("+" in name for name in programs)  # one a direction, and both with the bar on


def test_no_pose_follows_itself_and_the_ends_stay() -> None:
    order, pose = np.array([0, 1, 2, 3, 4, 5, 0]), np.array([0, 1, 1, 2, 3, 3])
    times = np.abs(np.arange(6.0)[:, None] - np.arange(6.0))
    apart = kept_apart(order, pose, times)
    assert sorted(apart.tolist()) == sorted(order.tolist()) and apart[0] == apart[-1] == 0
    assert np.all(np.diff(pose[apart]) != 0)
    assert kept_apart(np.array([0, 1, 2]), np.zeros(3, dtype=int), times).tolist() == [0, 1, 2], "nothing else to go to"
    assert out_and_back(np.arange(3), 9).tolist() == [0, 1, 0, 2, 0]


@pytest.mark.slow
@pytest.mark.parametrize("instrument", ["r_test", "ball_bar"])
def test_plans_are_rounded_at_the_edge_of_the_table_and_need_one_tool(
    rounded_plans: dict[str, Plan], instrument: str, tmp_path: Path
) -> None:
    """Location errors send balls to the edge, where (4.3, 159.9) mm rounded to (4, 160) mm is beside the table."""
    made = rounded_plans[instrument]
    machine = made.machine
    assert not [note for note in made.notes if "rounded" in note]
    for run in made.campaign.runs:
        place = np.array([*run.table_ball, run.tool_ball[2]])
        assert np.abs(place - np.round(place)).max() < 1e-6
        assert np.hypot(*run.table_ball[:2]) <= machine.workspace.table_radius
        angles = np.concatenate([100.0 * q for n, q in run.commands.items() if machine.axes[n].rotary])
        assert np.abs(angles - np.round(angles)).max() < 1e-6
        poses = np.stack(list(run.commands.values()), axis=1)
        assert np.all(np.any(np.diff(poses, axis=0) != 0.0, axis=1)), "a pose follows itself"
    assert len({run.tool_ball for run in made.campaign.runs}) == 1
    made.write(tmp_path / "plan", nc=())
    page = (tmp_path / "plan" / "setup.html").read_text()
    assert "of them different" in page and "pose measured " in page


def test_what_cannot_be_rounded_is_said() -> None:
    space = make_space(OYAMA, "r_test")
    z = np.tile([np.radians(12.34), np.radians(5.0), 0.5, 0.3, 0.8, 1.5], (2, 1))
    z[1, 0] = np.radians(12.3456)
    design = Rows(z, np.zeros((2, 1)), np.zeros(2, dtype=np.int64), 1, 2)
    assert not_rounded(space, design) == ((1,), 1)
    found = rounded(space, design)
    assert not_rounded(space, found) == ((), 0) and space.feasible(found.z, found.k).all()
    assert np.degrees(found.z[:, 0]) == pytest.approx([12.34, 12.35]) and space.table_ball(found.z[0])[
        :2
    ] == pytest.approx((48.0, 15.0))
