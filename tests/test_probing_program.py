"""The probing program read again: every touch aims at the sphere, every way around it keeps off, logs give the centres back."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import plant
import pytest
import rs274
from lean import location_only

from symfive.campaign import Campaign, Run, read_campaign, write_campaign
from symfive.cli import main
from symfive.design import plan
from symfive.design._candidates import candidates_in, setup_options  # what a plan chooses from
from symfive.design._reach import Reach  # as above
from symfive.design._space import make_space  # as above
from symfive.errors import InputError
from symfive.importers.touch_log import fitted_centres, probed_run, read_touches
from symfive.machine import Machine, preset
from symfive.moves import cleared
from symfive.nc import DIALECTS, Post, Probing, arrival_times, program, write_programs
from symfive.procedures import Nominal
from tests.plan_checker import check, read_plan, read_program

PROBING = Probing(sphere_radius=10.0, tip_radius=2.0, clearance=4.0, overtravel=1.5)
SPHERE, TIP = (80.0, -30.0, 120.0), (0.0, 0.0, -150.0)


POST = Post(probe_tool=30)
PROBING_DIALECTS = tuple(name for name, dialect in DIALECTS.items() if dialect.cycle is not None)


def probe_run(name: str, **options) -> tuple:
    machine = preset(name)
    angles = {"B": np.array([0.0, 40.0, -35.0]), "C": np.array([0.0, 100.0, -70.0])}
    commands = Nominal(machine).follow(np.tile(SPHERE, (3, 1)), TIP, angles, "the test")
    run = Run(
        id="sphere-1", instrument=("touch_probe",), sampling="static", time=np.arange(3.0) * 40.0, commands=commands,
        table_ball=SPHERE, tool_ball=TIP, options=options,
    )  # fmt: skip
    return machine, run


def moves(machine, run, text: str):
    """(code, tip relative to the sphere in mm) of every block with a feed; arithmetic on a contact stands for the contact."""
    data_axes = {n: {"origin": list(a.origin), "direction": list(a.direction)} for n, a in machine.axes.items()}
    chain = plant.parse_structure(machine.structure.code, data_axes)
    place: dict[str, float] = {}
    aimed = np.zeros(3)
    for line in text.splitlines():
        found = re.match(r"(G0|G1|G38\.2|G38\.3) (.*)", line)
        if not found or "[" in line:
            continue
        place |= {a: float(v) for a, v in re.findall(r"([XYZABC])(-?[\d.]+)", found[2])}
        if set(place) < set(machine.axis_names):
            continue
        q = {a.name: np.array([np.deg2rad(place[a.name]) if a.rotary else place[a.name]]) for a in chain.axes}
        aimed = plant.ball_in_workpiece(chain, q, run.tool_ball)[0] - np.asarray(run.table_ball)
        yield found[1], aimed, line


@pytest.mark.parametrize("name", ["table-bc", "mixed-bc", "head-bc"])
def test_touches_aim_at_the_sphere_and_ways_keep_off(name):
    machine, run = probe_run(name)
    text = program(machine, run, "linuxcnc", Post(), PROBING)
    reach = PROBING.sphere_radius + PROBING.tip_radius
    before, touches = None, 0
    for code, at, line in moves(machine, run, text):
        if code == "G38.2":
            assert np.linalg.norm(at) == pytest.approx(reach - PROBING.overtravel, abs=1e-4), line
            assert np.linalg.norm(before) == pytest.approx(reach + PROBING.clearance, abs=1e-4), line
            assert np.cross(at, before) == pytest.approx(np.zeros(3), abs=1e-3), line
            touches += line.endswith("F30")
            continue  # a touch ends on the sphere and goes back to where it began
        if before is not None and code in ("G1", "G38.3"):
            way = before + np.linspace(0.0, 1.0, 101)[:, None] * (at - before)
            assert np.linalg.norm(way, axis=1).min() > reach + 0.9 * PROBING.clearance, line
        before = at
    assert touches == 5 * run.rows == text.count("(LOG,")
    assert len(re.findall(r"G38\.3", text)) >= 2 * touches - run.rows


def off_the_post(machine, run, post: float) -> float:
    """Least gap, mm, of a tip of 3 mm on a sphere of 12.5 mm from its post, which ends in the sphere or, where it is thicker than
    that, 15 mm under its centre."""
    end = np.sqrt(12.5**2 - post**2) if post < 12.5 else 15.0
    gaps, before = [], None
    for code, at, _ in moves(machine, run, program(machine, run, "linuxcnc", cleared(machine, (run,), {}))):
        if code == "G38.2":
            at = at * 15.5 / np.linalg.norm(at)  # it stops on contact
        if before is not None:
            tip = before + np.linspace(0.0, 1.0, 101)[:, None] * (at - before)
            below = tip[:, 2] + end
            beside = np.linalg.norm(tip[:, :2], axis=1) - post
            gaps.append(np.hypot(np.maximum(below, 0.0), np.maximum(beside, 0.0)).min() - 3.0)
        before = at
    return min(gaps)


def on_a_post(radius: float) -> Machine:
    machine = location_only("table-bc")
    return replace(machine, workspace=replace(machine.workspace, post_radius=radius))


@pytest.fixture(scope="module")
def planned() -> Run:
    """For a post that reaches high into its sphere, so that the probe leans least."""
    options = {"setups": 1, "starts": 1, "anywhere": False, "prove": False}
    return plan(on_a_post(10.0), instrument="touch_probe", points=4, **options).campaign.runs[0]


@pytest.mark.parametrize("post", [1.0, 10.0, 14.0])
def test_touches_keep_off_the_post(planned, post):
    assert off_the_post(on_a_post(post), planned, post) > -1e-3


def test_a_post_that_touches_meet_is_refused(planned):
    with pytest.raises(InputError, match="tip and post on every exit path"):
        cleared(on_a_post(11.5), (planned,), {})


def test_every_pose_offered_keeps_the_stem_off_a_thick_post():
    machine = preset("head-bc")
    machine = replace(machine, workspace=replace(machine.workspace, post_radius=8.0, tool_radius=6.0))
    space = make_space(machine, "touch_probe")
    setups, lengths = setup_options(space)
    tilted = [
        [0.0, np.radians(b)] if space.names[0] == "C" else [np.radians(b), 0.0] for b in np.arange(26.0, 52.0, 2.0)
    ]
    offered = candidates_in(space, setups[:1], lengths[:1], np.array(tilted))
    assert 0 < len(offered) < len(tilted)
    assert not any("post" in what for what in Reach(space).in_the_way(offered.z, offered.k))


def test_rapids_keep_off_a_large_sphere():
    machine, run = probe_run("table-bc")
    machine = replace(machine, workspace=replace(machine.workspace, sphere_radius=46.0, tip_radius=4.0))
    for post in (cleared(machine, (run,), {}), Post()):  # the ways of a plan, and the usual ones
        before, text = None, program(machine, run, "linuxcnc", post)
        for code, at, line in moves(machine, run, text[: text.rindex("G53 G0")]):  # from there on Z is at the top
            if before is not None and code == "G0":
                way = before + np.linspace(0.0, 1.0, 101)[:, None] * (at - before)
                assert np.linalg.norm(way, axis=1).min() > 46.0 + 4.0 + 4.9, line
            before = at


@pytest.mark.linuxcnc
@rs274.needed
def test_the_control_reads_it(tmp_path):
    machine, run = probe_run("table-bc")
    (tmp_path / "probe.ngc").write_text(program(machine, run, "linuxcnc", Post(), PROBING))
    assert rs274.canonical(tmp_path / "probe.ngc").count("STRAIGHT_PROBE") == 19 * run.rows


def written(folder: Path, name: str = "table-bc", **options) -> tuple:
    """Campaign and programs of all controls."""
    machine, run = probe_run(name, **options)
    run = replace(run, time=arrival_times(machine, run, Post()))
    campaign = Campaign(machine=machine, runs=(run,))
    write_campaign(campaign, folder)
    write_programs(campaign, folder / "nc", PROBING_DIALECTS, POST)
    return machine, run


@pytest.mark.parametrize("name", ["table-bc", "mixed-bc", "head-bc"])
def test_programs_of_all_controls_pass_the_independent_checker(tmp_path, name):
    written(tmp_path, name)
    assert [str(finding) for finding in check(tmp_path)] == []


GUARD = r"(?<=\n)G31 (X[^\n]*F2000)\nIF[^\n]*"
FAULTS = {
    "iso: a move towards the sphere that does not stop": ("iso/sphere-1.nc", GUARD, r"G1 \1", "probing"),
    "iso: a guarded move nobody looks at": ("iso/sphere-1.nc", r"(G31 [^\n]*F2000\n)IF[^\n]*\n", r"\1", "probing"),
    "iso: compared with another place": ("iso/sphere-1.nc", r"IF\[\[ABS\[#5061-80", "IF[[ABS[#5061-81", "probing"),
    "iso: a touch that nobody looks at": ("iso/sphere-1.nc", r"\nIF[^\n]*LT[^\n]*", "", "probing"),
    "iso: the wrong row in the log": ("iso/sphere-1.nc", r"DPRNT\[R1T2", "DPRNT[R2T2", "touch"),
    "iso: nine digits": ("iso/sphere-1.nc", r"X#5061\[44\]", "X#5061[54]", "program"),
    "iso: a log that is not open": ("iso/sphere-1.nc", r"\nPOPEN", "", "touch"),
    "iso: a rotary axis turns at the sphere": ("iso/sphere-1.nc", r"(?<=\n)(DPRNT\[R0T0)", r"G1 B1. F500\n\1", "clear"),
    "iso: a rapid at the sphere": ("iso/sphere-1.nc", r"(DPRNT\[R0T1[^\n]*\n)G1", r"\1G0", "clear"),
    "iso: touched beside the centre": ("iso/sphere-1.nc", r"G31 X92.5000 Y-30", "G31 X92.5000 Y-29", "touch"),
    "siemens: MEAS left out": ("siemens/SPHERE_1.mpf", r"MEAS=1 (G1 [^\n]*F2000)\nSTOPRE\nIF[^\n]*", r"\1", "probing"),
    "siemens: a label that is not there": ("siemens/SPHERE_1.mpf", r"NO_CONTACT: MSG", "NO_TOUCH: MSG", "probing"),
    "siemens: two logs": ("siemens/SPHERE_1.mpf", r'DELETE\(FAULT,"SPHERE_1_LOG"', 'DELETE(FAULT,"OTHER"', "touch"),
    "siemens: no second touch": ("siemens/SPHERE_1.mpf", r"MEAS=1 G1 [^\n]*F30\nSTOPRE\n[^\n]*\n", "", "touch"),
    "heidenhain: the guard left out": ("heidenhain/sphere-1.h", r"\n\d+ FN 10:[^\n]*", "", "probing"),
    "heidenhain: another way": ("heidenhain/sphere-1.h", r"ABST\+18.5000", "ABST+18.0000", "touch|dialects"),
    "heidenhain: a label that is not there": ("heidenhain/sphere-1.h", r"\d+ LBL 98\n", "", "probing"),
    "heidenhain: the probe's length left in": ("heidenhain/sphere-1.h", r"\d+ CYCL DEF 7.1 Z-Q114\n", "", "dialects|end|clear"),
    "heidenhain: the mask is not there": ("heidenhain/TOUCHES.A", r"Q1,Q2", "Q2,Q1", "touch"),
    "linuxcnc: a move towards the sphere": ("linuxcnc/sphere-1.ngc", r"G38\.3", "G1", "probing"),
    "linuxcnc: a touch left out": ("linuxcnc/sphere-1.ngc", r"G38\.2 [^\n]*F30\n", "", "touch"),
}  # fmt: skip


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("probing")
    written(folder)
    return folder


@pytest.mark.parametrize("fault", FAULTS)
def test_the_checker_finds_planted_faults(good, tmp_path, fault):
    file, pattern, becomes, check_name = FAULTS[fault]
    folder = shutil.copytree(good, tmp_path / "plan")
    path = folder / "nc" / file
    text, n = re.subn(pattern, becomes, path.read_text(), count=1)
    assert n == 1, f"{pattern} is not in {file}"
    path.write_text(text)
    found = [finding.check for finding in check(folder)]
    assert re.search(check_name, " ".join(found)), found


LINES = {
    "linuxcnc": "{row},{touch},{0:.6f},{1:.6f},{2:.6f}",
    "iso": "R{row}T{touch}X{0: 9.4f}Y{1: 9.4f}Z{2: 9.4f}",
    "siemens": "R{row} T{touch} X{0} Y{1} Z{2}",
    "heidenhain": "R{row} T{touch} X{0:.5f} Y{1:.5f} Z{2:.5f}",
}
"""How each control prints a touch."""


@pytest.mark.parametrize("dialect", LINES)
def test_what_a_control_logs_comes_back_as_the_centres(good, tmp_path, dialect):
    """The checker drives the program against its sphere, moved a little, and prints; the import finds where it stood."""
    plan = read_plan(good)
    (run,), off = plan.runs, np.array([0.4, -0.3, 0.2])
    table = {**run.table, "table_ball": (run.table_ball + off).tolist()}
    path = read_program(plan.machine, replace(run, table=table), plan.programs()[dialect]["sphere-1"], dialect)
    lines, contact = [], None
    for event in path.events:
        contact = event.end if event.probing == "touch" else contact
        if event.kind == "log":
            row, touch = event.text.split(",")
            places = [float(contact[plan.machine.names.index(axis)]) for axis in "XYZ"]
            lines.append(LINES[dialect].format(*places, row=row, touch=touch))
    log = tmp_path / "log.txt"
    log.write_text("\x12%\r\n" + "\r\n".join(lines) + "\r\n%\x14")
    probed = probed_run(read_campaign(good).runs[0], read_touches(log))
    assert probed.run.rows == 3 and probed.rms_um < 0.1
    assert probed.radius == pytest.approx(15.5, abs=1e-4)
    moved = np.stack([probed.run.readings[f"{n}_dev_um"] for n in "XYZ"], axis=1)
    assert np.linalg.norm(moved, axis=1) == pytest.approx(1e3 * np.linalg.norm(off), abs=0.2)


def test_touches_from_below_and_tool_centre_control_are_refused():
    below = [[0, 0, 1], [1, 0, 0], [-1, 0, -0.2], [0, 1, 0], [0, -1, 0]]
    machine, run = probe_run("table-bc", touches=below)
    for dialect in PROBING_DIALECTS:
        with pytest.raises(InputError, match="below the sphere's equator"):
            program(machine, run, dialect, POST)
    machine, run = probe_run("table-bc")
    with pytest.raises(InputError, match="siemens: under tool-centre control"):
        program(machine, run, "siemens", Post(tool_centre=True))


def test_a_touch_beyond_the_travel_is_refused():
    machine, run = probe_run("table-bc")
    axis = machine.axes["X"]
    end = float(np.max(run.commands["X"])) + 10.0  # the pose is within, the touch from +X is not
    narrow = replace(machine, axes={**machine.axes, "X": replace(axis, travel=(axis.travel[0], end))}, text="")
    with pytest.raises(InputError, match=rf"takes X to .*, a plan uses -298 to {end - 2.0:g} of its"):
        program(narrow, run, "iso")


def test_a_heidenhain_is_told_which_tool_the_probe_is(tmp_path):
    machine, run = probe_run("table-bc")
    with pytest.raises(InputError, match="give --probe-tool"):
        program(machine, run, "heidenhain")
    lines = program(machine, run, "heidenhain", POST).splitlines()
    assert [line.split(" ", 1)[1] for line in lines if "TOOL CALL" in line and ";" not in line] == ["TOOL CALL 30 Z"]
    bare = [line.split(" ", 1)[1] for line in lines]
    assert bare.index("STOP M0") < bare.index(
        "TOOL CALL 30 Z"
    )  # it changes the tool where another one is in the spindle
    call = ["plan", "table-bc", "-o", str(tmp_path / "p"), "--instrument", "touch_probe", "--nc", "heidenhain"]
    assert main(call) == 2 and not (tmp_path / "p").exists()


def test_the_users_lines_switch_the_probe_on_and_off():
    machine, run = probe_run("table-bc")
    lines = program(machine, run, "iso", Post(probe_on="M60", probe_off="M61"), PROBING).splitlines()
    first, last = lines.index("M60"), lines.index("M61")
    assert first < min(i for i, line in enumerate(lines) if line.startswith("G91 G28"))
    assert last > max(i for i, line in enumerate(lines) if line.startswith(("G31", "G0", "G1")))


def test_a_touch_probes_sizes_are_positive():
    with pytest.raises(InputError, match="back_off = 0"):
        Probing(back_off=0.0)


def test_centres_of_a_log(tmp_path):
    _, run = probe_run("table-bc")
    rng = np.random.default_rng(2)
    off = rng.normal(0.0, 0.1, (3, 3))
    centres = np.stack([run.commands[n] for n in "XYZ"], axis=1) + off
    directions = np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], float)
    lines = []
    for row, centre in enumerate(centres):
        for k, n in enumerate(directions):  # the equator is touched a little off the sphere's own
            side = np.array([0.03, -0.02, 0.05]) * (1.0 - np.abs(n))
            at = centre + side + n * np.sqrt(15.5**2 - side @ side)
            lines.append(f"{row},{k},{at[0]:.9f},{at[1]:.9f},{at[2]:.9f}")
    (tmp_path / "log.txt").write_text("\n".join([lines[3].replace("0,3,", "0,3,9"), *lines]) + "\n")
    found, radius, rms = fitted_centres(read_touches(tmp_path / "log.txt"))
    assert radius == pytest.approx(15.5, abs=1e-7) and rms < 1e-7
    assert found == pytest.approx(centres, abs=1e-7)
    probed = probed_run(run, read_touches(tmp_path / "log.txt"))
    assert str(probed) == (
        "run sphere-1: 3 centres, effective radius of sphere and tip 15.5000 mm, touches 0.0 µm (rms) off that sphere"
    )
    readings = probed.run.readings
    assert np.stack([readings[f"{n}_dev_um"] for n in "XYZ"], axis=1) == pytest.approx(1e3 * off, abs=1e-4)


def log_of(run: Run, rows: range, *, off: float = 0.0) -> list[str]:
    directions = np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], float)
    centres = np.stack([run.commands[n] for n in "XYZ"], axis=1)
    places = [(row, k, centres[row] + 15.5 * n + off) for row in rows for k, n in enumerate(directions)]
    return ["R{} T{} X{:.5f} Y{:.5f} Z{:.5f}".format(row, k, *at) for row, k, at in places]


def test_a_log_that_ends_early_gives_the_poses_before(tmp_path):
    _, run = probe_run("table-bc")
    (tmp_path / "log.txt").write_text("\n".join(log_of(run, range(3))[:12]))
    probed = probed_run(run, read_touches(tmp_path / "log.txt"))
    assert probed.run.rows == 2 and "the log ends before pose 3 of 3" in str(probed)
    (tmp_path / "log.txt").write_text("\n".join([*log_of(run, range(3))[:12], "R2 T2 X-21."]))  # broken within a line
    assert probed_run(run, read_touches(tmp_path / "log.txt")).run.rows == 2


def changed(line: str) -> str:
    return re.sub(r"X(\S+)", lambda found: f"X{float(found[1]) + 0.7:.4f}", line)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda lines: ["0,0,1,2"], "line 1.*is not a touch"),
        (lambda lines: ["0,0,1,2,nan"], "line 1.*is not a touch"),
        (lambda lines: ["%"], "has no touches"),
        (lambda lines: [*lines[:6], "R1 T1 X-21.", *lines[7:]], "line 7.*is not a touch"),
        (lambda lines: lines[:3], "the log has 0 whole poses"),
        (lambda lines: lines[:4] + lines[5:], "pose 1 of run sphere-1 has 4 touches in the log, 5 are planned"),
        (lambda lines: lines[5:], "pose 1 of run sphere-1 has 0 touches"),
        (lambda lines: [*lines, lines[0].replace("R0", "R7")], "pose 8; run sphere-1 has 3"),
        (lambda lines: [*lines[:6], changed(lines[6]), *lines[7:]], "touches at pose 2 of run sphere-1 are 0.[23]"),
    ],
)
def test_a_broken_log_is_refused(tmp_path, spoil, words):
    _, run = probe_run("table-bc")
    (tmp_path / "log.txt").write_text("\n".join(spoil(log_of(run, range(3)))))
    with pytest.raises(InputError, match=words):
        probed_run(run, read_touches(tmp_path / "log.txt"))


def test_another_spheres_log_is_refused(tmp_path):
    _, run = probe_run("table-bc")
    (tmp_path / "log.txt").write_text("\n".join(log_of(run, range(3), off=80.0)))
    with pytest.raises(InputError, match=r"80\.0 mm from where the plan has it"):
        probed_run(run, read_touches(tmp_path / "log.txt"))


def test_a_log_is_imported_on_the_command_line(good, tmp_path, capsys):
    run = read_campaign(good).runs[0]
    (tmp_path / "log.txt").write_text("\n".join(log_of(run, range(3), off=0.02)))
    call = ["import-touches", str(good), str(tmp_path / "log.txt"), "-o", str(tmp_path / "measured")]
    assert main(call) == 0
    assert "effective radius of sphere and tip 15.5000 mm" in capsys.readouterr().err
    measured = read_campaign(tmp_path / "measured").runs[0]
    assert measured.readings["X_dev_um"] == pytest.approx(20.0, abs=0.01)
    assert main([*call[:2], str(tmp_path / "none.txt"), "-o", str(tmp_path / "other")]) == 2
    assert not (tmp_path / "other").exists()
