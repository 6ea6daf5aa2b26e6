"""What a correction is worth: against closed forms of a machine with three linear axes."""

from dataclasses import replace

import numpy as np
import pytest
from lean import without_drives

from symfive.campaign import Campaign, SetupSigma
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.identify import Identification, identify
from symfive.machine import preset
from symfive.procedures import campaign_of, planar_circle, r_test_grid
from symfive.simulate import simulate
from symfive.worth import DO_NOT, Worth, effect_worth, effect_worths, location_worths, worth_of, worth_text

WHOLE = without_drives(preset("three-axis"))
"""Drives would lag."""
KEPT = ("EC0X", "EA0Z", "EB0Z")
RADIUS = 100.0


def _plan(*planes: str) -> Campaign:
    machine = replace(WHOLE, errors={name: WHOLE.errors[name] for name in KEPT if name in WHOLE.errors})
    exact = SetupSigma(table_ball=20.0, tool_ball=0.0, length=0.5)
    runs = [
        run for plane in planes
        for run in planar_circle(machine, plane=plane, radius=RADIUS, feed=1000.0, rate_hz=10.0, setup_sigma_um=exact)
    ]  # fmt: skip
    return campaign_of(machine, runs)


def _identified(*planes: str, effects=(), **truth: float) -> Identification:
    plan = _plan(*planes)
    names = dict.fromkeys(plan.machine.errors, 0.0) | truth
    return identify(simulate(plan, truth=names, effects=effects, seed=2), effects=effects)


def test_the_only_error_is_all_of_the_deviation():
    found = _identified("XY", EC0X=80.0)
    (worth,) = worth_of(found, [["EC0X"]])
    # ½·R·S·sin 2φ has the rms R·S/√8; what is left is the noise of a reading
    wave, noise = RADIUS * 80.0e-3 / np.sqrt(8.0), 0.3
    expected = 1.0 - noise / np.hypot(wave, noise)
    assert set(worth.circles) == {"xy-ccw", "xy-cw"} and worth.certain
    for share in (worth.readings, *worth.circles.values()):
        assert share == pytest.approx(expected, abs=0.02)


def test_the_error_at_the_tool_is_that_of_the_travels():
    """EC0X moves Y by EC0X·x, EB0Z moves X by EB0Z·z: spread evenly, each has the rms t·L/√12 of its axis' travel L."""
    found = _identified("XY", "YZ", "ZX", EC0X=80.0, EB0Z=-40.0)
    size = {
        "EC0X": found["EC0X"] * np.ptp(found.model.machine.axes["X"].travel) / np.sqrt(12.0),
        "EB0Z": found["EB0Z"] * np.ptp(found.model.machine.axes["Z"].travel) / np.sqrt(12.0),
        "EA0Z": found["EA0Z"] * np.ptp(found.model.machine.axes["Z"].travel) / np.sqrt(12.0),
    }
    whole = np.sqrt(sum(v**2 for v in size.values()))
    worths = {worth.names[0]: worth for worth in location_worths(found)}
    for name in ("EC0X", "EB0Z"):
        rest = np.sqrt(max(whole**2 - size[name] ** 2, 0.0))
        assert worths[name].tool == pytest.approx(1.0 - rest / whole, abs=0.02), name
        assert worths[name].advice == "correct"
    assert list(worths) == sorted(worths, key=lambda name: -(worths[name].tool or 0.0))
    assert "EC0X" in worth_text(location_worths(found))


def test_no_correction_is_advised_from_a_fit_that_did_not_converge():
    found = _identified("XY", EC0X=80.0)
    assert "EC0X" in worth_text(location_worths(found))
    assert not location_worths(replace(found, converged=False))


