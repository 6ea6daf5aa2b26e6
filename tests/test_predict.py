"""`predict` and `check` where the machine file declares no error, or a run has nothing of its own to be fitted."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_real_recordings import recordings

from symfive.campaign import Campaign, Run, SetupSigma, write_campaign
from symfive.check import check
from symfive.cli import main
from symfive.convert import convert
from symfive.identify import fitted_model, identify, predict
from symfive.machine import preset
from symfive.model import Model, write_model
from symfive.simulate import simulate

TIME = np.arange(80) * 0.1
COMMANDS = {"X": 50.0 * np.sin(TIME), "Y": 40.0 * np.cos(TIME), "Z": 10.0 * np.sin(2.0 * TIME)}
SENSOR = {"direction": [1.0, 0.0, 0.0], "position": [0.0, 0.0, 0.0]}
RUNS: dict[str, dict[str, Any]] = {
    "encoder": {"options": {"encoder_axes": ["X"]}},
    "drive_force": {"options": {"axis": "X"}},
    "encoder+drive_force": {"options": {"axis": "X", "encoder_axes": ["X"]}},
    "ball_bar": {"length": 100.0, "tool_ball": (0.0, 0.0, -100.0)},
    "r_test": {"tool_ball": (0.0, 0.0, -100.0)},
    "laser": {"options": {"axis": "X"}},
    "grid_encoder": {"u": (1.0, 0.0, 0.0), "v": (0.0, 1.0, 0.0)},
    "straightedge": {"u": (0.0, 0.0, 1.0), "v": (1.0, 0.0, 0.0)},
    "tracker": {"options": {"placement_sigma": (1e-9, 1e-9)}},
    "displacement": {"options": {"sensors": [SENSOR]}},
    "touch_probe": {"sampling": "static", "tool_ball": (0.0, 0.0, -100.0)},
}
"""By instruments: what their run needs, and its sampling where they know but one."""


def measured(instruments: str, sampling: str = "dynamic", errors: bool = False) -> Campaign:
    """A run of these, set up exactly, on a machine without errors or with those of its preset."""
    machine = preset("three-axis")
    run = Run(
        id="r", instrument=tuple(instruments.split("+")), time=TIME, commands=COMMANDS, noise_um=0.5,
        setup_sigma_um=SetupSigma(table_ball=0.0, tool_ball=0.0, length=0.0), **{"sampling": sampling} | RUNS[instruments],
    )  # fmt: skip
    plan = Campaign(machine=machine if errors else replace(machine, errors={}), runs=(run,))
    return simulate(plan, seed=1).campaign


@pytest.mark.parametrize("errors", [False, True])
@pytest.mark.parametrize(
    ("instruments", "sampling"),
    [(name, s) for name, run in RUNS.items() for s in ("static", "dynamic") if run.get("sampling", s) == s],
)
def test_a_run_with_nothing_to_fit_is_predicted(instruments: str, sampling: str, errors: bool) -> None:
    campaign = measured(instruments, sampling, errors)
    fit = identify(campaign)
    assert predict(fitted_model(fit), campaign).rms["r"] == pytest.approx(fit.rms_um, rel=1e-6)
    assert identify(campaign, fixed=fit.named).rms_um == pytest.approx(fit.rms_um, rel=1e-6)
    assert identify(campaign, fixed=fit.named, solver="ipopt", loss="huber").rms_um == pytest.approx(
        fit.rms_um, rel=1e-6
    )


def test_a_prediction_in_several_units_has_one_rms_a_column() -> None:
    campaign = measured("encoder+drive_force")
    found = predict(fitted_model(identify(campaign)), campaign)
    left = {name: found.campaign.runs[0].readings[name] - values for name, values in campaign.runs[0].readings.items()}
    assert set(left) == {"X_act_mm", "X_force_N"}
    for name, difference in left.items():
        assert found.rms_by_column["r"][name] == pytest.approx(float(np.sqrt(np.mean(difference**2))), rel=1e-9)


def test_the_motion_is_not_predicted_and_has_no_part_in_the_rms() -> None:
    campaign = measured("encoder+drive_force")
    run = campaign.runs[0]
    taken = replace(campaign, runs=(replace(run, options={**run.options, "motion_from": "encoder"}),))
    found = predict(fitted_model(identify(taken)), taken)
    assert list(found.rms_by_column["r"]) == ["X_force_N"]
    assert found.rms["r"] == found.rms_by_column["r"]["X_force_N"] > 0.3


def test_an_axis_without_an_encoder_follows_its_command_where_others_move_as_recorded() -> None:
    campaign = measured("encoder+drive_force")
    run = replace(campaign.runs[0], options={**campaign.runs[0].options, "motion_from": "encoder", "low_pass_hz": 2.0})
    for readings in (run.readings, {}):  # measured, and as a plan
        at = Model(replace(campaign, runs=(run.with_readings(readings),)))
        assert np.ptp(at.predict({"drive_force.X.mass": 5.0})["r"][:, 1]) > 0.1


def test_the_command_prints_each_unit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    campaign = measured("encoder+drive_force")
    write_campaign(campaign, tmp_path / "c")
    write_model(fitted_model(identify(campaign)), tmp_path / "model.json")
    assert main(["predict", str(tmp_path / "model.json"), str(tmp_path / "c"), "-o", str(tmp_path / "p")]) == 0
    said = capsys.readouterr().out
    assert " mm, X_force_N 0." in said and said.rstrip().endswith(" N")
    data = json.loads((tmp_path / "p" / "prediction.json").read_text())
    assert set(data["rms_by_column"]["r"]) == {"X_act_mm", "X_force_N"}


@pytest.mark.parametrize(
    ("instruments", "problems", "notes"),
    [("drive_force", 0, 0), ("laser", 0, 1), ("ball_bar", 1, 0), ("encoder", 1, 0)],
)
def test_what_a_campaign_without_errors_can_identify(
    instruments: str, problems: int, notes: int, tmp_path: Path
) -> None:
    """Mass and friction of a drive; the zero of a laser; of an exact ball bar or the control's encoder nothing."""
    write_campaign(measured(instruments), tmp_path / "c")
    found = check(tmp_path / "c")
    assert len(found.problems) == problems
    assert not problems or "nothing can be identified" in found.problems[0].problem
    if instruments == "encoder":  # location errors would not help
        assert "encoder_zero_sigma" in found.problems[0].remedy
    assert sum("only the set-up" in note for note in found.notes) == notes


def test_a_machine_file_without_errors_is_a_problem_by_itself(tmp_path: Path) -> None:
    write_campaign(measured("drive_force"), tmp_path / "c")
    assert not check(tmp_path / "c" / "machine.toml").right


def test_the_recorded_drive_force_goes_from_check_to_prediction(tmp_path: Path) -> None:
    recordings("emps")
    campaign = convert("emps")
    write_campaign(campaign, tmp_path / "c")
    assert check(tmp_path / "c").right
    fit = identify(campaign)
    assert predict(fitted_model(fit), campaign).rms["DATA_EMPS"] == pytest.approx(fit.rms["N"], rel=1e-6)
