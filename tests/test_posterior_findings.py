"""The posterior names what it should: textbook plays, what a tilt closes, what comes back over time, open campaigns."""

from pathlib import Path
from typing import Any

import numpy as np
import plant
import pytest
from posterior_world import CAMPAIGNS, NOISE, bars

from symfive.campaign import Campaign, read_campaign
from symfive.diagnose import diagnose


def two_nests(folder: Path, effect: dict[str, Any], seed: int) -> Campaign:
    """R-tests in two nests of the independent plant, with one effect."""
    machine = plant.static_table()
    poses = plant.grid_poses(np.arange(-90, 91, 30.0), np.arange(0, 331, 30.0))
    runs = [
        plant.r_test(machine, "nest1", nest=(90, -20, 50), poses=poses),
        plant.r_test(machine, "nest2", nest=(50, 40, 150), poses=poses, start_s=1500.0),
    ]
    plant.write_campaign(folder, machine, runs, {"EX0B": 30.0}, None, [effect], seed=seed)
    return read_campaign(folder)


@pytest.mark.slow
def test_a_play_that_a_tilt_closes_is_no_backlash_but_unknown_over_both(tmp_path: Path) -> None:
    """A law of the library that holds at one tilt only: its name was said with 0.999, and two more beside it."""
    play = {"effect": "preloaded_play", "axis": "C", "tilt": "B", "limit": 0.8, "width": 60.0}
    found = diagnose(two_nests(tmp_path, play, seed=5))
    assert [f.name for f in found.findings] == ["unknown"]
    assert set(found.findings[0].coordinate.split(", ")) == {"C velocity sign", "B"}
    after, before = found.fit.chi2_dof_after, found.fit.chi2_dof_before
    assert after - 1.0 < 0.4 * (before - 1.0)  # what is closed at once is not quite a parabola


@pytest.mark.slow
def test_what_comes_back_over_time_is_unknown_over_time_with_its_period(tmp_path: Path) -> None:
    """A cooler that goes on and off: no drift, and no course of few intervals follows it."""
    cooler = {"effect": "coolant_cycle", "direction": [0.6, 0.0, 0.8], "amplitude": 3.0, "period_s": 410.0, "rise": 0.3}
    found = diagnose(two_nests(tmp_path, cooler, seed=6))
    assert [(f.name, f.coordinate) for f in found.findings] == [("unknown", "t")]
    period = found.findings[0].parameters["period"]
    assert period.value == pytest.approx(410.0, abs=3.0 * period.std) and period.std < 8.0
    assert found.fit.chi2_dof_after < 1.3 and found.fit.chi2_dof_before > 3.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plays", "soft", "machine"),
    [
        ({"X": 5.0, "Y": 11.0}, 0.0, "three-axis"),
        ({"X": 14.0, "Y": 4.0}, 0.0, "three-axis"),
        ({"X": 5.0}, 0.0, "three-axis"),
        ({"Y": 8.0}, 60.0, "three-axis"),
        ({"X": 5.0, "Y": 11.0}, 0.0, "table-bc"),
        ({}, 0.0, "table-bc"),
    ],
)
def test_textbook_plays_get_their_names_and_widths(plays: dict[str, float], soft: float, machine: str) -> None:
    result = diagnose(bars(plays, soft, machine))
    widths = {f.axis: f.parameters["width"].value for f in result.findings if f.name == "backlash"}
    others = {(f.name, f.axis) for f in result.findings if f.name != "backlash"}
    # the trunnion machine's baseline has no scale, the traces do
    assert others == (set() if machine == "three-axis" else {("scale_error", "X")})
    assert widths == pytest.approx(plays, abs=0.3)


@pytest.mark.slow
def test_what_cannot_be_distinguished_is_a_rival_and_gets_a_test() -> None:
    """A play of X and a carriage that turns by it give the same readings on circles of one height."""
    result = diagnose(bars({"X": 6.0}, machine="table-bc"))
    play = next(f for f in result.findings if (f.name, f.axis) == ("backlash", "X"))
    assert any(key.startswith("lateral_play") for key in play.alias)
    assert play.test is not None and play.test.useful and play.next_test
    assert 0.5 < play.confidence < 0.99


@pytest.mark.slow
def test_readings_left_out_are_predicted_better_with_the_finding() -> None:
    result = diagnose(bars({"X": 5.0, "Y": 11.0}))
    before, after = result.fit.heldout_rms_before_um, result.fit.heldout_rms_after_um
    assert before is not None and after is not None
    assert before > 2.0
    assert after < 1.1 * NOISE
    assert not result.unnamed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("static-none", set()), ("dynamic-none", set()), ("planar-none", set()), ("static-ball-bar-two-heights", set()),
        ("dynamic-backlash", {("backlash", "C")}),
        ("static-sag-and-drift", {("gravity_sag", "B"), ("thermal_drift", None)}),
    ],
)  # fmt: skip
def test_open_campaigns(name: str, expected: set[tuple[str, str | None]]) -> None:
    result = diagnose(read_campaign(CAMPAIGNS / name / "fit"))
    assert {(f.name, f.axis) for f in result.findings} == expected
