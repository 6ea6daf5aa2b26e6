"""Compiled functions over rows: the interpreter's bits, used when they pay, never where they cannot be trusted."""

from __future__ import annotations

import hashlib
import math
import os
import pickle
import platform
import re
import shutil
import subprocess
import sys
import threading
from collections import Counter
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from test_codegen import compiles
from test_codegen_lanes import cpu_flags
from test_effects import CASES, around, model_of

from symfive.campaign import read_campaign
from symfive.compiled import Mapped, _mapped, status
from symfive.compiled._cache import find
from symfive.compiled._columns import Columns
from symfive.compiled._compiler import FLAGS, SWITCH
from symfive.compiled._library import Library
from symfive.compiled._source import source_of
from symfive.design import plan
from symfive.identify import identify
from symfive.machine import preset, presets
from symfive.model import Model, _assembly
from symfive.procedures import campaign_of, r_test_grid

CAMPAIGNS = Path(__file__).parent / "data" / "campaigns"
PROGRAM = next((name for name in ("cc", "gcc", "clang") if shutil.which(name)), None)
needs_compiler = pytest.mark.skipif(PROGRAM is None, reason="no C compiler is installed")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache and a memory of one's own; where the libraries lie."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv(SWITCH, PROGRAM or "none")
    monkeypatch.setattr(_mapped, "_STATES", {})
    monkeypatch.setattr(_mapped, "_MADE", Counter())
    monkeypatch.setattr(_mapped, "_REFUSED", Counter())
    _assembly._KEPT.clear()
    return tmp_path / "cache" / "symfive"


