"""The independent checker of plans: it passes a plan that is in order, finds every planted fault, and passes symfive's plans."""

import filecmp
import re
import shutil
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rs274
from lean import location_only

from symfive.design import plan
from symfive.errors import InputError
from symfive.machine import Machine as MachineFile
from symfive.machine import preset, presets, read_machine
from tests.plan_checker import check, read_plan, read_program
from tests.plan_checker.__main__ import main as checker
from tests.plan_checker._bodies import Cylinder, clearance
from tests.plan_checker._plan import Machine
from tests.plan_checker.dialects import DIALECTS
from tests.plan_checker.example import write_example
from tests.plan_checker.machines import random_machine
from tests.plan_checker.refusals import share_with_a_way_out

ROOT = Path(__file__).resolve().parent.parent
MACHINE = (ROOT / "designs" / "machines" / "table-bc.toml").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_example(tmp_path_factory.mktemp("plan"), MACHINE)


def test_a_plan_that_is_in_order_has_no_findings(good: Path) -> None:
    assert [str(finding) for finding in check(good)] == []


def edit(file: str, pattern: str, becomes: str, count: int = 1) -> Callable[[Path], None]:
    """Replaces text in one file of the plan; the pattern must be there."""

    def spoil(folder: Path) -> None:
        path = folder / file
        text, n = re.subn(pattern, becomes, path.read_text(encoding="utf-8"), count=count, flags=re.M | re.S)
        assert n, f"{pattern} is not in {file}"
        path.write_text(text, encoding="utf-8")

    return spoil


def swap_rows(folder: Path) -> None:
    path = folder / "nest.csv"
    head, a, b, c, *rest = path.read_text().splitlines()
    (_, b), (_, c) = b.split(",", 1), c.split(",", 1)
    times = [line.split(",", 1)[0] for line in path.read_text().splitlines()[2:4]]
    path.write_text("\n".join([head, a, f"{times[0]},{c}", f"{times[1]},{b}", *rest]) + "\n")


def no_blocks_between(file: str) -> Callable[[Path], None]:
    """All blocks but the last of the first way are taken out: one straight block from pose to pose."""
    return edit(file, r"(G4 X2\.000\n)(?:G1 [^\n]*\n)*(G1 [^\n]*\nG4)", r"\1\2")


