"""LinuxCNC's component, its stock kinematics, the ISG table and the printed sheets."""

import ctypes
import os
import re
import shutil
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from codegen_world import fitted
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from symfive.codegen import codegen, subject_of
from symfive.codegen.linuxcnc import pin_names
from symfive.codegen.setp import entered_fit
from symfive.errors import InputError
from symfive.machine import ErrorTerm, Machine, Structure, make_axis, preset, presets

WORLD = "XYZABCUVW"
MODULES = Path("/usr/lib/linuxcnc/modules")


class Kinematics:
    """`sf_world` and `sf_joints` of the component, compiled without LinuxCNC."""

    def __init__(self, machine: Machine, folder: Path) -> None:
        codegen(fitted(machine), folder, target="linuxcnc")
        library = folder / "kins.so"
        strict = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror"]
        command = ["gcc", *strict, "-O0", "-shared", "-fPIC", "sf_kins.c", "-o", str(library), "-lm"]
        subprocess.run(command, cwd=folder, check=True)
        self._c = ctypes.CDLL(str(library))
        subject = subject_of(machine)
        self.axes = [machine.axes[letter] for letter in WORLD if letter in machine.axes]
        self.p = np.zeros(max(1, len(subject.parameters)))
        self._c.sf_parameters(_pointer(self.p))

    def world(self, joints: np.ndarray, tool: float, p: np.ndarray) -> np.ndarray:
        found = np.empty(9)
        assert self._c.sf_world(_pointer(joints), ctypes.c_double(tool), _pointer(p), _pointer(found)) == 0
        return found

    def joints(self, world: np.ndarray, tool: float, p: np.ndarray) -> np.ndarray:
        found = np.empty(len(self.axes))
        assert self._c.sf_joints(_pointer(world), ctypes.c_double(tool), _pointer(p), _pointer(found)) == 0
        return found

    def world_of_axes(self, joints: np.ndarray) -> np.ndarray:
        found = np.empty(9)
        self._c.sf_world_of_axes(_pointer(joints), _pointer(found))
        return found

    def axes_of_world(self, world: np.ndarray) -> np.ndarray:
        found = np.empty(len(self.axes))
        self._c.sf_axes_of_world(_pointer(world), _pointer(found))
        return found


def _pointer(array: np.ndarray) -> object:
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


@pytest.fixture(scope="module")
def kinematics(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Kinematics]:
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    root = tmp_path_factory.mktemp("kins")
    small = [name for name in presets() if name not in ("oyama-2010", "wang-li-2016")]
    return {name: Kinematics(preset(name), root / name) for name in small}


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_joints_and_world_are_each_others_inverse(kinematics, data) -> None:
    """To 1e-9 mm on every structure, both ways round (the class of bug of LinuxCNC#4546)."""
    kins = kinematics[data.draw(st.sampled_from(sorted(kinematics)))]
    joints = np.array([data.draw(st.floats(max(a.travel[0], -720.0), min(a.travel[1], 720.0))) for a in kins.axes])
    tool, p = data.draw(st.floats(0.0, 300.0)), kins.p * data.draw(st.floats(-30.0, 30.0))
    world = kins.world(joints, tool, p)
    back = kins.joints(world, tool, p)
    assert np.abs(back - joints).max() < 1e-9
    assert np.abs(kins.world(back, tool, p) - world).max() < 1e-9


def test_signs_and_tool_length_are_those_of_linuxcnc(kinematics) -> None:
    """Without errors and at zero world and joints agree, whatever the tool; C turns the workpiece under the tool."""
    for kins in kinematics.values():
        joints = np.zeros(len(kins.axes))
        joints[:3] = 10.0, 20.0, 30.0
        world = kins.world(joints, 120.0, 0.0 * kins.p)
        assert world[:3] == pytest.approx(joints[:3], abs=1e-12)
        assert world[3:] == pytest.approx(0.0, abs=1e-15)
    table = kinematics["table-bc"]
    world = kinematics["table-bc"].world(np.array([100.0, 0.0, 0.0, 0.0, 90.0]), 150.0, 0.0 * table.p)
    assert world[[0, 1, 2, 4, 5]] == pytest.approx([0.0, 100.0, 0.0, 0.0, 90.0], abs=1e-12)


