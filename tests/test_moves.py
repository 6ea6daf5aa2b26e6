"""Order of poses, bodies that may not meet, and moves around them."""

from dataclasses import replace

import numpy as np
import pytest
from lean import location_only

from symfive.campaign import Run
from symfive.design import Space, make_space, plan
from symfive.machine import Machine
from symfive.moves import Clearances, blocked_moves, cleared, kept_apart, out_and_back, round_trip, there_and_back
from symfive.nc import Step, program_steps
from symfive.procedures import r_test_grid, static_ball_bar

OYAMA = location_only("oyama-2010")


def test_orders_visit_every_pose_once() -> None:
    places = np.random.default_rng(0).random((30, 2))
    times = np.linalg.norm(places[:, None] - places[None, :], axis=2)
    order = round_trip(times)
    assert sorted(order.tolist()) == list(range(30)) == sorted(there_and_back(order).tolist())
    length = times[order[:-1], order[1:]].sum()
    assert length < 0.5 * np.mean(
        [times[p[:-1], p[1:]].sum() for p in (np.random.default_rng(i).permutation(30) for i in range(20))]
    )


def _low_ball() -> Machine:
    return replace(OYAMA, workspace=replace(OYAMA.workspace, ball_height=(40.0, 160.0)), text="")


def _set_up(space: Space, height: float) -> list[float]:
    return [0.5, 0.0, height / 100.0, 1.5]


def test_a_pose_whose_nose_would_meet_the_table_is_refused() -> None:
    """At B = 90° the nose (radius 40 mm) lies beside the table: its lower edge is 40 mm under the ball."""
    space = make_space(_low_ball(), "r_test")
    z = np.array(
        [[np.radians(b), 0.0, *_set_up(space, height)] for b, height in ((0.0, 45.0), (90.0, 45.0), (90.0, 35.0))]
    )
    limits = space.kernel.limits(z, np.zeros((3, 1)))
    nose = [i for i, name in enumerate(space.limit_names) if name == "spindle nose and table"]
    assert (limits[:, nose].min(axis=1) >= 0.0).tolist() == [True, True, False]
    table, nest = (Clearances(OYAMA, run) for run in _two_runs())
    assert "tool and post" in table.names and "spindle nose and table" in nest.names


def test_no_pose_or_way_leans_further_than_the_nest_opens() -> None:
    """A plan stays within 40°; of a grid the pose beyond it is named, and the moves to it and from it. The tool leans as far
    as B turns the table."""
    narrow = replace(OYAMA, workspace=replace(OYAMA.workspace, nest_opening=40.0), text="")
    made = plan(narrow, points=8, setups=1)
    turned = [abs(run.commands["B"]).max() for run in made.campaign.runs]
    assert max(turned) <= 40.0 + 1e-6 and max(turned) > 35.0
    grid = {"B": (0.0, 30.0, 60.0, 20.0)}
    (run,) = r_test_grid(narrow, grid=grid, nests=((0.0, 0.0, 120.0),), returning=False)
    names = Clearances(narrow, run).names
    left = Clearances(narrow, run)(np.stack([run.commands[name] for name in narrow.axis_names], axis=1))
    assert (left[:, names.index("tool and nest")] >= 0.0).tolist() == [True, True, False, True]
    met = dict(blocked_moves(narrow, run, program_steps(narrow, run)))
    assert {met[row] for row in (2, 3)} == {"tool and nest"} and not {0, 1} & set(met)


def test_a_thick_bar_passes_the_nose_at_its_radius() -> None:
    """The bar tilts towards the spindle, 45° and more from its axis: its mantle, not its axis, must pass the nose."""
    thick = replace(OYAMA, workspace=replace(OYAMA.workspace, bar_radius=12.0), text="")
    rest = {"B": np.zeros(3), "C": np.zeros(3)}
    down = tuple((np.cos(a), 0.0, -np.sin(a)) for a in np.radians([0.0, 20.0, 40.0]))
    run = static_ball_bar(
        OYAMA, poses=rest, direction=down, table_balls=((0.0, 0.0, 120.0),), length=100.0, seconds_per_pose=60.0
    )[0]
    at_rest = np.stack([run.commands[n] for n in OYAMA.axis_names], axis=1)
    for name, least, most in (("spindle nose and bar", 6.0, 12.0), ("bar and table", 8.0, 12.0)):
        line, mantle = (
            clear(at_rest)[:, clear.names.index(name)] for clear in (Clearances(OYAMA, run), Clearances(thick, run))
        )
        assert np.all((line - mantle >= least) & (line - mantle <= most + 1e-6))