def test_a_correction_from_a_model_that_does_not_explain_the_readings_says_so():
    """A play that the model lacks leaves 20 times the noise."""
    plan = simulate(
        _plan("XY"), effects=[make_effect("backlash", axis="X")], truth={"EC0X": 80.0, "backlash.X.width": 12.0}, seed=2
    )
    found = identify(plan.campaign)
    (worth,) = [worth for worth in location_worths(found) if worth.names == ("EC0X",)]
    assert found.fits == "no" and worth.certain
    assert worth.advice == "correct, then measure again: the model does not explain the readings"


@pytest.mark.parametrize(
    ("tool", "readings", "advice"),
    [
        (None, -0.0066, "do not correct alone: it compensates for another error"),
        (None, 0.0004, "no gain in these readings"),
        (None, 0.2, "correct"),
        (0.0004, 0.2, "no gain at the tool"),
        (0.2, -0.1, "correct"),
    ],
)
def test_what_the_readings_lose_is_not_advised(tool: float | None, readings: float, advice: str) -> None:
    """An effect in motion has no value at the tool: what it does to the readings counts."""
    assert Worth(("lift.Y.height",), {}, readings, tool, certain=True).advice == advice


def test_below_the_uncertainty_nothing_is_corrected():
    found = _identified("XY", EC0X=80.0)
    index = found.model.index["EC0X"]
    covariance = found.covariance.copy()
    for factor, certain in ((0.49, True), (0.51, False)):  # |v| against 2σ
        covariance[index, index] = (factor * found["EC0X"]) ** 2
        (worth,) = worth_of(replace(found, covariance=covariance), [["EC0X"]])
        assert worth.certain is certain and (worth.advice == DO_NOT) is not certain


def test_what_the_data_cannot_tell_apart_is_not_corrected_alone():
    machine = replace(WHOLE, errors={name: replace(WHOLE.errors["EC0X"], name=name) for name in ("EC0X", "EC0Y")})
    campaign = simulate(_plan("XY").with_machine(machine), truth={"EC0X": 200.0, "EC0Y": 0.0}, seed=2)
    (worth, _) = worth_of(identify(campaign), [["EC0X"], ["EC0Y"]])
    assert worth.confounded == ("EC0Y",)
    assert worth.advice == DO_NOT or "only together with EC0Y" in worth.advice


def test_an_effect_and_its_mistakes():
    play = make_effect("backlash", axis="X")
    found = _identified("XY", effects=[play], **{"EC0X": 20.0, "backlash.X.width": 12.0})
    (effect,) = found.model.added
    worth = effect_worth(found, effect)
    assert worth.certain and min(worth.circles.values()) > 0.3 and worth.tool is not None and worth.tool > 0.0
    with pytest.raises(InputError, match="no effect"):
        effect_worth(found, make_effect("backlash", axis="Y").prepare(found.model.campaign))
    with pytest.raises(InputError, match='no parameter "EX0C"'):
        worth_of(found, [["EX0C"]])


def test_an_instruments_fault_is_no_error_of_the_machine():
    gain = make_effect("sensor_error", instrument="ball_bar")
    play = make_effect("backlash", axis="X")
    found = _identified("XY", effects=[play, gain], **{"EC0X": 20.0, "backlash.X.width": 12.0})
    of_play, of_gain = effect_worths(found, found.model.added)
    assert of_play == effect_worth(found, found.model.added[0]) and of_play.of_machine
    assert not of_gain.of_machine and of_gain.tool is None
    assert of_gain.advice == "not an error of the machine: correct the instrument or the set-up"


def test_what_only_the_set_ups_1_sigma_separates_says_so():
    """An R-test reads the place of C and the tool ball's run-out alike: it is their priors that divide the reading."""
    machine = preset("tsutsumi-2007")
    grid = r_test_grid(machine, step_deg=90.0, returning=False)[:1]
    found = identify(simulate(campaign_of(machine, grid), truth={"EX0C": 150.0}, seed=1))
    (worth,) = worth_of(found, [["EX0C"]])
    assert worth.certain and any(name.endswith("tool_ball.x") for name in worth.by_setup)
    assert worth.advice.startswith("correct only if tool ball x of run") and "known to its 1σ" in worth.advice