def test_words_can_be_positions_of_the_axes(kinematics) -> None:
    """The other kind of programming, whatever the errors: every world coordinate is its axis' own position."""
    for kins in kinematics.values():
        joints = np.arange(1.0, len(kins.axes) + 1.0)
        world = kins.world_of_axes(joints)
        named = dict(zip(WORLD, world, strict=True))
        assert [named[axis.name] for axis in kins.axes] == joints.tolist()
        assert np.count_nonzero(world) == len(joints)
        assert kins.axes_of_world(world).tolist() == joints.tolist()


def test_every_error_has_a_pin_of_its_own(tmp_path) -> None:
    machine = preset("table-bc")
    mixed = ErrorTerm(name="EAC", sigma=1.0, over=("B", "C"), basis=("polynomial", "fourier"), order=(3, 2))
    subject = subject_of(replace(machine, errors={**machine.errors, "EAC": mixed}))
    pins = pin_names(subject, "sf")
    assert len(set(pins)) == len(pins) == len(subject.parameters)
    assert all(re.fullmatch(r"[A-Za-z0-9.-]{1,40}", pin) for pin in pins)
    assert {"EX0C", "EAC.P1-B-cos1-C"} <= set(pins)


@pytest.mark.parametrize("name", ["B1", "W"])
def test_axes_without_a_letter_are_refused(tmp_path, name) -> None:
    axes = {n: make_axis(n) for n in "XYZ"} | {name: make_axis(name, kind="rotary", direction=(0.0, 1.0, 0.0))}
    machine = Machine(name="odd", structure=Structure((name,), ("X", "Y", "Z")), axes=axes)
    with pytest.raises(InputError, match=f"LinuxCNC has no rotary axis called {name}"):
        codegen(machine, tmp_path / "out", target="linuxcnc")
    with pytest.raises(InputError, match="x, y and z cannot be reached"):
        codegen(
            Machine(name="one", structure=Structure((), ("X",)), axes={"X": make_axis("X")}),
            tmp_path,
            target="linuxcnc",
        )


