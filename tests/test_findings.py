"""What is said of several terms that describe one unidentified cause."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lean import location_only
from test_outliers import NOISE_UM, TARGETS, campaign

from symfive.campaign import Campaign, Run, read_campaign
from symfive.diagnose import Finding, amend, diagnose, facts_of, findings_of, locate
from symfive.effects import EFFECTS, Form, make_effect
from symfive.posterior import (
    WHITE,
    Expansion,
    Posterior,
    Verdict,
    baseline,
    candidates,
    expanded,
    laws_apart,
    moments_about,
    nearest_width,
)
from symfive.worth import effect_worths

CAMPAIGN = Path(__file__).parent / "data" / "campaigns" / "planar-none" / "fit"


def _found(names: tuple[tuple[str, str | None], ...], elsewhere: bool) -> tuple[tuple[Finding, ...], Expansion]:
    """Of two shifts, the second in another run if `elsewhere`, that are stated under `names`."""
    campaign = read_campaign(CAMPAIGN)
    campaign = replace(campaign, runs=tuple(run.part(0, 400) for run in campaign.runs[:2]))
    others = set(EFFECTS) - {"setup_shift"}
    first, second = campaign.runs[0], campaign.runs[1 if elsewhere else 0]
    shifts = [
        make_effect("setup_shift", run=run.id, t_s=float(run.time[int(share * run.rows)]), tag=tag).prepare(campaign)
        for run, share, tag in ((first, 0.3, ""), (second, 0.6, "2"))
    ]
    before, stated = baseline(campaign), candidates(campaign, others)
    here, evidence = expanded(amend(before, *shifts), [Form(effect=effect) for effect in shifts], stated)
    moments = moments_about(here, stated)
    held = tuple((t, nearest_width(1.0)) for t in range(moments.held))
    verdicts = [Verdict(t, names, 0.99, {}, (), (), False) for t in range(moments.held)]
    return findings_of(
        Posterior(moments, {held: evidence}), here, before, verdicts, locate(before, exclude=others)
    ), here


def test_an_unidentified_cause_over_one_coordinate_of_a_run_is_one_finding() -> None:
    """Six shifts that no name explains came back as six findings over time in the same run."""
    (finding,), here = _found((), elsewhere=False)
    assert finding.unidentified
    assert len(finding.effects) == 2
    whole = sum(here.fit.problem().contribution(e, here.fit.values)[finding.runs[0]] for e in finding.effects)
    np.testing.assert_allclose(finding.contribution[finding.runs[0]], whole)
    assert "by 2 terms" in finding.says
    assert "needs no repair" not in facts_of(finding, here.fit)["what to do"]
    assert len(finding.to_data()["further"]) == 1
    together = effect_worths(here.fit, [finding.effects])[0]
    assert together.names == tuple(
        n for e in finding.effects for n in (p.name for p in e.parameters(here.fit.model.campaign))
    )


@pytest.mark.parametrize(("names", "elsewhere"), [((("setup_shift", None),), False), ((), True)])
def test_what_has_a_name_or_acts_in_another_run_is_a_finding_of_its_own(names: tuple, elsewhere: bool) -> None:
    found, _ = _found(names, elsewhere)
    assert [finding.further for finding in found] == [(), ()]


def test_what_a_law_is_off_by_is_fitted_and_said_with_it() -> None:
    """A bow that is no polynomial of the catalogue: the law alone would predict the readings worse than is believed."""
    rng, way = np.random.default_rng(3), np.concatenate([TARGETS, TARGETS[::-1]])
    place = (way - 150.0) / 160.0
    bent = 30.0 * np.abs(place) ** 1.5 + 3.0 * np.sin(5.0 * place) * place
    found = diagnose(campaign([bent + NOISE_UM * rng.standard_normal(len(way)) for _ in range(5)]))
    (finding,) = found.findings
    ((effect, _),) = finding.discrepancies
    assert found.fit.rms_after_um == pytest.approx(NOISE_UM, rel=0.05)
    values = found.after.values.copy()
    for p in effect.parameters(found.after.model.campaign):
        values[found.after.model.index[p.name]] = 0.0
    lawful = found.after.problem().residuals_at(values)
    assert np.sqrt(np.mean([np.mean(r**2) for r in lawful.values()])) > 2.0 * found.fit.rms_after_um
    assert finding.to_data()["discrepancies"][0]["form"] == effect.key
    assert "discrepancy 1.6" in facts_of(finding, found.after)["how large"]
    assert effect in finding.effects  # what is corrected together


def test_a_laser_that_is_pushed_within_a_cycle_is_a_shift_of_the_set_up() -> None:
    """3 µm towards the reflector before the 41st reading of the second of three cycles, and a play of 2 µm."""
    rng, there = np.random.default_rng(4), np.repeat([-1.0, 1.0], len(TARGETS))
    cycles = [there + NOISE_UM * rng.standard_normal(len(there)) for _ in range(3)]
    cycles[1][40:] -= 3.0
    found = {finding.name: finding for finding in diagnose(campaign(cycles)).findings}
    assert set(found) == {"setup_shift", "backlash"} and found["setup_shift"].parameters["run"].value == "cycle-2"
    shift, width = found["setup_shift"].parameters["shift"], found["backlash"].parameters["width"]
    assert isinstance(shift.value, tuple) and isinstance(shift.std, tuple)
    assert shift.value[0] == pytest.approx(3.0, abs=3.0 * shift.std[0]) and shift.std[0] < 0.3
    assert abs(width.value) == pytest.approx(2.0, abs=3.0 * width.std)


@pytest.mark.slow
def test_a_bow_is_no_periodic_error() -> None:
    """What is seen once does not come back: a bend and a hump along X were a period of the whole travel with 96 %."""
    rng, way = np.random.default_rng(3), np.concatenate([TARGETS, TARGETS[::-1]])
    place = (way - 150.0) / 160.0
    bent = 30.0 * place**2 * np.sign(place) + 4.0 * np.exp(-(((place - 0.3) / 0.25) ** 2))
    found = diagnose(campaign([bent + NOISE_UM * rng.standard_normal(len(way)) for _ in range(3)]))
    assert [finding.coordinate for finding in found.findings] == ["X"]
    assert found.findings[0].name != "transmission_error" and found.fit.rms_after_um < 1.1 * NOISE_UM


def test_a_discrepancy_holds_nothing_of_its_law() -> None:
    """A slope of 120 µm/m and a curve: the curve, free to hold a slope too, left 10.9 ± 16.5 ppm of a scale error of 33 ± 2."""
    rng, way = np.random.default_rng(3), np.concatenate([TARGETS, TARGETS[::-1]])
    place = (way - way.mean()) / np.ptp(way)
    curve = 6.0 * np.exp(-((place / 0.15) ** 2))
    read = campaign([curve + 0.12 * way + NOISE_UM * rng.standard_normal(len(way)) for _ in range(5)])
    read = replace(read, machine=replace(read.machine, errors={}))
    law = replace(make_effect("scale_error", axis="X").prepare(read), spread=10.0)
    beside = make_effect("unknown", over=("X",), place="axis").prepare(read)
    fit = amend(baseline(read), law, beside)
    here = Expansion(fit, (Form(effect=law),), WHITE, 1.0, (Form(effect=beside, channel="axis"),))
    stated, name = laws_apart(here), "scale_error.X.ppm"
    line = np.column_stack([np.ones(len(way)), way])
    slope = np.linalg.lstsq(line, curve + 0.12 * way, rcond=None)[0][1]
    sigma = NOISE_UM / np.sqrt(5.0) / np.linalg.norm(way - way.mean())
    assert fit.uncertainty(name) > 5.0 * stated.uncertainty(name)
    assert stated[name] == pytest.approx(1e3 * slope, abs=3e3 * sigma)
    assert stated.uncertainty(name) == pytest.approx(1e3 * sigma, rel=0.1)
    fitted, parts = (
        [fit.problem().contribution(e, values)["cycle-1"][:, 0] for e in (law, beside)]
        for values in (fit.values, stated.values)
    )
    assert abs(np.polyfit(way, parts[1], 1)[0]) < 1e-3 * slope
    assert np.ptp(sum(fitted) - sum(parts)) < 0.05  # what is said adds up, but for zeros


@pytest.mark.slow
def test_a_law_that_holds_has_no_discrepancy() -> None:
    rng, way = np.random.default_rng(3), np.concatenate([TARGETS, TARGETS[::-1]])
    wave = 4.0 * np.sin(2.0 * np.pi * way / 70.0)
    found = diagnose(campaign([wave + NOISE_UM * rng.standard_normal(len(way)) for _ in range(5)]))
    (finding,) = found.findings
    assert (finding.name, finding.discrepancies) == ("transmission_error", ())


def test_a_component_that_the_sensor_does_not_see_is_no_alternative() -> None:
    """A sensor along y reads positioning errors of X by their product with a squareness: millimetres of them would fit."""
    machine = location_only("three-axis")
    x = np.concatenate([np.linspace(-300.0, 300.0, 31), np.linspace(300.0, -300.0, 31)])
    rough = np.random.default_rng(3).normal(0.0, 0.3, len(x))
    run = Run(
        id="edge", instrument=("straightedge",), sampling="static", time=4.0 * np.arange(len(x)),
        commands={"X": x, "Y": np.zeros(len(x)), "Z": np.full(len(x), 100.0)}, table_ball=(0.0, 0.0, -50.0),
        tool_ball=(0.0, 0.0, -150.0), u=(0.0, 1.0, 0.0), v=(1.0, 0.0, 0.0), noise_um=0.3,
        readings={"ds_um": 6.0 * (x / 300.0) ** 3 + rough},
    )  # fmt: skip
    (finding,) = diagnose(Campaign(machine=machine, runs=(run,))).findings
    assert finding.name == "error_motion" and finding.axis == "X"
    assert {"error_motion.EXX", "error_motion.EBX"}.isdisjoint({finding.effect.key, *finding.alias})
