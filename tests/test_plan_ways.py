"""Ways of a plan's programs: every pose can be left, no rapid meets anything, no axis is faster than promised."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest

from symfive.campaign import Run
from symfive.design import Plan, plan
from symfive.design._bodies import least_elevation
from symfive.design._ways import Ways, blocked_moves, cleared
from symfive.errors import InputError
from symfive.machine import Machine, preset
from symfive.nc import CAUTION, DIALECTS, Post, Step, arrival_times, pace, program_steps, top_of
from symfive.nc._base import render
from symfive.procedures import r_test_grid, static_ball_bar


def _location_only(name: str) -> Machine:
    machine = preset(name)
    return replace(machine, errors={k: v for k, v in machine.errors.items() if v.is_location}, text="")


def _with_travel(machine: Machine, axis: str, low: float, high: float) -> Machine:
    return replace(machine, axes={**machine.axes, axis: replace(machine.axes[axis], travel=(low, high))})


OYAMA, TABLE = _location_only("oyama-2010"), _location_only("table-bc")


@pytest.fixture(scope="module")
def made() -> Plan:
    """A ball-bar plan whose table tilts beyond 90°, where a rapid straight down would meet the table's side."""
    return plan(TABLE, instrument="ball_bar", points=16, starts=1, anywhere=False)


# --- ways --------------------------------------------------------------------------------------------------------------


def test_every_pose_can_be_left_and_every_move_is_clear(made: Plan) -> None:
    for run in made.campaign.runs:
        ways = Ways(TABLE, run)
        assert not [row for row in range(run.rows) if isinstance(ways.lift(row), str)]
        assert not blocked_moves(TABLE, run, program_steps(TABLE, run, made.post))


def test_a_pose_without_travel_to_draw_back_is_refused_not_written() -> None:
    """The tool ball in its nest at the upper end of Z: the retract shrank to nothing, and a rapid led straight to the pose."""
    (run,) = r_test_grid(OYAMA, grid={"B": (0.0,), "C": (0.0, 90.0)}, nests=((0.0, 0.0, 100.0),), returning=False)
    low = _with_travel(OYAMA, "Z", -100.0, float(run.commands["Z"].max()))
    sentence = r"run r-test-1: at line 2 no travel is left to draw the tool back by 10 mm; move the ball or nest, or use another"
    with pytest.raises(InputError, match=sentence):
        program_steps(low, run, Post(unsafe={run.id: (1,)}))
    with pytest.raises(InputError, match="on every way out of the pose of line 2; what clears such ways"):
        cleared(low, (run,), {})


def test_poses_without_a_way_out_are_replaced_or_the_plan_is_refused() -> None:
    """With Z so short the best poses stand at its upper end, from where no tool can be drawn out of a nest."""
    short = _with_travel(TABLE, "Z", -100.0, 300.0)
    made = plan(short, points=8, setups=1, starts=1, returns=0, anywhere=False)
    for run in made.campaign.runs:
        assert not blocked_moves(short, run, program_steps(short, run, made.post))
        assert run.commands["Z"].max() <= top_of(short) - 10.0
    machine = replace(TABLE, workspace=replace(TABLE.workspace, spindle_nose={"radius": 40.0, "above_ball": 60.0}))
    flat = _with_travel(_with_travel(machine, "Z", 195.0, 205.0), "B", -1.0, 1.0)
    with pytest.raises(InputError) as refused:
        plan(replace(flat, workspace=replace(flat.workspace, ball_height=(40.0, 100.0))), points=4, setups=1, starts=1)
    assert "\n" not in str(refused.value) and "no pose" in str(refused.value)


def test_a_blocked_rapid_is_blamed_on_the_row_it_leads_to() -> None:
    """A rapid straight into the pose: the move that follows stands still, and the row stays with the rapid."""
    (run,) = r_test_grid(OYAMA, grid={"B": (-90.0, 90.0), "C": (0.0,)}, nests=((0.0, 0.0, 60.0),), returning=False)
    ends = [{n: float(q[row]) for n, q in run.commands.items()} for row in (0, 1)]
    through = {**ends[1], "Z": ends[1]["Z"] - 80.0}
    steps = program_steps(OYAMA, run, Post(unsafe={run.id: (1,)}, ways={run.id: {1: (ends[0], through, ends[1])}}))
    reached = [step for step in steps if step.row == 1 and step.kind in ("rapid", "feed")]
    assert len(reached) == 1 and reached[0].towards == 1
    assert {row for row, _ in blocked_moves(OYAMA, run, steps)} == {1}


def test_a_way_around_names_one_group_of_axes_a_block(made: Plan) -> None:
    for run in made.campaign.runs:
        for step in program_steps(TABLE, run, made.post):
            if step.kind == "rapid":
                assert set(step.positions) in ({"Z"}, {"B", "C"}, {"B"}, {"C"}, {"X", "Y"}, {"X"}, {"Y"})
            assert step.kind != "rapid" or not step.seated


# --- feeds and minutes -------------------------------------------------------------------------------------------------


