"""NC programs: every dialect, the ball stays where it belongs, LinuxCNC's own interpreter follows the plan."""

import itertools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rs274

from symfive.campaign import Run
from symfive.errors import InputError
from symfive.machine import Machine, preset
from symfive.nc import DIALECTS, Post, arrival_times, program, program_steps, write_programs
from symfive.procedures import (
    Nominal,
    campaign_of,
    cone_circle,
    planar_circle,
    r_test_grid,
    static_ball_bar,
    synchronous_circle,
)
from tests.plan_checker.dialects import DIALECTS as WORDS

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
    assert len(words) == sum("X" in step.positions for step in steps)


@pytest.mark.parametrize(("machine", "run"), RUNS[:3], ids=IDS[:3])
def test_the_ball_stays_in_its_nest_between_poses(machine: Machine, run: Run) -> None:
    """Half-way along every straight block the ball is off by less than a tenth of the sensor's range."""
    steps = program_steps(machine, run)
    moves = [step for step in steps if step.kind == "feed" and step.seated]
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
    assert "G93" not in texts["heidenhain"]
    assert 0 < texts["heidenhain"].count("; block time") < run.rows  # once a way, not once a block
    assert "G4 P2.000" in texts["linuxcnc"] and texts["linuxcnc"].rstrip().endswith("M2")
    with pytest.raises(
        InputError, match='NC dialect "basic" is unknown; use one of iso, siemens, heidenhain, linuxcnc'
    ):
        program(machine, run, "basic")


@pytest.mark.parametrize("dialect", list(DIALECTS))
def test_the_head_of_a_program_warns_of_collisions(dialect: str) -> None:
    machine, run = RUNS[0]
    bare = replace(machine, workspace=replace(machine.workspace, spindle_nose=None), text="")
    expected = (
        (bare, Post(tested=True), "Collisions were not checked: the machine file names no spindle nose."),
        (machine, None, "Collisions were not checked for the path of this program."),
        (
            machine,
            Post(tested=True),
            "Not tested: cradle and drives of C, B, clamps, cables, sensors of the nest, covers",
        ),
    )
    for what, post, words in expected:
        head = program(what, run, dialect, post).split(" OFF?")[0].splitlines()
        assert _comments(head, dialect).count(words.lower()) == 1


def _bare(line: str, dialect: str) -> str:
    return line.split(" ", 1)[1] if DIALECTS[dialect].numbered else line


def _comments(lines: list[str], dialect: str) -> str:
    """What the comments of a program say, in small letters, the lines of each joined."""
    opening, closing = DIALECTS[dialect].comment.split("{text}")
    bare = [_bare(line, dialect) for line in lines]
    return " ".join(line[len(opening) : len(line) - len(closing)] for line in bare if line.startswith(opening)).lower()


@pytest.mark.parametrize("dialect", list(DIALECTS))
def test_first_the_tools_axis_alone_then_the_rotary_axes_then_the_plane(dialect: str) -> None:
    """From an unknown position and back to the top: no block moves two groups of axes but where the ball creeps or is seated."""
    machine, run = RUNS[0]
    lines = [_bare(line, dialect) for line in program(machine, run, dialect, Post(machine_top=-3.0)).splitlines()]
    moves = [line for line in lines if re.search(r"^([A-Z0-9 ]+ )?G(0|1|28)\b|^L ", line) and line != "G28 Z0."]
    assert moves[0] == moves[-3] == WORDS[dialect].top
    axes = [set(re.findall(r"\b([XYZBC])[=+-]?[\d-]", re.sub(r"D0|FMAX", "", line))) for line in moves]
    assert axes[1:4] == [{"B", "C"}, {"X", "Y"}, {"Z"}] and axes[-2:] == [{"B"}, {"C"}]
    rapid = DIALECTS[dialect].rapid.split("{")[0]
    assert not [
        a
        for a, line in zip(axes, moves, strict=True)
        if len(a) > 2 and line.startswith(rapid) and "FMAX" in line + rapid
    ]


