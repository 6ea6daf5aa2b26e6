"""NC programs: every dialect, the ball stays where it belongs, LinuxCNC's own interpreter follows the plan."""

from __future__ import annotations

import itertools
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from symfive.campaign import Run
from symfive.errors import InputError
from symfive.machine import Machine, preset
from symfive.nc import DIALECTS, Post, program, program_steps, write_programs
from symfive.procedures import Nominal, campaign_of, cone_circle, r_test_grid, static_ball_bar, synchronous_circle

LETTERS = "XYZABC"


def _runs() -> list[tuple[Machine, Run]]:
    table, head, circle = preset("oyama-2010"), preset("head-bc"), preset("tsutsumi-2007")
    grid = {"B": (-60.0, 0.0, 60.0), "C": (0.0, 90.0, 200.0)}
    return [
        (table, r_test_grid(table, grid=grid, returning=False)[0]),
        (head, r_test_grid(head, grid=grid, returning=False)[0]),
        (table, static_ball_bar(table)[0]),
        (circle, synchronous_circle(circle, radius=50.0, feed=1000.0, rate_hz=20.0)[0]),
        (table, cone_circle(table, direction="ccw", rate_hz=8.0)[0]),
    ]


RUNS = _runs()
IDS = [f"{machine.name.split(',')[0]}: {run.id}" for machine, run in RUNS]


@pytest.mark.parametrize(("machine", "run"), RUNS, ids=IDS)
@pytest.mark.parametrize("dialect", list(DIALECTS))
def test_every_dialect_visits_every_pose(machine: Machine, run: Run, dialect: str) -> None:
    text = program(machine, run, dialect)
    assert text.isascii() and text.endswith("\n") and max(map(len, text.splitlines())) < 200
    steps = program_steps(machine, run)
    visited = [step.row for step in steps if step.row is not None]
    if not run.dynamic:
        assert list(dict.fromkeys(visited)) == list(range(run.rows))
        assert sum(step.kind == "dwell" for step in steps) == run.rows
    for step in steps:
        if step.row is not None:
            for axis, value in step.positions.items():
                assert value == pytest.approx(run.commands[axis][step.row], abs=1e-9)
    words = re.findall(r"(?<!G4 )\bX[=+]?(-?\d+\.\d+)", text)
    assert len(words) == sum(bool(step.positions) for step in steps)


@pytest.mark.parametrize(("machine", "run"), RUNS[:3], ids=IDS[:3])
def test_the_ball_stays_in_its_nest_between_poses(machine: Machine, run: Run) -> None:
    """Half-way along every straight block the ball is off by less than a tenth of the sensor's range."""
    steps = program_steps(machine, run)
    seated = [i for i, step in enumerate(steps) if step.kind == "stop"]
    moves = [s for s in steps[seated[1] : seated[-1]] if s.kind == "feed"]
    ends = {n: np.array([m.positions[n] for m in moves]) for n in machine.axis_names}
    middle = {n: 0.5 * (v[1:] + v[:-1]) for n, v in ends.items()}
    off = Nominal(machine).ball(middle, run.tool_ball) - np.asarray(run.table_ball)
    distance = np.linalg.norm(off, axis=1) - (run.length or 0.0)
    assert np.abs(distance).max() < 0.1 * machine.workspace.sensor_range


def test_details_of_dialects() -> None:
    machine, run = RUNS[0]
    texts = {name: program(machine, run, name) for name in DIALECTS}
    assert "G93" in texts["iso"] and "G94\nM30\n%" in texts["iso"] and "G4 X2.000" in texts["iso"]
    assert "G4 F2.000" in texts["siemens"] and "; " in texts["siemens"]
    assert (
        texts["heidenhain"].startswith("0 BEGIN PGM R_TEST_1 MM\n")
        and "CYCL DEF 9.1 DWELL 2.000" in texts["heidenhain"]
    )
    assert "G93" not in texts["heidenhain"] and "; block time" in texts["heidenhain"]
    assert "G4 P2.000" in texts["linuxcnc"] and texts["linuxcnc"].rstrip().endswith("M2")
    with pytest.raises(
        InputError, match='NC dialect "okuma" is unknown; use one of iso, siemens, heidenhain, linuxcnc'
    ):
        program(machine, run, "okuma")


@pytest.mark.parametrize("dialect", list(DIALECTS))
def test_the_head_of_a_program_warns_of_collisions(dialect: str) -> None:
    machine, run = RUNS[0]
    bare = replace(machine, workspace=replace(machine.workspace, spindle_nose=None), text="")
    tested = Post(tested=True, blocked={run.id: (3, 3)})
    expected = (
        (bare, Post(tested=True), "Collisions were not checked: the machine file names no spindle nose."),
        (machine, None, "Collisions were not checked for the ways of this program."),
        (machine, tested, "Not tested: clamps, cables, the nest's sensors"),
        (machine, tested, f"NOT CLEAR on the way to line 5 of {run.file}."),
    )
    comment = DIALECTS[dialect].comment.split("{text}")[0]
    for what, post, words in expected:
        head = program(what, run, dialect, post).split(DIALECTS[dialect].stop)[0].splitlines()
        [line] = [line for line in head if words in line]
        assert line.lstrip("0123456789 ").startswith(comment), line


