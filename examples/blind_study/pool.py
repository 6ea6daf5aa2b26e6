"""The one seam to parallel computing: anything with `submit` of concurrent.futures can run the study."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import traceback
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from typing import Any


class Inline(Executor):
    """Runs at once in this process: for tests and for finding faults."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """A finished future."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def executor(workers: int) -> Executor:
    """`workers` processes of one thread each, every task in a fresh one; 0: in this process."""
    if workers == 0:
        return Inline()
    os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), max_tasks_per_child=1)


def run(pool: Executor, stage: Callable[..., None], tasks: Iterable[tuple[Any, ...]]) -> Iterator[tuple[str, str]]:
    """Case and error (empty if none) as the tasks end; the last argument of a task is its case."""
    waiting = [pool.submit(_call, stage.__module__, stage.__name__, task) for task in tasks]
    for future in as_completed(waiting):
        yield future.result()


def _call(module: str, function: str, task: tuple[Any, ...]) -> tuple[str, str]:
    """Imports in the worker, so that code which cannot even be imported is an error of the case and not of the study."""
    try:
        getattr(importlib.import_module(module), function)(*task)
    except Exception:
        return task[-1], traceback.format_exc()
    return task[-1], ""
