"""What the rows of a recording do not show of the motion, as of an axis that starts within two of them, no reading tells."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import plant
import pytest
from plant.campaign import machine_toml
from scipy.signal import lfilter

from symfive.arrays import Array
from symfive.campaign import Campaign, Run
from symfive.diagnose import diagnose
from symfive.effects import make_effect
from symfive.identify import Identification, identify
from symfive.machine import read_machine

FINE_S, ROW_S, LAG_S, NOISE_UM = 1e-4, 0.01, 1.0 / 45.0, 0.2
RADIUS, ACCELERATION = 80.0, 3000.0
"""mm, and mm/s²: the feed is there after two rows."""


def angle_of(feed: float, rest_s: float) -> Array:
    """A turn from rest to rest at a feed (mm/s), in steps of `FINE_S`, rad."""
    ramp, length = feed / ACCELERATION, 2.0 * np.pi * RADIUS
    time = np.arange(-rest_s, length / feed + ramp + 0.3, FINE_S)
    speed = np.clip(np.minimum(time, length / feed + ramp - time) * ACCELERATION, 0.0, feed)
    return np.cumsum(speed) * FINE_S / RADIUS


def late(way: Array) -> Array:
    """τ·dy/dt + y = x, from rest, x linear within a step."""
    left = np.exp(-FINE_S / LAG_S)
    share = LAG_S / FINE_S * (1.0 - left)
    return np.asarray(way[0] + lfilter([1.0 - share, share - left], [1.0, -left], way - way[0]))


def circles(folder: Path, feed: float = 50.0, rest_s: float = 0.3, begin_s: float = 0.0) -> Campaign:
    """Both ways on a grid encoder at 100 rows a second, as a control records them: somewhere between its own steps."""
    machine = plant.planar_table()
    for axis in machine["axes"].values():
        axis.pop("drive", None)
    (folder / "machine.toml").write_text(machine_toml(machine))
    rng, runs, told = np.random.default_rng(3), list[Run](), read_machine(folder / "machine.toml")
    for name, sign in (("ccw", 1.0), ("cw", -1.0)):
        angle = sign * angle_of(feed, rest_s)
        x, y = RADIUS * np.cos(angle), RADIUS * np.sin(angle)
        rows = np.arange(round((begin_s + 0.0037) / FINE_S), len(angle), round(ROW_S / FINE_S))
        seen = {"du_um": 1e3 * late(x)[rows], "dv_um": 1e3 * late(y)[rows]}
        still = {axis: np.zeros(len(rows)) for axis in told.axes}
        runs.append(Run(
            id=name, instrument=("grid_encoder",), sampling="dynamic", time=ROW_S * np.arange(len(rows)),
            commands=still | {"X": x[rows], "Y": y[rows], "Z": np.full(len(rows), 150.0)}, noise_um=NOISE_UM,
            readings={column: way + rng.normal(0.0, NOISE_UM, len(rows)) for column, way in seen.items()},
            tool_ball=(0.0, 0.0, -150.0), u=(1.0, 0.0, 0.0), v=(0.0, 1.0, 0.0), options={"between": "curve"},
        ))  # fmt: skip
    return Campaign(machine=told, runs=tuple(runs))


def followed(campaign: Campaign) -> Identification:
    """The fit with a lag of all axes."""
    return identify(campaign, effects=[make_effect("following_lag")], noise="declared")


@pytest.mark.parametrize(("rest_s", "begin_s", "loud"), [(0.3, 0.0, 6.0), (0.0, 0.0, 20.0), (0.3, 0.8, 1000.0)])
def test_readings_count_as_far_as_the_rows_tell_the_motion(
    tmp_path: Path, rest_s: float, begin_s: float, loud: float
) -> None:
    """From rest, from within the start, and begun in motion: the readings there are far from the fit, and count for no more than
    noise; those of the circle count whole, and all of them say that the lag is right."""
    fit = followed(circles(tmp_path, rest_s=rest_s, begin_s=begin_s))
    for run in fit.model.campaign.runs:
        weights, off = fit.weights[run.id], np.abs(fit.residuals[run.id]) / NOISE_UM
        assert off.max() > loud
        assert (weights * off).max() < 4.5
        middle = slice(run.rows // 3, run.rows // 2)
        assert weights[middle].min() > 0.99
    assert fit.uncertainty("following_lag.lag_ms") < 0.01
    assert fit["following_lag.lag_ms"] == pytest.approx(1e3 * LAG_S, abs=3.0 * fit.uncertainty("following_lag.lag_ms"))
    assert fit.rms_um == pytest.approx(NOISE_UM, rel=0.1)
    assert fit.fits == "yes"
    assert any("hardly count" in note for note in fit.notes)


def test_what_is_stated_is_taken_for_known(tmp_path: Path) -> None:
    """Straight lines between the rows, or a beginning at rest: the campaign says so."""
    campaign = circles(tmp_path, rest_s=0.0, begin_s=0.4)

    def least(**options: str) -> float:
        runs = [replace(run, options={**run.options, **options}) for run in campaign.runs]
        weights = followed(replace(campaign, runs=tuple(runs))).weights
        return min((float(w[:10].min()) for w in weights.values()), default=1.0)

    assert least() < 0.01
    assert least(start="rest") > 0.9
    assert least(between="line") == 1.0


@pytest.mark.slow
def test_a_start_between_two_rows_brings_no_effect(tmp_path: Path) -> None:
    """The lag is named, and no compliance beside it (99.9 % where the rows count for exact)."""
    found = diagnose(circles(tmp_path))
    assert [(f.name, f.axis) for f in found.findings] == [("servo_mismatch", None)]
