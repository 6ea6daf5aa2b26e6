"""A recording over a whole run is cut at its rests and matched with the poses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from symfive.campaign import Run, read_campaign, write_campaign
from symfive.cli import main
from symfive.errors import InputError
from symfive.importers import cut_at_rests, read_recording
from symfive.machine import preset
from symfive.motion import approach
from symfive.nc import Post, arrival_times
from symfive.procedures import campaign_of, r_test_grid
from symfive.simulate import simulate

MACHINE = preset("table-bc")
COLUMNS = ("dx_um", "dy_um", "dz_um")
DWELL = 2.0


def measured() -> Run:
    """An R-test of some poses as its program drives it, with readings."""
    run = r_test_grid(MACHINE, step_deg=60.0, returning=False)[0]
    longer = np.cumsum(np.random.default_rng(5).uniform(0.0, 8.0, run.rows))  # as the ways of an optimised plan
    run = replace(run, time=arrival_times(MACHINE, run, Post(dwell_s=DWELL)) + longer - longer[0])
    return simulate(campaign_of(MACHINE, (run,)), seed=3).campaign.runs[0]


RUN = measured()


def recorded(
    run: Run, *, shaken: tuple[int, ...] = (), rate_hz: float = 50.0, seed: int = 0
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """What an R-test records over the run: rests with its readings, motion between them, on a clock of its own; at `shaken`
    poses it never rests."""
    generator = np.random.default_rng(seed)
    end = run.time[-1] + DWELL + 6.0
    time = np.arange(-8.0, end, 1.0 / rate_hz)
    found = {}
    for name in COLUMNS:
        corners, values = [-8.0], [400.0]
        for row in range(run.rows):
            corners += [run.time[row], run.time[row] + DWELL]
            values += [run.readings[name][row]] * 2
        corners, values = [*corners, end], [*values, -700.0]
        moving = np.interp(time, corners, values)
        share = np.ones(len(time))
        for row in range(run.rows):
            share[(time >= run.time[row]) & (time <= run.time[row] + DWELL)] = 0.0
        for row in shaken:
            share[(time >= run.time[row]) & (time <= run.time[row] + DWELL)] = 1.0
        found[name] = moving + share * 30.0 * np.sin(17.0 * time) + 0.3 * generator.standard_normal(len(time))
    return 137.0 + 1.002 * time, found


def test_every_pose_is_found_on_a_clock_of_its_own() -> None:
    matched = cut_at_rests(MACHINE, RUN, *recorded(RUN), dwell_s=DWELL)
    assert matched.missing == () and matched.unused == 0
    (found,) = matched.runs
    for name in COLUMNS:
        assert np.abs(found.readings[name] - RUN.readings[name]).max() < 0.3


@pytest.mark.parametrize("shaken", [(4,), (9, 10), (0,), (RUN.rows - 1,)])
def test_a_pose_without_a_rest_is_named(shaken: tuple[int, ...]) -> None:
    matched = cut_at_rests(MACHINE, RUN, *recorded(RUN, shaken=shaken), dwell_s=DWELL)
    assert matched.missing == shaken and matched.alone == ()
    assert f"pose {shaken[0] + 1} (line {shaken[0] + 2})" in str(matched)
    rows = [row for row in range(RUN.rows) if row not in shaken]
    for name in COLUMNS:
        read = np.concatenate([run.readings[name] for run in matched.runs])
        assert np.abs(read - RUN.readings[name][rows]).max() < 0.3
    seen = 0
    for run in matched.runs:  # play sees the sides of the plan, or none: before an axis' first motion its side is free
        mine = rows[seen : seen + run.rows]
        seen += run.rows
        assert np.allclose(run.start_s + run.time, RUN.start_s + RUN.time[mine], atol=1e-9)
        for name, q in RUN.commands.items():
            moved = np.maximum.accumulate(np.abs(run.commands[name] - run.commands[name][0]) > 1e-6)
            assert np.array_equal(approach(run.commands[name])[moved], approach(q)[mine][moved])


def test_a_rest_that_is_no_pose_is_left_over() -> None:
    time, readings = recorded(RUN)
    stop = np.searchsorted(time, 137.0 - 4.0)
    still = {name: values.copy() for name, values in readings.items()}
    for values in still.values():
        values[stop : stop + 120] = 55.0 + 0.3 * np.random.default_rng(1).standard_normal(120)
    matched = cut_at_rests(MACHINE, RUN, time, still, dwell_s=DWELL)
    assert matched.missing == () and matched.unused == 1 and "no pose of the plan: 1" in str(matched)


def test_the_stops_at_the_first_and_the_last_pose_may_take_long() -> None:
    """The ball is seated and set to zero at the first pose, and freed at the last one, for as long as the operator needs."""
    time, readings = recorded(RUN)
    began, ended = 137.0 + 1.002 * RUN.time[0], 137.0 + 1.002 * (RUN.time[-1] + DWELL)
    still = {}
    for name, values in readings.items():
        noise = 0.3 * np.random.default_rng(2).standard_normal(len(time))
        before, after = time < began + 0.2, time > ended - 0.2
        still[name] = np.where(before, RUN.readings[name][0] + noise, values)
        still[name] = np.where(after, RUN.readings[name][-1] + noise, still[name])
    matched = cut_at_rests(MACHINE, RUN, time, still, dwell_s=DWELL)
    assert matched.missing == () and matched.unused == 0
    for name in COLUMNS:
        assert np.abs(matched.runs[0].readings[name] - RUN.readings[name]).max() < 0.3


def test_another_recording_is_refused() -> None:
    time, readings = recorded(RUN)
    half = len(time) // 3
    with pytest.raises(InputError, match="poses found by their times"):
        cut_at_rests(MACHINE, RUN, time[:half], {n: v[:half] for n, v in readings.items()}, dwell_s=DWELL)
    with pytest.raises(InputError, match="lacks dz_um"):
        cut_at_rests(MACHINE, RUN, time, {n: readings[n] for n in COLUMNS[:2]}, dwell_s=DWELL)
    with pytest.raises(InputError, match="show no rests"):
        cut_at_rests(MACHINE, RUN, time, readings, dwell_s=0.05)


def test_equal_intervals_do_not_say_which_pose_is_missing_at_an_end() -> None:
    even = replace(RUN, time=10.0 * np.arange(RUN.rows))
    time, readings = recorded(even)
    last = np.searchsorted(time, 137.0 + 1.002 * (even.time[-1] - 4.0))
    with pytest.raises(InputError, match="in several ways"):
        cut_at_rests(MACHINE, even, time[:last], {n: v[:last] for n, v in readings.items()}, dwell_s=DWELL)


def test_a_text_file_with_a_head_and_decimal_commas(tmp_path: Path) -> None:
    time, readings = recorded(RUN, rate_hz=20.0)
    lines = ["R-Test; 2026", "Zeit;x;y;Temp;z"]
    for k, t in enumerate(time):
        cells = [f"{t:.3f}", *(f"{readings[n][k] / 1e3:.5f}" for n in COLUMNS)]
        lines.append(";".join([*cells[:3], "20,1", cells[3]]).replace(".", ","))
    path = tmp_path / "r-test.txt"
    path.write_text("\n".join(lines), encoding="utf-8")
    read, found = read_recording(path, ["t", "dx_um", "dy_um", "-", "dz_um"], unit="mm")
    assert np.abs(read - time).max() < 1e-3
    assert all(np.abs(found[n] - readings[n]).max() < 0.006 for n in COLUMNS)
    path.write_text("\n".join([*lines[:30], "1;2;3"]), encoding="utf-8")
    with pytest.raises(InputError, match="the row has 3 cells, the first one has 5") as caught:
        read_recording(path, ["t", "dx_um", "dy_um", "-", "dz_um"])
    assert caught.value.line == 31
    path.write_text("\n".join([*lines[:30], lines[29]]), encoding="utf-8")
    with pytest.raises(InputError, match="the time does not increase") as caught:
        read_recording(path, ["t", "dx_um", "dy_um", "-", "dz_um"])
    assert caught.value.line == 31


def test_columns_in_another_order_than_the_head_says_are_refused(tmp_path: Path) -> None:
    time, readings = recorded(RUN, rate_hz=20.0)
    lines = ["t,dz_um,dy_um,dx_um"]
    lines += [
        f"{t:.3f},{readings['dz_um'][k]:.2f},{readings['dy_um'][k]:.2f},{readings['dx_um'][k]:.2f}"
        for k, t in enumerate(time)
    ]
    path = tmp_path / "r-test.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InputError, match=r"column 2 is 'dz_um' in the file .* write --columns t,dz_um,dy_um,dx_um"):
        read_recording(path, ["t", *COLUMNS])
    _, found = read_recording(path, ["t", *COLUMNS[::-1]])
    assert np.abs(found["dx_um"] - readings["dx_um"]).max() < 0.006


def test_the_verb_says_what_it_did_not_find(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = campaign_of(MACHINE, (replace(RUN, readings={}),))
    write_campaign(plan, tmp_path / "plan")
    time, readings = recorded(RUN, shaken=(4,), rate_hz=20.0)
    rows = [",".join([f"{t:.3f}", *(f"{readings[n][k]:.3f}" for n in COLUMNS)]) for k, t in enumerate(time)]
    (tmp_path / "r.csv").write_text("\n".join(["t,x,y,z", *rows]), encoding="utf-8")
    call = ["import-rests", str(tmp_path / "plan"), str(tmp_path / "r.csv"), "-o", str(tmp_path / "m")]
    assert main(call) == 0
    assert "not found: pose 5 (line 6)" in capsys.readouterr().err
    measured = read_campaign(tmp_path / "m")
    assert measured.measured and measured.rows == RUN.rows - 1
    for wrong, says in (
        (["--run", "no"], "the plan has no run no"),
        (["--columns", "dx_um,dy_um"], "do not name t"),
        (["--run", RUN.id, "--run", "b"], "1 file for 2 runs"),
    ):
        assert main([*call[:-1], str(tmp_path / "n"), *wrong]) == 2
        assert says in capsys.readouterr().err and not (tmp_path / "n").exists()


def test_mm_taken_for_micrometres_are_refused() -> None:
    time, readings = recorded(RUN, rate_hz=20.0)
    with pytest.raises(InputError, match=r"no reading reaches the noise of .* give --unit mm"):
        cut_at_rests(MACHINE, RUN, time, {name: 1e-3 * values for name, values in readings.items()}, dwell_s=DWELL)


@pytest.mark.parametrize(
    ("head", "unit", "factor"),
    [
        ("t;x [mm];y (mm);z/mm", None, 1e3),
        ("t;dx_mm;dy_mm;dz mm", None, 1e3),
        ("t;x [mm];y [mm];z [mm]", "um", 1.0),
        ("t;x [µm];y [µm];z [µm]", None, 1.0),
        ("t;x [mil];y [mils];z [thou]", None, 25.4),
        ("t;dx_in;dy (inch);dz/in", None, 25400.0),
        ("t [s];x [µin];y [uin];z_uin", None, 0.0254),
        ("t;x [nm];y [nm];z [nm]", None, 1e-3),
        ("t;grammm;y;z", None, 1.0),
        ("recorded in mm", None, 1.0),
    ],
)
def test_the_head_names_the_unit(tmp_path: Path, head: str, unit: str | None, factor: float) -> None:
    path = tmp_path / "r.txt"
    path.write_text("\n".join([head, *(f"{k};1,5;2,5;{k}" for k in range(30))]), encoding="utf-8")
    _, readings = read_recording(path, ["t", "dx_um", "dy_um", "dz_um"], unit=unit)
    assert readings["dx_um"] == pytest.approx(1.5 * factor)


def test_the_head_names_the_unit_of_the_time_and_none_of_another_quantity(tmp_path: Path) -> None:
    path = tmp_path / "r.txt"
    rows = [f"{50 * k};1.5;2.5;{k}" for k in range(30)]
    path.write_text("\n".join(["t_ms;x [µm];y [µm];z [µm]", *rows]), encoding="utf-8")
    time, _ = read_recording(path, ["t", *COLUMNS])
    assert time[1] == pytest.approx(0.05)
    for head in ("t;x [counts];y;z", "t;x [deg];y;z", "t [mm];x;y;z"):
        path.write_text("\n".join([head, *rows]), encoding="utf-8")
        with pytest.raises(InputError, match="has the unit") as caught:
            read_recording(path, ["t", *COLUMNS])
        assert caught.value.path == path
    path.write_text("\n".join(["t;x [counts];y;z", *rows]), encoding="utf-8")
    assert read_recording(path, ["t", *COLUMNS], unit="mil")[1]["dx_um"][0] == pytest.approx(1.5 * 25.4)
