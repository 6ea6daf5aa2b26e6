"""A vibration in recordings whose clocks are not tied to each other: readings that numpy made."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from symfive.campaign import Campaign
from symfive.diagnose import diagnose
from symfive.effects import make_effect
from symfive.identify import fitted_model, identify
from symfive.machine import preset
from symfive.model import read_model, write_model
from symfive.procedures import campaign_of, planar_circle

NOISE_UM, FREQUENCY_HZ, AMPLITUDE_UM = 0.3, 7.3, 1.0


def trembling(phases: tuple[float, ...]) -> Campaign:
    """Circles of a machine without any error that trembles along X, in each file with its own phase at the file's zero."""
    machine = preset("three-axis")
    machine = replace(machine, axes={name: replace(axis, drive=None) for name, axis in machine.axes.items()})
    plan = campaign_of(machine, planar_circle(machine, plane="XY", feed=2400.0, rate_hz=25.0))
    rng, runs = np.random.default_rng(11), []
    for run, phase in zip(plan.runs, phases, strict=True):
        along = (run.commands["X"] - run.commands["X"].mean()) / run.length
        tone = AMPLITUDE_UM * np.sin(2.0 * np.pi * FREQUENCY_HZ * run.time + phase)
        reading = along * tone + rng.normal(0.0, NOISE_UM, run.rows)
        runs.append(replace(run, readings={"dL_um": reading}, noise_um=NOISE_UM))
    return replace(plan, runs=tuple(runs))


@pytest.mark.parametrize("phases", [(0.3, 2.5), (-1.0, -2.2)])
def test_two_files_have_one_vibration(phases: tuple[float, float]) -> None:
    measured = trembling(phases)
    [finding] = diagnose(measured).findings
    assert finding.name == "vibration" and finding.confidence > 0.9
    frequency, seen = finding.parameters["frequency_hz"], finding.parameters["seen"]
    for found, truth in ((frequency, FREQUENCY_HZ), (seen, AMPLITUDE_UM)):
        assert isinstance(found.value, float) and isinstance(found.std, float)
        assert abs(found.value - truth) < 3.0 * found.std
    # Cramér-Rao bound of a tone in recordings with phases of their own (D. Rife & R. Boorstyn 1974); the bar sees half the power
    ratio = NOISE_UM / (AMPLITUDE_UM * np.sqrt(0.5))
    bound = np.sqrt(24.0 / measured.rows) * ratio / (2.0 * np.pi * measured.runs[0].duration)
    assert frequency.std == pytest.approx(bound, rel=0.1)


def test_phases_are_read_back_from_a_model_file(tmp_path: Path) -> None:
    measured = trembling((0.3, 2.5))
    tone = make_effect("vibration", None, frequency_hz=FREQUENCY_HZ, phases=((measured.runs[1].id, 2.0),))
    write_model(fitted_model(identify(measured, effects=[tone])), tmp_path / "model.json")
    [read] = read_model(tmp_path / "model.json").effects
    assert read == tone