def _two_runs() -> tuple[Run, Run]:
    grid = {"B": (-60.0, 60.0), "C": (0.0, 90.0)}
    first, second = r_test_grid(OYAMA, grid=grid, nests=((80.0, 0.0, 60.0), (0.0, 0.0, 120.0)), returning=False)
    return first, second


def test_a_spindle_that_stands_lower_comes_nearer_to_what_is_in_its_way() -> None:
    """Two free poses beside a thick post; 70 mm lower the clearance is smaller."""
    machine = replace(OYAMA, workspace=replace(OYAMA.workspace, post_radius=30.0), text="")
    rest = {"B": np.array([90.0, -90.0]), "C": np.array([0.0, 0.0])}
    run = static_ball_bar(
        machine, poses=rest, direction=((0.0, 0.0, 1.0), (0.0, 0.0, 1.0)), table_balls=((60.0, 0.0, 120.0),), length=100.0,
        seconds_per_pose=60.0,
    )[0]  # fmt: skip
    clear = Clearances(machine, run)
    at_rest = np.stack([run.commands[n] for n in machine.axis_names], axis=1)
    values = clear(at_rest)
    free = [i for i, name in enumerate(clear.names) if name == "tool and post"]
    assert np.all(values[:, free] > 0.0)
    low = replace(run, commands={**run.commands, "Z": run.commands["Z"] - 70.0})
    assert clear(np.stack([low.commands[n] for n in machine.axis_names], axis=1)).min() < values.min()


@pytest.mark.slow
def test_ways_are_clear_or_led_around() -> None:
    """Every move of the programs, sampled again: approach, ways, detours over the top, retract."""
    machine = location_only("tsutsumi-2007")
    made = plan(machine, instrument="ball_bar", points=16, starts=1, anywhere=False, prove=False)
    for run in made.campaign.runs:
        assert not blocked_moves(machine, run, program_steps(machine, run, made.post))


def test_a_way_through_the_table_is_found() -> None:
    """A nest low over the table, at B = -90° and at +90°: both free, but a rapid straight between them meets the table."""
    (run,) = r_test_grid(
        OYAMA, grid={"B": (-90.0, 90.0), "C": (0.0,)}, nests=((0.0, 0.0, 60.0),), returning=False, seconds_per_pose=60.0
    )
    names = OYAMA.axis_names
    ends = [{n: float(run.commands[n][i]) for n in names} for i in range(2)]
    assert Clearances(OYAMA, run)(np.array([[e[n] for n in names] for e in ends])).min() >= 0.0
    straight = [Step(kind="feed", commands=ends[0], towards=0), Step(kind="rapid", commands=ends[1], towards=1)]
    found = blocked_moves(OYAMA, run, straight)
    assert found and found[0][0] == 1
    around = program_steps(OYAMA, run, cleared(OYAMA, (run,), {run.id: (1,)}))
    assert not blocked_moves(OYAMA, run, around)
    named = [set(step.positions) for step in around if step.kind == "rapid"]
    assert named == [{"B", "C"}, {"X", "Y"}, {"Z"}, {"Z"}, {"B"}, {"X"}, {"Z"}, {"B"}]


def test_no_pose_follows_itself_and_the_ends_stay() -> None:
    order, pose = np.array([0, 1, 2, 3, 4, 5, 0]), np.array([0, 1, 1, 2, 3, 3])
    times = np.abs(np.arange(6.0)[:, None] - np.arange(6.0))
    apart = kept_apart(order, pose, times)
    assert sorted(apart.tolist()) == sorted(order.tolist()) and apart[0] == apart[-1] == 0
    assert np.all(np.diff(pose[apart]) != 0)
    assert kept_apart(np.array([0, 1, 2]), np.zeros(3, dtype=int), times).tolist() == [0, 1, 2], "nothing else to go to"
    assert out_and_back(np.arange(3), 9).tolist() == [0, 1, 0, 2, 0]
