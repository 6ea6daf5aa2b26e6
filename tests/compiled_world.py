"""What tests of compiled functions share: a memory of their own, a small function, the interpreter, compilers that lie."""

import shutil
from collections import Counter
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from symfive.compiled import Mapped, _mapped
from symfive.model import _assembly  # its memory is emptied

SWITCH = "SYMFIVE_COMPILER"
PROGRAM = next((name for name in ("cc", "gcc", "clang") if shutil.which(name)), None)
needs_compiler = pytest.mark.skipif(PROGRAM is None, reason="no C compiler is installed")
POINTS = np.random.default_rng(0).normal(size=(203, 2)) * 30.0
HELD = np.array([0.3, -2.0, 0.7])


@pytest.fixture(autouse=True)
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
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


def same(one: np.ndarray, other: np.ndarray) -> bool:
    """To the last bit, signs of zeros included; what is not a number is one as the other."""
    numbers = ~np.isnan(one)
    return np.array_equal(one, other, equal_nan=True) and np.array_equal(
        np.signbit(one[numbers]), np.signbit(other[numbers])
    )


def fake(folder: Path, text: str) -> str:
    """A compiler of one's own."""
    path = folder / "fake-cc"
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)
