"""Identification against truth: open campaigns, coverage, noise, outliers, confounding, solvers, sequential schemes."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from symfive.campaign import Campaign, Run, read_campaign
from symfive.design import assess
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.identify import (
    Stage,
    all_location_errors,
    ball_runout,
    calibrate_sensors,
    fitted_model,
    identify,
    identify_by_position,
    identify_sequentially,
    predict,
    redundancies,
)
from symfive.inference import Noise, Problem, gauss_newton, whiten
from symfive.machine import Machine, Structure, make_axis, preset
from symfive.model import Model, read_model, write_model
from symfive.procedures import campaign_of, planar_circle, r_test_grid, rotary_circle, static_ball_bar
from symfive.simulate import simulate

CAMPAIGNS = Path(__file__).parent / "data" / "campaigns"
CLEAN = ("static-none", "dynamic-none", "static-ball-bar-two-heights")


def _open(name: str, part: str = "fit") -> Campaign:
    return read_campaign(CAMPAIGNS / name / part)


@pytest.fixture(scope="module")
def results() -> dict:
    return {name: identify(_open(name)) for name in CLEAN}


@pytest.mark.parametrize("name", CLEAN)
def test_open_campaigns_within_three_sigma_of_the_truth(results, name):
    truth = json.loads((CAMPAIGNS / name / "truth.json").read_text())["location_errors_um_urad"]
    result = results[name]
    assert result.converged
    for error, value in truth.items():
        assert abs(result[error] - value) < 3.0 * result.uncertainty(error), error
    assert abs(result.chi2_dof - 1.0) < 0.05


@pytest.mark.parametrize("name", CLEAN)
def test_held_out_run_is_predicted_to_the_noise(results, name, tmp_path):
    write_model(fitted_model(results[name]), tmp_path / "model.json")
    heldout = _open(name, "heldout")
    prediction = predict(read_model(tmp_path / "model.json"), heldout)
    for run in heldout.runs:
        count = run.rows * len(run.readings)
        chance = 2.0 / np.sqrt(2.0 * count)  # two standard errors of a root mean square of so many readings
        assert prediction.rms[run.id] <= (1.05 + chance) * run.noise(run.instrument[0])


def test_prediction_without_readings_stands_at_zero_setup(results):
    heldout = _open("static-none", "heldout")
    plan = replace(heldout, runs=tuple(run.with_readings({}) for run in heldout.runs))
    prediction = predict(fitted_model(results["static-none"]), plan)
    model = Model(plan)
    expected = model.predict_run(plan.runs[0], {n: results["static-none"][n] for n in model.index if "setup" not in n})
    np.testing.assert_allclose(prediction.campaign.runs[0].readings["dx_um"], expected[:, 0], rtol=0, atol=1e-9)
    assert prediction.rms == {}


def _walked(
    reading: Callable[[np.ndarray], tuple[float, np.ndarray]], start: list[float], precision: float
) -> tuple[np.ndarray, bool, int]:
    """Where a fit of one reading (residual and slopes at given values) ends, whether it converged, and how often it looked."""
    seen = []

    def information_at(values: np.ndarray) -> SimpleNamespace:
        seen.append(values)
        residual, slope = reading(values)
        return SimpleNamespace(matrix=np.outer(slope, slope), gradient=slope * residual, square=residual**2)

    free = SimpleNamespace(lower=-np.inf, upper=np.inf)
    problem: Any = SimpleNamespace(
        model=SimpleNamespace(parameters=[free] * len(start), prior_mean=np.zeros(len(start))),
        prior_precision=np.full(len(start), precision),
        free=np.ones(len(start), dtype=bool),
        information_at=information_at,
    )
    return *gauss_newton(problem, np.array(start), 1e-6), len(seen)


@pytest.mark.parametrize("curvature", [1e-4, 1e-3])
@pytest.mark.parametrize("start", [30.0, 60.0])
def test_a_fit_walks_down_a_curved_valley(curvature, start):
    """Readings 10,000 times finer than the priors: y = c·x² is known well, and only the priors lead along it to 0."""

    def fine(at: np.ndarray) -> tuple[float, np.ndarray]:
        return 1e4 * (curvature * at[0] ** 2 - at[1]), 1e4 * np.array([-2.0 * curvature * at[0], 1.0])

    values, converged, looks = _walked(fine, [start, curvature * start**2], 1.0)
    assert converged and values == pytest.approx(0.0, abs=1e-4) and looks < 10


@pytest.mark.parametrize("share", [0.9, 0.97, -0.9, -0.97])
def test_a_fit_converges_where_the_bend_of_the_readings_counts(share):
    """y = a - c·x² is known, and the prior of y pulls by a: along the valley the Hessian is 1 - 2ac times Gauss–Newton's, whose
    steps are ten times too short or lead to the other side again and again."""
    pull = 30.0
    bend = 0.5 * share / pull

    def fine(at: np.ndarray) -> tuple[float, np.ndarray]:
        return 30.0 * (pull - bend * at[0] ** 2 - at[1]), 30.0 * np.array([2.0 * bend * at[0], 1.0])

    values, converged, looks = _walked(fine, [5.0, pull - bend * 25.0], 1.0)
    assert converged and values[0] == pytest.approx(0.0, abs=1e-2) and looks < 25


def test_a_step_that_no_second_one_corrects_is_shortened():
    """A wall that turns up steeply beyond the minimum: both whole steps lead beyond it."""

    def wall(at: np.ndarray) -> tuple[float, np.ndarray]:
        return -100.0 * float(np.arctan(at[0])), 100.0 / (1.0 + at**2)

    values, converged, _ = _walked(wall, [3.0], 1e-12)
    assert converged and values == pytest.approx(0.0, abs=1e-4)


@pytest.mark.slow
def test_coverage_of_95_percent_intervals_over_200_machines():
    plan = _open("static-none")
    hits = trials = 0
    for seed in range(200):
        measured = simulate(plan, seed=seed)
        result = identify(measured.campaign)
        for parameter in result.parameters:
            if parameter.kind == "location_error":
                low, high = result.interval(parameter.name)
                hits += low <= measured.truth[parameter.name] <= high
                trials += 1
    assert trials == 1600
    assert 0.93 <= hits / trials <= 0.97


@pytest.mark.slow
def test_coverage_holds_under_coloured_noise_that_no_file_declares():
    """The white likelihood would cover about half here: the coloured part must be found."""
    plan = _open("planar-none")
    plan = replace(
        plan, runs=tuple(run.with_readings({}) for run in plan.select("xy-f2400-ccw-1", "xy-f2400-cw-1").runs)
    )
    hits = trials = naive = 0
    for seed in range(24):
        measured = simulate(plan, seed=seed)
        rng = np.random.default_rng(10_000 + seed)
        runs = []
        for run in measured.campaign.runs:
            drive = rng.standard_normal(run.rows) * 0.5 * np.sqrt(1 - 0.975**2)
            slow = np.zeros(run.rows)
            for k in range(1, run.rows):
                slow[k] = 0.975 * slow[k - 1] + drive[k]
            runs.append(run.with_readings({"dL_um": run.readings["dL_um"] + slow}))
        noisy = replace(measured.campaign, runs=tuple(runs))
        honest, white = identify(noisy), identify(noisy, noise="declared")
        low, high = honest.interval("EC0X")
        hits += low <= measured.truth["EC0X"] <= high
        low, high = white.interval("EC0X")
        naive += low <= measured.truth["EC0X"] <= high
        trials += 1
    assert hits / trials >= 0.83
    assert naive / trials <= 0.6


@pytest.mark.parametrize(("n", "columns"), [(1, 1), (31, 2), (50, 3), (33, 3), (2200, 1), (1025, 40), (70, 2000)])
@pytest.mark.parametrize("noise", [Noise(0.3, 0.7, 2.0), Noise(0.3, 0.3, 5.0), Noise(0.01, 0.7, 0.05)])
def test_whitening_is_the_exact_inverse_of_the_covariance(n, columns, noise):
    """Whole blocks, broken ones, several levels of them and several spans of rows."""
    interval = 0.1
    lags = np.abs(np.subtract.outer(np.arange(n), np.arange(n))) * interval
    covariance = noise.coloured**2 * np.exp(-lags / noise.time_constant) + noise.white**2 * np.eye(n)
    residual = np.random.default_rng(n).standard_normal((n, columns))
    white, logs = whiten(residual, noise, interval)
    wanted = residual.T @ np.linalg.solve(covariance, residual)
    assert np.abs(white.T @ white - wanted).max() < 1e-8 * np.abs(wanted).max()
    assert logs == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-9)


def test_a_fit_settles_where_a_sum_is_known_and_its_parts_are_not():
    """The zero of an angle and the skew EC0B read alike: each is known to 100 µrad, their sum to a fifth of one."""
    angles = np.linspace(0.0, 345.0, 24)
    commands = {name: np.zeros(24) for name in "XYZB"} | {"C": angles}
    run = Run(id="c", instrument=("laser",), sampling="static", time=np.arange(24.0), commands=commands, noise_um=1.0,
              options={"axis": "C"})  # fmt: skip
    model = Model(simulate(Campaign(machine=preset("table-bc"), runs=(run,)), truth={}, seed=2).campaign)
    problem = Problem.of(model)
    best, _ = gauss_newton(problem, model.start, 1e-6)
    beside = best.copy()
    beside[model.index["setup.c.zero"]] += 0.9
    values, converged = gauss_newton(problem, beside, 1e-2)
    left = float(np.mean(model.predict(values)["c"] - model.predict(best)["c"]))
    assert converged and abs(left) < 1e-2 / np.sqrt(24.0)


def test_whitening_a_table_without_columns_leaves_it_empty():
    """A recording that is fitted without any parameter of its own."""
    white, logs = whiten(np.empty((1000, 2, 0)), Noise(0.3, 0.7, 2.0), 0.1)
    assert white.shape == (1000, 2, 0) and np.isfinite(logs)


def test_isolated_outliers_are_reported_by_row_and_do_not_move_the_result():
    measured = simulate(_open("static-none"), seed=5)
    clean = identify(measured.campaign)
    run = measured.campaign.runs[0]
    spoiled = run.readings["dy_um"].copy()
    spoiled[[40, 120]] += [9.0, -30.0]
    campaign = replace(
        measured.campaign, runs=(run.with_readings({**run.readings, "dy_um": spoiled}), *measured.campaign.runs[1:])
    )
    result = identify(campaign)
    assert [(o.run, o.row, o.column) for o in result.outliers] == [("nest1", 40, "dy_um"), ("nest1", 120, "dy_um")]
    assert result.to_data()["outliers"][0]["row"] == 42  # as an editor counts the file's lines
    for parameter in ("EA0B", "EX0C", "EB0C"):
        assert abs(result[parameter] - clean[parameter]) < 0.2 * clean.uncertainty(parameter)


def test_what_comes_again_whenever_a_pose_does_is_no_outlier():
    """Both readings of one pose spoiled alike are the machine's; spoiled to different sides they are outliers."""
    measured = simulate(_open("static-none"), seed=5)
    run = measured.campaign.runs[0]
    poses = np.column_stack([run.commands[axis] for axis in ("B", "C")])
    first = 40
    (second,) = (k for k in range(run.rows) if k != first and np.array_equal(poses[k], poses[first]))
    for sense, left_out in ((1.0, []), (-1.0, sorted((first, second)))):
        spoiled = run.readings["dy_um"].copy()
        spoiled[[first, second]] += [12.0, sense * 12.0]
        runs = (run.with_readings({**run.readings, "dy_um": spoiled}), *measured.campaign.runs[1:])
        result = identify(replace(measured.campaign, runs=runs))
        assert [o.row for o in result.outliers] == left_out


