"""Diagnosis on open campaigns and on concealed data of the independent plant: named, modelled, clean where clean."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import plant
import pytest
from concealed_world import grid_runs, names_of, read_by_the_plant
from lean import without_drives

from symfive.campaign import Campaign, Run, read_campaign
from symfive.diagnose import Diagnosis, Fit, amend, cross_validated, diagnose, place_words
from symfive.effects import make_effect
from symfive.identify import fitted_model, identify, predict
from symfive.importers import polar_run
from symfive.machine import preset
from symfive.simulate import simulate

CAMPAIGNS = Path(__file__).parent / "data" / "campaigns"


def _open(name: str) -> Diagnosis:
    return diagnose(read_campaign(CAMPAIGNS / name / "fit"))


@pytest.fixture(scope="module")
def sag_and_drift() -> Diagnosis:
    return _open("static-sag-and-drift")


@pytest.mark.parametrize(
    "name",
    ["static-ball-bar-two-heights", *(pytest.param(n, marks=pytest.mark.slow) for n in ("static-none", "planar-none"))],
)
def test_clean_campaigns_stay_clean(name):
    result = _open(name)
    assert not result.mismatch
    assert result.findings == ()
    assert result.p_value > 0.01
    assert "noise" in result.summary


@pytest.mark.slow
def test_a_pair_that_the_geometry_conceals_is_named_with_its_magnitudes(sag_and_drift):
    found = {f.name: f for f in sag_and_drift.findings}
    assert set(found) == {"gravity_sag", "thermal_drift"}
    assert found["gravity_sag"].axis == "B"
    assert found["gravity_sag"].parameters["amplitude"].value == pytest.approx(7.0, rel=0.1)
    assert found["thermal_drift"].parameters["amplitude"].value == pytest.approx(10.8, rel=0.1)
    assert found["thermal_drift"].coordinate == "t"
    truth = json.loads((CAMPAIGNS / "static-sag-and-drift" / "truth.json").read_text())["location_errors_um_urad"]
    for name, value in truth.items():
        assert abs(sag_and_drift.after[name] - value) < 3.0 * sag_and_drift.after.uncertainty(name), name


@pytest.mark.slow
def test_the_fit_improves_on_data_that_were_left_out(sag_and_drift):
    fit = sag_and_drift.fit
    assert fit.chi2_dof_before > 10.0 and fit.chi2_dof_after < 1.05
    assert fit.heldout_rms_after_um < 0.4 * fit.heldout_rms_before_um
    heldout = read_campaign(CAMPAIGNS / "static-sag-and-drift" / "heldout")
    assert predict(fitted_model(sag_and_drift.after), heldout).rms["check"] < 1.05 * 0.4


@pytest.mark.slow
def test_the_letter_says_how_the_geometry_moved(sag_and_drift):
    moved = {name for finding in sag_and_drift.findings for name in finding.moved}
    assert moved & set(sag_and_drift.before.model.index)
    assert "→" in sag_and_drift.summary and "µm" in sag_and_drift.summary
    data = json.loads(json.dumps(sag_and_drift.to_data(), allow_nan=False))
    assert data["schema"] == "symfive.diagnosis/1" and data["mismatch"] is True
    assert {"effect", "axis", "confidence", "where", "parameters", "rivals", "says"} <= set(data["findings"][0])


@pytest.mark.slow
def test_observability_is_told_before_any_verdict(sag_and_drift):
    table = {o.form: o for o in sag_and_drift.observability}
    assert table["gravity_sag.B.EZB"].visible < 0.35 < table["backlash.C"].visible
    assert any({"location_error.EC0Y", "location_error.EC0X"} <= set(c) for c in sag_and_drift.classes)


@pytest.mark.slow
def test_a_backlash_that_the_fit_absorbs_is_found_on_dynamic_recordings():
    result = _open("dynamic-backlash")
    assert names_of(result) == [("backlash", "C")]
    finding = result.findings[0]
    assert finding.parameters["width"].value == pytest.approx(80.0, rel=0.1)
    assert finding.visible < 0.5 and finding.confidence > 0.95
    assert finding.coordinate == "C velocity sign"


def _simulated(tmp_path: Path, effects: list[dict], seed: int = 3, turn_deg: float = 45.0) -> Diagnosis:
    machine = plant.static_table()
    poses = plant.grid_poses(np.arange(-90, 91, 45.0), np.arange(0, 316, turn_deg))
    runs, errors = grid_runs(machine, poses), {"EX0B": 30.0, "EA0C": -40.0}
    return diagnose(read_by_the_plant(tmp_path / "c", machine, runs, effects, seed=seed, errors=errors))


BACKLASH = {"effect": "backlash", "axis": "B", "width": 40.0}
SCALE = {"effect": "scale_error", "axis": "X", "ppm": 40.0}
LATERAL = {"effect": "lateral_play", "axis": "B", "component": "EYB", "width": 6.0}
SHIFT = {"effect": "setup_shift", "run": "nest2", "t_s": 200.0, "shift": [4.0, -3.0, 2.0]}
DRIFT = {"effect": "thermal_drift", "amplitude": 12.0, "direction": [0.0, 0.6, 0.8], "time_constant_s": 900.0}
CASES = {
    "backlash and scale": [(BACKLASH, "width"), (SCALE, "ppm")],
    "lateral play and drift": [(LATERAL, "width"), (DRIFT, "amplitude")],
    "shift": [(SHIFT, None)],
}


@pytest.mark.parametrize("name", [n if n == "shift" else pytest.param(n, marks=pytest.mark.slow) for n in CASES])
def test_effects_of_the_independent_plant_are_named(name, tmp_path):
    result = _simulated(tmp_path, [effect for effect, _ in CASES[name]], turn_deg=90.0 if name == "shift" else 45.0)
    found = {(f.name, f.axis): f.parameters for f in result.findings}
    assert len(result.findings) == len(found) and set(found) == {(e["effect"], e.get("axis")) for e, _ in CASES[name]}
    for effect, parameter in CASES[name]:
        if parameter is not None:
            value = found[effect["effect"], effect.get("axis")][parameter].value
            assert value == pytest.approx(effect[parameter], rel=0.15)
    assert result.fit.chi2_dof_after < 1.1


@pytest.mark.slow
def test_a_sag_that_comes_back_by_another_way_is_one_effect(tmp_path):
    sag = {"effect": "gravity_sag", "axis": "B", "component": "EZB", "amplitude": 9.0, "form": "hysteresis"}
    result = _simulated(tmp_path, [sag], seed=11)
    assert names_of(result) == [("gravity_sag", "B")]
    assert result.fit.chi2_dof_after < 1.1
    found = result.findings[0].parameters
    assert found["amplitude"].value == pytest.approx(9.0, rel=0.05)
    assert found["amplitude_branch"].value == pytest.approx(0.2 * 9.0, rel=0.1)


@pytest.mark.xfail(strict=True, reason="not reached: an unidentified effect beside it")
@pytest.mark.slow
def test_a_form_that_differs_from_the_librarys_brings_no_second_effect(tmp_path):
    """A sag whose way back takes over bit by bit over 60° and more."""
    sag = {"effect": "gravity_sag", "axis": "B", "component": "EZB", "amplitude": 30.0, "form": "hysteresis"}
    result = _simulated(tmp_path, [sag | {"branch": 0.3, "distance_deg": 60.0}], seed=11)
    assert names_of(result) == [("gravity_sag", "B")]
    assert result.fit.chi2_dof_after < 1.1


@pytest.mark.xfail(strict=True, reason="not reached: the onset is not found")
@pytest.mark.slow
def test_heat_that_comes_late_is_one_drift_with_its_onset(tmp_path):
    heat = {"effect": "thermal_drift", "direction": [0.6, 0.0, 0.8], "amplitude": 12.0, "time_constant_s": 700.0}
    result = _simulated(tmp_path, [heat | {"form": "onset", "onset_s": 1100.0}], seed=11)
    assert names_of(result) == [("thermal_drift", None)]
    assert result.fit.chi2_dof_after < 1.1
    said = result.findings[0].parameters
    assert 1002.0 < said["onset_s"].value < 1500.0  # in the pause; where there, nothing tells
    assert said["onset_s"].value == pytest.approx(1100.0, abs=2.0 * said["onset_s"].std) and said["onset_s"].std < 150.0
    assert said["amplitude"].value == pytest.approx(12.0, abs=2.0 * said["amplitude"].std)


@pytest.mark.slow
def test_without_the_true_effect_in_the_catalogue_the_answer_is_unknown_over_the_right_coordinate(tmp_path):
    machine = plant.static_table()
    lacking = ("thermal_drift", "axis_growth", "spindle_growth", "table_growth")
    result = diagnose(read_by_the_plant(tmp_path / "c", machine, grid_runs(machine), [DRIFT]), exclude=lacking)
    assert result.findings[0].name == "unknown"
    assert result.findings[0].coordinate == "t"


def test_findings_that_predict_nothing_are_doubted() -> None:
    fit = Fit(1.0, 0.6, 4.0, 1.4, 1.0, 1.1, {"feed": (1.0, 0.7), "place": (1.0, 2.0)})
    doubts = fit.doubts("µm")
    assert [d.split(" that ")[0] for d in doubts] == ["A run", "A place"]
    assert "1 → 1.1 µm" in doubts[0] and "beyond the places recorded" in doubts[1]
    assert not Fit(1.0, 0.6, 4.0, 1.4, None, None).doubts("µm")


def test_findings_that_do_not_hold_at_another_place_are_doubted_though_they_help_there() -> None:
    (said,) = Fit(3.0, 0.5, 36.0, 1.0, 3.0, 0.52, {"place": (3.0, 1.2)}).doubts("µm")
    assert "predicted to 1.2 µm" in said and " 0.5 µm" in said and "beyond the places recorded" in said


def _plays_at_two_feeds(planes: tuple[str, str], plays: tuple[float, float]) -> Fit:
    """Cross-validation of a backlash of X: circles of 100 mm at 1000 and at 2000 mm/min, each in its plane and with its play of X
    (µm) where that moves."""
    machine, runs = preset("three-axis"), []
    for k, (plane, play, feed) in enumerate(zip(planes, plays, (1000.0, 2000.0), strict=True)):
        for sense in (1, -1):
            phi = sense * 2.0 * np.pi * (np.arange(120) + 0.5) / 120
            moved = 0.5 * play * sense * np.sign(np.sin(phi)) * np.cos(phi) if plane == "XY" else np.zeros(120)
            read = moved + 0.3 * np.random.default_rng([k, sense + 1]).standard_normal(120)
            circle = {"centre": (0.0, 0.0, 80.0), "radius": 100.0, "feed": feed, "plane": plane}
            runs.append(polar_run(machine, np.degrees(phi), read, id=f"{plane}{feed:.0f}{sense}", **circle))
    before = identify(Campaign(machine=machine, runs=tuple(runs)), noise="repeats")
    return cross_validated(before, amend(before, make_effect("backlash", "X")))


def test_what_the_other_feeds_do_not_show_is_no_doubt():
    """In YZ X stands still: without the circles in XY nobody knows its play."""
    fit = _plays_at_two_feeds(("XY", "YZ"), (8.0, 8.0))
    assert fit.heldout_by["feed"][1] > 3.0 * fit.rms_after_um
    assert fit.heldout_expected_um["feed"] > fit.heldout_by["feed"][1]
    assert not any("feed" in said for said in fit.doubts("µm"))


def test_a_play_that_is_another_at_another_feed_is_doubted():
    fit = _plays_at_two_feeds(("XY", "XY"), (8.0, 2.0))
    assert any("A feed that was left out" in said for said in fit.doubts("µm"))


def test_what_is_expected_of_left_out_runs_is_what_they_leave_under_slow_noise_too():
    """Runs in three planes, each with errors that the others tell nothing of: machines drawn from their priors. Slow noise counts
    less where slopes are whitened; the readings do not become quieter by that. It had been expected half as large."""
    machine, angles, runs = preset("three-axis"), np.degrees(np.linspace(0.0, 2.0 * np.pi, 300, endpoint=False)), []
    for plane in ("XY", "YZ", "ZX"):
        circle = {"centre": (0.0, 0.0, 80.0), "radius": 100.0, "feed": 1000.0, "plane": plane}
        runs.append(polar_run(machine, angles, np.zeros(300), id=plane, noise_um=0.3, **circle))
    left, expected = 0.0, 0.0
    for seed in range(4):
        drawn = simulate(Campaign(machine=machine, runs=tuple(runs)), seed=seed).campaign
        slow = np.random.default_rng(seed).standard_normal((3, 300))
        for k in range(1, 300):
            slow[:, k] = 0.97 * slow[:, k - 1] + 0.24 * slow[:, k]
        read = [
            run.with_readings({"dL_um": run.readings["dL_um"] + each[: run.rows]})
            for run, each in zip(drawn.runs, slow, strict=True)
        ]
        fit = identify(replace(drawn, runs=tuple(read)))
        assert all(noise.coloured > noise.white for noise in fit.noises.values())
        quality = cross_validated(fit, fit)
        left += quality.heldout_rms_after_um**2
        expected += quality.heldout_expected_um["run"] ** 2
    assert 0.5 < left / expected < 2.0


@pytest.mark.slow
def test_a_slip_in_a_long_run_is_placed_between_two_rows():
    """Every seventh of 1,080 rows had been looked at, and a creep that was not there made up for the rest."""
    machine, rng, row = preset("three-axis"), np.random.default_rng(8), 524
    circle = {"centre": (0.0, 0.0, 80.0), "radius": 100.0, "feed": 1000.0, "angle_error": 0.0}
    runs = []
    for sense in (1, -1):
        phi = sense * 2.0 * np.pi * np.arange(1080) / 1080
        slip = 6.0 * np.cos(phi) * (np.arange(1080) >= row) if sense > 0 else 0.0
        read = slip + 0.3 * rng.standard_normal(1080)
        runs.append(polar_run(machine, np.degrees(phi), read, id=f"circle{sense}", noise_um=0.3, **circle))
    (finding,) = diagnose(Campaign(machine=machine, runs=tuple(runs))).findings
    assert finding.effect.id == "setup_shift" and finding.effect.shape == "step"
    before, after = runs[0].time[row - 1 : row + 1]
    assert before < finding.parameters["t_s"].value < after


def test_of_a_single_run_no_feed_and_no_place_can_be_left_out():
    read = 0.3 * np.random.default_rng(0).standard_normal(360)
    circle = {"centre": (0.0, 0.0, 80.0), "radius": 100.0, "feed": 1000.0}
    machine = preset("three-axis")
    fit = identify(Campaign(machine=machine, runs=(polar_run(machine, np.arange(360.0), read, **circle),)))
    found = cross_validated(fit, fit)
    assert found.heldout_rms_after_um and found.heldout_by == {} and list(found.heldout_expected_um) == ["run"]


@pytest.mark.xfail(strict=True, reason="not reached: the curve is fitted to 1.5 times the noise only")
@pytest.mark.slow
def test_a_curve_of_the_drives_force_is_found_beside_friction_that_keeps_its_values():
    """The library knows two levels of friction; what bends over the speed is named as unknown, over the speed, in the drive."""
    machine = without_drives(preset("three-axis"))
    time = np.arange(2400) * 0.01
    way = 40.0 * np.sin(1.3 * time) * (1.0 + np.sin(0.31 * time))
    speed = np.gradient(way, time)
    acceleration = np.gradient(speed, time)
    noise = np.random.default_rng(3).normal(0.0, 0.3, len(time))
    friction = 20.0 * np.clip(speed / 0.1, -1.0, 1.0) - 3.0
    curve = 6.0 * np.exp(-np.abs(speed) / 15.0)
    force = 95e-3 * acceleration + 0.2 * speed + friction + curve + noise
    run = Run(
        id="x", instrument=("drive_force",), sampling="dynamic", time=time, noise_um=0.3, readings={"X_force_N": force},
        commands={**dict.fromkeys(machine.axis_names, np.zeros(len(time))), "X": way},
        options={"axis": "X", "force_terms": ("mass", "viscous")},
    )  # fmt: skip
    found = diagnose(Campaign(machine=machine, runs=(run,)))
    first, second = found.findings[:2]
    assert (first.name, first.axis, second.name, second.coordinate) == ("friction", "X", "unknown", "X velocity")
    assert all("the drive of X" in place_words(f, machine) and f.effect.in_the_drive for f in (first, second))
    assert first.confidence > 0.9 and found.fit.rms_after_um < 1.1 * 0.3
    own = np.column_stack([np.ones(len(time)), np.clip(speed / 0.1, -1.0, 1.0), speed, acceleration])
    level, coulomb = np.linalg.lstsq(own, force, rcond=None)[0][:2]  # what the published model would say
    assert first.parameters["coulomb"].value == pytest.approx(coulomb, abs=0.15)
    assert first.parameters["offset"].value == pytest.approx(level, abs=0.15)
