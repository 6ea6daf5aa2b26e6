"""Effects in the force of a drive: friction, ripple, weight, a recording that comes early."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from effects_world import assert_exact
from laser_world import axis_alone

from symfive.campaign import Campaign, Run
from symfive.diagnose import diagnose
from symfive.effects import Effect, Form, make_effect
from symfive.errors import InputError
from symfive.machine import Machine, Structure, make_axis, preset
from symfive.model import Model
from symfive.posterior import WHITE, baseline, candidates, expanded, explore, fitted, moments_about, moments_of


def test_force_friction_is_a_level_for_each_direction_where_the_baseline_has_none() -> None:
    machine = preset("three-axis")
    time = np.arange(400) * 0.01
    rest = {name: np.zeros(400) for name in machine.axis_names}
    bare = Run(
        id="x", instrument=("drive_force",), sampling="dynamic", time=time,
        commands={**rest, "X": 40.0 * np.sin(2.0 * np.pi * time)}, noise_um=0.3,
        options={"axis": "X", "force_terms": ("mass", "viscous")},
    )  # fmt: skip
    plan = Campaign(machine=machine, runs=(bare,))
    model = Model(plan, [make_effect("force_friction", "X")])
    sized = {"force_friction.X.coulomb": 20.0, "force_friction.X.offset": -3.0}
    force = (model.predict(sized)["x"] - model.predict({})["x"])[:, 0]
    speed = np.gradient(bare.commands["X"], time)
    clear = (np.abs(speed) > 60.0) & (time > 0.0)  # it starts from rest
    np.testing.assert_allclose(force[clear], 20.0 * np.sign(speed[clear]) - 3.0, atol=1e-9)
    full = replace(plan, runs=(replace(bare, options={"axis": "X"}),))
    with pytest.raises(InputError, match="without friction in its baseline"):
        make_effect("force_friction", "X").prepare(full)


def force_of(axis: str, machine: Machine, **more: float) -> Campaign:
    """The force of one axis along an encoder's motion that has passed the force's low-pass; all rotary axes move."""
    time = np.arange(600) * 0.01
    commands = {name: np.zeros(600) for name in machine.axis_names}
    for number, name in enumerate(n for n in machine.axis_names if machine.axes[n].rotary):
        commands[name] = 40.0 * np.sin((1.0 + 0.3 * number) * time)
    commands[axis] = 40.0 * np.sin(2.0 * time) + 15.0 * np.sin(5.0 * time)
    rotary = machine.axes[axis].rotary
    unit, quantity = ("deg", "torque_Nm") if rotary else ("mm", "force_N")
    options = {"axis": axis, "encoder_axes": [axis], "motion_from": "encoder", "low_pass_hz": 20.0} | more
    run = Run(
        id="f", instrument=("encoder", "drive_force"), sampling="dynamic", time=time, commands=commands, options=options,
        readings={f"{axis}_act_{unit}": commands[axis], f"{axis}_{quantity}": 10.0 * np.cos(time)},
    )  # fmt: skip
    return Campaign(machine=machine, runs=(run,))


def added_force(effect: Effect, plan: Campaign, values: dict[str, float]) -> np.ndarray:
    """What an effect adds to the recorded force (N,)."""
    model = Model(plan, [effect])
    at = model.named(model.start) | {"drive_force.X.mass": 80.0, "drive_force.X.viscous": 200.0} | values
    at = {name: value for name, value in at.items() if name in model.index}
    return np.asarray(model.contribution(model.effects[0], model.vector(at))["f"][:, 1])


def test_a_force_that_is_recorded_early_is_that_of_a_moment_later() -> None:
    plan = force_of("X", preset("three-axis"))
    t = plan.runs[0].time
    speed = (80.0 * np.cos(2.0 * t) + 75.0 * np.cos(5.0 * t)) * 1e-3
    acceleration = (-160.0 * np.sin(2.0 * t) - 375.0 * np.sin(5.0 * t)) * 1e-3
    jerk = (-320.0 * np.cos(2.0 * t) - 1875.0 * np.cos(5.0 * t)) * 1e-3
    added = added_force(make_effect("force_delay", "X"), plan, {"force_delay.X.delay_ms": -2.0})
    inner = slice(50, -50)
    np.testing.assert_allclose(added[inner], 2e-3 * (80.0 * jerk + 200.0 * acceleration)[inner], atol=1e-3)
    assert np.ptp(speed) > 0.1
    bare = replace(plan, runs=(replace(plan.runs[0], options={"axis": "X"}),))
    with pytest.raises(InputError, match="filtered motion"):
        make_effect("force_delay", "X").prepare(bare)


def test_a_ripple_of_the_force_follows_the_way() -> None:
    plan = force_of("X", preset("three-axis"))
    values = {"force_ripple.X.sin": 3.0, "force_ripple.X.cos2": -1.0}
    added = added_force(make_effect("force_ripple", "X", period=7.0, harmonics=2), plan, values)
    angle = 2.0 * np.pi * plan.runs[0].commands["X"] / 7.0
    np.testing.assert_allclose(added[20:], (3.0 * np.sin(angle) - np.cos(2.0 * angle))[20:], atol=0.2)
    with pytest.raises(InputError, match="no run records the drive force of Y"):
        make_effect("force_ripple", "Y", period=7.0).prepare(plan)


def test_friction_of_a_drive_may_differ_by_direction_and_fade_with_the_speed() -> None:
    plan = force_of("X", preset("three-axis"), force_terms=("mass", "viscous"))
    effect = make_effect("force_friction", "X", parts=("coulomb", "skew", "stribeck"))
    sizes = {"coulomb": 20.0, "skew": 30.0, "stribeck": -8.0, "speed": 12.0}
    added = added_force(effect, plan, {f"force_friction.X.{name}": size for name, size in sizes.items()})
    speed = np.gradient(plan.runs[0].commands["X"], plan.runs[0].time)
    clear = np.abs(speed) > 40.0
    expected = 20.0 * np.sign(speed) + 0.03 * np.abs(speed) - 8.0 * np.sign(speed) * np.exp(-np.abs(speed) / 12.0)
    np.testing.assert_allclose(added[clear], expected[clear], atol=0.3)  # the filter rounds reversals


def test_friction_of_a_drive_may_change_along_the_axis() -> None:
    plan = force_of("X", preset("three-axis"))
    effect = make_effect("force_friction", "X", parts=("along",))
    added = added_force(effect, plan, {"force_friction.X.along": 250.0})
    way = plan.runs[0].commands["X"]
    speed = np.gradient(way, plan.runs[0].time)
    clear = np.abs(speed) > 40.0
    np.testing.assert_allclose(added[clear], (0.25 * way * np.sign(speed))[clear], atol=0.3)


def driven(course: Callable[[np.ndarray], np.ndarray]) -> Campaign:
    """The force of a drive at two speeds; its Coulomb friction is 180 N and a `course` over the position, N."""
    rng, runs = np.random.default_rng(3), []
    for speed in (40.0, 120.0):
        omega = speed / 200.0
        time = np.arange(0.0, 4.0 * np.pi / omega, 0.05)
        way, rate = -200.0 * np.cos(omega * time), 200.0 * omega * np.sin(omega * time)
        sign = np.clip(rate / 0.1, -1.0, 1.0)
        force = 0.4 * omega**2 * 200.0 * np.cos(omega * time) + 1.5 * rate + (180.0 + course(way)) * sign + 5.0
        runs.append(
            Run(
                id=f"v{speed:g}", instrument=("drive_force",), sampling="dynamic", time=time, commands={"X": way},
                readings={"X_force_N": force + rng.normal(0.0, 2.0, len(time))}, noise_um=2.0,
                options={"axis": "X", "between": "curve", "start": "moving"},
            )
        )  # fmt: skip
    return Campaign(machine=axis_alone(-210.0, 210.0), runs=tuple(runs))


def test_preload_that_changes_along_the_axis_is_found() -> None:
    """Only speed and time had names; a screw whose friction rises by 30 % to one end was a following lag and vibrations."""
    [finding] = diagnose(driven(lambda way: 0.27 * way)).findings
    along = finding.parameters["along"]
    assert (finding.name, finding.axis) == ("friction", "X")
    assert along.value == pytest.approx(270.0, abs=3.0 * along.std)
    assert along.std < 5.0


def test_only_what_moves_the_readings_is_weighed() -> None:
    """A backlash that no encoder sees was a rival of what the force shows, at 59 %."""
    plan = driven(lambda way: 0.27 * way)
    every = candidates(plan)
    moments = moments_about(expanded(baseline(plan), (), every)[0], every)
    weighed = {t for subset in explore(moments).mass for t, _ in subset}
    assert 5 < len(weighed) < 0.5 * len(moments.terms)
    assert all(moments.terms[t].effect.in_the_drive or moments.terms[t].effect.unidentified for t in weighed)


def test_a_law_that_varies_leaves_no_room_for_another_law_of_its_slot() -> None:
    """Two laws of one friction, one of which varied, were of opposite sign: 124 and -123 N."""
    plan = driven(lambda way: 0.27 * way)
    every = candidates(plan)
    law = next(form.effect for form in every.forms if form.effect.key == "force_friction.X.place")
    varying = make_effect("varying", of=law, over="t").prepare(plan)
    fit = fitted(Model(plan, [varying]), [{}], WHITE, 1.0, baseline(plan))
    others = [f for f in every.forms if f.effect.id in ("force_friction", "unknown") and f.effect.key != law.key]
    assert others[-1].effect.id == "force_friction"
    found = explore(moments_of(fit, [Form(effect=varying)], others), (0,))
    terms = found.moments.terms
    keys = [{terms[t].effect.key for t, _ in subset} for subset in found.mass]
    assert any(law.key in each and len(each) > 1 for each in keys)
    assert not any(sum(key.startswith("force_friction") for key in each) > 1 for each in keys)


def test_a_force_is_looked_for_by_place_and_direction() -> None:
    plan = driven(np.zeros_like)
    forms = [f for f in make_effect("unknown", over=("X",)).candidates(plan) if isinstance(f, Form)]
    own = [f.effect for f in forms if f.effect.over == ("X", "X velocity sign") and f.effect.place == "force"]
    assert len(own) == 1
    table = own[0].table(plan.machine, plan.runs)
    way, time = plan.runs[0].commands["X"], plan.runs[0].time
    pull = np.where(np.abs(way - 40.0) < 60.0, 1.0, 0.0) * np.sign(np.gradient(way, time))
    rows = np.r_[: len(way)]
    left = pull - table[rows] @ np.linalg.lstsq(table[rows], pull)[0]
    assert np.mean(left**2) < 0.3 * np.mean(pull**2)  # a place where friction is higher, in both directions


@pytest.mark.slow
def test_a_place_of_high_friction_is_over_position_and_direction() -> None:
    """It was a vibration of the force with phases of its own in each run."""
    [finding] = diagnose(driven(lambda way: 60.0 * np.exp(-0.5 * ((way - 40.0) / 50.0) ** 2))).findings
    assert finding.effect.coordinate == "X, X velocity sign"


def test_weight_loads_the_drive_of_a_tilted_axis() -> None:
    """A pendulum: the torque of a weight moment about a horizontal axis is that times the cosine of its angle to the horizon."""
    axes = {
        "J1": make_axis("J1", kind="rotary", direction=(0.0, 1.0, 0.0), origin=(0.0, 0.0, 100.0)),
        "J2": make_axis("J2", kind="rotary", direction=(0.0, 1.0, 0.0), origin=(0.0, 0.0, 400.0)),
        "J3": make_axis("J3", kind="rotary", direction=(0.0, 0.0, 1.0), origin=(0.0, 0.0, 400.0)),
    }
    machine = Machine(name="arm", structure=Structure.parse("w b J1 J2 J3 t"), axes=axes, errors={})
    plan = force_of("J1", machine)
    angle = {name: np.radians(way) for name, way in plan.runs[0].commands.items()}
    sizes = {"gravity_torque.J1.J1.z": 5.0, "gravity_torque.J1.J2.z": 2.0}
    added = added_force(make_effect("gravity_torque", "J1"), plan, sizes)
    # weight at the upper end of both links: it pulls the arm over as the sines of their angles
    expected = 5.0 * np.sin(angle["J1"]) + 2.0 * np.sin(angle["J1"] + angle["J2"])
    np.testing.assert_allclose(np.abs(added), np.abs(expected), atol=1e-6)
    with pytest.raises(InputError, match="no weight loads it"):
        make_effect("gravity_torque", "Z1").prepare(force_of("Z1", upright()))


def upright() -> Machine:
    axes = {"Z1": make_axis("Z1", kind="rotary", direction=(0.0, 0.0, 1.0), origin=(0.0, 0.0, 0.0))}
    return Machine(name="turn", structure=Structure.parse("w b Z1 t"), axes=axes, errors={})


def test_an_unknown_of_a_drives_force_takes_nothing_from_offset_direction_and_speed() -> None:
    machine = preset("three-axis")
    time = np.arange(900) * 0.01
    commands = {name: np.zeros(900) for name in machine.axis_names}
    commands["X"] = 40.0 * np.sin(2.0 * np.pi * time) + 15.0 * np.sin(5.0 * time)
    bare = Run(
        id="x", instrument=("drive_force",), sampling="dynamic", time=time, commands=commands, noise_um=0.3,
        options={"axis": "X"},
    )  # fmt: skip
    plan = Campaign(machine=machine, runs=(bare,))
    model = Model(plan, [make_effect("unknown", over=("X velocity",), place="force", order=6)])
    names = [p.name for p in model.effects[0].parameters(plan)]
    assert {p.unit for p in model.parameters if p.name in names} == {"N"}
    speed = np.gradient(commands["X"], time)
    own = np.column_stack([np.ones(900), np.sign(speed), speed])
    at = model.contribution(model.effects[0], model.vector(dict.fromkeys(names, 5.0) | {names[0]: -9.0}))["x"][:, 0]
    taken = own @ np.linalg.lstsq(own, at, rcond=None)[0]
    assert np.std(at) > 0.5 and np.std(taken) < 0.2 * np.std(at)  # the drive lags behind its command
    assert_exact(model, names)
    with pytest.raises(InputError, match="no run records the drive force of Y"):
        make_effect("unknown", over=("Y",), place="force").prepare(plan)
