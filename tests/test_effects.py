"""Effects: exact sensitivities, plain formulas, the independent plant, what they leave alone, how they are reported."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import plant
import pytest
from effects_world import (
    CASES,
    START,
    Case,
    assert_exact,
    baseline,
    campaign,
    every_case,
    model_of,
    own,
    plants,
    tilt,
)
from scipy.spatial.transform import Rotation

from symfive.campaign import Campaign, Run
from symfive.effects import EFFECTS, make_effect
from symfive.errors import InputError
from symfive.machine import Machine, Structure, machine_from_data, make_axis
from symfive.model import Model, signature
from symfive.motion import PreSliding, ReversalDistance, ReversalTime, RunMotion


@every_case
def test_sensitivities_are_exact(number: int) -> None:
    model = model_of(number)
    effect, runs = model.effects[-1], [run for run in model.campaign.runs if model.effects[0].applies(run)]
    names = [p.name for p in (*effect.parameters(model.campaign), *effect.starts(runs[0]))]
    assert_exact(model, names, events=0.01)


@every_case
def test_at_zero_size_nothing_changes(number: int) -> None:
    case, model = CASES[number], model_of(number)
    zero = model.predict({p.name: p.mean for p in model.effects[-1].parameters(model.campaign)})
    for run, readings in baseline(case.where).predict({}).items():
        np.testing.assert_allclose(zero[run], readings, rtol=0, atol=1e-8)


@pytest.mark.parametrize("case", [case for case in CASES if case.plant is not None], ids=str)
def test_plant_agrees(case: Case) -> None:
    model = model_of(CASES.index(case))
    machine, runs = plants()[case.where]
    spec = {"effect": case.effect, "axis": case.axis} | (case.plant or {})
    shift = {p: 40.0 for p in ("EX0C", "EA0C") if p in machine["errors"]}
    values, told = own(model, case.sizes) | shift, {run["id"]: dict(spec) for run in runs}
    for run in runs:
        sides = model.effects[-1].starts(model.campaign.run(run["id"]))
        if spec.get("start") == START or (sides and case.where == "static"):
            steps = np.diff(run["command"][spec["axis"] or spec["component"][2:]])
            first = float(np.sign(steps[np.abs(steps) > 1e-6][0]))
            if "start" in spec:
                told[run["id"]]["start"] = first
            values |= {p.name: first for p in sides}  # the plant's static axes count as they first go
    predicted = model.predict(values)
    for run in runs:
        truth = plant.simulate_run(machine, run, shift, effects=[told[run["id"]]], noise_options=plant.QUIET).values
        wrong = np.abs(truth - predicted[run["id"]]).max(axis=1)
        assert np.mean(wrong > case.agree) <= case.rows, wrong.max()


@pytest.mark.parametrize("case", [c for c in CASES if EFFECTS[c.effect].dynamic_only], ids=str)
def test_dynamic_effects_rest_in_static_runs(case: Case) -> None:
    still = campaign(case.where)
    still = replace(still, runs=tuple(replace(run, sampling="static") for run in still.runs))
    model = Model(still, [case.make()])
    sized = model.predict(model.effects[-1].typical(still))
    for run, readings in Model(still).predict({}).items():
        np.testing.assert_array_equal(sized[run], readings)


FORMULAS = {
    "scale_error": ("Y", {}, {"ppm": 30.0}, lambda run: (30e-6 * run.commands["Y"] * 1e3, (0, 1, 0))),
    "transmission_error": ("Y", {"period": 40.0}, {"sin": 3.0, "cos": 4.0},
        lambda run: (5.0 * np.sin(2.0 * np.pi * run.commands["Y"] / 40.0 + math.atan2(4.0, 3.0)), (0, 1, 0))),
    "thermal_drift": (None, {}, {"amplitude.z": 20.0, "time_constant_s": 300.0},
        lambda run: (20.0 * (1.0 - np.exp(-(run.start_s + run.time) / 300.0)), (0, 0, 1))),
    "lateral_play": (None, {"component": "EZX"}, {"width": 10.0},
        lambda run: (-5.0 * came_from(run.commands["X"]), (0, 0, 1))),
    "backlash": ("Z", {}, {"width": 10.0}, lambda run: (-5.0 * came_from(run.commands["Z"]), (0, 0, 1))),
    "table_step": ("Y", {"at": 20.0, "ramp": 1e-6}, {"height": 7.0},
        lambda run: (7.0 * (run.commands["Y"] > 20.0), (0, 1, 0))),
    "gravity_sag": ("B", {"component": "EZB"}, {"sin": 6.0, "one_minus_cos": 2.0},
        lambda run: (-6.0 * np.sin(tilt(run)) - 2.0 * (1.0 - np.cos(tilt(run))), (0, 0, 1))),
}  # fmt: skip


def came_from(command: np.ndarray) -> np.ndarray:
    """By the moves; before the first one between the flanks, but for a single first row, which counts like the second."""
    signs = np.zeros(len(command))
    for k in range(1, len(command)):
        step = command[k] - command[k - 1]
        signs[k] = np.sign(step) if abs(step) > 1e-9 else signs[k - 1]
    begins = np.flatnonzero(signs)[0]
    if begins == 1:
        signs[0] = signs[1]
    return signs


@pytest.mark.parametrize("name", FORMULAS)
def test_plain_formulas(name: str) -> None:
    """R-test readings by hand: a shift e of the tool in the machine frame reads Rᵀ·e at the turned table."""
    axis, options, sizes, formula = FORMULAS[name]
    plan = campaign("static")
    change = signature(make_effect(name, axis, **options), plan, zero_but(name, axis, options, sizes))
    for run in plan.runs:
        value, direction = formula(run)
        pairs = zip(tilt(run), np.deg2rad(run.commands["C"]), strict=True)
        turned = [Rotation.from_euler("YZ", [-b, -c]).as_matrix() for b, c in pairs]
        wanted = np.stack([r.T @ np.asarray(direction) for r in turned]) * value[:, None]
        np.testing.assert_allclose(change[run.id], wanted, rtol=0, atol=2e-6 * max(1.0, np.abs(value).max()))


def zero_but(name: str, axis: str | None, options: dict[str, Any], sizes: dict[str, float]) -> dict[str, float]:
    effect = Model(campaign("static"), [make_effect(name, axis, **options)]).effects[-1]
    means = {p.name.removeprefix(effect.key + "."): p.mean for p in effect.parameters(campaign("static"))}
    return means | sizes


@pytest.mark.parametrize("code", ["w C' B' X' Y' b Z t", "w C' X' Y' b Z B t"])
@pytest.mark.parametrize("direction", [(0.0, 1.0, 0.0), (0.0, 1.0, 1.0), (1.0, 2.0, -0.5)])
def test_gravity_turns_in_the_tilted_frame(code: str, direction: tuple[float, float, float]) -> None:
    """Against gravity turned by a numerical rotation about the axis' own direction, on either side of the machine."""
    axes: dict[str, Any] = {n: {} for n in "CXYZ"} | {"B": {"direction": list(direction)}}
    machine = machine_from_data({"schema": "symfive.machine/1", "structure": code, "axes": axes})
    poses = np.array([0.0, 20.0, 50.0, -70.0])
    commands = {n: np.zeros(4) for n in "CXYZ"} | {"B": poses}
    plan = replace(campaign("static"), machine=machine)
    runs = (replace(plan.runs[0], time=np.arange(4.0), commands=commands, readings={}, tool_ball=(0.0, 0.0, -100.0)),)
    plan = replace(plan, runs=runs)
    unit, down = np.asarray(direction) / np.linalg.norm(direction), np.array([0.0, 0.0, -1.0])
    sign = -1.0 if "B'" in code else 1.0
    across = -sign * np.cross(unit, down)
    change = [Rotation.from_rotvec(sign * q * unit).inv().apply(down) - down for q in np.deg2rad(poses)]
    wanted = np.array(change) @ (across / np.linalg.norm(across))
    got = signature(make_effect("gravity_sag", "B", component="EZB"), plan, {"sin": 8.0, "one_minus_cos": 0.0})
    moved = got[runs[0].id]
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 8.0 * np.abs(wanted), rtol=0, atol=1e-6)
    if sign > 0.0:
        np.testing.assert_allclose(moved[:, 2], 8.0 * wanted, rtol=0, atol=1e-6)
    sine = np.linalg.norm(across)
    np.testing.assert_allclose(wanted, sine * np.sin(np.deg2rad(poses)), rtol=0, atol=1e-12)
    said = make_effect("gravity_sag", "B", component="EZB").describe(
        plan, {"gravity_sag.B.EZB.sin": 8.0, "gravity_sag.B.EZB.one_minus_cos": 0.0}, {}
    )
    assert said["amplitude"].value == pytest.approx(8.0 * sine)  # what it moves at sin q = 1