def _shares(machine: Machine, run: Run, post: Post) -> np.ndarray:
    """Of every feed block and axis: its speed as a share of the greatest feed."""
    found, before = [], dict.fromkeys(machine.axis_names, np.nan)
    for step in program_steps(machine, run, post):
        if step.kind == "feed":
            speed = [abs(step.commands[n] - before[n]) / step.seconds * 60.0 for n in machine.axis_names]
            found.append(
                [v / (machine.axes[n].max_feed or np.inf) for v, n in zip(speed, machine.axis_names, strict=True)]
            )
        before = {**before, **step.commands}
    return np.nan_to_num(np.array(found))


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
    (run,) = r_test_grid(OYAMA, grid={"B": (0.0,), "C": (0.0, 180.0)}, nests=((100.0, 0.0, 80.0),), returning=False)
    quick = replace(run, time=run.time / 1e3)
    (move,) = (
        step
        for step in program_steps(OYAMA, quick, Post(tool_centre_on="TRAORI", tool_centre_off="TRAFOOF"))
        if step.row == 1 and step.kind == "feed"
    )
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


def test_a_budget_holds_for_the_programs_as_they_are_written() -> None:
    made = plan(OYAMA, points=10, minutes=6.5, setups=1, starts=1, anywhere=False)
    assert made.minutes <= 6.5


def test_another_retract_leads_to_other_ways_that_are_clear(made: Plan, tmp_path) -> None:
    """What the user decides about the programs may change ways and times; the campaign says the times of its programs."""
    made.write(tmp_path / "plan", nc=("iso",), post=Post(retract_mm=90.0, dwell_s=5.0, machine_top=-2.0))
    text = (tmp_path / "plan" / "nc" / "iso" / "bar-1.nc").read_text()
    assert "BALL STANDS 90 MM OFF?" in text and "G4 X5.000" in text and "NOT CHECKED" not in text
    first = (tmp_path / "plan" / "bar-1.csv").read_text().splitlines()[2]
    assert float(first.split(",")[0]) >= 5.0


# --- words -------------------------------------------------------------------------------------------------------------


def test_a_plan_with_fewer_readings_than_unknowns_says_why_its_certificate_is_low(made: Plan) -> None:
    unknowns = len(made.assessment.parameters)
    (said,) = (note for note in made.notes if "unknowns" in note)
    assert said.startswith(
        f"16 readings for {unknowns} unknowns of machine and set-up: they determine {made.assessment.rank}"
    )
    enough = plan(OYAMA, points=12, setups=1, starts=1, anywhere=False)
    assert not [note for note in enough.notes if "unknowns" in note]


def test_the_sheet_says_what_the_program_says(made: Plan, tmp_path) -> None:
    made.write(tmp_path / "plan", nc=("linuxcnc",))
    page = (tmp_path / "plan" / "setup.html").read_text()
    head = (tmp_path / "plan" / "nc" / "linuxcnc" / "bar-1.ngc").read_text()
    length = f"{-made.campaign.runs[0].tool_ball[2]:g} mm below it"
    for said in ("X Y Z are of the spindle nose, no tool length called", length, "cradle and drives of C, B"):
        assert said in page.replace("&#x27;", "'") and said in head, said
    assert "First moves, not tested: Z alone to the top of its travel, machine coordinate 0" in page
    assert "no tool offset, the control shows X" in page


def test_a_way_to_the_far_side_of_the_moon_is_left_at_once() -> None:
    """Where a chain is nearly singular a way is kilometres long: outside the travel it is blocked without a look along it."""
    run = plan(TABLE, instrument="r_test", points=4, starts=1).campaign.runs[0]
    pose = {name: float(q[0]) for name, q in run.commands.items()}
    steps = [Step(kind="feed", commands=place, towards=1, seated=True) for place in (pose, {**pose, "X": 1e12}, pose)]
    assert blocked_moves(TABLE, run, steps) == [(1, "travel of X")]


def test_first_blocks_under_tool_centre_control_have_their_feed() -> None:
    """The way of the first block after the switch is that of the ball, and a block of the rotary axes alone has a feed."""
    run = plan(TABLE, instrument="r_test", points=4, starts=1).campaign.runs[0]
    post = Post(tool_centre_on="M128", tool_centre_off="M129")
    text = render(DIALECTS["heidenhain"], "nest", program_steps(TABLE, run, post))
    feeds = [float(word) for word in re.findall(r" R0 F([\d.]+)$", text, flags=re.M)]
    assert feeds[0] == pytest.approx(500.0, rel=1e-3)
    assert min(feeds) > 1.0


def test_a_bar_stays_off_the_rim_of_a_thick_post() -> None:
    """15 mm below the ball a bar must be further out than the post is thick."""
    for radius, degree in ((None, -45.0), (10.0, -45.0), (18.0, -np.degrees(np.arctan2(15.0, 18.0)))):
        workspace = replace(TABLE.workspace, post_radius=radius)
        assert least_elevation(workspace) == pytest.approx(degree)
