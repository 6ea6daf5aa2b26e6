"""Readings that no fit has seen: ways to hold them out, what is said of them, findings that they refute."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from laser_world import axis_alone, laser_run
from pages import without_figures

from symfive import cli
from symfive.campaign import Campaign, write_campaign
from symfive.diagnose import Diagnosis, diagnose, held_out, held_out_square, parted, root, withdraw
from symfive.effects import Form, make_effect
from symfive.errors import InputError
from symfive.posterior import baseline, moments_of, refitted
from symfive.report import diagnosis_text
from symfive.simulate import simulate

PLACES = np.array([0.0, 40.0, 80.0, 120.0, 160.0, 200.0])
NOISE_UM, WIDTH_UM = 0.3, 12.0


def axis_test(width: float = WIDTH_UM, runs: int = 1, seed: int = 3) -> Campaign:
    """Runs of a laser on a linear axis with play, each four times up and down, with overruns."""
    machine = axis_alone(-10.0, 210.0, sigma_um=20.0)
    command = np.tile(np.concatenate([[-5.0], PLACES, [205.0], PLACES[::-1]]), 4)
    plan = [laser_run(f"r{number}", command, noise_um=NOISE_UM, start_s=1e3 * number) for number in range(runs)]
    play = make_effect("backlash", "X")
    truth = {"backlash.X.width": width, "EXX.P1": 20.0}
    return simulate(Campaign(machine=machine, runs=tuple(plan)), truth=truth, effects=[play], seed=seed).campaign


def jagged(targets: int = 11, cycles: int = 5, seed: int = 8) -> Campaign:
    """A test as of ISO 230-2, each cycle a run, of an axis whose deviation is another one at every target from either side."""
    rng = np.random.default_rng(seed)
    measured = axis_test(width=0.0)
    targets_mm = np.linspace(0.0, 200.0, targets)
    deviation = {side: rng.normal(0.0, 8.0, targets) for side in ("up", "down")}
    command = np.concatenate([[-5.0], targets_mm, [205.0], targets_mm[::-1]])
    true = np.concatenate([[0.0], deviation["up"], [0.0], deviation["down"][::-1]])
    runs = tuple(
        replace(
            measured.runs[0], id=f"cycle-{k}", file=f"cycle-{k}.csv", time=np.arange(float(len(command))),
            commands={"X": command}, start_s=100.0 * k,
            readings={"X_dev_um": true + rng.normal(0.0, NOISE_UM, len(command))},
        )
        for k in range(cycles)
    )  # fmt: skip
    return replace(measured, runs=runs)


@pytest.fixture(scope="module")
def refuted() -> Diagnosis:
    """Play in three runs, none in the fourth, which is held out."""
    with_play, without = axis_test(runs=4), axis_test(width=0.0, runs=4, seed=4)
    return diagnose(replace(with_play, runs=(*with_play.runs[:3], without.runs[3])), hold_out="runs:r3")


@pytest.fixture(scope="module")
def halved() -> Diagnosis:
    """Fitted on the first half of one run with play."""
    return diagnose(axis_test(), hold_out="half")


@pytest.mark.parametrize(("how", "count"), [("half", 28), pytest.param("cycles", 27, marks=pytest.mark.slow)])
def test_a_play_stands_on_what_was_held_out(halved: Diagnosis, how: str, count: int) -> None:
    found = halved if how == "half" else diagnose(axis_test(), hold_out=how)
    assert [(f.name, f.axis) for f in found.findings] == [("backlash", "X")]
    held = found.hold_out
    assert held is not None and not held.withdrawn
    assert held.readings == {"all": 56, "fitted": 56 - count, "held_out": count}
    assert found.after.model.campaign.rows == 56 - count
    for before, after in held.rms.values():
        assert before > 3.0 and after < 1.3 * NOISE_UM
    squares = [held.readings[part] * held.rms[part][1] ** 2 for part in ("all", "fitted", "held_out")]
    assert squares[0] == pytest.approx(squares[1] + squares[2])
    assert held.rms["fitted"][1] == pytest.approx(found.fit.rms_after_um, rel=1e-6)
    assert found.summary.endswith(".") and "Held out: " in found.summary and "Withdrawn" not in found.summary


@pytest.mark.slow
def test_a_table_by_either_side_is_learnt_from_two_cycles_and_predicts_the_others() -> None:
    found = diagnose(jagged(), hold_out="runs:cycle-2,cycle-3,cycle-4")
    assert [(f.name, set(f.effect.coordinate.split(", "))) for f in found.findings] == [
        ("unknown", {"X", "X velocity sign"})
    ]
    held = found.hold_out
    assert held is not None and not held.withdrawn
    before, after = held.rms["held_out"]
    assert before > 5.0 and after < 1.3 * NOISE_UM


@pytest.mark.parametrize(
    ("size", "seed"), [(100.0, 9), *(pytest.param(*odd, marks=pytest.mark.slow) for odd in ((40.0, 9), (60.0, 8)))]
)
def test_of_two_cycles_the_odd_readings_are_found_beside_what_they_hide(size: float, seed: int) -> None:
    """The first two targets of the first cycle: the table that explains the rest decides which are wrong."""
    measured = jagged(targets=5, seed=seed)
    first, *others = measured.runs
    wrong = first.readings["X_dev_um"].copy()
    wrong[1:3] += size, 0.5 * size
    spoilt = replace(measured, runs=(first.with_readings({"X_dev_um": wrong}), *others))
    found = diagnose(spoilt, hold_out="runs:cycle-2,cycle-3,cycle-4")
    assert [(o.run, o.row) for o in found.after.outliers] == [("cycle-0", 1), ("cycle-0", 2)]
    assert found.hold_out is not None and found.hold_out.rms["held_out"][1] < 1.5 * NOISE_UM


def test_what_is_held_out_is_not_learnt_from(halved: Diagnosis) -> None:
    """Other readings in the held-out half change nothing but how they are predicted."""
    measured = axis_test()
    (run,) = measured.runs
    wrong = run.readings["X_dev_um"] + np.where(np.arange(run.rows) < run.rows // 2, 0.0, 500.0)
    plain = halved
    spoilt = diagnose(replace(measured, runs=(run.with_readings({"X_dev_um": wrong}),)), hold_out="half")
    assert spoilt.before.named == plain.before.named and spoilt.p_value == plain.p_value
    assert plain.hold_out is not None and spoilt.hold_out is not None
    assert spoilt.hold_out.rms["held_out"][0] == pytest.approx(500.0, rel=0.05)


def test_a_finding_that_is_refuted_is_withdrawn_and_said(refuted: Diagnosis) -> None:
    held = refuted.hold_out
    assert held is not None and not refuted.findings and not refuted.after.model.added
    assert [w.words for w in held.withdrawn] == ["backlash of axis X"]
    (gone,) = held.withdrawn
    assert gone.rms_with_um > 1.01 * gone.rms_without_um
    assert held.rms["held_out"][1] == pytest.approx(gone.rms_without_um)
    assert "Withdrawn: backlash of axis X predicted run r3 worse, " in refuted.summary
    assert "Withdrawn: backlash of axis X" in diagnosis_text(refuted)
    data = json.loads(json.dumps(refuted.to_data()))["hold_out"]
    assert data["held_out"] == "run r3" and data["withdrawn"][0]["axis"] == "X"
    assert data["rms_after_um"].keys() == data["readings"].keys() == {"all", "fitted", "held_out"}


def test_what_is_nothing_without_a_withdrawn_effect_is_withdrawn_with_it() -> None:
    """A shift beside a refuted play stayed a finding of 0.0σ with the confidence that it had beside the play."""
    with_play, without = axis_test(runs=4), axis_test(width=0.0, runs=4, seed=4)
    whole = replace(with_play, runs=(*with_play.runs[:3], without.runs[3]))
    _, split = parted(whole, "runs:r3")
    learnt = split.fitted(whole)
    effects = [make_effect("backlash", "X"), make_effect("setup_shift", run="r0", t_s=28.5)]
    before = baseline(learnt)
    here = refitted(moments_of(before, (), [Form(effect=e.prepare(learnt)) for e in effects]), ((0, 1.0), (1, 1.0)))
    left, gone = withdraw(here, before, whole, split)
    assert not left.held and [w.effect.id for w in gone] == ["backlash", "setup_shift"]
    said = held_out(before, left.fit, whole, split, gone).sentences("µm")
    assert "predicted run r3 worse" in said[0] and said[1] == "Withdrawn: setup shift is below 2σ without it."


@pytest.mark.slow
def test_a_run_that_no_fit_has_seen_has_its_own_zero() -> None:
    measured = axis_test(runs=2)
    shifted = measured.runs[1].with_readings({"X_dev_um": measured.runs[1].readings["X_dev_um"] + 3.0})
    both = []
    for last in (measured.runs[1], shifted):
        campaign, split = parted(replace(measured, runs=(measured.runs[0], last)), "runs:r1")
        fit = diagnose(campaign, hold_out=split).after
        both.append(root(*held_out_square(fit, campaign, split, "um")))
    assert both[0] == pytest.approx(both[1], rel=1e-2)


def test_cycles_keep_every_row_and_the_side_of_their_first_one() -> None:
    measured = axis_test()
    cut, split = parted(measured, "cycles")
    commands = np.concatenate([run.commands["X"] for run in cut.runs])
    assert np.array_equal(commands, measured.runs[0].commands["X"])
    assert [run.rows for run in cut.runs] == [15, 14, 14, 13]
    assert [bool(split.learn(run).all()) for run in cut.runs] == [True, False, True, False]
    first = 0
    for run in cut.runs[1:]:
        first += cut.runs[cut.runs.index(run) - 1].rows
        step = commands[first] - commands[first - 1]
        assert np.sign(step) == np.sign(run.commands["X"][1] - run.commands["X"][0])


def test_runs_of_different_kinds_are_not_each_others_cycles() -> None:
    measured = axis_test(runs=3)
    short = [run.part(0, 13) for run in measured.runs]
    _, split = parted(replace(measured, runs=tuple(short)), "cycles")
    assert [bool(split.learn(run).all()) for run in short] == [True, False, True]
    with pytest.raises(InputError, match="no two runs are of one kind"):
        parted(replace(measured, runs=tuple(short[:1])), "cycles")


@pytest.mark.parametrize(("how", "said"), [
    ("runs:r7", 'there is no run "r7" to hold out; use one of r0, r1'),
    ("runs:r*", "nothing is left to fit without runs r0, r1"),
    ("quarter", '"quarter" is no way to hold out readings; write half, cycles, or runs:NAME'),
    ("runs:", '"runs:" is no way to hold out readings'),
])  # fmt: skip
def test_a_hold_out_that_cannot_be_is_one_sentence(how: str, said: str) -> None:
    with pytest.raises(InputError) as error:
        diagnose(axis_test(runs=2), hold_out=how)
    assert str(error.value).startswith(said) and "\n" not in str(error.value)


def test_runs_too_short_to_be_halved() -> None:
    measured = axis_test()
    with pytest.raises(InputError, match="no run is long enough"):
        parted(replace(measured, runs=(measured.runs[0].part(0, 3),)), "half")


def test_the_command_line_holds_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    without_figures(monkeypatch)
    write_campaign(axis_test(), tmp_path / "c")
    verb = ["diagnose", str(tmp_path / "c"), "-o", str(tmp_path / "d")]
    assert cli.main([*verb, "--hold-out", "runs:no"]) == 2
    said = capsys.readouterr().err
    assert 'there is no run "no" to hold out' in said and said.count("\n") == 1 and not (tmp_path / "d").exists()
    assert cli.main([*verb, "--hold-out", "half"]) == 0
    assert "Held out: the second half of each run (28 of 56 readings)" in capsys.readouterr().out
    data = json.loads((tmp_path / "d" / "diagnosis.json").read_text())
    assert data["hold_out"]["readings"]["held_out"] == 28
    assert "Held out: the second half of each run" in (tmp_path / "d" / "report.html").read_text()
