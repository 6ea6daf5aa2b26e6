"""BLAS computes with one thread inside symfive, whenever its library was loaded, and as before outside."""

import sys
from types import ModuleType

import pytest
import scipy.linalg  # noqa: F401 - brings a BLAS of its own
from threadpoolctl import ThreadpoolController, threadpool_info, threadpool_limits

from symfive import threads
from symfive.threads import one_thread


def counts() -> list[int]:
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]


def test_one_thread_inside_and_the_callers_own_outside() -> None:
    with threadpool_limits(limits=2, user_api="blas"):
        before = counts()
        inside = one_thread(lambda: (counts(), one_thread(counts)(), counts()))()
        assert counts() == before and before
    assert inside == ([1] * len(before),) * 3


def test_the_callers_own_after_an_error() -> None:
    with threadpool_limits(limits=2, user_api="blas"):
        before = counts()
        with pytest.raises(ZeroDivisionError):
            one_thread(lambda: 1 / 0)()
        assert counts() == before


def test_loaded_libraries_are_looked_for_anew_only_after_an_import(monkeypatch: pytest.MonkeyPatch) -> None:
    looked = []
    monkeypatch.setattr(threads, "ThreadpoolController", lambda: looked.append(1) or ThreadpoolController())
    nothing = one_thread(lambda: None)
    for number, name in enumerate(("a_blas", "another_blas"), start=1):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
        for _ in range(3):
            nothing()
        assert len(looked) == number
