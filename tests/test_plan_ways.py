"""Ways of a plan's programs: every pose can be left, no rapid meets anything, times are those of the programs."""

import itertools
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from lean import location_only

from symfive.campaign import Campaign, Run
from symfive.design import Plan, Sheet, plan, setup_sheet
from symfive.design._candidates import pose_grid  # whole plans take seconds
from symfive.design._reach import Reach  # as above
from symfive.design._space import make_space  # as above
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.moves import Ways, blocked_moves, cleared, least_elevation
from symfive.nc import Post, Step, arrival_times, program, program_steps, retract_words, rotary_ranges, top_of
from symfive.procedures import planar_circle, r_test_grid, static_ball_bar


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


@pytest.mark.parametrize(("left", "drawn"), [(70.0, 50), (40.0, 35), (27.0, 25)])
def test_what_the_travel_leaves_decides_how_far_the_tool_is_drawn_back(left: float, drawn: int) -> None:
    """A pose with less than 50 mm of travel above it had no way out, although its ball needs 15 mm off its nest."""
    run = _grid((0.0,), (0.0, 90.0), (0.0, 0.0, 100.0))
    kept = OYAMA.workspace.clearance
    low = _with_travel(OYAMA, "Z", -100.0, float(run.commands["Z"].max()) + left + kept)
    post = cleared(low, (run,), {})
    assert f"BALL {drawn} MM FROM POSE 1?" in program(low, run, "iso", post)
    assert retract_words(low, run, post) == f"The program draws the tool back by {drawn} mm"


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
            z = z[tall.feasible(z, k) & (space.commands(z, k)["Z"] < 200.0)][:8:2]
            blocked = Reach(space).in_the_way(z, k[: len(z)])
            assert len(z) == 4 and all(blocked) != fits


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
    offered, left_out = (np.flatnonzero(others & side)[:20] for side in (back >= 0.0, back < 0.0))
    assert len(offered) == len(left_out) == 20
    k = np.zeros((20, 1))
    assert drawn_back not in Reach(space).in_the_way(drawn[offered], k)
    assert set(Reach(space).in_the_way(drawn[left_out], k)) <= {drawn_back, "nest, from below,"}


@pytest.mark.parametrize("instrument", ["r_test", "ball_bar"])
def test_a_machine_whose_top_is_under_its_table_is_refused_at_once(instrument: str) -> None:
    """Z in machine coordinates, 0 at the top of its travel: all ways out lead through the table. The poses with the table
    tilted were tested one by one, for minutes."""
    under = _with_travel(location_only("table-bc"), "Z", -520.0, -20.0)
    with pytest.raises(InputError, match=r"no pose can be reached: .*with all axes at 0 the spindle nose stands"):
        plan(under, instrument=instrument, points=6, setups=1, starts=1)


@pytest.mark.slow
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


def test_the_sheet_and_the_head_say_how_far_each_rotary_axis_turns(few: Run) -> None:
    """Hoses and the control's roll-over: home and positions on the way count, an axis that stands still does not."""
    post = Post(via={few.id: {1: ({**{n: float(q[0]) for n, q in few.commands.items()}, "C": 250.0},)}})
    low, high = min(0.0, few.commands["B"].min()), max(0.0, few.commands["B"].max())
    said = rotary_ranges(TABLE, few, post)
    assert f"B from {low:g}° to {high:g}°" in said and "to 250°" in said
    turned = replace(post, reversed_axes=("B",))
    assert f"B from {-high:g}° to {-low:g}°" in rotary_ranges(TABLE, few, turned)
    assert rotary_ranges(TABLE, planar_circle(TABLE)[0], Post()) == ""
    assert f"B FROM {low:g} DEG TO {high:g} DEG" in " ".join(
        program(TABLE, few, "iso", post).replace(")\n(", " ").split()
    )


def test_sheet_and_program_can_be_compared_line_by_line(few: Run) -> None:
    """The table of poses has the words of a block in their order, and the program names the pose to which a way leads."""
    page = setup_sheet(Sheet(campaign=Campaign(machine=TABLE, runs=(few,)), post=Post()), {}, ())
    heads = re.findall(r"<th>([XYZABC]) / (?:mm|°)</th>", page)
    text = program(TABLE, few, "siemens")
    assert heads == re.findall(r"([XYZABC])-?\d", next(line for line in text.splitlines() if line.startswith("G1")))
    assert re.findall(r"^; to pose (\d+)$", text, flags=re.M) == [str(row + 1) for row in range(1, few.rows)]


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
