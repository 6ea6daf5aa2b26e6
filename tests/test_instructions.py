"""Programs and sheets have the operator keep what the evaluation takes as known: a zero, a place on the table."""

from dataclasses import replace
from pathlib import Path

import pytest

from symfive.campaign import Run, SetupSigma, read_campaign
from symfive.design import Sheet, setup_sheet
from symfive.machine import preset
from symfive.model import Model
from symfive.nc import Post, program_steps
from symfive.procedures import planar_circle, r_test_grid

PLANS = Path(__file__).parent.parent / "designs" / "plans"
FREE_UM = 1e4
"""1σ of a zero that nobody knows."""
MACHINE = {"options": {"frame": "machine"}}
KNOWN = {"setup_sigma_um": SetupSigma(zero=5.0)}
CASES = {
    "bar": ("table-bc-ball-bar-48", {}, "MOUNT BAR, KEEP ITS ZERO", "known to 20 µm"),
    "nest": ("table-bc-r-test-40", {}, "SEAT BALL, ZERO IT", "within 1 mm: the readings determine its exact position"),
    "nest at a known place": ("table-bc-r-test-40", KNOWN, "SEAT BALL, KEEP ITS ZERO", "known to 5 µm"),
    "head in the spindle": ("table-bc-r-test-40", MACHINE, "SEAT BALL, ZERO IT", "known to 20 µm"),
}


def of_plan(name: str, changes: dict) -> tuple[Run, str, str]:
    """The first run of a ready plan, what the program says where the instrument is seated, and the sheet."""
    campaign = read_campaign(PLANS / name)
    run = replace(campaign.runs[0], **changes)
    stops = [step.text for step in program_steps(campaign.machine, run) if step.kind == "stop"]
    campaign = replace(campaign, runs=(run,))
    return run, stops[2], setup_sheet(Sheet(campaign=campaign, post=Post()), {}, ())


def test_a_recording_is_started_and_stored_at_its_stops() -> None:
    """The screen of an R-test in motion named neither; no text is longer than the 26 characters that every control shows."""
    machine, wanted = preset("three-axis"), preset("table-bc")
    sweep = replace(r_test_grid(wanted, returning=False)[0], sampling="dynamic")
    disc = planar_circle(machine, instrument="grid_encoder")[0]
    bar = planar_circle(machine)[0]
    for owner, run, texts in (
        (wanted, sweep, ["SEAT, ZERO IT, THEN RECORD", "STORED? FREE BALL"]),
        (machine, disc, ["SEAT, ZERO IT, THEN RECORD", "STORED? FREE HEAD"]),
        (machine, bar, ["MOUNT BAR, THEN RECORD", "STORED? REMOVE BAR"]),
    ):
        stops = [step.text for step in program_steps(owner, run) if step.kind == "stop"]
        assert stops[-2:] == texts and max(map(len, stops)) <= 26


@pytest.mark.parametrize(("plan", "changes", "stop", "place"), CASES.values(), ids=CASES)
def test_the_operator_is_told_to_keep_what_is_known(plan, changes, stop, place):
    run, said, sheet = of_plan(plan, changes)
    model = Model(replace(read_campaign(PLANS / plan), runs=(run,)))
    zeros = [p.sigma for p in model.parameters if ".zero." in p.name]
    free = bool(zeros) and min(zeros) >= FREE_UM
    assert said == stop and ("ZERO IT" in said) == free
    assert ("do not set them to zero" in sheet) != free
    assert place in sheet
