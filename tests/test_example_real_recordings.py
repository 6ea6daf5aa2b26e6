"""The example of the real recordings: its functions on simulated readings, and on the recordings where they are."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from laser_world import axis_alone, laser_run

from examples.real_recordings import figures, story, words
from examples.real_recordings.recordings import RECORDINGS, Part, Recording, halves, runs_with
from examples.real_recordings.rivals import RIVALS, best_rival, boosted, harmonic, table
from examples.real_recordings.study import Study, rms_of, study
from symfive.campaign import Campaign, Run
from symfive.convert import CONVERTERS, convert, data_folder
from symfive.diagnose import Split, amend, held_out_square, root
from symfive.effects import Effect, Varying, make_effect
from symfive.errors import InputError
from symfive.identify import identify
from symfive.importers import cycles_of, rows_of, turns_of
from symfive.machine import Machine, Structure, make_axis
from symfive.posterior import baseline
from symfive.simulate import simulate

PLACES = np.array([0.0, 40.0, 80.0, 120.0, 160.0, 200.0])
WIDTH_UM = 12.0
BY_NAME = {recording.name: recording for recording in RECORDINGS}


def axis_under_test() -> Campaign:
    """A linear axis, five times up and down in one run, as the converters hand over an ISO 230-2 file."""
    once = np.concatenate([[-5.0], PLACES, [205.0], PLACES[::-1]])
    command = np.tile(once, 5)
    runs = (laser_run("iso", command, noise_um=0.3),)
    return Campaign(machine=axis_alone(-10.0, 210.0, sigma_um=20.0), runs=runs, name="axis")


@pytest.fixture(scope="module")
def simulated() -> Study:
    """Backlash that the baseline does not know, through the functions of the example."""
    effect = make_effect("backlash", "X")
    plan = axis_under_test()
    pieces = tuple(cycles_of(plan.runs[0]))  # each begins anew: its first row counts as approached like its second
    whole = simulate(
        replace(plan, runs=pieces), truth={"backlash.X.width": WIDTH_UM}, effects=[effect], seed=3
    ).campaign
    recording = Recording(
        name="simulated (cycles)", machine="a simulated axis", source="none", prepared="cycles as runs", unit="um", over="X",
        column="X_dev_um", parts=(runs_with("1, 2 → 3, 4", "cycle-1", "cycle-2"),),
        published={"width": WIDTH_UM},
    )  # fmt: skip
    return study(recording, replace(whole, runs=whole.runs[:4]), unseen=replace(whole, runs=whole.runs[4:]))


def real(name: str) -> tuple[Recording, Campaign]:
    """A recording as it is handed to the diagnosis, or a visible skip."""
    recording = BY_NAME[name]
    try:
        folder = data_folder() / recording.converter
    except InputError as error:
        pytest.skip(str(error))
    if not folder.is_dir():
        pytest.skip(f"the recording {recording.converter} is not in {folder.parent}")
    return recording, recording.prepare(convert(recording.converter))


def sized(found: Study) -> bool:
    """Whether every finding differs from none by 2σ or more, and every number that was estimated has its 1σ."""
    for finding in found.found.findings:
        for name, q in finding.parameters.items():
            numbers = np.ravel(np.asarray(q.value, dtype=object))
            if not isinstance(numbers[0], str) and name not in vars(finding.effect) and q.std is None:
                return False
    return all(finding.sigmas >= 2.0 for finding in found.found.findings)


def held_out_with(campaign: Campaign, part: Part, effect: Effect, unit: str) -> tuple[float, float]:
    """rms of what a part predicts, by the plain model and with an effect that is named."""
    whole = part.cut(campaign)
    split = Split(part.label, lambda run: np.full(run.rows, part.learn(run)))
    learnt = split.fitted(whole)
    plain = identify(learnt, noise="repeats")
    fits = plain, amend(plain, effect.prepare(learnt))
    before, after = (root(*held_out_square(fit, whole, split, unit)) for fit in fits)
    return before, after


# --- without the recordings ----------------------------------------------------------------------------------


def test_every_converter_has_its_study_and_every_name_its_own() -> None:
    assert {recording.converter for recording in RECORDINGS} == set(CONVERTERS)
    assert len(BY_NAME) == len(RECORDINGS)


def test_cycles_repeat_each_other_and_lose_nothing() -> None:
    run = axis_under_test().runs[0]
    pieces = cycles_of(run)
    assert all(pieces[0].repeated_by(piece) for piece in pieces)
    assert np.array_equal(np.concatenate([piece.commands["X"] for piece in pieces]), run.commands["X"])
    assert [piece.start_s for piece in pieces] == [0.0, 14.0, 28.0, 42.0, 56.0]


def test_whole_turns_repeat_each_other() -> None:
    time = np.arange(0.0, 30.0, 0.1)
    run = Run(
        id="wheel", instrument=("displacement",), sampling="dynamic", time=time, commands={"C": 100.0 + 30.0 * time},
        readings={"s1_um": np.cos(np.radians(100.0 + 30.0 * time))},
    )  # fmt: skip
    axes = {"C": make_axis("C", travel=(-3600.0, 3600.0))}
    machine = Machine(name="wheel", structure=Structure.parse("w C' b t"), axes=axes, errors={})
    found = turns_of(run, machine, step_deg=4.0)
    assert len(found) == 1  # from 100° to 997°: only 360° … 720° is whole
    assert found[0].start_s == pytest.approx((360.0 - 100.0) / 30.0)
    expected = np.cos(np.radians(found[0].commands["C"]))
    assert found[0].readings["s1_um"] == pytest.approx(expected, abs=1e-3)
    with pytest.raises(InputError, match="whole revolution"):
        turns_of(rows_of(run, slice(0, 50)), machine, step_deg=4.0)


def test_halves_are_each_others_rest() -> None:
    run = axis_under_test().runs[0]
    first, second = halves()
    cut = first.cut(axis_under_test())
    assert [first.learn(r) for r in cut.runs] == [not second.learn(r) for r in cut.runs] == [True, False]
    assert np.array_equal(np.concatenate([r.commands["X"] for r in cut.runs]), run.commands["X"])
    assert cut.runs[1].start_s == run.time[run.rows // 2] and cut.runs[1].time[0] == 0.0


@pytest.mark.slow
def test_a_simulated_backlash_is_placed_named_and_proven(simulated: Study) -> None:
    [finding] = simulated.found.findings
    assert (finding.name, finding.axis) == ("backlash", "X")
    width = finding.parameters["width"]
    assert isinstance(width.value, float) and isinstance(width.std, float)
    assert abs(width.value - WIDTH_UM) < 3.0 * width.std < 0.6
    assert simulated.found.location.significant[0].link == "behind the drive"
    assert not simulated.left.significant


def test_held_out_parts_get_better_and_say_by_what(simulated: Study) -> None:
    assert [part.label for part in simulated.held_out][-1] == "all → the other file"
    for part in simulated.held_out:
        assert part.after < 0.45 < 3.0 < part.before and not part.worse
        assert [(f.name, f.axis) for f in part.findings] == [("backlash", "X")] and not part.withdrawn
        assert part.after == part.unfiltered < 1.1 * part.rival < part.before
    (finding,) = simulated.found.findings
    assert simulated.judged(finding).startswith("Right as far as this recording goes, because width 12")


def test_a_finding_that_is_not_sure_is_not_called_right(simulated: Study) -> None:
    (finding,) = simulated.found.findings
    assert "60 % probable" in simulated.judged(replace(finding, confidence=0.6))
    assert "1.0 σ from nothing" in simulated.judged(replace(finding, sigmas=1.0))
    assert "curve that predicts" in simulated.judged(replace(finding, name="unknown"))
    nowhere = replace(simulated, held_out=tuple(replace(p, findings=()) for p in simulated.held_out))
    assert "not found again where less is fitted (1, 2 → 3, 4)" in nowhere.judged(finding)


@pytest.mark.parametrize("regression", [table, harmonic, boosted])
def test_rivals_learn_a_position_error_with_a_reversal(regression: Any) -> None:
    rng = np.random.default_rng(2)

    def rows(n: int) -> tuple[np.ndarray, np.ndarray]:
        place, side = rng.uniform(0.0, 200.0, n), rng.choice([-1.0, 1.0], n)
        reading = 8.0 * np.sin(place / 40.0) + 5.0 * side + 3.0 * side * place / 200.0
        return np.column_stack([place, side, np.zeros(n), np.zeros(n)]), reading

    (known, left), (asked, truth) = rows(400), rows(200)
    noisy = left + rng.normal(0.0, 0.3, len(left))
    assert np.std(regression(known, noisy, asked) - truth) < 0.25 * np.std(truth)
    assert not np.any(regression(known, np.zeros(400), asked))


def test_the_rival_is_measured_on_what_it_has_not_seen(simulated: Study) -> None:
    campaign = simulated.campaign
    split = Split("last", lambda run: np.full(run.rows, run.id != campaign.runs[-1].id))
    before = baseline(split.fitted(campaign))
    name, rms = best_rival(before, campaign, split, "um")
    plain = root(*held_out_square(before, campaign, split, "um"))
    assert name in RIVALS and 0.2 < rms < 0.3 * plain


def test_rms_is_told_by_unit(simulated: Study) -> None:
    assert rms_of(simulated.found.before, "um") == pytest.approx(simulated.found.before.rms["um"])
    assert np.isnan(rms_of(simulated.found.before, "N"))


def test_page_data_and_figure_are_written(simulated: Study, tmp_path: Path) -> None:
    story.write([simulated], ["emps: not there"], tmp_path)
    text = (tmp_path / "recordings.md").read_text()
    for expected in (
        "## simulated (cycles)",
        "backlash of X",
        "Not included: emps: not there",
        "Published values",
        " µm",
    ):
        assert expected in text
    assert "um |" not in text and " um" not in text
    data = json.loads((tmp_path / "recordings.json").read_text())
    assert data["recordings"][0]["findings"][0]["effect"] == "backlash"
    assert (tmp_path / "figures" / "simulated-cycles.png").stat().st_size > 10_000


def test_a_study_without_finding_says_so(simulated: Study, tmp_path: Path) -> None:
    none = replace(simulated, found=replace(simulated.found, findings=(), after=simulated.found.before))
    text = words.section(none, "x.png")
    assert "None. Of" in text and "as before" in text
    figures.save(figures.drawing(none), tmp_path, "nothing (here)")
    assert (tmp_path / "nothing-here.png").is_file()


def test_recordings_that_are_not_there_are_left_out(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SYMFIVE_DATA", str(tmp_path / "nowhere"))
    assert story.main(["-o", str(tmp_path), "--only", "emps"]) == 1
    assert "is not there" in capsys.readouterr().out


# --- on the recordings ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_emps_halves_give_the_same_friction_and_predict_each_other(tmp_path: Path) -> None:
    """Force, mass and friction: A. Janot, M. Gautier & M. Brunot 2019; their model leaves 2.2 N."""
    found = study(*real("emps"))
    first, second = found.held_out
    assert first.after < 1.0 and second.after < 1.25
    assert all(isinstance(gone.effect, Varying) for part in found.held_out for gone in part.withdrawn)  # no name is
    assert ("friction", "X") in {(f.name, f.axis) for f in first.findings if f.confidence > 0.99}
    for part in found.held_out:
        assert any(f.effect.key.startswith("force_friction.X") for f in part.findings)
        delay = next(f for f in part.findings if f.effect.key == "force_delay.X")
        assert delay.parameters["delay_ms"].value == pytest.approx(-0.9, abs=0.06)  # a sample of the control is 1 ms
    story.write([found], [], tmp_path)
    assert "µm" not in (tmp_path / "recordings.md").read_text()  # its readings are forces


@pytest.mark.slow
@pytest.mark.parametrize(("joint", "most"), [("J1", 0.06), ("J2", 0.14), ("J4", 0.0115)])
def test_the_last_third_of_an_arms_motion_is_predicted_from_the_first_two(joint: str, most: float) -> None:
    (part,) = study(*real(f"tx40 ({joint})")).held_out
    assert part.after < most < part.before and part.won
    assert joint != "J2" or {"gravity_torque.J2", "load_inertia.J2"} <= {
        e.key for f in part.findings for e in f.effects
    }


@pytest.mark.slow
def test_the_column_bends_under_the_reach_of_its_arm() -> None:
    recording, campaign = real("hilti-column")
    for part in recording.parts:
        before, after = held_out_with(campaign, part, make_effect("load_moment", "L", spread=10.0), "mm")
        assert after < 1.3 and after < 0.8 * before


@pytest.mark.slow
def test_ecmc_cycles_are_predicted_from_others() -> None:
    found = study(*real("ecmc-iso230"))
    (finding,) = found.found.findings
    assert {"X", "X velocity sign"} <= set(finding.coordinate.split(", ")) and sized(found)
    from_the_first, from_the_last = found.held_out
    assert from_the_first.after < 0.4 * from_the_first.before
    assert from_the_last.after < 0.85 * from_the_last.before  # the first reading of all, 110 µm off, counts in either


@pytest.mark.slow
def test_slit_has_a_periodic_error_of_one_turn_of_its_screw() -> None:
    """The largest finding on the open-loop stepper."""
    recording, campaign = real("jjxray-slit")
    run = rows_of(campaign.runs[0], slice(None, None, 2))
    found = study(recording, replace(campaign, runs=(run,)))
    first = found.found.findings[0]
    assert (first.name, first.axis) == ("transmission_error", "X") and sized(found)
    assert all(part.after < 0.2 * part.before for part in found.held_out)


@pytest.mark.slow
def test_a_sag_of_the_arm_predicts_other_poses_and_another_reflector() -> None:
    """The first that the diagnosis finds on every fourth pose, here on every twelfth: the second axis gives way under weight."""
    recording, campaign = real("irb120-tracker")
    plain = identify(campaign, noise="repeats")
    sag = amend(plain, make_effect("gravity_sag", "J2", component="EBJ2").prepare(campaign))
    assert sag["gravity_sag.J2.EBJ2.sin"] > 5.0 * sag.uncertainty("gravity_sag.J2.EBJ2.sin")
    for part in recording.parts:
        before, after = held_out_with(campaign, part, make_effect("gravity_sag", "J2", component="EBJ2"), "mm")
        assert after < 0.99 * before
