"""Generated C: equal to the symbolic model in both directions, single precision and batches; what it refuses."""

import re
import shutil
from dataclasses import replace
from functools import lru_cache

import casadi as ca
import codegen_world
import numpy as np
import pytest
from codegen_world import EVERY, STRICT, TOOL, fitted, loaded, needs, run
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from symfive.campaign import Campaign, Run
from symfive.codegen import Subject, codegen, subject_of
from symfive.effects import EFFECTS, Form
from symfive.errors import InputError
from symfive.machine import EffectEntry, ErrorTerm, Machine, Structure, make_axis, preset
from symfive.model import Model

compiled = codegen_world.compiled  # fixture


def random_pose(subject: Subject, data: st.DataObject) -> np.ndarray:
    shares = data.draw(st.lists(st.floats(0.0, 1.0), min_size=len(subject.axes), max_size=len(subject.axes)))
    ends = [[v * a.to_internal for v in a.travel] for a in (subject.machine.axes[n] for n in subject.axes)]
    return np.array([low + (high - low) * s for s, (low, high) in zip(shares, ends, strict=True)])


@lru_cache
def subject_and_reference(name: str) -> tuple[Subject, ca.Function]:
    subject = subject_of(name)
    return subject, subject.function()


@pytest.mark.parametrize("name", EVERY)
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_the_library_is_the_symbolic_model(compiled, name, data) -> None:
    machine = compiled.machine(name)
    subject, function = subject_and_reference(name)
    q = random_pose(subject, data)
    p = machine.p * data.draw(st.floats(-3.0, 3.0))
    expected = [np.asarray(part, dtype=float) for part in function(q, TOOL, p)]
    found = (*machine.forward(q, TOOL, p), machine.axis_jacobian(q, TOOL, p)[0], machine.parameter_jacobian(q, TOOL, p))
    for one, other in zip(found, expected, strict=True):
        assert np.reshape(one, other.shape) == pytest.approx(other, abs=2e-11)
    error, tilt = machine.error(q, TOOL, p)
    nominal, direction = machine.nominal(q, TOOL)
    assert nominal + error == pytest.approx(found[0], abs=1e-12)
    assert direction + tilt == pytest.approx(found[1], abs=1e-14)
    assert machine.error(q, TOOL, 0.0 * p)[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("name", EVERY)
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_forward_and_inverse_are_each_others_inverse(compiled, name, data) -> None:
    """The class of bug of LinuxCNC#4546, on every structure: to 1e-9 mm, whatever the errors."""
    machine = compiled.machine(name)
    subject, _ = subject_and_reference(name)
    q = random_pose(subject, data)
    p = machine.p * data.draw(st.floats(-50.0, 50.0))
    tool = np.array([0.0, 0.0, -data.draw(st.floats(0.0, 300.0))])
    target, _ = machine.forward(q, tool, p)
    linear = [i for i, axis in enumerate(subject.axes) if not subject.machine.axes[axis].rotary]
    start = q.copy()
    start[linear] = 0.0
    back = machine.inverse(target, tool, start, p)
    assert np.abs(back - q).max() < 1e-9
    assert np.abs(machine.forward(back, tool, p)[0] - target).max() < 1e-9
    commands = machine.compensate(q, tool, p)
    assert np.abs(machine.forward(commands, tool, p)[0] - machine.nominal(q, tool)[0]).max() < 1e-9
    assert machine.inverse_nominal(machine.nominal(q, tool)[0], tool, start) == pytest.approx(q, abs=1e-9)


@pytest.mark.parametrize("name", [name for name in EVERY if name != "three-axis"])
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_directions_are_found_again(compiled, name, data) -> None:
    machine = compiled.machine(name)
    subject, _ = subject_and_reference(name)
    q = random_pose(subject, data)
    _, direction = machine.nominal(q, TOOL)
    rotary = [i for i, axis in enumerate(subject.axes) if subject.machine.axes[axis].rotary]
    start = q.copy()
    start[rotary] += 0.01 * np.array([data.draw(st.floats(-1, 1)) for _ in rotary])
    found = unless_singular(machine.orient, direction, start)
    if found is not None:
        assert machine.nominal(found, TOOL)[1] == pytest.approx(direction, abs=1e-7)
    commands = unless_singular(machine.compensate_direction, q, TOOL, machine.p)
    if commands is not None:
        position, reached = machine.forward(commands, TOOL, machine.p)
        assert np.abs(position - machine.nominal(q, TOOL)[0]).max() < 1e-9
        assert np.abs(reached - direction).max() < 1e-9


def unless_singular(solve, *arguments):
    """The solution, or None where the pose is singular; any other failure is one."""
    try:
        return solve(*arguments)
    except ArithmeticError as error:
        assert error.status == 1, error
        return None


def test_singular_and_unreachable_poses_are_said(compiled) -> None:
    machine = compiled.machine("table-bc")
    q = np.array([1.0, 2.0, 0.0, 0.7, 3.0])
    with pytest.raises(ArithmeticError, match="singular"):
        machine.orient([0.0, 0.0, 1.0], q)
    with pytest.raises(ArithmeticError, match="singular"):
        machine.compensate_direction(q, TOOL)
    with pytest.raises(ArithmeticError, match="not finite"):
        machine.inverse([np.nan, 0.0, 0.0], TOOL, q)
    with pytest.raises(ArithmeticError, match="unreachable"):
        compiled.machine("nutating-table").orient([1.0, 0.0, -0.2] / np.hypot(1.0, 0.2), np.zeros(5))


def test_linear_axes_in_one_plane_reach_no_point(tmp_path) -> None:
    needs("gcc")
    flat = replace(
        preset("three-axis"), axes={**preset("three-axis").axes, "Z": make_axis("Z", direction=(1.0, 1.0, 0.0))}
    )
    codegen(flat, tmp_path / "flat")
    module = loaded(tmp_path / "flat" / "sf.py")
    machine = module.Machine(module.build(compiler="gcc", flags=("-O0",)))
    for solve in (machine.inverse, machine.inverse_nominal):
        with pytest.raises(ArithmeticError, match="unreachable"):
            solve([1.0, 2.0, 3.0], TOOL, np.zeros(3))


# ---- what the errors are made of


def test_static_effects_are_in_and_the_others_are_named(tmp_path) -> None:
    entries = (
        EffectEntry(effect="gravity_sag", axis="B", options={"component": "EYB"}),
        EffectEntry(effect="transmission_error", axis="C", options={"period": 3.0}),
        EffectEntry(effect="scale_error", axis="X"),
        EffectEntry(effect="backlash", axis="X"),
        EffectEntry(effect="thermal_drift"),
    )
    subject = subject_of(replace(preset("table-bc"), effects=entries))
    assert [effect.id for effect in subject.effects] == ["gravity_sag", "transmission_error", "scale_error"]
    assert dict(subject.left_out) == {
        "backlash.X": "depends on the path to the position", "thermal_drift": "depends on time",
    }  # fmt: skip
    codegen(replace(preset("table-bc"), effects=entries), tmp_path / "c")
    header = (tmp_path / "c" / "sf.h").read_text()
    assert "left out     backlash.X" in header and "gravity_sag.B.EYB.sin" in header
    needs("gcc")
    run("gcc", *STRICT, "-O1", "sf.c", "sf_selftest.c", "-lm", "-o", "selftest", cwd=tmp_path / "c")
    assert "0 failures" in run("./selftest", cwd=tmp_path / "c")


@pytest.mark.parametrize("name", ["table-bc", pytest.param("head-bc", marks=pytest.mark.slow)])
def test_every_static_effect_moves_the_tool_as_in_the_model(name) -> None:
    """By readings of an R-test; what hangs on the ball of a run cannot be in a control."""
    machine, rng, rows = replace(preset(name), errors={}), np.random.default_rng(0), 8
    commands = {axis.name: rng.uniform(*(0.1 * np.array(axis.travel)), rows) for axis in machine.axes.values()}
    nest = np.array([30.0, 20.0, 50.0])
    campaign = Campaign(machine=machine, runs=(
        Run(id="r", instrument=("r_test",), sampling="static", time=np.arange(1.0, rows + 1), commands=commands,
            table_ball=tuple(nest), tool_ball=TOOL),
    ))  # fmt: skip
    left_out = {}
    for form in (form for effect in EFFECTS.values() for form in effect.candidates(campaign) if isinstance(form, Form)):
        try:
            form.effect.prepare(campaign)
        except InputError:
            continue  # not of this machine
        subject = subject_of(fitted(machine, effects=(form.effect,)))
        left_out |= dict(subject.left_out)
        if subject.effects:
            model = Model(campaign, effects=(form.effect,))
            values = dict(zip((p.name for p in subject.parameters), subject.values, strict=True))
            read = model.predict_run("r", [values.get(p.name, 0.0) for p in model.parameters]).reshape(rows, 3)
            q = np.stack([commands[axis] * machine.axes[axis].to_internal for axis in subject.axes], axis=1)
            tool = subject.function()
            moved = [1e3 * (tool(row, TOOL, subject.values)[0].full()[:, 0] - nest) for row in q]
            assert np.array(moved) == pytest.approx(read, abs=1e-6), form.effect.key
    hung = {key.split(".")[0] for key, reason in left_out.items() if "ball on the table" in reason}
    assert hung == ({"load_moment"} if name == "table-bc" else set())


@pytest.mark.parametrize(
    "basis", ["fourier", *(pytest.param(b, marks=pytest.mark.slow) for b in ("bspline", "polynomial"))]
)
def test_six_error_motions_of_every_axis_in_every_basis(tmp_path, basis) -> None:
    needs("gcc")
    machine = preset("nutating-table")
    errors = {f"E{c}{axis}": ErrorTerm(name=f"E{c}{axis}", sigma=10.0, basis=(basis,), order=(2,)) for axis in ("C", "Z")
              for c in "XYZABC"}  # fmt: skip
    errors["EXB"] = ErrorTerm(name="EXB", sigma=5.0, over=("B", "C"), basis=(basis, "fourier"), order=(2, 1))
    codegen(replace(machine, errors=errors), tmp_path / "c")
    run("gcc", *STRICT, "-O1", "sf.c", "sf_selftest.c", "-lm", "-o", "selftest", cwd=tmp_path / "c")
    assert "0 failures" in run("./selftest", cwd=tmp_path / "c")


def test_machines_without_errors_or_inverse(tmp_path) -> None:
    """No parameter: arrays of one; fewer than three linear axes: no inverse; any names."""
    needs("gcc")
    directions = {"J1": (0.0, 1.0, 1.0), "J2": (1.0, 0.0, 0.0)}
    axes = {name: make_axis(name, kind="rotary", direction=direction) for name, direction in directions.items()}
    arm = Machine(name='arm "*/" ??/', structure=Structure(("J2",), ("J1",)), axes=axes)
    for name, machine in (("arm", arm), ("ideal", replace(preset("table-bc"), errors={}))):
        codegen(machine, tmp_path / name, prefix="my_machine")
        run(
            "gcc", *STRICT, "-O1", "my_machine.c", "my_machine_selftest.c", "-lm", "-o", "selftest", cwd=tmp_path / name
        )
        assert "0 failures" in run("./selftest", cwd=tmp_path / name)
        for compiler in filter(shutil.which, ("gcc", "clang")):
            run(compiler, "-std=gnu99", "-Wall", "-Wextra", "-Werror", "-c", "my_machine_batch.c", cwd=tmp_path / name)
        assert ("my_machine_inverse(" in (tmp_path / name / "my_machine.h").read_text()) == (name == "ideal")


def test_the_page_has_every_function_and_status_of_the_header(compiled) -> None:
    folder = compiled.folder("tsutsumi-2007")
    header, page = (folder / "sf.h").read_text(), (folder / "sf.html").read_text()
    functions = set(re.findall(r"(sf_\w+)\(", re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL)))
    assert functions == set(re.findall(r"<td><code>(sf_\w+)</code>", page))
    codes = re.findall(r"#define (SF_[A-Z_]+) (\d) +/\* \D", header)
    assert all(f"<code>{name}</code> ({number})" in page for name, number in codes if name != "SF_P_SIZE")


