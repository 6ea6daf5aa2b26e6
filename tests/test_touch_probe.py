"""Touch probe and calibration sphere against the independent plant, which touches, fits spheres and searches for coordinates."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import plant
import pytest
from lean import location_only
from plant import LOCATION

from symfive.campaign import Campaign, Run, SetupSigma, read_campaign
from symfive.cli import main
from symfive.design import assess, plan
from symfive.diagnose import diagnose
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.identify import identify
from symfive.machine import machine_from_data, preset, read_machine, write_machine
from symfive.model import Model
from symfive.nc import program, touch_reach
from symfive.procedures import r_test_grid
from symfive.simulate import simulate
from tests.plan_checker.machines import random_machine

MOTION = {"EXC": {"basis": "fourier", "order": 1, "sigma": 9.0}, "EYX": {"basis": "polynomial", "order": 2, "sigma": 9.0},
          "EXX": {"basis": "polynomial", "order": 3, "sigma": 9.0}}  # fmt: skip
SIZES = {"EXC.cos1": 4.0, "EXC.sin1": -3.0, "EYX.P2": 6.0, "EYX.P1": -2.0, "EXX.P1": 7.0, "EXX.P2": 3.0, "EXX.P3": -5.0}
SETUP = {
    "table_ball": [140.0, -90.0, 60.0],
    "tool_ball": [11.0, -7.0, 5.0],
    "lobing": [6.0, -4.0],
    "length": 0.0,
    "zero": [],
}
ONE_WAY = plant.grid_poses([-50.0, -20.0, 35.0], [0.0, 75.0, 160.0, 250.0], both_ways=False)
POSES = np.concatenate([ONE_WAY, ONE_WAY[::-1]])
DENSE = [[0, 0, 1], [0.9, 0, 0.3], [-0.4, 0.8, 0.2], [-0.5, -0.7, 0], [0.3, -0.8, 0.5], [0.6, 0.6, 0.4]]


def probe_run(machine: dict, poses: np.ndarray = POSES, **more: object) -> dict:
    run = plant.r_test(machine, "sphere-1", nest=[90.0, -25.0, 80.0], poses=poses, noise_um=1.0, sigma_um=100.0)
    return {**run, "instrument": "touch_probe", **more}


def campaign_of(table: dict, run: dict, errors: dict) -> Campaign:
    machine = machine_from_data({"schema": "symfive.machine/1", **{**table, "errors": errors}})
    options = {k: run[k] for k in ("lobing_sigma_um", "touches", "touch_frame") if k in run}
    planned = Run(
        id=run["id"], instrument=("touch_probe",), sampling="static", time=run["t_s"],
        commands={n: np.round(np.broadcast_to(run["command"].get(n, 0.0), len(run["t_s"])), 7) for n in machine.axis_names},
        table_ball=tuple(run["table_ball"]), tool_ball=tuple(run["tool_ball"]), noise_um=1.0, options=options,
    )  # fmt: skip
    return Campaign(machine=machine, runs=(planned,))


def true_motions(table: dict) -> dict:
    """The error motions as functions of the coordinate, written out."""
    low, high = table["axes"]["X"]["travel"]

    def legendre(*c: float):
        return lambda q: np.polynomial.legendre.legval((2 * q - low - high) / (high - low), [0.0, *c])

    return {
        "EXC": lambda q: 4.0 * np.cos(np.deg2rad(q)) - 3.0 * np.sin(np.deg2rad(q)),
        "EYX": legendre(-2.0, 6.0),
        "EXX": legendre(7.0, 3.0, -5.0),
    }


@pytest.mark.parametrize(
    ("topology", "more"),
    [
        ("table-bc", {}),
        ("nutating-table", {}),
        ("head-cb", {}),
        ("head-cb", {"lobing_sigma_um": 5.0}),
        ("head-cb", {"lobing_sigma_um": 5.0, "touch_frame": "machine", "touches": DENSE}),
        ("mixed-c-b", {"lobing_sigma_um": 5.0, "touch_frame": "machine"}),
    ],
)
def test_readings_and_derivatives_agree_with_the_plant(topology, more):
    table = plant.topology(topology, {})
    lobed = bool(more)
    run = probe_run(table, ONE_WAY[::2] if lobed else ONE_WAY, **more)
    truth = SETUP if lobed else {**SETUP, "lobing": [0.0, 0.0]}
    campaign = campaign_of(table, run, {**{n: {"sigma": 50.0} for n in LOCATION}, **MOTION})
    model = Model(campaign)
    values = {**LOCATION, **SIZES}
    for ball in ("table_ball", "tool_ball"):
        values |= {f"setup.sphere-1.{ball}.{c}": v for c, v in zip("xyz", SETUP[ball], strict=True)}
    if lobed:
        values |= {f"setup.sphere-1.lobing.{f}": v for f, v in zip(("cos", "sin"), SETUP["lobing"], strict=True)}

    def measured(location: dict, setup_um: dict) -> np.ndarray:
        found = plant.simulate_run(
            table, {**run, "setup_um": setup_um}, location, true_motions(table), noise_options=plant.QUIET
        )
        assert found.columns == ["X_dev_um", "Y_dev_um", "Z_dev_um"]
        return found.values

    read = measured(LOCATION, truth)
    assert np.abs(read).max() > 50.0
    # 1e-9 mm; lobes of 7 µm bend the fit of a sphere of 12.5 mm by their square over its radius
    assert model.predict(values)["sphere-1"] == pytest.approx(read, abs=4e-3 if lobed else 1e-6)

    linear = model.linearise("sphere-1", values)
    slopes = dict(
        zip([model.parameters[i].name for i in linear.columns], np.moveaxis(linear.jacobian, 2, 0), strict=True)
    )
    # each by itself, or of lobed tips, whose spheres the plant searches, all along one drawn direction
    drawn = dict(zip(LOCATION, np.random.default_rng(1).normal(size=len(LOCATION)), strict=True))
    for way in [drawn] if lobed else [{name: 1.0} for name in LOCATION]:
        ends = [measured({n: v + s * way.get(n, 0.0) for n, v in LOCATION.items()}, truth) for s in (20.0, -20.0)]
        along = sum(share * slopes[name] for name, share in way.items())
        assert along == pytest.approx((ends[0] - ends[1]) / 40.0, abs=2e-6 * sum(map(abs, way.values()))), way
    for k, ball in enumerate(("table_ball", "tool_ball", "lobing")[: 3 if lobed else 2]):
        ends = [measured(LOCATION, {**truth, ball: [truth[ball][0] + s, *truth[ball][1:]]}) for s in (1.0, -1.0)]
        name = f"setup.sphere-1.{ball}." + ("x", "x", "cos")[k]
        assert slopes[name] == pytest.approx((ends[0] - ends[1]) / 2.0, abs=1e-3 if k == 2 else 2e-6), name


@pytest.fixture(scope="module")
def trunnion() -> dict:
    return plant.static_table()


def measured_campaign(trunnion: dict, folder, seed: int) -> tuple[Campaign, dict]:
    """A trunnion table with eight drawn location errors, probed with 1 µm of noise in a place known to 0.1 mm."""
    rng = np.random.default_rng(seed)
    truth = {name: float(rng.normal(0.0, term["sigma"])) for name, term in trunnion["errors"].items()}
    run = probe_run(trunnion, setup_sigma_um={"table_ball": 100.0, "tool_ball": 1.0})
    plant.write_campaign(folder, trunnion, [run], truth, seed=seed)
    return read_campaign(folder), truth


def test_eight_location_errors_of_a_trunnion_table(trunnion, tmp_path):
    campaign, truth = measured_campaign(trunnion, tmp_path / "one", 3)
    result = identify(campaign)
    assert set(truth) == {"EX0B", "EZ0B", "EA0B", "EC0B", "EX0C", "EY0C", "EA0C", "EB0C"}
    for name, value in truth.items():
        assert abs(result[name] - value) < 2.0 * result.uncertainty(name), name
        assert result.uncertainty(name) < 0.2 * trunnion["errors"][name]["sigma"], name
    assert result.rms_um == pytest.approx(1.0, rel=0.25)


def test_its_uncertainties_hold_over_machines(trunnion, tmp_path):
    scores = []
    for seed in range(20):
        campaign, truth = measured_campaign(trunnion, tmp_path / str(seed), 100 + seed)
        found = identify(campaign)
        scores += [(found[name] - value) / found.uncertainty(name) for name, value in truth.items()]
    assert np.mean(np.abs(scores) < 2.0) > 0.90
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1.0, abs=0.2)


def test_what_a_probe_cannot_see_is_named():
    chosen = plan(
        location_only("table-bc"), instrument="touch_probe", points=10, setups=1, starts=1, anywhere=False, prove=False,
        noise_um=1.0, setup_sigma=SetupSigma(table_ball=100.0, tool_ball=20.0),
    )  # fmt: skip
    run = chosen.campaign.runs[0]
    assert chosen.instrument == "touch_probe" and np.abs(run.commands["B"]).max() <= 50.0 + 1e-6
    assert chosen.unsafe[run.id] == tuple(range(1, run.rows))
    said = [group.names for group in assess(chosen.campaign).confounded]
    assert any({"EZ0B", f"setup.{run.id}.tool_ball.z"} <= set(group) for group in said), said
    results = [identify(simulate(chosen.campaign, seed=seed).campaign) for seed in range(3)]
    assert np.mean([result.chi2_dof for result in results]) == pytest.approx(1.0, abs=0.3)


def test_a_plan_leaves_travel_for_the_way_around_the_sphere(tmp_path):
    """A head that tilts with Y on it: the more it does, the farther Y has to go for the same millimetre."""
    (tmp_path / "machine.toml").write_text(random_machine(0), encoding="utf-8")
    machine = read_machine(tmp_path / "machine.toml")
    assert machine.structure.code == "w b Z A X Y t"
    made = plan(machine, instrument="touch_probe", points=6, setups=1, starts=1, anywhere=False, prove=False)
    (run,) = made.campaign.runs
    assert "DPRNT[R7T4" in program(machine, run, "iso", made.post)  # raises where a touch is beyond the travel
    room = machine.axes["Y"].travel[1] - run.commands["Y"]
    need = touch_reach(machine) / np.cos(np.deg2rad(run.commands["A"]))
    assert np.all(room >= need - 0.1)
    assert np.any(room < need + 5.0), "some pose lies at that limit"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"touches": [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]}, "do not make a centre"),
        ({"touches": [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [1, 1, 0]]}, "do not determine"),
        ({"touch_frame": "table"}, "touch_frame"),
        ({"lobing_sigma_um": -1.0}, "lobing_sigma_um"),
    ],
)  # fmt: skip
def test_touches_that_make_no_centre_are_refused(trunnion, tmp_path, options, words):
    plant.write_campaign(tmp_path, trunnion, [probe_run(trunnion, **options)], readings=False)
    with pytest.raises(InputError, match=words) as refused:
        read_campaign(tmp_path)
    assert "campaign.toml" in str(refused.value)


def test_a_recording_is_no_probing(trunnion, tmp_path):
    plant.write_campaign(tmp_path, trunnion, [probe_run(trunnion, sampling="dynamic")], readings=False)
    with pytest.raises(InputError, match="at rest"):
        read_campaign(tmp_path)


@pytest.mark.slow
def test_a_play_of_the_tilting_axis_is_named_from_probed_centres(tmp_path: Path) -> None:
    """Centres approached from both sides: B's play behind its drive, and nothing beside it."""
    machine = location_only("table-bc")
    angles = {"B": (-45.0, -15.0, 15.0, 45.0), "C": (0.0, 90.0, 180.0, 270.0)}
    (found,) = r_test_grid(machine, grid=angles, nests=((90.0, -25.0, 80.0),), returning=True)
    run = replace(
        found,
        id="sphere-1",
        file="",
        instrument=("touch_probe",),
        noise_um=0.5,
        setup_sigma_um=SetupSigma(tool_ball=5.0),
    )
    planned = Campaign(machine=machine, runs=(run,))
    measured = simulate(
        planned, truth={"backlash.B.width": 60.0}, effects=[make_effect("backlash", "B")], seed=3
    ).campaign
    (finding,) = diagnose(measured).findings
    assert (finding.name, finding.axis) == ("backlash", "B")
    width = finding.parameters["width"]
    assert abs(width.value - 60.0) < 3.0 * width.std < 9.0


