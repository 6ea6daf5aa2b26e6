"""Runs that share a mounting: one error for all of them, in the model, in files and in what is identified from concealed data."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lean import location_only
from plant.campaign import write_campaign as write_concealed
from plant.machines import static_table
from plant.paths import r_test, static_ball_bar

from symfive.campaign import Campaign, read_campaign, write_campaign
from symfive.design import Plan, assess, plan
from symfive.diagnose import diagnose
from symfive.errors import InputError
from symfive.identify import identify, may_have_stayed
from symfive.identify._mounted import CERTAIN, _Comparison, _Group  # odds, of which a result says only the decision
from symfive.machine import preset
from symfive.model import Model
from symfive.procedures import campaign_of, linear_positioning
from symfive.report import _report, diagnosis_text, identification_report
from symfive.simulate import simulate

NESTS = ((90.0, -20.0, 50.0), (-40.0, 60.0, 100.0), (30.0, -70.0, 150.0), (-80.0, -40.0, 70.0))
POSES = np.array([(b, c) for b in (-60.0, 0.0, 60.0) for c in (0.0, 90.0, 180.0, 270.0)])
SPINDLE = {"tool_ball": "spindle"}
MACHINES = 20


def concealed(folder: Path, seed: int = 0, *, said: bool = True, stayed: bool = True, effects: tuple = ()) -> Campaign:
    """Four nests read with one ball that `stayed` in the spindle; whether the file says so is `said`."""
    machine = static_table()
    rng = np.random.default_rng(1000 + seed)
    errors = {name: rng.normal(0.0, term["sigma"]) for name, term in machine["errors"].items()}
    mounting = SPINDLE if stayed else {}
    runs = [
        {**r_test(machine, f"nest-{i}", nest=nest, poses=POSES, noise_um=0.4, start_s=100.0 * i), "mounting": mounting}
        for i, nest in enumerate(NESTS, 1)
    ]
    write_concealed(folder, machine, runs, errors, effects=effects, seed=seed)
    campaign = read_campaign(folder)
    return campaign if said else replace(campaign, runs=tuple(replace(run, mounting={}) for run in campaign.runs))


def test_a_plan_expects_a_mounting_to_creep_by_1_um_from_run_to_run(tmp_path: Path) -> None:
    """Against the covariance of all readings together: noise, and the creep of the ball of each run."""
    campaign = concealed(tmp_path / "c")
    model = Model(campaign)
    precision = np.diag(model.prior_sigma**-2.0)
    balls = [i for i, p in enumerate(model.parameters) if "tool_ball" in p.name]
    for run in campaign.runs:
        line = model.linearise(run, model.start)
        slopes = np.zeros((line.prediction.size, len(model.parameters)))
        slopes[:, line.columns] = line.jacobian.reshape(line.prediction.size, -1)
        noise = np.diag(np.broadcast_to(model.noise(run) ** 2, line.prediction.shape).ravel())
        precision += slopes.T @ np.linalg.solve(noise + slopes[:, balls] @ slopes[:, balls].T, slopes)
    expected = np.sqrt(np.diag(np.linalg.inv(precision)))
    np.testing.assert_allclose(list(assess(campaign).sigma.values()), expected, rtol=1e-6)


def test_runs_of_a_mounting_have_one_error_of_it_with_exact_slopes(tmp_path: Path) -> None:
    model = Model(concealed(tmp_path / "c"))
    names = [p.name for p in model.parameters if "tool_ball" in p.name]
    assert names == [f"mounting.spindle.tool_ball.{c}" for c in "xyz"]
    assert sum(".zero." in p.name for p in model.parameters) == 3 * len(NESTS)
    values = model.start + 3.0 * np.random.default_rng(0).standard_normal(len(model.parameters))
    for run in model.campaign.runs:
        line = model.linearise(run, values)
        for k, number in enumerate(line.columns):
            step = np.zeros(len(values))
            step[number] = 0.5
            ends = [model.predict_run(run, values + sign * step) for sign in (1.0, -1.0)]
            np.testing.assert_allclose(line.jacobian[:, :, k], ends[0] - ends[1], atol=1e-6)


@pytest.mark.slow
def test_the_uncertainty_of_errors_behind_a_ball_that_stays_is_honest(tmp_path: Path) -> None:
    """By the independent plant. If the runs are taken for mounted anew, the ball's error is averaged, and 1σ are too small."""
    covered = dict.fromkeys((True, False), 0)
    for seed in range(MACHINES):
        for said in covered:
            campaign = concealed(tmp_path / f"{seed}-{said}", seed, said=said)
            truth = json.loads((tmp_path / f"{seed}-{said}" / "truth.json").read_text())["location_errors_um_urad"]
            result = identify(campaign)
            for name in ("EX0B", "EY0C"):
                low, high = result.interval(name)
                covered[said] += low <= truth[name] <= high
    assert covered[True] >= 0.88 * 2 * MACHINES
    assert covered[False] <= 0.8 * 2 * MACHINES


