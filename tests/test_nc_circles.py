"""Programs of recordings: planar circles as the control's own arcs, other paths as blocks of a stated error."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rs274

from symfive.campaign import Run, read_campaign, write_campaign
from symfive.machine import Machine, preset, presets
from symfive.moves import cleared
from symfive.nc import DIALECTS, Post, program, program_steps, write_programs
from symfive.procedures import Nominal, campaign_of, cone_circle, planar_circle, rotary_circle, synchronous_circle
from tests.plan_checker import check
from tests.plan_checker.dialects import DIALECTS as WORDS

THREE, TABLE = preset("three-axis"), preset("table-bc")
CENTRED = Post(tool_centre_on="TRAORI", tool_centre_off="TRAFOOF")


def written(folder: Path, machine: Machine, runs: tuple[Run, ...], *dialects: str, post: Post | None = None) -> Path:
    """The runs as a campaign with programs."""
    write_campaign(campaign_of(machine, runs), folder)
    write_programs(
        campaign_of(machine, runs), folder / "nc", dialects or tuple(DIALECTS), cleared(machine, runs, {}, post)
    )
    return folder


def moves(text: str) -> list[str]:
    """What stands between putting the bar on and taking it off."""
    lines = [re.sub(r"^\d+ (?=[A-Z;])", "", line) for line in text.splitlines()]
    on, off = (next(i for i, line in enumerate(lines) if word in line) for word in ("MOUNT BAR", "REMOVE BAR"))
    return [line for line in lines[on + 1 : off] if re.match(r"G[0-3] |L |C[CP] ", line)]


@pytest.mark.parametrize("dialect", list(DIALECTS))
def test_two_turns_between_radial_feed_in_and_out(dialect: str) -> None:
    run = planar_circle(THREE, radius=100.0, direction="cw")[0]
    text = program(THREE, run, dialect, cleared(THREE, (run,), {}))
    assert moves(text) == list(WORDS[dialect].circle)
    assert "G93" not in text and not re.search(r"hand on the feed|slowly", text, re.I)
    assert "override 100 percent" in text.lower()


def test_where_an_axis_ends_too_near_the_circle_becomes_an_arc() -> None:
    axes = {**THREE.axes, "Y": replace(THREE.axes["Y"], travel=(-51.0, 300.0))}  # 1 mm beyond the circle
    machine = replace(THREE, axes=axes, text="")
    run = planar_circle(machine, radius=50.0, centre=(0.0, 0.0, 80.0), direction="ccw")[0]
    assert run.commands["Y"].min() > -49.0 and np.ptp(run.commands["X"]) > 99.0
    cleared(machine, (run,), {})


@pytest.mark.parametrize(("stroke", "out"), [(0.4, 0.6), (1.0, 1.5), (4.0, 1.5)])
def test_a_bar_is_pulled_out_no_farther_than_it_reaches(stroke: float, out: float) -> None:
    machine = replace(THREE, workspace=replace(THREE.workspace, bar_stroke=stroke), text="")
    run = planar_circle(machine, radius=100.0, centre=(0.0, 0.0, 80.0), direction="cw")[0]
    text = program(machine, run, "linuxcnc", cleared(machine, (run,), {}))
    places = [complex(*map(float, re.search(r"X(\S+) Y(\S+)", line).groups())) for line in moves(text)]
    assert [abs(place) for place in places] == pytest.approx([100.0, 100.0, 100.0 + out])
    entry = re.findall(r"G1 X(\S+) Y(\S+)", text.partition("MOUNT BAR")[0])
    before = [complex(*map(float, words)) for words in entry] or [
        complex(*map(float, re.findall(r"G0 X(\S+) Y(\S+)", text)[0]))
    ]
    assert abs(before[-1]) == pytest.approx(100.0 + out)


@pytest.mark.parametrize(
    ("name", "plane"),
    [(name, plane) if k % 3 == i else pytest.param(name, plane, marks=pytest.mark.slow)
     for k, name in enumerate(("three-axis", "table-bc", "head-bc", "mixed-bc", "nutating-table", "tsutsumi-2007"))
     for i, plane in enumerate(("XY", "YZ", "ZX"))],
)  # fmt: skip
def test_the_checker_finds_nothing_in_circles(name: str, plane: str, tmp_path: Path) -> None:
    machine = preset(name)
    runs = planar_circle(machine, plane=plane, radius=50.0, feed=(1500.0, 3000.0), rate_hz=10.0)
    found = check(written(tmp_path / "plan", machine, runs))
    assert found == [], "\n".join(map(str, found))


FAULTS = {
    "the other sense": (r"^G3", "G2", "the arc turns"),
    "a turn missing": (r" P2", "", "the arc turns"),
    "another centre": (r"I100\.0", "I100.1", "from its centre|off the circle"),
    "another feed": (r"P2 F2000", "P2 F1900", "the rows go at 2000.0"),
    "no feed-out": (r"(P2 F2000\n)G1[^\n]*\n", r"\1", "1 straight moves"),
    "fed in beside": (r"X-100\.00000 Y0\.00000 F2000", "X-100.00000 Y0.01000 F2000", "beside the radius"),
    "a short pull": (r"G1 X-101\.50000 Y0\.00000 F2000", "G1 X-100.50000 Y0.00000 F2000", "fed 0.500 mm outside"),
}


@pytest.mark.parametrize("fault", list(FAULTS))
def test_the_checker_finds_a_faulty_circle(fault: str, tmp_path: Path) -> None:
    runs = planar_circle(THREE, radius=100.0, feed=2000.0, direction="ccw", rate_hz=20.0)
    folder = written(tmp_path / "plan", THREE, runs, "linuxcnc")
    pattern, instead, says = FAULTS[fault]
    (path,) = (folder / "nc" / "linuxcnc").iterdir()
    text, count = re.subn(pattern, instead, path.read_text(encoding="ascii"), count=1, flags=re.M)
    assert count == 1
    path.write_text(text, encoding="ascii")
    assert re.search(says, "\n".join(map(str, check(folder))))


def test_rows_that_are_no_circle_are_found(tmp_path: Path) -> None:
    """The rows of the file against the program's arc, not the program against itself."""
    folder = written(tmp_path / "plan", THREE, planar_circle(THREE, direction="ccw", rate_hz=20.0), "iso")
    (rows,) = folder.glob("*.csv")
    lines = rows.read_text(encoding="utf-8").splitlines()
    cells = lines[400].split(",")
    column = lines[0].split(",").index("X_mm")
    cells[column] = str(float(cells[column]) + 0.01)
    lines[400] = ",".join(cells)
    rows.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert any("line 401" in str(finding) and "off the circle" in str(finding) for finding in check(folder))


