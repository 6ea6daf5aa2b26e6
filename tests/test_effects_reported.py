"""Sizes of effects with their uncertainty, their words, signatures and files."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from effects_world import CASES, around, campaign, every_case, model_of, polar
from laser_world import laser_run

from symfive.campaign import Campaign, Run, read_campaign
from symfive.effects import EFFECTS, VOCABULARY, Quantity, form_words, make_effect
from symfive.errors import InputError
from symfive.identify import identify
from symfive.machine import Machine, Structure, make_axis
from symfive.model import Model, effect_to_data, effects_from_data, signature
from symfive.report import identification_text
from symfive.report.signature import plot_signature
from symfive.simulate import simulate


@every_case
def test_described_and_written(number: int) -> None:
    """Every report is finite JSON in the vocabulary's words; an effect survives model.json."""
    model = model_of(number)
    effect = model.effects[-1]
    covariance = {(p.name, p.name): (0.1 * p.sigma) ** 2 for p in model.parameters}
    values = dict(zip(model.index, around(model), strict=True))
    found = {name: vars(quantity) for name, quantity in effect.describe(model.campaign, values, covariance).items()}
    assert json.dumps(found, allow_nan=False)
    chosen = {"direction"} if effect.id in ("spindle_growth", "table_growth") else set(vars(effect))  # not estimated
    for name, entry in found.items():
        numbers = np.ravel(entry["value"]).dtype.kind in "if"
        assert not numbers or name in chosen or entry["std"] is not None, name
    assert effect.vocabulary in VOCABULARY and effect.says and effect.hidden_by and effect.action
    again = effects_from_data(json.loads(json.dumps([effect_to_data(effect)])), "model.json")
    assert again == (effect,)


@pytest.mark.parametrize("name", EFFECTS)
def test_nothing_is_hidden_by_what_it_is_reported_as(name: str) -> None:
    """`friction of axis Y, hidden by friction` helps nobody: another effect of the same word needs words of its own."""
    effect = EFFECTS[name]
    word = (effect.reported_as or effect.id).replace("_", " ")
    assert word not in re.split(r"[;,] | and | \(", effect.hidden_by)


def test_a_tone_names_the_frequencies_that_read_the_same() -> None:
    """Rows at even times do not separate f from those mirrored at the sampling rate; at uneven times they do."""
    plan = campaign("planar")
    effect = make_effect("vibration", frequency_hz=3.0, phases="run", directions="x")
    model = Model(plan, (effect,))
    named = model.named(model.start) | {p.name: 1.0 for p in model.parameters if p.name.endswith((".sin", ".cos"))}
    (run, *_) = plan.runs

    def read(frequency: float, *parts: str) -> np.ndarray:
        sizes = {n: v * (n.rpartition(".")[2] in parts or not n.endswith((".sin", ".cos"))) for n, v in named.items()}
        return model.contribution(effect, sizes | {f"{effect.key}.frequency_hz": frequency})[run.id].ravel()

    values = {name: float(value) for name, value in named.items()}
    aliases = effect.describe(plan, values, {})["alias_frequencies_hz"].value
    assert isinstance(aliases, tuple) and aliases == pytest.approx((1.0 / run.interval - 3.0, 1.0 / run.interval + 3.0))
    for alias in aliases:
        pair = np.stack([read(alias, "sin"), read(alias, "cos")], axis=1)
        left = read(3.0, "sin", "cos") - pair @ np.linalg.lstsq(pair, read(3.0, "sin", "cos"))[0]
        assert np.abs(left).max() < 1e-4  # µm of 1; the clock is written to a microsecond
    rng = np.random.default_rng(1)
    runs = [replace(r, time=np.sort(rng.uniform(r.time[0], r.time[-1], r.rows))) for r in plan.runs]
    assert "alias_frequencies_hz" not in effect.describe(replace(plan, runs=tuple(runs)), values, {})


def test_a_period_names_those_that_read_the_same() -> None:
    """Even targets do not separate 1/period from those mirrored at 1/step: of 120 teeth every 5° they read 24; uneven ones do."""
    targets = np.arange(-5.0, 360.0, 5.0)
    machine = Machine(name="table", structure=Structure.parse("w C' b t"), axes={"C": make_axis("C")})
    run = laser_run("polygon", targets, axis="C")
    plan = Campaign(machine=machine, runs=(run,))
    effect = make_effect("transmission_error", "C", period=15.0)
    values = {f"{effect.key}.{n}": v for n, v in {"sin": 1.0, "cos": 0.5, "period": 15.0}.items()}
    aliases = effect.describe(plan, values, {})["alias_periods"].value
    assert aliases == pytest.approx((7.5, 3.75, 3.0, 360.0 / 168.0))
    angle = 2.0 * np.pi * targets
    read = np.sin(angle / 15.0) + 0.5 * np.cos(angle / 15.0)
    for alias in aliases:
        pair = np.stack([np.sin(angle / alias), np.cos(angle / alias)], axis=1)
        assert np.abs(read - pair @ np.linalg.lstsq(pair, read)[0]).max() < 1e-9
    uneven = replace(run, commands={"C": targets + np.random.default_rng(1).uniform(-1.0, 1.0, len(targets))})
    assert "alias_periods" not in effect.describe(replace(plan, runs=(uneven,)), values, {})


