"""Ways of a plan's programs: every pose can be left, no rapid meets anything, no axis is faster than promised."""

import itertools
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from lean import location_only
from scipy.spatial import cKDTree

from symfive.campaign import Run
from symfive.design import Plan, plan
from symfive.design._candidates import pose_grid  # whole plans take seconds
from symfive.design._reach import Reach  # as above
from symfive.design._space import make_space  # as above
from symfive.errors import InputError
from symfive.machine import Machine, preset
from symfive.moves import Clearances, Moves, Rod, Ways, apart, blocked_moves, cleared, least_elevation
from symfive.nc import CAUTION, Post, Step, arrival_times, pace, program, program_steps, top_of
from symfive.nc._pace import spread  # a closed form that programs only round
from symfive.procedures import Nominal, planar_circle, r_test_grid, static_ball_bar


def _with_travel(machine: Machine, axis: str, low: float, high: float) -> Machine:
    return replace(machine, axes={**machine.axes, axis: replace(machine.axes[axis], travel=(low, high))})


OYAMA, TABLE = location_only("oyama-2010"), location_only("table-bc")


def _plan(machine: Machine, **options: Any) -> Plan:
    return plan(machine, **{"setups": 1, "starts": 1, "anywhere": False, "prove": False, **options})


def _grid(b: tuple[float, ...], c: tuple[float, ...] = (0.0,), nest: tuple[float, ...] = (0.0, 0.0, 60.0)) -> Run:
    return r_test_grid(OYAMA, grid={"B": b, "C": c}, nests=(nest,), returning=False)[0]


@pytest.fixture(scope="module")
def made() -> Plan:
    """A ball-bar plan whose table tilts beyond 90°, where a rapid straight down would meet the table's side."""
    return _plan(TABLE, instrument="ball_bar", points=8)


@pytest.fixture(scope="module")
def hurried() -> Plan:
    """Ten R-test poses within a time that one set-up leaves."""
    return _plan(OYAMA, points=10, minutes=6.5)


@pytest.fixture(scope="module")
def few() -> Run:
    """The first run of a plan of four R-test poses."""
    return _plan(TABLE, points=4).campaign.runs[0]


@pytest.mark.slow
def test_every_pose_can_be_left_and_every_move_is_clear(made: Plan) -> None:
    for run in made.campaign.runs:
        ways = Ways(TABLE, run)
        assert not [row for row in range(run.rows) if isinstance(ways.out(row), str)]
        assert not blocked_moves(TABLE, run, program_steps(TABLE, run, made.post))


def test_a_pose_without_travel_to_draw_back_is_refused_not_written() -> None:
    """The tool ball in its nest at the upper end of Z: the retract shrank to nothing, and a rapid led straight to the pose."""
    run = _grid((0.0,), (0.0, 90.0), (0.0, 0.0, 100.0))
    low = _with_travel(OYAMA, "Z", -100.0, float(run.commands["Z"].max()))
    sentence = r"run r-test-1: at line 2 no travel is left to draw the tool back by 10 mm; move the ball or nest, or use another"
    with pytest.raises(InputError, match=sentence):
        program_steps(low, run, Post(unsafe={run.id: (1,)}))
    with pytest.raises(InputError, match="on every exit path from the pose of line 2; what helps"):
        cleared(low, (run,), {})


@pytest.mark.slow
def test_poses_without_a_way_out_are_replaced_or_the_plan_is_refused() -> None:
    """With Z so short the best poses stand at its upper end, from where no tool can be drawn out of a nest."""
    short = _with_travel(TABLE, "Z", -100.0, 300.0)
    made = _plan(short, points=6, returns=0)
    for run in made.campaign.runs:
        assert not blocked_moves(short, run, program_steps(short, run, made.post))
        assert run.commands["Z"].max() <= top_of(short) - 10.0
    machine = replace(TABLE, workspace=replace(TABLE.workspace, spindle_nose={"radius": 40.0, "above_ball": 60.0}))
    flat = _with_travel(_with_travel(machine, "Z", 195.0, 205.0), "B", -1.0, 1.0)
    with pytest.raises(InputError) as refused:
        plan(replace(flat, workspace=replace(flat.workspace, ball_height=(40.0, 100.0))), points=4, setups=1, starts=1)
    assert "\n" not in str(refused.value) and "no pose" in str(refused.value)


