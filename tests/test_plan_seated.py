"""Seated moves that go around what is in the way, and poses chosen with the price of their moves."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lean import location_only

from symfive.campaign import Run
from symfive.design import Plan, make_space, plan
from symfive.design._seated import Seated  # moves that are refused at will
from symfive.instruments import INSTRUMENTS
from symfive.machine import machine_from_data, preset, presets
from symfive.motion import approach
from symfive.moves import blocked_moves
from symfive.nc import DIALECTS, Positions, Post, Seat, Way, program_steps
from symfive.procedures import Nominal, r_test_grid
from tests.plan_checker import check

TURNED_Y = {
    "schema": "symfive.machine/1", "name": "Y turns with C", "structure": "w b B X C Y Z t",
    "axes": {"B": {"travel": [-90.0, 110.0]}, "C": {"travel": [-360.0, 360.0]},
             **{name: {"travel": [-800.0, 800.0]} for name in "XYZ"}},
    "errors": {"EX0C": {"sigma": 50.0}}, "workspace": {"table_radius": 200.0, "ball_height": [30.0, 100.0],
                                                    "tool_length": [100.0, 200.0]},
}  # fmt: skip
PLANS = (("three-axis", preset, "ball_bar", 24), ("mixed-bc", location_only, "r_test", 32))


@pytest.fixture(scope="module", params=PLANS, ids=lambda p: p[0])
def made(request: pytest.FixtureRequest) -> Plan:
    """Plans in which straight moves meet something."""
    name, machine, instrument, points = request.param
    return plan(machine(name), instrument=instrument, points=points, starts=1, anywhere=False, prove=False)


def _bent(made: Plan) -> Iterator[tuple[Run, int, Way]]:
    for run in made.campaign.runs:
        for row, places in made.post.via.get(run.id, {}).items():
            yield run, row, places


@pytest.mark.slow
def test_a_blocked_move_goes_around_without_a_removal(made: Plan) -> None:
    assert list(_bent(made))
    assert not made.unsafe
    for run in made.campaign.runs:
        straight = replace(made.post, via={})
        met = {row for row, _ in blocked_moves(made.machine, run, program_steps(made.machine, run, straight))}
        assert met == set(made.post.via.get(run.id, {}))
        assert not blocked_moves(made.machine, run, program_steps(made.machine, run, made.post))


@pytest.mark.slow
def test_a_program_passes_its_further_positions_seated(made: Plan) -> None:
    nominal, stroke = Nominal(made.machine), 0.05 * INSTRUMENTS[made.instrument].stroke(made.machine)
    for run, row, places in _bent(made):
        steps = program_steps(made.machine, run, made.post)
        there = [step.commands for step in steps if step.towards == row and step.seated and step.commands]
        begins = {name: float(values[row - 1]) for name, values in run.commands.items()}
        assert all(place in there or place == pytest.approx(begins, abs=1e-6) for place in places)
        q = {name: np.array([c[name] for c in there]) for name in made.machine.axis_names}
        away = np.linalg.norm(nominal.ball(q, run.tool_ball) - np.asarray(run.table_ball), axis=1) - (run.length or 0.0)
        assert np.abs(away).max() < stroke


@pytest.mark.slow
def test_every_rotary_axis_comes_to_a_row_from_the_side_that_the_file_says(made: Plan) -> None:
    rotary = [name for name, axis in made.machine.axes.items() if axis.rotary]
    for run, row, places in _bent(made):
        ends = [{n: float(q[i]) for n, q in run.commands.items()} for i in (row - 1, row)]
        for name in rotary:
            q = [place[name] for place in (ends[0], *places, ends[1])]
            assert np.ptp(q) == 0.0 or np.sign(q[-1] - q[-2]) == approach(run.commands[name])[row]


@pytest.mark.slow
def test_programs_of_all_dialects_are_in_order(made: Plan, tmp_path: Path) -> None:
    made.write(tmp_path / "plan", nc=tuple(DIALECTS))
    assert not check(tmp_path / "plan")


@pytest.mark.slow
def test_another_dwell_keeps_the_further_positions(made: Plan, tmp_path: Path) -> None:
    made.write(tmp_path / "plan", nc=("linuxcnc",), post=Post(dwell_s=3.0))
    assert not check(tmp_path / "plan")


def test_what_the_exact_bodies_refuse_is_not_tried_again() -> None:
    """A leg that is refused once gives way to other positions; with all legs refused there is no move."""
    space = make_space(preset("three-axis"), "ball_bar")
    poses = np.radians([[0.0, 80.0], [90.0, 10.0], [180.0, 80.0]])
    setup = 0.5 * (space.lower[2:] + space.upper[2:])
    z = np.hstack([poses, np.broadcast_to(setup, (3, 4))])
    seated = Seated(space, z, np.full((3, 1), 100.0))
    sides = np.zeros(0)
    assert seated.via(0, 2, sides) == ()
    asked: list[tuple[float, ...]] = []

    def later(moves: Sequence[tuple[Positions, Positions]]) -> list[bool]:
        asked.extend((*before.values(), *after.values()) for before, after in moves)
        return [len(asked) > 1] * len(moves)

    around = seated.via(0, 2, sides, later)
    assert around and len(set(asked)) == len(asked)
    assert seated.via(0, 1, sides, lambda moves: [False] * len(moves)) is None


def test_a_move_that_is_clear_one_way_only_is_taken_that_way() -> None:
    """Opposite bars have no shorter arc between them: the one that is driven there is another than the one back."""
    space = make_space(preset("table-bc"), "ball_bar")
    z = np.array([[0.1, 0.1, a, 0.5, 0.5, 0.0, 0.5, 1.5] for a in (0.0, 0.5, 1.0)])
    seated = Seated(space, z, np.full((3, 1), 100.0))
    seated.direct[:] = np.triu(np.ones((3, 3), dtype=bool))
    seated.direct[0, 2] = False
    asked: list[tuple[float, ...]] = []

    def only_there(moves: Sequence[tuple[Positions, Positions]]) -> list[bool]:
        asked.extend(tuple(move[1].values()) for move in moves)
        return [True] * len(moves)

    assert seated.via(2, 0, np.ones(2), only_there) is not None
    one = tuple(float(q[1]) for q in seated.commands.values())
    assert one not in asked  # back from 2 to 1 nothing is clear


@pytest.mark.slow
@pytest.mark.parametrize("name", presets())
def test_a_bar_comes_off_at_most_once_a_run(name: str) -> None:
    """On every preset: 41 removals in 8 plans before (2, 7, 5, 2, 8, 5, 9, 8 by preset), 1 since."""
    made = plan(preset(name), instrument="ball_bar", points=32, starts=2, anywhere=False)
    assert all(len(rows) <= 1 for rows in made.unsafe.values())
    for run, rows in made.unsafe.items():
        assert any(note.startswith(f"run {run}: remove the bar before {len(rows)} of the poses") for note in made.notes)


def test_linear_axes_that_turn_against_each_other_keep_out_of_one_plane() -> None:
    """C turns Y, which stands on it, towards X: at C = 90° both go one way, and any of many positions would do."""
    machine = machine_from_data(TURNED_Y)
    space = make_space(machine, "r_test")
    z = np.array([[0.0, np.radians(c), 0.5, 0.0, 0.5, 1.5] for c in (0.0, 60.0, 88.0, 90.0)])
    assert space.feasible(z, np.zeros((4, 1))).tolist() == [True, True, False, False]


def test_the_last_block_ends_at_the_pose_that_is_written() -> None:
    """At C = 90° X and Y cancel, so the ball's place does not say where they stand: the last block slides both by 200 mm."""
    machine, tool = machine_from_data(TURNED_Y), (0.0, 0.0, -150.0)
    nominal, place = Nominal(machine), np.array([[0.0, 0.0, 50.0]])
    before, after = (
        {n: float(q[0]) for n, q in nominal.follow(place, tool, {"B": 0.0, "C": c}, "it").items()} for c in (80.0, 90.0)
    )
    after |= {"X": after["X"] + 200.0, "Y": after["Y"] + 200.0}
    run = replace(
        r_test_grid(preset("table-bc"))[0], time=np.zeros(1), tool_ball=tool, readings={},
        commands={n: np.array([v]) for n, v in before.items()},
    )  # fmt: skip
    path = Seat(machine, run, nominal).path(before, after)
    assert path is not None and dict(zip(machine.axis_names, path[-1].tolist(), strict=True)) == after
    dense = np.concatenate([path[:-1] + share * np.diff(path, axis=0) for share in np.linspace(0.0, 1.0, 9)])
    ball = nominal.ball(dict(zip(machine.axis_names, dense.T, strict=True)), tool)
    assert np.linalg.norm(ball - place, axis=1).max() < 0.1 * machine.workspace.sensor_range