@pytest.mark.parametrize("dialect", list(DIALECTS))
def test_datum_and_tool_offset_are_called_and_cancelled_before_the_first_move(dialect: str) -> None:
    machine, run = RUNS[0]
    text = program(machine, run, dialect, Post(machine_top=-3.0)).splitlines()
    lines = [_bare(line, dialect) for line in text]
    top = lines.index(WORDS[dialect].top)
    assert set(WORDS[dialect].calls) <= set(lines[:top])
    if WORDS[dialect].moves_alone:  # G49 may move the tool by its length: at the top, from where it goes up once more
        assert not [line for line in lines[:top] if "G49" in line and line[0] != "("]
        assert lines[top : top + 4] == ["G91 G28 Z0.", "G49", "G28 Z0.", "G90"]
    said = f"X Y Z are positions of the spindle nose, without a tool length, the tool ball is {-run.tool_ball[2]:g} mm below it"
    assert said.lower() in _comments(text, dialect)
    three = preset("three-axis")
    circle = planar_circle(three)[0]
    assert "TCPM" not in program(three, circle, "heidenhain")
    assert not re.search("TRAFOOF|ROTOF", program(three, circle, "siemens"))


@pytest.mark.parametrize(
    ("dialect", "left"),
    [("iso", "G52, G92"), ("siemens", "basic frame"), ("heidenhain", "mirror image"), ("linuxcnc", "rotation R")],
)
def test_the_head_names_what_another_program_may_have_left_on(dialect: str, left: str) -> None:
    """The program cancels what has the same word on every control of its kind; the rest shifts or mirrors its first move."""
    assert left.lower() in _comments(program(*RUNS[0], dialect).splitlines(), dialect)


def test_the_head_speaks_of_what_is_there() -> None:
    """An R-test has no bar, a bar no nest."""
    heads = {
        name: _comments(program(*RUNS[i], "iso", Post(tested=True)).splitlines(), "iso")
        for name, i in (("nest", 0), ("bar", 2))
    }
    assert "post and table as" in heads["nest"] and "sensors of the nest" in heads["nest"]
    assert "post, bar and table as" in heads["bar"] and "nest" not in heads["bar"]


def test_heidenhain_calls_no_tool_before_the_operator_was_asked() -> None:
    """TOOL CALL 0 unloads the spindle on some machines, with the ball in it."""
    lines = [line.split(" ", 1)[1] for line in program(*RUNS[0], "heidenhain").splitlines()]
    assert lines.index("STOP M0") + 1 == lines.index("TOOL CALL 0 Z")


@pytest.mark.parametrize("dialect", list(DIALECTS))
def test_every_stop_shows_its_text_on_the_controls_screen(dialect: str) -> None:
    machine, run = RUNS[2]
    post = Post(unsafe={run.id: (3,)})
    texts = [step.text for step in program_steps(machine, run, post) if step.kind == "stop"]
    assert texts == ["CLEAR? Z GOES TO TOP FIRST", "BALL 50 MM FROM POSE 1?", "MOUNT BAR, KEEP ITS ZERO", "REMOVE THE BAR",
                     "MOUNT THE BAR", "REMOVE BAR, START"]  # fmt: skip
    assert re.findall(WORDS[dialect].screen, program(machine, run, dialect, post)) == texts


@pytest.mark.parametrize("dialect", list(DIALECTS))
def test_every_pose_is_read_at_a_stop_with_its_number(dialect: str) -> None:
    machine, run = RUNS[0]
    post = Post(at_pose="stop", dwell_s=3.0)
    run = replace(run, time=arrival_times(machine, run, post))
    texts = re.findall(WORDS[dialect].screen, program(machine, run, dialect, post))
    poses = [text for text in texts if text.startswith("READ POSE")]
    assert poses == [f"READ POSE {row + 1} OF {run.rows}" for row in range(run.rows)]
    steps = program_steps(machine, run, post)
    rests = [(a, b) for a, b in itertools.pairwise(steps) if b.text.startswith("READ POSE")]
    assert all(a.kind == "dwell" and a.seconds >= 3.0 for a, _ in rests)
    first, *_, last = [i for i, step in enumerate(steps) if step.kind == "dwell"]
    driven = sum(step.seconds for step in steps[first:last]) + 10.0 * (run.rows - 1)  # ten seconds to read each
    assert driven <= run.duration <= 1.1 * driven + 0.1 * run.rows


def test_every_pose_ends_with_the_users_trigger() -> None:
    machine, run = RUNS[0]
    steps = program_steps(machine, run, Post(at_pose="trigger", trigger="M64 P0\nM65 P0"))
    triggers = [i for i, step in enumerate(steps) if step.kind == "trigger"]
    assert len(triggers) == run.rows and all(steps[i - 1].kind == "dwell" for i in triggers)
    text = program(machine, run, "linuxcnc", Post(at_pose="trigger", trigger="M64 P0\nM65 P0"))
    assert len(re.findall(r"G4 P[\d.]+\nM64 P0\nM65 P0\n", text)) == run.rows
    for wrong in ({"at_pose": "trigger"}, {"trigger": "M64 P0"}, {"at_pose": "hand"}):
        with pytest.raises(InputError, match=r"trigger|unknown"):
            Post(**wrong)


