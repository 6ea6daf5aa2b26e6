"""An axis whose drive the machine file does not state need not follow its command exactly: a lag of its own is a candidate."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import plant
import pytest
from laser_world import axis_alone
from lean import without_drives

from symfive.arrays import Array
from symfive.campaign import Campaign, Run, read_campaign
from symfive.diagnose import diagnose
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.identify import identify
from symfive.machine import Drive
from symfive.model import Model
from symfive.motion import LAG, LAG_OF_ALL, AxisMotion, Late, RunMotion, Series
from symfive.posterior import Moments, baseline, candidates, log_evidence, moments_of

LAG_S, RATE = 0.024, 0.7
NONE: Mapping[str, float] = {}
LOOP = {"velocity_gain": 5e3, "integral_time": 1.0, "viscous": 0.0, "feedforward": 0.0}


def told(folder: Path) -> Campaign:
    """The campaign of a folder, its machine file without drives."""
    campaign = read_campaign(folder)
    return campaign.with_machine(without_drives(campaign.machine))


def circles(
    folder: Path,
    lags: Mapping[str, float] = NONE,
    effects: Sequence[dict[str, Any]] = (),
    instrument: str = "ball_bar",
    interval_s: float = 0.04,
) -> Campaign:
    """Circles both ways at two feeds by the independent plant, read with a machine file that states no drive: axes follow late
    by their `lags`, s, the others exactly."""
    machine = plant.planar_table()
    for name, axis in machine["axes"].items():
        axis.pop("drive", None)
        if name in lags:
            axis["drive"] = LOOP | {"position_gain": 1.0 / lags[name]}
    path = {"sweep_deg": 360.0, "centre": (20.0, -10.0, 80.0), "instrument": instrument, "dt": interval_s}
    runs = [
        plant.planar_circle(machine, f"{name}-{feed:.0f}", feed=feed, direction=sign, **path)
        for feed in (1000.0, 3000.0)
        for name, sign in (("ccw", 1), ("cw", -1))
    ]
    plant.write_campaign(folder, machine, runs, effects=effects, seed=7)
    return told(folder)


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """Nothing is wrong."""
    return circles(tmp_path_factory.mktemp("still"))


def followed(campaign: Campaign, run: Run, lag: float) -> Series:
    """Y with a lag, s."""
    return RunMotion(run, campaign.machine, {("Y", LAG): "lag"}, {"lag": lag}).axis("Y").position


def in_small_steps(command: Array, interval: float, parts: int = 400) -> Array:
    """τ·dy/dt + y = x by the rule of the middle, x linear between rows."""
    found, h = [command[0]], interval / parts / LAG_S
    for before, after in pairwise(command):
        y = found[-1]
        for k in range(parts):
            x = before + (after - before) * (k + 0.5) / parts
            y += h * (x - (y + 0.5 * h * (x - y)))
        found.append(y)
    return np.array(found)


def test_the_lag_is_that_of_its_differential_equation(still: Campaign) -> None:
    run = still.runs[2]
    lagged, rows = followed(still, run, LAG_S), 150
    assert lagged.value[:rows] == pytest.approx(in_small_steps(run.commands["Y"][:rows], run.interval), abs=1e-5)
    h = 1e-6
    slope = (followed(still, run, LAG_S + h).value - followed(still, run, LAG_S - h).value) / (2.0 * h)
    assert lagged.tangents["lag"] == pytest.approx(slope, rel=1e-6, abs=1e-6)
    assert followed(still, run, 0.0).value == pytest.approx(run.commands["Y"], abs=1e-12)


def test_the_lag_of_an_axis_comes_on_top_of_that_of_all(still: Campaign) -> None:
    run, whole = still.runs[2], followed(still, still.runs[2], LAG_S)
    freed = {("Y", LAG): "own", ("Y", LAG_OF_ALL): "all"}
    both = RunMotion(run, still.machine, freed, {"own": 1e-3, "all": LAG_S - 1e-3}).axis("Y").position
    assert both.value == pytest.approx(whole.value, abs=1e-12)
    loop = freed | {("Y", gain): gain for gain in ("velocity_gain", "integral_time", "viscous")}
    values = {"own": 1e-3, "all": LAG_S - 1e-3, "velocity_gain": 300.0, "integral_time": 0.05, "viscous": 5.0}
    quick = RunMotion(run, still.machine, loop, values).axis("Y").position
    for series in (both, quick):
        assert series.tangents["own"] == pytest.approx(series.tangents["all"], abs=1e-12)
    assert both.tangents["own"] == pytest.approx(whole.tangents["lag"], rel=1e-9)


def lags_of_one_axis(campaign: Campaign) -> tuple[Moments, dict[str | None, int]]:
    """Moments about the baseline, and by axis the term that is a lag of this axis about none."""
    moments = moments_of(baseline(campaign), (), candidates(campaign).forms)
    plain = {
        term.effect.axis: number
        for number, term in enumerate(moments.terms)
        if term.effect.id == "following_lag" and not term.form.at
    }
    return moments, plain


def unbounded(moments: Moments) -> Moments:
    """The same as if a lag could be negative."""
    free = (replace(own, lower=np.full(len(own.lower), -np.inf)) for own in moments.columns)
    return replace(moments, columns=tuple(free))


def test_an_axis_that_is_late_is_no_other_one_that_is_early(tmp_path: Path) -> None:
    """Where each recording has a clock of its own the two cannot be distinguished, but a lag is not negative."""
    read = circles(tmp_path, {"Y": 3e-4}, interval_s=0.16)
    runs = tuple(replace(run, options={**run.options, "clock_sigma_ms": 50.0}) for run in read.runs)
    moments, lags = lags_of_one_axis(replace(read, runs=runs))
    nothing, late, early = (
        log_evidence(moments, subset).total for subset in ((), [(lags["Y"], 1.0)], [(lags["X"], 1.0)])
    )
    assert late > nothing + 100.0
    assert early < nothing + 3.0
    assert log_evidence(unbounded(moments), [(lags["X"], 1.0)]).total > nothing + 100.0


def test_the_evidence_of_a_bound_is_an_integral_over_what_it_leaves(still: Campaign) -> None:
    moments, lags = lags_of_one_axis(still)
    number, (at,) = lags["Y"], moments.columns[lags["Y"]].where
    bound, free = (log_evidence(each, [(number, 3.0)]) for each in (moments, unbounded(moments)))
    curve = 9.0 * moments.gram[:, at, at] / free.scales + 1.0
    likely, x = 3.0 * moments.gram[:, at, -1] / free.scales / curve, np.linspace(-8.0, 8.0, 400_001)
    weight, sizes = np.exp(-0.5 * x**2), x[:, None] / np.sqrt(curve) + likely
    inside = [np.sum(weight[column > 0.0]) / np.sum(weight) for column in sizes.T]
    assert 0.01 < min(inside) < 0.99
    assert bound.by_node - free.by_node == pytest.approx(np.log(inside) + np.log(2.0), abs=1e-4)


def undeclared(folder: Path, *feeds: float) -> Campaign:
    """Circles of a grid encoder on a machine whose loops have finite velocity gains, which the machine file does not state."""
    machine = plant.planar_table()
    runs = [
        plant.planar_circle(machine, f"{feed:.0f}-{sign}", feed=feed, direction=sign, radius=60.0, instrument="grid_encoder")
        for feed in feeds
        for sign in (1, -1)
    ]  # fmt: skip
    plant.write_campaign(folder, machine, runs, {"EC0X": 35.0}, seed=7)
    return told(folder)


def test_the_gains_of_loops_that_nobody_stated_are_those_of_the_plant(tmp_path: Path) -> None:
    """A first-order lag leaves five times the noise, in starts and stops."""
    campaign = undeclared(tmp_path, 4000.0)
    fit = identify(campaign, effects=[make_effect("following_lag", shape="loop")], noise="declared")
    assert fit.chi2_dof < 1.1
    truth = {"lag_ms": 1e3 / 45.0}
    for axis, velocity in (("X", 280.0), ("Y", 260.0)):
        truth |= {f"velocity_gain_{axis}": velocity, f"integral_time_{axis}": 0.06, f"viscous_{axis}": 6.0}
    for name, value in truth.items():
        name = f"following_lag.{name}"
        assert abs(fit[name] - value) < 3.5 * fit.uncertainty(name), name
    plain = identify(campaign, effects=[make_effect("following_lag")], noise="declared")
    assert plain.chi2_dof > 25.0


def test_slopes_of_a_loop_that_nobody_stated_are_those_of_finite_differences(still: Campaign) -> None:
    run = still.runs[2]
    freed = {("Y", LAG): "lag", ("Y", "velocity_gain"): "kv", ("Y", "integral_time"): "ti", ("Y", "viscous"): "d"}
    values = {"lag": LAG_S, "kv": 260.0, "ti": 0.06, "d": 6.0}

    def position(**changed: float) -> Series:
        return RunMotion(run, still.machine, freed, values | changed).axis("Y").position

    for name, value in values.items():
        h = 1e-5 * value
        slope = (position(**{name: value + h}).value - position(**{name: value - h}).value) / (2.0 * h)
        found = position().tangents[name]
        assert found == pytest.approx(slope, rel=1e-4, abs=1e-5 * float(np.abs(found).max())), name


def test_where_a_recording_begins_in_motion_the_lag_has_settled(still: Campaign) -> None:
    run = still.runs[2]
    time, speed = run.time, 40.0
    ramp = {**run.commands, "Y": 5.0 + speed * (time - time[0])}
    moving = replace(run, commands=ramp, options={**run.options, "start": "moving"})
    assert followed(still, moving, LAG_S).value == pytest.approx(ramp["Y"] - speed * LAG_S, abs=1e-9)


def on_a_circle(campaign: Campaign) -> tuple[Run, Array]:
    """Y = 100·cos(0.7·t) every 1.6°, some rows missing, as ball-bar software exports it, and its time."""
    run, rows = campaign.runs[2], np.delete(np.arange(225), np.r_[40:45, 150:153])
    time = 0.04 * rows
    turning = {**run.commands, "Y": 100.0 * np.cos(RATE * time)}
    return Run(
        id="circle", instrument=run.instrument, sampling="dynamic", time=time, readings={}, table_ball=run.table_ball,
        commands={name: np.resize(way, len(time)) for name, way in turning.items()}, tool_ball=run.tool_ball,
        length=run.length, noise_um=run.noise_um, options={"start": "moving", "between": "curve"},
    ), time  # fmt: skip


def test_on_a_circle_that_begins_in_motion_the_lag_is_that_of_a_steady_oscillation(still: Campaign) -> None:
    """Amplitude and phase of 1/(1 + iωτ) from the first row."""
    circle, time = on_a_circle(still)
    lagged, phase = 100.0 / np.hypot(1.0, RATE * LAG_S), np.arctan(RATE * LAG_S)
    assert followed(still, circle, LAG_S).value == pytest.approx(lagged * np.cos(RATE * time - phase), abs=5e-5)


@pytest.mark.parametrize("lags", [{}, {"lag": LAG_S}, {"lag": LAG_S, "velocity_gain": 350.0}])
def test_an_early_clock_sees_how_the_motion_goes_on_behind_the_last_row(
    still: Campaign, lags: dict[str, float]
) -> None:
    """30 ms early, of an axis that follows exactly, late by a lag, and late by a loop, with its velocity and acceleration."""
    circle, time = on_a_circle(still)
    freed = {("Y", LAG if name == "lag" else name): name for name in lags}
    if "velocity_gain" in lags:
        lags = lags | {"integral_time": 0.05, "viscous": 5.0}
        freed |= {("Y", name): name for name in ("integral_time", "viscous")}

    def seen(delay: float, **values: float) -> AxisMotion:
        late = Late(delay, clocks=("clock",))
        return RunMotion(circle, still.machine, freed, lags | values, late).axis("Y")

    s = 1j * RATE
    if "velocity_gain" in lags:
        speed = 350.0 * (1.0 + 1.0 / (0.05 * s))
        answer = speed / LAG_S / (s**2 + 5.0 * s + speed * (s + 1.0 / LAG_S))
    else:
        answer = 1.0 / (1.0 + s * lags.get("lag", 0.0))
    motion, turning = seen(-0.03), 100.0 * answer * np.exp(s * (time + 0.03))
    parts = zip(("position", "velocity", "acceleration"), (1e-4, 2e-3, 0.1), strict=True)
    for order, (part, near) in enumerate(parts):
        found: Series = getattr(motion, part)
        assert found.value == pytest.approx((s**order * turning).real, abs=near), part
        for name in found.tangents:
            h = 1e-5 if name == "clock" else 1e-3 * lags[name]
            up = seen(-0.03 + h) if name == "clock" else seen(-0.03, **{name: lags[name] + h})
            down = seen(-0.03 - h) if name == "clock" else seen(-0.03, **{name: lags[name] - h})
            slope = (getattr(up, part).value - getattr(down, part).value) / (2.0 * h)
            size = max(float(np.abs(slope).max()), 1e-6)
            assert found.tangents[name] == pytest.approx(slope, abs=1e-2 * size), (part, name)


@pytest.mark.parametrize("interval", [0.002, 0.005, 0.01])
def test_a_drive_follows_the_curve_and_not_its_chords(still: Campaign, interval: float) -> None:
    """A turning table at 120°/s: chords of 5 ms lie 0.83 µm within the circle, and readings at a drive of 40/s showed them as the
    gain of an instrument. Amplitude and phase are those of the loop's transfer function."""
    run, rate, time = still.runs[2], 2.0, interval * np.arange(round(4.0 / interval))
    s, gains = 1j * rate, {"position_gain": 40.0, "velocity_gain": 350.0, "integral_time": 0.05, "viscous": 5.0}
    driven = replace(still.machine.axes["Y"], drive=Drive(**gains))
    machine = replace(still.machine, axes={**still.machine.axes, "Y": driven})
    speed = 350.0 * (1.0 + 1.0 / (0.05 * s))
    answer = 40.0 * speed / (s**2 + 5.0 * s + speed * (s + 40.0))
    turning = {n: np.resize(way, len(time)) for n, way in run.commands.items()} | {"Y": 100.0 * np.sin(rate * time)}
    options = {"start": "moving", "between": "curve"}
    fast = replace(run, time=time, commands=turning, readings={}, options=options)
    found = RunMotion(fast, machine, {}, {}).axis("Y").position.value
    late = time > 1.0
    assert found[late] == pytest.approx((100.0 * answer * np.exp(s * time)).imag[late], abs=2e-5)