def test_sphere_and_tip_are_the_users_on_the_command_line(tmp_path: Path) -> None:
    machine = preset("table-bc")
    write_machine(replace(machine, errors={"EX0C": machine.errors["EX0C"]}, text=""), tmp_path / "machine.toml")
    words = ["--instrument", "touch_probe", "--points", "4", "--setups", "1", "--starts", "1", "--returns", "0", "-q"]
    words += ["--sphere-radius", "15", "--tip-radius", "2", "--nc", "linuxcnc", "--no-proof"]
    assert main(["plan", str(tmp_path / "machine.toml"), "-o", str(tmp_path / "plan"), *words]) == 0
    text = next((tmp_path / "plan" / "nc" / "linuxcnc").iterdir()).read_text()
    assert "sphere radius 15, tip radius 2" in text
    sheet = (tmp_path / "plan" / "setup.html").read_text()
    assert "Sphere of radius 15 mm, tip of radius 2 mm" in sheet
    assert "Centre of the tip at" in sheet and "With the centre of the tip there" in sheet and "ool ball" not in sheet
    assert (
        "Probe its centre with the rotary axes as below" in sheet and "under it" not in sheet
    )  # no tip gets into a sphere


@pytest.mark.parametrize(("instrument", "frame"), [("r_test", "table"), ("touch_probe", "tool")])
def test_a_frame_that_cannot_be_is_refused(instrument: str, frame: str) -> None:
    with pytest.raises(InputError, match="frame"):
        plan("table-bc", instrument=instrument, points=4, frame=frame)


def test_a_head_in_the_spindle_is_planned_in_its_frame() -> None:
    """In the tool's frame the table ball is a nuisance that turns with the table."""
    made = plan(location_only("table-bc"), points=8, setups=1, starts=1, anywhere=False, prove=False, frame="tool")
    assert all(run.options["frame"] == "tool" for run in made.campaign.runs)
    names = [p.name for p in made.assessment.parameters]
    assert "setup.head-1.table_ball.x" in names and "setup.head-1.tool_ball.x" not in names