def test_tool_centre_control_is_switched_by_the_users_text() -> None:
    machine, run = RUNS[0]
    post = Post(tool_centre_on="TRAORI", tool_centre_off="TRAFOOF", reversed_axes=("C",))
    lines = program(machine, run, "siemens", post).splitlines()
    on, off = lines.index("TRAORI"), [i for i, line in enumerate(lines) if line == "TRAFOOF"]
    first = next(i for i, line in enumerate(lines) if "G0 " in line)
    assert off[0] == 1 < first < on < off[-1]  # whatever the control was left in, the first words are those of the axes
    x, y, z = run.table_ball
    inside = [line for line in lines[on : off[-1]] if line.startswith("G1")][1:-2]
    assert all(line.startswith(f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f}") for line in inside)
    plain = [step for step in program_steps(machine, run) if step.row == 2][-1]
    turned = [step for step in program_steps(machine, run, post) if step.row == 2][-1]
    assert turned.positions["C"] == -plain.positions["C"] != 0.0
    said = "the control turns c against iso 841: program and control have the opposite sign of"
    assert said in "\n".join(lines).lower().replace("\n; ", " ")
    assert len(inside) == run.rows  # the control follows the ball itself: one block a pose


def test_the_tool_stands_still_where_its_length_is_called() -> None:
    """A Fanuc takes the frame that the table has at G43.4, and moves by the tool's length where G43.4 or G49 stand alone."""
    machine = preset("table-bc")
    run = r_test_grid(machine, grid={"B": (0.0,), "C": (90.0, 0.0)}, nests=((60.0, 0.0, 100.0),), returning=False)[0]
    lines = program(machine, run, "iso", Post(tool_centre=True)).splitlines()
    on, off = (next(i for i, line in enumerate(lines) if code in line) for code in ("G43.4 H1 X", "G49 X"))
    assert lines[on - 2 : on] == ["G0 X0.0000 Y-60.0000", "G0 Z300.0000"]  # the ball is 150 mm below
    assert lines[on] == "G1 G43.4 H1 X0.0000 Y-60.0000 Z150.0000 B0.0000 C90.0000 F1"
    assert {line.split()[2] for line in lines[on:off] if line.startswith("G1 X")} == {"Y-60.0000"}  # wherever C is
    assert lines[off - 1].startswith("G1 X0.0000 Y-60.0000 Z150.0000 B0.0000 C0.0000")
    assert lines[off] == "G1 G49 X60.0000 Y0.0000 Z300.0000 B0.0000 C0.0000 F1"


def test_no_number_has_more_digits_than_the_control_reads() -> None:
    """A Fanuc refuses X1063.42240: nine digits."""
    machine = preset("table-bc")
    far = {name: replace(axis, travel=(-20000.0, 20000.0)) for name, axis in machine.axes.items()}
    wide = replace(machine, axes=far)
    for run in (planar_circle(wide, plane="XY", feed=1000.0, rate_hz=5.0)[0], r_test_grid(wide)[0]):
        shift = {"X": 1234.567895, "C": 10800.0}
        moved = replace(run, commands={n: q + shift.get(n, 0.0) for n, q in run.commands.items()}, readings={})
        text = program(wide, moved, "iso")
        blocks = re.findall(r"^G[0-3] .*$", text, re.MULTILINE)
        numbers = re.findall(r"[A-Z](-?[0-9.]+)", "".join(blocks))
        assert max(len(n.replace(".", "").lstrip("-")) for n in numbers) == 8
        written = np.array([float(x) for x in re.findall(r" X(\S+)", "".join(blocks))])
        ends = moved.commands["X"] if not run.dynamic else moved.commands["X"][[0, -1]]
        assert written.max() > 1000.0 and np.abs(ends[:, None] - written).min(axis=1).max() < 6e-5


@pytest.mark.parametrize(("dialect", "decimals"), [("iso", 4), ("siemens", 4), ("heidenhain", 4), ("linuxcnc", 5)])
def test_positions_are_written_to_what_the_control_keeps(dialect: str, decimals: int) -> None:
    """A Fanuc keeps 0.001 or 0.0001 mm and degree."""
    machine, run = RUNS[0]
    text = program(machine, run, dialect)
    blocks = "\n".join(re.findall(r"^(?:N?[0-9]+ )?(?:G[0-3]|LN?|CC) .*$", text, re.MULTILINE))
    written = [number for number in re.findall(r" [XYZBC][+]?(-?[0-9.]+)", blocks) if "." in number]
    assert {len(number.partition(".")[2]) for number in written} == {decimals}


def test_the_tool_centre_stands_still_in_the_nest() -> None:
    """Half a last digit: rounded up or down from block to block, it was a way of 0.0001 mm, at F0.002."""
    machine = preset("table-bc")
    run = r_test_grid(machine, step_deg=60.0, nests=((80.12345, 0.00005, 100.00005),))[0]
    stated = replace(run, commands={name: np.round(q, 6) for name, q in run.commands.items()})
    text = program(machine, stated, "heidenhain", Post(tool_centre_on="M128", tool_centre_off="M129"))
    seated = text[text.index("SEAT BALL") : text.index("FREE BALL")]
    assert len({line[: line.index(" B")] for line in re.findall(r"L (X.*)", seated)}) == 1
    assert min(float(word) for word in re.findall(r" R0 F([\d.]+)$", seated, flags=re.MULTILINE)) > 100.0


@pytest.mark.parametrize("dialect", DIALECTS)
def test_the_program_waits_no_time_of_nothing(dialect: str) -> None:
    """The first pose is read again with the spindle turned, where the table of times leaves the turn alone."""
    machine, run = RUNS[0]
    twice = {name: q[[0, 0]] for name, q in run.commands.items()}
    indexed = replace(run, time=np.array([0.0, 7.0]), commands=twice, spindle=np.array([0.0, 180.0]), readings={})
    text = program(machine, indexed, dialect)
    assert not re.search(r"(G4 [XPF]|DWELL )0\.000", text) and len(re.findall(r"(G4 [XPF]|DWELL )2\.000", text)) == 2


def test_a_control_that_reads_capitals_gets_no_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without G93 the time of a block is a comment of the program too."""
    monkeypatch.setitem(DIALECTS, "plain", replace(DIALECTS["iso"], name="plain", inverse_time=False))
    text = program(*RUNS[0], "plain")
    assert "(BLOCK TIME " in text and text == text.upper()


def test_a_dialect_writes_its_block_numbers_and_comments_in_braces(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = replace(DIALECTS["iso"], name="plain", head=("{{{name}}}",), end=("M30",), comment="{{{text}}}")
    machine, texts = preset("table-bc"), []
    for numbered in ("", "N{block}"):
        monkeypatch.setitem(DIALECTS, "plain", replace(plain, numbered=numbered))
        texts.append(program(machine, r_test_grid(machine, step_deg=90.0)[0], "plain").splitlines())
    assert texts[1] == [f"N{number} {line}" for number, line in enumerate(texts[0])]
    assert texts[0][0] == "{R_TEST_1}" and any(line.startswith("{RUN R-TEST-1, ") for line in texts[0])


def test_names_that_are_no_address() -> None:
    odd = replace(RUNS[2][0], name="brackets (and) 100 % ; {name}")
    assert "{" not in program(odd, RUNS[2][1], "iso")


@pytest.mark.linuxcnc
@rs274.needed
@pytest.mark.parametrize(("machine", "run"), RUNS, ids=IDS)
def test_linuxcnc_follows_the_plan(machine: Machine, run: Run, tmp_path: Path) -> None:
    (path,) = write_programs(campaign_of(machine, (run,)), tmp_path, ("linuxcnc",))
    at, wanted = dict.fromkeys(LETTERS, 0.0), []
    for step in program_steps(machine, run):
        at |= step.positions
        wanted += [[at[axis] for axis in LETTERS]] if step.positions else []
    canonical = rs274.straight_moves(path)
    assert canonical.shape == np.shape(wanted)
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
    moves = [
        line for line in text.splitlines() if re.search(r"\bX[=+-]?\d", line) and "G4" not in line and " B" in line
    ]
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


@pytest.mark.parametrize(("machine", "run"), RUNS[:1], ids=IDS[:1])
def test_a_machine_without_declared_feeds_is_driven_as_a_slow_one(machine: Machine, run: Run) -> None:
    silent = {n: replace(a, max_feed=None, max_acceleration=None) for n, a in machine.axes.items()}
    slow = {
        n: replace(a, max_feed=1800.0 if a.rotary else 5000.0, max_acceleration=100.0 if a.rotary else 500.0)
        for n, a in machine.axes.items()
    }
    text = program(replace(machine, axes=silent, text=""), run, "siemens")
    assert text == program(replace(machine, axes=slow, text=""), run, "siemens")
    blocks = [60.0 / float(f) for f in re.findall(r"^G1 .* F([\d.]+)$", text, re.M)]
    assert min(blocks) > 1e-3, "seconds of a block"
