"""The files of a diagnosis, where a machine lacks what its programs need."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from symfive.campaign import Campaign, Run, read_campaign
from symfive.design import Discrimination, Separation
from symfive.diagnose import diagnose
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.machine import machine_from_data
from symfive.nc import upright_axis
from symfive.results import write_diagnosis
from symfive.simulate import simulate

DRIVE = {
    "position_gain": 10.0, "velocity_gain": 100.0, "integral_time": 1.0, "viscous": 5.0, "feedforward": 0.0,
}  # fmt: skip
ROTARY = machine_from_data(
    {
        "schema": "symfive.machine/1",
        "name": "rotary axis alone",
        "structure": "w C' b t",
        "axes": {"C": {"travel": [-20.0, 20.0], "drive": DRIVE}},
    }
)


def test_a_machine_without_a_linear_axis_has_results_and_the_plan_of_its_test(tmp_path: Path) -> None:
    time = 0.05 * np.arange(200.0)
    run = Run(
        id="sine", instrument=("encoder",), sampling="dynamic", time=time, commands={"C": 10.0 * np.sin(1.3 * time)},
        noise_um=0.01, options={"encoder_axes": ["C"], "encoder_zero_sigma": 1.0},
    )  # fmt: skip
    plan = Campaign(machine=ROTARY, runs=(run,))
    slow = {"servo_mismatch.C.position_gain": 6.0}
    found = diagnose(simulate(plan, effects=[make_effect("servo_mismatch", "C")], truth=slow, seed=1).campaign)
    test = Discrimination(plan, 40.0, 2.0, (Separation("sine again", 40.0, 40.0),))
    asking = replace(found.findings[0], next_test="plans/apart", test=test)
    write_diagnosis(replace(found, findings=(asking,)), tmp_path)
    assert (tmp_path / "diagnosis.json").exists() and (tmp_path / "report.html").exists()
    assert read_campaign(tmp_path / "plans" / "apart").rows == 200


def test_without_a_linear_axis_no_program_can_draw_the_tool_back() -> None:
    with pytest.raises(InputError, match="no linear axis"):
        upright_axis(ROTARY)
