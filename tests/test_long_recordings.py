"""Long recordings: read and identified by windows, with the same result, in memory that does not grow."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text

from symfive import disk
from symfive.campaign import Campaign, Run, _csv, read_campaign, write_campaign
from symfive.design import assess
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.identify import Identification, fitted_model, identify, predict
from symfive.inference import Noise, Problem, Whitening, whiten
from symfive.inference import _windows as windows  # what is long is made short
from symfive.machine import preset
from symfive.model import Model
from symfive.procedures import campaign_of, planar_circle, r_test_grid
from symfive.report import _spectrum, _traces, identification_report, residuals_over_time  # likewise
from symfive.report._traces import BLOCKS, condensed  # envelopes row by row
from symfive.simulate import simulate

MACHINE = preset("table-bc")


def by_windows(monkeypatch, campaign: Campaign, **options) -> tuple[Identification, Identification]:
    """The same campaign identified run by run and by windows of few rows."""
    whole = identify(campaign, **options)
    small_windows(monkeypatch)
    return whole, identify(campaign, **options)


def same(whole: Identification, cut: Identification, share: float = 1e-8) -> None:
    """To `share`: slopes of the noise's likelihood are differences of rounded sums; an inverse to what rounding leaves of it,
    eps·cond, which differs from processor to processor."""
    inverse = max(share, float(np.finfo(float).eps * np.linalg.cond(whole.covariance)))
    assert (np.abs(cut.values - whole.values) / whole.std).max() < share
    assert np.abs(cut.covariance - whole.covariance).max() < inverse * np.abs(whole.covariance).max()
    assert cut.std == pytest.approx(whole.std, rel=inverse)
    assert cut.chi2_dof == pytest.approx(whole.chi2_dof, rel=share)
    assert cut.rms_um == pytest.approx(whole.rms_um, rel=share)
    assert [(o.run, o.row, o.column) for o in cut.outliers] == [(o.run, o.row, o.column) for o in whole.outliers]
    for key, noise in whole.noises.items():
        assert cut.noises[key].white == pytest.approx(noise.white, rel=share)
    for run, residual in whole.residuals.items():
        assert np.abs(cut.residuals[run] - residual).max() < share


def spoilt(campaign: Campaign, column: str) -> Campaign:
    """With slow noise and two outliers in every run."""
    generator, runs = np.random.default_rng(5), []
    for run in campaign.runs:
        slow = np.zeros(run.rows)
        for row in range(1, run.rows):
            slow[row] = 0.97 * slow[row - 1] + 0.1 * generator.standard_normal()
        values = run.readings[column] + slow
        values[[399, 1000]] += 9.0
        runs.append(run.with_readings({**run.readings, column: values}))
    return replace(campaign, runs=tuple(runs))


@pytest.fixture(scope="module")
def circles() -> Campaign:
    plan = campaign_of(MACHINE, planar_circle(MACHINE, plane="XY", feed=2000.0, rate_hz=50.0))
    return simulate(plan, seed=2).campaign


def test_a_dynamic_campaign(monkeypatch, circles):
    whole, cut = by_windows(monkeypatch, spoilt(circles, "dL_um"))
    assert len(whole.outliers) >= 4 and next(iter(whole.noises.values())).coloured > 0.0
    assert isinstance(cut.residuals["xy-ccw"], np.memmap) and not cut.notes
    same(whole, cut)


def test_a_static_campaign(monkeypatch):
    grid = campaign_of(MACHINE, r_test_grid(MACHINE, step_deg=9.0))
    assert min(run.rows for run in grid.runs) > 1200
    same(*by_windows(monkeypatch, simulate(grid, seed=3).campaign))


def small_windows(monkeypatch) -> None:
    monkeypatch.setattr(windows, "LONG", 700)
    monkeypatch.setattr(windows, "ROWS", 400)
    monkeypatch.setattr(disk, "IN_MEMORY_BYTES", 4000)


def test_a_prediction(monkeypatch, circles):
    play = [make_effect("backlash", "X")]
    spoiled = spoilt(simulate(circles, effects=play, seed=4).campaign, "dL_um")
    fitted = fitted_model(identify(spoiled, effects=play))
    whole = predict(fitted, spoiled)
    small_windows(monkeypatch)
    cut = predict(fitted, spoiled)
    for run in whole.campaign.runs:
        found = cut.campaign.run(run.id).readings["dL_um"]
        assert isinstance(found, np.memmap)
        assert found == pytest.approx(run.readings["dL_um"], abs=1e-5)  # where two fits of a set-up end
        assert cut.rms_by_column[run.id] == pytest.approx(whole.rms_by_column[run.id], rel=1e-6)
        assert cut.rms[run.id] == pytest.approx(whole.rms[run.id], rel=1e-6)


def test_an_assessment(monkeypatch, circles):
    whole = assess(circles)
    small_windows(monkeypatch)
    cut = assess(circles)
    assert cut.covariance == pytest.approx(whole.covariance, rel=1e-6, abs=1e-9 * float(np.abs(whole.covariance).max()))
    assert cut.run_worth == pytest.approx(whole.run_worth, rel=1e-6, abs=1e-9)
    for run, worth in whole.worth.items():
        assert isinstance(cut.worth[run], np.memmap)
        assert cut.worth[run] == pytest.approx(worth, rel=1e-6, abs=1e-12)
        assert cut.idle[run].tolist() == whole.idle[run].tolist()


def test_a_long_recording_is_drawn_by_blocks_of_all_its_rows():
    """Three times the blocks: a spike of one row is in the envelope, every row in the means, an outlier by itself."""
    count, generator = 3 * BLOCKS + 5, np.random.default_rng(2)
    place = 100.0 * np.sin(np.arange(count) * 1e-3)
    commands = {name: place if name == "X" else np.zeros(count) for name in MACHINE.axis_names}
    residual = generator.standard_normal((count, 2))
    residual[7000, 0], residual[9001, 1] = 40.0, 500.0
    run = Run(
        id="a", instrument=("grid_encoder",), sampling="dynamic", time=np.arange(count) / 200.0, commands=commands,
        readings={"du_um": residual[:, 0], "dv_um": residual[:, 1]}, u=(1.0, 0.0, 0.0), v=(0.0, 1.0, 0.0),
    )  # fmt: skip
    view = condensed(run, residual, ("du_um", "dv_um"), [(9001, 1)])
    assert view.step == 4 and view.run.rows == -(-count // 4) + 1
    kept = residual.copy()
    kept[9001, 1] = np.nan
    assert np.nanmax(view.high, axis=0) == pytest.approx(np.nanmax(kept, axis=0))
    assert np.nanmin(view.low, axis=0) == pytest.approx(np.nanmin(kept, axis=0))
    assert np.nanmean(np.where(view.outlier, np.nan, view.residual), axis=0) == pytest.approx(
        np.nanmean(kept, axis=0), abs=1e-3
    )
    (row,) = np.flatnonzero(view.outlier[:, 1])
    assert view.run.time[row] == run.time[9001] and view.residual[row, 1] == 500.0 and not view.outlier[:, 0].any()
    assert np.all(np.diff(view.run.time) > 0.0)
    assert view.run.readings["dv_um"][row] == 500.0
    others = np.delete(view.run.readings["dv_um"], row)
    assert np.abs(others).max() < 10.0  # it has no part in its block
    assert set(view.run.commands["X"]) <= set(place)


@pytest.mark.slow
def test_the_report_of_a_long_recording_counts_all_rows(monkeypatch, circles, tmp_path):
    """Its pictures are of blocks, its tables of rows."""
    result = identify(spoilt(circles, "dL_um"), noise="declared")
    whole = _tables(identification_report(result, tmp_path / "whole"))
    monkeypatch.setattr(_traces, "BLOCKS", 100)
    assert _tables(identification_report(result, tmp_path / "blocks")) == whole
    for run in circles.runs:
        assert f">{run.rows}<" in "".join(whole)
    words = "".join(text.get_text() for text in residuals_over_time(result).findobj(Text))
    assert "Pale: the lowest and the highest of every" in words


def _tables(page: Path) -> list[str]:
    return re.findall(r"<table.*?</table>", page.read_text(encoding="utf-8"), flags=re.DOTALL)


def test_a_tone_has_its_size_in_the_mean_of_stretches(monkeypatch, circles):
    """And noise stays below its line: the largest of averaged spectra passes a lower one."""
    monkeypatch.setattr(_spectrum, "STRETCH_ROWS", 512)
    result = identify(circles, noise="declared")
    for amplitude in (0.0, 0.5):
        for run in circles.runs:
            result.residuals[run.id][:, 0] = 0.3 * np.random.default_rng(3).standard_normal(run.rows)
            result.residuals[run.id][:, 0] += amplitude * np.sin(2.0 * np.pi * 7.3 * run.time)
        (line, *_, level) = _spectrum.residual_spectrum(result, [circles.runs[0].id]).axes[0].get_lines()
        peak = int(np.argmax(line.get_ydata()))
        dashed = float(level.get_ydata()[0])
        if amplitude:
            assert line.get_ydata()[peak] == pytest.approx(amplitude, rel=0.15)
            assert line.get_xdata()[peak] == pytest.approx(7.3, rel=0.05)
        else:
            assert 0.5 * dashed < line.get_ydata()[peak] < dashed


@pytest.mark.parametrize(("effects", "options"), [
    ([make_effect("backlash", "X")], {}),
    ([make_effect("servo_mismatch", "Y"), make_effect("latency")], {}),
    ([], {"loss": "huber"}),
])  # fmt: skip
def test_what_has_memory_and_other_losses(monkeypatch, circles, effects, options):
    campaign = simulate(circles, effects=effects, seed=4).campaign
    same(*by_windows(monkeypatch, campaign, effects=effects, noise="declared", **options), share=1e-6)


@pytest.mark.parametrize("turns", [tuple(range(150, 1800, 150)), (100,)])
def test_a_memory_longer_than_the_margin_lengthens_it(monkeypatch, turns):
    """C stands for hundreds of rows, in which its play depends on whence it came; at last only the whole run tells."""
    count, generator = 1800, np.random.default_rng(1)
    commands = {name: generator.uniform(-40.0, 40.0, count) for name in MACHINE.axis_names}
    commands["C"] = 30.0 * (-1.0) ** np.searchsorted(turns, np.arange(count), side="right")
    run = Run(id="a", instrument=("tracker",), sampling="static", time=np.arange(count, dtype=float), commands=commands)
    plan, play = Campaign(machine=MACHINE, runs=(run,)), [make_effect("backlash", "C")]
    campaign = simulate(plan, effects=play, truth={"backlash.C.width": 80.0}, seed=1).campaign
    whole, cut = by_windows(monkeypatch, campaign, effects=play, noise="declared")
    same(whole, cut)
    assert not whole.notes
    assert bool([note for note in cut.notes if "as a whole" in note]) is (len(turns) == 1)


def test_whitening_by_stretches_is_whitening():
    table = np.random.default_rng(0).standard_normal((500, 2, 3))
    for noise in (Noise(0.5), Noise(0.5, 0.8, 0.3)):
        whitening = Whitening(noise, 0.02)
        parts = [whitening(part) for part in (table[:70], table[70:71], table[71:])]
        white, logs = whiten(table, noise, 0.02)
        assert np.concatenate(parts) == pytest.approx(white, abs=1e-12)
        assert whitening.logs == pytest.approx(logs)


def test_columns_read_by_blocks_are_the_same(monkeypatch, tmp_path, circles):
    write_campaign(circles, tmp_path / "measured")
    monkeypatch.setattr(_csv, "BLOCK_BYTES", 5000)
    monkeypatch.setattr(disk, "IN_MEMORY_BYTES", 4000)
    for run, read in zip(circles.runs, read_campaign(tmp_path / "measured").runs, strict=True):
        assert isinstance(read.time, np.memmap) and not read.time.flags.writeable
        assert np.array_equal(read.time, run.time)
        for given, found in ((run.commands, read.commands), (run.readings, read.readings)):
            assert all(np.array_equal(values, found[name]) for name, values in given.items())
        part = read.part(10, 20)
        assert not isinstance(part.time, np.memmap) and part.commands["X"].tolist() == run.commands["X"][10:20].tolist()


WRONG = {
    "text": lambda rows: [*rows[:1500], rows[1500].replace(b".", b"x", 1), *rows[1501:]],
    "time goes back": lambda rows: [*rows[:1500], rows[1400], *rows[1501:]],
    "time stands at a seam": lambda rows: [row for row in rows for _ in (0, 1)],
    "outside travel": lambda rows: [*rows[:1500], rows[1500].replace(b",", b",99999", 1), *rows[1501:]],
    "cells": lambda rows: [*rows[:1500], b"1,2\n", *rows[1501:]],
    "empty row": lambda rows: [*rows[:1500], b"\n", *rows[1500:]],
    "many empty rows": lambda rows: [*rows[:1500], b"\n" * 6000, *rows[1500:]],
    "NUL": lambda rows: [*rows[:1500], b"\x00" + rows[1500], *rows[1501:]],
    "not UTF-8": lambda rows: [*rows[:1500], b"1\xe4" + rows[1500], *rows[1501:]],
    "UTF-16": lambda rows: [b"\xff\xfe", *rows],
    "no: blank lines": lambda rows: [*rows, b"\n" * 9000],
    "no: CR LF": lambda rows: [row.replace(b"\n", b"\r\n") for row in rows],
    "no: CR": lambda rows: [row.replace(b"\n", b"\r") for row in rows],
}


@pytest.mark.parametrize("name", WRONG)
def test_errors_name_the_same_place(monkeypatch, tmp_path, circles, name):
    write_campaign(circles, tmp_path / "measured")
    path = tmp_path / "measured" / circles.runs[0].file
    path.write_bytes(b"".join(WRONG[name](path.read_bytes().splitlines(keepends=True))))

    def said() -> str:
        try:
            return str(read_campaign(tmp_path / "measured").runs[0].time.sum())
        except InputError as error:
            return str(error)

    whole = said()
    monkeypatch.setattr(_csv, "BLOCK_BYTES", 5000)
    assert said() == whole
    assert name.startswith("no:") or path.name in whole


def test_a_line_without_end_is_refused(monkeypatch, tmp_path, circles):
    write_campaign(circles, tmp_path / "measured")
    monkeypatch.setattr(_csv, "BLOCK_BYTES", 500)
    path = tmp_path / "measured" / circles.runs[0].file
    path.write_text(path.read_text() + "1" * 3000)
    with pytest.raises(InputError, match="the line has more than") as caught:
        read_campaign(tmp_path / "measured")
    assert caught.value.line == circles.runs[0].rows + 2


def test_no_room_for_a_temporary_file(monkeypatch, tmp_path):
    monkeypatch.setattr(disk.tempfile, "TemporaryFile", lambda **more: (tmp_path / "missing" / "file").open("w+b"))
    with pytest.raises(InputError, match="TMPDIR"):
        disk.new_table(10_000_000, 2)


MEASURE = """
import resource, sys
import numpy as np
from symfive.campaign import Campaign, Run
from symfive.inference import Problem
from symfive.machine import preset
from symfive.model import Model
from symfive.model import Model
from symfive.procedures import planar_circle