@pytest.mark.slow
def test_a_concealed_loop_is_named_with_its_gain(tmp_path: Path) -> None:
    found = diagnose(circles(tmp_path, {"Y": LAG_S}, interval_s=0.16))
    (finding,) = found.findings
    assert (finding.name, finding.axis, finding.confidence > 0.9) == ("servo_mismatch", "Y", True)
    gain = finding.parameters["position_gain"]
    assert isinstance(gain.value, float) and isinstance(gain.std, float)
    assert abs(gain.value - 1.0 / LAG_S) < 0.02 / LAG_S
    assert found.fit.rms_after_um < 0.02 * found.fit.rms_before_um


@pytest.mark.slow
@pytest.mark.parametrize("late", ["X", "Y"])
def test_with_a_clock_of_each_recording_the_late_axis_is_named_and_not_the_other_one_as_early(
    tmp_path, late: str
) -> None:
    """A polar trace does not say when its circle began: X late by 0.3 ms was Y early by as much, which no lag is."""
    read = circles(tmp_path, {late: 3e-4})
    runs = tuple(replace(run, options={**run.options, "clock_sigma_ms": 50.0}) for run in read.runs[:2])
    (finding,) = diagnose(replace(read, runs=runs)).findings
    assert (finding.name, finding.axis, finding.confidence > 0.9) == ("servo_mismatch", late, True)
    assert finding.parameters["lag_ms"].value == pytest.approx(0.3, abs=0.02)
    assert finding.parameters["lag_beyond_all_ms"].std < 0.02
    assert finding.parameters["lag_ms"].std > 0.5 and "position_gain" not in finding.parameters  # all may be late