def test_amplitude_and_phase_are_reported_with_their_uncertainty() -> None:
    plan = campaign("planar")
    effect = make_effect("transmission_error", "X", period=10.0)
    values = {f"{effect.key}.{n}": v for n, v in (polar(3.0, 2.9, "sin", "cos") | {"period": 10.0}).items()}
    names = [f"{effect.key}.sin", f"{effect.key}.cos"]
    matrix = np.array([[0.04, 0.01], [0.01, 0.09]])
    covariance = {(a, b): matrix[i, j] for i, a in enumerate(names) for j, b in enumerate(names) if i <= j}
    found = effect.describe(plan, values, covariance)
    along_it = np.array([math.cos(2.9), math.sin(2.9)])
    assert found["amplitude"].value == pytest.approx(3.0) and found["phase"].value == pytest.approx(2.9)
    assert found["amplitude"].std == pytest.approx(math.sqrt(along_it @ matrix @ along_it), rel=1e-6)
    assert found["phase"].std == pytest.approx(
        math.sqrt(along_it[::-1] * (-1, 1) @ matrix @ (along_it[::-1] * (-1, 1))) / 3.0
    )
    assert (found["period"].unit, found["amplitude"].unit, found["phase"].unit) == ("mm", "um", "rad")


def test_an_instrument_has_the_columns_of_its_own_run() -> None:
    """Beside a ball bar, whose run has neither the axis of a laser nor sensors, nothing may ask that run for them."""
    circle = campaign("planar").runs[0]
    sensors = [{"direction": list(e), "position": [0.0, 0.0, 0.0]} for e in np.eye(3)]
    rest = {
        "time": np.arange(3.0),
        "commands": {name: q[:3] for name, q in circle.commands.items()},
        "sampling": "static",
    }
    beside = (
        Run(id="line", instrument=("laser",), options={"axis": "X"}, **rest),
        Run(id="ball", instrument=("displacement",), options={"sensors": sensors}, **rest),
    )
    plan = replace(campaign("planar"), runs=(circle, *beside))
    assert forms_of_a_sensor(plan) == [
        ("sensor_error", "matrix", "displacement"),
        ("sensor_error.gain", "gain", "r_test"),
    ]


def test_each_instrument_of_several_columns_may_have_a_cross_sensitivity() -> None:
    """An instrument of an earlier letter does not hide that of the R-test."""
    nest = campaign("static").runs[0]
    plate = replace(
        nest, id="plate", file="plate.csv", instrument=("grid_encoder",), u=(1.0, 0.0, 0.0), v=(0.0, 1.0, 0.0)
    )
    plan = replace(campaign("static"), runs=(nest, plate))
    *matrices, _ = forms_of_a_sensor(plan)
    assert matrices == [(f"sensor_error.{name}", "matrix", name) for name in ("grid_encoder", "r_test")]
    effects = [form.effect for form in EFFECTS["sensor_error"].candidates(plan)]
    model = Model(plan, effects[:2])
    names = [f"sensor_error.{name}.matrix.12" for name in ("grid_encoder", "r_test")]
    assert set(names) <= set(model.index)


def forms_of_a_sensor(plan: Campaign) -> list[tuple[str, str, str]]:
    effects = [form.effect for form in EFFECTS["sensor_error"].candidates(plan)]
    return [(effect.key, effect.shape, effect.instrument) for effect in effects]


def test_vocabulary_is_that_of_the_conventions() -> None:
    page = (Path(__file__).parent.parent / "docs/conventions.md").read_text(encoding="utf-8")
    section = page.partition("\n## 7. ")[2].partition("\n## ")[0]
    assert set(VOCABULARY) == set(re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE))
    others = {"force_friction", "force_delay", "force_ripple", "force_vibration", "gravity_torque", "held_friction"}
    others |= {"varying", "following_lag", "load_inertia"}  # of axes without a drive, of an arm: tests of their own
    assert {case.effect for case in CASES} | others == set(EFFECTS)


