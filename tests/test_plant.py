"""The independent plant agrees with the shared vectors and campaigns, and writes what FORMATS.md says."""

import csv
import json
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import plant
import pytest
from plant.chain import COMPONENTS
from plant.drives import state_matrices
from plant.reader import fit_setup, read_campaign, read_truth
from plant.state import last_sign, since_reversal

DATA = Path(__file__).parent / "data"
CAMPAIGNS = DATA / "campaigns"
DRIVE = plant.Drive(40.0, 300.0, 0.05, 8.0, 0.0)


# --- the chain ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("path", sorted((DATA / "vectors").glob("*.json")), ids=lambda p: p.stem)
def test_chain_agrees_with_the_vectors(path: Path) -> None:
    vector = json.loads(path.read_text())
    tables: dict[str, dict[str, Any]] = {k: {"origin": o} for k, o in vector["origins_mm"].items()}
    for name, direction in vector.get("directions", {}).items():
        tables.setdefault(name, {})["direction"] = direction
    chain = plant.parse_structure(vector["structure"], tables)
    place = {k: v * (1e-6 if k[1] in "ABC" else 1e-3) for k, v in vector["location_errors_um_urad"].items()}
    unit = np.array([1e-3] * 3 + [1e-6] * 3)
    for row in vector["rows"]:
        q = {a.name: np.array([row["command"][a.name]]) for a in chain.axes}
        q = {n: np.deg2rad(v) if chain.axis(n).rotary else v for n, v in q.items()}
        errors = row["error_motions_um_urad"]
        motion = {a.name: unit * [[errors.get(c + a.name, 0.0) for c in COMPONENTS]] for a in chain.axes}
        ball = plant.ball_in_workpiece(chain, q, row["tool_ball_mm"], place, motion)
        assert np.abs(ball - row["ball_in_workpiece_mm"]).max() < 1e-9
        nominal = plant.ball_in_workpiece(chain, q, row["tool_ball_mm"])
        assert np.abs(nominal - row["nominal_ball_in_workpiece_mm"]).max() < 1e-9


@pytest.mark.parametrize("name", plant.TOPOLOGIES)
def test_every_topology_reaches_its_tests_within_travel(name: str) -> None:
    machine = plant.topology(name, {})
    rotary = [axis for axis in machine["axes"] if axis in "ABC"]
    runs = [plant.planar_circle(machine, "xy", sweep_deg=400.0)]
    if len(rotary) == 2:
        tilt = next(axis for axis in rotary if axis != "C")
        poses = plant.grid_poses([-60.0, 0.0, 60.0], range(0, 360, 60))
        runs.append(plant.r_test(machine, "nest", nest=[60.0, 20.0, 80.0], poses=poses, axes=(tilt, "C")))
    for run in runs:
        chain = plant.parse_structure(machine["structure"], machine["axes"])
        q = {a.name: np.deg2rad(run["command"][a.name]) if a.rotary else run["command"][a.name] for a in chain.axes}
        ball = plant.ball_in_workpiece(chain, q, run["tool_ball"])
        far = np.linalg.norm(ball - run["table_ball"], axis=1)
        assert np.abs(far - run.get("length", 0.0)).max() < 1e-9
        for axis, values in run["command"].items():
            assert np.abs(values).max() <= machine["axes"][axis]["travel"][1]


def test_free_axis_names_and_wrong_codes() -> None:
    tables = {"J1": {"kind": "rotary", "direction": [0.0, 0.0, 2.0]}}
    named = plant.parse_structure("w J1' b X Y Z t", tables)
    letter = plant.parse_structure("w C' b X Y Z t")
    rest = {"X": np.array([10.0]), "Y": np.array([-20.0]), "Z": np.array([5.0])}
    a = plant.ball_in_workpiece(named, {"J1": np.array([0.3]), **rest}, [0, 0, -100])
    assert np.allclose(a, plant.ball_in_workpiece(letter, {"C": np.array([0.3]), **rest}, [0, 0, -100]))
    for wrong in ("w C' X Y Z t", "w C b X Y Z t", "w J2' b X Y Z t"):
        with pytest.raises(ValueError, match=r"structural code|wrong side|needs kind"):
            plant.parse_structure(wrong)


# --- the drive ---------------------------------------------------------------------------------------------
def test_drive_follows_the_analytic_ramp_response() -> None:
    t, rate = np.arange(400) * 0.01, 30.0
    a, b = state_matrices(DRIVE)
    # z = x - c, v, I on a ramp: particular solution plus the modes of A
    steady = np.array([-rate / DRIVE.position_gain, rate, DRIVE.viscous * rate * 0.05 / DRIVE.velocity_gain])
    modes, vectors = np.linalg.eig(a)
    weights = np.linalg.solve(vectors, -steady.astype(complex))
    exact = (steady[0] + (vectors[0] * weights * np.exp(np.outer(t, modes))).sum(axis=1)).real + rate * t
    motion = plant.follow(DRIVE, rate * t, 0.01)
    assert np.abs(motion.x - exact).max() < 1e-10
    assert motion.x[-1] - rate * t[-1] == pytest.approx(-rate / 40.0, abs=1e-9)
    assert b.shape == (3, 3)