def test_a_circle_is_known_again_from_its_file(tmp_path: Path) -> None:
    run = planar_circle(THREE, centre=(12.3, -7.1, 90.0), feed=1234.0, direction="cw", rate_hz=20.0)[0]
    write_campaign(campaign_of(THREE, (run,)), tmp_path / "c")
    (again,) = read_campaign(tmp_path / "c").runs
    assert program(THREE, again, "iso") == program(THREE, run, "iso") and " F1234\n" in program(THREE, run, "iso")


def test_tool_centre_control_stays_off_on_a_circle_of_linear_axes() -> None:
    run = planar_circle(TABLE, direction="ccw", rate_hz=20.0)[0]
    text = program(TABLE, run, "siemens", CENTRED)
    assert "TRAORI" not in text and "TRAFOOF" in text


def test_a_turning_table_is_few_blocks_with_tool_centre_control() -> None:
    """The words stand still but for the table's: from the run-up's end to the run-out's beginning one block."""
    run = rotary_circle(TABLE, axis="C", direction="ccw")[0]
    text = program(TABLE, run, "siemens", CENTRED)
    inside = text.split("THEN RECORD")[1].split("REMOVE BAR")[0]
    blocks = re.findall(r"^G1 (.*) C(\S+) F", inside, re.M)
    assert len({words for words, _ in blocks}) == 1 and len(blocks) < 150
    assert np.abs(np.diff([float(c) for _, c in blocks])).max() > 359.0