def test_a_play_is_said_as_it_acts() -> None:
    """A shop reads in one line whether the play grows along its axis, and whether a carriage shifts or tilts."""
    sizes = {"width": Quantity(6.0, 0.1, "um"), "slope": Quantity(0.03, 0.001, "um/mm")}
    grown, mended = make_effect("backlash", "X", shape="wind_up").advice(sizes)
    plain = make_effect("backlash", "X").advice({"width": sizes["width"]})
    assert "unequal backlash" in grown and mended != plain[1]
    level = {**sizes, "slope": Quantity(0.002, 0.005, "um/mm")}
    assert make_effect("backlash", "X", shape="wind_up").advice(level) == plain
    assert "sideways" in make_effect("lateral_play", component="EYX").advice(sizes)[0]
    assert "tilts" in make_effect("lateral_play", component="EBX").advice(sizes)[0]


def test_a_positioning_error_sends_to_the_measuring_system_of_its_axis() -> None:
    """A service engineer does not take a table apart for an encoder that is mounted off its axis."""
    checks = {
        symbol: make_effect("error_motion", component=symbol).advice({})[1] for symbol in ("ECC", "EXC", "EXX", "EYX")
    }
    assert "encoder" in checks["ECC"] and "bearing" not in checks["ECC"]
    assert "scale" in checks["EXX"] and "guideway" not in checks["EXX"]
    assert "bearing" in checks["EXC"] and "guideway" not in checks["EXC"]
    assert "guideway" in checks["EYX"] and "encoder" not in checks["EYX"]


def test_signature_is_drawn() -> None:
    figure = plot_signature(make_effect("backlash", "X"), campaign("planar"), {"width": 12.0})
    assert len(figure.axes) == 2 and figure.axes[0].lines
    with pytest.raises(InputError, match='no parameter "depth"'):
        signature(make_effect("backlash", "X"), campaign("planar"), {"depth": 12.0})


def test_a_drift_says_how_far_it_went_where_amplitude_and_time_constant_are_known_only_together():
    """Of a rise that has just begun only amplitude/τ is known."""
    plan = campaign("static")
    drift = make_effect("thermal_drift").prepare(plan)
    end = drift.clock_span(plan)
    names = [f"thermal_drift.{name}" for name in ("amplitude.x", "amplitude.y", "amplitude.z", "time_constant_s")]
    values = dict(zip(names, (30.0, 40.0, 0.0, 1e3 * end), strict=True))
    together = {(a, b): 0.81 * values[a] * values[b] for a in names for b in names}
    said = drift.describe(plan, values, together)
    assert said["amplitude"].value == pytest.approx(50.0) and said["amplitude"].std == pytest.approx(45.0)
    assert said["reached"].value == pytest.approx(0.05, rel=1e-3) and said["reached"].std < 1e-4
    assert said["reached"].unit == "um"


def test_a_component_that_is_not_seen_is_in_the_uncertainty_of_an_amplitude():
    """A circle in XY sees nothing of z: its prior's 1σ is all that is known, and to first order it adds nothing."""
    plan = campaign("planar")
    drift = make_effect("thermal_drift").prepare(plan)
    names = [f"thermal_drift.{name}" for name in ("amplitude.x", "amplitude.y", "amplitude.z", "time_constant_s")]
    values = dict(zip(names, (3.0, 4.0, 0.0, 100.0), strict=True))
    known = {(name, name): 0.01 for name in names[:2]}
    assert drift.describe(plan, values, known)["amplitude"].std == pytest.approx(0.1, rel=0.01)
    unseen = {**known, (names[2], names[2]): 25.0}
    assert drift.describe(plan, values, unseen)["amplitude"].std == pytest.approx(2.89, rel=0.01)


def test_the_size_of_a_term_without_a_name_is_that_of_its_readings():
    """Also where the axis rests in a run: there it came from no side."""
    plan = campaign("static")
    still = replace(plan.runs[1], commands=plan.runs[1].commands | {"B": np.zeros(plan.runs[1].rows)})
    plan = replace(plan, runs=(plan.runs[0], still))
    term = make_effect("unknown", over=("B velocity sign",), basis="polynomial", order=1, directions="y").prepare(plan)
    values = {p.name: 4.0 for p in term.parameters(plan)}
    first = {r.id: next(float(np.sign(s)) for s in np.diff(r.commands["B"]) if abs(s) > 1e-9) for r in plan.runs[:1]}
    sides = {p.name: first[run.id] for run in plan.runs[:1] for p in term.starts(run)}
    moved = np.concatenate(list(Model(plan, [term]).contribution(term, values | sides).values()))
    size = term.describe(plan, values, {(name, name): 1.0 for name in values})["rms"].value
    assert size == pytest.approx(float(np.sqrt(np.mean(np.sum(moved**2, axis=1)))), rel=1e-6)
    assert size < 3.9


