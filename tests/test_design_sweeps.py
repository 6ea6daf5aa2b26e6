"""R-tests and ball bars in motion: plans, their programs, and readings of the independent plant with lag, delay and slow
noise."""

import itertools
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2
from sweeps_world import measured

from symfive.campaign import Campaign, read_campaign, write_campaign_files
from symfive.cli import main
from symfive.design import Assessment, SweepPlan, _sweep_plan, _sweep_search, assess, make_space, plan_sweeps
from symfive.design._sweeps import Sweeps
from symfive.errors import InputError
from symfive.identify import identify
from symfive.inference import Noise
from symfive.machine import EffectEntry, preset
from symfive.nc import Post, program
from symfive.procedures import DWELL_S, Nominal, through
from tests.plan_checker import check

MACHINE = "nutating-table"
MINUTES, SPEED = 7.0, 20.0
DRAWN = 3
"""Machines that the plant draws."""
COARSE = {"POSITIONS": 8, "OF_A_BAR": 8, "SHAKES": 6, "HALVINGS": 1}
SHIPPED = {name: getattr(_sweep_search, name) for name in COARSE}


@pytest.fixture(scope="module", autouse=True)
def coarse() -> Iterator[None]:
    """The same search on a sixth of the positions or fewer, with few steps, and a tenth of the sweeps that only a certificate
    looks at. Slow tests run the search as it ships."""
    with pytest.MonkeyPatch.context() as patch:
        for name, size in COARSE.items():
            patch.setattr(_sweep_search, name, size)
        patch.setitem(_sweep_plan.INSTRUMENTS, "ball_bar", replace(_sweep_plan.INSTRUMENTS["ball_bar"], drawn=1_000))
        yield


def _plan(minutes: float = MINUTES, **options: Any) -> SweepPlan:
    return plan_sweeps(MACHINE, minutes=minutes, speeds=(SPEED,), rate_hz=10.0, **options)


def _findings(made: SweepPlan, target: Path, *nc: str, post: Post | None = None) -> list[str]:
    """What the checker finds in the plan's folder."""
    made.write(target, nc=nc, post=post)
    return [str(finding) for finding in check(target)]


@pytest.fixture(scope="module")
def made() -> SweepPlan:
    return _plan()


@pytest.fixture(scope="module")
def bar() -> SweepPlan:
    return _plan(MINUTES - 0.5, instrument="ball_bar")


@pytest.fixture(scope="module")
def twice() -> SweepPlan:
    """The mean variance is that of the set-up errors, which another mounting lowers."""
    return _plan(2.0 * MINUTES - 1.5, criterion="A", setups=2)


