"""The demonstration, its steps on a small scale: they cannot rot, and what they say holds."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from symfive.errors import InputError
from symfive.identify import fitted_model, identify, predict
from symfive.machine import preset
from symfive.simulate import simulate

SCRIPT = Path(__file__).resolve().parent.parent / "examples" / "demo" / "demo.py"


@pytest.fixture(scope="module")
def demo():
    spec = importlib.util.spec_from_file_location("demo", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules["demo"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["demo"]


@pytest.fixture(scope="module")
def machine():
    """The demonstration's machine with fewer error motions, which is quicker to plan for."""
    whole = preset("table-bc")
    return replace(whole, errors={t.name: t for t in whole.errors.values() if t.is_location or t.name == "EXC"})


@pytest.fixture(scope="module")
def planned(demo, machine):
    return demo.make_plan(machine, points=8, rate_hz=6.0)


@pytest.fixture(scope="module")
def measured(demo, planned):
    return simulate(planned[1], seed=demo.SEED)


@pytest.fixture(scope="module")
def result(measured):
    return identify(measured.campaign)


def test_the_plan_is_certified_and_joined_by_circles(planned):
    chosen, campaign = planned
    assert 0.5 < chosen.certificate.efficiency <= 1.0
    assert {run.instrument[0] for run in campaign.runs} == {"r_test", "ball_bar"}


def test_most_bands_hold_the_truth_and_every_number_has_its_unit(demo, measured, result):
    inside, count = demo.share_covered(result, measured.truth)
    assert count == sum(p.run is None for p in result.parameters)
    assert inside >= 0.8 * count
    lines = demo.table_of_errors(result, measured.truth)
    assert len(lines) == 1 + sum(p.kind == "location_error" for p in result.parameters)
    for line in lines[1:]:
        assert line.count("µ") == 3


def test_a_held_out_run_is_predicted_to_the_noise(demo, machine, measured, result, tmp_path):
    check = demo.held_out(machine, measured.truth, rate_hz=6.0)
    prediction = predict(fitted_model(result), check)
    [run] = check.runs
    assert prediction.rms[run.id] < 1.6 * run.noise("ball_bar")
    demo.save_prediction(prediction, check, tmp_path / "predicted")
    assert [path.suffix for path in (tmp_path / "predicted").iterdir()] == [".png"]


@pytest.mark.slow
def test_the_concealed_sag_is_found_and_the_geometry_moves_back(demo, machine, tmp_path):
    sagging = demo.conceal(machine, step_deg=60.0)
    assert all(term.is_location for term in sagging.campaign.machine.errors.values())
    found = demo.diagnose(sagging.campaign)
    assert found.mismatch
    assert found.fit.rms_after_um < 0.5 * found.fit.rms_before_um
    text = "\n".join(demo.lines_of_diagnosis(found, sagging.truth))
    assert "µm before" in text
    for finding in found.findings:
        for name, (before, after) in finding.moved.items():
            assert abs(after - sagging.truth[name]) < max(abs(before - sagging.truth[name]), 2.0)
    demo.save_diagnosis(found, tmp_path)
    assert (tmp_path / "diagnosis.json").is_file()
    assert (tmp_path / "residuals-before.png").stat().st_size > 1000


def test_the_readme_s_picture_shows_what_it_says(demo, machine, tmp_path):
    """Rigid geometry is far from the truth by its own uncertainty, with the sag it is not; on a coarser grid."""
    spec = importlib.util.spec_from_file_location("picture", SCRIPT.with_name("picture.py"))
    picture = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(picture)
    measured = demo.conceal(machine, step_deg=60.0)
    rigid = identify(measured.campaign, noise="declared")
    sagging = identify(measured.campaign, effects=[demo.SAG])
    names = [term.name for term in rigid.model.machine.location_errors if term.angular]

    def off(result):
        return max(abs(result[name] - measured.truth[name]) / result.uncertainty(name) for name in names)

    assert off(rigid) > 10.0 and off(sagging) < 3.0
    figure = picture.picture(rigid, sagging, measured.truth)
    (axes,) = figure.axes
    assert [label.get_text().split(":")[0] for label in axes.get_yticklabels()] == names


def test_the_real_drive_agrees_with_the_published_values(demo):
    try:
        result = demo.real_drive()
    except InputError as absent:
        pytest.skip(str(absent))
    for term, value in demo.PUBLISHED.items():
        name = f"drive_force.X.{term}"
        assert abs(result[name] - value) < 2.0 * result.uncertainty(name), term
    lines = demo.lines_of_drive(result)
    assert len(lines) == 5
    assert "N rms" in lines[-1]


def test_without_the_recordings_it_says_so(demo, monkeypatch, tmp_path):
    monkeypatch.setenv("SYMFIVE_DATA", str(tmp_path / "nowhere"))
    with pytest.raises(InputError, match="is not there"):
        demo.real_drive()


def test_the_whole_story_names_its_folder(demo, planned, measured, result, monkeypatch, tmp_path, capsys):
    """The order of the story; its slow steps are those of the tests above."""
    monkeypatch.setenv("SYMFIVE_DATA", str(tmp_path / "nowhere"))
    monkeypatch.setattr(demo, "make_plan", lambda machine: planned)
    monkeypatch.setattr(demo, "simulate", lambda campaign, **options: measured)
    monkeypatch.setattr(demo, "held_out", lambda machine, truth: measured.campaign.select("xy-ccw"))
    monkeypatch.setattr(demo, "conceal", lambda machine: measured)
    monkeypatch.setattr(demo, "diagnose", lambda campaign: None)
    monkeypatch.setattr(demo, "lines_of_diagnosis", lambda found, truth: ["  (found)"])
    monkeypatch.setattr(demo, "save_diagnosis", lambda found, folder: None)
    monkeypatch.setattr(demo, "save_identification", lambda result, folder: None)
    assert demo.main(["-o", str(tmp_path / "results")]) == 0
    said = capsys.readouterr().out
    assert [line[0] for line in said.splitlines() if line[:1].isdigit()] == list("1234567")
    assert "Skipped (optional): real recordings are not on this computer." in said and "NOT RUN" not in said
    assert str((tmp_path / "results").resolve()) in said
    assert np.isfinite(result.rms_um)