def test_the_part_of_an_amplitude_that_is_seen_is_said_by_itself():
    plan = campaign("planar")
    compliance = make_effect("inertial_compliance", "X").prepare(plan)
    names = [f"inertial_compliance.X.compliance.{c}" for c in "xyz"]
    values = dict(zip(names, (3.0, 4.0, 1.0), strict=True))
    known = {(name, name): 0.01 for name in names}
    assert "seen" not in compliance.describe(plan, values, known)
    seen = compliance.describe(plan, values, {**known, (names[2], names[2]): 25.0})["seen"]
    assert (seen.value, seen.std) == (pytest.approx(5.0), pytest.approx(0.1)) and seen.unit == "um/(m/s^2)"


def test_the_size_of_a_term_without_a_name_is_what_the_readings_determine():
    """A direction of its amplitudes that they leave to the prior adds neither size nor doubt."""
    clean = read_campaign(Path(__file__).parent / "data" / "campaigns" / "static-none" / "fit")
    term = make_effect("unknown", over=("t",), order=4, directions="x").prepare(clean)
    parameters = term.parameters(clean)
    names, sigma = [p.name for p in parameters], np.array([p.sigma for p in parameters])
    seen = np.eye(len(names))[0]
    spread = np.outer(sigma, sigma) * (np.eye(len(names)) - 0.9996 * np.outer(seen, seen))
    pairs = {(a, b): spread[i, j] for i, a in enumerate(names) for j, b in enumerate(names)}
    exact = dict.fromkeys(names, 0.0) | {names[0]: sigma[0]}
    vague = {n: 0.3 * s for n, s in zip(names, sigma, strict=True)} | {names[0]: sigma[0]}
    wanted, found = (term.describe(clean, values, pairs)["rms"] for values in (exact, vague))
    assert found.value == pytest.approx(wanted.value) and found.std == pytest.approx(0.02 * found.value)


def test_a_way_since_reversal_is_also_that_of_an_axis_that_only_goes_back() -> None:
    """Its span ended at zero, and the table of its functions was divided by it."""
    plan = campaign("planar")
    run = plan.runs[0]
    back = replace(run, commands={**run.commands, "X": np.linspace(50.0, -50.0, run.rows)})
    plan = replace(plan, runs=(back,))
    effect = make_effect("unknown", over=("X since reversal",)).prepare(plan)
    assert effect.span == ((-100.0, 100.0),)
    assert np.isfinite(effect.table(plan.machine, plan.runs)).all()


@every_case
def test_every_parameter_says_what_it_is_in_words(number: int) -> None:
    """No raw name is left, two parameters of a model are never called alike, and a key says the same as the parameter."""
    model = model_of(number)
    said = [p.words for p in model.parameters]
    assert len(set(said)) == len(said)
    for p in model.parameters:
        assert p.kind == "location_error" or not re.search(r"_|\.(?! )|\b(sin|cos|P|S)\d", p.words), p.words
        assert p.kind != "effect" or p.of_setup or p.what == form_words(p.name, model.machine)


def test_a_letter_has_no_raw_name_and_a_wave_has_amplitude_and_phase() -> None:
    """`load_moment.Y.w.X` stood in letters, and sine and cosine coefficients where a person reads a periodic error."""
    motion = make_effect("error_motion", component="EAC", basis="fourier", order=2)
    effects = [make_effect("load_moment", "Y"), motion, make_effect("unknown", over=("B",))]
    truth = {"error_motion.EAC.sin2": 30.0, "error_motion.EAC.cos2": 40.0}
    measured = simulate(campaign("static"), effects=effects, truth=truth, seed=1)
    found = identify(Model(measured.campaign, effects))
    text = identification_text(found)
    assert not re.search(r"\w_\w|[A-Za-z0-9]\.[A-Za-z]|\b(sin|cos|P|S)\d", text), text
    size, phase = (
        re.search(rf"^ *(\S+) +\S+ +\S+ .*\(EAC, {what} of order 2\)", text, re.M) for what in ("amplitude", "phase")
    )
    assert float(size[1]) == pytest.approx(50.0, abs=2.0) and float(phase[1]) == pytest.approx(53.13, abs=2.0)
    said = motion.describe(measured.campaign, found.named, {})
    assert said["sin2"].aside and said["phase2"].said.value == pytest.approx(math.degrees(said["phase2"].value))
