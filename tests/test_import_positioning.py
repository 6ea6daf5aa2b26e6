"""Tables of positioning tests (ISO 230-2) as lasers and autocollimators export them."""

from pathlib import Path

import numpy as np
import pytest

from symfive.campaign import Campaign, read_campaign
from symfive.cli import main
from symfive.diagnose import diagnose
from symfive.machine import preset
from symfive.motion import approach
from symfive.procedures import campaign_of, linear_positioning
from symfive.simulate import simulate
from symfive.standards import standard_values

MACHINE = preset("three-axis")


def _imported(folder: Path, machine: str, *words: object) -> Campaign:
    assert main([str(word) for word in ("import", machine, *words, "-o", folder / "out", "-q")]) == 0
    return read_campaign(folder / "out")


def test_a_laser_file_gives_the_numbers_of_its_test(tmp_path: Path):
    """Of a test without overruns."""
    (run,) = linear_positioning(MACHINE, axis="X", cycles=5, overrun=3.0)
    run = simulate(campaign_of(MACHINE, [run]), seed=4).campaign.runs[0]
    way, x = run.commands["X"], run.readings["X_dev_um"]
    targets = np.unique(way)[1:-1]
    rises = np.concatenate([[True], np.diff(way) > 0.0])
    up, down = (np.array([x[(way == t) & (rises == side)][:5] for t in targets]) for side in (True, False))
    wanted = {v.title: v.value for v in standard_values(Campaign(machine=MACHINE, runs=(run,)))}
    rows = [
        ";".join(f"{v:.4f}".replace(".", ",") for v in (t, *u, *d)) for t, u, d in zip(targets, up, down, strict=True)
    ]
    heads = ";".join(["Target [mm]", *(f"up {k} [µm]" for k in range(1, 6)), *(f"down {k} [µm]" for k in range(1, 6))])
    (tmp_path / "x.csv").write_text("\n".join(["Machine;4711", "", heads, *rows]), encoding="cp1252")
    wide = _imported(tmp_path, "three-axis", tmp_path / "x.csv", "--yes")
    inner = np.isin(way, targets)
    lines = [f"{t / 25.4:.8f}, {(t + 1e-3 * d) / 25.4:.9f}" for t, d in zip(way[inner], x[inner], strict=True)]
    (tmp_path / "long.csv").write_text("\n".join(["target (inch), measured (inch)", *lines]))
    long = _imported(tmp_path, "three-axis", tmp_path / "long.csv", "--yes", "--overwrite")
    for target, upward, downward in (("Ziel", "auf", "ab"), ("Target", "Fwd", "Rev")):
        other = heads.replace("Target", target).replace("up", upward).replace("down", downward)
        (tmp_path / f"{target}.csv").write_text("\n".join([other, *rows]), encoding="cp1252")
        again = _imported(tmp_path, "three-axis", tmp_path / f"{target}.csv", "--yes", "--overwrite")
        np.testing.assert_array_equal(again.runs[0].readings["X_dev_um"], wide.runs[0].readings["X_dev_um"])
    for campaign in (wide, long):
        found = {v.title: v.value for v in standard_values(campaign)}
        assert set(found) == set(wanted)
        for name, value in wanted.items():
            assert found[name] == pytest.approx(value, abs=0.01), name
    cycles = _imported(tmp_path, "three-axis", tmp_path / "x.csv", "--yes", "--split", "cycles", "--overwrite")
    assert [run.rows for run in cycles.runs] == [2 * len(targets)] * 5
    again = {v.title: v.value for v in standard_values(cycles)}
    assert again["E X"] == pytest.approx(wanted["E X"], abs=0.01)


def test_a_positioning_test_keeps_its_times(tmp_path: Path):
    """As a growth of the axis needs them; the last target stands twice, reached from either side."""
    (tmp_path / "x.csv").write_text("time [s];target [mm];deviation [µm]\n5;0;0\n11;100;1\n29;100;4\n36;0;3\n")
    (run,) = _imported(tmp_path, "three-axis", tmp_path / "x.csv", "--yes").runs
    assert run.has_clock and run.time.tolist() == [0.0, 6.0, 24.0, 31.0]
    assert approach(run.commands["X"]).tolist() == [1.0, 1.0, -1.0, -1.0]


