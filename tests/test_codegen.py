"""Generated C: equal to the symbolic model, clean, guarded, in single precision too, and the same bytes every time."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import ModuleType

import casadi as ca
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from symfive.codegen import TARGETS, Subject, codegen, subject_of
from symfive.errors import InputError
from symfive.machine import EffectEntry, ErrorTerm, Machine, Structure, make_axis, preset, presets
from symfive.model import FittedModel, write_model

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Wdouble-promotion", "-Wshadow", "-Werror")
COMPILERS = ("gcc", "clang")
TOOL = (1.5, -2.5, -120.0)
LIBM = {"sin", "cos", "sincos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "sqrt", "pow", "fabs", "floor",
        "ceil", "fmin", "fmax", "sinh", "cosh", "tanh"}  # fmt: skip


def needs(*programs: str) -> None:
    """Skip, and say why, where a program is not installed."""
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")


def compiles(compiler: str) -> bool:
    """Whether a compiler finds the headers of its C library."""
    return (
        subprocess.run(
            [compiler, "-xc", "-E", "-include", "stdio.h", "-"], input="", text=True, capture_output=True
        ).returncode
        == 0
    )


def run(*command: object, cwd: Path) -> str:
    done = subprocess.run([str(word) for word in command], cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
    return done.stdout


def loaded(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"loader_{path.parent.name.replace('-', '_')}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def fitted(machine: Machine, seed: int = 0) -> FittedModel:
    """A model as an identification leaves it, with drawn values."""
    parameters = subject_of(machine).parameters
    drawn = np.random.default_rng(seed).normal(size=len(parameters))
    values = {p.name: float(round(v * p.sigma, 3)) for p, v in zip(parameters, drawn, strict=True)}
    names = tuple(values)
    return FittedModel(
        machine=machine, effects=(), values=values, std=dict.fromkeys(names, 1.0), names=names,
        units={p.name: p.unit for p in parameters}, covariance=np.eye(len(names)),
    )  # fmt: skip


class Compiled:
    """Presets as C, generated and compiled when they are first asked for."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._machines: dict[str, object] = {}

    def folder(self, name: str) -> Path:
        if not (self._root / name).exists():
            codegen(fitted(preset(name)), self._root / name)
        return self._root / name

    def machine(self, name: str):
        if name not in self._machines:
            needs("gcc")
            module = loaded(self.folder(name) / "sf.py")
            self._machines[name] = module.Machine(module.build(compiler="gcc", flags=("-O0",)))
        return self._machines[name]


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Compiled:
    return Compiled(tmp_path_factory.mktemp("c"))


LARGE = ("oyama-2010", "wang-li-2016")
EVERY = [pytest.param(name, marks=pytest.mark.slow) if name in LARGE else name for name in presets()]


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


@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("name", ["head-bc"])
def test_it_compiles_without_a_word_and_passes_its_self_test(compiled, name, compiler, precision) -> None:
    _compile_and_test(compiled.folder(name), compiler, precision)


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("name", presets())
def test_every_preset_compiles_and_passes_its_self_test(compiled, name, compiler, precision) -> None:
    _compile_and_test(compiled.folder(name), compiler, precision)


def _compile_and_test(folder: Path, compiler: str, precision: str) -> None:
    needs(compiler, "nm")
    switch = ["-DSF_FLOAT"] if precision == "float" else []
    run(compiler, *STRICT, *switch, "-O2", "-fno-pie", "-c", "sf.c", "-o", f"sf-{precision}.o", cwd=folder)
    run(
        compiler,
        *STRICT,
        *switch,
        "-O2",
        "sf_selftest.c",
        f"sf-{precision}.o",
        "-lm",
        "-no-pie",
        "-o",
        "selftest",
        cwd=folder,
    )
    assert "0 failures" in run("./selftest", cwd=folder)
    imports = set(run("nm", "-u", f"sf-{precision}.o", cwd=folder).split()) - {"U", "memset", "memcpy"}
    allowed = {f"{name}f" for name in LIBM} if precision == "float" else LIBM
    assert imports <= allowed, f"{precision} imports {imports - allowed}"
    defined = run("nm", f"sf-{precision}.o", cwd=folder)
    assert not re.search(r" [BbDdC] ", defined), "there is a variable that outlives a call"


def test_a_wrong_library_fails_its_self_test(compiled, tmp_path) -> None:
    needs("gcc")
    shutil.copytree(compiled.folder("three-axis"), tmp_path / "wrong")
    source = tmp_path / "wrong" / "sf.c"
    text = source.read_text()
    changed = text.replace("(sf_real)(0.001)", "(sf_real)(0.0010001)", 1)
    assert changed != text
    source.write_text(changed)
    run("gcc", "sf_selftest.c", "sf.c", "-lm", "-o", "selftest", cwd=source.parent)
    done = subprocess.run(["./selftest"], cwd=source.parent, capture_output=True, text=True)
    assert done.returncode == 1
    assert "off by" in done.stdout