def test_friction_sticks_until_the_analytic_breakaway() -> None:
    dt, rate, level = 1e-3, 2.0, 200.0
    t = np.arange(200) * dt
    motion = plant.follow(replace(DRIVE, friction=plant.Friction(level)), rate * t, dt, 5e-5)
    # stuck: u = Kv.Kp.rate.(t + t^2 / (2 Ti)) reaches the level
    breakaway = 0.05 * (np.sqrt(1.0 + 2.0 * level / (300.0 * 40.0 * rate * 0.05)) - 1.0)
    assert np.all(motion.x[t < breakaway - 1e-4] == 0.0)
    assert np.all(motion.x[t > breakaway + 2 * dt] > 0.0)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="the plant's friction kernel needs gcc")
@pytest.mark.parametrize(
    "friction",
    [
        plant.Friction(300.0),
        plant.Friction(300.0, 420.0, 2.0, asymmetry=0.1),
        plant.Friction(300.0, 400.0, 2.0, 1e5, 600.0),
    ],
    ids=["coulomb", "stribeck", "lugre"],
)
def test_friction_kernel_equals_plain_python_and_converges(friction: plant.Friction) -> None:
    c = 20.0 * np.cos(2.0 * np.pi * np.arange(200) * 0.01 / 1.5)
    drive = replace(DRIVE, friction=friction, two_mass=plant.TwoMass(60.0, 0.05, 0.3))
    fine = plant.follow(drive, c, 0.01, 2e-5)
    normal = plant.follow(drive, c, 0.01)
    plain = plant.follow(drive, c, 0.01, compiled=False)
    assert np.abs(normal.x - fine.x).max() < 5e-5
    assert np.abs(plain.x - plant.follow(drive, c, 0.01, 5e-4).x).max() < 1e-10
    assert np.abs(plant.follow(replace(drive, friction=plant.Friction()), c, 0.01).x - fine.x).max() > 1e-3


def test_signs_and_reversal_distance() -> None:
    x = np.array([0.0, 0.0, 1.0, 2.0, 1.5, 1.5, 0.0, 3.0])
    assert last_sign(x).tolist() == [1, 1, 1, 1, -1, -1, -1, 1]
    assert since_reversal(x, last_sign(x)).tolist() == [0, 0, 1, 2, 0.5, 0.5, 2, 3]


# --- paths and files ---------------------------------------------------------------------------------------
def campaign_like(name: str) -> list[dict[str, Any]]:
    """The shared campaign's runs as plant.paths generates them."""
    if name == "dynamic-none":
        return [
            plant.synchronous_circle(plant.dynamic_table(), f"x{x}-f{f}-{w}", x_t=float(x) / 2, feed=f, direction=s)
            for x, f, w, s in (("090", 800, "ccw", 1), ("110", 800, "ccw", 1), ("110", 1600, "cw", -1))
        ]
    if name == "planar-none":
        centres = {1: [0.0, 0.0, 80.0], 2: [60.0, -40.0, 80.0]}
        return [
            plant.planar_circle(plant.planar_table(), f"xy-f{f}-{w}-{i}", centre=centres[i], feed=f, direction=s)
            for f, w, s, i in ((800, "ccw", 1, 2), (2400, "cw", -1, 1))
        ]
    table, poses = plant.static_table(), plant.grid_poses(range(-90, 91, 30), range(0, 360, 30))
    if name == "static-none":
        return [plant.r_test(table, "nest2", nest=[50.0, 40.0, 150.0], poses=poses, start_s=1500.0)]
    poses = plant.grid_poses([0.0], range(0, 360, 15), both_ways=False)
    return [plant.static_ball_bar(table, "high", table_ball=[0.0, 0.0, 140.0], poses=poses)]


@pytest.mark.parametrize("name", ["dynamic-none", "planar-none", "static-none", "static-ball-bar-two-heights"])
def test_paths_reproduce_the_shared_commands(name: str) -> None:
    _, shared = read_campaign(CAMPAIGNS / name / "fit")
    by_id = {run["id"]: run for run in shared}
    for mine in campaign_like(name):
        theirs = by_id[mine["id"]]
        for key in plant.campaign.RUN_KEYS:
            assert mine.get(key, theirs.get(key)) == pytest.approx(theirs.get(key)), key
        assert np.allclose(mine["t_s"], theirs["t_s"], atol=1e-6)
        for axis, q in theirs["command"].items():
            assert np.abs(mine["command"][axis] - q).max() < 1e-7