@pytest.mark.parametrize("post", [Post(), CENTRED], ids=["axes", "tool-centre control"])
def test_blocks_keep_to_the_models_path(post: Post, tmp_path: Path) -> None:
    runs = rotary_circle(TABLE, axis="C", direction="ccw", arrangement="tangential")
    folder = written(tmp_path / "plan", TABLE, runs, "siemens", post=post)
    found = check(folder)
    assert found == [], "\n".join(map(str, found))


@pytest.mark.parametrize(
    "run",
    [
        synchronous_circle(preset("tsutsumi-2007"), x_t=45.0, radius=50.0, rate_hz=100.0)[0],
        cone_circle(preset("tsutsumi-2007"), direction="cw", rate_hz=50.0)[0],
    ],
    ids=lambda run: run.id,
)
def test_the_stated_error_of_blocks_holds_at_every_row(run: Run) -> None:
    machine = preset("tsutsumi-2007")
    steps = program_steps(machine, run)
    (said,) = [step.text for step in steps if "straight blocks" in step.text]
    um, degree = map(float, re.findall(r"within (\S+) (?:um|deg)", said))
    driven = [step for step in steps if step.kind == "feed" and step.seated]
    times = np.concatenate([[0.0], np.cumsum([step.seconds for step in driven])])
    there = {
        name: np.interp(run.time, times, [run.commands[name][0], *(step.commands[name] for step in driven)])
        for name in machine.axis_names
    }
    turning = [name for name, axis in machine.axes.items() if axis.rotary]
    assert max(np.abs(there[name] - run.commands[name]).max() for name in turning) <= degree + 1e-9
    nominal = Nominal(machine)
    away = np.linalg.norm(nominal.ball(there, run.tool_ball) - nominal.ball(run.commands, run.tool_ball), axis=1)
    assert 1e3 * away.max() <= um + 1e-6 and len(driven) < run.rows


@pytest.mark.parametrize("name", presets())
@pytest.mark.parametrize("dialect", list(DIALECTS))
def test_no_line_is_longer_than_controls_read(name: str, dialect: str) -> None:
    machine = preset(name)
    run = planar_circle(machine, radius=50.0, direction="ccw", rate_hz=20.0)[0]
    text = program(machine, run, dialect, Post(tested=True, tool_centre_on="M428", tool_centre_off="M429"))
    assert max(map(len, text.splitlines())) < 80


@pytest.mark.linuxcnc
@rs274.needed
@pytest.mark.parametrize("plane", ["XY", "YZ", "ZX"])
@pytest.mark.parametrize("direction", ["ccw", "cw"])
def test_linuxcnc_reads_the_same_arc(plane: str, direction: str, tmp_path: Path) -> None:
    run = planar_circle(THREE, plane=plane, radius=100.0, direction=direction, rate_hz=20.0)[0]
    path = next((written(tmp_path / "plan", THREE, (run,), "linuxcnc") / "nc" / "linuxcnc").iterdir())
    (arc,) = re.findall(r"ARC_FEED\(([^)]*)\)", rs274.canonical(path))
    first, second, x, y, turns = (float(v) for v in arc.split(",")[:5])
    sign = 1.0 if direction == "ccw" else -1.0
    a, b = (run.commands[name] for name in plane)
    assert (first, second) == pytest.approx((a[-1], b[-1]), abs=1e-4)
    middle = {"X": 0.0, "Y": 0.0, "Z": run.table_ball[2] - run.tool_ball[2]}  # of the spindle nose
    assert (x, y) == pytest.approx(tuple(middle[name] for name in plane), abs=1e-3)
    assert turns == sign * (2 if plane == "XY" else 1)
