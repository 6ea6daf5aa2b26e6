"""Predictions of the three ball instruments against a chain written again in numpy, without CasADi."""

from dataclasses import replace

import numpy as np
import plant
import pytest
from scipy.spatial.transform import Rotation

from symfive.campaign import Campaign, Run, SetupSigma
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.identify import identify
from symfive.machine import machine_from_data, preset
from symfive.model import Model
from symfive.procedures import campaign_of, linear_positioning

UNITS = dict(zip("XYZABC", np.vstack([np.eye(3), np.eye(3)]), strict=True))
MACHINES = {
    "table": ("w C' B' X' Y' b Z t", {"B": [0.0, 0.0, -50.0]}, {}),
    "nutating": ("w C' B' X' Y' b Z t", {"B": [0.0, 0.0, -30.0]}, {"B": [0.0, 0.6, 0.8]}),
    "head": ("w X' b Y Z C B t", {"B": [5.0, 0.0, 120.0]}, {}),
    "mixed": ("w C' X' b Y Z B t", {"B": [0.0, 0.0, 150.0], "C": [1.0, 2.0, 0.0]}, {}),
}
LOCATION = plant.LOCATION | {"EC0X": 29.0, "EA0Z": -41.0, "EB0Z": 12.0}
MOTION = {"EXC.cos1": 4.0, "EXC.sin1": -3.0, "EAC.cos1": 21.0, "EAC.sin1": 17.0, "EYX.P2": 6.0, "ECX.P1": -13.0}
N = 9


def rotation(axis, angle):
    """Rotation about a unit vector, by its matrix exponential's closed form."""
    x, y, z = axis
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def rpy(a, b, c):
    return rotation([1, 0, 0], a) @ rotation([0, 1, 0], b) @ rotation([0, 0, 1], c)


def motions(name, q):
    """E(q), R(q) of the error motions in MOTION: mm and rad."""
    e = dict.fromkeys("XYZABC", 0.0)
    if name == "C":
        e["X"] = 1e-3 * (MOTION["EXC.cos1"] * np.cos(q) + MOTION["EXC.sin1"] * np.sin(q))
        e["A"] = 1e-6 * (MOTION["EAC.cos1"] * np.cos(q) + MOTION["EAC.sin1"] * np.sin(q))
    if name == "X":
        x = q / 400.0
        e["Y"] = 1e-3 * MOTION["EYX.P2"] * (1.5 * x * x - 0.5)
        e["C"] = 1e-6 * MOTION["ECX.P1"] * x
    return np.array([e[c] for c in "XYZ"]), rpy(*(e[c] for c in "ABC"))


def chain(structure, origins, directions, command, tool_ball):
    """The ball in the workpiece frame with 4×4 matrices, after the conventions, section 1."""
    workpiece, tool = (side.split() for side in structure[2:-2].split(" b "))
    names = [[word.rstrip("'") for word in reversed(workpiece)], tool]
    total = []
    for side, sign in zip(names, (-1.0, 1.0), strict=True):
        matrix = np.eye(4)
        for name in side:
            e = np.asarray(directions.get(name, UNITS[name]))
            q = command[name] * (np.pi / 180.0 if name in "ABC" else 1.0)
            shift, turn = motions(name, q)
            place = np.array([1e-3 * LOCATION.get(f"E{c}0{name}", 0.0) for c in "XYZ"])
            tilt = rpy(*(1e-6 * LOCATION.get(f"E{c}0{name}", 0.0) for c in "ABC"))
            step = np.eye(4)
            if name in "ABC":
                origin = np.asarray(origins.get(name, [0.0, 0.0, 0.0]))
                step[:3, :3] = tilt @ turn @ rotation(e, sign * q)
                step[:3, 3] = origin + place + shift - step[:3, :3] @ origin
            else:
                step[:3, :3] = turn
                step[:3, 3] = tilt @ e * sign * q + shift
            matrix = matrix @ step
        total.append(matrix)
    return (np.linalg.solve(total[0], total[1] @ np.append(tool_ball, 1.0)))[:3]


def campaign(name, run_fields):
    structure, origins, directions = MACHINES[name]
    axes = {n: {"travel": [-400.0, 400.0]} for n in "XYZBC"}
    for key, values in (("origin", origins), ("direction", directions)):
        for axis, value in values.items():
            axes[axis][key] = value
    errors = {n: {"sigma": 50.0} for n in LOCATION}
    errors |= {n: {"basis": "fourier", "order": 1, "sigma": 9.0} for n in ("EXC", "EAC")}
    errors |= {"EYX": {"basis": "polynomial", "order": 2, "sigma": 9.0}}
    errors |= {"ECX": {"basis": "polynomial", "order": 1, "sigma": 9.0}}
    machine = machine_from_data({"schema": "symfive.machine/1", "structure": structure, "axes": axes, "errors": errors})
    rng = np.random.default_rng(5)
    commands = {n: rng.uniform(-90, 90, N) if n in "BC" else rng.uniform(-300, 300, N) for n in machine.axis_names}
    run = Run(id="r", sampling="static", time=np.arange(N) * 6.0, commands=commands, **run_fields)
    return Campaign(machine=machine, runs=(run,))