@pytest.mark.parametrize("begin", ["", "2026-03-02 ", "2026-03-02T"])
def test_instants_are_read_as_seconds(begin: str, tmp_path: Path):
    """As logs have them; a decimal point there says nothing of the marks of the readings."""
    times = ["23:59:58", "23:59:58.25", "23:59:59,5"]
    rows = [f"{begin}{t};{x};{x // 100},5" for t, x in zip(times, (0, 100, 200), strict=True)]
    (tmp_path / "x.csv").write_text("\n".join(["Timestamp;target [mm];deviation [µm]", *rows]))
    (run,) = _imported(tmp_path, "three-axis", tmp_path / "x.csv", "--yes").runs
    np.testing.assert_allclose(run.time, [0.0, 0.25, 1.5], atol=1e-6)
    np.testing.assert_allclose(run.readings["X_dev_um"], [0.5, 1.5, 2.5])


def test_a_rotary_axis_has_a_positioning_test_too(tmp_path: Path):
    """Readings of an autocollimator, arcseconds, at targets in degrees."""
    rows = [f"{t},{u},{d}" for t, u, d in ((0.0, 0.0, 3.0), (90.0, -7.2, -3.6), (180.0, 1.8, 5.4))]
    (tmp_path / "c.csv").write_text("\n".join(["target [°],up [arcsec],down [arcsec]", *rows]))
    (run,) = _imported(tmp_path, "table-bc", tmp_path / "c.csv", "--yes", "--axis", "C").runs
    np.testing.assert_allclose(run.commands["C"], [0.0, 90.0, 180.0, 180.0, 90.0, 0.0], atol=1e-5)
    seconds = [0.0, -7.2, 1.8, 5.4, -3.6, 3.0]
    np.testing.assert_allclose(run.readings["C_dev_urad"], 1e6 * np.radians(seconds) / 3600.0)
    (tmp_path / "long.csv").write_text("target,measured\n0,0.001\n90,89.99\n")
    words = ("table-bc", tmp_path / "long.csv", "--axis", "C", "--map", "target=1:deg", "--map", "measured=2:deg")
    (long,) = _imported(tmp_path, *words, "--overwrite").runs
    np.testing.assert_allclose(long.readings["C_dev_urad"], 1e6 * np.radians([0.001, -0.01]), atol=1e-6)


def test_a_drift_at_a_standstill_needs_no_column_of_a_position(tmp_path: Path):
    (tmp_path / "z.csv").write_text("time [s];Z_dev [µm]\n0;0\n60;4.5\n125;7\n")
    (run,) = _imported(tmp_path, "three-axis", tmp_path / "z.csv", "--yes", "--hold", "Z=120", "--static").runs
    assert run.commands["Z"].tolist() == [120.0] * 3 and run.options["axis"] == "Z"
    assert run.sampling == "static" and run.has_clock and run.time.tolist() == [0.0, 60.0, 125.0]
    (moving,) = _imported(tmp_path, "three-axis", tmp_path / "z.csv", "--yes", "--hold", "Z=120", "--overwrite").runs
    assert moving.dynamic


@pytest.mark.parametrize("words", [("--map", "X=2:mm", "--map", "X_dev=3:um", "--static"), ("--map", "target=2:mm")])
def test_what_is_read_twice_where_an_axis_turns_back_is_read_from_both_sides(words: tuple[str, ...], tmp_path: Path):
    """A timed recording of ISO 230-2: the overrun at the ends is not in it. Readings repeated on the way are of one side."""
    way = np.repeat([0.0, 100.0, 200.0, 200.0, 100.0, 0.0, 0.0, 100.0, 200.0], 2)
    (tmp_path / "x.csv").write_text(
        "\n".join(["time [s],X [mm],dev [um]", *(f"{5 * k},{x},0" for k, x in enumerate(way))])
    )
    words = (*words, "--map", "deviation=3:um", "--axis", "X") if "--static" not in words else words
    (run,) = _imported(tmp_path, "three-axis", tmp_path / "x.csv", "--map", "time=1:s", *words, "--yes").runs
    np.testing.assert_allclose(run.commands["X"], way, atol=2e-6)
    assert approach(run.commands["X"]).tolist() == [*[1.0] * 6, *[-1.0] * 6, *[1.0] * 6]


def test_repeats_at_one_target_are_diagnosed(tmp_path: Path):
    """One place is no table of places: its knots did not ascend, and diagnose ended in that."""
    noise = np.random.default_rng(1).normal(0.0, 0.3, 30)
    (tmp_path / "a.csv").write_text("target [mm],deviation [um]\n" + "\n".join(f"100,{v:.2f}" for v in noise))
    assert not diagnose(_imported(tmp_path, "three-axis", tmp_path / "a.csv", "--axis", "X", "--yes")).findings