@pytest.mark.slow
def test_of_axes_that_are_all_late_the_one_that_is_later_is_named(tmp_path: Path) -> None:
    """Polar traces at two feeds: radii that shrink with the feed were compliances of 218 and 158 µm/(m/s²), above 96 %."""
    read = circles(tmp_path, {"X": 0.024, "Y": 0.025})
    runs = tuple(replace(run, options={**run.options, "clock_sigma_ms": 50.0}) for run in read.runs)
    later, all_ = sorted(diagnose(replace(read, runs=runs)).findings, key=lambda finding: finding.axis or "Z")
    assert [(f.name, f.axis, f.confidence > 0.9) for f in (later, all_)] == [
        ("servo_mismatch", "Y", True),
        ("servo_mismatch", None, True),
    ]
    assert (later.title, all_.title) == ("Servo mismatch of axis Y", "Servo mismatch of all axes")
    for finding, name, value in ((later, "lag_ms", 25.0), (later, "lag_beyond_all_ms", 1.0), (all_, "lag_ms", 24.0)):
        quantity = finding.parameters[name]
        assert isinstance(quantity.value, float) and isinstance(quantity.std, float)
        assert abs(quantity.value - value) < 3.5 * quantity.std, (name, quantity)


@pytest.mark.slow
def test_axes_that_are_all_late_are_a_late_clock(tmp_path: Path) -> None:
    late = {"effect": "latency", "delay_ms": 40.0}  # a row of the plant, whose command is a chord between rows
    (finding,) = diagnose(circles(tmp_path, effects=[late], instrument="grid_encoder")).findings
    assert finding.name == "latency"
    assert finding.parameters["delay_ms"].value == pytest.approx(40.0, abs=0.1)


