"""Order of poses, bodies that may not meet, and moves around them."""

from dataclasses import replace

import numpy as np
import pytest
from lean import location_only
from scipy.spatial import cKDTree

from symfive.campaign import Run
from symfive.design import Space, make_space, plan
from symfive.machine import Machine, preset
from symfive.moves import (
    Box,
    Clearances,
    Moves,
    Rod,
    apart,
    blocked_moves,
    cleared,
    kept_apart,
    out_and_back,
    round_trip,
    there_and_back,
)
from symfive.nc import Step, program_steps
from symfive.procedures import Nominal, planar_circle, r_test_grid, static_ball_bar

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


def test_what_lies_between_two_positions_is_found() -> None:
    """A line of a tool passes the table ball (radius 6.35 mm) between two positions that are looked at, 4 mm apart."""
    machine = preset("three-axis")
    machine = replace(machine, workspace=replace(machine.workspace, spindle_nose=None), text="")
    run = planar_circle(machine, radius=50.0, centre=(0.0, 0.0, 100.0), direction="ccw")[0]
    run = replace(run, instrument=("r_test",), length=None, readings={})  # whose tool ball is no body of its own
    nominal, moves = Nominal(machine), Moves(machine, run)
    for aside, met in ((6.2, "tool and table ball"), (6.4, "")):  # the ends stand off by √(2² + 6.2²) - 6.35 = 0.16 mm
        ends = nominal.follow(np.array([[-2.0, aside, 50.0], [2.0, aside, 50.0]]), run.tool_ball, {}, "a move")
        start, end = np.stack([ends[n] for n in machine.axis_names], axis=1)
        found = moves.met(np.stack([start, start, end]), np.stack([end, start, end]), rapid=False, bar=False)
        assert found == [met, "", ""]


def test_the_tool_does_not_meet_the_tables_edge() -> None:
    """Its ball stands 5 mm beside the table, 20 mm below its plane: a tool that leans over the table passes through the edge."""
    run = r_test_grid(OYAMA, grid={"B": (0.0,), "C": (0.0,)}, nests=((0.0, 0.0, 60.0),), returning=False)[0]
    edge = (OYAMA.workspace.table_radius or 0.0) + 50.0
    clear = Clearances(OYAMA, run)
    for degree, distance in ((-45.0, -np.inf), (45.0, 5.0), (0.0, 5.0)):
        q = Nominal(OYAMA).follow(np.array([[edge + 5.0, 0.0, -20.0]]), run.tool_ball, {"B": degree}, "a pose")
        found = clear(np.stack([q[n] for n in OYAMA.axis_names], axis=1))[0][clear.names.index("tool and table")]
        assert found == pytest.approx(distance, abs=1e-3) if distance > 0.0 else found < -1.0, degree


def _apart(a: tuple[list[float], list[float], float, float], b: tuple[list[float], list[float], float, float]) -> float:
    return float(apart(*(Rod(*(np.array([part]) for part in rod[:3]), rod[3]) for rod in (a, b)))[0])


def test_a_cylinder_keeps_off_a_box_by_their_distance() -> None:
    """From below, by the nearest of many points of each."""
    rng, low, high = np.random.default_rng(5), np.array([20.0, -60.0, 0.0]), np.array([120.0, 60.0, 90.0])
    inside = rng.uniform(low, high, (20000, 3))
    surface = np.where(rng.random((20000, 3)) < 0.5, np.where(rng.random((20000, 3)) < 0.5, low, high), inside)
    seen = set()
    for radius in (0.0, 40.0):
        for _ in range(40):
            start, axis = rng.uniform(-150.0, 200.0, 3), rng.normal(size=3)
            rod = Rod(start[None], (axis / np.linalg.norm(axis))[None], rng.uniform(1.0, 200.0, 1), radius)
            (found,) = apart(rod, Box(low[None], high[None]))
            nearest = rod.nearest(surface)
            sampled = float(np.linalg.norm(nearest - surface, axis=1).min())
            assert found <= sampled + 1e-6 and sampled - max(found, 0.0) < 4.0
            seen.add(bool(found > 0.0))
    assert seen == {True, False}


def test_cylinders_keep_apart_by_their_distance() -> None:
    """Distances by hand: parallel, touching, crossed, one over the other, an edge over an edge, and one inside."""
    up, along = [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]
    still = ([0.0, 0.0, 0.0], up, 10.0, 2.0)
    for other, distance in (
        (([5.0, 0.0, 0.0], up, 10.0, 1.0), 2.0), (([5.0, 0.0, 0.0], up, 10.0, 3.0), 0.0),
        (([-9.0, 4.5, 5.0], along, 20.0, 0.0), 2.5),
        (([0.0, 0.0, 13.0], up, 4.0, 8.0), 3.0), (([5.0, 0.0, 14.0], up, 4.0, 0.0), 5.0), (([0.0, 0.0, 5.0], up, 1.0, 0.0), -2.0),
    ):  # fmt: skip
        found = _apart(still, other)
        assert found == pytest.approx(distance, abs=1e-3) if distance >= 0.0 else found <= distance + 1e-3


def test_a_distance_is_never_overstated() -> None:
    """Points of two cylinders, drawn at random: none are nearer than the distance, and some almost as near."""
    rng = np.random.default_rng(5)
    for _ in range(8):
        rods = []
        for radius in (40.0, 200.0):
            axis = rng.normal(size=3)
            rods.append((rng.uniform(-400.0, 400.0, 3), axis / np.linalg.norm(axis), rng.uniform(1.0, 300.0), radius))
        found = _apart(*rods)
        points = [_points(rng, *rod) for rod in rods]
        nearest = float(cKDTree(points[0]).query(points[1])[0].min())
        assert found <= nearest + 1e-9
        assert found >= nearest - 12.0 or found <= 0.0


def _points(rng: np.random.Generator, start: np.ndarray, axis: np.ndarray, length: float, radius: float) -> np.ndarray:
    """Points of a cylinder, most of them on its rims, mantle and ends."""
    n = 8000
    u = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    u /= np.linalg.norm(u)
    share, angle = np.clip(rng.uniform(-0.5, 1.5, n), 0.0, 1.0), rng.uniform(0.0, 2.0 * np.pi, n)
    size = radius * np.sqrt(np.clip(rng.uniform(0.0, 2.0, n), 0.0, 1.0))
    across = np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * np.cross(axis, u)
    return np.asarray(start + share[:, None] * length * axis + size[:, None] * across)
