"""What a drive feels of the inertia of the later axes, against Newton's law on point masses by finite differences."""

from dataclasses import replace

import numpy as np
import pytest
from effects_world import assert_exact

from symfive.campaign import Campaign, Run
from symfive.diagnose import diagnose
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.machine import Machine, Structure, make_axis
from symfive.model import Model

ORDER = ("X", "J1", "Y", "J2", "J3")
AXES = {
    "X": make_axis("X", kind="linear", direction=(1.0, 0.0, 0.0)),
    "J1": make_axis("J1", kind="rotary", direction=(0.0, 0.0, 1.0), origin=(20.0, 0.0, 100.0)),
    "Y": make_axis("Y", kind="linear", direction=(0.0, 1.0, 0.0)),
    "J2": make_axis("J2", kind="rotary", direction=(0.0, 1.0, 0.0), origin=(100.0, 0.0, 400.0)),
    "J3": make_axis("J3", kind="rotary", direction=(0.0, 0.6, 0.8), origin=(300.0, 50.0, 400.0)),
}
MASSES = {  # of each body (place from its origin in m, kg)
    "J1": [((0.1, 0.2, 0.3), 3.0)],
    "J2": [((0.02, 0.05, -0.03), 2.0), ((0.1, 0.0, 0.2), 1.5)],
    "J3": [((0.3, 0.02, 0.1), 1.0)],
}
SIDES = {"w b X J1 Y J2 J3 t": 1.0, "w J3' J2' Y' J1' X' b t": -1.0}
"""Structures, and the sign of a coordinate in them."""


def moving(structure: str, axis: str, names: tuple[str, ...] = ORDER, rows: int = 2001) -> Campaign:
    """The drive force of one axis while some axes move."""
    machine = Machine(name="arm", structure=Structure.parse(structure), axes=AXES, errors={})
    time = np.linspace(0.0, 5.0 * np.pi, rows)  # it ends at rest
    commands = {name: way(ORDER.index(name), time) * (name in names) for name in ORDER}
    run = Run(id="f", instrument=("drive_force",), sampling="dynamic", time=time, commands=commands, noise_um=0.02,
              options={"axis": axis, "between": "curve"})  # fmt: skip
    return Campaign(machine=machine, runs=(run,))


def way(number: int, time: np.ndarray) -> np.ndarray:
    """Motion of the axis of this number, mm or degree, from rest to rest."""
    return 30.0 * np.sin((1.0 + 0.2 * number) * time) ** 3


def place(body: str, point: np.ndarray, position: dict[str, float]) -> np.ndarray:
    """A point of a body in the machine frame, m, by its own chain of turns and shifts."""
    at = np.array(AXES[body].origin) * 1e-3 + point
    for name in reversed(ORDER[: ORDER.index(body) + 1]):
        direction, origin = np.array(AXES[name].direction), np.array(AXES[name].origin) * 1e-3
        if AXES[name].rotary:
            arm, (c, s) = at - origin, (np.cos(position[name]), np.sin(position[name]))
            at = origin + c * arm + s * np.cross(direction, arm) + (1.0 - c) * direction * (direction @ arm)
        else:
            at = at + direction * position[name]
    return at


def newton(axis: str, sign: float, t: float, h: float = 1e-3) -> float:
    """Force on the drive of the axis by the masses, less what the same masses in the origins of their bodies would add."""

    def position(at: float) -> dict[str, float]:
        scale = {name: np.pi / 180.0 if AXES[name].rotary else 1e-3 for name in ORDER}
        return {name: sign * scale[name] * float(way(n, np.array(at))) for n, name in enumerate(ORDER)}

    before, here, after = position(t - h), position(t), position(t + h)
    step = 1e-6 * sign
    ahead, behind = here | {axis: here[axis] + step}, here | {axis: here[axis] - step}
    total = 0.0
    for body, masses in MASSES.items():
        if ORDER.index(body) < ORDER.index(axis):
            continue
        for point, mass in [(p, m) for p, m in masses] + [((0.0, 0.0, 0.0), -m) for _, m in masses]:
            x = np.array(point)
            acceleration = (place(body, x, after) - 2.0 * place(body, x, here) + place(body, x, before)) / h**2
            slope = (place(body, x, ahead) - place(body, x, behind)) / 2e-6
            total += mass * float(acceleration @ slope)
    return total