@pytest.mark.slow
def test_axes_that_follow_alike_are_one_finding_of_all_drives(tmp_path: Path) -> None:
    """The law of a loop is not quite first order, as that of a low-pass of the instrument is: that is no rival of it."""
    found = diagnose(circles(tmp_path, {"X": LAG_S, "Y": LAG_S}, instrument="grid_encoder")).by_share[0]
    assert (found.name, found.axis) == ("servo_mismatch", None)
    assert found.parameters["lag_ms"].value == pytest.approx(1e3 * LAG_S, abs=0.05)
    assert found.confidence > 0.9


@pytest.mark.slow
def test_loops_that_nobody_stated_are_one_finding_and_nothing_else(tmp_path: Path) -> None:
    """With the lag alone, resonances, compliances, a play and a vibration had joined it, and the diagnosis took minutes."""
    (found,) = diagnose(undeclared(tmp_path, 1500.0, 4000.0)).findings
    assert (found.name, found.axis, found.confidence > 0.9) == ("servo_mismatch", None, True)
    for name, value in (("position_gain", 45.0), ("velocity_gain_X", 280.0), ("velocity_gain_Y", 260.0)):
        quantity = found.parameters[name]
        assert abs(quantity.value - value) < 3.5 * quantity.std


def test_an_axis_with_a_drive_has_its_gains_instead(tmp_path: Path) -> None:
    machine = plant.planar_table()
    plant.write_campaign(tmp_path, machine, [plant.planar_circle(machine, "ccw")])
    with pytest.raises(InputError, match="servo_mismatch"):
        Model(read_campaign(tmp_path), [make_effect("following_lag", "X")])


def test_a_curve_has_its_slope_in_the_first_and_last_row() -> None:
    """An axis that turns in the first row moved there at the speed of the first chord: the friction of a drive was the wrong one
    in one row, which a loop without a lag explained."""
    time = np.arange(80) * 0.05
    run = Run(
        id="turn", instrument=("drive_force",), sampling="dynamic", time=time, commands={"X": -200.0 * np.cos(0.6 * time)},
        noise_um=1.0, options={"axis": "X", "between": "curve", "start": "moving"},
    )  # fmt: skip
    motion = RunMotion(run, axis_alone(-210.0, 210.0), {}, {}).axis("X")
    assert motion.velocity.value == pytest.approx(120.0 * np.sin(0.6 * time), abs=1e-3)
    assert motion.acceleration.value == pytest.approx(72.0 * np.cos(0.6 * time), abs=0.05)