FAULTS: dict[str, tuple[str, Callable[[Path], None]]] = {
    "a rapid plunges into the table": ("clearance", edit("nc/iso/nest.nc", r"^G0 Z\S+", "G0 Z-60.0000")),
    "a rapid leaves the travel": ("travel", edit("nc/iso/nest.nc", r"^G0 X\S+", "G0 X400.0000")),
    "a travel is shorter than the plan": ("travel",
        edit("machine.toml", r"(axes.Z.\ntravel = \[-100.0, )450.0", r"\g<1>300.0")),
    "a stop is removed": ("bar", edit("nc/iso/bar.nc", r"M0 \(Remove the bar\)\n", "")),
    "the bar is never mounted again": ("stop",
        edit("nc/siemens/bar.mpf", r'(Remove.*?)MSG\("Mount the bar"\)\nM0\nMSG\(\)\n', r"\1")),
    "a feed is twelve times as high": ("feed", edit("nc/iso/nest.nc", r"F900$", "F10800")),
    "one dialect is twice as fast": ("dialects", edit("nc/siemens/nest.mpf", r"F900$", "F1800", 0)),
    "every feed is twice as high": ("time", edit("nc/iso/nest.nc", r"F900$", "F1800", 0)),
    "a feed word is missing": ("feed", edit("nc/linuxcnc/nest.ngc", r" F900$", "")),
    "a Klartext feed is too high": ("feed", edit("nc/heidenhain/bar.h", r"( R0 F)(\d+)\.", r"\g<1>9\g<2>.", 0)),
    "the table is smaller": ("table", edit("machine.toml", r"table_radius = 150.0", "table_radius = 50.0")),
    "the table turns elsewhere": ("table",
        edit("machine.toml", r"(axes.C.\norigin = )\[0.0, 0.0", r"\1[250.0, 200.0")),
    "the ball stands too high": ("table",
        edit("machine.toml", r"ball_height = \[40.0, 160.0\]", "ball_height = [40.0, 90.0]")),
    "the nest opens less far than the tool leans": ("nest",
        edit("machine.toml", r"^\[workspace\]", "[workspace]\nnest_opening = 25.0")),
    "the first move is a five-axis rapid": ("first move", edit("nc/iso/nest.nc", r"G53 G0 Z0\n", "")),
    "a length is cancelled where the tool stands": ("first move", edit("nc/iso/nest.nc", r"^M5$", "M5\nG49")),
    "the plane moves before the rotary axes": ("first move",
        edit("nc/linuxcnc/bar.ngc", r"(G0 B[^\n]*\n)(G0 X[^\n]*\n)", r"\2\1")),
    "the tool goes down before the plane": ("first move",
        edit("nc/siemens/bar.mpf", r"(G0 X[^\n]*\n)(G0 Z[^\n]*\n)", r"\2\1")),
    "the tool axis stops half-way": ("first move",
        edit("nc/heidenhain/nest.h", r"L Z-1 R0 FMAX M91", "L Z-200 R0 FMAX M91")),
    "two rows are swapped": ("poses", swap_rows),
    "a pose is left out": ("poses", edit("nc/iso/nest.nc", r"G1 [^\n]*\nG4 X2.000\n(G1)", r"\1")),
    "a pose is off by a hundredth": ("poses", edit("nc/linuxcnc/nest.ngc", r"(B20\.00)0", r"\g<1>9")),
    "a length offset is on": ("poses", edit("nc/iso/bar.nc", r"^G54$", "G54 G43 H1")),
    "an axis turns the other way": ("poses", edit("nc/iso/bar.nc", r" C(-?)(\d)", r" C-\2", 0)),
    "no datum is called": ("modal", edit("nc/siemens/nest.mpf", r"^G54\n", "")),
    "tool-centre control may be on": ("modal", edit("nc/heidenhain/nest.h", r"^\d+ M129\n", "")),
    "LinuxCNC shows no text": ("stop", edit("nc/linuxcnc/bar.ngc", r"\(MSG, ", "(")),
    "Sinumerik shows no text": ("stop", edit("nc/siemens/bar.mpf", r"^MSG\(\"[^\n]*\n", "; mount the bar\n")),
    "the program ends with the bar on": ("stop",
        edit("nc/iso/bar.nc", r"M0 \(Remove the bar\)(?!.*M0)", "M0 (Check the readings)")),
    "a datum is called under the bar": ("stop", edit("nc/iso/bar.nc", r"(M0 \(Mount the bar\)\n)", r"\1G55\n")),
    "inverse time stays on": ("end", edit("nc/linuxcnc/bar.ngc", r"^G94\n", "")),
    "the tool stays down": ("end", edit("nc/siemens/bar.mpf", r"SUPA G0 Z0\nG94", "G94")),
    "the bar is longer": ("bar", edit("campaign.toml", r"length = 100.0", "length = 103.0")),
    "the ball is dragged through its nest": ("nest", no_blocks_between("nc/iso/nest.nc")),
    "the bar is stretched on the way": ("bar", no_blocks_between("nc/iso/bar.nc")),
    "a rapid into the nest": ("nest", edit("nc/iso/nest.nc", r"^G1( X[^\n]*) F10$", r"G0\1")),
    "a rapid with the bar on": ("bar", edit("nc/iso/bar.nc", r"^G1( X[^\n]*) F900$", r"G0\1")),
    "the nose reaches low": ("clearance",
        edit("machine.toml", r"radius = 40.0, above_ball = 60.0", "radius = 300.0, above_ball = -40.0")),
    "the tool is as thick as the post": ("clearance",
        edit("machine.toml", r"\[workspace\]", "[workspace]\npost_radius = 60.0\ntool_radius = 60.0")),
    "a vice stands in the way": ("clearance",
        edit("machine.toml", r"^\[workspace\]", "[workspace]\nobstacles = {vice = [[-90.0, -90.0, 0.0], [90.0, 90.0, 120.0]]}")),
    "the minutes are those of another plan": ("time", edit("plan.json", r"[\d.]+", "20.0")),
    "the sheet puts the ball elsewhere": ("sheet", edit("setup.html", "x = 80", "x = 85")),
    "the sheet names another tool": ("sheet", edit("setup.html", "150 mm below", "155 mm below")),
    "the sheet shows another pose": ("sheet", edit("setup.html", r'(<td class="n">)-30.000', r"\1-31.000")),
    "the sheet leaves a pose out": ("sheet", edit("setup.html", r'<tr><td class="n">2.*?</tr>', "")),
    "an axis turns further than the sheet says": ("sheet", edit("setup.html", r"from -30° to", "from -29° to")),
    "the sheet says no tool length": ("sheet", edit("nc/linuxcnc/bar.ngc", r"^G54$", "G54 G43 H1")),
    "the spindle nose is thick": ("clearance",
        edit("machine.toml", r"radius = 40.0, above_ball = 60.0", "radius = 250.0, above_ball = 2.0")),
    "more decimals than the control keeps": ("program", edit("nc/iso/nest.nc", r"^(G0 X\S+)", r"\g<1>5")),
    "a code that nobody knows": ("program", edit("nc/iso/nest.nc", r"^G54$", "G54 G68.2")),
    "a program is missing": ("program", lambda folder: (folder / "nc" / "iso" / "bar.nc").unlink()),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_found(good: Path, tmp_path: Path, fault: str) -> None:
    kind, spoil = FAULTS[fault]
    folder = tmp_path / "plan"
    shutil.copytree(good, folder)
    spoil(folder)
    for programs in (folder / "nc").iterdir():  # beside the spoilt ones those of one dialect
        if programs.name != "iso" and not filecmp.dircmp(good / "nc" / programs.name, programs).diff_files:
            shutil.rmtree(programs)
    found = check(folder)
    assert kind in {finding.check for finding in found}, "\n".join(map(str, found))
    assert all(re.search(r"\w", finding.says) and finding.file.is_relative_to(folder) for finding in found)


def test_cylinders_keep_apart_by_their_distance() -> None:
    """Lines and cylinders whose distance is known: parallel, crossed, one above the other, an edge over an edge, one inside."""
    up, along = [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]
    for start, axis, length, radius, distance in (
        ([5.0, 0.0, 0.0], up, 10.0, 1.0, 2.0), ([5.0, 0.0, 0.0], up, 10.0, 3.0, 0.0), ([-9.0, 4.5, 5.0], along, 20.0, 0.0, 2.5),
        ([0.0, 0.0, 13.0], up, 4.0, 8.0, 3.0), ([2.0 + 3.0, 0.0, 14.0], up, 4.0, 0.0, 5.0), ([0.0, 0.0, 5.0], up, 1.0, 0.0, -2.0),
    ):  # fmt: skip
        a = Cylinder(np.array([[0.0, 0.0, 0.0]]), np.array([up]), np.array([10.0]), 2.0)
        b = Cylinder(np.array([start]), np.array([axis]), np.array([length]), radius)
        assert clearance(a, b, near=100.0)[0] == pytest.approx(distance, abs=1e-3)


def test_arcs_have_their_length_and_place(good: Path, tmp_path: Path) -> None:
    """Two turns of a circle of 150 mm by I J and P, by TURN, and about a pole; each at 1000 mm/min."""
    good_plan = read_plan(good)
    programs = {
        "linuxcnc": "G53 G0 Z0\nG0 B0 C0\nG0 X-150 Y0\nG94\nG3 X-150 Y0 I150 J0 P2 F1000\n",
        "siemens": "SUPA G0 Z0\nG0 B0 C0\nG0 X-150 Y0\nG94\nG3 X-150 Y0 I150 J0 TURN=1 F1000\n",
        "iso": "G53 G0 Z0\nG0 B0 C0\nG0 X-150 Y0\nG94\nG2 X150 Y0 I150 J0 F1000\nG2 X-150 Y0 I-150 J0\nG2 X-150 Y0 I150 J0\n",
        "heidenhain": "1 L Z-1 R0 FMAX M91\n2 L B+0 C+0 R0 FMAX\n3 L X-150 Y+0 R0 FMAX\n4 CC X+0 Y+0\n5 CP IPA+720 DR+ F1000\n",
    }
    for dialect, text in programs.items():
        file = tmp_path / f"arc{DIALECTS[dialect].suffix}"
        file.write_text(text)
        path = read_program(good_plan.machine, good_plan.runs[0], file, dialect)
        assert not path.control.findings
        feeds = [event for event in path.events if event.kind == "feed"]
        assert sum(event.seconds for event in feeds) == pytest.approx(
            2.0 * 2.0 * np.pi * 150.0 / 1000.0 * 60.0, rel=1e-9
        )
        x, y = (path.q[:, good_plan.machine.names.index(name)] for name in "XY")
        arcs = np.isin(path.owner, [i for i, event in enumerate(path.events) if event.kind == "feed"])
        assert np.ptp(np.hypot(x[arcs], y[arcs])) < 1e-9
        assert [y[arcs].min(), y[arcs].max()] == pytest.approx([-150.0, 150.0], abs=0.1)


@pytest.mark.linuxcnc
@rs274.needed
def test_linuxcncs_interpreter_reads_the_same_positions(good: Path) -> None:
    good_plan = read_plan(good)
    for run in good_plan.runs:
        file = good / "nc" / "linuxcnc" / f"{run.table['id']}.ngc"
        theirs = rs274.straight_moves(file)
        theirs = theirs[theirs[:, 2] != 0.0][:, [0, 1, 2, 4, 5]]  # without what is at the top, Z 0 of the machine
        path = read_program(good_plan.machine, run, file, "linuxcnc")
        order = [good_plan.machine.names.index(name) for name in "XYZBC"]
        mine = np.array(
            [
                event.end[order]
                for event in path.events
                if event.motion and not event.machine and np.isfinite(event.end).all()
            ]
        )
        mine = mine[mine[:, 2] != good_plan.machine.top]
        assert len(mine) > 50 and np.abs(theirs[-len(mine) :] - mine).max() <= 1e-4


QUICK = [("three-axis", "ball_bar"), pytest.param("table-bc", "r_test", marks=pytest.mark.slow)]
READY = sorted(path.parent for path in (ROOT / "designs" / "plans").glob("*/campaign.toml"))


def made(folder: Path, machine: MachineFile, instrument: str, points: int, starts: int = 1) -> Path:
    """A plan of symfive's with programs of all dialects; the checker asks for no proof that it is the best."""
    found = plan(machine, instrument=instrument, points=points, starts=starts, anywhere=False, prove=False)
    found.write(folder, nc=tuple(DIALECTS))
    return folder


def in_order(folder: Path) -> bool:
    """No findings, and LinuxCNC's interpreter takes the programs where it is installed; what is wrong is printed."""
    found = check(folder)
    print(*found, sep="\n")
    if rs274.INSTALLED:
        for file in (folder / "nc").glob("linuxcnc/*"):
            rs274.canonical(file)
    return not found


@pytest.mark.parametrize(("name", "instrument"), QUICK)
def test_a_quick_plan_is_in_order(name: str, instrument: str, tmp_path: Path) -> None:
    assert in_order(made(tmp_path / "plan", location_only(name), instrument, 6))


@pytest.mark.slow
@pytest.mark.parametrize(("instrument", "high"), [("r_test", 90.0), ("ball_bar", 170.0)])
def test_a_plan_keeps_off_what_stands_on_the_table(instrument: str, high: float, tmp_path: Path) -> None:
    """Without the box in its machine file the plan is one that meets it."""
    machine = location_only("table-bc")
    boxes = {"vice": ((20.0, -60.0, 0.0), (120.0, 60.0, high)), "nests": ((-120.0, 30.0, 0.0), (-60.0, 120.0, high))}
    obstructed = replace(machine, workspace=replace(machine.workspace, obstacles=boxes), text="")
    kept = made(tmp_path / "plan", obstructed, instrument, 8)
    assert in_order(kept)
    assert "vice (a box)" in (kept / "setup.html").read_text(encoding="utf-8")
    free = made(tmp_path / "free", machine, instrument, 8)
    shutil.copy(kept / "machine.toml", free / "machine.toml")
    assert any(f"and {name} " in finding.says for finding in check(free) for name in boxes)


@pytest.mark.slow
@pytest.mark.parametrize("instrument", ["r_test", "ball_bar"])
@pytest.mark.parametrize("name", presets())
def test_every_preset_with_default_points_is_in_order(name: str, instrument: str, tmp_path: Path) -> None:
    try:
        folder = made(tmp_path / "plan", preset(name), instrument, 40, starts=2)
    except InputError as refusal:
        pytest.skip(f"refused: {refusal}")
    assert in_order(folder)


OFF_CENTRE = {
    "table": (r"(axes.C.\norigin = )\[[^]]*\]", r"\1[250.0, 200.0, 0.0]"),
    "a little": (r"(axes.C.\norigin = )\[[^]]*\]", r"\1[30.0, -20.0, 0.0]"),
    "cradle": (r"(axes.B.\norigin = )\[[^]]*\]", r"\1[20.0, 0.0, -60.0]"),
    "nutating": (r"\[axes.B\]", "[axes.B]\ndirection = [0.0, 1.0, 1.0]"),
    "tilted": (r"\[axes.C\]", "[axes.C]\ndirection = [0.0, 0.1, 1.0]"),
    "centre": (r"\[workspace\]", "[workspace]\ntable_centre = [40.0, 30.0]"),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "instrument"),
    [(where, instrument) for where in OFF_CENTRE for instrument in ("r_test", "ball_bar")],
)
def test_tables_that_turn_elsewhere_are_in_order(where: str, instrument: str, tmp_path: Path) -> None:
    text, n = re.subn(*OFF_CENTRE[where], MACHINE, count=1)
    assert n == 1
    text = re.sub(r"travel = \[-(300|250).0, (300|250).0\]", "travel = [-700.0, 700.0]", text)
    (tmp_path / "machine.toml").write_text(text, encoding="utf-8")
    assert in_order(made(tmp_path / "plan", read_machine(tmp_path / "machine.toml"), instrument, 12))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [64, 76, 142])
