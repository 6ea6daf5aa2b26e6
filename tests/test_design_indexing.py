"""Spindle indexing and known set-ups: closed forms, files, programs, and the sentence that says what dominates."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lean import location_only

from symfive.campaign import Campaign, Run, SetupSigma, read_campaign, write_campaign
from symfive.design import Plan, assess, plan
from symfive.errors import InputError
from symfive.machine import preset
from symfive.nc import DIALECTS, Post, program, program_steps
from symfive.simulate import simulate
from tests.plan_checker import check
from tests.plan_checker.dialects import DIALECTS as WORDS

NOISE = 0.3


@pytest.fixture(scope="module")
def made() -> Plan:
    options = {"points": 8, "starts": 1, "anywhere": False, "prove": False}
    known = SetupSigma(tool_length=2.0)
    return plan(location_only("table-bc"), criterion="V", index=True, setup_sigma=known, **options)


def _turned(run: Run, degree: float) -> Run:
    return replace(run, spindle=np.full(run.rows, degree))


def test_two_readings_of_a_pose_tell_the_run_out(made: Plan) -> None:
    """1σ is noise/√2 at most, whatever the machine does; the design took it for so much, and the whole plan agrees."""
    sigma = made.assessment.sigma
    for run in made.campaign.runs:
        for c in "xy":
            assert sigma[f"setup.{run.id}.tool_ball.{c}"] <= NOISE / np.sqrt(2.0)
        assert list(run.spindle[:3]) == [0.0, 180.0, 0.0]
    assert made.assessment.tool_centre_um is not None and made.assessment.tool_centre_um[0] < 8.0
    unindexed = replace(made.campaign, runs=tuple(replace(run, spindle=None) for run in made.campaign.runs))
    before = assess(unindexed).tool_centre_um
    assert before is not None and before[0] > 10.0


def test_the_ball_goes_around_with_the_spindle(made: Plan) -> None:
    """A ball 10 µm off in x stands 10 µm off in y at 90° and on the other side at 180°, all else being without error."""
    run = made.campaign.runs[0]
    truth = dict.fromkeys(made.assessment.sigma, 0.0)

    def read(x: float, y: float, degree: float) -> np.ndarray:
        campaign = replace(made.campaign, runs=(_turned(run, degree),))
        offsets = {f"setup.{run.id}.tool_ball.x": x, f"setup.{run.id}.tool_ball.y": y}
        values = {
            name: value
            for name, value in (truth | offsets).items()
            if name.startswith(f"setup.{run.id}") or "setup" not in name
        }
        return np.stack(list(simulate(campaign, truth=values, noise=False).campaign.runs[0].readings.values()))

    assert read(10.0, 0.0, 90.0) == pytest.approx(read(0.0, 10.0, 0.0), abs=1e-6)
    assert read(10.0, 0.0, 180.0) == pytest.approx(read(-10.0, 0.0, 0.0), abs=1e-6)


def test_the_spindle_stands_in_the_files_and_in_every_program(made: Plan, tmp_path: Path) -> None:
    made.write(tmp_path / "plan", nc=DIALECTS)
    again = read_campaign(tmp_path / "plan")
    for run, same in zip(made.campaign.runs, again.runs, strict=True):
        assert same.spindle is not None and np.array_equal(run.spindle, same.spindle)
        assert same.setup_sigma_um.tool == (20.0, 20.0, 2.0)
    assert check(tmp_path / "plan") == []
    for dialect in DIALECTS:
        text = program(made.machine, made.campaign.runs[0], dialect, made.post)
        assert re.findall(WORDS[dialect].orient, text) == ["0", "180", "0"]
    assert "spindle turned to 180°" in (tmp_path / "plan" / "setup.html").read_text(encoding="utf-8")
    write_campaign(again, tmp_path / "again")
    assert (tmp_path / "again" / again.runs[0].file).read_text() == (tmp_path / "plan" / again.runs[0].file).read_text()


def test_a_run_without_indexing_turns_no_spindle(made: Plan) -> None:
    run = replace(made.campaign.runs[0], spindle=None)
    assert not any(step.kind == "orient" for step in program_steps(made.machine, run, Post()))


@pytest.mark.parametrize(
    ("known", "index", "name"),
    [
        ({}, False, "the tool ball's run-out (20 µm)"),
        pytest.param({}, True, "the tool's length (20 µm)", marks=pytest.mark.slow),
        pytest.param(
            {"tool_length": 2.0}, True, "the nest's position in the workpiece frame (not known)", marks=pytest.mark.slow
        ),
    ],
)
def test_what_dominates_is_named(known: dict[str, float], index: bool, name: str) -> None:
    options = {"points": 40, "setups": 1, "starts": 1, "anywhere": False, "prove": False}
    made = plan("table-bc", criterion="V", index=index, setup_sigma=SetupSigma(**known), **options)
    (said,) = (note for note in made.notes if note.startswith("more poses in these set-ups hardly help"))
    assert f"; {name} dominates; if it were known exactly, " in said


def test_what_indexing_leaves_is_not_indexed_again() -> None:
    options = {"points": 40, "setups": 1, "starts": 1, "anywhere": False, "prove": False}
    known = SetupSigma(tool_length=0.01)
    made = plan(location_only("table-bc"), criterion="A", for_=("EX0B",), index=True, setup_sigma=known, **options)
    (said,) = (note for note in made.notes if "the tool ball's run-out" in note)
    assert "the noise of the spindle indexing limits it" in said and "--index" not in said


def test_the_fewer_poses_named_do_as_well() -> None:
    options = {"criterion": "V", "setups": 1, "starts": 1, "anywhere": False, "prove": False}
    made = plan(location_only("table-bc"), points=40, **options)
    (few,) = (
        re.search(r"hardly help, (\d+) of the 40 do as well", note) for note in made.notes if "hardly help" in note
    )
    left = plan(location_only("table-bc"), points=int(few[1]), **options)
    assert int(few[1]) <= 20
    assert 0.9 < np.exp(0.5 * (made.certificate.value - left.certificate.value)) < 1.0


def test_nothing_dominates_where_poses_help() -> None:
    made = plan(location_only("table-bc"), points=8, setups=1, starts=1, anywhere=False, prove=False)
    assert not [note for note in made.notes if "hardly help" in note]


def test_nothing_dominates_where_readings_are_fewer_than_unknowns() -> None:
    """Three poses read four times are hardly better than read once, but six are: they determine what three do not."""
    options = {"instrument": "ball_bar", "criterion": "A", "setups": 1, "starts": 1, "anywhere": False, "prove": False}
    few, more = (plan(location_only("three-axis"), points=points, **options) for points in (3, 6))
    assert few.assessment.value > more.assessment.value + 0.1
    assert not [note for made in (few, more) for note in made.notes if "hardly help" in note]


def test_what_cannot_be_indexed_is_said() -> None:
    with pytest.raises(InputError, match="spindle indexing with ball_bar is not written: it needs three readings"):
        plan("table-bc", instrument="ball_bar", index=True)
    with pytest.raises(InputError, match="head in the spindle is not written: its zeros turn with it"):
        plan("table-bc", frame="machine", index=True)
    machine = preset("table-bc")
    commands = dict.fromkeys(machine.axis_names, np.zeros(2))
    run = Run(id="a", instrument=("r_test",), sampling="static", time=np.arange(2.0), commands=commands)
    assert Campaign(machine=machine, runs=(_turned(run, 90.0),)).rows == 2
    with pytest.raises(InputError, match="run a: spindle_deg in a recording at a constant rate"):
        replace(run, sampling="dynamic", spindle=np.zeros(2))
    with pytest.raises(InputError, match="spindle_deg has 3 rows, t_s has 2"):
        replace(run, spindle=np.zeros(3))
    with pytest.raises(InputError, match=r"zero = 0\.0 is not a standard deviation"):
        SetupSigma(zero=0.0)
