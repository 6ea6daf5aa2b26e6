"""Compiled functions over rows: used when they pay, never where they cannot be trusted."""

import hashlib
import math
import os
import pickle
import re
import subprocess
import sys
import threading
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import casadi as ca
import compiled_world
import numpy as np
import pytest
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
from processes import ended

from symfive.compiled import Mapped, _mapped, status
from symfive.machine import preset
from symfive.model import Model
from symfive.procedures import campaign_of, r_test_grid

cache, eager = compiled_world.cache, compiled_world.eager  # fixtures


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*/*.so"))


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
    for name in ("COMPILED_S", "COMPILED_OPERATION_S", "LOOKED_UP_S", "LOOKED_UP_OPERATION_S"):
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
    mapped = Mapped(small(), (1,))
    if open_one == "library":
        mapped(POINTS, HELD)
        assert (status().loaded, status().compiled) == (0, 2), "made anew, not loaded"
        return
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
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with ExitStack() as stack:
        both = [stack.enter_context(ended(subprocess.Popen(command, **pipes))) for _ in range(2)]
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


@needs_compiler
def test_the_source_holds_numbers_only(eager, monkeypatch, tmp_path) -> None:
    """No name of a user's file reaches the compiler."""
    machine = replace(preset("table-bc"), name='evil"); system("id'[:60])
    model = Model(campaign_of(machine, r_test_grid(machine)))
    run = model.campaign.runs[0]
    kept = tmp_path / "kept.c"
    monkeypatch.setenv(
        SWITCH, fake(tmp_path, f'case "$*" in *-dM*) exec cc "$@";; esac; cp rows.c {kept}; exec cc "$@"')
    )
    model.linearise(run, model.start)
    text = kept.read_text()
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