def balls(plan, name, tool_ball):
    structure, origins, directions = MACHINES[name]
    run = plan.runs[0]
    rows = [{axis: run.commands[axis][k] for axis in run.commands} for k in range(N)]
    return np.array([chain(structure, origins, directions, row, tool_ball) for row in rows])


def predict(plan, setup):
    model = Model(plan)
    motion = {k: v for k, v in MOTION.items() if k in model.index}
    values = {**LOCATION, **motion, **{f"setup.r.{k}": v for k, v in setup.items()}}
    return model.predict(values)["r"]


SETUP = {"tool_ball.x": 11.0, "tool_ball.y": -7.0, "tool_ball.z": 5.0}
TOOL = np.array([1.0, -2.0, -130.0])
TOOL_TRUE = TOOL + 1e-3 * np.array([11.0, -7.0, 5.0])


@pytest.fixture(params=MACHINES)
def name(request):
    return request.param


def test_ball_bar(name):
    table = np.array([40.0, -30.0, 60.0])
    fields = {"instrument": ("ball_bar",), "table_ball": tuple(table), "tool_ball": tuple(TOOL), "length": 150.0}
    plan = campaign(name, fields)
    setup = {**SETUP, "table_ball.x": -9.0, "table_ball.y": 4.0, "table_ball.z": 8.0, "length": 0.7}
    offset = balls(plan, name, TOOL_TRUE) - (table + 1e-3 * np.array([-9.0, 4.0, 8.0]))
    expected = 1e3 * (np.linalg.norm(offset, axis=1) - 150.0) - 0.7
    assert predict(plan, setup)[:, 0] == pytest.approx(expected, abs=1e-6)


def test_r_test(name):
    nest = np.array([40.0, -30.0, 60.0])
    plan = campaign(name, {"instrument": ("r_test",), "table_ball": tuple(nest), "tool_ball": tuple(TOOL)})
    zero = np.array([100.0, -50.0, 20.0])
    setup = {**SETUP, **{f"zero.{c}": z for c, z in zip("xyz", zero, strict=True)}}
    assert predict(plan, setup) == pytest.approx(1e3 * (balls(plan, name, TOOL_TRUE) - nest) + zero, abs=1e-6)


def test_grid_encoder(name):
    u, v = np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0])
    origin = np.array([10.0, 20.0, 30.0])
    sigma = SetupSigma(plate=50.0)
    plan = campaign(
        name,
        {"instrument": ("grid_encoder",), "tool_ball": tuple(TOOL), "table_ball": tuple(origin), "u": tuple(u),
         "v": tuple(v), "setup_sigma_um": sigma},
    )  # fmt: skip
    turn = np.array([15.0, -25.0, 35.0])
    setup = {**SETUP, "zero.u": 5.0, "zero.v": -6.0}
    setup |= {f"plate.{c}": t for c, t in zip("abc", turn, strict=True)}
    d = balls(plan, name, TOOL_TRUE)
    seen = d - np.cross(1e-6 * turn, d - origin)  # the plate turned by a, b, c about its origin
    expected = 1e3 * np.stack([seen @ u, seen @ v], axis=1) + [5.0, -6.0]
    assert predict(plan, setup) == pytest.approx(expected, abs=1e-6)


def relative_rotations(plan, name):
    """Of the tool in the workpiece frame, a row each, from where it carries four points."""
    unit = [balls(plan, name, np.eye(3)[i]) - balls(plan, name, np.zeros(3)) for i in range(3)]
    return Rotation.from_matrix(np.stack(unit, axis=2))


def test_a_laser_that_is_pushed_within_its_test_reads_a_step():
    (run,) = linear_positioning(preset("three-axis"), axis="X", cycles=3)
    pushed = {"X_dev_um": 4.0 * (np.arange(run.rows) >= 20)}
    plan = campaign_of(preset("three-axis"), [replace(run, readings=pushed)])
    begin = {"t_s": float(run.time[19] + run.time[20]) / 2.0} if run.has_clock else {"row": 21}
    fit = identify(plan, effects=[make_effect("setup_shift", run=run.id, **begin)])
    assert fit.named[f"setup_shift.{run.id}.shift.x"] == pytest.approx(
        -4.0, abs=0.1
    )  # of the laser, towards its reflector


@pytest.mark.parametrize("axis", ["B", "C"])
def test_laser_on_a_rotary_axis(name, axis, monkeypatch):
    plan = campaign(name, {"instrument": ("laser",), "tool_ball": tuple(TOOL), "options": {"axis": axis}})
    real = relative_rotations(plan, name)
    monkeypatch.setitem(globals(), "LOCATION", {})
    monkeypatch.setitem(globals(), "MOTION", dict.fromkeys(MOTION, 0.0))
    nominal = relative_rotations(plan, name)
    run = plan.runs[0]
    further = replace(plan, runs=(replace(run, commands={**run.commands, axis: run.commands[axis] + 1.0}),))
    along = np.degrees((relative_rotations(further, name) * nominal.inv()).as_rotvec())
    monkeypatch.undo()
    expected = 1e6 * np.sum(along * (real * nominal.inv()).as_rotvec(), axis=1)
    assert np.abs(expected).max() > 10.0
    assert predict(plan, {"zero": 3.0})[:, 0] == pytest.approx(expected + 3.0, abs=1e-4)