def test_no_set_up_is_offered_over_which_the_tool_cannot_go_home() -> None:
    """With Z so short a long tool at its top reaches below a high ball in the middle: every way out of that nest ends in it."""
    head = location_only("head-bc")
    tall, low = (make_space(machine, "ball_bar") for machine in (head, _with_travel(head, "Z", -100.0, 260.0)))
    over, beside = np.array([0.1, 0.0, 1.5, 1.8]), np.array([1.5, 0.0, 1.5, 1.8])
    for space, offered in ((tall, True), (low, False)):
        grid = pose_grid(space, 300)
        for setup, fits in ((over, offered), (beside, True)):
            z = np.concatenate([grid, np.tile(setup, (len(grid), 1))], axis=1)
            k = np.full((len(z), 1), 150.0)
            assert space.feasible(z, k).any() == fits
            z = z[tall.feasible(z, k) & (space.commands(z, k)["Z"] < 200.0)][:8]
            blocked = Reach(space).in_the_way(z, k[: len(z)])
            assert len(z) == 8 and all(blocked) != fits


@pytest.mark.parametrize(
    ("name", "high"), [("head-bc", {"Z": 220.0}), ("table-bc", {"Z": 300.0}), ("table-bc", {"Z": 220.0, "X": 150.0})]
)
def test_no_pose_is_offered_without_travel_to_draw_the_tool_back(name: str, high: dict[str, float]) -> None:
    """Poses in reach are left out where the program's own ways find no travel to leave them, and nowhere else."""
    tall = short = location_only(name)
    for axis, most in high.items():  # the last one is what some poses lack
        tall, short = short, _with_travel(short, axis, short.axes[axis].travel[0], most)
    space = make_space(short, "r_test")
    generator = np.random.default_rng(0)
    drawn = generator.uniform(space.lower, space.upper, (4000, len(space.lower)))
    drawn[:, space.poses :] = np.tile(drawn[:4, space.poses :], (1000, 1))  # four set-ups
    k = np.zeros((len(drawn), 1))
    drawn = drawn[make_space(tall, "r_test").feasible(drawn, k)]
    limits = space.kernel.limits(drawn, k[: len(drawn)])
    drawn_back = "travel to draw the tool back"
    place = space.limit_names.index(drawn_back)
    back, others = limits[:, place], np.delete(limits, place, axis=1).min(axis=1) >= 0.0
    offered, left_out = (np.flatnonzero(others & side)[:60] for side in (back >= 0.0, back < 0.0))
    assert len(offered) == len(left_out) == 60
    k = np.zeros((60, 1))
    assert drawn_back not in Reach(space).in_the_way(drawn[offered], k)
    assert set(Reach(space).in_the_way(drawn[left_out], k)) <= {drawn_back, "nest, from below,"}


@pytest.mark.parametrize("instrument", ["r_test", "ball_bar"])
def test_a_machine_whose_top_is_under_its_table_is_refused_at_once(instrument: str) -> None:
    """Z in machine coordinates, 0 at the top of its travel: all ways out lead through the table. The poses with the table
    tilted were tested one by one, for minutes."""
    under = _with_travel(location_only("table-bc"), "Z", -520.0, -20.0)
    with pytest.raises(InputError, match=r"no pose can be reached: .*with all axes at 0 the spindle nose stands"):
        plan(under, instrument=instrument, points=6, setups=1, starts=1)


def test_a_plan_on_a_machine_with_a_short_z_is_as_good_as_its_certificate() -> None:
    """Nothing that is chosen has to be exchanged for a pose with a way out, at whatever cost."""
    short = _with_travel(location_only("head-bc"), "Z", -200.0, 220.0)
    made = _plan(short, points=12, setups=2)
    assert made.certificate.efficiency > 0.95


def test_a_blocked_rapid_is_blamed_on_the_row_it_leads_to() -> None:
    """A rapid straight into the pose: the move that follows stands still, and the row stays with the rapid."""
    run = _grid((-90.0, 90.0))
    ends = [{n: float(q[row]) for n, q in run.commands.items()} for row in (0, 1)]
    through = {**ends[1], "Z": ends[1]["Z"] - 80.0}
    steps = program_steps(OYAMA, run, Post(unsafe={run.id: (1,)}, ways={run.id: {1: (ends[0], through, ends[1])}}))
    reached = [step for step in steps if step.row == 1 and step.kind in ("rapid", "feed")]
    assert len(reached) == 1 and reached[0].towards == 1
    assert {row for row, _ in blocked_moves(OYAMA, run, steps)} == {1}