@pytest.mark.parametrize("slip", [0.0, 1e-9, 2.9e-4, 0.1, 1.0])
@pytest.mark.parametrize("axis", ["B", "C"])
def test_a_sag_is_no_larger_than_gravity_turns_in_its_frame(axis: str, slip: float) -> None:
    """However near an axis is to the vertical, alone or on a tilting one: 1 g turned over is a change by 2."""
    axes: dict[str, Any] = {n: {} for n in "CXYZB"}
    axes[axis] = {"direction": [0.0, slip, 1.0]}
    machine = machine_from_data({"schema": "symfive.machine/1", "structure": "w C' B' X' Y' b Z t", "axes": axes})
    generator = np.random.default_rng(1)
    commands = {n: np.zeros(50) for n in "XYZ"} | {n: generator.uniform(-180.0, 180.0, 50) for n in "BC"}
    plan = campaign("static")
    run = replace(plan.runs[0], time=np.arange(50.0), commands=commands, readings={}, tool_ball=(0.0, 0.0, -100.0))
    plan = replace(plan, machine=machine, runs=(run,))
    if axis == "B" and slip < 1e-8:  # vertical, to rounding
        with pytest.raises(InputError, match="gravity does not turn"):
            make_effect("gravity_sag", "B", component="EZB").prepare(plan)
        return
    moved = signature(make_effect("gravity_sag", axis, component=f"EZ{axis}"), plan, {"sin": 8.0, "one_minus_cos": 0.0})
    turns = 2.0 if axis == "C" else 2.0 * slip / math.hypot(slip, 1.0)
    assert 0.1 * turns * 8.0 < np.linalg.norm(moved[run.id], axis=1).max() <= turns * 8.0 + 1e-6


