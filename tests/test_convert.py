"""Converters on tiny files of the same layout, made by hand with invented numbers."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from symfive.convert import CONVERTERS, VARIABLE, convert, data_folder
from symfive.convert._files import Channel, sampling_times  # arrivals whose true times are known
from symfive.convert.irb120_tracker import AXES as IRB_AXES
from symfive.convert.mukca import AXES as PANDA_AXES
from symfive.convert.mukca import TOOL_BALL
from symfive.errors import InputError
from symfive.instruments.drive_force import low_pass
from symfive.kinematics import axes_of_modified_dh, forward
from symfive.model import Model
from symfive.motion import Direction, RunMotion

LOG_DAY = "2020-01-02"


def stamp(seconds: float) -> str:
    minutes, rest = divmod(seconds, 60.0)
    return f"{LOG_DAY} 10:{int(minutes):02d}:{rest:09.6f}"


def log_text(channels: dict[str, list[tuple[float, float]]]) -> str:
    lines = [(t, f"{name} {stamp(t)} {float(value)!r}") for name, rows in channels.items() for t, value in rows]
    return "\n".join(line for _, line in sorted(lines)) + "\n"


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def columns(rows: np.ndarray, delimiter: str = " ") -> str:
    return "\n".join(delimiter.join(repr(float(v)) for v in row) for row in rows) + "\n"


# --- where the recordings are --------------------------------------------------------------------------------


def test_data_folder_follows_the_variable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    assert data_folder() == tmp_path
    monkeypatch.setenv(VARIABLE, str(tmp_path / "nowhere"))
    with pytest.raises(InputError, match=f"nowhere, is not there; set {VARIABLE}"):
        data_folder()


def test_unknown_recording_is_named() -> None:
    with pytest.raises(InputError, match=r'no converter for "lathe"; use one of ecmc-iso230, emps'):
        convert("lathe", ".")


@pytest.mark.parametrize("name", CONVERTERS)
def test_missing_and_empty_folders_are_one_sentence(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not there"):
        convert(name, tmp_path)
    (tmp_path / name).mkdir(parents=True)
    with pytest.raises(InputError, match="there is no"):
        convert(name, tmp_path)


# --- shared pieces -------------------------------------------------------------------------------------------


def test_log_reads_alarms_and_skips_disconnections(tmp_path: Path) -> None:
    path = tmp_path / "jjxray-slit" / "a.log"
    write(path, f"P:Enc-PosAct {stamp(1.0)} 2.5 LOLO MAJOR\nP:b *** Not connected\nP:Enc-PosAct {stamp(0.5)} 1.5\n")
    assert convert("jjxray-slit", tmp_path).run("a").readings["X_act_mm"].tolist() == [1.5, 2.5]
    write(path, f"P:other {stamp(1.0)} 2.5\n")
    with pytest.raises(InputError, match="no channel …Enc-PosAct"):
        convert("jjxray-slit", tmp_path)


def test_broken_log_line_is_named(tmp_path: Path) -> None:
    write(tmp_path / "jjxray-slit" / "a.log", f"P:Enc-PosAct {stamp(1.0)} 2.5\nP:Enc-PosAct {LOG_DAY}\n")
    with pytest.raises(InputError, match="line 2"):
        convert("jjxray-slit", tmp_path)


def test_sampling_times_undo_late_bursts_and_find_losses() -> None:
    rng = np.random.default_rng(1)
    tick = np.setdiff1d(np.arange(2000), [70, 71, 900, 1500])  # four samples were lost
    true = 0.01 * tick
    burst = 0.05 * np.ceil(true / 0.05 + 1e-9)
    arrival = np.where(rng.uniform(size=true.size) < 0.7, burst, true) + 2e-4 * rng.uniform(size=true.size)
    found = sampling_times(Channel(arrival, 30.0 * true), 0.01, 1e-3)
    error = found - true
    assert np.ptp(error) < 1e-9  # a constant delay remains, and no jitter
    assert 0.0 <= error[0] < 2e-3


def test_modified_dh_equals_product_of_exponentials() -> None:
    a, d, alpha = (0.0, 0.0, 82.5, 88.0), (333.0, 0.0, 316.0, 0.0), (0.0, -90.0, 90.0, 90.0)
    angles = np.random.default_rng(2).uniform(-170.0, 170.0, (20, 4))
    axes, turn, place = axes_of_modified_dh(a, d, alpha)
    rotation, translation = forward({str(k): axis for k, axis in enumerate(axes)}, angles)
    for k, q in enumerate(np.radians(angles)):
        frame = np.eye(4)
        for i, (length, offset, twist) in enumerate(zip(a, d, np.radians(alpha), strict=True)):
            ca, sa, c, s = np.cos(twist), np.sin(twist), np.cos(q[i]), np.sin(q[i])
            rows = [[c, -s, 0, length], [s * ca, c * ca, -sa, -offset * sa], [s * sa, c * sa, ca, offset * ca]]
            frame = frame @ np.array([*rows, [0, 0, 0, 1]])
        assert np.allclose(rotation[k] @ turn, frame[:3, :3], atol=1e-9)
        assert np.allclose(rotation[k] @ place + translation[k], frame[:3, 3], atol=1e-6)


# --- EMPS: known forces come back ----------------------------------------------------------------------------


def test_emps_gives_back_invented_forces(tmp_path: Path) -> None:
    t = np.arange(12000) * 1e-3
    x = 0.1 * np.sin(2 * np.pi * 0.5 * t) + 0.01 * np.sin(2 * np.pi * 3.1 * t)
    v, a = np.gradient(x, t), np.gradient(np.gradient(x, t), t)
    force = 80.0 * a + 150.0 * v + 17.0 * np.sign(v) - 4.0
    (tmp_path / "emps").mkdir()
    data = {"t": t, "qg": x, "qm": x, "vir": force / 20.0, "gtau": 20.0, "kp": 160.0}
    savemat(tmp_path / "emps" / "DATA_EMPS.mat", data)
    campaign = convert("emps", tmp_path)
    run = campaign.run("DATA_EMPS")
    assert run.options["low_pass_hz"] == 50.9
    assert run.commands["X"] == pytest.approx(run.readings["X_act_mm"], abs=1e-3)
    model = Model(campaign)
    table = model.linearise(run, model.start)
    found = np.linalg.lstsq(table.jacobian[:, 1, :], run.readings["X_force_N"], rcond=None)[0]
    assert found == pytest.approx([80.0, 150.0, 17.0, -4.0], rel=0.005)


def test_emps_pulses_are_in_the_voltage_already(tmp_path: Path) -> None:
    """The carriage answers to all that the drive gets; the file names the part of it that the pulses are."""
    t = np.arange(12000) * 1e-3
    pulses = np.where((t % 3.0 > 1.0) & (t % 3.0 < 1.5), 30.0, 0.0)
    controller = 200.0 * np.cos(2 * np.pi * 0.5 * t)
    x = np.cumsum(np.cumsum((controller + pulses) / 80.0) * 1e-3) * 1e-3
    (tmp_path / "emps").mkdir()
    data = {
        "t": t,
        "qg": x,
        "qm": x,
        "vir": (controller + pulses) / 20.0,
        "gtau": 20.0,
        "kp": 160.0,
        "pulses_N": pulses,
    }
    savemat(tmp_path / "emps" / "DATA_EMPS_PULSES.mat", data)
    campaign = convert("emps", tmp_path)
    run, model = campaign.run("DATA_EMPS_PULSES"), Model(campaign)
    slopes = model.linearise(run, model.start).jacobian[:, 1, :]
    square = low_pass(pulses, run.options["low_pass_hz"], 1e-3)[np.searchsorted(t, run.time)]
    found = np.linalg.lstsq(np.column_stack([slopes, square]), run.readings["X_force_N"], rcond=None)[0]
    assert found[0] == pytest.approx(80.0, rel=0.005)
    assert abs(found[-1]) < 0.01  # nothing that looks like the pulses is left beside the inertia


def test_emps_file_that_lacks_a_column(tmp_path: Path) -> None:
    (tmp_path / "emps").mkdir()
    savemat(tmp_path / "emps" / "DATA_EMPS.mat", {"t": [0.0, 1.0]})
    with pytest.raises(InputError, match="lacks qg, qm, vir"):
        convert("emps", tmp_path)


def test_low_pass_passes_slow_and_stops_fast() -> None:
    t = np.arange(5000) * 1e-3
    slow, fast = np.sin(2 * np.pi * 5.0 * t), np.sin(2 * np.pi * 300.0 * t)
    assert np.abs(low_pass(slow + fast, 50.0, 1e-3) - slow)[500:-500].max() < 1e-3


# --- ISO 230-2 -----------------------------------------------------------------------------------------------

ISO = """TEST_DATA=# invented
TGT_SET_PV=UNIT:Y-PosCmd
TGT_DATA[1]=-5
REF_DATA_FWD[1,1]=-4.99
TGT_DATA[2]=5
REF_DATA_FWD[2,1]=5.02
REF_DATA_FWD[1,2]=-4.98
REF_DATA_FWD[2,2]=5.03
REF_DATA_BWD[1,1]=-5.01
REF_DATA_BWD[2,1]=5.0
REF_DATA_BWD[1,2]=-5.02
REF_DATA_BWD[2,2]=4.99
"""


def test_iso230_rows_tell_the_direction_of_approach(tmp_path: Path) -> None:
    write(tmp_path / "ess-xyz" / "invented_ISO230.dat", ISO)
    campaign = convert("ess-xyz", tmp_path)
    run = campaign.runs[0]
    assert run.instrument == ("laser",) and run.options["axis"] == "Y"
    assert not run.has_clock  # the file holds an order, and no times
    assert run.commands["Y"].round(3).tolist() == [-5.0, 5.0, 5.0, -5.0, -5.0, 5.0, 5.0, -5.0]
    assert run.readings["Y_dev_um"].round(2).tolist() == [10.0, 20.0, 0.0, -10.0, 20.0, 30.0, -10.0, -20.0]
    direction = Direction("Y").series(RunMotion(run, campaign.machine, {}, {})).value
    assert direction.tolist() == [1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0]


def test_iso230_scale_of_the_scripts_is_undone(tmp_path: Path) -> None:
    write(tmp_path / "ecmc-iso230" / "report.md_ISO230.dat", ISO)
    report = "Target Position | Reference | -1.002 | 50.3 | 8 | .1\n\nTarget position source | UNIT:Y-PosCmd\n"
    write(tmp_path / "ecmc-iso230" / "report.md", report)
    reading = convert("ecmc-iso230", tmp_path).runs[0].readings["X_dev_um"]
    assert reading[0] == pytest.approx(1e3 * (-4.99 / 1.002 + 5.0), abs=1e-6)


def test_iso230_hole_in_the_table(tmp_path: Path) -> None:
    write(tmp_path / "ecmc-iso230" / "a_ISO230.dat", ISO.replace("REF_DATA_BWD[2,2]=4.99\n", ""))
    with pytest.raises(InputError, match=r"REF_DATA_BWD\[2,2\] is missing"):
        convert("ecmc-iso230", tmp_path)


def test_xyz_log_gives_stops_and_scan(tmp_path: Path) -> None:
    """Stops at -1, 1 and, after an overrun to 1.5, at 1 again; the laser counts down and lags 20 µm on the way back."""
    targets = [(0.0, -1.0, 1101), (10.0, 1.0, 1102), (20.0, 1.5, None), (30.0, 1.0, 2102), (40.0, -1.0, 2101)]
    time = np.arange(0.0, 51.0, 0.1)
    position = np.interp(time, [0, 10, 14, 20, 23, 30, 33, 40, 44, 51], [-1, -1, 1, 1, 1.5, 1.5, 1, 1, -1, -1])
    laser = 40.0 - position - np.where(time > 30.05, 0.02, 0.0)
    tests = [(end - 0.5, float(n)) for (_, _, n), end in zip(targets, (10, 20, 30, 40, 50), strict=True) if n]
    channels = {
        "I:ILD_DownSample": list(zip(time, laser, strict=True)),
        "T:X-PosAct": list(zip(time[::5], position[::5], strict=True)),
        "T:ec0-s10-EL7201-PosAct": list(zip(time, 3.0818e6 * position + 7e5, strict=True)),
        "T:X-PosCmd": [(t, x) for t, x, _ in targets],
        "I:TestNumber": tests,
    }
    write(tmp_path / "ess-xyz" / "invented.log", log_text(channels))
    campaign = convert("ess-xyz", tmp_path)
    stops, scan = campaign.run("invented-stops"), campaign.run("invented-scan")
    assert stops.commands["X"].tolist() == [-1.0, 1.0, 1.5, 1.0, -1.0]
    assert stops.readings["X_act_mm"] == pytest.approx(stops.commands["X"], abs=1e-6)
    assert np.diff(stops.readings["X_dev_um"]) == pytest.approx([0.0, 0.0, 20.0, 0.0], abs=1e-3)
    assert scan.dynamic and scan.rows == 510
    assert stops.has_clock and stops.time[-1] == pytest.approx(40.0, abs=0.1)
    assert np.ptp(scan.readings["X_dev_um"]) == pytest.approx(20.0, abs=1e-3)


# --- rotary axis ---------------------------------------------------------------------------------------------


def wheel(path: Path, turns: bool) -> None:
    time = np.arange(0.0, 24.0, 0.01)
    angle = np.radians(30.0 * time) if turns else np.zeros_like(time)
    channels = {"D:Rotation-PosAct": list(zip(time, np.degrees(angle) % 360.0, strict=True))}
    for k in range(3):
        reading = 11.0 + 0.3 * np.cos(angle + np.radians(120.0 * k))
        channels[f"L:m0s002-AI0{k + 1}"] = list(zip(time + 0.002 * k, reading, strict=True))
    channels["L:m0s002-AI04"] = list(zip(time, 12.0 + 0.1 * np.sin(angle), strict=True))
    write(path, log_text(channels))


def test_wobbling_eccentric_rim_is_one_form_for_all_probes(tmp_path: Path) -> None:
    wheel(tmp_path / "ess-rotary/wobbling/invented.log", turns=True)
    campaign = convert("ess-rotary/wobbling", tmp_path)
    model = Model(campaign)
    run = campaign.runs[0]
    values = {"setup.invented.form.rim.cos1": 300.0, "setup.invented.form.face.sin1": 100.0}
    difference = model.readings(run) - model.predict(values)["invented"]
    assert np.abs(difference - difference.mean(axis=0)).max() < 1.0


def test_wobbling_standstill_has_no_form(tmp_path: Path) -> None:
    wheel(tmp_path / "ess-rotary/wobbling/zero.log", turns=False)
    campaign = convert("ess-rotary/wobbling", tmp_path)
    assert {p.name.split(".")[2] for p in Model(campaign).parameters} == {"zero", "ball"}


def test_coast_down_gives_friction_per_inertia(tmp_path: Path) -> None:
    time = np.arange(0.0, 30.0, 0.01)
    drive = 3.0  # s under power at 2 rad/s, then a = -(0.05 + 0.08 w)
    rest = np.maximum(time - drive, 0.0)
    speed = np.where(time < drive, 2.0, (2.0 + 0.05 / 0.08) * np.exp(-0.08 * rest) - 0.05 / 0.08)
    angle = np.degrees(np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 0.01)]))
    moving = speed > 0.0
    rows = list(zip(time[moving], (angle % 360.0)[moving], strict=True))
    write(tmp_path / "ess-rotary/wobbling/coast.log", log_text({"D:Rotation-PosAct": rows}))
    campaign = convert("ess-rotary/wobbling", tmp_path)
    model = Model(campaign)
    run = campaign.runs[0]
    table = model.linearise(run, model.start)
    found = np.linalg.lstsq(table.jacobian[:, 1, :], run.readings["C_torque_Nm"], rcond=None)[0]
    assert found == pytest.approx([0.08, 0.05], rel=0.05)


def test_radial_load_joins_free_and_loaded_rows(tmp_path: Path) -> None:
    for k, (name, shift) in enumerate({"x_plus_no_load": 0.0, "x_plus_10kN": 0.4}.items()):
        time = 600.0 * k + np.arange(0.0, 1.0, 0.1)
        channels = {f"I:m0s005-AI0{c}": [(t, 11.0 + shift * (c == 1)) for t in time] for c in range(1, 5)}
        write(tmp_path / f"ess-rotary/radial-load/{name}.log", log_text(channels))
    run = convert("ess-rotary/radial-load", tmp_path).run("x_plus")
    assert run.rows == 20 and np.ptp(run.readings["s1_um"]) == pytest.approx(400.0)
    assert np.ptp(run.readings["s2_um"]) == 0.0


# --- slit, arms ----------------------------------------------------------------------------------------------


def test_slit_resolver_against_counter(tmp_path: Path) -> None:
    time = np.arange(0.0, 2.0, 0.01)
    channels = {
        "P:Axis1-PosAct": [(t, 0.25 * t) for t in time],
        "P:ec0-s4-EL7211-Enc-PosAct": [(t, 0.25 * t + 0.2) for t in time],
    }
    write(tmp_path / "jjxray-slit/move.log", log_text(channels))
    write(tmp_path / "jjxray-slit/still.log", log_text({"P:ec0-s4-EL7211-Enc-PosAct": [(t, 0.7) for t in time]}))
    campaign = convert("jjxray-slit", tmp_path)
    model = Model(campaign)
    values = {"setup.move.zero.X": 0.2, "setup.still.zero.X": 0.7}
    for run in campaign.runs:
        assert np.abs(model.readings(run) - model.predict(values)[run.id]).max() < 1e-9


def test_tracker_placement_and_lost_reflectors(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    folder = tmp_path / "irb120-tracker"
    joints = rng.uniform(-60.0, 60.0, (30, 6))
    rotation, position = forward(IRB_AXES, joints)
    turn = forward({"C": ((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))}, np.array([[140.0]]))[0][0]
    shift = np.array([2000.0, 300.0, -500.0])
    for k, ball in enumerate(([390.0, 20.0, 700.0], [390.0, -80.0, 640.0], [400.0, 60.0, 600.0]), start=1):
        points = (rotation @ np.array(ball) + position) @ turn.T + shift
        write(folder / f"measured_SMR_{k}.txt", columns(points))
        base = np.tile(turn @ np.array([100.0 * k, 50.0, 0.0]) + shift, (30, 1))
        base[3] = 0.0
        base[7, 0] += 100.0
        write(folder / f"measured_base_{k}.txt", columns(base))
    write(folder / "generated_joints.txt", columns(joints))
    write(folder / "measured_joints.txt", columns(joints))
    campaign = convert("irb120-tracker", tmp_path)
    assert campaign.run("base-1").rows == 28 and len(campaign.notes) == 6
    assert not any(run.has_clock for run in campaign.runs)
    model = Model(campaign)
    prediction = model.predict(model.start)
    for run in campaign.runs:
        assert np.abs(model.readings(run) - prediction[run.id]).max() < 0.01  # starting values are rounded to 1 µm


def test_arm_in_its_socket_reads_zero(tmp_path: Path) -> None:
    folder = tmp_path / "mukca/panda_1"
    angles = np.random.default_rng(4).uniform(-0.5, 0.5, (1, 7))
    write(folder / "here/hole_0.csv", columns(np.vstack([angles, angles]), ","))
    write(folder / "here/hole_0_pose.csv", "this file is not read\n")
    campaign = convert("mukca/panda_1", tmp_path)
    run = campaign.run("here-hole_0")
    assert not run.has_clock
    rotation, position = forward(PANDA_AXES, np.degrees(angles))
    assert np.asarray(run.table_ball) == pytest.approx(rotation[0] @ np.array(TOOL_BALL) + position[0], abs=1e-3)
    model = Model(campaign)
    assert np.abs(model.predict(model.start)[run.id]).max() < 1.0  # µm: the start is rounded
    write(folder / "here/hole_1.csv", "0.1,0.2\n")
    with pytest.raises(InputError, match="does not hold 7"):
        convert("mukca/panda_1", tmp_path)
