"""The steps of a diagnosis, each by itself: detect, locate, explore, polish, decide, amend, cross-validate."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import plant
import pytest
from concealed_world import circle_runs, read_by_the_plant
from lean import location_only

from symfive.campaign import Campaign, read_campaign
from symfive.diagnose import (
    amend,
    cross_validated,
    detect,
    diagnose,
    facts_of,
    findings_of,
    locate,
    located,
    moved,
    next_test,
    partitions,
    possible_tests,
)
from symfive.effects import Form, make_effect
from symfive.identify import identify
from symfive.machine import EffectEntry, preset
from symfive.model import Model
from symfive.posterior import (
    Posterior,
    baseline,
    candidates,
    coarsened,
    decide,
    expanded,
    explore,
    moments_of,
    polish,
    verdicts_on,
)
from symfive.procedures import Nominal, campaign_of, planar_circle, r_test_grid, static_ball_bar
from symfive.simulate import simulate

CAMPAIGNS = Path(__file__).parent / "data" / "campaigns"


def _circles(folder: Path, feeds: tuple[float, ...], effects: list[dict], seed: int) -> Campaign:
    machine = plant.planar_table()
    return read_by_the_plant(folder, machine, circle_runs(machine, feeds), effects, seed)


@pytest.mark.slow
def test_each_step_is_usable_alone_and_they_lead_to_the_same():
    campaign = read_campaign(CAMPAIGNS / "static-sag-and-drift" / "fit")
    detection = detect(campaign)
    assert detection.mismatch and detection.p_value < 1e-10
    assert next(t for t in detection.tests if t.name == "whiteness").says in detection.says
    location = locate(detection)
    first = location.significant[0]
    assert (first.link, first.axis, first.coordinate) == ("structure", "B", "B") and "structure" in location.says
    assert first.intervals and {i.run for i in first.intervals} <= {"nest1", "nest2"}
    stated, before = candidates(campaign), baseline(campaign)
    first_look = explore(moments_of(before, (), stated.forms))
    assert max(first_look.names(), key=lambda name: first_look.names()[name]) in {
        ("gravity_sag", "B"),
        ("thermal_drift", None),
    }
    posterior, here = polish(before, stated)
    verdicts = verdicts_on(posterior)
    assert verdicts == decide(posterior, coarsened(posterior))  # both have a name
    assert {verdict.names for verdict in verdicts} == {(("gravity_sag", "B"),), (("thermal_drift", None),)}
    findings = findings_of(posterior, here, before, verdicts, located(posterior.moments, detection))
    shares = {finding.name: finding.share for finding in findings}
    explained = 1.0 - (here.fit.rms_um / before.rms_um) ** 2
    assert 0.9 * explained < sum(shares.values()) <= explained + 1e-3 and min(shares.values()) > 0.1
    for finding in findings:
        says = finding.says
        assert says.startswith(f"{finding.title}: ") and says.count(". ") == 0 and len(says) < 180
        assert "; before, the geometry absorbed it (" in says and " %; " in says and "amplitude" in says
        facts = facts_of(finding, here.fit)
        assert facts["where"].endswith("in all runs") and " ± " in facts["how large"]
    sag = make_effect("gravity_sag", "B", component="EZB", parts=("one_minus_cos",))
    amended = amend(detection.fit, sag, make_effect("thermal_drift"))
    assert amended["gravity_sag.B.EZB.one_minus_cos"] == pytest.approx(7.0, rel=0.1)
    assert amended.chi2_dof < 1.05 < detection.fit.chi2_dof
    assert set(moved(detection.fit, amended)) <= {p.name for p in detection.fit.parameters}
    fit = cross_validated(detection.fit, amended)
    assert fit.heldout_rms_after_um < 0.4 * fit.heldout_rms_before_um
    assert fit.heldout_by["place"][1] < fit.heldout_by["place"][0]


def test_shares_of_two_that_can_stand_for_each_other_add_up_to_what_both_explain():
    """Left out one at a time, neither costs anything."""
    campaign = read_campaign(CAMPAIGNS / "static-sag-and-drift" / "fit")
    sag = make_effect("gravity_sag", "B", component="EZB", parts=("one_minus_cos",))
    twin = make_effect("error_motion", component="EZB", basis="polynomial", order=4)
    before = identify(campaign, effects=[make_effect("thermal_drift")])
    after = amend(before, sag, twin)
    here, _ = expanded(after, [Form(effect=effect) for effect in after.model.added], candidates(campaign))
    moments = moments_of(here.fit, here.held, ())
    posterior = Posterior(moments, {tuple((number, 1.0) for number in range(moments.held)): 0.0})
    verdicts = [v for v in decide(posterior, posterior) if moments.terms[v.term].effect.id != "thermal_drift"]
    found = findings_of(posterior, here, before, verdicts, located(moments, detect(before)))
    explained = 1.0 - (after.rms_um / before.rms_um) ** 2
    assert explained > 0.3 and 0.9 * explained < sum(f.share for f in found) <= explained + 1e-9


@pytest.mark.parametrize("name", ["dynamic-none", "planar-none", "static-none"])
def test_a_clean_fit_passes_all_tests(name):
    detection = detect(read_campaign(CAMPAIGNS / name / "fit"))
    assert not detection.mismatch and not detection.disagreements
    assert not any(t.says in detection.says for t in detection.tests)


def test_an_effect_below_the_noise_shows_as_one_parameter_that_is_not_the_same_in_both_directions(tmp_path):
    """0.1 µm of play under 0.3 µm of noise: the residual is clean, squareness is not the same clockwise and back."""
    play = [{"effect": "backlash", "axis": "X", "width": 0.1}]
    detection = detect(_circles(tmp_path / "c", (800.0,), play, 4))
    assert detection.disagreements[0].parameter == "EC0X" and detection.disagreements[0].between == "direction"
    assert np.sqrt(detection.fit.chi2_dof) < 1.05
    ccw, cw = detection.disagreements[0].values.values()
    assert abs(ccw[0] - cw[0]) > 3.0 * np.hypot(ccw[1], cw[1])


def test_repeated_runs_show_the_noise_that_a_mismatch_would_swell():
    rigid = location_only("table-bc")
    once = r_test_grid(rigid, step_deg=45.0)
    twice = [replace(r, id=f"{r.id}-again", file=f"{r.id}-again.csv") for r in once]
    plan = campaign_of(rigid, (*once, *twice))
    assert len(plan.repeats) == len(once)
    bowed = make_effect("error_motion", component="EZC", basis="fourier", order=3)
    size = {p.name: 2.0 for p in bowed.parameters(plan)}
    measured = simulate(plan, truth=size, effects=[bowed], seed=5).campaign
    declared = measured.runs[0].noise("r_test")
    plain, repeated = identify(measured), identify(measured, noise="repeats")
    assert (
        max(n.total for n in repeated.noises.values()) < 1.15 * declared < max(n.total for n in plain.noises.values())
    )
    detection = detect(measured)
    lack = next(t for t in detection.tests if t.name == "lack of fit")
    assert lack.p_value < 1e-6 and detection.mismatch


def test_a_tone_is_found_at_its_frequency_over_runs_that_are_minutes_apart(tmp_path):
    machine = plant.planar_table()
    runs = [
        plant.planar_circle(machine, f"r{i}", centre=(0.0, 0.0, 80.0), feed=1600.0, direction=d, start_s=200.0 * i)
        for i, d in enumerate((1, -1))
    ]
    tone = {"effect": "vibration", "frequency_hz": 6.71856, "amplitude": 2.0, "direction": [0.8, 0.6, 0.0]}
    location = locate(read_by_the_plant(tmp_path / "c", machine, runs, [tone], seed=6))
    first = location.suspects[0]
    assert first.effect.id == "vibration" and first.effect.frequency_hz == pytest.approx(6.71856, abs=1e-3)
    assert len(first.intervals) <= 40
    assert sum(i.end_s - i.begin_s for i in first.intervals) > 0.5 * sum(r.duration for r in first.campaign.runs)


def test_runs_are_parted_by_what_they_differ_in(tmp_path):
    groups = partitions(_circles(tmp_path / "c", (800.0, 2400.0), [], 1))
    assert {label: len(ids) for label, ids in groups["feed"].items()} == {"about 800 mm/min": 2, "about 2400 mm/min": 2}
    assert set(groups["direction"]) == {"XY counter-clockwise", "XY clockwise"}


@pytest.mark.slow
def test_backlash_hides_in_servo_mismatch_by_64_over_9_pi_squared_on_one_feed(tmp_path):
    """Energy of sgn(sin θ)·cos θ in the span of sin 2θ; a second feed brings back what the first one hides."""
    seen = {}
    for feeds in ((800.0,), (800.0, 2400.0)):
        campaign = _circles(tmp_path / f"c{len(feeds)}", feeds, [], 3)
        gain = EffectEntry(effect="servo_mismatch", axis="X", options={"gains": ("position_gain",)})
        held = replace(campaign.machine, effects=(*campaign.machine.effects, gain))
        location = locate(identify(campaign.with_machine(held), noise="declared"))
        seen[len(feeds)] = next(o.visible for o in location.observability if o.form == "backlash.X")
    assert 1.0 - seen[1] == pytest.approx(64.0 / (9.0 * np.pi**2), abs=0.005)
    assert seen[2] > 1.4 * seen[1]


@pytest.mark.slow
def test_a_concentric_circle_has_one_class_of_bow_scale_and_yaw_that_only_another_place_parts():
    machine = preset("three-axis")
    plain = replace(machine, errors={n: machine.errors[n] for n in ("EC0X", "EA0Z", "EB0Z")})
    runs = [
        replace(run, id=f"{run.id}-{feed:g}", file=f"{run.id}-{feed:g}.csv")
        for feed in (500.0, 2000.0)
        for run in planar_circle(plain, feed=feed, centre=(100.0, 0.0, 110.0))
    ]
    measured = simulate(campaign_of(plain, runs), seed=3).campaign
    location = locate(measured)
    bow, scale, yaw = "error_motion.EYX.P2", "error_motion.EYY.P2", "error_motion.ECX.P2"
    assert any({bow, scale, yaw} <= set(c) for c in location.classes)

    first, second = (make_effect("error_motion", component=c, basis="polynomial", order=2) for c in ("EYX", "EYY"))
    test = next_test(measured, first, second, values={bow: 5.0})
    sigmas = {s.name.removeprefix("xy-ccw-500-"): s.sigmas for s in test.table}
    for useless in ("repeat", "faster", "slower", "half-radius"):
        assert sigmas[useless] < 1.0, useless
    assert max(s for name, s in sigmas.items() if name.startswith("centre") and "150" in name) > 30.0
    assert test.useful and "150" in test.says


def test_what_was_found_beside_a_finding_is_no_rival_of_it_any_more():
    machine = preset("three-axis")
    plan = campaign_of(machine, planar_circle(machine, direction="ccw"))
    first, second = (make_effect("backlash", axis).prepare(plan) for axis in "XY")
    assert next_test(plan, first, second, held=(second,)) is None
    assert next_test(plan, first, second, held=(make_effect("latency").prepare(plan),)) is not None


def test_where_no_single_test_separates_all_causes_the_next_ones_come_together(tmp_path):
    """Play of Z as a tilt or sideways is distinguished with a longer tool, a yaw of Y from both beside: it takes both."""
    poses = plant.grid_poses(np.arange(-90, 91, 30.0), np.arange(0, 331, 30.0))
    machine = plant.static_table()
    bar = plant.static_ball_bar(machine, "bar-x", table_ball=(0.0, 0.0, 140.0), poses=np.vstack([poses, poses[::-1]]))
    measured = read_by_the_plant(tmp_path / "c", machine, [bar], [])
    tilt, side, yaw = (make_effect("lateral_play", component=c).prepare(measured) for c in ("EBZ", "EXZ", "ECY"))
    for first, others in ((tilt, (side, yaw)), (yaw, (tilt, side))):
        test = next_test(measured, first, *others)
        assert [run.id for run in test.test.runs] == ["bar-x-beside", "bar-x-longer-tool"]
        assert test.test.runs[1].start_s > test.test.runs[0].start_s + test.test.runs[0].duration
        assert test.useful and min(sigmas for _, sigmas in test.each) > 30.0 and "no test" not in test.says
    assert test.also == (("lateral_play.EBZ", "lateral_play.EXZ"),) and "EBZ" in test.says and "EXZ" in test.says
    improbable = next_test(measured, yaw, tilt, side, chances=(0.02, 0.01))
    assert len(improbable.test.runs) == 1 and not improbable.also


@pytest.mark.parametrize("instrument", ["ball_bar", "r_test in motion"])
def test_a_bar_or_a_nest_can_be_mounted_elsewhere_in_the_same_poses(instrument):
    """A tool ball that stayed mounted over the runs stays so where nothing of it changes."""
    machine = preset("table-bc")
    if instrument == "ball_bar":
        run = static_ball_bar(machine, table_balls=[(50.0, 0.0, 60.0)], length=50.0)[0]
    else:
        run = r_test_grid(machine, nests=((50.0, 0.0, 60.0),))[0]
        run = replace(run, sampling="dynamic", time=60.0 * np.arange(run.rows))
    other = "table_ball" if instrument == "ball_bar" else "zero"
    run = replace(run, mounting={"tool_ball": "1", other: "2"})
    tests = {test.id.removeprefix(f"{run.id}-"): test for test in possible_tests(campaign_of(machine, [run]))}
    assert {"repeat", "reversed", "opposite", "turned", "higher", "longer-tool"} <= set(tests)
    nominal = Nominal(machine)
    bar = nominal.ball(run.commands, run.tool_ball) - np.asarray(run.table_ball)
    for name in ("opposite", "turned", "higher", "longer-tool"):
        test = tests[name]
        assert np.allclose(nominal.ball(test.commands, test.tool_ball) - np.asarray(test.table_ball), bar, atol=1e-6), (
            name
        )
        assert all(np.array_equal(test.commands[n], run.commands[n]) for n in ("B", "C")), name
        assert test.mounting.get("tool_ball") == (None if name == "longer-tool" else "1"), name
        assert test.mounting.get(other) == ("2" if name == "longer-tool" and other == "table_ball" else None), name
        Model(campaign_of(machine, [run, test]))


def test_tests_to_choose_from_have_the_rows_that_the_recorder_lost():
    machine = preset("three-axis")
    run = planar_circle(machine, feed=1000.0)[0]
    kept = np.random.default_rng(1).random(run.rows) > 0.02
    kept[[0, -1]] = True
    lost = replace(run, time=run.time[kept], commands={n: way[kept] for n, way in run.commands.items()})
    repeat, *others = possible_tests(campaign_of(machine, [lost]))
    assert {run.rows} == {test.rows for test in (repeat, *others) if "-in-" not in test.id}
    for axis, way in run.commands.items():
        assert np.abs(repeat.commands[axis] - way).max() < 0.01, axis
    assert np.allclose(repeat.time, run.time)


@pytest.mark.slow
@pytest.mark.parametrize("law", [{"width": 0.3}, {"width": 3.0, "form": "presliding", "distance": 270.0}])
def test_an_alias_is_named_with_its_rival_and_separated_by_the_test_it_asks_for(tmp_path, law):
    """Play of X and a carriage that turns about B at 80 mm below the ball cannot be distinguished until the ball stands
    higher, whatever the contact does behind a reversal: with pre-sliding the turn was compared without, play stated at 99 %."""
    play = [{"effect": "backlash", "axis": "X", **law}]
    campaign = _circles(tmp_path / "c", (800.0,), play, 4)
    found = diagnose(campaign)
    finding = found.findings[0]
    assert (finding.name, finding.axis) == ("backlash", "X") and finding.confidence < 0.9
    assert finding.rivals[0].effect == "lateral_play" and finding.rivals[0].confidence > 0.1
    assert finding.test is not None and finding.test.useful and "-z" in finding.test.table[0].name
    assert finding.test.before < 2.0
    asked = finding.test.test.runs[0]
    machine = plant.planar_table()
    run = plant.planar_circle(machine, "asked", centre=asked.table_ball, feed=800.0, direction=1)
    both = diagnose(campaign.joined(read_by_the_plant(tmp_path / "next", machine, [run], play, seed=9)))
    assert (both.findings[0].name, both.findings[0].axis) == ("backlash", "X") and both.findings[0].confidence > 0.95


@pytest.mark.parametrize(("tilt", "sags"), [(0.0, False), (30.0, True)])
def test_an_axis_that_stays_upright_has_no_sag_among_its_candidates(tilt, sags):
    """A table that turns about the vertical carries nothing in whose frame gravity turns."""
    machine = preset("table-bc")
    plan = campaign_of(machine, r_test_grid(machine, grid={"B": (tilt,), "C": tuple(range(0, 360, 30))}))
    stated = {(form.effect.id, form.effect.axis) for form in candidates(plan).forms}
    assert ("backlash", "C") in stated
    assert (("gravity_sag", "C") in stated) == sags
