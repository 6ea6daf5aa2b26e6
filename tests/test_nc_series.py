"""Circular tests as a control drives them: the bar stays on between circles, every dialect's arcs, tool-centre control."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from lean import location_only

from symfive.cli import main
from symfive.design import Plan, circular_test, plan
from symfive.errors import InputError
from symfive.machine import preset
from symfive.nc import DIALECTS, Post, program, series_of
from symfive.procedures import r_test_grid, rotary_circle
from tests.plan_checker import check
from tests.plan_checker.dialects import DIALECTS as WORDS


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A circular test with its programs in every dialect; nothing may be changed in it."""
    place = tmp_path_factory.mktemp("series") / "test"
    made = circular_test("three-axis", planes=("XY", "ZX"), feeds=(500.0, 2000.0), radius=100.0, rate_hz=10.0)
    made.write(place, nc=tuple(DIALECTS))
    return place


@pytest.fixture(scope="module")
def of_poses() -> Plan:
    return plan(location_only("table-bc"), points=4, starts=1, anywhere=False, prove=False)


def test_a_sheet_states_positions_as_the_program_does_and_how_the_readings_are_imported(tmp_path: Path) -> None:
    """A height of 33.26 mm and a tool of 133.5 mm were 33.3 and 134 mm on the sheet, where the ball counts as known to 20 µm."""
    known = location_only("table-bc")
    workspace = replace(known.workspace, ball_height=(33.26, 33.26), tool_length=(133.5, 133.5), bar_lengths=(50.0,))
    machine = replace(known, workspace=workspace, text="")
    circular_test(machine, planes=("XY",), feeds=(1000.0,), radius=50.0, rate_hz=10.0).write(tmp_path / "bar")
    sheet = (tmp_path / "bar" / "setup.html").read_text(encoding="utf-8")
    assert "z = 33.26 mm" in sheet and "at 133.5 mm below the spindle nose" in sheet
    assert "import-polar PLAN FILES" in sheet and "called xy-ccw" in sheet and "If a run is interrupted" in sheet
    made = plan(machine, points=4, starts=1, anywhere=False, prove=False)
    made.write(tmp_path / "nest")
    sheet = (tmp_path / "nest" / "setup.html").read_text(encoding="utf-8")
    assert "z = 33.26 mm" in sheet and "33.26) mm; " in sheet and "import-rests PLAN FILES --dwell 2 " in sheet


@pytest.mark.slow
def test_one_program_drives_both_directions_and_feeds_with_the_bar_on(folder: Path) -> None:
    for dialect in DIALECTS:
        series = [*(folder / "nc" / dialect).glob(f"*[dD][-_]3[-_]*{WORDS[dialect].suffix}")]
        assert len(series) == 2
        for path in series:
            text = path.read_text()
            assert text.count("MOUNT BAR") == text.count("REMOVE BAR") == 1
            assert [text.count(f"THEN {said}") for said in ("CW F500", "CCW F2000", "CW F2000")] == [1, 1, 1]
    sheet = (folder / "setup.html").read_text()
    assert "the 4 circles of this mounting, each a recording of its own; the bar stays mounted." in sheet
    assert sheet.count("leave table ball and tool ball in place.") == 7  # each program of its own has the bar removed


def test_every_control_takes_the_names_of_its_files(folder: Path) -> None:
    """Siemens: letters, digits and _, beginning with two letters, at most 24 characters. Heidenhain: no +."""
    names = {dialect: [path.stem for path in (folder / "nc" / dialect).iterdir()] for dialect in DIALECTS}
    assert len({len(found) for found in names.values()}) == 1
    assert all(re.fullmatch("[A-Z]{2}[A-Z0-9_]{0,22}", name) for name in names["siemens"])
    assert DIALECTS["siemens"].file("1-c-x200-f500-ccw") == "RUN_1_C_X200_F500_CCW"
    assert all(re.fullmatch("[A-Za-z0-9._-]{1,24}", name) for name in names["heidenhain"])
    for path in (folder / "nc" / "heidenhain").iterdir():
        assert f"BEGIN PGM {path.stem.replace('-', '_').upper()} MM" in path.read_text()


def test_the_checker_reads_the_arcs_of_every_dialect(folder: Path) -> None:
    assert not check(folder)


@pytest.mark.parametrize("dialect", list(DIALECTS))
def test_the_checker_finds_a_wrong_arc_in_every_dialect(folder: Path, dialect: str, tmp_path: Path) -> None:
    right, wrong, said = WORDS[dialect].spoiled
    mine = Path(shutil.copytree(folder, tmp_path / "test", ignore=shutil.ignore_patterns(*set(DIALECTS) - {dialect})))
    (path,) = (mine / "nc" / dialect).glob("[xX][yY]*[dD][-_]3[-_]*")
    text = path.read_text()
    assert right in text
    path.write_text(text.replace(right, wrong, 1))
    found = [finding for finding in check(mine) if finding.file == path]
    assert found and any(said in finding.says for finding in found)


def test_circles_of_another_mounting_are_no_series() -> None:
    machine = preset("three-axis")
    runs = circular_test(machine, feeds=(500.0,), radius=100.0, rate_hz=10.0).campaign.runs
    others = circular_test(machine, feeds=(500.0,), radius=100.0, centre=(0.0, 0.0, 150.0), rate_hz=10.0).campaign.runs
    assert [len(found) for found in series_of(machine, [*runs, *others])] == [2, 2]
    assert not series_of(machine, [runs[0], others[1]])


