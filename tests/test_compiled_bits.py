"""Compiled functions and array operations give the interpreter's bits: every operation, effect, preset and instruction set."""

import platform
import shutil
from dataclasses import replace
from pathlib import Path

import casadi as ca
import compiled_world
import numpy as np
import pytest
from codegen_world import compiles
from compiled_world import (
    HELD,
    POINTS,
    SWITCH,
    fake,
    interpreted,
    needs_compiler,
    same,
    small,
)
from effects_world import CASES, around, model_of
from test_codegen_lanes import cpu_flags

from symfive.campaign import read_campaign
from symfive.compiled import Mapped, _mapped, status
from symfive.compiled._columns import Columns  # array operations for any number of rows
from symfive.design import plan
from symfive.identify import identify
from symfive.machine import preset, presets
from symfive.model import Model, _assembly
from symfive.procedures import campaign_of, r_test_grid

CAMPAIGNS = Path(__file__).parent / "data" / "campaigns"


cache, eager = compiled_world.cache, compiled_world.eager  # fixtures


def by_columns(function: ca.Function, held: tuple[int, ...], *inputs: np.ndarray) -> list[np.ndarray] | None:
    """By array operations, whatever the number of rows; None where one of them has no number."""
    rows = next(len(value) for i, value in enumerate(inputs) if i not in held)
    results = [np.full((rows, function.numel_out(i)), np.nan) for i in range(function.n_out())]
    return results if Columns(function, held)(inputs, results, 0, rows) else None


@needs_compiler
@pytest.mark.parametrize("rows", [1, 2, 7, 8, 9, 64, 203])
def test_any_number_of_rows(eager, rows) -> None:
    mapped = Mapped(small(), (1,))
    mapped(POINTS, HELD)
    assert mapped.compiled
    for one, other in zip(mapped(POINTS[:rows], HELD), interpreted(small(), (1,), POINTS[:rows], HELD), strict=True):
        assert one.shape == other.shape
        assert same(one, other)
    assert [part.shape for part in mapped(POINTS[:0], HELD)] == [(0, 3), (0, 3)]


def every_operation() -> ca.Function:
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 2)
    a, b = x[0], x[1]
    one = [ca.fabs, ca.sign, ca.floor, ca.ceil, ca.sqrt, ca.sin, ca.cos, ca.tan, ca.asin, ca.acos, ca.atan, ca.exp, ca.log,
           ca.sinh, ca.cosh, ca.tanh, ca.asinh, ca.acosh, ca.atanh, ca.log1p, ca.expm1, ca.erf, ca.logic_not]  # fmt: skip
    two = [ca.fmin, ca.fmax, ca.atan2, ca.hypot, ca.power, ca.fmod, ca.logic_and, ca.logic_or]
    found = [f(a) for f in one] + [f(p[0]) for f in one]
    found += [f(*pair) for f in two for pair in ((a, b), (b, a), (a, p[1]), (p[0], b), (p[0], p[1]), (a, ca.SX(-0.0)))]
    found += [a < b, a <= b, a == b, a != b, a < p[0], p[1] <= b, a == 0, -a, -(a - b), a * -b, a + -b, a / 3.0, a / b]
    found += [
        ca.if_else(a > b, ca.sin(a), ca.sqrt(b)),
        ca.if_else(p[0] > 0, a, b),
        ca.if_else(ca.fabs(a) < 1, a * b, p[0]),
    ]
    found += [
        a**2,
        a**3,
        a**-1,
        a**0.5,
        ca.sin(2 * a),
        ca.cos(3 * a),
        2 * a,
        a * a * b + a * a * p[0],
        1 / a,
        ca.SX(7.0),
    ]
    found += [ca.SX(np.inf) + 0 * a, ca.jacobian(ca.fmax(a, b) * ca.sign(a), x)]
    return ca.Function("every", [x, p], [ca.densify(ca.vertcat(*(ca.vec(part) for part in found)))])


@pytest.mark.parametrize("rows", [1, 203, 1500])
def test_columns_give_the_bits_of_rows(rows) -> None:
    points = np.resize(POINTS, (rows, 2))
    for still in (points, points * [1.0, 0.0], np.ones_like(points)):
        for one, other in zip(
            by_columns(small(), (1,), still, HELD), interpreted(small(), (1,), still, HELD), strict=True
        ):
            assert same(one, other)