def test_confounded_combinations_are_named(results):
    names = [set(c.names) for c in results["static-none"].confounded]
    assert {"EX0B", "setup.nest1.tool_ball.x", "setup.nest2.tool_ball.x"} in names
    assert results["static-none"].rank == 17
    assert "EX0B cannot be separated from" in str(results["static-none"])


def test_rank_and_confounding_do_not_depend_on_units_of_the_priors():
    plan = _open("static-none")
    errors = {n: replace(t, sigma=t.sigma * 10.0) for n, t in plan.machine.errors.items()}
    wide = assess(plan.with_machine(replace(plan.machine, errors=errors)))
    assert wide.rank == assess(plan).rank


def test_redundant_parameters_of_a_topology_are_found_by_the_null_space():
    structure = Structure.parse("w C' B' X' Y' b Z t")
    machine = Machine(name="m", structure=structure, axes={a: make_axis(a) for a in structure.axes})
    found = [set(c.names) for c in redundancies(machine)]
    assert {"EA0X"} in found and {"EB0Y"} in found and {"EC0Z"} in found
    assert {"EY0B", "EY0C"} in found and {"EB0B", "EB0C"} in found
    assert len(all_location_errors(machine)) == 21


def test_ipopt_finds_the_same_maximum_and_respects_bounds():
    campaign = _open("static-none")
    by_ipopt = identify(campaign, solver="ipopt", noise="declared")
    plain = identify(campaign, noise="declared")
    np.testing.assert_allclose(by_ipopt.values, plain.values, atol=1e-3 * plain.std.min())
    assert by_ipopt.converged