@pytest.mark.linuxcnc
@pytest.mark.parametrize("name", ["table-bc", "head-bc", "mixed-bc"])
def test_the_component_runs_in_hal(tmp_path, kinematics, name) -> None:
    for program in ("halcompile", "halrun"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed (Debian: linuxcnc-uspace-dev)")
    if not os.access(MODULES, os.W_OK):
        pytest.skip(f"{MODULES} cannot be written: LinuxCNC loads modules from there only")
    prefix = f"symfivetest{os.getpid()}"
    codegen(fitted(preset(name)), tmp_path, target="linuxcnc", prefix=prefix)
    kins = kinematics[name]
    pose = {"X": 30.0, "Y": -40.0, "Z": 150.0, "B": 35.0, "C": 70.0}
    changed = f"{prefix}kins.{pin_names(subject_of(preset(name)), prefix)[5]}"
    lines = ["loadrt threads name1=test period1=1000000", (tmp_path / f"{prefix}kins.hal").read_text(),
             f"addf {prefix}kins.check test", f"setp {prefix}kins.tool-offset 120",
             *(f"setp {prefix}kins.check-world-{WORLD.index(k)} {v}" for k, v in pose.items()),
             "start", "loadusr -w sleep 0.2", f"show pin {prefix}kins",
             f"setp {changed} {kins.p[5] + 100.0}", "loadusr -w sleep 1", f"show pin {prefix}kins",
             f"setp {prefix}kins.ramp 10000", "loadusr -w sleep 0.2", f"show pin {prefix}kins",
             f"setp {changed} nan", "loadusr -w sleep 0.2", f"show pin {prefix}kins",
             f"setp {prefix}kins.check-world-1 nan", "loadusr -w sleep 0.2", f"show pin {prefix}kins"]  # fmt: skip
    environment = dict(os.environ)
    shared = Path(tempfile.mkdtemp())  # root's LinuxCNC works as nobody, who may not read pytest's folders
    if os.getuid() == 0:
        shared.chmod(0o777)
        environment |= {"RTAPI_UID": "65534", "RTAPI_FIFO_PATH": str(shared / "fifo")}
    (shared / "try.hal").write_text("\n".join(lines) + "\n")
    try:
        made = subprocess.run(
            ["halcompile", "--install", f"{prefix}kins.comp"], cwd=tmp_path, capture_output=True, text=True
        )
        assert made.returncode == 0, made.stdout + made.stderr
        shown = subprocess.run(["halrun", "-f", "try.hal"], cwd=shared, env=environment, capture_output=True, text=True)
    finally:
        (MODULES / f"{prefix}kins.so").unlink(missing_ok=True)
        shutil.rmtree(shared, ignore_errors=True)
    shows = [
        {pin: value for value, pin in re.findall(rf"\s(\S+)\s+{prefix}kins\.(\S+)", part)}
        for part in shown.stdout.split("Component Pins")[1:]
    ]
    start, ramped, there, held, refused = shows
    world = np.array([pose.get(letter, 0.0) for letter in WORLD])
    expected = kins.joints(world, 120.0, kins.p)
    after = kins.joints(world, 120.0, kins.p + 100.0 * (np.arange(len(kins.p)) == 5))
    moved = int(np.argmax(np.abs(after - expected)[:3]))

    def joints(pins: dict[str, str]) -> np.ndarray:
        return np.array([float(pins[f"check-joint-{i}"]) for i in range(5)])

    assert [pins["check-status"] for pins in shows] == ["0", "0", "0", "0", "-1"], shown.stdout + shown.stderr
    assert joints(start) == pytest.approx(expected, rel=1e-6)
    assert [float(start[f"check-back-{i}"]) for i in range(6)] == pytest.approx(world[:6], abs=1e-4)
    share = (joints(ramped) - expected)[moved] / (after - expected)[moved]
    assert 0.15 < share < 0.6 and ramped["following"] == "TRUE"  # 20 um in a second
    assert joints(there) == pytest.approx(after, rel=1e-6) and there["following"] == "FALSE"
    assert joints(held) == pytest.approx(after, rel=1e-6)
    assert [pins["fault"] for pins in shows] == ["FALSE", "FALSE", "FALSE", "TRUE", "TRUE"]
    assert joints(refused) == pytest.approx(0.0)


@pytest.mark.parametrize("sense", [1.0, -1.0], ids=["ISO 841", "against"])
@pytest.mark.parametrize("tilt", ["A", "B"])
def test_places_of_axes_fit_the_stock_kinematics_entirely(tmp_path, tilt, sense) -> None:
    """LinuxCNC 2.9 turns the rotary axes against ISO 841; a machine file says so by their directions."""
    across = "Y" if tilt == "A" else "X"
    machine = _trunnion(tilt, sense)
    subject = subject_of(fitted(machine, {f"E{across}0{tilt}": 31.0, f"EZ0{tilt}": -17.0, "EX0C": 40.0, "EY0C": -25.0}))
    fit, _ = entered_fit(subject)
    k = "XY".index(across)
    c = np.array([0.040, -0.025])  # C stands on the tilting axis
    c[k] += 0.031
    assert fit.fitted == pytest.approx([*c, 0.031 - c[k], -50.017], abs=1e-5)
    assert fit.design == pytest.approx([0.0, 0.0, 0.0, -50.0])
    assert fit.before > 20.0 and fit.after < 0.02
    by_name = {"x-rot": 0, "y-rot": 1, "lateral": 2, "height": 3}  # every error has 1σ 1 µm: sums of independent ones
    assert fit.uncertainty[by_name["height"]] == pytest.approx(2e-3, rel=1e-3)
    assert fit.uncertainty[by_name["y-rot" if tilt == "B" else "x-rot"]] == pytest.approx(2e-3, rel=0.3)
    (path,) = codegen(machine, tmp_path, target="setp")
    assert ("1, after ISO 841" in path.read_text()) == (sense > 0.0)


@pytest.mark.parametrize(
    ("tilt", "joints"), [("B", [137.8348, -2.223958, -15.01023]), ("A", [93.38089, -61.35493, 31.53947])]
)
def test_the_stock_kinematics_turn_against_iso_841(tmp_path, tilt, joints) -> None:
    """xyzbc- and xyzac-trt-kins of LinuxCNC 2.9.0~pre1 in halrun, with the pins that the file states, tilted by 35° and turned
    by 70°: what their kinematicsInverse says for (12, -34, 56)."""
    machine = _trunnion(tilt, -1.0)
    places = {"C": (30.0, 40.0, 0.0), tilt: (3.0, 7.0, -50.0)}
    machine = replace(machine, axes={n: replace(a, origin=places.get(n, a.origin)) for n, a in machine.axes.items()})
    (path,) = codegen(machine, tmp_path / "pins", target="setp")
    pins = dict(re.findall(r"^setp \S+kins\.(\S+) (\S+)$", path.read_text(), re.MULTILINE))
    lateral = {"x-offset": -27.0} if tilt == "B" else {"y-offset": -33.0}
    wanted = {"x-rot-point": 30.0, "y-rot-point": 40.0, "z-rot-point": 0.0, "z-offset": -50.0, **lateral}
    assert {pin: float(value) for pin, value in pins.items()} == wanted
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    kins = Kinematics(machine, tmp_path / "kins")
    world = np.zeros(9)
    world[:3], world[WORLD.index(tilt)], world[WORLD.index("C")] = (12.0, -34.0, 56.0), 35.0, 70.0
    assert kins.joints(world, 0.0, 0.0 * kins.p)[:3] == pytest.approx(joints, rel=1e-6)


def test_axes_of_opposite_senses_do_not_fit_the_stock_kinematics(tmp_path) -> None:
    machine = _trunnion("B")
    axes = {**machine.axes, "C": replace(machine.axes["C"], direction=(0.0, 0.0, -1.0))}
    with pytest.raises(InputError, match="both against"):
        codegen(replace(machine, axes=axes), tmp_path, target="setp")


def _trunnion(tilt: str, sense: float = 1.0) -> Machine:
    """The preset with the other tilting axis, and the other sense of the rotary ones, where that is asked for."""
    whole = preset("table-bc")
    axes = {n: whole.axes[n] for n in "XYZC"} | {
        tilt: make_axis(tilt, travel=(-110.0, 110.0), origin=(0.0, 0.0, -50.0))
    }
    axes |= {n: replace(axes[n], direction=tuple(sense * v for v in axes[n].direction)) for n in ("C", tilt)}
    names = (f"EX0{tilt}" if tilt == "B" else f"EY0{tilt}", f"EZ0{tilt}", f"EC0{tilt}", "EX0C", "EY0C", "EA0C")
    errors = {n: ErrorTerm(name=n, sigma=50.0) for n in names}
    return Machine(name="trunnion", structure=Structure(("C", tilt, "X", "Y"), ("Z",)), axes=axes, errors=errors)


def test_the_setp_lines_say_what_they_leave(tmp_path) -> None:
    model = fitted(preset("table-bc"))
    (path,) = codegen(model, tmp_path, target="setp")
    text = path.read_text()
    before, after = map(float, re.findall(r"([\d.]+) um rms", text))
    assert 0.0 < after < before
    pins = re.findall(r"^setp xyzbc-trt-kins\.(\S+) (\S+)$", text, re.MULTILINE)
    assert [pin for pin, _ in pins] == ["z-rot-point", "x-rot-point", "y-rot-point", "x-offset", "z-offset"]
    assert "It cannot" in text and "Draft" in text


def test_a_pin_within_its_uncertainty_stays_as_designed(tmp_path) -> None:
    values = {"EX0C": 40.4, "EY0C": 1.5, "EZ0B": -30.0, "EX0B": 40.4}
    (path,) = codegen(fitted(_trunnion("B"), values), tmp_path, target="setp")
    text = path.read_text()
    pins = dict(re.findall(r"^setp xyzbc-trt-kins\.(\S+) (\S+)$", text, re.MULTILINE))
    assert (
        float(pins["y-rot-point"]) == 0.0
        and "y-rot-point: designed 0.0000 mm, change +1.5 um, U 2.0 um: within" in text
    )
    assert float(pins["z-offset"]) == pytest.approx(-50.03) and len(pins["x-rot-point"]) <= len("0.0808")
    (path,) = codegen(_trunnion("B"), tmp_path / "other", target="setp")
    assert "not known: nothing was measured" in path.read_text()


@pytest.mark.parametrize("name", ["head-bc", "mixed-bc", "nutating-table", "three-axis"])
def test_other_structures_do_not_fit_the_stock_kinematics(tmp_path, name) -> None:
    with pytest.raises(InputError, match="stock trunnion"):
        codegen(name, tmp_path / "out", target="setp")