def test_files_keep_mountings_and_the_older_name_of_a_placement(tmp_path: Path) -> None:
    campaign = concealed(tmp_path / "c")
    assert all(dict(run.mounting) == SPINDLE for run in campaign.runs)
    write_campaign(campaign, tmp_path / "again")
    assert [dict(run.mounting) for run in read_campaign(tmp_path / "again").runs] == [SPINDLE] * len(NESTS)
    joined = campaign.joined(campaign, "second-")
    assert {run.mounting["tool_ball"] for run in joined.runs} == {"spindle", "second-spindle"}
    folder = tmp_path / "older"
    write_concealed(folder, static_table(), [], readings=False)
    (folder / "campaign.toml").write_text(
        'schema = "symfive.campaign/1"\nmachine = "machine.toml"\n[[run]]\nid = "t"\nfile = "t.csv"\n'
        'instrument = "tracker"\nsampling = "static"\nplacement_id = "first"\nnoise_um = 5.0\n'
    )
    (folder / "t.csv").write_text("t_s,X_mm,Y_mm,Z_mm,B_deg,C_deg\n0,0,0,0,0,0\n")
    older = read_campaign(folder)
    assert "mounting.first.placement.a" in Model(older).index


def test_identification_and_report_name_the_mounting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_report, "FIGURES", ())
    result = identify(concealed(tmp_path / "c"))
    data = result.to_data()
    assert set(data["mountings"]) == {"spindle"}
    assert set(data["mountings"]["spindle"]) == {"tool_ball.x", "tool_ball.y", "tool_ball.z"}
    assert all("tool_ball.x" not in entry for entry in data["setup"].values())
    assert not any(name.startswith("mounting") for name in data["parameters"])
    folder = tmp_path / "report"
    identification_report(result, folder)
    assert any("mounting spindle" in page.read_text() for page in folder.glob("*.html"))


def test_it_is_said_what_stayed_and_how_much_larger_the_uncertainty_then_is(tmp_path: Path) -> None:
    """As large as it then is: checked with the fit that knows it."""
    silent, found = identify(concealed(tmp_path / "s", said=False)), identify(concealed(tmp_path / "t"))
    (note,) = silent.notes
    assert re.search(r"tool ball in runs nest-1, nest-2, nest-3, nest-4 stayed mounted", note)
    assert re.search(r'1σ of E[XYZ]0[BC] is then 17.9 µm, not 9.7 µm: .* mounting = { tool_ball = "1" }', note)
    assert found.uncertainty("EX0B") == pytest.approx(17.9, abs=0.05)
    assert found.notes == ()