@pytest.mark.parametrize("structure", SIDES)
@pytest.mark.parametrize(
    "axis", [axis if axis in ("X", "J1") else pytest.param(axis, marks=pytest.mark.slow) for axis in ORDER]
)
def test_force_is_that_of_point_masses(structure: str, axis: str) -> None:
    plan = moving(structure, axis)
    model = Model(plan, [make_effect("load_inertia", axis)])
    names = [p.name for p in model.effects[0].parameters(plan)]
    each = [model.contribution(model.effects[0], model.vector({name: 1.0}))["f"][:, 0] for name in names]
    rows = np.arange(20, 1980, 35)
    table = np.stack(each, axis=1)[rows]
    expected = np.array([newton(axis, SIDES[structure], plan.runs[0].time[row]) for row in rows])
    assert len(names) < len(rows) / 3
    by_any = table @ np.linalg.lstsq(table, expected, rcond=None)[0]
    np.testing.assert_allclose(by_any, expected, atol=2e-3 * np.abs(expected).max())
    assert_exact(model, names)


def test_it_needs_another_axis_that_turns() -> None:
    with pytest.raises(InputError, match="no other rotary axis of its chain moves"):
        make_effect("load_inertia", "J2").prepare(moving("w b X J1 Y J2 J3 t", "J2", ("J2", "X")))
    turntable = Machine(
        name="t", structure=Structure.parse("w b J1 X t"), axes={k: AXES[k] for k in ("J1", "X")}, errors={}
    )
    (run,) = moving("w b X J1 Y J2 J3 t", "X").runs
    commands = {name: run.commands[name] for name in ("J1", "X")}
    with pytest.raises(InputError, match="no other rotary axis of its chain moves"):  # X carries none
        make_effect("load_inertia", "X").prepare(Campaign(machine=turntable, runs=(replace(run, commands=commands),)))
    with pytest.raises(InputError, match="no run records the drive force of J1"):
        make_effect("load_inertia", "J1").prepare(moving("w b X J1 Y J2 J3 t", "J2"))


@pytest.mark.slow
def test_the_inertia_of_the_load_is_named_where_the_other_axes_turn() -> None:
    """A drive's torque while the arm that it carries folds and unfolds; alone the axis has one inertia."""
    plan = moving("w b X J1 Y J2 J3 t", "J1", rows=601)
    (run,) = plan.runs
    rate = 1.2  # of J1: d/dt and d²/dt² of sin³
    s, c = np.sin(rate * run.time), np.cos(rate * run.time)
    speed, acceleration = (
        np.radians(30.0) * 3.0 * rate * s**2 * c,
        np.radians(30.0) * 3.0 * rate**2 * (2.0 * s * c**2 - s**3),
    )
    load = np.array([newton("J1", 1.0, t) for t in run.time])
    plain = acceleration + 0.5 * speed + 0.2 * np.clip(speed / np.radians(0.1), -1.0, 1.0)
    noise = np.random.default_rng(3).normal(0.0, 0.02, run.rows)
    found = diagnose(replace(plan, runs=(replace(run, readings={"J1_torque_Nm": plain + load + noise}),)))
    assert [(f.name, f.axis) for f in found.findings] == [("load_inertia", "J1")]
    assert found.findings[0].confidence > 0.9 and found.findings[0].parameters["amplitude"].unit == "Nm"
    size = found.findings[0].parameters["amplitude"]
    assert abs(size.value - np.sqrt(np.mean(load**2))) < 3.0 * size.std + 0.05 * size.value
    assert found.fit.rms_after_um < 1.1 * 0.02 < 0.3 * found.fit.rms_before_um
