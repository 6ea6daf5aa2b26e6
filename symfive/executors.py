"""The one seam to parallel computing: any executor with `submit` runs a study, a fleet, a Monte Carlo, a plan's starts.

A task is a function that can be imported and its plain arguments; what it draws at random follows from its own number.
So results depend neither on the executor, nor on the number of workers, nor on how often a task was begun.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from queue import SimpleQueue
from typing import Any

from symfive.errors import InputError

__all__ = ["DEATHS", "Inline", "Processes", "connect", "executor", "finished", "results"]

DEATHS = 4
"""A task ends in an error when so many processes have died under it; Dask's own default, too."""
MOST_WORKERS = 1024
"""Processes of one computer; more computers are a scheduler's."""
ANSWER_S = 5.0
"""A scheduler answers within so many seconds."""
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


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


class Processes(ThreadPoolExecutor):
    """`workers` processes of this computer, of one thread each; `fresh` starts a new one for every task.

    The standard library's pool loses all that waits when one process dies. Here every process is a pool of its own, and a
    task whose process died begins again in a new one.
    """

    def __init__(self, workers: int, *, fresh: bool = False) -> None:
        super().__init__(workers)
        self._fresh = fresh
        self._idle: SimpleQueue[ProcessPoolExecutor | None] = SimpleQueue()
        for _ in range(workers):
            self._idle.put(None)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The future of a call in one of the processes."""
        return super().submit(self._call, fn, args, kwargs)

    def _call(self, fn: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
        process = self._idle.get()
        try:
            for death in range(1, DEATHS + 1):
                process = process or _process()
                try:
                    return process.submit(fn, *args, **kwargs).result()
                except BrokenProcessPool:
                    process = None
                    if death == DEATHS:
                        raise
        finally:
            if process and self._fresh:
                process.shutdown(wait=False)
            self._idle.put(None if self._fresh else process)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the processes when their tasks are done."""
        super().shutdown(wait, cancel_futures=cancel_futures)
        while not self._idle.empty():
            if process := self._idle.get():
                process.shutdown(wait)


def _process() -> ProcessPoolExecutor:
    os.environ |= THREADS  # a new process reads them before it loads BLAS; this one has done so
    return ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), initializer=_end_with_parent)


def _end_with_parent() -> None:
    """A process whose parent was killed would wait for tasks for ever."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class _Cluster(Executor):
    """The workers of a Dask scheduler."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._tasks = client.get_executor(pure=False)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The future of a call on one of the workers."""
        future: Future[Any] = self._tasks.submit(fn, *args, **kwargs)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leaves the scheduler; it and its workers go on."""
        self._tasks.shutdown(wait and not cancel_futures)
        self._client.close()


def connect(scheduler: str) -> Executor:
    """The workers of a running Dask scheduler, as "tcp://host:8786".

    The scheduler gives the tasks of a worker that died to the others (its setting `allowed-failures`: three deaths are
    forgiven). A worker must have one thread: Matplotlib, for one, may not run in two. Raises `InputError`.
    """
    import asyncio

    try:
        import distributed
    except ImportError:
        problem = "a scheduler needs Dask, which is not installed"
        raise InputError(problem, remedy='install the extra "dask": pip install distributed') from None
    try:
        with ThreadPoolExecutor(1) as thread:  # a notebook has a loop of its own in this thread
            known = thread.submit(asyncio.run, _greet(scheduler)).result()
        if not str(known["type"]).endswith("Scheduler"):
            raise ValueError(f"it is a {known['type']}")
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # `finished` says it in one sentence
        client = distributed.Client(scheduler, timeout=ANSWER_S, set_as_default=False)
    except Exception as error:  # a name, a port, TLS, silence, or an answer that is none of Dask's
        problem = f"no Dask scheduler answers at {scheduler} ({str(error).rstrip('.') or 'silence'})"
        raise InputError(
            problem, remedy="start one with `dask scheduler` and name its address, as tcp://host:8786"
        ) from None
    crowded = [name for name, worker in known["workers"].items() if worker["nthreads"] != 1]
    if crowded:
        client.close()
        problem = f"worker {crowded[0]} has {known['workers'][crowded[0]]['nthreads']} threads"
        raise InputError(
            problem, remedy="start it with `dask worker --nworkers 2 --nthreads 1`, or as many as it has cores"
        )
    return _Cluster(client)


async def _greet(scheduler: str) -> Any:
    """What the scheduler says of itself and its workers."""
    import asyncio

    from distributed import Security, rpc

    async with asyncio.timeout(ANSWER_S):
        arguments = Security().get_connection_args("client")
        async with rpc(scheduler, timeout=ANSWER_S - 1.0, connection_args=arguments) as answers:
            return await answers.identity()


def executor(workers: int, scheduler: str | None = None, *, fresh: bool = False) -> Executor:
    """The scheduler's workers if one is named, else `workers` local processes; 0: in this process."""
    if scheduler is not None:
        return connect(scheduler)
    if workers > MOST_WORKERS:
        raise InputError(f"{workers} workers are more than {MOST_WORKERS}", remedy="write as many as there are cores")
    if workers < 0:
        raise InputError(f"{workers} workers cannot work", remedy="write --workers 1 or more, or 0 for this process")
    return Processes(workers, fresh=fresh) if workers else Inline()


def finished(
    pool: Executor, function: Callable[..., Any], tasks: Iterable[tuple[Any, ...]]
) -> Iterator[tuple[int, Any]]:
    """Number of the task and what it returned, or the exception it raised, as they end; who leaves early cancels the rest.

    Raises `InputError` where the scheduler is lost.
    """
    waiting = {pool.submit(function, *task): number for number, task in enumerate(tasks)}
    try:
        for future in as_completed(waiting):
            number = waiting.pop(future)  # and its result is nobody's but the caller's
            try:
                outcome = future.result()
            except CancelledError:
                problem = "the tasks were given up, as the scheduler is gone"
                raise InputError(problem, remedy="start it again and repeat the command") from None
            except Exception as error:
                outcome = error
            yield number, outcome
    finally:
        for future in waiting:
            future.cancel()


def results(pool: Executor, function: Callable[..., Any], tasks: Iterable[tuple[Any, ...]]) -> list[Any]:
    """What the tasks returned, in their order, for work of which every part is needed.

    Raises what the first of them raised, in that order, and `InputError` where the workers died under it.
    """
    outcomes = sorted(finished(pool, function, tasks), key=lambda outcome: outcome[0])
    for _, outcome in outcomes:
        if isinstance(outcome, BrokenProcessPool) or type(outcome).__name__ == "KilledWorker":  # the latter is Dask's
            problem = "workers died again and again under the same task"
            raise InputError(problem, remedy="take fewer workers, or give them more memory") from outcome
        if isinstance(outcome, Exception):
            raise outcome
    return [outcome for _, outcome in outcomes]