def test_laser_reads_a_large_error_of_a_rotary_axis_whole(name):
    """A resolver with the wrong number of pole pairs is degrees off: no small angle."""
    plan = campaign(name, {"instrument": ("laser",), "options": {"axis": "C"}})
    model = Model(plan, [make_effect("transmission_error", "C", period=90.0)])
    error = {"period": 90.0, "sin": 1.4e5, "cos": -2e4}
    values = dict.fromkeys(model.index, 0.0) | {f"transmission_error.C.{k}": v for k, v in error.items()}
    turn = 2.0 * np.pi * plan.runs[0].commands["C"] / 90.0
    expected = 1.4e5 * np.sin(turn) - 2e4 * np.cos(turn)
    assert model.predict(values)["r"][:, 0] == pytest.approx(expected, abs=1e-3)


def test_straightedge(name):
    u, v, place = np.array([0.6, 0.0, 0.8]), np.array([0.8, 0.0, -0.6]), np.array([10.0, 20.0, 30.0])
    fields = {"instrument": ("straightedge",), "tool_ball": tuple(TOOL), "table_ball": tuple(place)}
    plan = campaign(name, {**fields, "u": tuple(u), "v": tuple(v)})
    away = balls(plan, name, TOOL) - place
    expected = 1e3 * (away @ u) + 1e-3 * 250.0 * (away @ v) - 40.0
    assert predict(plan, {"slope": 250.0, "zero": -40.0})[:, 0] == pytest.approx(expected, abs=1e-6)
    for wrong in ({}, {"u": tuple(u)}, {"u": tuple(u), "v": tuple(u)}):
        with pytest.raises(InputError, match="right angles; add u = "):
            Model(campaign(name, fields | wrong))


def test_a_ball_off_its_place_turns_with_the_table():
    """Sensors 1 and 2 see one ball, 3 another one; 20 µm beside the axis was 100 µrad of tilt by an eccentric mass, at 99.9 %."""
    machine, turn = preset("table-bc"), np.radians([0.0, 30.0, 100.0, 250.0])
    sensors = [
        {"direction": list(direction), "position": [0.0, 0.0, height]}
        for direction, height in (((1.0, 0.0, 0.0), 100.0), ((0.0, 1.0, 0.0), 100.0), ((1.0, 0.0, 0.0), 50.0))
    ]
    still = dict.fromkeys(machine.axis_names, np.zeros(4)) | {"C": np.degrees(turn)}
    run = Run(
        id="r", instrument=("displacement",), sampling="static", time=np.arange(4.0), commands=still, noise_um=0.1,
        options={"sensors": sensors},
    )  # fmt: skip
    model = Model(Campaign(machine=machine, runs=(run,)))
    off = {"setup.r.ball.s1.x": 12.0, "setup.r.ball.s1.y": -5.0, "setup.r.ball.s3.x": 3.0}
    readings = model.predict(dict.fromkeys(model.index, 0.0) | off)["r"]
    cos, sin = np.cos(turn), np.sin(turn)  # C' turns the table by -C
    np.testing.assert_allclose(readings, np.stack([12 * cos - 5 * sin, -12 * sin - 5 * cos, 3 * cos], 1), atol=1e-9)
    assert not [name for name in model.index if ".ball.s2" in name]
    slipped = Model(Campaign(machine=machine, runs=(run,)), [make_effect("setup_shift", run="r", t_s=1.5)])
    after = slipped.predict(
        dict.fromkeys(slipped.index, 0.0) | {"setup_shift.r.shift.x": 2.0, "setup_shift.r.shift.y": 1.0}
    )["r"]
    moved = np.stack([2 * cos + sin, -2 * sin + cos, 2 * cos + sin], 1) * (run.time >= 1.5)[:, None]
    np.testing.assert_allclose(after, moved, atol=1e-9)


def test_without_set_up_errors_there_are_fewer_unknowns():
    exact = SetupSigma(table_ball=0.0, tool_ball=0.0, length=0.0)
    fields = {"instrument": ("ball_bar",), "length": 100.0, "setup_sigma_um": exact}
    assert not [p for p in Model(campaign("table", fields)).parameters if p.run == "r"]


def test_without_errors_the_reading_is_the_nominal_offset(name, monkeypatch):
    for errors in (LOCATION, MOTION):
        for key in errors:
            monkeypatch.setitem(errors, key, 0.0)
    plan = campaign(name, {"instrument": ("r_test",), "tool_ball": tuple(TOOL)})
    assert predict(plan, {}) == pytest.approx(1e3 * balls(plan, name, TOOL), abs=1e-6)
