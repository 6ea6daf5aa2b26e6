"""The loop through LinuxCNC: its parts, the whole story on a control made of the compiled component, and on LinuxCNC itself."""

import ctypes
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from processes import PATIENCE_S, ended, gone, until

from examples.linuxcnc_loop import controller, loop, poses, write
from examples.linuxcnc_loop.baseline import with_error_motions
from examples.linuxcnc_loop.configuration import TCP_OFF, hal_text, ini_text, joint_letters, tcp_on
from examples.linuxcnc_loop.controller import PREFIX, Controller, Recording, setp_lines
from examples.linuxcnc_loop.deviation import measured_deviation, true_deviation
from examples.linuxcnc_loop.poses import held_out_run, joints_at_poses, plant_run, pose_lines
from examples.linuxcnc_loop.truth import MotionCurve, drawn_machine, measure
from symfive.campaign import read_campaign
from symfive.codegen import codegen, subject_of
from symfive.codegen.linuxcnc import WORLD, pin_names
from symfive.design import Plan, plan
from symfive.errors import InputError
from symfive.machine import Machine, machine_to_data, preset
from symfive.procedures import r_test_grid

ROOT = Path(__file__).resolve().parent.parent

GRID = {"B": [-60.0, 0.0, 60.0], "C": [0.0, 90.0, 180.0, 270.0]}


def grid_run(machine=None):
    [run, _] = r_test_grid(machine or preset("table-bc"), grid=GRID, returning=False)
    return run


# --- the parts -------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["table-bc", "tsutsumi-2007", "head-bc"])
def test_the_configuration_names_every_axis_once(name) -> None:
    machine = preset(name)
    letters = joint_letters(machine)
    ini, hal = ini_text(machine, "sf"), hal_text(machine, "sf", ["setp sfkins.EX0C 12.5"])
    assert f"COORDINATES = {' '.join(letters)}\n" in ini
    for joint, letter in enumerate(letters):
        [block] = re.findall(rf"\[JOINT_{joint}\]\n(.*?)(?:\n\n|\Z)", ini, re.DOTALL)
        low = float(re.search(r"MIN_LIMIT = (\S+)", block)[1])
        assert low == machine.axes[letter].travel[0] - 1.0
        assert ("ANGULAR" in block) == machine.axes[letter].rotary
        assert hal.count(f"joint.{joint}.motor-pos-cmd => joint.{joint}.motor-pos-fb sampler.0.pin.{joint + 1}") == 1
    assert "motion.tooloffset.z => sfkins.tool-offset" in hal and "setp sfkins.EX0C 12.5" in hal


def test_joints_are_taken_where_the_control_stood_at_each_pose() -> None:
    text = "G0 X9\nG1 X1 F9\nM0\nG4 P0.1\nG1 X2 F9\nG1 X3 F9\nG4 P0.1\nG1 X0 F9\n"
    assert pose_lines(text) == [2, 6]
    line = np.array([0, 1, 2, 2, 0, 0, 0, 0, 5, 6, 6, 0, 0, 0, 0, 8, 8])
    x = np.array([0, 5, 2, 1.1, 1.01, 1, 1, 1, 2, 2.5, 2.9, 3, 3, 3, 3, 1, 0.0])
    assert joints_at_poses(text, Recording(line, {"X": x}))["X"].tolist() == [1.0, 3.0]
    again = text.replace("G1 X0", "G1 X3 F5\nG4 P0.1\nG1 X0")
    assert pose_lines(again) == [2, 6, 6]  # the control passes over a block that moves nothing
    with pytest.raises(InputError, match="never ran line 6"):
        joints_at_poses(text, Recording(np.where(line == 6, 5, line), {"X": x}))
    with pytest.raises(InputError, match="axis X did not come to rest"):
        joints_at_poses(text, Recording(line, {"X": np.linspace(0.0, 1.0, len(x))}))