def test_pre_sliding_after_a_reversal_is_the_catalogue_s_formula() -> None:
    plan = campaign("static")
    way = np.concatenate([np.linspace(0.0, 5.0, 60), np.linspace(5.0, 3.0, 200)])
    commands = {name: np.zeros(len(way)) for name in plan.machine.axis_names} | {"X": way}
    run = replace(plan.runs[0], time=np.arange(len(way), dtype=float), commands=commands)
    motion = RunMotion(run, plan.machine, {}, {"distance": 0.2})
    state = PreSliding("X", "distance").series(motion).value
    after = 5.0 - way[60:]
    np.testing.assert_allclose(state[:60], 1.0)
    np.testing.assert_allclose(state[60:], -(1.0 - 2.0 * np.exp(-after / 0.2)), atol=1e-12)


def test_a_recording_that_begins_in_motion_knows_where_its_axis_turned_just_before() -> None:
    """A polar trace begins where the axis has just turned: the first spike of its circle was there without a cause."""
    plan = campaign("planar")
    time = 0.02 * np.arange(400.0)
    way = {name: np.zeros(len(time)) for name in plan.machine.axis_names}
    way |= {"X": 50.0 * np.cos(0.4 * time), "Y": 50.0 * np.sin(0.4 * time)}
    whole = replace(plan.runs[0], time=time, commands=way, options={**plan.runs[0].options, "start": "moving"})
    before = replace(whole, time=time - 1.0, commands=way | {"X": 50.0 * np.cos(0.4 * (time - 1.0))})
    late = replace(whole, time=time, commands=way | {"X": 50.0 * np.cos(0.4 * (time + 0.1))})
    for signal in (ReversalTime("X"), ReversalDistance("X")):
        known = signal.series(RunMotion(before, plan.machine, {}, {})).value
        np.testing.assert_allclose(
            signal.series(RunMotion(late, plan.machine, {}, {})).value[:100], known[55:155], atol=2e-4
        )
    still = replace(late, options={**late.options, "start": "rest"})
    assert ReversalTime("X").series(RunMotion(still, plan.machine, {}, {})).value[0] > 1e3


REFUSED = [
    ("static", "location_error", None, {"component": "EX0C"}, "already varies EX0C"),
    ("static", "location_error", None, {"component": "EX0Y"}, "no position of its own"),
    ("planar", "scale_error", "X", {}, "already varies the scale"),
    ("planar", "error_motion", None, {"component": "EXX", "basis": "polynomial", "order": 1}, "already holds EXX"),
    ("planar", "error_motion", None, {"component": "EXX", "basis": "bspline", "order": 4}, "holds EXX as polynomial"),
    ("static", "gravity_sag", "Y", {"component": "EZB"}, "does not tilt"),
    ("planar", "gravity_sag", "X", {"component": "EZA"}, "does not tilt"),
    ("static", "friction", "X", {}, "needs the drive"),
    ("static", "backlash", None, {}, "belongs to an axis"),
    ("static", "backlash", "Q", {}, "the machine lacks"),
    ("static", "backlash", "C", {"shape": "round"}, "shape 'round' is unknown"),
    ("static", "transmission_error", "C", {}, "needs its period"),
    ("static", "lateral_play", None, {"component": "EXX"}, "lies along the motion"),
    ("static", "setup_shift", None, {"run": "n1", "t_s": -5.0}, "outside the run"),
    ("static", "table_step", "C", {"at": 1000.0, "ramp": 20.0, "shape": "late"}, "nothing was read beyond the step"),
    ("static", "unknown", None, {"over": ("speed",)}, "is unknown"),
    ("static", "unknown", None, {"over": ("B",), "carrier": "C", "directions": "xa"}, "needs coordinates and directions"),
    ("planar", "unknown", None, {"over": ("Z",)}, "does not move"),
    ("static", "unknown", None, {"over": ("B",), "carrier": "Q"}, "no axis Q carries it"),
    ("static", "unknown", None, {"over": ("B",), "carrier": "C", "place": "axis"}, "no axis C carries it"),
]  # fmt: skip