def test_odd_numbers_by_columns_are_those_of_rows_or_left_to_them() -> None:
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 2)
    a, b = x[0], x[1]
    told = [a < b, a <= b, a == b, a != b, a == 0, ca.if_else(a > b, a, b), ca.if_else(a, b, p[0]), ca.logic_not(a)]
    told += [
        ca.fmax(a, b),
        ca.fmin(a, b),
        ca.fmax(p[0], b),
        ca.sign(a),
        ca.floor(a),
        ca.ceil(p[0]),
        ca.logic_and(a, b),
        ca.logic_or(a, p[0]),
    ]
    made = [a + b, a - p[0], a * b, p[1] * p[0], a / p[0], 1 / a, -a, ca.fabs(b), ca.sqrt(a), a**2, 2 * b]
    called = [ca.sin(a), ca.atan2(a, b), ca.exp(a), ca.tanh(a), ca.log(a), ca.power(a, b), a**3, ca.fmod(a, b)]
    odd = np.array([0.0, -0.0, 1.0, -1.0, 0.5, 2.0, -3.7, 1e-310, -1e-310, 1e300, np.inf, -np.inf, np.nan, 4e5, np.pi])
    points = np.array(np.meshgrid(odd, odd)).reshape(2, -1).T
    held = np.array([0.4, -1.0])
    both = ca.Function("both", [x, p], [ca.densify(ca.vertcat(*told, *made))])
    assert same(by_columns(both, (1,), points, held)[0], interpreted(both, (1,), points, held)[0])
    for call in called:
        function = ca.Function("call", [x, p], [call])
        expected = interpreted(function, (1,), points, held)[0]
        found = by_columns(function, (1,), points, held)
        assert found is None or same(found[0], expected)
        for row, value in zip(points, expected, strict=True):
            found = by_columns(function, (1,), row[None, :], held)
            assert found is None or same(found[0][0], value)
    many = np.concatenate([points, points])  # so many that columns are tried first
    for call in called:
        function = ca.Function("call", [x, p], [call])
        assert same(Mapped(function, (1,))(many, held)[0], interpreted(function, (1,), many, held)[0])


@needs_compiler
@pytest.mark.parametrize("program", ["gcc", "clang"])
def test_every_operation_and_every_odd_number(eager, monkeypatch, program) -> None:
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not installed")
    monkeypatch.setenv(SWITCH, program)
    odd = np.array([0.0, -0.0, 1.0, -1.0, 0.5, 2.0, -3.7, 1e-310, -1e-310, 1e300, np.inf, -np.inf, np.nan, 4e5, np.pi])
    points = np.array(np.meshgrid(odd, odd)).reshape(2, -1).T
    for held in ([0.4, -1.0], [-0.0, 0.0], [np.inf, 1.0]):
        mapped = Mapped(every_operation(), (1,))
        expected = interpreted(every_operation(), (1,), points, np.array(held))[0]
        assert same(mapped(points, np.array(held))[0], expected)
        assert mapped.compiled, status().refused
        assert same(mapped(points, np.array(held))[0], expected)


@pytest.mark.parametrize("program", ["gcc", "clang"])
@pytest.mark.parametrize("march", ["x86-64-v2", "x86-64-v3", "x86-64-v4", "sapphirerapids", "aarch64"])
def test_every_instruction_set(eager, monkeypatch, tmp_path, program, march) -> None:
    """Vectors of the registers' size, so without a word on the ABI; the same bits from each that this processor can run. With
    AVX512-FP16 (Sapphire Rapids) gcc says that half precision has operations of its own."""
    cross = march == "aarch64"
    if cross and program == "clang":
        pytest.skip("gcc is the cross compiler")
    if not cross and platform.machine() not in ("x86_64", "AMD64"):
        pytest.skip("not an x86-64 processor")
    compiler = shutil.which("aarch64-linux-gnu-gcc" if cross else program)
    if compiler is None:
        pytest.skip(f"{program} for {march} is not installed")
    if cross and not compiles(compiler):
        pytest.skip("the C library's headers for aarch64 are not installed")
    needed = {"x86-64-v3": {"avx2"}, "x86-64-v4": {"avx512vl"}, "sapphirerapids": {"avx512_fp16"}}
    runs = not cross and needed.get(march, set()) <= cpu_flags()
    own = 'for word; do shift; case $word in -w|-march=native) ;; *) set -- "$@" "$word";; esac; done'
    set_ = "" if cross else f"-march={march}"
    strict = f'{own}; {compiler} "$@" {set_} -Wpsabi -Werror || exit 1'
    unused = 'case "$*" in *-shared*) echo nonsense > rows.so;; esac'  # what this processor cannot run is not loaded
    monkeypatch.setenv(SWITCH, fake(tmp_path, strict if runs else f"{strict}; {unused}"))
    mapped, held = Mapped(every_operation(), (1,)), np.array([0.4, -1.0])
    (expected,) = interpreted(every_operation(), (1,), POINTS, held)
    mapped(POINTS, held)
    refused = " ".join(status().refused)
    assert mapped.compiled if runs else "cannot be loaded" in refused, refused
    assert same(mapped(POINTS, held)[0], expected)