def test_held_out_poses_are_new_and_within_the_travels() -> None:
    machine = preset("table-bc")
    run = grid_run(machine)
    other = held_out_run(machine, run, poses=9, seed=2)
    assert other.rows == 9 and other.table_ball != run.table_ball and other.tool_ball != run.tool_ball
    for name, axis in machine.axes.items():
        assert (other.commands[name] >= axis.travel[0]).all() and (other.commands[name] <= axis.travel[1]).all()
    tiny = replace(machine, axes={n: replace(a, travel=(-1.0, 1.0)) for n, a in machine.axes.items()})
    with pytest.raises(InputError, match="no other poses fit"):
        held_out_run(tiny, run, poses=9, seed=2)


def test_the_truth_is_richer_than_the_file_and_follows_iso_230() -> None:
    table = machine_to_data(with_error_motions(preset("table-bc")))
    truth, again = (drawn_machine(table, seed=4) for _ in range(2))
    assert set(truth.location_errors) | set(truth.error_motions) == set(table["errors"])
    assert truth.location_errors == again.location_errors
    assert all(
        (truth.error_motions[n].coefficients == again.error_motions[n].coefficients).all() for n in ("EYX", "EXC")
    )
    assert truth.error_motions["EYX"].coefficients[0] == 0.0 != truth.error_motions["EXX"].coefficients[0]
    assert truth.error_motions["EYX"].coefficients.size == table["errors"]["EYX"]["order"] + 1
    less = truth.within_the_file().error_motions
    x, c = np.linspace(-300.0, 300.0, 7), np.linspace(0.0, 360.0, 7)
    for name, q in (("EYX", x), ("EXC", c)):
        assert 0.0 < np.abs(truth.error_motions[name](q) - less[name](q)).max() < 3.0
    assert MotionCurve(np.array([0.0, 2.0]), (-1.0, 3.0))(np.array([-1.0, 1.0, 3.0])) == pytest.approx([2.0, -1.0, 2.0])
    assert [effect["amplitude"] for effect in drawn_machine(table, seed=4, drift_um=1.5).effects] == [1.5]


