"""The test that separates two explanations best: what an expert would take, several rivals, its folder."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from lean import location_only

from symfive.campaign import Campaign, Run, read_campaign
from symfive.design import APART, Discrimination, Separation, discriminate, in_addition, in_common, write_test
from symfive.design._discriminate import _Explained  # a rival that levels off, as no model does
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.machine import preset
from symfive.model import Model
from symfive.procedures import campaign_of, planar_circle


def test_a_rival_whose_steps_lead_beyond_the_readings_is_judged_by_the_best_of_them() -> None:
    """Readings that level off (tanh): whole steps from 3 lead to -98 and 1e84, where no slope is left to solve with."""
    bounds = SimpleNamespace(lower=-np.inf, upper=np.inf)

    def linearise(run: str, values: np.ndarray) -> SimpleNamespace:
        with np.errstate(over="ignore"):
            jacobian = np.array([[[100.0 / np.cosh(values[0]) ** 2]]])
        return SimpleNamespace(prediction=100.0 * np.tanh(values)[None], jacobian=jacobian, columns=np.array([0]))

    readings: Any = SimpleNamespace(
        predict_run=lambda run, truth: np.zeros((1, 1)),
        noise=lambda run: np.ones(1),
        start=np.zeros(1),
        prior_mean=np.zeros(1),
        prior_sigma=np.ones(1),
        campaign=SimpleNamespace(runs=[SimpleNamespace(id="run")]),
    )
    rival: Any = SimpleNamespace(
        prior_sigma=np.full(1, 1e200), prior_mean=np.zeros(1), start=np.full(1, 3.0), parameters=[bounds],
        linearise=linearise, noise=lambda run: np.ones(1),
    )  # fmt: skip
    assert _Explained(readings, np.zeros(1), rival, rival.start, {}).left(["run"]) == pytest.approx(
        (100.0 * np.tanh(3.0)) ** 2
    )


def test_discrimination_finds_the_test_that_an_expert_would_take() -> None:
    """A bow of Y across X and a scale error of X quadratic in x look alike on one circle (EFFECTS.md 2.2): a repeat tells
    nothing, a circle elsewhere does."""
    machine = location_only("three-axis")
    options = {"basis": "polynomial", "order": 2}
    here = planar_circle(machine, plane="XY", feed=2000.0, direction="ccw", rate_hz=20.0)
    there = planar_circle(machine, plane="XY", feed=2000.0, direction="ccw", rate_hz=20.0, centre=(0.0, 100.0, 80.0))
    given = Campaign(machine=machine, runs=here)
    bow = Model(given, [make_effect("error_motion", "Y", component="EXY", **options)])
    quadratic = Model(given, [make_effect("error_motion", "X", component="EXX", **options)])
    found = discriminate(bow, quadratic, [here, there])
    assert found.test.runs == there and found.useful
    assert found.separation > 1.5 * found.before
    averaged = discriminate(bow, quadratic, [here, there], draws=2)
    assert averaged.test.runs == there and "separates" in averaged.says
    with pytest.raises(InputError, match="there is no test to choose from"):
        discriminate(bow, quadratic, [])


def test_a_repeat_separates_no_two_causes_beside_a_growth_that_both_know() -> None:
    """Play of X and a tilt at its reversals are alike on one line. A fit of the growth of the screw from nothing ends in 4 steps
    far from it: "the repeat separates them by 149σ"."""
    targets = np.linspace(-350.0, 350.0, 11)
    way = np.tile(np.concatenate([targets, targets[::-1] - 1e-6]), 5)
    laser = Run(
        id="laser", instrument=("laser",), sampling="static", time=6.0 * np.arange(way.size), tool_ball=(0.0, 0.0, -150.0),
        commands={"X": way, "Y": 0.0 * way, "Z": 0.0 * way + 200.0}, options={"axis": "X"},
    )  # fmt: skip
    higher = replace(laser, id="higher", commands=laser.commands | {"Z": 0.0 * way + 300.0})
    warm = make_effect("axis_growth", "X")
    known = {
        f"axis_growth.X.{name}": size for name, size in (("growth", 25.0), ("held", -400.0), ("time_constant_s", 317.0))
    }
    given = Campaign(machine=preset("three-axis"), runs=(laser,))
    play, tilt = (
        Model(given, [warm, effect])
        for effect in (make_effect("backlash", "X"), make_effect("lateral_play", "X", component="EBX"))
    )
    found = discriminate(play, tilt, [replace(laser, id="repeat"), higher], values_a=known, values_b=known)
    assert found.table[0].name == "higher" and found.useful
    assert found.before < APART and found.table[1].sigmas < APART


def test_a_rival_that_only_the_priors_make_improbable_spoils_no_test_against_the_others():
    """A cubic holds a straight line: nothing parts them, and 3.2σ of prior are no reason to call all tests useless."""
    machine = preset("three-axis")
    runs = [
        replace(run, id=f"t{k}", file=f"t{k}.csv") for k in range(2) for run in planar_circle(machine, direction="ccw")
    ]
    plain = Campaign(machine=machine, runs=tuple(runs), name="plan")

    def part(before: float, *sigmas: float) -> Discrimination:
        table = [Separation(run.id, s, 1.0) for run, s in zip(runs, sigmas, strict=True)]
        return Discrimination(plain, max(sigmas), before, tuple(sorted(table, key=lambda row: -row.sigmas)))

    both = in_common({"cubic": part(3.2, 3.3, 3.25), "sag": part(3.2, 3.25, 11.0)}, runs)
    assert both.useful and both.test.runs[0].id == "t1"
    assert both.separation == 11.0 and both.before == 3.2
    assert dict(both.each)["sag"] == pytest.approx(10.5, abs=0.05) and dict(both.each)["cubic"] < APART
    assert "sag by 10.5σ" in both.says and "cubic" in both.says
    assert not in_common({"cubic": part(3.2, 3.3, 3.25)}, runs).useful
    nothing = in_common({"cubic": part(0.0, 0.01, 0.04)}, runs)
    assert not nothing.useful and "no further test" in nothing.says


def test_further_tests_are_those_that_part_what_the_first_leaves():
    machine = preset("three-axis")
    plain = campaign_of(machine, planar_circle(machine, direction="ccw"))

    def part(before: float, **sigmas: float) -> Discrimination:
        table = tuple(Separation(name, s, 1.0) for name, s in sigmas.items())
        return Discrimination(plain, max(sigmas.values()), before, table)

    one, two, three = part(0.0, a=9.0, b=1.0, c=0.0), part(4.0, a=4.1, b=5.5, c=4.0), part(0.0, a=0.0, b=4.0, c=9.0)
    assert in_addition({"one": one}, "a") == ["a"]
    assert in_addition({"one": one, "two": two, "three": three}, "a") == ["a", "b"]
    assert in_addition({"one": one, "three": three}, "a") == ["a", "c"]
    assert in_addition({"one": one, "known": part(4.0, a=4.5, b=4.9, c=4.0)}, "a") == ["a"]  # 2.8σ more at most


def test_a_further_test_is_a_plan_with_programs_and_a_sheet_that_says_what_it_is_for(tmp_path: Path) -> None:
    asked = campaign_of(preset("three-axis"), planar_circle(preset("three-axis"), direction="ccw"))
    test = Discrimination(asked, 41.2, 2.0, (Separation("xy-ccw", 41.2, 3.0),))
    write_test(test, tmp_path, nc=("linuxcnc", "heidenhain"))
    assert read_campaign(tmp_path).runs[0].rows == asked.rows
    assert [p.parent.name for p in sorted(tmp_path.glob("nc/*/*"))] == ["heidenhain", "linuxcnc"]
    sheet = (tmp_path / "setup.html").read_text(encoding="utf-8")
    assert "xy-ccw separates the two by 41.2σ" in sheet and "nc/linuxcnc/*.ngc" in sheet
    assert "drive the tool ball there and lock the table ball under it" in sheet and "known to 20 µm (1σ)" in sheet


def test_a_further_test_without_a_clear_way_gets_no_program(tmp_path: Path) -> None:
    """A whole circle in YZ carries the bar through what stands under the table ball: the sheet says so in a program's place."""
    machine = preset("three-axis")
    asked = campaign_of(machine, planar_circle(machine, plane="YZ", sweep_deg=360.0, direction="ccw"))
    write_test(Discrimination(asked, 41.2, 2.0, (Separation("yz-ccw", 41.2, 3.0),)), tmp_path, nc=("linuxcnc",))
    assert not list(tmp_path.glob("nc/*/*"))
    sheet = (tmp_path / "setup.html").read_text(encoding="utf-8")
    assert "No program: run yz-ccw: bar and" in sheet and "along the recording at line" in sheet