machine = preset("table-bc")
[circle] = planar_circle(machine, plane="XY", feed=4000.0, rate_hz=200.0, direction="ccw")

def passed(passes):
    def column(name, part):
        with open(f"{sys.argv[1]}/{name}", "wb") as file:
            for k in range(passes):
                part(k).tofile(file)
        return np.memmap(file.name, dtype=float, mode="r")
    time = np.arange(2 * circle.rows) / 200.0
    commands = {n: column(n, lambda k: np.append(v, v[::-1])) for n, v in circle.commands.items()}
    read = {"dL_um": column("dL", lambda k: np.random.default_rng(k).standard_normal(2 * circle.rows))}
    clock = column("t", lambda k: time + k * 2 * circle.rows / 200.0)
    run = Run(id="a", instrument=("ball_bar",), sampling="dynamic", time=clock, commands=commands, readings=read,
              table_ball=circle.table_ball, tool_ball=circle.tool_ball, length=circle.length, noise_um=1e3)
    model = Model(Campaign(machine=machine, runs=(run,)))
    problem = Problem.of(model)
    problem.information_at(model.start)
    problem.flag_outliers(problem.survey(model.start), model.start)
    problem.residuals_at(model.start)
    return run.rows, len(model.parameters), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

few, _, begin = passed(8)
many, parameters, end = passed(32)
print(few, many, parameters, end - begin)
"""
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def test_memory_does_not_grow_with_the_rows(tmp_path):
    command = [sys.executable, "-c", MEASURE, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ | ONE_THREAD)
    few, many, parameters, grown = map(float, done.stdout.split())
    assert few > windows.LONG and many > 3 * few
    table = (many - few) * (1 + parameters) * 8 / 1024**2
    assert grown < 0.5 * table


def test_a_search_begins_with_what_the_last_one_ended_with(circles):
    """The same values under the same noise, outliers and freedom are evaluated once; each of these changes the sum."""
    problem = Problem.of(Model(circles))
    values = problem.model.start
    first = problem.information_at(values)
    assert problem.information_at(values.copy()) is first
    run = circles.runs[0].id
    problem.left_out[run][7, 0] = True
    fewer = problem.information_at(values)
    assert fewer.count == first.count - 1
    key = next(iter(problem.noises))
    problem.noises[key] = replace(problem.noises[key], white=2.0)
    assert problem.information_at(values).square < fewer.square
    problem.free[:] = False
    assert not problem.information_at(values).matrix.any()
    assert problem.information_at(values + 1.0).square != fewer.square
