"""Diagnosis of long recordings: what the search sees of them, and that windows change no result."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from symfive.campaign import Campaign, Run
from symfive.diagnose import _stretches, cross_validated, detect, diagnose  # what is long is made short
from symfive.effects import Effect, make_effect
from symfive.identify import Identification, identify
from symfive.inference import _windows  # likewise
from symfive.machine import preset
from symfive.model import Model
from symfive.motion import approach
from symfive.procedures import campaign_of, planar_circle
from symfive.report import visible_parts
from symfive.simulate import simulate

PLAY = {"backlash.X.width": 12.0}


def again_and_again(run: Run, times: int) -> Run:
    """The run's commands forth and back, so many times, without a stop of the recorder."""
    ways = {axis: np.tile(np.concatenate([way, way[::-1]]), times) for axis, way in run.commands.items()}
    return replace(run, time=np.arange(2.0 * times * run.rows) * run.interval, commands=ways)


def circles(times: int, rate_hz: float, *effects: Effect, seed: int = 3) -> Campaign:
    """Circles of a grid encoder in XY in both senses, each so many times, with a play of X and these effects."""
    machine = preset("three-axis")
    runs = planar_circle(machine, feed=3000.0, rate_hz=rate_hz, instrument="grid_encoder")
    plan = campaign_of(machine, [again_and_again(run, times) for run in runs])
    return simulate(plan, truth=PLAY, effects=[make_effect("backlash", "X"), *effects], seed=seed).campaign


@pytest.fixture(scope="module")
def recording() -> Campaign:
    return circles(4, 25.0)