@pytest.mark.parametrize(("where", "name", "axis", "options", "message"), REFUSED)
def test_refused_with_one_sentence(
    where: str, name: str, axis: str | None, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Model(campaign(where), [make_effect(name, axis, **options)])


def test_a_unit_without_a_scale_is_refused() -> None:
    """Taken as it is, µm per (m/s)² would be wrong by 10⁹."""
    with pytest.raises(InputError, match=r"lift has the unit 'um/\(m/s\)\^2'") as caught:
        make_effect("scale_error", "X").own("lift", "um/(m/s)^2", 1.0)
    assert "um/mm" in str(caught.value.remedy)
    assert make_effect("scale_error", "X").own("lift", "um/mm", 1.0).scale == 1e-3


def test_make_effect_names_what_is_missing() -> None:
    with pytest.raises(InputError, match="needs its option component"):
        make_effect("error_motion")
    with pytest.raises(InputError, match='has no option "size"'):
        make_effect("backlash", "X", size=3.0)


def test_a_column_bends_under_the_reach_of_what_it_carries() -> None:
    """A boom that turns on a column: tilt by the moment of its weight, and by the height of the carriage."""
    axes = {
        "Z": make_axis("Z", travel=(0.0, 1000.0)),
        "C": make_axis("C", kind="rotary", direction=(0.0, 0.0, 1.0), origin=(0.0, 0.0, 0.0)),
    }
    machine = Machine(name="crane", structure=Structure.parse("w b Z C t"), axes=axes, errors={})
    boom, angles, height = (500.0, 0.0, 0.0), np.linspace(0.0, 350.0, 15), 800.0
    run = Run(
        id="f", instrument=("r_test",), sampling="static", time=np.arange(15.0), tool_ball=boom, table_ball=(0.0, 0.0, 0.0),
        commands={"Z": np.full(15, height), "C": angles},
    )  # fmt: skip
    plan = Campaign(machine=machine, runs=(run,))
    model = Model(plan, [make_effect("load_moment", "Z")])
    reach = 0.5 * np.stack([np.cos(np.radians(angles)), np.sin(np.radians(angles))], axis=1)  # m
    for name, turn, shift in (("w", 40.0, 40.0 * 0.8), ("h", 40.0 * 0.8, 0.5 * 40.0 * 0.8**2)):
        change = model.predict({f"load_moment.Z.{name}.tool": 40.0})["f"] - model.predict({})["f"]
        radial = np.sum(change[:, :2] * reach, axis=1) / 0.5
        np.testing.assert_allclose(change[:, 2], -turn * 0.5 * 0.5 * np.ones(15), rtol=1e-3)  # it sinks by tilt × reach
        np.testing.assert_allclose(radial, shift * 0.5, rtol=2e-3)  # and leans out


def test_a_step_on_its_ramp_stays_so_in_runs_that_end_before_it():
    plan = campaign("static")
    late = make_effect("table_step", "C", at=100.0, ramp=20.0, shape="late").prepare(plan)
    run = plan.runs[0]
    ends = int(np.argmax(run.commands["C"] > 100.0))
    few = replace(plan, runs=(run.part(0, ends),))
    assert late.prepare(few).beyond == late.beyond > 0.0
    with pytest.raises(InputError, match="nothing was read beyond the step"):
        make_effect("table_step", "C", at=100.0, ramp=20.0, shape="late").prepare(few)


def test_a_shape_stays_as_it_is_beyond_what_was_recorded():
    """A polynomial of order 8 would be 200 times as large at 1.4 times its span."""
    shape = make_effect("unknown", over=("t",), basis="polynomial", order=5, span=((0.0, 100.0),))
    said = []
    for start in (100.0, 140.0, 5000.0):
        plan = campaign("planar")
        late = replace(plan, runs=tuple(replace(run, start_s=start) for run in plan.runs[:1]))
        effect = shape.prepare(late)
        values = {p.name: 1.0 for p in effect.parameters(late)}
        (readings,) = Model(late, [effect]).predict(values).values()
        said.append(readings - next(iter(Model(late, [effect]).predict({}).values())))
    np.testing.assert_allclose(said[1], said[0], atol=1e-12)
    np.testing.assert_allclose(said[2], said[0], atol=1e-12)
    assert 0.1 < np.abs(said[0]).max() < 100.0