def test_the_stack_stays_below_what_the_header_says(compiled) -> None:
    needs("gcc")
    folder = compiled.folder("table-bc")
    said = dict(
        re.findall(
            r"\* +\(?(?:sf_)?(\w+)\)?: \d+ operations, \d+ live, at most (\d+) bytes", (folder / "sf.h").read_text()
        )
    )
    assert {"forward", "parameter_jacobian", "real_slope"} <= set(said)
    for level in ("-O0", "-O2"):
        run("gcc", "-std=c99", level, "-fstack-usage", "-c", "sf.c", "-o", "stack.o", cwd=folder)
        used = re.findall(r":(?:sf_)?(\w+)\t(\d+)\tstatic", next(folder.glob("*.su")).read_text())
        for name, size in used:
            if name in said:
                assert int(size) <= int(said[name]), f"{name} at {level}"
        path = ("inverse", "approach", "solve3", "largest", "real_slope")
        assert sum(int(size) for name, size in used if name in path) <= int(said["real_slope"]) + 1000


@pytest.mark.slow
def test_cppcheck_finds_nothing_that_matters(compiled) -> None:
    """MISRA C:2012 as far as cppcheck's addon goes; what remains belongs to checking one file alone."""
    needs("cppcheck")
    for precision in (["-USF_FLOAT"], ["-DSF_FLOAT"]):
        done = subprocess.run(
            ["cppcheck", "--std=c99", "--enable=warning,style,performance,portability", "--addon=misra", "--template={id}",
             "--suppress=missingIncludeSystem", *precision, "sf.c"],
            cwd=compiled.folder("head-bc"), capture_output=True, text=True,
        )  # fmt: skip
        found = {line for line in done.stderr.splitlines() if re.fullmatch(r"[\w.-]+", line)}
        assert found <= {"misra-c2012-2.5", "misra-c2012-8.7", "misra-config", "normalCheckLevelMaxBranches"}, found


@pytest.mark.slow
def test_cmake_builds_and_tests_it(compiled, tmp_path) -> None:
    needs("cmake", "gcc")
    for switch in ("OFF", "ON"):
        build = tmp_path / switch
        run("cmake", "-S", compiled.folder("head-bc"), "-B", build, f"-DSF_FLOAT={switch}", cwd=tmp_path)
        run("cmake", "--build", build, cwd=tmp_path)
        assert "100% tests passed" in run("ctest", "--test-dir", build, cwd=tmp_path)


@pytest.mark.parametrize("target", list(TARGETS))
def test_the_same_model_gives_the_same_bytes(tmp_path, target) -> None:
    model = fitted(preset("table-bc"))
    write_model(model, tmp_path / "model.json")
    first = codegen(model, tmp_path / "first", target=target)
    second = codegen(tmp_path / "model.json", tmp_path / "second", target=target)
    assert first and [p.name for p in first] == [p.name for p in second]
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
        text = one.read_text()
        assert text.endswith("\n") and not re.search(r"\b20[2-9]\d-\d\d-\d\d\b|/(tmp|home)/", text)
        assert model.machine.name in text or target == "c" or one.suffix in (".hal", ".c")


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
        assert ("my_machine_inverse(" in (tmp_path / name / "my_machine.h").read_text()) == (name == "ideal")


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


# ---- wrapper and library


@pytest.mark.parametrize("kind", ["Machine", "Batch"])
def test_a_library_of_another_model_is_not_loaded(tmp_path, kind) -> None:
    """Regenerated in the same folder: the library beside the wrapper is compiled anew, one that is named is refused."""
    needs("gcc")
    old, new = fitted(preset("table-bc")), fitted(preset("table-bc"), seed=1)
    codegen(old, tmp_path / "c")
    run(sys.executable, "-c", f"import sf; sf.{kind}()", cwd=tmp_path / "c")
    (library,) = (tmp_path / "c").glob("lib*.so")
    stale = Path(shutil.copy(library, tmp_path / "stale.so"))
    codegen(new, tmp_path / "c", overwrite=True)
    module = loaded(tmp_path / "c" / "sf.py")
    with pytest.raises(module.WrongLibrary, match="another model"):
        getattr(module, kind)(stale)
    made = getattr(module, kind)()
    assert module.MODEL.encode() in library.read_bytes() != stale.read_bytes()
    q = np.array([10.0, 20.0, 0.3, 0.4, 30.0])
    p = np.array([new.values[name] for name in module.PARAMETERS])
    wanted = np.asarray(subject_of("table-bc").function()(q, TOOL, p)[0], dtype=float)[:, 0]
    found = made.forward(q, TOOL)[0] if kind == "Machine" else made.forward(q[None], TOOL, p)[0]
    assert found == pytest.approx(wanted, abs=1e-9)


def test_a_library_that_others_could_have_written_is_not_loaded(compiled, tmp_path, monkeypatch) -> None:
    needs("gcc")
    module = loaded(compiled.folder("three-axis") / "sf.py")
    library = module.build(tmp_path, compiler="gcc", flags=("-O0",))
    module.Machine(library)
    for mode in (0o775, 0o757):
        library.chmod(mode)
        with pytest.raises(module.WrongLibrary, match="others can write"):
            module.Machine(library)
    library.chmod(0o755)
    owner = library.stat().st_uid
    if owner:
        monkeypatch.setattr(module.os, "getuid", lambda: owner + 1)
    else:
        os.chown(library, 12345, 0)
    with pytest.raises(module.WrongLibrary, match="another user"):
        module.Machine(library)


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