def test_a_run_whose_readings_the_ball_does_not_move_is_no_part_of_a_mounting(tmp_path: Path) -> None:
    """An R-test and a ball bar on one place of the table: to the R-test the ball's place is its zero."""
    machine, nest = static_table(), NESTS[0]
    runs = [r_test(machine, "nest", nest=nest, poses=POSES)]
    runs += [
        static_ball_bar(machine, name, table_ball=nest, poses=POSES, direction=direction, start_s=500.0 * k)
        for k, (name, direction) in enumerate({"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}.items(), 1)
    ]
    write_concealed(tmp_path / "c", machine, runs, {"EX0C": 20.0}, seed=1)
    campaign = read_campaign(tmp_path / "c")
    assert campaign.alike("table_ball") == (("nest", "x", "y"),)
    assert not any("table ball" in note and "nest" in note for note in identify(campaign).notes)


def test_the_odds_that_a_ball_stayed_are_those_of_the_readings(tmp_path: Path) -> None:
    """Against the normal density of all readings under either prior. A ball mounted anew is not taken for one that stayed."""
    for stayed in (True, False):
        runs = concealed(tmp_path / str(stayed), said=False, stayed=stayed)
        fit = identify(runs, noise="declared")
        model, blocks = fit.model, []
        for run in runs.runs:
            line = model.linearise(run, model.start)
            table = np.zeros((line.jacobian[..., 0].size, len(model.parameters)))
            table[:, line.columns] = line.jacobian.reshape(len(table), -1)
            rest = (model.readings(run) - line.prediction).reshape(-1, 1)
            blocks.append(np.hstack([table, rest]) / run.noise("r_test"))
        rows = np.concatenate(blocks)
        slopes, readings = rows[:, :-1] * model.prior_sigma, rows[:, -1]
        shared = np.eye(len(model.parameters))
        for c in "xyz":
            own = [model.index[f"setup.{run.id}.tool_ball.{c}"] for run in runs.runs]
            shared[np.ix_(own, own)] = 1.0
        densities = []
        for prior in (np.eye(len(shared)), shared):
            covariance = slopes @ prior @ slopes.T + np.eye(len(slopes))
            spread = np.linalg.slogdet(covariance)[1]
            densities.append(-0.5 * float(spread + readings @ np.linalg.solve(covariance, readings)))
        found = _Comparison(fit.problem(), fit).log_odds(_Group("tool_ball", tuple(run.id for run in runs.runs)))
        assert found == pytest.approx(densities[1] - densities[0], rel=0.01)
        assert (found > CERTAIN) == stayed


def test_a_laser_has_no_ball_that_may_have_stayed(tmp_path: Path) -> None:
    """Of an axis against an indexer the report had asked for the mounting of the balls, which such a test does not have."""
    assert may_have_stayed(identify(concealed(tmp_path / "c", said=False))) == ("the tool ball",)
    machine = preset("three-axis")
    runs = [
        replace(run, id=id, file=f"{id}.csv")
        for id in ("one", "two")
        for run in linear_positioning(machine, axis="X", cycles=1)
    ]
    fit = identify(simulate(campaign_of(machine, runs), seed=1).campaign)
    assert fit.model.campaign.alike("tool_ball")
    assert may_have_stayed(fit) == ()


DRIFT = {
    "effect": "thermal_drift", "axis": None, "direction": [0.0, 0.0, 1.0], "amplitude": 8.0, "time_constant_s": 200.0,
}  # fmt: skip


@pytest.mark.slow
def test_a_drift_that_new_set_up_errors_absorb_is_found_behind_a_ball_that_stays(tmp_path: Path) -> None:
    found = diagnose(concealed(tmp_path / "c", effects=(DRIFT,)))
    assert [finding.name for finding in found.findings] == ["thermal_drift"]
    assert found.p_value < 1e-9
    assert found.after.uncertainty("EX0B") == pytest.approx(17.9, abs=0.1)
    assert "stayed mounted" not in " ".join(diagnosis_text(found).split())


@pytest.mark.slow
def test_a_drift_behind_a_ball_of_which_nothing_is_said_is_not_found(tmp_path: Path) -> None:
    silent = diagnose(concealed(tmp_path / "c", said=False, effects=(DRIFT,)))
    assert silent.findings == ()
    assert "If the tool ball stayed mounted between runs at the same position, enter it" in " ".join(
        diagnosis_text(silent).split()
    )


@pytest.mark.slow
def test_nothing_is_found_behind_a_ball_that_stays_where_nothing_is_wrong(tmp_path: Path) -> None:
    assert diagnose(concealed(tmp_path / "c")).findings == ()


def _planned(setups: int) -> Plan:
    machine = location_only("table-bc")
    return plan(machine, instrument="r_test", points=12, setups=setups, starts=1, anywhere=False, prove=False)


@pytest.mark.slow
def test_a_plan_says_what_it_counts_on_and_the_sheet_what_to_do(tmp_path: Path) -> None:
    made = _planned(2)
    (note,) = [note for note in made.notes if "is remounted for every run" in note]
    stays = tuple(replace(run, mounting=SPINDLE) for run in made.campaign.runs)
    then = assess(replace(made.campaign, runs=stays)).sigma
    name = re.search(r"1σ of (\w+) is ([\d.]+) µm, not ([\d.]+) µm", note)
    assert name is not None
    assert then[name[1]] == pytest.approx(float(name[2]), rel=0.01)
    assert made.assessment.sigma[name[1]] == pytest.approx(float(name[3]), rel=0.01)
    made.write(tmp_path / "plan")
    assert "Remount it in the spindle: " in (tmp_path / "plan" / "setup.html").read_text()


@pytest.mark.slow
def test_a_plan_of_one_run_counts_on_no_mounting() -> None:
    assert not any("remounted" in note for note in _planned(1).notes)


@pytest.mark.parametrize(
    ("edit", "problem"),
    [
        ({"mounting": {"tool_ball": "a.b"}}, "is not a plain name"),
        ({"mounting": {"spindle": "1"}}, "its instruments have no error"),
        ({"mounting": {"extra": "1"}}, "its instruments have no error"),
        ({"mounting": "1"}, "is not a table"),
        ({"mounting": SPINDLE, "tool_ball": (0.0, 0.0, -120.0)}, "is not that of run nest-1"),
    ],
)
def test_what_cannot_be_one_mounting_is_refused(edit, problem, tmp_path: Path) -> None:
    campaign = concealed(tmp_path / "c")
    with pytest.raises(InputError, match=problem):
        runs = (campaign.runs[0], replace(campaign.runs[1], **edit), *campaign.runs[2:])
        Model(replace(campaign, runs=runs))