def test_huber_loss_resists_many_outliers():
    measured = simulate(_open("static-none"), seed=3)
    rng = np.random.default_rng(2)
    runs = []
    for run in measured.campaign.runs:
        spoiled = {}
        for name, values in run.readings.items():
            jump = np.where(rng.random(run.rows) < 0.08, rng.choice([-8.0, 8.0], run.rows), 0.0)
            spoiled[name] = values + jump
        runs.append(run.with_readings(spoiled))
    campaign = replace(measured.campaign, runs=tuple(runs))
    robust = identify(campaign, loss="huber", noise="declared")
    square = identify(campaign, noise="declared")
    error = {n: abs(robust[n] - measured.truth[n]) for n in ("EA0B", "EC0B", "EX0C")}
    worse = {n: abs(square[n] - measured.truth[n]) for n in error}
    assert sum(error[n] / square.uncertainty(n) for n in error) < 0.6 * sum(
        worse[n] / square.uncertainty(n) for n in error
    )


def test_backlash_in_the_baseline_is_identified():
    result = identify(_open("dynamic-backlash"), effects=[make_effect("backlash", "C")])
    assert abs(result["backlash.C.width"] - 80.0) < 3.0 * result.uncertainty("backlash.C.width")
    assert result.chi2_dof < 1.05