@pytest.fixture
def eager(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything is compiled after the first rows."""
    for name in ("LOOKED_UP_S", "LOOKED_UP_OPERATION_S", "COMPILED_S", "COMPILED_OPERATION_S"):
        monkeypatch.setattr(_mapped, name, 0.0)


def small(scale: float = 1.0) -> ca.Function:
    """x (2) moves, p (3) is held; two results, one of them partly constant."""
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 3)
    first = ca.vertcat(ca.sin(scale * x[0] + p[0]) * x[1], p[1] * ca.exp(p[2]), 4.5)
    return ca.Function("small", [x, p], [first, ca.densify(ca.jacobian(first[0], p))])


def interpreted(function: ca.Function, held: tuple[int, ...], *inputs: np.ndarray) -> list[np.ndarray]:
    """By CasADi's interpreter, row by row."""
    plain = Mapped(function, held)
    plain._state.settled = plain._tried = True
    return plain(*inputs)


def by_columns(function: ca.Function, held: tuple[int, ...], *inputs: np.ndarray) -> list[np.ndarray] | None:
    """By array operations, whatever the number of rows; None where one of them has no number."""
    rows = next(len(value) for i, value in enumerate(inputs) if i not in held)
    results = [np.full((rows, function.numel_out(i)), np.nan) for i in range(function.n_out())]
    return results if Columns(function, held)(inputs, results, 0, rows) else None


def same(one: np.ndarray, other: np.ndarray) -> bool:
    """To the last bit, signs of zeros included; what is not a number is one as the other."""
    numbers = ~np.isnan(one)
    return np.array_equal(one, other, equal_nan=True) and np.array_equal(
        np.signbit(one[numbers]), np.signbit(other[numbers])
    )


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*/*.so"))


POINTS = np.random.default_rng(0).normal(size=(203, 2)) * 30.0
HELD = np.array([0.3, -2.0, 0.7])


# ---- the same bits


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
def test_every_instruction_set(tmp_path, program, march) -> None:
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
    (tmp_path / "rows.c").write_text(source_of(every_operation(), (1,)).text)
    flags = [flag for flag in FLAGS if flag not in ("-w", "-march=native")] + ([] if cross else [f"-march={march}"])
    command = [compiler, *flags, "-Wpsabi", "-Werror", "-shared", "rows.c", "-o", "rows.so", "-lm"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr, done.stderr
    needed = {"x86-64-v3": {"avx2"}, "x86-64-v4": {"avx512vl"}, "sapphirerapids": {"avx512_fp16"}}
    if cross or not needed.get(march, set()) <= cpu_flags():
        return
    points, held = POINTS, np.array([0.4, -1.0])
    (expected,) = interpreted(every_operation(), (1,), points, held)
    found = np.empty_like(expected)
    Library(tmp_path / "rows.so")(len(points), [points, held], [found])
    assert same(found, expected)


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


# ---- when


@needs_compiler
def test_little_work_is_never_compiled_and_much_work_is_once(cache) -> None:
    mapped = Mapped(small(), (1,))
    a_row = mapped._operations * _mapped.SHARE * _mapped.INTERPRETED_S
    price = _mapped.COMPILED_S + _mapped.COMPILED_OPERATION_S * mapped._operations
    many = np.tile(POINTS, (20, 1))
    for _ in range(int(price / a_row / len(many))):
        mapped(many, HELD)
    assert not mapped.compiled and not files(cache)
    mapped(many, HELD)
    mapped(many, HELD)
    assert mapped.compiled and [path.suffix for path in cache.glob("*/*")] == [".so"]
    assert status().compiled == 1 and status().folder == str(cache)


@needs_compiler
@pytest.mark.parametrize("note", ["whole", "nonsense", "nan", "-1e9", "1e300"])
def test_what_earlier_runs_have_paid_counts(cache, monkeypatch, note) -> None:
    for name in ("COMPILED_S", "COMPILED_OPERATION_S", "LOOKED_UP_S", "LOOKED_UP_OPERATION_S", "NOTED_S"):
        monkeypatch.setattr(_mapped, name, 0.2 * getattr(_mapped, name))  # all costs alike, and sooner
    many = np.tile(POINTS, (20, 1))
    calls = [0, 0]
    for run in range(2):
        monkeypatch.setattr(_mapped, "_STATES", {})
        mapped = Mapped(small(), (1,))
        price = _mapped.COMPILED_S + _mapped.COMPILED_OPERATION_S * mapped._operations
        while not mapped.compiled and (run or mapped._state.spent < 0.9 * price):
            mapped(many, HELD)
            calls[run] += 1
        if not run:
            (noted,) = cache.glob("*/*")
            assert 0.4 * price < float(noted.read_text()) < price
            if note != "whole":
                noted.write_text(note)
    assert (calls[1] < 0.7 * calls[0]) == (note == "whole")


@needs_compiler
def test_runs_that_each_pay_less_than_those_before_add_up(cache, monkeypatch) -> None:
    many, mapped = np.tile(POINTS, (20, 1)), Mapped(small(), (1,))
    price = _mapped.COMPILED_S + _mapped.COMPILED_OPERATION_S * mapped._operations
    a_call = len(many) * mapped._operations * _mapped.SHARE * _mapped.INTERPRETED_S
    monkeypatch.setattr(_mapped, "NOTED_S", 0.01 * price)
    runs = 0
    while not mapped.compiled and runs < 9:
        monkeypatch.setattr(_mapped, "_STATES", {})
        mapped, runs = Mapped(small(), (1,)), runs + 1
        for _ in range(math.ceil(price / 6.0 / a_call)):
            mapped(many, HELD)
    assert mapped.compiled and runs in (6, 7)


@needs_compiler
def test_one_call_with_many_rows_is_compiled_on_its_way(cache, monkeypatch) -> None:
    monkeypatch.setattr(_mapped, "COMPILED_S", 0.4 * _mapped.COMPILED_S)
    mapped = Mapped(small(), (1,))
    many = np.random.default_rng(1).normal(size=(2_500_000, 2))
    found = mapped(many, HELD)
    assert len(files(cache)) == 1
    part = np.r_[0:5000, 2_000_000:2_005_000, 2_495_000:2_500_000]
    for one, other in zip(found, interpreted(small(), (1,), many[part], HELD), strict=True):
        assert same(one[part], other)


@needs_compiler
def test_what_lies_on_disk_is_used_at_once(eager, cache, monkeypatch) -> None:
    Mapped(small(), (1,))(POINTS, HELD)
    assert status().compiled == 1
    monkeypatch.setattr(_mapped, "_STATES", {})
    monkeypatch.setattr(_mapped, "COMPILED_S", 1e9)
    again = Mapped(small(), (1,))
    again(POINTS, HELD)
    assert again.compiled and status().loaded == 1
    third = Mapped(small(), (1,))  # the same function in the same process
    third(POINTS, HELD)
    assert third._state is again._state
    other = Mapped(small(2.0), (1,))
    other(POINTS, HELD)
    assert not other.compiled


# ---- without a compiler


@pytest.mark.parametrize("wanted", ["none", "NONE", "no-such-compiler"])
def test_it_can_be_switched_off(eager, cache, monkeypatch, wanted) -> None:
    monkeypatch.setenv(SWITCH, wanted)
    mapped = Mapped(small(), (1,))
    for _ in range(3):
        assert same(mapped(POINTS, HELD)[0], interpreted(small(), (1,), POINTS, HELD)[0])
    assert not mapped.compiled and not files(cache)
    assert status().compiler is None and sum(status().refused.values()) == 1


def test_without_a_compiler_in_the_path(eager, monkeypatch, tmp_path) -> None:
    monkeypatch.delenv(SWITCH)
    monkeypatch.setenv("PATH", str(tmp_path))
    mapped = Mapped(small(), (1,))
    mapped(POINTS, HELD)
    assert same(mapped(POINTS, HELD)[0], interpreted(small(), (1,), POINTS, HELD)[0])
    assert status().compiler is None


def fake(folder: Path, text: str) -> str:
    """A compiler of one's own."""
    path = folder / "fake-cc"
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


@needs_compiler
@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ('case "$*" in *-dM*) exec cc "$@";; esac; echo "no memory" >&2; exit 1', "fails: no memory"),
        ('case "$*" in *-dM*) exec cc "$@";; esac; echo nonsense > rows.so', "cannot be loaded"),
        ('case "$*" in *-dM*) exec cc "$@";; esac; sed -i "s/4.5/4.500001/" rows.c; exec cc "$@"', "differs"),
    ],
)
def test_a_compiler_that_fails_or_lies_changes_nothing(eager, monkeypatch, tmp_path, script, reason) -> None:
    monkeypatch.setenv(SWITCH, fake(tmp_path, script))
    mapped = Mapped(small(), (1,))
    for _ in range(2):
        assert same(mapped(POINTS, HELD)[0], interpreted(small(), (1,), POINTS, HELD)[0])
    assert not mapped.compiled
    assert [said for said in status().refused if reason in said], status().refused