@pytest.mark.slow
def test_a_rapid_between_known_places_moves_one_axis(made: Plan) -> None:
    """Which way several axes take together in a rapid depends on the control. A pose may be lifted to the top, where the spindle
    stands already."""
    for run in made.campaign.runs:
        before, found = {}, 0
        for step in program_steps(TABLE, run, cleared(TABLE, (run,), {run.id: (2,)})):
            assert step.kind != "rapid" or not step.seated
            if step.kind == "rapid" and before and step.commands:
                assert sum(before[name] != q for name, q in step.commands.items()) <= len(step.positions) == 1
                found += 1
            before = step.commands or ({} if step.kind == "rapid" else before)
        assert found > 4


def test_two_poses_with_a_way_out_are_joined() -> None:
    """Off the table's centre a way around was refused between poses of which each could be left."""
    machine = replace(
        TABLE, workspace=replace(TABLE.workspace, table_centre=(40.0, 30.0)), text="",
        axes={name: replace(axis, travel=axis.travel if axis.rotary or name == "Z" else (-700.0, 700.0))
              for name, axis in TABLE.axes.items()},
    )  # fmt: skip
    rng = np.random.default_rng(4)
    rows = {"B": rng.uniform(-110.0, 110.0, 24), "C": rng.uniform(-180.0, 180.0, 24)}
    (run,) = static_ball_bar(
        machine, poses=rows, table_balls=((140.0, 30.0, 120.0),), length=100.0, seconds_per_pose=60.0
    )
    ways = Ways(machine, run)
    free = [row for row in range(run.rows) if not isinstance(ways.out(row), str)]
    kept = replace(run, time=run.time[free], commands={name: q[free] for name, q in run.commands.items()})
    ways = Ways(machine, kept)
    assert 8 < len(free) < run.rows
    for row in range(1, kept.rows):
        way = ways.around(row)
        assert all(sum(a[n] != b[n] for n in a) == 1 for a, b in itertools.pairwise(way[1:-1]))


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
    run = _grid((0.0,))
    edge = (OYAMA.workspace.table_radius or 0.0) + 50.0
    clear = Clearances(OYAMA, run)
    for degree, distance in ((-45.0, -np.inf), (45.0, 5.0), (0.0, 5.0)):
        q = Nominal(OYAMA).follow(np.array([[edge + 5.0, 0.0, -20.0]]), run.tool_ball, {"B": degree}, "a pose")
        found = clear(np.stack([q[n] for n in OYAMA.axis_names], axis=1))[0][clear.names.index("tool and table")]
        assert found == pytest.approx(distance, abs=1e-3) if distance > 0.0 else found < -1.0, degree


def _apart(a: tuple[list[float], list[float], float, float], b: tuple[list[float], list[float], float, float]) -> float:
    return float(apart(*(Rod(*(np.array([part]) for part in rod[:3]), rod[3]) for rod in (a, b)))[0])


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


def test_the_program_takes_the_time_that_its_file_says() -> None:
    """A way around that takes less time than a pose is given waits at the pose."""
    run = _grid((-90.0, 90.0))
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
    run = _grid((0.0,), (0.0, 180.0), (100.0, 0.0, 80.0))
    quick = replace(run, time=run.time / 1e3)
    steps = program_steps(OYAMA, quick, Post(tool_centre_on="TRAORI", tool_centre_off="TRAFOOF"))
    (move,) = (step for step in steps if step.row == 1 and step.kind == "feed")
    angular = np.pi / move.seconds  # rad/s of C: the ball 100 mm off the axis goes so fast in X and in Y
    fastest = min(OYAMA.axes[n].max_feed or np.inf for n in "XY")
    assert 60.0 * angular * 100.0 <= CAUTION * fastest * (1.0 + 1e-3)
    assert np.degrees(angular) * 60.0 <= CAUTION * (OYAMA.axes["C"].max_feed or np.inf) * (1.0 + 1e-9)


def test_the_pace_of_one_straight_move_is_that_from_rest_to_rest() -> None:
    axis = TABLE.axes["X"]
    speed, push = CAUTION * (axis.max_feed or 0.0) / 60.0, CAUTION * (axis.max_acceleration or 0.0)
    for way in (1.0, 5.0, 200.0):
        path = np.zeros((2, len(TABLE.axis_names)))
        path[1, TABLE.axis_names.index("X")] = way
        expected = 2.0 * np.sqrt(way / push) if way < speed**2 / push else way / speed + speed / push
        assert sum(pace(TABLE, path)) == pytest.approx(expected, rel=1e-12)
    assert pace(TABLE, np.zeros((2, len(TABLE.axis_names)))) == (0.0, 0.0)


