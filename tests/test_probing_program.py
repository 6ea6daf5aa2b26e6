"""The probing program read again: every touch aims at the sphere, every way around it keeps off, logs give the centres back."""

from __future__ import annotations

import re
import shutil
import subprocess

import numpy as np
import plant
import pytest

from symfive.campaign import Run
from symfive.errors import InputError
from symfive.importers.touch_log import fitted_centres, probed_run, read_touches
from symfive.machine import preset
from symfive.nc import Post, Probing, cycle_seconds, program
from symfive.procedures import Nominal

PROBING = Probing(sphere_radius=10.0, tip_radius=2.0, clearance=4.0, overtravel=1.5)
SPHERE, TIP = (80.0, -30.0, 120.0), (0.0, 0.0, -150.0)


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


@pytest.mark.linuxcnc
@pytest.mark.skipif(
    shutil.which("rs274") is None, reason="LinuxCNC's interpreter rs274 is not installed (linuxcnc-uspace)"
)
def test_the_control_reads_it(tmp_path):
    machine, run = probe_run("table-bc")
    (tmp_path / "probe.ngc").write_text(program(machine, run, "linuxcnc", Post(), PROBING))
    done = subprocess.run(["rs274", "-g", "probe.ngc"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("STRAIGHT_PROBE") >= 4 * 5 * run.rows


def test_other_controls_and_touches_from_below_are_refused():
    machine, run = probe_run("table-bc")
    with pytest.raises(InputError, match="not written for heidenhain: its probing cycles depend"):
        program(machine, run, "heidenhain")
    below = [[0, 0, 1], [1, 0, 0], [-1, 0, -0.2], [0, 1, 0], [0, -1, 0]]
    machine, run = probe_run("table-bc", touches=below)
    with pytest.raises(InputError, match="below the sphere's equator"):
        program(machine, run, "linuxcnc")


def test_a_cycle_lasts_as_long_as_its_moves():
    _, run = probe_run("table-bc")
    slow = Probing(slow_feed=10.0)
    assert cycle_seconds(run, slow) - cycle_seconds(run) == pytest.approx(5 * 60.0 * 0.5 * (1 / 10.0 - 1 / 30.0))


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
    readings = probed_run(run, read_touches(tmp_path / "log.txt")).readings
    assert np.stack([readings[f"{n}_dev_um"] for n in "XYZ"], axis=1) == pytest.approx(1e3 * off, abs=1e-4)


@pytest.mark.parametrize(
    ("text", "words"),
    [("0,0,1,2\n", "line 1"), ("0,0,1,2,nan\n", "line 1"), ("0,0,1,2,3\n", "1 touches|row 2 is missing")],
)
def test_a_broken_log_is_refused(tmp_path, text, words):
    _, run = probe_run("table-bc")
    (tmp_path / "log.txt").write_text(text)
    with pytest.raises(InputError, match=words):
        probed_run(run, read_touches(tmp_path / "log.txt"))