def test_the_truth_knows_nothing_of_symfive() -> None:
    code = (
        "import sys; sys.path.insert(0, 'tests'); sys.path.insert(0, 'examples/linuxcnc_loop'); import truth; "
        "assert not any(m.split('.')[0] in ('symfive', 'casadi') for m in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_a_machine_without_errors_leaves_the_noise_and_no_set_up(tmp_path) -> None:
    run = grid_run()
    table = machine_to_data(preset("table-bc"))
    perfect = replace(drawn_machine(table, seed=0), location_errors={}, error_motions={})
    at_plan = plant_run(run, run.commands)
    assert true_deviation(perfect, [at_plan]).largest < 1e-3  # commands in files have 7 decimals
    measure(perfect, [at_plan], tmp_path, seed=5)
    campaign = read_campaign(tmp_path)
    raw = np.stack([campaign.runs[0].readings[f"d{c}_um"] for c in "xyz"])
    assert np.abs(raw).max() > 20.0  # the unknown zero and the ball's place on the tool
    assert 0.25 < measured_deviation(campaign, table).per_coordinate < 0.55  # noise 0.4


# --- the whole story, the control being the compiled component -------------------------------------------------
class Compiled:
    """Stands in for LinuxCNC: straight to the end of every block, through the component's own C functions."""

    version = "absent"

    def __init__(self, machine, folder: Path) -> None:
        self.machine, self.letters = machine, joint_letters(machine)
        codegen(machine, folder, target="linuxcnc", prefix=PREFIX)
        command = ["gcc", "-std=c99", "-O1", "-shared", "-fPIC", f"{PREFIX}_kins.c", "-o", "kins.so", "-lm"]
        subprocess.run(command, cwd=folder, check=True)
        self.c = ctypes.CDLL(str(folder / "kins.so"))
        self.pins = [f"{PREFIX}kins.{name}" for name in pin_names(subject_of(machine), PREFIX)]

    def run(self, programs: Mapping[str, str], setp: Sequence[str], *, feed_override: float) -> dict[str, Recording]:
        values = {words[1]: float(words[2]) for words in map(str.split, setp)}
        assert set(values) == set(self.pins) and feed_override > 0.0
        p = np.array([values[pin] for pin in self.pins])
        return {name: self._recording(text, p) for name, text in programs.items()}

    def _recording(self, text: str, p: np.ndarray) -> Recording:
        tool, centred, rows = 0.0, False, []
        for number, line in enumerate(text.splitlines(), start=1):
            words = {w[0]: float(w[1:]) for w in line.split() if re.fullmatch(r"[A-Z]-?[\d.]+", w)}
            tool = words["Z"] if line.startswith("G43.1") else tool
            centred = words["Q"] == 0.0 if line.startswith("M68") else centred
            if line.startswith(("G0 ", "G1 ")):
                world = np.array([words.get(letter, 0.0) for letter in WORLD])
                joints = world[[WORLD.index(letter) for letter in self.letters]]
                if centred:
                    world[2] += tool
                    assert self.c.sfloop_joints(_p(world), ctypes.c_double(tool), _p(p), _p(joints)) == 0
                rows += [(number, joints.copy()), *[(0, joints.copy())] * 3]
        table = np.stack([joints for _, joints in rows])
        return Recording(np.array([n for n, _ in rows]), {c: table[:, i] for i, c in enumerate(self.letters)})


def _p(array: np.ndarray) -> object:
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


@pytest.fixture
def without_linuxcnc(monkeypatch, tmp_path):
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    from contextlib import nullcontext

    monkeypatch.setattr(loop, "require_linuxcnc", lambda: None)
    monkeypatch.setattr(
        Controller, "of", classmethod(lambda cls, machine: nullcontext(Compiled(machine, tmp_path / "kins")))
    )


SMALL = ("--points", "18", "--held-out", "4")


@pytest.mark.slow
def test_the_whole_story_and_its_files(without_linuxcnc, tmp_path, capsys) -> None:
    folder = tmp_path / "results"
    assert loop.main(["-o", str(folder), *SMALL]) == 0
    said = capsys.readouterr().out
    assert [line[0] for line in said.splitlines() if line[:1].isdigit()] == list("12345")
    _check(folder)
    assert "| measured, rms of a coordinate |" in (folder / "loop.md").read_text()
    for name in ("deviation.png", "rest.png", "location-errors.png", "identification.json", "model.json"):
        assert (folder / "table-bc" / name).stat().st_size > 500, name


def _check(folder: Path) -> None:
    [data] = json.loads((folder / "results.json").read_text()).values()
    assert data["factor"] > 8.0 and data["held_out_factor"] > 5.0  # 18 poses only
    assert data["after"]["true_um"]["rms"] < 0.2 * data["before"]["true_um"]["rms"]
    assert data["after"]["parts_rms_um"]["control"] < 0.05
    assert data["location_errors_in_sigmas"]["rms"] < 2.0


# --- what the user may have to do ------------------------------------------------------------------------------
def test_without_linuxcnc_one_sentence_says_so_and_nothing_is_written(monkeypatch, tmp_path, capsys) -> None:
    monkeypatch.setattr(controller.shutil, "which", lambda program: None)
    assert loop.main(["-o", str(tmp_path / "results")]) == 2
    said = capsys.readouterr().err
    assert "LinuxCNC is not installed" in said and "apt install linuxcnc-uspace" in said and said.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_without_rights_or_beside_another_one_it_does_not_start(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(controller.shutil, "which", lambda program: f"/usr/bin/{program}")
    monkeypatch.setattr(controller, "MODULES", tmp_path / "modules")
    with pytest.raises(InputError, match=r"halcompile --install cannot write to .*; run this as root"):
        controller.require_linuxcnc()
    (tmp_path / "modules").mkdir()
    monkeypatch.setattr(controller, "LOCK", tmp_path / "linuxcnc.lock")
    controller.require_linuxcnc()
    (tmp_path / "linuxcnc.lock").touch()
    with pytest.raises(InputError, match="another LinuxCNC is running"):
        controller.require_linuxcnc()


def test_nothing_is_left_running() -> None:
    process = subprocess.Popen(["sh", "-c", "sleep 60 & echo $!; wait"], stdout=subprocess.PIPE, start_new_session=True)
    with ended(process):
        child = int(process.stdout.readline())
        controller._stop(process)
        until(lambda: gone(child), 0.5 * PATIENCE_S)  # it would end by itself only then


# --- LinuxCNC itself -------------------------------------------------------------------------------------------
def _quick(name: str) -> Machine:
    """The preset with axes ten times as fast: LinuxCNC runs by the clock, and its poses are the same."""
    machine = preset(name)
    fast = {
        letter: replace(axis, max_feed=10.0 * axis.max_feed, max_acceleration=10.0 * axis.max_acceleration)
        for letter, axis in machine.axes.items()
    }
    return replace(machine, axes=fast, text="")


@pytest.mark.linuxcnc
def test_linuxcnc_closes_the_loop(monkeypatch, tmp_path) -> None:
    try:
        controller.require_linuxcnc()
    except InputError as absent:
        pytest.skip(str(absent))
    monkeypatch.setattr(loop, "preset", _quick)
    monkeypatch.setattr(loop, "plan", partial(plan, prove=False))
    monkeypatch.setattr(loop, "SETUPS", 2)
    monkeypatch.setattr(loop, "FEED_OVERRIDE", 100.0)
    monkeypatch.setattr(poses, "DWELL_S", 0.1)
    monkeypatch.setattr(
        write, "save_figures", lambda *_: None
    )  # the story without LinuxCNC has them, and the plan's files
    monkeypatch.setattr(Plan, "write", lambda *_, **__: None)
    folder = tmp_path / "results"
    assert loop.main(["-o", str(folder), "--points", "12", "--held-out", "2"]) == 0
    _check(folder)
    assert not controller.LOCK.exists() and not (controller.MODULES / f"{PREFIX}kins.so").exists()


@pytest.mark.linuxcnc
def test_linuxcnc_runs_through_the_pole_and_follows_a_pin_smoothly(tmp_path) -> None:
    """The whole control: through B = 0 with the tool centre held, then a pin changes; no joint jumps. A pin that is not a
    number is not followed, and a program that leads beyond a joint's limit is stopped with the control's own words."""
    try:
        controller.require_linuxcnc()
    except InputError as absent:
        pytest.skip(str(absent))
    machine = preset("table-bc")
    setp = [line.replace(f"{PREFIX}kins.EA0B 0.0", f"{PREFIX}kins.EA0B nan") for line in setp_lines(machine)]
    setp = [line for line in setp if f"{PREFIX}kins.EX0C" not in line]
    setp.append(f"net changed motion.analog-out-00 => {PREFIX}kins.EX0C")
    head = f"G21 G90 G94 G61\nG1 X40 Y20 Z0 B0 C30 F3000\n{tcp_on(80.0)}\n"
    path = head + "G1 B-3 F300\nG1 B3 C31\nG1 B-1\nG1 B3\nG4 P0.2\nM68 E0 Q150\nG4 P2\nG1 B-1\n" + TCP_OFF + "\nM2\n"
    with Controller.of(machine) as control:
        joints = control.run({"path": path}, setp, feed_override=1.0)["path"].joints
        with pytest.raises(InputError, match=r"LinuxCNC stopped a programme: .*limit"):
            control.run({"far": head + "G1 X4000 F3000\nM2\n"}, setp, feed_override=1.0)
    steps = {letter: np.abs(np.diff(values, 2)) for letter, values in joints.items()}
    assert all(np.isfinite(values).all() for values in joints.values())
    assert np.ptp(joints["B"]) > 5.9 and joints["B"].min() < 0.0 < joints["B"].max()
    for letter, change in steps.items():  # what an axis may accelerate in a cycle, and no more
        most = (machine.axes[letter].max_acceleration or 1000.0) * 1e-6
        assert change.max() < 3.0 * most, letter
    there = np.flatnonzero((np.abs(joints["B"] + 1.0) < 2e-3) & (np.abs(joints["C"] - 31.0) < 2e-3))  # before and after
    assert 0.02 < abs(joints["X"][-1] - joints["X"][there[0]]) < 0.15  # mm: two seconds and a path at 20 µm/s
    assert not controller.LOCK.exists()