def test_a_ball_leaves_its_nest_upwards(seed: int, tmp_path: Path) -> None:
    """Machines whose tables tilt so far that up in the machine is down for the nest."""
    file = tmp_path / f"{seed}.toml"
    file.write_text(random_machine(seed), encoding="utf-8")
    assert in_order(made(tmp_path / str(seed), read_machine(file), ("r_test", "ball_bar")[seed % 2], 10))


@pytest.mark.slow
@pytest.mark.parametrize("first", [0, 5, 25, 35])
def test_random_machines_are_in_order_or_refused(first: int, tmp_path: Path) -> None:
    """Four machines each (`--random` of the checker takes more). A refusal is one sentence; no way, no clear random pose."""
    refused = []
    for seed in range(first, first + 4):
        file = tmp_path / f"{seed}.toml"
        file.write_text(random_machine(seed), encoding="utf-8")
        try:
            folder = made(tmp_path / str(seed), read_machine(file), ("r_test", "ball_bar")[seed % 2], 10)
        except InputError as refusal:
            assert "\n" not in str(refusal)
            refused.append(f"{seed}: {refusal}")
            if "way" in str(refusal):
                assert share_with_a_way_out(Machine(tomllib.loads(file.read_text(encoding="utf-8")))) < 0.1, refused
            continue
        assert in_order(folder), f"machine {seed}"
    print(*refused, sep="\n")
    assert len(refused) < 3, refused


@pytest.mark.slow
@pytest.mark.parametrize("folder", READY, ids=[folder.name for folder in READY])
def test_the_ready_plans_are_in_order(folder: Path) -> None:
    assert in_order(folder)


def test_the_command_ends_with_one_where_there_are_findings(
    good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoilt = tmp_path / "spoilt"
    shutil.copytree(good, spoilt)
    FAULTS["a rapid plunges into the table"][1](spoilt)
    assert checker([str(good)]) == 0
    assert checker([str(spoilt)]) == 1
    assert "spindle nose and table meet by" in capsys.readouterr().out


@pytest.mark.slow
def test_circles_of_random_machines_are_in_order(capsys: pytest.CaptureFixture[str]) -> None:
    """`python -m tests.plan_checker --random 0 40 --circles` takes more."""
    assert checker(["--random", "0", "4", "--circles"]) == 0
    assert capsys.readouterr().out.split() == [word for n in range(4) for word in (f"{n}:", "0", "findings")]