@pytest.fixture(scope="module")
def folder(made: SweepPlan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("plan") / "sweeps"
    made.write(target, nc=("linuxcnc", "heidenhain"))
    return target


def test_ways_through_stops_keep_the_speed_of_the_axis_that_turns_most() -> None:
    stops = np.array([[0.0, 0.0], [30.0, -90.0], [30.0, 0.0]])
    time, q = through(stops, 10.0, 50.0)
    assert time[-1] == pytest.approx(9.5 + 9.5 + DWELL_S, abs=0.05)  # a ramp of 0.5 s each way costs half of itself
    rate = np.abs(np.diff(q, axis=0)) * 50.0
    assert rate.max() == pytest.approx(10.0, abs=1e-6) and rate[:, 0].max() == pytest.approx(10.0 / 3.0, abs=1e-6)
    corner = int(np.argmin(q[:, 1]))
    assert q[corner] == pytest.approx(stops[1], abs=1e-9) and q[-1] == pytest.approx(stops[2], abs=1e-9)
    assert rate[[0, corner - 1, corner, -1]].max() < 0.2  # at rest at every stop
    assert np.abs(np.diff(rate, axis=0)).max() * 50.0 < 1.51 * 10.0 / 0.5  # acceleration of the smooth ramp


@pytest.mark.parametrize("short", [0.004, 0.01, 0.05])
def test_a_row_just_before_a_stop_is_the_stop(short: float) -> None:
    """A step from there to the stop is no block of a program, and at 10 Hz its 0.1 s were those of the next block: 0.04°."""
    whole = 3.0 + short  # s, of which a smooth start and stop cost half a second
    _, q = through(np.array([[0.0], [20.0 * (whole - 0.5)], [0.0]]), 20.0, 10.0)
    steps = np.abs(np.diff(q[:, 0]))
    assert steps[: -round(DWELL_S * 10.0)].min() > 1e-4
    assert q[:, 0].max() == 20.0 * (whole - 0.5)


@pytest.mark.parametrize(
    ("instrument", "play"),
    [("ball_bar", False), pytest.param("r_test", False, marks=pytest.mark.slow), ("r_test", True)],
)
def test_sweeps_computed_together_are_those_computed_alone(instrument: str, play: bool) -> None:
    """Between two sweeps computed together the axes jump: neither drives, noise nor a play may remember the one before."""
    machine = preset(MACHINE)
    if play:
        machine = replace(machine, effects=(*machine.effects, EffectEntry(effect="backlash", axis="C")))
    space = make_space(machine, instrument)
    setup, noise = (space.lower + space.upper)[space.poses :] / 2.0, Noise(0.3, 0.3, 1.0)
    alone, together = (Sweeps(space, setup, max(space.lengths), noise, 20.0) for _ in range(2))
    ends = np.round(np.random.default_rng(0).uniform(alone.low, alone.high, (60, 2, len(alone.low))), 2)
    pairs = [(before, after) for before, after in ends]
    found = together.all_between(pairs, SPEED)
    assert 10 < sum(sweep is not None for sweep in found) < len(pairs)
    for pair, sweep in zip(pairs, found, strict=True):
        one = alone.between(*pair, SPEED)
        if sweep is None or one is None:
            assert sweep is one
            continue
        sizes = np.sqrt(np.diag(one.matrix)) + 1e-300
        assert sweep.seconds == one.seconds
        assert sweep.matrix / np.outer(sizes, sizes) == pytest.approx(one.matrix / np.outer(sizes, sizes), abs=1e-6)


def test_plan_keeps_the_minutes_and_states_certificate_and_gain(made: SweepPlan) -> None:
    assert MINUTES - 0.3 < made.minutes <= MINUTES + 0.01
    assert made.certificate is not None
    assert 0.9 < made.certificate.efficiency <= 1.0
    assert "searched over a dense set" in made.certificate.says and "same recording time" in made.certificate.says
    assert made.at_rest > 1.5
    turned = [np.abs(b - a).max() for a, b in itertools.pairwise(made.stops[0])]
    assert min(turned) >= 2.0 * SPEED  # two correlation times
    both_ways = {(bool(s > 0)) for s in np.diff(made.stops[0][:, -1]) if s}
    assert both_ways == {True, False}


@pytest.fixture
def shipped(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, size in SHIPPED.items():
        monkeypatch.setattr(_sweep_search, name, size)


@pytest.mark.slow
def test_the_search_as_it_ships_tells_more(made: SweepPlan, shipped: None) -> None:
    fine = _plan()
    assert fine.value < made.value
    assert fine.certificate is not None and made.certificate is not None
    assert fine.certificate.efficiency > 0.9 and fine.certificate.bound <= made.certificate.bound


def test_bar_keeps_its_length_and_swings_while_the_table_turns(bar: SweepPlan) -> None:
    machine, run = preset(MACHINE), bar.campaign.runs[0]
    assert bar.axes == ("B", "C", "bar azimuth", "bar elevation") and run.length in machine.workspace.bar_lengths
    way = Nominal(machine).ball(run.commands, run.tool_ball) - np.asarray(run.table_ball)
    assert np.linalg.norm(way, axis=1) == pytest.approx(run.length, abs=1e-5)
    sine = np.sin(np.radians(bar.stops[0][:, 3]))
    assert way[0, 2] / run.length == pytest.approx(sine[0], abs=1e-6)
    assert way[-1, 2] / run.length == pytest.approx(sine[-1], abs=1e-6)
    both = [np.abs(b - a) > 10.0 for a, b in itertools.pairwise(bar.stops[0])]
    assert any(turned[:2].any() and turned[2:].any() for turned in both)


def test_plan_of_a_bar_keeps_the_minutes_and_states_certificate_and_gain(bar: SweepPlan) -> None:
    assert MINUTES - 0.8 < bar.minutes <= MINUTES - 0.5 + 0.01
    assert bar.certificate is not None and 0.5 < bar.certificate.efficiency < 1.0
    assert bar.at_rest > 1.5
    assert str(bar).startswith("ball bar in motion") and f"bar {bar.campaign.runs[0].length:g} mm" in str(bar)
    assert bar.to_data()["instrument"] == "ball_bar" and bar.to_data()["axes"] == list(bar.axes)


@pytest.mark.parametrize(
    ("dialects", "post"),
    [(("heidenhain",), None),
     *(pytest.param(*case, marks=pytest.mark.slow) for case in ((("linuxcnc",), None), (("iso",), Post(tool_centre=True))))],
)  # fmt: skip
def test_folder_of_a_bar_is_in_order(
    bar: SweepPlan, dialects: tuple[str, ...], post: Post | None, tmp_path: Path
) -> None:
    assert _findings(bar, tmp_path / "plan", *dialects, post=post) == []


def test_readings_beyond_the_stroke_are_refused() -> None:
    machine = preset(MACHINE)
    short = replace(machine, workspace=replace(machine.workspace, bar_stroke=0.01))
    with pytest.raises(InputError, match="bar_stroke"):
        plan_sweeps(short, instrument="ball_bar", minutes=6.5)


def test_value_is_that_of_the_assessment(made: SweepPlan, bar: SweepPlan) -> None:
    """ψ by the assessment of the finished plan is what the search computed, and half of the recording has more. The search counts
    on no reading at the beginning, which tells of a bar where its balls stand, and of a nest nothing: its place is not known."""
    for plan, first in ((made, 0.01), (bar, 0.03)):
        assert plan.value - first < _size(plan.assessment) < plan.value + 0.01
        run = plan.campaign.runs[0]
        half = Campaign(machine=plan.campaign.machine, runs=(run.part(0, run.rows // 2),))
        assert _size(assess(half, effects=plan.effects, noise=plan.noise)) > plan.value + 0.1


def _size(found: Assessment) -> float:
    """ψ of D of all errors of the machine."""
    place = [i for i, p in enumerate(found.parameters) if p.kind not in ("setup", "effect")]
    scale = np.array([found.parameters[i].sigma for i in place])
    return float(np.linalg.slogdet(found.covariance[np.ix_(place, place)] / np.outer(scale, scale))[1]) / len(place)


def test_reading_faster_promises_hardly_more(made: SweepPlan) -> None:
    """White noise halves with four times the rows; slow noise does not."""
    run = made.campaign.runs[0]
    few = replace(run, time=run.time[::4], commands={name: q[::4] for name, q in run.commands.items()})
    both = [Campaign(machine=preset(MACHINE), runs=(each,)) for each in (few, run)]

    def gain(noise: Noise) -> float:
        fewer, every = (assess(campaign, effects=made.effects, noise=noise).sigma["EC0X"] for campaign in both)
        return fewer / every

    assert gain(Noise(0.3)) == pytest.approx(2.0, abs=0.1)
    assert gain(Noise(0.3, 0.3, 1.0)) < 1.4


def test_folder_is_in_order_and_its_programs_reach_every_stop(folder: Path, made: SweepPlan) -> None:
    assert [str(finding) for finding in check(folder)] == []
    data = json.loads((folder / "plan.json").read_text())
    assert data["certificate"]["efficiency"] == pytest.approx(made.certificate.efficiency, rel=1e-5)
    (recording,) = data["recordings"]
    assert recording["run"] == "sweeps" and recording["stops_deg"] == made.stops[0].tolist()
    assert {e["effect"] for e in data["effects"]} == {"latency", "servo_mismatch"}
    sheet = (folder / "setup.html").read_text()
    assert "efficiency" in sheet
    assert "Start the recording there" in sheet
    assert read_campaign(folder).runs[0].rows == made.campaign.runs[0].rows


def test_one_block_of_the_control_is_checked_along_its_way(made: SweepPlan, tmp_path: Path) -> None:
    """Under tool-centre control a whole sweep may be one block, along which no axis moves straight."""
    assert _findings(made, tmp_path / "centred", "iso", post=Post(tool_centre=True)) == []
    blocks = (tmp_path / "centred" / "nc" / "iso" / "sweeps.nc").read_text().splitlines()
    assert len(blocks) < made.campaign.runs[0].rows


def test_out_and_back_on_one_way_is_programmed_up_to_its_turn(made: SweepPlan) -> None:
    """A block from the row before the turn to the one after would lead nowhere, and its time went to the next one."""
    run, start, turn = made.campaign.runs[0], np.zeros(2), np.array([20.0, 60.0])
    time, q = through(np.stack([start, turn, start]), SPEED, 50.0)
    turned = dict(zip(made.axes, q.T, strict=True))
    commands = Nominal(preset(MACHINE)).follow(
        np.tile(run.table_ball, (len(q), 1)), run.tool_ball, turned, "out and back"
    )
    back = replace(run, time=time, commands=commands)
    text = program(preset(MACHINE), back, "linuxcnc")
    words = " ".join(f"{name}{value:.5f}" for name, value in sorted(zip(made.axes, turn, strict=True)))
    assert words in text


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"minutes": 5.0}, "no time beside the mounting"),
        ({"instrument": "touch_probe"}, "sweeps with touch_probe"),
        ({"speeds": (0.0,)}, "below 0.1 °/s"),
        ({"speeds": (10.0, 0.001)}, "below 0.1 °/s"),
        ({"correlation_s": 0.0}, "noise"),
        ({"speeds": (5000.0,)}, "no sweep"),
        ({"instrument": "ball_bar", "lengths": (2000.0,)}, "no pose can be reached"),
    ],
)
def test_what_cannot_be_planned_is_refused(options: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        plan_sweeps(MACHINE, **options)


def test_another_mounting_is_taken_where_it_pays(twice: SweepPlan, made: SweepPlan) -> None:
    first, second = twice.campaign.runs
    assert (first.id, second.id) == ("sweeps-1", "sweeps-2") and first.table_ball != second.table_ball
    assert first.duration == pytest.approx(second.duration, abs=5.0) and twice.minutes <= 2.0 * MINUTES - 1.5 + 0.01
    assert {effect.id for effect in twice.effects} == {"servo_mismatch"} and first.clock_sigma_ms > 0.0
    assert twice.certificate is not None and 0.9 < twice.certificate.efficiency <= 1.0
    share = np.sqrt(first.duration / (60.0 * (twice.minutes - 5.0)))  # of the noise of one mounting, read all the time
    quiet = replace(first, noise_um=0.3 * share)
    slow = Noise(0.3 * share, 0.3 * share, 1.0, 0.3 * share)
    alone = assess(Campaign(machine=twice.campaign.machine, runs=(quiet,)), effects=twice.effects, noise=slow)
    errors = [p for p in alone.parameters if not p.name.startswith(("setup.", "servo_mismatch."))]
    both, one = (np.mean([(f.sigma[p.name] / p.sigma) ** 2 for p in errors]) for f in (twice.assessment, alone))
    assert np.log(both) == pytest.approx(twice.value, abs=0.05) and both < one
    assert len(made.campaign.runs) == 1  # two minutes hold no further mounting


@pytest.mark.slow
def test_fewer_mountings_are_searched_where_whole_sweeps_do_not_fill_more(shipped: None) -> None:
    """In 18 s each, two mountings are better by optimal seconds; whole sweeps of a bar come to far less there than in one."""
    bar: dict[str, Any] = {"instrument": "ball_bar", "minutes": 10.6, "criterion": "A"}
    free, alone = _plan(**bar), _plan(**bar, setups=1, certify=False)
    assert len(free.campaign.runs) == 1 and free.value == pytest.approx(alone.value, abs=1e-9)
    assert free.certificate is not None and free.certificate.efficiency > 0.9


def test_two_mountings_are_in_order(twice: SweepPlan, tmp_path: Path) -> None:
    assert _findings(twice, tmp_path / "twice", "linuxcnc") == []
    assert sorted(path.stem for path in (tmp_path / "twice" / "nc" / "linuxcnc").iterdir()) == ["sweeps-1", "sweeps-2"]


@pytest.mark.slow
def test_two_mountings_are_identified(twice: SweepPlan, tmp_path: Path) -> None:
    """Each recording has a delay of its own, 5 ms (1σ)."""
    assert _findings(twice, tmp_path / "twice", "heidenhain") == []
    _compare_with_the_plant(tmp_path / "twice", twice)


def test_a_recording_adds_to_what_is_known(made: SweepPlan) -> None:
    """A second recording tells more than the first one made again, and as much as the search expects."""
    second = _plan(given=made.campaign, certify=False)
    known = Campaign(machine=preset(MACHINE), runs=(replace(made.campaign.runs[0], clock_sigma_ms=10.0),))
    again = _size(assess(known, effects=second.effects, noise=second.noise, given=known))
    assert second.campaign.runs[0].clock_sigma_ms > 0.0 and again < made.value - 0.2
    assert _size(second.assessment) < again - 0.01
    assert second.value - 0.01 < _size(assess(second.campaign, effects=second.effects, noise=second.noise, given=known))


def test_command_line_reads_bars_setups_and_what_is_known_and_refuses_options_of_poses(
    tmp_path: Path, capsys: Any
) -> None:
    words = ["plan", MACHINE, "-o", str(tmp_path / "p"), "--in-motion", "--instrument", "ball_bar"]
    refused = {
        "--bar 5": "balls touch",
        "--setups 0": "setups",
        "--given nowhere": "nowhere",
        "--points 20": "has no use",
    }
    for option, says in refused.items():
        assert main([*words, *option.split()]) == 2 and says in capsys.readouterr().err


def test_plant_is_identified_within_the_stated_uncertainty(folder: Path, made: SweepPlan) -> None:
    _compare_with_the_plant(folder, made)


@pytest.mark.slow
def test_plant_read_by_a_bar_is_identified_within_the_stated_uncertainty(shipped: None, tmp_path: Path) -> None:
    bar = _plan(MINUTES - 0.5, instrument="ball_bar")
    bar.write(tmp_path / "bar", nc=())
    _compare_with_the_plant(tmp_path / "bar", bar)
    assert "latency.delay_ms" in _identified(tmp_path / "bar", tmp_path)[0]


def _identified(plan: Path, target: Path) -> tuple[dict[str, Any], dict[str, float]]:
    """The parameters that the command line finds with the effects of a plan, and the truth of those readings."""
    campaign, truth = measured(plan, 1)
    (target / "measured").mkdir()
    write_campaign_files(campaign, target / "measured")
    options = ["--effects", str(plan / "plan.json"), "--no-figures", "--quiet"]
    assert main(["identify", str(target / "measured"), "-o", str(target / "r"), *options]) == 0
    return json.loads((target / "r" / "identification.json").read_text())["parameters"], truth


def _compare_with_the_plant(folder: Path, made: SweepPlan) -> None:
    """χ² of all errors of the machine by their joint covariance, over some machines; and what the plan promised, on average: of
    one machine the noise that is found varies."""
    distance, size, promised = 0.0, 0, []
    for seed in range(DRAWN):
        campaign, truth = measured(folder, seed)
        found = identify(campaign, effects=made.effects)
        place = [found.model.index[name] for name in truth]
        off = np.array([found[name] - value for name, value in truth.items()])
        distance += float(off @ np.linalg.solve(found.covariance[np.ix_(place, place)], off))
        size += len(off)
        promised.append([found.uncertainty(name) / made.assessment.sigma[name] for name in truth])
    assert chi2(size).cdf(distance) == pytest.approx(0.5, abs=0.499)
    assert np.mean(promised, axis=0) == pytest.approx(1.0, abs=0.2)


def test_without_lag_the_geometry_is_wrong(folder: Path, made: SweepPlan) -> None:
    campaign, truth = measured(folder, 0)
    blind, seeing = identify(campaign), identify(campaign, effects=made.effects)
    off = [max(abs(found[n] - v) / made.assessment.sigma[n] for n, v in truth.items()) for found in (blind, seeing)]
    assert off[0] > 10.0 * off[1]


def test_command_line_frees_the_effects_of_the_plan(folder: Path, tmp_path: Path) -> None:
    found, truth = _identified(folder, tmp_path)
    assert "latency.delay_ms" in found
    off = [(found[name]["value"] - value) / found[name]["std"] for name, value in truth.items()]
    assert np.sqrt(np.mean(np.square(off))) < 2.0


def test_a_refused_speed_names_one_that_works() -> None:
    options: dict[str, Any] = {"minutes": 6.0, "setups": 1, "rate_hz": 10.0, "certify": False}
    says = r"no sweep is clear of all limits at 400 °/s and more; ([\d.]+) °/s works"
    with pytest.raises(InputError, match=says) as refused:
        plan_sweeps(MACHINE, speeds=(400.0, 800.0), **options)
    named = re.search(says, str(refused.value))
    assert named is not None
    made = plan_sweeps(MACHINE, speeds=(float(named[1]),), **options)
    assert made.speeds == (float(named[1]),) and float(named[1]) < 400.0
