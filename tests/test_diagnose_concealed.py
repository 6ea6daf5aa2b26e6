"""Effects that hide: in the prior, in the geometry, behind a rival."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import plant
import pytest
from concealed_world import bar_runs, circle_runs, diagnosed, grid_runs, names_of, read_by_the_plant, wrong

from examples.blind_study.cases import make_case, write_case
from symfive.campaign import Campaign, read_campaign
from symfive.diagnose import diagnose, locate, log_tail, model_averaged
from symfive.posterior import baseline, candidates, polish, refitted

FEW = plant.grid_poses(np.arange(-90, 91, 45.0), np.arange(0, 316, 45.0))


@pytest.mark.slow
def test_a_sag_far_larger_than_usual_is_not_pulled_back_by_its_prior(tmp_path):
    """120 µm where 10 are usual: nothing else makes up for what a prior would hold back."""
    machine = plant.static_table()
    sag = {"effect": "gravity_sag", "axis": "B", "component": "EZB", "amplitude": 120.0, "form": "one_minus_cos"}
    found = diagnose(read_by_the_plant(tmp_path / "c", machine, grid_runs(machine), [sag]))
    assert names_of(found) == [("gravity_sag", "B")]
    finding = found.findings[0]
    assert finding.parameters["amplitude"].value == pytest.approx(120.0, abs=1.0)
    assert found.fit.chi2_dof_after < 1.1


@pytest.mark.slow
def test_a_scale_that_geometry_hides_but_for_a_hair_is_named_though_it_is_far_beyond_usual(tmp_path):
    """Of an effect of usual size these readings hold nothing; of one a hundred times as large its curvature."""
    machine = plant.static_table()
    wrong = {"effect": "scale_error", "axis": "X", "ppm": -3000.0}
    measured = read_by_the_plant(tmp_path / "c", machine, bar_runs(machine), [wrong])
    before = locate(measured)
    seen = next(o for o in before.observability if o.form == "scale_error.X")
    assert seen.sigmas < 1.0 and seen.visible < 1e-3
    found = diagnose(measured)
    assert names_of(found)[0] == ("scale_error", "X")
    said = found.findings[0].parameters["ppm"]
    assert abs(said.value + 3000.0) < 3.0 * said.std and said.std < 600.0


@wrong("no term over two velocities")
@pytest.mark.slow
def test_what_changes_with_the_faster_axis_is_one_term_over_both_velocities(tmp_path):
    """Master/slave changeover of old controls: sectors that begin at 45°, which terms over one coordinate cannot hold."""
    machine = plant.planar_table()
    aside = {"effect": "changeover_sector", "axes": ["X", "Y"], "direction": [0.6, 0.8, 0.0], "amplitude": 3.0}
    found = diagnose(read_by_the_plant(tmp_path / "c", machine, circle_runs(machine, (800.0, 2000.0)), [aside]))
    (finding,) = found.findings
    assert finding.name == "unknown" and set(finding.effect.over) == {"X velocity", "Y velocity"}
    assert found.fit.chi2_dof_before > 2.0 and found.fit.chi2_dof_after < 1.3
    assert np.abs(finding.parameters["direction"].value) == pytest.approx([0.6, 0.8, 0.0], abs=0.05)


@wrong("further names beside it")
@pytest.mark.slow
def test_a_compliance_that_softens_by_another_curve_brings_no_resonance(tmp_path):
    machine = plant.planar_table()
    soft = {
        "effect": "inertial_compliance", "axis": "X", "direction": [-0.412, -0.783, 0.467], "form": "softening",
        "limit": 0.02, "compliance": 1500.0,
    }  # fmt: skip
    found = diagnose(read_by_the_plant(tmp_path / "c", machine, circle_runs(machine, (750.0, 2300.0)), [soft]))
    assert names_of(found) == [("inertial_compliance", "X")]


@pytest.mark.slow
def test_a_step_along_a_path_is_found_with_its_ramp_and_brings_no_other_effect(tmp_path):
    machine = plant.planar_table()
    step = {"effect": "compensation_table_step", "axis": "X", "at": 9.65, "ramp": 2.0, "step": 4.6}
    found = diagnose(read_by_the_plant(tmp_path / "c", machine, circle_runs(machine, (1000.0, 2500.0)), [step]))
    assert names_of(found) == [("error_motion", "X")]
    for name, true in (("at", 10.65), ("ramp", 2.0), ("height", 4.6)):
        said = found.findings[0].parameters[name]
        assert abs(said.value - true) < 3.0 * said.std and said.std < 0.3 * true


@pytest.mark.slow
def test_two_names_go_before_one_term_over_both_their_axes(tmp_path):
    machine = plant.static_table()
    bow = {"effect": "error_motion", "component": "EYB", "coefficients": [0.0, 6.0, 9.0]}
    wave = {"effect": "error_motion", "component": "EZC", "harmonics": [[3, -6.0, 3.0]]}
    found = diagnose(read_by_the_plant(tmp_path / "c", machine, bar_runs(machine), [bow, wave]))
    assert sorted(names_of(found)) == [("error_motion", "B"), ("error_motion", "C")]


@wrong("the drift with an onset is no rival")
@pytest.mark.slow
def test_what_lost_its_place_to_another_name_is_still_said_to_rival_it(tmp_path):
    """Where only the head turns, a ball that creeps in its holder reads like heat that comes on at that instant."""
    free = (("X", "C"), ("Y", "C"), ("A", "C"), ("B", "C"), ("A", "B"), ("C", "B"), ("Z", "B"))
    machine = plant.topology("head-cb", {f"E{letter}0{axis}": {"sigma": 40.0} for letter, axis in free})
    shift = {
        "effect": "setup_shift",
        "run": "nest1",
        "t_s": 587.0,
        "form": "creep",
        "creep_s": 100.0,
        "shift": [-1.1, 2.1, 7.0],
    }
    (found,) = diagnose(read_by_the_plant(tmp_path / "c", machine, grid_runs(machine), [shift])).findings
    said = {found.name: found.confidence} | {r.effect: r.confidence for r in found.rivals}
    assert said["setup_shift"] > 0.05 and said["thermal_drift"] > 0.05


def test_the_tail_of_chi_squared_is_a_number_however_far_out():
    for dof in (0.5, 3.0, 40.0):
        near = log_tail(1300.0, dof)
        assert near == pytest.approx(log_tail(1300.0 + 1e-6, dof), abs=1e-5)
        assert -5.1e4 < log_tail(1e5, dof) < -4.9e4
        slope = (log_tail(3000.0, dof) - log_tail(1400.0, dof)) / 1600.0
        assert slope == pytest.approx(-0.5, abs=0.02)


@pytest.mark.slow
def test_a_step_of_the_compensation_table_is_placed_between_two_positions(tmp_path):
    machine = plant.static_table()
    step = {"effect": "compensation_table_step", "axis": "Y", "at": -11.0, "ramp": 2.0, "step": 9.0}
    found = diagnose(read_by_the_plant(tmp_path / "c", machine, grid_runs(machine), [step]))
    assert names_of(found)[0] == ("error_motion", "Y")
    assert all(finding.share < 0.01 for finding in found.findings[1:])  # chance: one survey in a hundred
    place = found.findings[0].parameters["at"]
    assert abs(place.value + 10.0) < 2.0 * place.std
    assert found.findings[0].parameters["height"].value == pytest.approx(9.0, rel=0.05)


def test_a_step_is_looked_for_where_the_fit_leaves_it_and_not_where_it_is_absorbed(tmp_path):
    """Bars at rest: a step anywhere else would have more to do with the residual, and the geometry absorbs it whole."""
    machine = plant.static_table()
    step = {"effect": "compensation_table_step", "axis": "X", "at": -60.0, "ramp": 2.0, "step": 6.0}
    campaign = read_by_the_plant(tmp_path / "c", machine, bar_runs(machine), [step])
    found = next(s for s in locate(campaign).suspects if s.effect.id == "table_step" and s.axis == "X")
    assert -61.0 < found.effect.at < 0.0  # no ball stands between
    assert found.nats > 150.0
    assert abs(found.values[f"{found.effect.key}.height"]) == pytest.approx(6.0, rel=0.3)


@pytest.mark.slow
def test_a_rival_of_one_finding_is_not_the_shape_of_another(tmp_path):
    """A wide step of X is named first as a narrow one, and a delay beside it: a curve over X would stand for both."""
    machine = plant.planar_table()
    step = {"effect": "compensation_table_step", "axis": "X", "at": 42.3, "ramp": 2.0, "step": 9.0}
    found = diagnose(read_by_the_plant(tmp_path / "c", machine, circle_runs(machine, (700.0, 1400.0)), [step], seed=4))
    first = found.findings[0].effect
    assert (first.id, first.axis) == ("table_step", "X") and abs(first.at - 42.3) < 2.0
    assert "unknown" not in {f.name for f in found.findings}


@wrong("nothing is found")
@pytest.mark.slow
def test_one_feed_cannot_tell_play_from_the_servo_and_the_second_feed_that_is_asked_for_can(tmp_path):
    machine = plant.planar_table()
    play = [{"effect": "backlash", "axis": "X", "width": 0.35}]
    first = read_by_the_plant(
        tmp_path / "c", machine, circle_runs(machine, (800.0,), dt=0.6, sweep_deg=420.0), play, seed=4
    )
    found = diagnose(first, exclude=("lateral_play",))
    finding = found.findings[0]
    assert (finding.name, finding.axis) == ("backlash", "X") and finding.confidence < 0.95
    assert {r.effect for r in finding.rivals if r.confidence > 0.01} == {"servo_mismatch"}
    assert finding.test is not None and finding.test.useful
    sigmas = {s.name.removeprefix("xy-f800-ccw-"): s.sigmas for s in finding.test.table}
    assert sigmas["faster"] > 1.2 * sigmas["repeat"]
    second = read_by_the_plant(
        tmp_path / "d", machine, circle_runs(machine, (1600.0,), dt=0.3, sweep_deg=420.0), play, seed=7
    )
    both = diagnose(first.joined(second), exclude=("lateral_play",))
    assert names_of(both)[0] == ("backlash", "X") and both.findings[0].confidence > 0.99


@pytest.mark.slow
def test_a_play_that_could_as_well_be_sideways_is_named_with_it_and_with_the_height_that_parts_them(tmp_path):
    """A circle in the plane of the table reads a carriage that rolls by w/z like a play of w."""
    machine = plant.planar_table()
    play = [{"effect": "backlash", "axis": "Y", "width": 2.4}]
    finding = diagnose(
        read_by_the_plant(tmp_path / "c", machine, circle_runs(machine, (1000.0, 2500.0)), play)
    ).findings[0]
    assert (finding.name, finding.axis) == ("backlash", "Y")
    assert "lateral_play.EAY" in finding.alias
    assert finding.test is not None and finding.test.separation > 10.0
    assert finding.test.table[0].name.endswith("-z")


def _rubbing(folder: Path, **friction: object) -> Campaign:
    """Three circles of X and C, whose drive rubs."""
    machine = plant.dynamic_table()
    runs = [
        plant.synchronous_circle(
            machine, f"x{x_t:g}-f{feed:g}-{'ccw' if d > 0 else 'cw'}", x_t=x_t, feed=feed, direction=d, dt=0.02
        )
        for x_t, feed, d in ((45.0, 650.0, 1), (65.0, 1300.0, 1), (65.0, 1300.0, -1))
    ]
    return read_by_the_plant(
        folder, machine, runs, [{"effect": "friction", "axis": "C", "stribeck_speed": 0.02, **friction}]
    )


@pytest.mark.slow
def test_the_way_of_a_contact_is_found_though_the_usual_one_looks_hard(tmp_path):
    """There the search stood still, and six effects were invented for what it left."""
    rubs = {"form": "lugre", "coulomb": 7.4, "breakaway": 10.7, "stiffness": 1e5, "damping": 300.0}
    found = diagnose(_rubbing(tmp_path / "c", **rubs))
    assert names_of(found) == [("friction", "C")]
    said = found.findings[0].parameters
    assert said["coulomb"].value == pytest.approx(7.4, rel=0.05)
    assert said["pre_sliding"].value == pytest.approx(74.0, rel=0.2)


@pytest.mark.slow
def test_friction_whose_contact_yields_brings_no_other_effect(tmp_path):
    """The plant's bristles are no library form's first guess: what they leave is not a filter of the instrument."""
    machine = plant.planar_table()
    runs = circle_runs(machine, (600.0, 1500.0))
    rubs = {
        "effect": "friction", "axis": "X", "form": "lugre", "coulomb": 110.0, "breakaway": 170.0, "stribeck_speed": 2.0,
        "stiffness": 1e5, "damping": 300.0,
    }  # fmt: skip
    found = diagnose(read_by_the_plant(tmp_path / "c", machine, runs, [rubs]))
    assert names_of(found) == [("friction", "X")]
    said = found.findings[0].parameters
    assert said["coulomb"].value == pytest.approx(110.0, rel=0.1)
    assert said["pre_sliding"].value == pytest.approx(1.1, rel=0.5)


LACKING = [
    pytest.param("B since reversal", ("lateral_play", "setup_shift", "gravity_sag"),
     {"effect": "lateral_play", "component": "EZB", "width": 8.0, "form": "presliding", "distance": 30.0},
     marks=pytest.mark.slow),
    pytest.param("B since reversal", ("lateral_play", "setup_shift", "gravity_sag"),
     {"effect": "lateral_play", "component": "EAB", "width": 60.0, "form": "presliding", "distance": 30.0},
     marks=[pytest.mark.slow, wrong("two names beside it")]),
    pytest.param("t", ("vibration",),
     {"effect": "vibration", "frequency_hz": 6.7, "amplitude": 2.0, "direction": [0.8, 0.6, 0.0]},
     marks=pytest.mark.slow),
    pytest.param("X", ("transmission_error", "error_motion", "table_step"),
     {"effect": "transmission_error", "axis": "X", "period": 12.0, "amplitude": 3.0, "phase": 1.0},
     marks=[pytest.mark.slow, wrong("it is put over Y")]),
]  # fmt: skip
"""The coordinate of an effect, and what the library must lack so that nothing in it gives the same readings."""


@pytest.mark.parametrize(("coordinate", "exclude", "effect"), LACKING)
def test_what_the_library_lacks_is_unknown_over_its_own_coordinate_and_nothing_else(
    tmp_path, coordinate, exclude, effect
):
    at_rest = coordinate.startswith("B")
    machine = plant.static_table() if at_rest else plant.planar_table()
    runs = grid_runs(machine) if at_rest else circle_runs(machine, (800.0, 1700.0))
    found = diagnose(read_by_the_plant(tmp_path / "c", machine, runs, [effect]), exclude=exclude)
    assert [(f.name, f.coordinate) for f in found.findings] == [("unknown", coordinate)]
    assert found.fit.chi2_dof_after < 1.1


@pytest.mark.slow
def test_two_axes_whose_loops_differ_are_told_apart_in_another_plane(tmp_path):
    """A circle of two axes reads little but the difference of their loops; a feed-forward is never below 0."""
    machine = plant.planar_table()
    lag = [{"effect": "servo_mismatch", "axis": "X", "feedforward": 0.01}]
    first = read_by_the_plant(tmp_path / "c", machine, circle_runs(machine, (1000.0, 1500.0)), lag)
    finding = diagnose(first).findings[0]
    others = {(r.effect, r.axis) for r in finding.rivals if r.confidence > 0.1}
    assert {(finding.name, finding.axis), *others} == {("servo_mismatch", a) for a in "XY"} and finding.by_experience
    assert finding.test is not None and finding.test.separation > 10.0 and "-in-" in finding.test.table[0].name
    asked = finding.test.test.runs[0]
    plane = finding.test.table[0].name[-2:]
    run = plant.planar_circle(
        machine, "asked", plane=plane, centre=asked.table_ball, feed=1000.0, start_deg=10.0 if plane == "YZ" else -80.0,
        sweep_deg=150.0,
    )  # fmt: skip
    both = diagnose(first.joined(read_by_the_plant(tmp_path / "d", machine, [run], lag, seed=8)))
    assert names_of(both) == [("servo_mismatch", "X")] and both.findings[0].confidence > 0.99


@pytest.mark.slow
def test_what_is_not_known_of_a_name_is_in_the_uncertainty_of_the_geometry(tmp_path):
    """Half of the probability on another component, which moves the geometry otherwise."""
    machine = plant.static_table()
    sag = {"effect": "gravity_sag", "axis": "B", "component": "EZB", "amplitude": 9.0}
    campaign = read_by_the_plant(tmp_path / "c", machine, grid_runs(machine, FEW), [sag])
    posterior, here = polish(baseline(campaign), candidates(campaign))
    assert [form.effect.key for form in here.held] == ["gravity_sag.B.EZB"]
    terms = posterior.moments.terms
    own = ((0, 1.0),)
    other = ((next(k for k, t in enumerate(terms) if t.effect.key == "gravity_sag.B.EXB"), 1.0),)
    sure, unsure = (replace(posterior, mass=mass) for mass in ({own: 0.0}, {own: 0.0, other: 0.0}))
    here = replace(here, others=())
    assert model_averaged(sure, here, here.fit).covariance == pytest.approx(here.fit.covariance)
    there = refitted(posterior.moments, other).fit
    name = max((p.name for p in here.fit.parameters if p.name in machine["errors"]),
               key=lambda name: abs(there[name] - here.fit[name]) / here.fit.uncertainty(name))  # fmt: skip
    assert abs(there[name] - here.fit[name]) > 3.0 * here.fit.uncertainty(name)
    expected = np.hypot(here.fit.uncertainty(name), np.sqrt(0.5) * (there[name] - here.fit[name]))
    assert model_averaged(unsure, here, here.fit).uncertainty(name) == pytest.approx(expected, rel=1e-6)
    reshaped = replace(here, others=((0.25, there),))
    expected = np.hypot(here.fit.uncertainty(name), 0.5 * (there[name] - here.fit[name]))
    assert model_averaged(sure, reshaped, here.fit).uncertainty(name) == pytest.approx(expected, rel=1e-6)


@pytest.mark.slow
def test_readings_that_stand_alone_may_be_physics(tmp_path: Path) -> None:
    """A lateral play of Z that shows in a tenth of the readings: each of them alone looks like an outlier of the instrument."""
    case = make_case(9911, "alias-002")
    write_case(case, tmp_path)
    campaign = read_campaign(tmp_path / "fit")
    assert [(e["effect"], e["component"]) for e in case.effects] == [("lateral_play", "EYZ")]
    assert len(baseline(campaign).outliers) > 5
    found = diagnose(campaign)
    assert names_of(found) == [("lateral_play", "Z")] and not found.after.outliers


@pytest.mark.slow
def test_a_scale_error_is_not_unidentified_because_the_axis_stood_at_few_places(tmp_path: Path) -> None:
    """A function over two places of Z holds the scale error and no more: the name is stated."""
    case = make_case(20261128, "alias-000")
    found = diagnosed(case, tmp_path)
    assert [e["effect"] for e in case.effects] == ["scale_error"] and names_of(found) == [("scale_error", "Z")]
