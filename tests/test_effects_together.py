"""Effects together: what joins, what varies over a coordinate, what a latency leaves alone."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from effects_world import assert_exact, campaign

from symfive.effects import EFFECTS, Tone, make_effect
from symfive.errors import InputError
from symfive.machine import preset
from symfive.model import Model, effect_to_data, effects_from_data, signature
from symfive.motion import approach
from symfive.posterior import candidates
from symfive.procedures import campaign_of, planar_circle, r_test_grid

COMBINED = [
    ("planar", [("friction", "X", {}), ("servo_mismatch", "X", {})], 0.03),
    ("circle", [("servo_mismatch", "C", {}), ("backlash", "C", {}),
                ("structural_resonance", "X", {"frequency_hz": 30.0})], 0.03),
    ("planar", [("latency", None, {}), ("servo_mismatch", "X", {"gains": ("position_gain",)}),
                ("sensor_low_pass", None, {}), ("sensor_error", None, {})], 0.03),
    ("static", [("gravity_sag", "B", {"component": "EZB"}), ("thermal_drift", None, {}), ("eccentric_mass", "C", {}),
                ("transmission_error", "C", {"period": 90.0})], 0.0),
]  # fmt: skip


@pytest.mark.parametrize(("where", "effects", "events"), COMBINED, ids=lambda v: v if isinstance(v, str) else "")
def test_effects_join(where: str, effects: list[tuple[str, str | None, dict[str, Any]]], events: float) -> None:
    model = Model(campaign(where), [make_effect(name, axis, **options) for name, axis, options in effects])
    names = [p.name for e in model.effects for p in e.parameters(model.campaign)]
    names += [p.name for p in model.parameters if p.kind == "location_error"][:1]
    assert_exact(model, names, events=events)


def test_latency_leaves_the_control_s_own_recording_alone() -> None:
    plan = campaign("planar")
    runs = tuple(replace(run, instrument=("ball_bar", "encoder")) for run in plan.runs)
    change = signature(make_effect("latency"), replace(plan, runs=runs), {"delay_ms": 8.0})
    for run in runs:
        assert np.abs(change[run.id][:, 0]).max() > 0.01
        assert np.abs(change[run.id][:, 1:]).max() == 0.0


def test_latency_leaves_what_other_effects_do_to_the_control_s_own_recording_alone() -> None:
    """A clock belongs to a reading: force and bar may look at the velocity of one axis, and only the bar sees it late."""
    plan = campaign("planar")
    options = {"axis": "X", "force_terms": ("mass", "viscous")}
    runs = tuple(
        replace(run, instrument=("drive_force", "ball_bar"), options=options, readings={}) for run in plan.runs
    )
    plan = replace(plan, runs=runs)
    others = [make_effect("force_friction", "X"), make_effect("unknown", over=("X velocity",), place="force")]
    model = Model(plan, [*others, make_effect("latency")])
    at = {p.name: 5.0 for e in model.effects[:2] for p in e.parameters(plan)} | {"drive_force.X.mass": 90.0}
    on_time, late = model.predict(at), model.predict({**at, "latency.delay_ms": 8.0})
    for run in runs:
        change = late[run.id] - on_time[run.id]
        assert np.abs(change[:, 0]).max() == 0.0 and np.ptp(on_time[run.id][:, 0]) > 1.0
        assert np.abs(change[:, 1]).max() > 0.01
    names = [*at, "latency.delay_ms", next(p.name for p in model.parameters if p.kind == "location_error")]
    assert_exact(model, names)


@pytest.mark.parametrize("name", ["latency", "sensor_low_pass"])
def test_where_the_control_records_everything_no_instrument_is_late(name: str) -> None:
    plan = campaign("planar")
    runs = tuple(replace(run, instrument=("encoder",), readings={}) for run in plan.runs)
    assert not any(make_effect(name).applies(run) for run in runs)
    assert any(make_effect(name).applies(run) for run in plan.runs)
    assert name not in {form.effect.id for form in candidates(replace(plan, runs=runs)).forms}


def test_further_harmonics_join_those_of_the_baseline() -> None:
    plan = campaign("planar")
    effect = make_effect("error_motion", component="EXX", basis="polynomial", order=3)
    assert [p.name for p in effect.parameters(plan)] == ["error_motion.EXX.P2", "error_motion.EXX.P3"]


def test_an_error_motion_however_large_leaves_location_errors_what_they_are_at_the_axis_zero() -> None:
    """A polynomial vanishes at zero, with its slope there where a squareness has the slope."""
    tilt = campaign("static")
    rows = {run.id: run.commands["B"] == 0.0 for run in tilt.runs}
    assert sum(int(np.sum(at)) for at in rows.values()) > 5
    model = Model(tilt, [make_effect("error_motion", component="EXB", basis="polynomial", order=3)])
    moved = model.contribution(model.effects[-1], model.vector({f"error_motion.EXB.P{k}": 1000.0 for k in (1, 2, 3)}))
    assert max(np.abs(moved[id][at]).max(initial=0.0) for id, at in rows.items()) < 1e-6
    assert max(np.abs(moved[id]).max() for id in rows) > 100.0

    machine = preset("three-axis")
    square = replace(machine, errors={"EC0X": machine.errors["EC0X"]})
    circle = Model(
        campaign_of(square, planar_circle(square, centre=(0.0, 0.0, 110.0))),
        [make_effect("error_motion", component="EYX", basis="polynomial", order=3)],
    )
    (effect,) = circle.effects
    for id, y in circle.contribution(effect, circle.vector({"error_motion.EYX.P3": 1000.0})).items():
        run = circle.campaign.run(id)
        x, across = run.commands["X"], np.abs(run.commands["Y"]) / np.hypot(run.commands["X"], run.commands["Y"])
        near = (np.abs(x) < 70.0) & (np.abs(x) > 20.0)
        bow = np.abs(y[near, 0] / across[near] / x[near] ** 3)
        assert np.ptp(bow) < 0.25 * bow.mean()  # the axis lags behind its command


@pytest.mark.parametrize(
    ("over", "where"), [("C", "static"), ("t", "static"), ("B velocity sign", "static"), ("X velocity", "planar")]
)
def test_what_varies_is_the_effect_times_a_function_of_the_coordinate(over: str, where: str) -> None:
    plan, inner = campaign(where), make_effect("lateral_play", component="EYX" if where == "planar" else "EZB")
    effect = make_effect("varying", of=inner, over=over).prepare(plan)
    plain, varied = Model(plan, [inner]), Model(plan, [effect])
    shares = {p.name: m for p, m in zip(effect.parameters(plan)[1:], (0.4, -0.3), strict=False)}
    size = {f"{inner.key}.width": 6.0}
    for run in plan.runs:
        if over == "t":
            course = run.start_s + run.time
        elif over.endswith("sign"):
            course = approach(run.commands["B"])
        else:
            course = np.gradient(run.commands["X"], run.time) if over.endswith("velocity") else run.commands[over]
        ends = [np.min(effect.span), np.max(effect.span)]
        z = np.clip(2.0 * (course - ends[0]) / (ends[1] - ends[0]) - 1.0, -1.0, 1.0)
        functions = (
            (z, 1.5 * z**2 - 0.5) if not effect.periodic else (np.cos(np.radians(course)), np.sin(np.radians(course)))
        )
        share = 1.0 + sum(m * f for m, f in zip(shares.values(), functions, strict=False))
        alone, both = (model.predict_run(run, values) - model.predict_run(run, {})
                       for model, values in ((plain, size), (varied, size | shares)))  # fmt: skip
        if over.endswith("velocity"):  # behind its drive the axis is not quite as fast as commanded
            steady = np.abs(np.gradient(course)) < 1e-2 * np.abs(course).max()
            alone, both, share = alone[steady], both[steady], share[steady]
        scale = np.abs(alone).max()
        assert np.allclose(both, share[:, None] * alone, atol=(2e-2 if over.endswith("velocity") else 1e-3) * scale)
    assert_exact(varied, [p.name for p in effect.parameters(plan)])
    again = effects_from_data(json.loads(json.dumps([effect_to_data(effect)])), "model.json")
    assert again == (effect,)


def test_what_acts_inside_the_position_loop_cannot_vary() -> None:
    with pytest.raises(InputError, match="cannot vary over Y"):
        make_effect("varying", of=make_effect("servo_mismatch", "X"), over="Y").prepare(campaign("planar"))
    with pytest.raises(InputError, match='varies over "Q", which is unknown'):
        make_effect("varying", of={"effect": "backlash", "axis": "X"}, over="Q").prepare(campaign("planar"))


@pytest.mark.parametrize("step_deg", [15.0, 90.0])
def test_no_period_is_sought_between_positions_that_only_rounding_tells_apart(step_deg: float) -> None:
    """Linear axes that follow the table come back to a position with another last digit. Half of the steps at 90° were such ones:
    cycles up to 1e13 per mm were to be tried, and a diagnosis ended for want of memory."""
    machine = preset("tsutsumi-2007")
    grid, *_ = r_test_grid(machine, step_deg=step_deg, returning=False)

    def highest(commands: dict[str, np.ndarray]) -> dict[str | None, float]:
        forms = EFFECTS["transmission_error"].candidates(campaign_of(machine, [replace(grid, commands=commands)]))
        return {form.axis: form.highest for form in forms if isinstance(form, Tone)}

    found = highest(dict(grid.commands))
    assert found == pytest.approx(highest({axis: np.round(q, 9) for axis, q in grid.commands.items()}))
    assert bool(found) == (step_deg < 90.0)  # of three positions there is none