@pytest.fixture
def long(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What takes longer than a second at 25 Hz is a long recording."""
    monkeypatch.setattr(_stretches, "LONG", 1000)
    monkeypatch.setattr(_stretches, "SEEN", 800)
    monkeypatch.setattr(_stretches, "STRETCH", 64)
    monkeypatch.setattr(_stretches, "MOST_STEP", 3)
    yield


def test_a_short_campaign_is_seen_whole(recording: Campaign) -> None:
    seen, rows = _stretches.stretches_of(recording)
    assert seen is recording
    assert all(rows[run.id].all() for run in recording.runs)


@pytest.mark.usefixtures("long")
def test_the_search_sees_every_place_from_both_sides(recording: Campaign) -> None:
    seen, rows = _stretches.stretches_of(recording)
    for run, part in zip(recording.runs, seen.runs, strict=True):
        assert part.rows == rows[run.id].sum() < 0.5 * run.rows
        assert rows[run.id][0]
        assert part.time[-1] > 0.9 * run.time[-1]
        for axis in "XY":
            whole, cut = run.commands[axis], part.commands[axis]
            for side in (-1.0, 1.0):
                places = np.histogram(cut[approach(whole)[rows[run.id]] == side], 8, (whole.min(), whole.max()))[0]
                assert places.min() > 0


@pytest.mark.usefixtures("long")
def test_a_stretch_moves_as_in_the_whole_recording() -> None:
    effects = [make_effect("backlash", "X"), make_effect("friction", "Y")]
    campaign = circles(4, 25.0, effects[1])
    seen, rows = _stretches.stretches_of(campaign)
    whole, part = (Model(each, [effect.prepare(campaign) for effect in effects]) for each in (campaign, seen))
    assert [p.name for p in whole.parameters] == [p.name for p in part.parameters]
    values = whole.prior_mean + 0.5 * whole.prior_sigma
    for run, cut in zip(campaign.runs, seen.runs, strict=True):
        wanted, found = whole.linearise(run, values), part.linearise(cut, values)
        np.testing.assert_allclose(found.prediction, wanted.prediction[rows[run.id]], atol=1e-7)
        np.testing.assert_allclose(found.jacobian, wanted.jacobian[rows[run.id]], rtol=1e-7, atol=1e-9)


def test_of_many_runs_each_shows_little() -> None:
    machine = preset("three-axis")
    (first, *_) = planar_circle(machine, feed=3000.0, rate_hz=50.0, instrument="grid_encoder")
    runs = [replace(first, id=f"r{number}", file="") for number in range(40)]
    campaign = campaign_of(machine, runs)
    assert campaign.rows > _stretches.LONG
    seen, rows = _stretches.stretches_of(campaign)
    assert seen.rows == sum(int(kept.sum()) for kept in rows.values()) < 1.5 * _stretches.SEEN
    assert {run.rows for run in seen.runs} == {seen.runs[0].rows}


def test_rows_that_the_recorder_lost_stay_lost(monkeypatch: pytest.MonkeyPatch, long: None) -> None:
    campaign = circles(4, 25.0)
    kept = np.r_[0:700, 703 : campaign.runs[0].rows]
    runs = [
        replace(
            run, time=run.time[kept],
            commands={axis: way[kept] for axis, way in run.commands.items()},
            readings={name: column[kept] for name, column in run.readings.items()},
        )
        for run in campaign.runs
    ]  # fmt: skip
    lossy = replace(campaign, runs=tuple(runs))
    seen, rows = _stretches.stretches_of(lossy)
    model, part = Model(lossy), Model(seen)
    for run, cut in zip(lossy.runs, seen.runs, strict=True):
        found = part.predict_run(cut, part.start)
        np.testing.assert_allclose(found, model.predict_run(run, model.start)[rows[run.id]], atol=1e-7)


def test_a_run_of_pieces_is_not_cut_again(recording: Campaign, long: None) -> None:
    seen, _ = _stretches.stretches_of(recording)
    with pytest.raises(ValueError, match="pieces"):
        seen.runs[0].part(0, 10)
    with pytest.raises(ValueError, match="pieces"):
        replace(seen.runs[0], pieces=seen.runs[0].pieces[1:])


@pytest.mark.slow
@pytest.mark.usefixtures("long")
def test_a_long_recording_is_named_from_stretches_and_identified_whole(recording: Campaign) -> None:
    found = diagnose(recording)
    assert [(f.name, f.axis) for f in found.findings] == [("backlash", "X")]
    assert found.after.model.campaign is recording
    assert found.searched is not None
    unseen = found.searched.readings["held_out"]
    assert found.searched.readings == {
        "all": 2 * recording.rows,
        "fitted": 2 * recording.rows - unseen,
        "held_out": unseen,
    }
    assert found.searched.label == "the rows outside the search"
    assert unseen > recording.rows
    assert found.hold_out is None
    before, after = found.searched.rms["held_out"]
    assert after < 1.1 * found.noise_um < 0.2 * before
    whole = identify(recording, effects=[make_effect("backlash", "X")])
    name = "backlash.X.width"
    assert found.after[name] == pytest.approx(whole[name], abs=0.2 * whole.uncertainty(name))
    assert found.after.uncertainty(name) == pytest.approx(whole.uncertainty(name), rel=0.1)


@pytest.fixture(scope="module")
def fits(recording: Campaign) -> tuple[Identification, Identification]:
    return identify(recording), identify(recording, effects=[make_effect("backlash", "X")])


@pytest.mark.slow
def test_windows_change_no_result(fits: tuple[Identification, Identification], monkeypatch: pytest.MonkeyPatch) -> None:
    before, after = fits
    play = after.model.added[0]

    def results() -> tuple[object, ...]:
        contribution = after.problem().contribution(play, after.values)
        (visible,) = visible_parts(before, [contribution])
        proof = cross_validated(before, after)
        tests = {test.name: test.statistic for test in detect(after).tests}
        return contribution, visible, (proof.heldout_rms_before_um, proof.heldout_rms_after_um), tests

    contribution, visible, proof, tests = results()
    monkeypatch.setattr(_windows, "LONG", 300)
    monkeypatch.setattr(_windows, "ROWS", 200)
    monkeypatch.setattr(_windows, "MARGIN_ROWS", 100)
    small = results()
    for run in contribution:
        np.testing.assert_allclose(small[0][run], contribution[run], atol=1e-6)
        np.testing.assert_allclose(small[1][run], visible[run], atol=1e-6)
    assert small[2] == pytest.approx(proof, rel=1e-7)
    assert small[3] == pytest.approx(tests, rel=1e-6)


@pytest.mark.slow
def test_a_quarter_of_a_million_rows_is_diagnosed_like_a_short_campaign() -> None:
    short, long = circles(1, 50.0), circles(25, 200.0)
    assert long.rows > 100_000
    for campaign in (short, long):
        assert [(f.name, f.axis) for f in diagnose(campaign).findings] == [("backlash", "X")]