FIRST = [next(i for i, case in enumerate(CASES) if case.effect == effect) for effect in {c.effect: 0 for c in CASES}]
NUMBERS = [i if i in FIRST else pytest.param(i, marks=pytest.mark.slow) for i in range(len(CASES))]


@needs_compiler
@pytest.mark.parametrize("number", NUMBERS, ids=lambda number: str(CASES[number]))
def test_every_effect(eager, number) -> None:
    model = model_of(number)
    run = next(run for run in model.campaign.runs if model.effects[-1].applies(run))
    function, values = model._function(run), around(model)
    arguments = values[[model.index[name] for name in function.shared]], *model._numbers(run, values)
    inputs = model._clocks(run, function, values)[0].inputs
    fresh = replace(function, _mapped={})
    for slopes in (True,) if number in FIRST else (True, False):
        expected = interpreted(function._table(slopes), (1, 2, 3), inputs, *arguments)[0]
        fresh.evaluate(inputs, *arguments, slopes=slopes)
        assert fresh._mapped[slopes, (1, 2, 3)].compiled, status().refused
        assert same(fresh.evaluate(inputs, *arguments, slopes=slopes).reshape(expected.shape), expected)
        assert same(by_columns(function._table(slopes), (1, 2, 3), inputs, *arguments)[0], expected)


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in presets() if name != "three-axis"])
def test_every_preset(eager, name) -> None:
    model = Model(campaign_of(preset(name), r_test_grid(preset(name))))
    plain, run = Model(model.campaign), model.campaign.runs[0]
    values = model.start + 0.3 * np.minimum(model.prior_sigma, 30.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(SWITCH, "none")
        expected = plain.linearise(run, values)
    _assembly._KEPT.clear()
    before = status().compiled  # the nominal kinematics of the poses
    model.linearise(run, values)
    found = model.linearise(run, values)
    assert status().compiled == before + 1
    assert same(found.prediction, expected.prediction)
    assert same(found.jacobian, expected.jacobian)


@needs_compiler
@pytest.mark.parametrize("where", ["static-none", "static-ball-bar-two-heights", "dynamic-backlash"])
def test_an_identification_is_the_same_to_the_last_bit(monkeypatch, where) -> None:
    campaign = read_campaign(CAMPAIGNS / where / "fit")
    with monkeypatch.context() as patch:
        patch.setenv(SWITCH, "none")
        expected = identify(campaign)
    assert status().compiled == 0
    _assembly._KEPT.clear()
    for name in ("LOOKED_UP_S", "LOOKED_UP_OPERATION_S", "COMPILED_S", "COMPILED_OPERATION_S"):
        monkeypatch.setattr(_mapped, name, 0.0)
    found = identify(campaign)
    assert status().compiled >= 1
    assert not status().refused.keys() - {"no C compiler, or SYMFIVE_COMPILER is none"}
    assert np.array_equal(found.values, expected.values)
    assert np.array_equal(found.covariance, expected.covariance)


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("instrument", ["r_test", "ball_bar"])
def test_a_plan_is_the_same_to_the_last_bit(eager, monkeypatch, instrument) -> None:
    found = plan(preset("table-bc"), instrument=instrument, points=12, starts=1, anywhere=False)
    assert status().compiled >= 5 and not status().refused
    monkeypatch.setenv(SWITCH, "none")
    _assembly._KEPT.clear()
    expected = plan(preset("table-bc"), instrument=instrument, points=12, starts=1, anywhere=False)
    for one, other in zip(found.campaign.runs, expected.campaign.runs, strict=True):
        assert all(np.array_equal(one.commands[axis], other.commands[axis]) for axis in one.commands)
