"""What effects state for a campaign as possibly missing, and in which form it is looked at."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from posterior_world import CAMPAIGNS, bars

import symfive
from symfive.campaign import read_campaign
from symfive.effects import EFFECTS, Form, Scan, Tone, make_effect
from symfive.effects.backlash import SHAPES
from symfive.machine import preset
from symfive.model import Model
from symfive.posterior import (
    WHITE,
    baseline,
    candidates,
    expanded,
    explore,
    fitted,
    linear_estimate,
    log_evidence,
    moments_about,
    moments_of,
)
from symfive.procedures import campaign_of, planar_circle, r_test_grid
from symfive.simulate import simulate


def test_every_effect_states_its_own_candidates() -> None:
    campaign = bars({}, angles=100)
    for effect in EFFECTS.values():
        assert all(isinstance(stated, Form | Scan | Tone) for stated in effect.candidates(campaign))
    keys = [form.effect.key for form in candidates(campaign).forms if not form.at]
    assert {"backlash.X", "backlash.Y", "lateral_play.EXY", "friction.X"} <= set(keys)
    assert len(keys) == len(set(keys))
    assert not any(
        key.startswith("backlash") for key in (f.effect.key for f in candidates(campaign, ["backlash"]).forms)
    )


def test_a_backlash_can_take_each_of_its_shapes_whichever_it_joined_in() -> None:
    """A step that had joined was never refitted as the free play that it was, and the tilt of a carriage was: it came first."""
    every = candidates(bars({}, angles=100)).forms
    stated = [form for form in every if form.effect.id == "backlash"]
    assert {form.effect.shape for form in stated} >= {"play", "step"}
    assert all({form.effect.shape, *(other.shape for other in form.shapes)} == set(SHAPES) for form in stated)


def test_a_counterbalance_is_looked_for_on_a_vertical_axis_that_turns_back() -> None:
    keys = {form.effect.key for form in candidates(read_campaign(CAMPAIGNS / "static-none" / "fit")).forms}
    assert {key for key in keys if key.startswith("counterbalance")} == {"counterbalance.Z"}


@pytest.mark.parametrize(("package", "others"), [
    ("posterior", set()), ("diagnose", {"unknown", "location_error", "error_motion"}),  # a verdict, two kinds of parameters
])  # fmt: skip
def test_no_effect_is_named_in_the_package(package: str, others: set[str]) -> None:
    text = "\n".join(path.read_text() for path in (Path(symfive.__file__).parent / package).glob("*.py"))
    assert {name for name in EFFECTS if re.search(rf"[\"']{name}\b", text)} == others


@pytest.mark.slow
def test_another_component_joins_in_the_law_of_the_held_one() -> None:
    """A roll that gave way over some distance was stated without EYX, which cannot be distinguished at one height: that was
    considered as a step only."""
    machine = preset("three-axis")
    grids = planar_circle(machine, plane="XY", feed=1000.0, rate_hz=10.0, instrument="grid_encoder")
    stated = candidates(campaign_of(machine, grids))
    roll = next(form for form in stated.forms if form.effect.key == "lateral_play.EAX")
    gradual = next(shape for shape in roll.shapes if shape.shape == "play")
    truth = {"lateral_play.EAX.width": 30.0, "lateral_play.EAX.distance": 50.0}
    campaign = simulate(campaign_of(machine, grids), truth=truth, effects=[gradual], seed=1).campaign
    fit = fitted(Model(campaign, [gradual]), [truth], WHITE, 1.0)
    terms = moments_about(expanded(fit, [replace(roll, effect=gradual)], stated)[0], stated).terms
    assert "play" in {t.effect.shape for t in terms if t.effect.key == "lateral_play.EYX" and not t.needs}


def test_friction_is_looked_at_where_it_is_of_some_size() -> None:
    """Its slopes at a size and what it adds beyond them give the readings at that size exactly."""
    campaign = read_campaign(CAMPAIGNS / "dynamic-backlash" / "fit")
    fit = baseline(campaign)
    form = next(f for f in candidates(campaign).forms if f.at)
    found = moments_of(fit, (), [form])
    model = Model(campaign, [*fit.model.added, form.effect])
    values = model.vector({**fit.named, **form.at})
    (own,) = found.columns
    amount = np.array([0.0 if not size else (model.named(values)[p.name] - p.mean) / p.sigma
                       for p, size in zip(form.effect.parameters(campaign), own.amplitude, strict=True)])  # fmt: skip
    gram = found.raw[np.ix_([*own.where, own.exact], [*own.where, own.exact])]
    added = model.contribution(form.effect, values)
    left_out = fit.problem().left_out
    square = sum(float(np.sum(((added[r.id] / model.noise(r))[~left_out[r.id]]) ** 2)) for r in campaign.runs)
    weights = np.append(amount, 1.0)
    assert weights @ gram @ weights == pytest.approx(square, rel=1e-6)


@pytest.mark.parametrize(("effect", "parameter"), [("latency", "delay_ms"), ("sensor_low_pass", "time_constant_ms")])
def test_what_is_late_is_looked_at_about_several_times(effect: str, parameter: str) -> None:
    """While an axis accelerates the slope at nothing says nothing of 150 ms."""
    whole, name = read_campaign(CAMPAIGNS / "planar-none" / "fit"), f"{effect}.{parameter}"
    plan = replace(whole, runs=whole.runs[4:6])
    late = simulate(plan, truth={name: 150.0}, effects=[make_effect(effect)], seed=1).campaign
    found = moments_of(baseline(late), (), candidates(late).forms)
    best = explore(found, named=True).best
    assert [found.terms[t].effect.key for t, _ in best] == [effect]
    assert linear_estimate(found, best, log_evidence(found, best))[1][name] == pytest.approx(150.0, abs=20.0)


def test_a_drift_is_one_law_and_not_a_sum_of_several() -> None:
    """Three onsets in three directions are any curve: they were three names, one above 97 %, for what no name has."""
    plan = read_campaign(CAMPAIGNS / "static-none" / "fit")
    plan = replace(plan, runs=plan.runs[:1])
    one, other = make_effect("thermal_drift"), make_effect("thermal_drift", shape="delayed", tag="late")
    heat = {"thermal_drift.amplitude.y": 15.0, "thermal_drift.late.amplitude.x": -20.0}
    heated = simulate(plan, truth=heat, effects=[one, other], seed=2).campaign
    few = candidates(heated, EFFECTS.keys() - {"thermal_drift", "setup_shift"})
    moments = moments_about(expanded(baseline(heated), (), few)[0], few)
    drifts = {t for t, term in enumerate(moments.terms) if term.effect.id == "thermal_drift"}
    assert any(moments.terms[t].effect.shape == "delayed" for t in drifts)
    assert {len(drifts & {t for t, _ in subset}) for subset in explore(moments, named=True).mass} == {0, 1}


def test_the_two_components_of_a_vector_are_weighed_together() -> None:
    """A tilt of a table, of which either component alone explained next to nothing, was taken for a matrix of the sensors."""
    machine = preset("mixed-bc")
    poses = r_test_grid(machine, grid={"B": [0.0], "C": np.arange(0.0, 361.0, 15.0)}, returning=False)
    clean = simulate(campaign_of(machine, poses), seed=3).campaign
    every = candidates(clean)
    moments = moments_about(expanded(baseline(clean), (), every)[0], every)
    weighed = {frozenset(moments.terms[t].effect.key for t, _ in subset) for subset in explore(moments).mass}
    assert all(
        {f"error_motion.{one}", f"error_motion.{other}"} in weighed for one, other in (("EXC", "EYC"), ("EAC", "EBC"))
    )


def test_a_slope_in_a_delay_is_taken_over_a_row() -> None:
    """Between two rows a command is a chord: what a shorter delay does says little of a longer one."""
    plan = read_campaign(CAMPAIGNS / "planar-none" / "fit")
    fit, latency = baseline(plan), make_effect("latency").prepare(plan)
    found = moments_of(fit, (), [Form(effect=latency)])
    model, square = Model(plan, [*fit.model.added, latency]), 0.0
    left_out = fit.problem().left_out
    for run in plan.runs:
        ahead, behind = (
            model.predict_run(run, {**fit.named, "latency.delay_ms": s * 1e3 * run.interval}) for s in (1, -1)
        )
        slope = (ahead - behind) / (2e3 * run.interval) * latency.parameters(plan)[0].sigma
        square += float(np.sum((slope / model.noise(run))[~left_out[run.id]] ** 2))
    (number,) = found.columns[0].where
    assert found.raw[number, number] == pytest.approx(square, rel=1e-9)