def test_tool_centre_control_comes_in_the_dialects_own_words(of_poses: Plan, tmp_path: Path) -> None:
    of_poses.write(tmp_path / "plan", nc=("iso", "siemens"), post=Post(tool_centre=True, tool_number=7))
    iso = next((tmp_path / "plan/nc/iso").iterdir()).read_text()
    siemens = next((tmp_path / "plan/nc/siemens").iterdir()).read_text()
    assert "In the program: while tool-centre control is on, X Y Z are positions of the tool ball" in (
        tmp_path / "plan/setup.html"
    ).read_text(encoding="utf-8")
    of_poses.write(tmp_path / "turned", nc=(), post=Post(reversed_axes=("C",)))
    assert "The control turns C against ISO 841: program" in (tmp_path / "turned/setup.html").read_text(
        encoding="utf-8"
    )
    assert iso.index("G43.4 H7") < iso.index("SEAT BALL") < iso.rindex("G49")
    assert siemens.index("T7 D1\nTRAORI") < siemens.index("SEAT BALL") < siemens.rindex("TRAFOOF\nD0")
    assert not check(tmp_path / "plan")


def test_a_new_dialect_is_read_by_its_entry(of_poses: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a how-to's reader adds one, with words of its own for the datum, machine coordinates and tool-centre control."""
    start = ("G21 G17 G90 G94 G40 G80", "M5", "G15 H1", "G53")
    own = replace(
        DIALECTS["iso"], name="new", start=start, retract=("G53", "G16 H0 G0 {words}"), dwell="G4 F{seconds}",
        stop=("({text})", "M0"), tool_centre=("G1 G169 H{tool} {words} F1", "G1 G170 {words} F1"),
        frame_of_start=False, inverse_time=False, cycle=None,
    )  # fmt: skip
    needed = ("G17", "G21", "G40", "G80", "G90", "G53", "datum")
    read = replace(
        WORDS["iso"], needed=needed, dwell="F", datum="15", machine=("16",), no_length="53", centre=("169", "170"),
        frame_of_start=False, message="", stops=False,
    )  # fmt: skip
    monkeypatch.setitem(DIALECTS, "new", own)
    monkeypatch.setitem(WORDS, "new", read)
    for name, post in (("axes", Post()), ("centred", Post(tool_centre=True))):
        of_poses.write(tmp_path / name, nc=("new", "siemens"), post=post)
        assert not check(tmp_path / name)
    monkeypatch.setitem(WORDS, "new", replace(read, frame_of_start=True))
    assert check(tmp_path / "centred")


@pytest.mark.parametrize("dialect", ["heidenhain", "linuxcnc"])
def test_words_that_depend_on_the_machine_are_asked_for(dialect: str) -> None:
    machine = preset("table-bc")
    run = r_test_grid(machine, grid={"B": (0.0,), "C": (0.0, 90.0)}, nests=((0.0, 0.0, 100.0),), returning=False)[0]
    with pytest.raises(InputError, match="depends on your machine; give --tool-centre-on and --tool-centre-off"):
        program(machine, run, dialect, Post(tool_centre=True))
    own = Post(tool_centre=True, tool_centre_on="M428", tool_centre_off="M429")
    assert "M428" in program(machine, run, dialect, own)


def test_the_command_line_plans_arcs_of_220_degrees_at_two_feeds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--circles", "iso-230-4", "--plane", "YZ", "--feed", "500", "--feed", "2000", "--bar", "100"]
    assert main(["plan", "three-axis", "-o", str(tmp_path / "plan"), *options, "--nc", "heidenhain"]) == 0
    said = capsys.readouterr().out
    assert "4 recordings" in said and "partial arcs, not a circular test by ISO 230-4, which has 360°" in said
    text = next((tmp_path / "plan/nc/heidenhain").glob("*-and-*")).read_text()
    assert text.count("CP IPA+224.0000 DR+") == text.count("CP IPA-224.0000 DR-") == 2
    assert not check(tmp_path / "plan")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--plane", "XX"], 'plane "XX" is unknown'),
        (["--bar", "100", "--bar", "150"], "a circular test has one bar, 2 are given"),
        (["--feed", "500", "--feed", "500"], "a plane or a feed is named twice"),
        (["--feed", "1e5"], "axis"),
    ],
)
def test_a_circular_test_that_cannot_be_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], said: str
) -> None:
    assert main(["plan", "three-axis", "-o", str(tmp_path / "plan"), "--circles", "iso-230-4", *options]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1 and not (tmp_path / "plan").exists()


@pytest.mark.parametrize(("dialect", "line"), [("iso", "G64"), ("siemens", "G64"), ("linuxcnc", "G64 P0.005")])
def test_a_recording_of_straight_blocks_switches_exact_stop_off(dialect: str, line: str) -> None:
    """A Siemens control starts with G60: every one of the short blocks would end at rest."""
    machine = preset("table-bc")
    run = next(iter(rotary_circle(machine, axis="C", arrangement="radial", rate_hz=10.0)))
    lines = program(machine, run, dialect).splitlines()
    recorded = next(i for i, text in enumerate(lines) if "straight blocks" in text.casefold())
    assert line in lines[:recorded] and not {"G60", "G61"} & set(lines)
