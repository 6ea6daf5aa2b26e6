"""A ball that stands elsewhere than the file says: the readings are explained, by errors that were thought impossible."""

from dataclasses import replace

import pytest

from symfive.campaign import Campaign
from symfive.diagnose import diagnose
from symfive.effects import make_effect
from symfive.identify import Tension, identify, relief_notes, tensions
from symfive.machine import preset
from symfive.model import Model
from symfive.parameters import Parameter
from symfive.procedures import campaign_of, planar_circle, r_test_grid
from symfive.report import diagnosis_text
from symfive.simulate import simulate

MACHINE = preset("table-bc")
PLAN = campaign_of(MACHINE, planar_circle(MACHINE, rate_hz=5.0))


def measured(off_um: float) -> Campaign:
    """Both circles with the table ball off by so much along X, the machine exact."""
    truth = {f"setup.{run.id}.table_ball.x": off_um for run in PLAN.runs}
    exact = {p.name: 0.0 for p in identify(simulate(PLAN, seed=1).campaign).parameters}
    return simulate(PLAN, truth=exact | truth, seed=1).campaign


def test_it_is_said_which_error_is_far_from_its_prior_and_what_to_check() -> None:
    found = identify(measured(800.0))
    assert found.chi2_dof < 1.3
    (said,) = (note for note in found.notes if "prior 1σ from its prior mean" in note)
    assert "check where balls and nests stand (table_ball" in said
    assert found.model.parameters and any(said.startswith(t.words) for t in tensions(found))


@pytest.mark.parametrize("off_um", [0.0, 30.0])
def test_nothing_is_said_of_a_ball_that_stands_where_the_file_says(off_um: float) -> None:
    assert not [note for note in identify(measured(off_um)).notes if "prior mean" in note]


def test_what_the_user_holds_far_from_its_prior_is_no_tension() -> None:
    name = next(p.name for p in identify(measured(0.0)).parameters if p.kind == "location_error")
    sigma = MACHINE.errors[name].sigma
    assert not [note for note in identify(measured(0.0), fixed={name: 8.0 * sigma}).notes if note.startswith(name)]


@pytest.mark.slow
def test_a_ball_that_stands_elsewhere_is_no_fault_and_it_is_said_what_to_check() -> None:
    found = diagnose(measured(800.0))
    assert not found.findings
    said = " ".join(found.doubts).lower()
    assert "check where balls" in said and "how long the bar is (length" in said


def test_an_effect_is_no_tension_however_large() -> None:
    """ "Check where balls and nests stand before a correction is entered" was said of the friction of a drive."""
    play = make_effect("backlash", "X")
    truth = dict.fromkeys((p.name for p in Model(PLAN).parameters), 0.0) | {"backlash.X.width": 300.0}
    found = identify(simulate(PLAN, truth=truth, effects=[play], seed=1).campaign, effects=[play])
    assert found["backlash.X.width"] == pytest.approx(300.0, abs=3.0 * found.uncertainty("backlash.X.width"))
    assert not [note for note in found.notes if "prior mean" in note]


def test_a_diagnosis_without_findings_says_what_to_check() -> None:
    """A tool 0.4 mm shorter than entered went into EZ0A, 11 prior 1σ from its mean, and the diagnosis asked for further runs."""
    plan = campaign_of(MACHINE, r_test_grid(MACHINE, step_deg=90.0))
    exact = dict.fromkeys((p.name for p in Model(plan).parameters), 0.0)
    shorter = {f"setup.{run.id}.tool_ball.z": 400.0 for run in plan.runs}
    found = diagnose(simulate(plan, truth=exact | shorter, seed=1).campaign)
    assert not found.findings and "where balls and nests stand" in found.doubts[0]
    assert "Next: check the set-up" in diagnosis_text(found) and found.doubts[0] in found.summary


def test_readings_that_refute_a_fit_are_not_explained_nearly_as_well_by_it() -> None:
    """However far its set-up is from the priors: no place of the ball leaves half as much again of the noise."""
    campaign = measured(2000.0)
    anywhere = replace(campaign.runs[0].setup_sigma_um, table_ball=4000.0)
    runs = tuple(replace(run, setup_sigma_um=anywhere) for run in campaign.runs)
    plain, relieved = identify(campaign), identify(replace(campaign, runs=runs))
    assert relief_notes(plain, relieved)
    assert not relief_notes(replace(plain, chi2_dof_whitened=1.5 * plain.chi2_dof_whitened), relieved)


def test_of_a_clock_that_is_far_off_the_times_are_to_be_checked() -> None:
    clock = Parameter(name="setup.ccw.clock", unit="ms", sigma=1.0, kind="setup", run="ccw")
    late = Tension(kind="set-up", statistic=1e4, dof=2.0, p=0.0, worst=clock, sigmas=100.0)
    assert late.words == "clock of run ccw" and "clock of run ccw by 100.0 σ" in late.says
    runs = tuple(replace(run, clock_sigma_ms=1.0) for run in PLAN.runs)
    plan = replace(PLAN, runs=runs)
    exact = {p.name: 0.0 for p in identify(simulate(plan, seed=1).campaign).parameters}
    late_by = {f"setup.{run.id}.clock": 40.0 for run in runs}
    (said,) = (n for n in identify(simulate(plan, truth=exact | late_by, seed=1).campaign).notes if "prior mean" in n)
    assert said.startswith("clock of run ") and "clock_sigma_ms" in said and "table_ball" not in said


def test_a_bar_that_was_not_calibrated_is_among_what_to_check() -> None:
    """Its error is that of the scale of both axes, to which the machine's errors give way."""
    exact = {p.name: 0.0 for p in identify(simulate(PLAN, seed=1).campaign).parameters}
    long = {f"setup.{run.id}.length": 25.0 for run in PLAN.runs}
    (said,) = (n for n in identify(simulate(PLAN, truth=exact | long, seed=1).campaign).notes if "prior mean" in n)
    assert "how long the bar is (length" in said
