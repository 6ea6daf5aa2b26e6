"""A ball bar that is not as long as stated: readings that numpy made."""

from dataclasses import replace

import numpy as np
import pytest
from lean import without_drives

from symfive.campaign import Campaign
from symfive.diagnose import diagnose
from symfive.machine import preset
from symfive.procedures import campaign_of, planar_circle

NOISE_UM = 0.3


def circles(too_long_um: float) -> Campaign:
    """Circles in XY and ZX of a machine without any error, axes without drives."""
    machine = without_drives(preset("three-axis"))
    plans = [planar_circle(machine, plane=plane, direction="ccw", feed=2000.0, rate_hz=4.0) for plane in ("XY", "ZX")]
    plan, rng = campaign_of(machine, [run for runs in plans for run in runs]), np.random.default_rng(3)
    runs = [
        replace(r, readings={"dL_um": rng.normal(-too_long_um, NOISE_UM, r.rows)}, noise_um=NOISE_UM) for r in plan.runs
    ]
    return replace(plan, runs=tuple(runs))


@pytest.mark.slow
def test_a_bar_that_is_longer_than_stated_is_the_bar_s_fault() -> None:
    [finding] = diagnose(circles(25.0)).findings
    assert (finding.name, finding.axis, finding.effect.id) == ("sensor_error", None, "bar_length")
    error = finding.parameters["error"]
    assert isinstance(error.value, float) and isinstance(error.std, float)
    assert abs(error.value - 25.0) < 3.0 * error.std < 10.0


@pytest.mark.parametrize("too_long_um", [0.5, pytest.param(0.0, marks=pytest.mark.slow)])
def test_a_bar_within_its_calibration_is_no_fault(too_long_um: float) -> None:
    assert not diagnose(circles(too_long_um)).findings