@pytest.mark.parametrize(
    ("source", "more", "says"),
    [
        ("table-bc", {"target": "matlab"}, "there is no target 'matlab'; use one of c, linuxcnc"),
        ("table-bc", {"prefix": "9x"}, "cannot begin C names"),
        ("nothing.txt", {}, "neither a machine nor a model"),
        ("nothing.json", {}, "there is no such file"),
    ],
)
def test_bad_input_ends_in_one_sentence(tmp_path, source, more, says) -> None:
    with pytest.raises(InputError, match=re.escape(says)):
        codegen(source, tmp_path / "out", **more)
    assert not (tmp_path / "out").exists()


# ---- the batch kernel


@pytest.mark.parametrize(
    ("name", "compiler", "flags"),
    [
        ("tsutsumi-2007", "gcc", ()),
        ("tsutsumi-2007", "clang", ()),
        pytest.param("wang-li-2016", "gcc", (), marks=pytest.mark.slow),
        pytest.param("head-bc", "clang", ("-DSF_LANES=2",), marks=pytest.mark.slow),
    ],
)
def test_the_batch_kernel_is_the_symbolic_model(compiled, tmp_path, name, compiler, flags) -> None:
    needs(compiler)
    module = loaded(compiled.folder(name) / "sf.py")
    batch = module.Batch(
        module.build_batch(tmp_path, compiler=compiler, flags=("-Wall", "-Wextra", "-Wpsabi", "-Werror", *flags))
    )
    subject = subject_of(name)
    p = np.array([fitted(preset(name)).values[n] for n in module.PARAMETERS])
    generator = np.random.default_rng(1)
    ends = np.array([[v * a.to_internal for v in a.travel] for a in (subject.machine.axes[n] for n in subject.axes)])
    q = generator.uniform(ends[:, 0], ends[:, 1], size=(203, len(ends)))
    function = subject.function()
    results = [function(row, TOOL, p) for row in q]
    position = np.array([np.asarray(r[0])[:, 0] for r in results])
    by_p = np.array([np.asarray(r[3]) for r in results])
    assert np.abs(batch.forward(q, TOOL, p) - position).max() < 1e-12 * 1e3
    for stream in (False, True):
        points, slopes = batch.jacobian(q, TOOL, p, stream=stream)
        assert np.abs(points - position).max() < 1e-12 * 1e3
        assert np.abs(slopes - by_p).max() < 1e-12 * np.abs(by_p).max()
    step = p * generator.normal(size=len(p))
    assert np.abs(batch.predict(q, TOOL, p, step) - position - by_p @ step).max() < 1e-12 * 1e3
    target = position + generator.normal(size=position.shape)
    information, gradient, square = batch.information(q, TOOL, p, target)
    expected = np.einsum("nij,nik->jk", by_p, by_p)
    assert np.abs(information - expected).max() < 1e-12 * np.abs(expected).max()
    expected = np.einsum("nij,ni->j", by_p, target - position)
    assert np.abs(gradient - expected).max() < 1e-12 * np.abs(expected).max()
    assert square == pytest.approx(np.sum((target - position) ** 2), rel=1e-12)
    for rank in (1, 4, len(p)):  # a remainder, one block, all
        factor = np.linalg.qr(generator.normal(size=(len(p), rank)))[0] * generator.uniform(0.1, 9.0, rank)
        expected = by_p @ (factor @ factor.T) @ by_p.transpose(0, 2, 1)
        assert np.abs(batch.leverage(q, TOOL, p, factor) - expected).max() < 1e-12 * np.abs(expected).max()
    with pytest.raises(ValueError, match="shape"):
        batch.leverage(q, TOOL, p, np.eye(len(p) + 1))
