"""The recordings of others, where they are (`SYMFIVE_DATA`): converted, written, read back, fitted by the baseline."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from symfive.campaign import Campaign, read_campaign, write_campaign
from symfive.convert import CONVERTERS, convert, data_folder
from symfive.convert.mukca import AXES, PANDA_A, PANDA_ALPHA, PANDA_D
from symfive.diagnose import diagnose
from symfive.errors import InputError
from symfive.kinematics import axes_of_modified_dh, forward
from symfive.model import Model

FLANGE_TO_HAND_MM = 210.4  # the controller's end-effector frame lies this far along z of frame 7


def recordings(name: str) -> Path:
    """The recording's folder, or a visible skip."""
    try:
        folder = data_folder() / name
    except InputError as error:
        pytest.skip(str(error))
    if not folder.is_dir():
        pytest.skip(f"the recording {name} is not in {folder.parent}")
    return folder


def least_squares(model: Model, run_id: str, column: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values, their standard deviations and residuals of a column that is linear in all parameters."""
    run = model.campaign.run(run_id)
    table = model.linearise(run, model.start)
    matrix, reading = table.jacobian[:, column, :], model.readings(run)[:, column]
    values = np.linalg.lstsq(matrix, reading, rcond=None)[0]
    residual = reading - matrix @ values
    variance = residual @ residual / (len(reading) - len(values))
    return values, np.sqrt(variance * np.diag(np.linalg.inv(matrix.T @ matrix))), residual


def published_mass_std(campaign: Campaign) -> float:
    """Uncertainty in kg of the mass in the published model: spread of ten tenths, for its residual is no white noise."""
    model = Model(campaign)
    (run,) = campaign.runs
    matrix, reading = model.linearise(run, model.start).jacobian[:, 1, :], model.readings(run)[:, 1]
    tenths = np.array_split(np.arange(len(reading)), 10)
    return float(
        np.std([np.linalg.lstsq(matrix[at], reading[at], rcond=None)[0][0] for at in tenths], ddof=1) / np.sqrt(10.0)
    )


@pytest.mark.parametrize("name", CONVERTERS)
def test_conversion_survives_the_disk(name: str, tmp_path: Path) -> None:
    recordings(name)
    campaign = convert(name)
    assert campaign.measured
    write_campaign(campaign, tmp_path / "campaign")
    again = read_campaign(tmp_path / "campaign")
    for run in campaign.runs:
        for column, values in run.readings.items():
            assert np.array_equal(again.run(run.id).readings[column], values)
        assert np.array_equal(again.run(run.id).time, run.time)
    model = Model(campaign)
    for run_id, prediction in model.predict(model.start).items():
        assert np.isfinite(prediction).all(), run_id


@pytest.mark.slow
def test_emps_without_its_friction_gets_a_friction_and_the_instant_of_its_force() -> None:
    """Mass and viscous friction alone; published: 95.11 kg, 20.39 N, and 2.2 N are left (A. Janot et al. 2019). The force is a
    sample of the 1 kHz control ahead of the position."""
    recordings("emps")
    full = convert("emps")
    bare = [replace(run, options={**run.options, "force_terms": ("mass", "viscous")}) for run in full.runs]
    found = diagnose(replace(full, runs=tuple(bare)), exclude=("varying",))
    first = found.findings[0]
    assert (first.name, first.axis) == ("friction", "X") and first.confidence > 0.8
    offset = first.parameters["offset"]  # N, published -3.16; its law and what that is off by share it
    assert abs(offset.value + 3.16) < 2.0 * offset.std < 6.0
    sizes = {
        name: size
        for f in found.findings
        for own in (f.parameters, *(q for _, q in f.further))
        for name, size in own.items()
    }
    assert sizes["delay_ms"].value == pytest.approx(-0.87, abs=0.05)
    mass, std = found.after["drive_force.X.mass"], found.after.uncertainty("drive_force.X.mass")
    assert abs(mass - 95.11) < 3.0 * np.hypot(std, published_mass_std(full)) and std < 0.3
    assert found.after.rms["N"] < 1.0 and found.fit.heldout_rms_after_um < 0.2 * found.fit.heldout_rms_before_um


def test_emps_least_squares_agrees_with_the_published_model() -> None:
    """Mass 95.11 kg, viscous 203.5 N s/m, Coulomb 20.39 N, offset -3.16 N (A. Janot, M. Gautier & M. Brunot 2019)."""
    recordings("emps")
    values, std, residual = least_squares(Model(convert("emps")), "DATA_EMPS", 1)
    assert np.all(np.abs(values - np.array([95.11, 203.5, 20.39, -3.16])) < 2.0 * std)
    assert np.all(std < [0.2, 2.0, 0.2, 0.1])
    assert 2.0 < residual.std() < 2.4  # N: what the four terms leave


def test_x_stops_agree_with_the_file_of_the_test_script() -> None:
    """The .dat file and the raw log are two ways to the same test: same order, same direction, same deviations."""
    recordings("ess-xyz")
    campaign = convert("ess-xyz")
    script, stops = campaign.run("b02_x_target_x"), campaign.run("b02_x_230_2-stops")
    inner = np.abs(stops.commands["X"]) < 20.2  # without the overruns
    assert stops.commands["X"][inner] == pytest.approx(script.commands["X"], abs=1e-3)
    difference = stops.readings["X_dev_um"][inner] - script.readings["X_dev_um"]
    assert difference.std() < 1.0


def test_panda_chain_is_the_controllers_own() -> None:
    """The chain against the controller's poses: to 1e-6 m where joints and pose were taken at one instant."""
    folder = recordings("mukca")
    _, turn, place = axes_of_modified_dh(PANDA_A, PANDA_D, PANDA_ALPHA)
    distances = []
    for path in sorted(folder.glob("panda_*/*/hole_[0-9].csv")):
        angles = np.degrees(np.loadtxt(path, delimiter=","))
        poses = np.loadtxt(path.with_name(f"{path.stem}_pose.csv"), delimiter=",")
        if len(poses) != len(angles):  # one file pair is not row by row
            continue
        rotation, position = forward(AXES, angles)
        hand = rotation @ (place + turn @ np.array([0.0, 0.0, FLANGE_TO_HAND_MM])) + position
        distances.append(np.linalg.norm(hand - 1e3 * poses[:, :3], axis=1))
    distance = np.concatenate(distances)
    assert distance.min() < 2e-3
    assert np.median(distance) < 0.025  # mm