def test_what_cannot_be_written_in_c_stays_interpreted(eager) -> None:
    x = ca.MX.sym("x", 2)
    mapped = Mapped(ca.Function("mx", [x], [ca.sin(x)]))
    mapped(POINTS)
    assert same(mapped(POINTS)[0], np.sin(POINTS))
    assert not mapped.compiled


# ---- the folder


@needs_compiler
@pytest.mark.parametrize("damage", ["cut", "garbage", "garbage of the right name", "gone"])
def test_a_damaged_library_is_made_anew(eager, cache, monkeypatch, damage) -> None:
    Mapped(small(), (1,))(POINTS, HELD)
    (path,) = files(cache)
    whole = path.read_bytes()
    path.unlink()  # not in place: this process has it mapped
    if damage == "cut":
        path.write_bytes(whole[: len(whole) // 2])
    elif damage == "garbage":
        path.write_bytes(b"garbage")
    elif damage != "gone":
        path.with_name(hashlib.sha256(b"garbage").hexdigest() + ".so").write_bytes(b"garbage")
    monkeypatch.setattr(_mapped, "_STATES", {})
    mapped = Mapped(small(), (1,))
    mapped(POINTS, HELD)
    assert mapped.compiled and status().compiled == 2
    assert [hashlib.sha256(p.read_bytes()).hexdigest() == p.stem for p in files(cache)] == [True]


@needs_compiler
@pytest.mark.parametrize("open_one", ["cache", "parent", "library"])
def test_what_others_can_write_to_is_not_trusted(eager, cache, monkeypatch, open_one) -> None:
    Mapped(small(), (1,))(POINTS, HELD)
    (path,) = files(cache)
    assert cache.stat().st_mode & 0o777 == 0o700 and path.parent.stat().st_mode & 0o777 == 0o700
    {"cache": cache, "parent": cache.parent, "library": path}[open_one].chmod(0o777)
    monkeypatch.setattr(_mapped, "_STATES", {})
    if open_one == "library":
        assert find(cache, path.parent.name) is None
        return
    mapped = Mapped(small(), (1,))
    assert same(mapped(POINTS, HELD)[0], interpreted(small(), (1,), POINTS, HELD)[0])
    assert not mapped.compiled
    assert [said for said in status().refused if "others can write" in said]
    assert status().folder is None


@needs_compiler
def test_a_folder_that_cannot_be_made_is_no_error(eager, monkeypatch, tmp_path) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    mapped = Mapped(small(), (1,))
    mapped(POINTS, HELD)
    assert same(mapped(POINTS, HELD)[0], interpreted(small(), (1,), POINTS, HELD)[0])
    assert not mapped.compiled


@needs_compiler
def test_the_oldest_libraries_and_abandoned_work_go(eager, cache, monkeypatch) -> None:
    monkeypatch.setattr("symfive.compiled._cache.MOST", 2)
    Mapped(small(0.5), (1,))(POINTS, HELD)
    (first,) = files(cache)
    os.utime(first.parent, (1.0, 1.0))
    (cache / "work-abandoned").mkdir()
    os.utime(cache / "work-abandoned", (1.0, 1.0))
    for scale in (2.0, 3.0):
        Mapped(small(scale), (1,))(POINTS, HELD)
    assert not first.exists() and len(files(cache)) == 2
    assert not list(cache.glob("work-*"))


CONCURRENT = """
import hashlib, sys
import casadi as ca, numpy as np
from symfive.compiled import Mapped, _mapped, status
for name in ("LOOKED_UP_S", "LOOKED_UP_OPERATION_S", "COMPILED_S", "COMPILED_OPERATION_S"):
    setattr(_mapped, name, 0.0)
x = ca.SX.sym("x", 2)
points, found = np.random.default_rng(0).normal(size=(203, 2)), hashlib.sha256()
print("ready", flush=True)
sys.stdin.readline()
for scale in range(1, 6):
    mapped = Mapped(ca.Function("f", [x], [ca.sin(scale * x) * x[0]]))
    mapped(points)
    assert mapped.compiled, status()
    found.update(mapped(points)[0].tobytes())
print(found.hexdigest(), status().compiled + status().loaded)
"""


@needs_compiler
def test_two_processes_at_once(cache) -> None:
    command = [sys.executable, "-c", CONCURRENT]
    both = [subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    for process in both:
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
    for process in both:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    said = [process.communicate(timeout=120)[0].split() for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert said[0] == said[1] and said[0][1] == "5"
    assert len(list(cache.iterdir())) == 5
    assert all(hashlib.sha256(path.read_bytes()).hexdigest() == path.stem for path in files(cache))


@needs_compiler
def test_threads_may_share_a_function(eager) -> None:
    mapped, expected = Mapped(small(), (1,)), interpreted(small(), (1,), POINTS, HELD)[0]
    wrong: list[int] = []

    def work() -> None:
        wrong.extend(i for i in range(200) if not same(mapped(POINTS, HELD)[0], expected))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong and mapped.compiled


# ---- small things


def test_the_source_holds_numbers_only() -> None:
    """No name of a user's file reaches the compiler."""
    machine = replace(preset("table-bc"), name='evil"); system("id'[:60])
    model = Model(campaign_of(machine, r_test_grid(machine)))
    run = model.campaign.runs[0]
    text = source_of(model._function(run)._table(True), (1, 2, 3)).text
    text = re.sub(r"/\*.*?\*/|^#.*?$", "", text, flags=re.DOTALL | re.MULTILINE)
    own = {"x", "y", "c", "v", "w", "zero", "row", "rows", "given", "results", "work", "used", "lanes", "lane", "gather",
           "scatter", "one_vector", "flag", "where", "lane_pairs", "sin", "cos", "symfive_rows", "symfive_work"}  # fmt: skip
    body = text[text.index("static void one_vector") :]
    names = set(re.findall(r"[A-Za-z_]\w*", re.sub(r"\b[\d.]+(e[-+]?\d+)?U?\b", "", body)))
    rest = {name for name in names - own if not re.fullmatch(r"[txk]\d+|x\d+_\d*|LANES|UNUSED", name)}
    assert rest <= {"const", "double", "size_t", "static", "void", "restrict", "return", "sizeof", "for"}, rest
    assert '"' not in body and "evil" not in text


def test_pickles_and_other_shapes(eager) -> None:
    mapped = pickle.loads(pickle.dumps(Mapped(small(), (1,))))
    assert same(mapped(POINTS, HELD)[0], interpreted(small(), (1,), POINTS, HELD)[0])
    for inputs in ((POINTS, HELD[:2]), (POINTS[:, :1], HELD), (POINTS, np.tile(HELD, (203, 1)))):
        with pytest.raises(ValueError, match="shapes"):
            mapped(*inputs)