def test_campaign_files_follow_the_format(tmp_path: Path) -> None:
    machine = plant.dynamic_table()
    run = plant.synchronous_circle(machine, "one", x_t=45.0, sweep_deg=40.0, instrument=["ball_bar", "encoder"])
    grid = plant.planar_circle(machine, "two", plane="ZX", sweep_deg=30.0, instrument="grid_encoder", start_s=9.0)
    plant.write_campaign(
        tmp_path, machine, [run, grid], {"EX0C": 3.0}, noise_options=plant.NoiseOptions(missing_rate=0.1)
    )
    assert tomllib.loads((tmp_path / "machine.toml").read_text()) == machine
    campaign = tomllib.loads((tmp_path / "campaign.toml").read_text())
    assert [r["id"] for r in campaign["run"]] == ["one", "two"]
    assert campaign["run"][1]["u"] == [0.0, 0.0, 1.0] and "length" not in campaign["run"][1]
    with (tmp_path / "one.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["t_s", "Y_mm", "A_deg", "C_deg", "X_mm", "Z_mm", "dL_um", "C_act_deg", "X_act_mm"]
    values = np.array(rows, float)
    assert 0.8 < len(values) / len(run["t_s"]) < 0.97
    assert np.all(np.diff(values[:, 0]) > 0.0) and np.isfinite(values).all()
    truth = read_truth(tmp_path)
    assert truth["effects"] == [] and truth["location_errors_um_urad"] == {"EX0C": 3.0}
    plant.write_campaign(tmp_path / "plan", machine, [run], readings=False)
    assert (tmp_path / "plan" / "one.csv").read_text().splitlines()[0] == "t_s,Y_mm,A_deg,C_deg,X_mm,Z_mm"
    assert not (tmp_path / "plan" / "truth.json").exists()


def test_seed_decides_everything_and_runs_are_independent(tmp_path: Path) -> None:
    runs = campaign_like("static-none") + campaign_like("static-ball-bar-two-heights")
    options = replace(plant.LIKE_PLANAR, missing_rate=0.05, walk_um_per_sqrt_s=0.01, drift_um=0.2, quantum_um=0.1)
    for name, seed, some in (("a", 1, runs), ("b", 1, runs), ("c", 2, runs), ("d", 1, runs[:1])):
        plant.write_pair(tmp_path / name, plant.static_table(), some, [], seed=seed, noise_options=options)
    texts = {k: (tmp_path / k / "fit" / "nest2.csv").read_text() for k in "abcd"}
    assert texts["a"] == texts["b"] == texts["d"] != texts["c"]


# --- the shared campaigns are reproduced to their noise ----------------------------------------------------
SAG = {"effect": "gravity_sag", "axis": "B", "component": "EZB", "amplitude": 7.0, "form": "one_minus_cos"}
DRIFT = {
    "effect": "thermal_drift",
    "direction": [0.0, 0.28, 0.96],
    "amplitude": 10.77,
    "time_constant_s": 1114.0,
}


@pytest.mark.parametrize(
    ("name", "effects", "low", "high"),
    [
        ("dynamic-none", [], 0.29, 0.31),
        ("dynamic-backlash", None, 0.29, 0.315),
        ("planar-none", [], 0.29, 0.45),
        ("static-none", [], 0.35, 0.45),
        ("static-ball-bar-two-heights", [], 0.28, 0.48),
        ("static-sag-and-drift", [SAG, DRIFT], 0.35, 0.45),
    ],
)
def test_plant_explains_the_shared_campaign(name: str, effects: list[Any] | None, low: float, high: float) -> None:
    truth = read_truth(CAMPAIGNS / name)
    for part in ("fit", "heldout"):
        machine, runs = read_campaign(CAMPAIGNS / name / part)
        for run in runs:
            used = truth["effects"] if effects is None else effects
            place = {k: v for k, v in truth["location_errors_um_urad"].items() if k[2] == "0"}
            setup, residual = fit_setup(machine, run, place, used)
            assert low < residual.std() < high, (run["id"], residual.std())
            if "length" in setup:
                assert abs(setup["length"]) < 2.5


def test_shared_backlash_is_seen_only_with_the_lag_behind_the_drive() -> None:
    machine, runs = read_campaign(CAMPAIGNS / "dynamic-backlash" / "fit")
    truth = read_truth(CAMPAIGNS / "dynamic-backlash")
    run = next(r for r in runs if r["id"] == "x110-f800-cw")
    spec = truth["effects"][0]
    rms = [
        fit_setup(machine, run, truth["location_errors_um_urad"], [{**spec, "width": w}])[1].std()
        for w in (-80.0, 0.01, 80.0)
    ]
    assert rms[2] < 0.31 < 0.35 < rms[1] < rms[0]
