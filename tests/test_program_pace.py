"""Pace of a program's moves: no axis faster than promised, and as long as the campaign's file says."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from lean import location_only

from symfive.campaign import Run
from symfive.machine import Machine
from symfive.moves import cleared
from symfive.nc import CAUTION, Post, arrival_times, pace, program_steps
from symfive.nc._pace import spread  # a closed form that programs only round
from symfive.procedures import r_test_grid, static_ball_bar

OYAMA, TABLE = location_only("oyama-2010"), location_only("table-bc")


@pytest.mark.parametrize("seconds", [0.1, 5.0, 6.0, 60.0])
def test_a_slower_pace_takes_the_time_it_is_given(seconds: float) -> None:
    """Blocks that are slower than they could be need less time to get up to speed: the rest was lost to nobody."""
    path = np.zeros((5, len(TABLE.axis_names)))
    path[:, TABLE.axis_names.index("X")] = np.linspace(0.0, 100.0, 5)
    least, more = pace(TABLE, path)
    whole, rest = spread(least, more, seconds)
    assert whole + rest == pytest.approx(max(seconds, least + more), rel=1e-12)
    speed = 100.0 / whole
    assert rest == pytest.approx(speed / (CAUTION * (TABLE.axes["X"].max_acceleration or 0.0)), rel=1e-9)


def test_the_pace_of_one_straight_move_is_that_from_rest_to_rest() -> None:
    axis = TABLE.axes["X"]
    speed, push = CAUTION * (axis.max_feed or 0.0) / 60.0, CAUTION * (axis.max_acceleration or 0.0)
    for way in (1.0, 5.0, 200.0):
        path = np.zeros((2, len(TABLE.axis_names)))
        path[1, TABLE.axis_names.index("X")] = way
        expected = 2.0 * np.sqrt(way / push) if way < speed**2 / push else way / speed + speed / push
        assert sum(pace(TABLE, path)) == pytest.approx(expected, rel=1e-12)
    assert pace(TABLE, np.zeros((2, len(TABLE.axis_names)))) == (0.0, 0.0)


def test_the_program_takes_the_time_that_its_file_says() -> None:
    """A way around that takes less time than a pose is given waits at the pose."""
    run = r_test_grid(OYAMA, grid={"B": (-90.0, 90.0), "C": (0.0,)}, nests=((0.0, 0.0, 60.0),), returning=False)[0]
    post = cleared(OYAMA, (run,), {run.id: (1,)})
    slow = replace(run, time=arrival_times(OYAMA, run, post, 200.0))
    steps = program_steps(OYAMA, slow, post)
    dwells = [i for i, step in enumerate(steps) if step.kind == "dwell"]
    assert sum(step.seconds for step in steps[dwells[0] + 1 : dwells[-1] + 1]) == pytest.approx(200.0, abs=0.11)


def _shares(machine: Machine, run: Run, post: Post) -> np.ndarray:
    """Of every feed block and axis: its speed as a share of the greatest feed."""
    found, before = [], dict.fromkeys(machine.axis_names, np.nan)
    feeds = [machine.axes[n].max_feed or np.inf for n in machine.axis_names]
    for step in program_steps(machine, run, post):
        if step.kind == "feed":
            found.append([abs(step.commands[n] - before[n]) / step.seconds * 60.0 for n in machine.axis_names])
        before = {**before, **step.commands}
    return np.nan_to_num(np.array(found) / feeds)


@pytest.mark.parametrize("hurried", [1.0, 0.1])
def test_no_block_asks_for_more_than_half_an_axis_greatest_feed(hurried: float) -> None:
    """Linear axes that follow a turning table go farther than the difference of the end points."""
    rows = {"B": np.array([0.0, 60.0, -60.0, 0.0]), "C": np.array([0.0, 180.0, 360.0, 20.0])}
    (run,) = static_ball_bar(TABLE, poses=rows, table_balls=((120.0, 0.0, 120.0),), length=100.0, seconds_per_pose=60.0)
    quick = replace(run, time=run.time * hurried / 20.0)
    shares = _shares(TABLE, quick, Post())
    assert 0.49 < shares.max() <= CAUTION * (1.0 + 1e-9)
    straight = np.abs(np.diff(np.stack([run.commands[n] for n in TABLE.axis_names]), axis=1)).max(axis=1)
    travelled = np.zeros(len(straight))
    seated = [step for step in program_steps(TABLE, quick) if step.seated and step.kind == "feed"]
    for a, b in itertools.pairwise(seated):
        travelled += [abs(b.commands[n] - a.commands[n]) for n in TABLE.axis_names]
    assert (travelled > 2.0 * straight).any(), "the case that differences of end points do not see"


def test_feeds_hold_on_the_path_that_the_control_makes() -> None:
    """Under tool-centre control one block leads to a pose, and the linear axes follow by themselves."""
    run = r_test_grid(OYAMA, grid={"B": (0.0,), "C": (0.0, 180.0)}, nests=((100.0, 0.0, 80.0),), returning=False)[0]
    quick = replace(run, time=run.time / 1e3)
    steps = program_steps(OYAMA, quick, Post(tool_centre_on="TRAORI", tool_centre_off="TRAFOOF"))
    (move,) = (step for step in steps if step.row == 1 and step.kind == "feed")
    angular = np.pi / move.seconds  # rad/s of C: the ball 100 mm off the axis goes so fast in X and in Y
    fastest = min(OYAMA.axes[n].max_feed or np.inf for n in "XY")
    assert 60.0 * angular * 100.0 <= CAUTION * fastest * (1.0 + 1e-3)
    assert np.degrees(angular) * 60.0 <= CAUTION * (OYAMA.axes["C"].max_feed or np.inf) * (1.0 + 1e-9)