def test_tool_centre_control_is_switched_by_the_users_text() -> None:
    machine, run = RUNS[0]
    post = Post(tool_centre_on="TRAORI", tool_centre_off="TRAFOOF", reversed_axes=("C",))
    lines = program(machine, run, "siemens", post).splitlines()
    on, off = lines.index("TRAORI"), [i for i, line in enumerate(lines) if line == "TRAFOOF"]
    first_rapid = next(i for i, line in enumerate(lines) if line.startswith("G0"))
    assert off[0] < first_rapid < on < off[1]  # whatever the control was left in, the first words are those of the axes
    x, y, z = run.table_ball
    inside = [line for line in lines[on : off[1]] if line.startswith("G1")][:-1]
    assert all(line.startswith(f"G1 X{x:.5f} Y{y:.5f} Z{z:.5f}") for line in inside)
    plain = [step for step in program_steps(machine, run) if step.row == 2][-1]
    turned = [step for step in program_steps(machine, run, post) if step.row == 2][-1]
    assert turned.positions["C"] == -plain.positions["C"] != 0.0
    assert len(inside) == run.rows  # the control follows the ball itself: one block a pose


def test_retract_where_the_way_is_blocked_and_names_that_are_no_address() -> None:
    machine, run = RUNS[2]
    steps = program_steps(machine, run, Post(unsafe={run.id: (3,)}))
    assert [s.text for s in steps if s.kind == "stop"][2:4] == [
        "take the bar off, then start",
        "put the bar on, then start",
    ]
    odd = replace(machine, name="brackets (and) 100 % ; {name}")
    assert "{" not in program(odd, run, "iso")


def _interpreted(path: Path) -> np.ndarray:
    """End points of all straight moves as LinuxCNC's interpreter reads them, X Y Z A B C."""
    answer = subprocess.run(
        ["rs274", "-g", str(path)], capture_output=True, text=True, timeout=60, cwd=path.parent, check=False
    )
    assert answer.returncode == 0, answer.stdout[-500:] + answer.stderr[-500:]
    found = re.findall(r"STRAIGHT_(?:FEED|TRAVERSE)\(([^)]*)\)", answer.stdout)
    return np.array([[float(v) for v in line.split(",")[:6]] for line in found])


@pytest.mark.linuxcnc
@pytest.mark.skipif(
    shutil.which("rs274") is None, reason="LinuxCNC's interpreter rs274 is not installed (linuxcnc-uspace)"
)
@pytest.mark.parametrize(("machine", "run"), RUNS, ids=IDS)
def test_linuxcnc_follows_the_plan(machine: Machine, run: Run, tmp_path: Path) -> None:
    (path,) = write_programs(campaign_of(machine, (run,)), tmp_path, ("linuxcnc",))
    moves = [step for step in program_steps(machine, run) if step.positions]
    wanted = np.array([[step.positions.get(axis, 0.0) for axis in LETTERS] for step in moves])
    canonical = _interpreted(path)
    assert canonical.shape == wanted.shape
    assert np.abs(canonical - wanted).max() <= 1e-4
    if not run.dynamic:
        poses = np.stack([run.commands.get(axis, np.zeros(run.rows)) for axis in LETTERS], axis=1)
        nearest = np.abs(canonical[:, None, :] - poses[None, :, :]).max(axis=2).min(axis=0)
        assert nearest.max() <= 1e-4


@pytest.mark.parametrize(("machine", "run"), RUNS, ids=IDS)
@pytest.mark.parametrize("dialect", list(DIALECTS))
def test_no_block_stands_still_and_no_zero_is_negative(machine: Machine, run: Run, dialect: str) -> None:
    text = program(machine, run, dialect)
    assert not re.search(r"-0\.0+\b", text)
    moves = [line for line in text.splitlines() if re.search(r"\bX[=+-]?\d", line) and "G4" not in line]
    words = [" ".join(re.findall(r"\b[A-CX-Z][=+]?-?\d+\.\d+", line)) for line in moves]
    assert all(a != b for a, b in itertools.pairwise(words))


def test_a_rest_while_reading_becomes_a_dwell_of_the_same_time() -> None:
    machine, run = RUNS[3]
    moving = [step for step in program_steps(machine, run) if step.seated]
    assert sum(step.seconds for step in moving) == pytest.approx(run.duration)
    assert moving[-1].kind == "dwell", "the recording ends at rest"


def test_programs_are_numbered_as_the_runs(tmp_path: Path) -> None:
    machine, first = RUNS[0]
    second = replace(first, id="another", file="another.csv")
    paths = write_programs(campaign_of(machine, (first, second)), tmp_path, ("iso",))
    assert [path.read_text().splitlines()[1] for path in paths] == ["O0001 (R_TEST_1)", "O0002 (ANOTHER)"]