def test_joined_campaigns_tell_more_than_one():
    first = simulate(_open("static-none"), seed=1).campaign
    one = identify(first)
    both = identify(first.joined(simulate(_open("static-none"), seed=1).campaign, prefix="again-"))
    assert both.uncertainty("EA0B") == pytest.approx(one.uncertainty("EA0B") / np.sqrt(2.0), rel=0.05)


def test_sequential_scheme_is_biased_where_the_joint_one_is_not():
    """Paper 1's order takes what is not yet known as zero; a tilt then reads as an offset at the next height."""
    measured = simulate(_open("static-none"), truth={"EA0B": 150.0}, seed=4)
    stages = [Stage(("nest1",), ("EX0C", "EY0C", "EA0C", "EB0C")), Stage(("nest2",), ("EX0B", "EZ0B", "EA0B", "EC0B"))]
    sequential = identify_sequentially(measured.campaign, stages)
    joint = identify(measured.campaign)
    error = abs(sequential["EA0C"] - measured.truth["EA0C"])
    assert error > 10.0 * sequential.uncertainty("EA0C")
    assert abs(joint["EA0C"] - measured.truth["EA0C"]) < 3.0 * joint.uncertainty("EA0C")
    assert sequential.method == "sequential"


def test_errors_by_position_of_the_tilting_axis():
    result = identify_by_position(_open("static-none"), "B", ("A", "B", "C"))
    curve = result.error_motion("EBB")
    assert np.all(np.abs(curve.value) < 3.5 * curve.std + 1e-9)
    assert result.method == "by position of B"


def test_sensor_directions_and_ball_run_out():
    rng = np.random.default_rng(0)
    grid = np.array(np.meshgrid(*[[-0.2, 0.0, 0.2]] * 3)).reshape(3, -1).T
    directions = np.array([[0.8, 0.1, 0.6], [-0.3, 0.7, 0.6], [-0.4, -0.6, 0.7]])
    found = calibrate_sensors(grid, grid @ directions.T + 0.03 + 1e-4 * rng.standard_normal((27, 3)))
    assert np.abs(found.directions - directions).max() < 5e-4
    np.testing.assert_allclose(found.displacement(grid @ directions.T + found.offsets), grid, atol=3e-4)
    angles = np.linspace(0.0, 2 * np.pi, 8, endpoint=False)
    e = np.array([4e-3, -3e-3])
    turned = (
        np.stack([np.cos(angles) * e[0] - np.sin(angles) * e[1], np.sin(angles) * e[0] + np.cos(angles) * e[1]], axis=1)
        - e
    )
    np.testing.assert_allclose(ball_runout(angles, turned).eccentricity, e, atol=1e-9)
    with pytest.raises(InputError, match="do not span"):
        calibrate_sensors(grid * [1, 1, 0], grid @ directions.T)


