"""Procedures: nobody types poses, every pose stands where it should, and every axis can do it."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from symfive.campaign import Run, read_campaign, write_campaign
from symfive.errors import InputError
from symfive.machine import preset, presets
from symfive.model import Model
from symfive.procedures import (
    Nominal,
    campaign_of,
    checked,
    cone_circle,
    followed,
    linear_positioning,
    planar_circle,
    r_test_grid,
    rotary_circle,
    serpentine,
    static_ball_bar,
    synchronous_circle,
)

SHARED = Path(__file__).parent / "data" / "campaigns"
PROCEDURES = {
    r_test_grid: ("r_test",), static_ball_bar: ("ball_bar",), rotary_circle: ("ball_bar",), synchronous_circle: ("ball_bar",),
    cone_circle: ("ball_bar",), planar_circle: ("ball_bar",), linear_positioning: ("laser",),
}  # fmt: skip
"""Each procedure and the instrument of its runs."""
LACKING = [("three-axis", r_test_grid), ("three-axis", static_ball_bar), ("three-axis", rotary_circle),
           ("three-axis", synchronous_circle), ("three-axis", cone_circle), ("head-bc", synchronous_circle)]  # fmt: skip
"""Machines without the axes for a procedure."""
PAIRS = [(name, procedure) for name in presets() for procedure in PROCEDURES if (name, procedure) not in LACKING]


def named(value) -> str:
    return getattr(value, "__name__", str(value))


def offset_of(machine, run):
    """From the table ball to the nominal tool ball, workpiece frame, (N, 3) mm."""
    return Nominal(machine).ball(run.commands, run.tool_ball) - run.table_ball


@pytest.mark.parametrize(("name", "procedure"), PAIRS, ids=named)
def test_defaults_suit_every_machine(name, procedure):
    machine = preset(name)
    campaign = campaign_of(machine, procedure(machine), named(procedure))
    assert not campaign.measured
    clock = 0.0
    for run in campaign.runs:
        assert run.start_s >= clock and set(run.commands) == set(machine.axes)
        clock = run.start_s + run.duration
        assert run.instrument == PROCEDURES[procedure]
        for axis in machine.axes.values():
            values = run.commands[axis.name]
            assert axis.travel[0] <= values.min() and values.max() <= axis.travel[1]
            if run.dynamic:
                assert np.abs(np.diff(values) / np.diff(run.time)).max() * 60 <= axis.max_feed
                steady = np.abs(np.diff(values)).max()
                # half of the acceleration within a row
                at_first = 0.75 * steady if procedure is planar_circle else 1e-3
                assert abs(values[1] - values[0]) <= at_first  # it starts from rest
        if run.instrument == ("r_test",):
            assert np.abs(offset_of(machine, run)).max() < 1e-9
        if run.instrument == ("ball_bar",):
            assert np.abs(np.linalg.norm(offset_of(machine, run), axis=1) - run.length).max() < 1e-9


@pytest.mark.parametrize("procedure", PROCEDURES, ids=named)
def test_plans_are_written_and_read(procedure, tmp_path):
    machine = preset("table-bc")
    plan = campaign_of(machine, procedure(machine), named(procedure))
    write_campaign(plan, tmp_path / "plan")
    again = read_campaign(tmp_path / "plan")
    assert [run.id for run in again.runs] == [run.id for run in plan.runs] and again.name == named(procedure)
    assert all(np.array_equal(a.commands["Z"], b.commands["Z"]) for a, b in zip(again.runs, plan.runs, strict=True))
    assert Model(again).predict_run(again.runs[0], Model(again).start).shape[0] == plan.runs[0].rows


@pytest.mark.parametrize(("name", "procedure"), LACKING, ids=named)
def test_a_machine_without_the_axes_is_named(name, procedure):
    with pytest.raises(InputError) as caught:
        procedure(preset(name))
    assert caught.value.remedy


def test_r_test_grid_is_the_shared_one():
    shared = read_campaign(SHARED / "static-none" / "fit")
    runs = r_test_grid(shared.machine, nests=[run.table_ball for run in shared.runs], tool_ball=(0.0, 0.0, -150.0))
    for ours, theirs in zip(runs, shared.runs, strict=True):
        assert np.array_equal(ours.time, theirs.time)
        for name in shared.machine.axes:
            assert np.abs(ours.commands[name] - theirs.commands[name]).max() < 6e-8  # seven decimals in the file


def test_static_ball_bar_is_the_shared_one():
    shared = read_campaign(SHARED / "static-ball-bar-two-heights" / "fit")
    runs = static_ball_bar(
        shared.machine,
        direction=(1.0, 0.0, 0.0),
        table_balls=[r.table_ball for r in shared.runs],
        tool_ball=(0, 0, -150),
    )
    for ours, theirs in zip(runs, shared.runs, strict=True):
        assert ours.length == theirs.length == 100.0
        for name in shared.machine.axes:
            assert np.abs(ours.commands[name] - theirs.commands[name]).max() < 6e-8


@pytest.mark.parametrize("name", ["nutating-table", "head-bc", "mixed-bc", "tsutsumi-2007"])
def test_r_test_on_any_topology(name):
    machine = preset(name)
    tilt, turn = {"tsutsumi-2007": ("A", "C"), "nutating-table": ("B", "C")}.get(name, ("B", "C"))
    run = r_test_grid(machine)[0]
    assert run.rows == 2 * 7 * 12
    poses = {(b, c) for b, c in zip(run.commands[tilt], run.commands[turn], strict=True)}
    assert len(poses) == 84
    assert np.abs(offset_of(machine, run)).max() < 1e-9
    steps = [np.abs(np.diff(run.commands[n])) for n in (tilt, turn)]
    assert np.all((steps[0] < 1e-9) | (steps[1] < 1e-9))  # one rotary axis at a time


def test_serpentine():
    poses = serpentine({"A": [0, 1], "B": [0, 1], "C": [0, 1, 2]}, returning=True)
    rows = list(zip(*(v.tolist() for v in poses.values()), strict=True))
    assert len(rows) == 24 and rows[:12] == rows[:11:-1]
    assert len(set(rows)) == 12
    assert all(sum(abs(x - y) for x, y in zip(a, b, strict=True)) <= 1 for a, b in pairwise(rows))
    with pytest.raises(InputError):
        serpentine({"A": []})


def test_ball_bar_along_given_directions():
    machine = preset("table-bc")
    directions = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 1.0, 1.0]])
    poses = {"B": [0.0, 30.0, -30.0], "C": [10.0, 20.0, 30.0]}
    run = static_ball_bar(machine, poses=poses, direction=directions, table_balls=[(40.0, 0.0, 60.0)], length=100.0)[0]
    bar = np.einsum("nij,nj->ni", Nominal(machine).workpiece_rotation(run.commands), offset_of(machine, run))
    assert bar == pytest.approx(100.0 * directions / np.linalg.norm(directions, axis=1)[:, None], abs=1e-9)


@pytest.mark.parametrize(
    ("make", "options", "said"),
    [(r_test_grid, {"nests": [(500.0, 0.0, 50.0)]}, "travel"),
     (r_test_grid, {"seconds_per_pose": 0.2}, "seconds_per_pose"),
        (r_test_grid, {"seconds_per_pose": 0.0}, "increase"),
     (r_test_grid, {"grid": {"B": [-120.0]}}, "travel"),
     (r_test_grid, {"grid": {"Q": [0.0]}}, "no axis Q"),
     (r_test_grid, {"grid": {"B": [0.0], "X": [0.0]}}, "miss"),
     (static_ball_bar, {"poses": {"B": [0.0], "C": [0.0, 1.0]}}, "number"),
     (static_ball_bar, {"direction": (0.0, 0.0, 0.0)}, "no length"),
     (static_ball_bar, {"length": -5.0}, "length"),
     (planar_circle, {"plane": "XC"}, "plane"),
     (planar_circle, {"instrument": "laser"}, "laser"),
     (planar_circle, {"radius": 0.0}, "radius"),
     (planar_circle, {"radius": 290.0}, "travel"),
     (planar_circle, {"feed": 14000.0, "radius": 10.0, "rate_hz": 500.0}, "accelerate"),
     (planar_circle, {"feed": 29000.0}, "lower the feed"),
     (planar_circle, {"feed": 40000.0}, "X would move at .* its limit is 15000"),
     (planar_circle, {"feed": 6000.0, "rate_hz": 5.0}, "sample rate"),
     (planar_circle, {"rate_hz": 1e7}, "rows"),
     (synchronous_circle, {"linear": "Z"}, "square"),
     (synchronous_circle, {"x_t": float("inf")}, "centre"),
     (linear_positioning, {"axis": "C"}, "linear axis"),
     (linear_positioning, {"targets": [0.0, -1.0]}, "ascend"),
     (linear_positioning, {"targets": [-299.0, 0.0, 299.0]}, "travel")],
)  # fmt: skip
def test_impossible_plans(make, options, said):
    with pytest.raises(InputError, match=said) as caught:
        make(preset("table-bc"), **options)
    assert caught.value.remedy and "\n" not in str(caught.value)


def test_laser_targets_after_iso_230_2():
    machine = preset("table-bc")
    run = linear_positioning(machine, axis="Z", cycles=5)[0]
    z = run.commands["Z"]
    low, high = machine.axes["Z"].travel
    stops = sorted(set(z))[1:-1]
    assert len(stops) >= 5 and len(stops) / (high - low) >= 5 / 1000
    gaps = np.diff(stops)
    assert gaps.min() > 0.3 * gaps.max() and np.ptp(gaps) > 1.0  # uneven, but everywhere
    before = np.sign(np.diff(z))
    for stop in stops:
        sides = before[np.flatnonzero(z[1:] == stop)]
        assert (sides > 0).sum() == 5 and (sides < 0).sum() == 5
    assert run.options["axis"] == "Z" and np.ptp(run.commands["X"]) == 0.0


@pytest.mark.parametrize(
    ("span", "seconds", "reason"),
    [(100.0, 2.0, ""), (100.0, 0.5, "would move"), (10.0, 0.15, "would accelerate"), (400.0, 20.0, "would go")],
)
def test_rows_that_axes_follow_are_all_of_a_run_that_is_not_refused(span: float, seconds: float, reason: str) -> None:
    """X to and fro in half a sine, and a rest; a row is refused by the two steps before it, not by what comes later."""
    machine, time = preset("table-bc"), np.arange(0.0, 1.5 * seconds, seconds / 200.0)
    x = np.where(time < seconds, span * np.sin(np.pi * np.minimum(time / seconds, 1.0)) ** 2, 0.0)
    commands = {name: x if name == "X" else np.zeros_like(x) for name in machine.axis_names}
    run = Run(id="x", instrument=("r_test",), sampling="dynamic", time=time, commands=commands)
    found = followed(machine, run)
    assert found.all() == (not reason) and found[-20:].all()
    if reason:
        with pytest.raises(InputError, match=reason):
            checked(machine, run, place="the span")
    else:
        assert checked(machine, run, place="the span") is run