@pytest.mark.slow
def test_times_and_minutes_are_those_of_the_programs(made: Plan) -> None:
    total = 0.0
    for run in made.campaign.runs:
        steps = program_steps(TABLE, run, made.post)
        dwells = [i for i, step in enumerate(steps) if step.kind == "dwell"]
        between = steps[dwells[0] : dwells[-1]]
        taken = sum(step.seconds for step in between) + 30.0 * sum(step.kind == "stop" for step in between)
        assert taken <= run.time[-1] + 1e-6 and run.time[-1] - taken < 0.6 * run.rows
        assert np.all(run.time == arrival_times(TABLE, run, made.post, TABLE.workspace.seconds_per_pose))
        total += 300.0 + run.time[-1] + sum(step.seconds for step in (*steps[: dwells[0]], *steps[dwells[-1] :]))
    assert made.minutes == pytest.approx(total / 60.0, abs=0.02 * len(made.campaign.runs))


def test_a_budget_holds_for_the_programs_as_they_are_written(hurried: Plan) -> None:
    assert hurried.minutes <= 6.5


@pytest.mark.slow
def test_another_retract_leads_to_other_ways_that_are_clear(made: Plan, tmp_path) -> None:
    """What the user decides about the programs may change ways and times; the campaign says the times of its programs."""
    made.write(tmp_path / "plan", nc=("iso",), post=Post(retract_mm=90.0, dwell_s=5.0, machine_top=-2.0))
    text = (tmp_path / "plan" / "nc" / "iso" / "bar-1.nc").read_text()
    assert "BALL 90 MM FROM POSE 1?" in text and "G4 X5.000" in text and "NOT CHECKED" not in text
    first = (tmp_path / "plan" / "bar-1.csv").read_text().splitlines()[2]
    assert float(first.split(",")[0]) >= 5.0


@pytest.mark.slow
def test_a_plan_with_fewer_readings_than_unknowns_says_why_its_certificate_is_low(made: Plan, hurried: Plan) -> None:
    unknowns = len(made.assessment.parameters)
    (said,) = (note for note in made.notes if "unknowns" in note)
    determined = f"determine {made.assessment.rank} combinations; the priors determine the rest"
    assert f"8 readings for {unknowns} unknowns of machine and set-up {determined}" in said
    assert not [note for note in hurried.notes if "unknowns" in note]


@pytest.mark.slow
def test_the_sheet_says_what_the_program_says(made: Plan, tmp_path) -> None:
    made.write(tmp_path / "plan", nc=("linuxcnc",))
    page = (tmp_path / "plan" / "setup.html").read_text()
    head = (tmp_path / "plan" / "nc" / "linuxcnc" / "bar-1.ngc").read_text()
    length = f"{-made.campaign.runs[0].tool_ball[2]:g} mm below it"
    for said in ("X Y Z are positions of the spindle nose, without a tool length", length, "cradle and drives of C, B"):
        assert said in page.replace("&#x27;", "'") and said in head, said
    assert "First moves, not checked for collisions: Z alone to the top of its travel, machine coordinate 0" in page
    assert "no tool offset, the control shows X" in page


def test_a_way_to_the_far_side_of_the_moon_is_left_at_once(few: Run) -> None:
    """Where a chain is nearly singular a way is kilometres long: outside the travel it is blocked without a look along it."""
    pose = {name: float(q[0]) for name, q in few.commands.items()}
    steps = [Step(kind="feed", commands=place, towards=1, seated=True) for place in (pose, {**pose, "X": 1e12}, pose)]
    assert blocked_moves(TABLE, few, steps) == [(1, "travel of X")]


def test_first_blocks_under_tool_centre_control_have_their_feed(few: Run) -> None:
    """The way of the first block after the switch is that of the ball, and a block of the rotary axes alone has a feed."""
    post = Post(tool_centre_on="M128", tool_centre_off="M129")
    text = program(TABLE, few, "heidenhain", post)
    feeds = [float(word) for word in re.findall(r" R0 F([\d.]+)$", text, flags=re.M)]
    assert feeds[0] == pytest.approx(500.0, rel=1e-3)
    assert min(feeds) > 1.0


def test_a_bar_stays_off_the_rim_of_a_thick_post() -> None:
    """15 mm below the ball a bar must be further out than the post is thick."""
    for radius, degree in ((None, -45.0), (10.0, -45.0), (18.0, -np.degrees(np.arctan2(15.0, 18.0)))):
        workspace = replace(TABLE.workspace, post_radius=radius)
        assert least_elevation(workspace) == pytest.approx(degree)
    least = np.radians(least_elevation(replace(TABLE.workspace, post_radius=18.0, bar_radius=6.0)))
    assert 15.0 * np.cos(least) + 18.0 * np.sin(least) == pytest.approx(6.0)  # its axis 6 mm above the rim