def test_assessment_of_a_plan_needs_no_readings_and_names_the_useless_run():
    plan = _open("static-none")
    plan = replace(plan, runs=tuple(run.with_readings({}) for run in plan.runs))
    result = assess(plan)
    fit = identify(_open("static-none"), noise="declared")
    np.testing.assert_allclose([result.sigma[p.name] for p in fit.parameters], fit.std, rtol=1e-2)
    still = replace(
        plan.runs[0],
        id="still",
        file="still.csv",
        commands={a: np.full(5, v[0]) for a, v in plan.runs[0].commands.items()},
        time=np.arange(5.0),
    )
    more = assess(replace(plan, runs=(*plan.runs, still)))
    assert more.run_worth["still"] < 1e-3 < more.run_worth["nest1"]


def test_an_unknown_name_or_a_plan_is_refused_in_one_sentence():
    plan = _open("static-none")
    with pytest.raises(InputError, match="has no parameter"):
        identify(plan, fixed={"EX0Q": 1.0})
    bare = replace(plan, runs=tuple(run.with_readings({}) for run in plan.runs))
    with pytest.raises(InputError, match="no readings"):
        identify(bare)


def test_readings_in_the_wrong_unit_are_said_to_be_too_quiet():
    """mm under a heading of µm: the residuals are far below the noise that is declared, and no fit says why."""
    machine = preset("table-bc")
    measured = simulate(campaign_of(machine, r_test_grid(machine, step_deg=60.0)), seed=3).campaign
    small = [run.with_readings({k: 1e-3 * v for k, v in run.readings.items()}) for run in measured.runs]
    assert not [n for n in identify(measured).notes if "smaller than the noise" in n]
    assert [n for n in identify(replace(measured, runs=tuple(small))).notes if "µm, not mm" in n]


@pytest.mark.parametrize("name", ["three-axis", "table-bc"])
@pytest.mark.parametrize("seed", [0, pytest.param(3, marks=pytest.mark.slow)])
def test_the_ball_bar_procedure_of_the_docs_converges_with_plays(name: str, seed: int) -> None:
    """A play that is hardly seen comes out near none, where the cost has a kink."""
    machine = preset(name)
    rotary = [("C", "radial"), ("C", "axial"), ("B", "axial")] if name == "table-bc" else []
    runs = [
        *planar_circle(machine, plane="XY", feed=2000.0, rate_hz=10.0),
        *planar_circle(machine, plane="ZX", feed=2000.0, rate_hz=10.0, sweep_deg=180.0),
        *(run for axis, way in rotary for run in rotary_circle(machine, axis=axis, arrangement=way, rate_hz=10.0)),
        *(static_ball_bar(machine) if rotary else ()),
    ]
    truth = ({"backlash.C.width": 45.0} if rotary else {}) | {"backlash.X.width": 9.0}
    plays = [make_effect("backlash", key.split(".")[1]) for key in truth]
    measured = simulate(campaign_of(machine, runs), truth=truth, effects=plays, seed=seed).campaign
    for effects, least, most in (((), 80.0, 130.0), (plays, 0.9, 1.1)):
        fit = identify(measured, effects=effects)
        assert fit.converged and not fit.notes
        assert least < fit.chi2_dof < most
    assert fit["backlash.X.width"] == pytest.approx(9.0, abs=0.1)
    for key, width in truth.items():
        assert abs(fit[key] - width) < 3.0 * fit.uncertainty(key)  # these circles hardly see a play of C


def test_an_axis_that_is_late_has_a_lower_gain_and_no_negative_feed_forward():
    """At one feed both fit; a velocity feed-forward below 0 no control has."""
    machine = preset("three-axis")
    plan = campaign_of(machine, planar_circle(machine, feed=2000.0, rate_hz=10.0))
    gain = make_effect("servo_mismatch", axis="Y", gains=("position_gain",))
    measured = simulate(plan, effects=[gain], truth={"servo_mismatch.Y.position_gain": 43.0}, seed=3).campaign
    late = identify(measured, effects=[gain])
    assert late["servo_mismatch.Y.position_gain"] == pytest.approx(43.0, abs=0.1) and late.fits in ("yes", "nearly")
    forward = identify(measured, effects=[make_effect("servo_mismatch", axis="Y", gains=("feedforward",))])
    assert forward["servo_mismatch.Y.feedforward"] == pytest.approx(0.0, abs=1e-6) and forward.fits == "no"
