"""The seam to parallel computing: results do not depend on the engine, on the number of workers or on workers that die."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from processes import PATIENCE_S, ended, gone, local_cluster, until

from symfive import executors
from symfive.errors import InputError
from symfive.executors import DEATHS, Inline, Processes, connect, executor, finished, results
from symfive.identify import identify
from symfive.machine import preset
from symfive.procedures import campaign_of, r_test_grid
from symfive.simulate import simulate

CASES = 12
DASK_S = 30.0
"""After which Dask itself gives up a scheduler that does not answer."""


# --- tasks -------------------------------------------------------------------------------------------------
def drawn(seed: int, number: int) -> tuple[float, ...]:
    """What a case draws follows from its number: the child that `SeedSequence(seed).spawn` gives it."""
    generator = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
    return tuple(generator.normal(size=3))


def machine(number: int) -> tuple[float, ...]:
    """One machine of a Monte Carlo: simulated and identified."""
    made = preset("oyama-2010")
    measured = simulate(campaign_of(made, r_test_grid(made, step_deg=90.0)), seed=number)
    result = identify(measured.campaign)
    return (*result.values, *result.std)


def noted(folder: Path, gate: Path, seed: int, number: int) -> tuple[float, ...]:
    """A case that leaves a mark where it began, and ends once the gate is there."""
    (folder / f"{number}-{os.getpid()}").touch()
    until(gate.exists)
    return drawn(seed, number)


def dies_first(folder: Path, number: int) -> int:
    """Kills its process at the first trial."""
    mark = folder / str(number)
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def dies_at(fatal: int, number: int) -> int:
    """One number kills its process whenever it is tried."""
    if number == fatal:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def fails(number: int) -> float:
    """An error of the task."""
    return 1.0 / number


def whole(pool: Any, function: Any, tasks: Any) -> list[Any]:
    """All outcomes in the order of the tasks."""
    return [outcome for _, outcome in sorted(finished(pool, function, tasks), key=lambda pair: pair[0])]


def serial(function: Any, *arguments: Any) -> list[Any]:
    return [function(*arguments, number) for number in range(CASES)]


# --- in this process and in local ones ---------------------------------------------------------------------
@pytest.mark.parametrize("workers", [0, 1, pytest.param(3, marks=pytest.mark.slow)])
def test_results_do_not_depend_on_the_number_of_workers(workers: int) -> None:
    children = np.random.SeedSequence(5).spawn(CASES)
    assert drawn(5, 7) == tuple(np.random.default_rng(children[7]).normal(size=3))
    with executor(workers) as pool:
        assert whole(pool, drawn, [(5, number) for number in range(CASES)]) == serial(drawn, 5)


def test_an_error_is_an_outcome_and_stops_no_other() -> None:
    with Inline() as pool:
        zero, one = whole(pool, fails, [(0,), (1,)])
    assert isinstance(zero, ZeroDivisionError)
    assert one == 1.0


def test_work_of_which_every_part_is_needed_comes_in_order_or_ends_in_its_first_error() -> None:
    with Inline() as pool:
        assert results(pool, fails, [(4,), (2,), (1,)]) == [0.25, 0.5, 1.0]
        with pytest.raises(ZeroDivisionError):
            results(pool, fails, [(1,), (0,), ("x",)])
        with pytest.raises(TypeError):
            results(pool, fails, [(1,), ("x",), (0,)])


@pytest.mark.slow
def test_a_task_whose_process_is_killed_begins_again(tmp_path: Path) -> None:
    with Processes(2) as pool:
        assert whole(pool, dies_first, [(tmp_path, number) for number in range(3)]) == [0, 1, 2]


@pytest.mark.slow
def test_a_task_that_always_kills_ends_in_an_error_of_its_own() -> None:
    with Processes(2) as pool:
        *others, last = whole(pool, dies_at, [(4, number) for number in range(5)])
        with pytest.raises(InputError, match="workers died again and again under the same task; take fewer workers"):
            results(pool, dies_at, [(1, number) for number in range(3)])
    assert others == [0, 1, 2, 3]
    assert isinstance(last, BrokenProcessPool)


@pytest.mark.slow
def test_fresh_processes_are_not_used_twice() -> None:
    with Processes(1, fresh=True) as pool:
        pids = whole(pool, os.getpid, [(), ()])
    assert len({os.getpid(), *pids}) == 3


def test_who_leaves_early_leaves_no_tasks_behind(tmp_path: Path) -> None:
    marks, gate = tmp_path / "marks", tmp_path / "gate"
    marks.mkdir()
    with Processes(1) as pool:
        for _ in finished(pool, noted, [(marks, gate if number else marks, 1, number) for number in range(50)]):
            break
        gate.touch()
    assert len(list(marks.iterdir())) <= 2, "the one that is done, and the one that had begun"


@pytest.mark.slow
def test_processes_end_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from pathlib import Path\n"
        "from test_executors import *\n"
        "if __name__ == '__main__':\n"
        "    with Processes(1) as pool: list(finished(pool, noted, [(Path(sys.argv[2]), Path('never'), 1, 0)]))\n"
    )
    (tmp_path / "parent.py").write_text(code)
    marks = tmp_path / "marks"
    marks.mkdir()
    with ended(subprocess.Popen([sys.executable, tmp_path / "parent.py", Path(__file__).parent, marks])):
        [mark] = until(lambda: list(marks.iterdir()))
    until(lambda: gone(int(mark.name.split("-")[1])), 0.5 * PATIENCE_S)  # its case would end only then


def test_sentences_of_what_cannot_be_had(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="-1 workers cannot work; write --workers 1"):
        executor(-1)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"needs Dask, which is not installed; install .*pip install distributed"):
        executor(2, "tcp://127.0.0.1:8786")


# --- on a Dask cluster -------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    with local_cluster(tmp_path_factory.mktemp("dask"), n_workers=3) as running:
        yield running


@pytest.mark.slow
def test_a_monte_carlo_is_the_same_on_the_cluster(cluster: Any) -> None:
    with connect(cluster.scheduler_address) as pool:
        assert whole(pool, drawn, [(5, number) for number in range(CASES)]) == serial(drawn, 5)
        assert whole(pool, machine, [(number,) for number in range(4)]) == [machine(number) for number in range(4)]
        zero, one = whole(pool, fails, [(0,), (1,)])
    assert isinstance(zero, ZeroDivisionError)
    assert one == 1.0


@pytest.mark.slow
def test_a_worker_killed_in_the_middle_loses_nothing(cluster: Any, tmp_path: Path) -> None:
    marks, gate = tmp_path / "marks", tmp_path / "gate"
    marks.mkdir()

    def kill() -> str:
        case, pid = until(lambda: list(marks.iterdir()))[0].name.split("-")
        os.kill(int(pid), signal.SIGKILL)
        until(lambda: gone(int(pid)))
        gate.touch()  # no case ended before
        return case

    with ThreadPoolExecutor(1) as beside, connect(cluster.scheduler_address) as pool:
        killed = beside.submit(kill)
        assert whole(pool, noted, [(marks, gate, 5, number) for number in range(CASES)]) == serial(drawn, 5)
    assert len(list(marks.glob(f"{killed.result()}-*"))) == 2, "the case was begun a second time, elsewhere"


@pytest.mark.slow
def test_a_task_that_kills_every_worker_ends_in_an_error(tmp_path: Path) -> None:
    with local_cluster(tmp_path, n_workers=2) as running, connect(running.scheduler_address) as pool:
        [outcome] = whole(pool, os._exit, [(1,)])
        with pytest.raises(InputError, match="workers died again and again under the same task"):
            results(pool, os._exit, [(1,)])
    assert type(outcome).__name__ == "KilledWorker"
    assert f"{DEATHS} different workers" in str(outcome)


@pytest.mark.slow
def test_a_lost_scheduler_is_one_sentence(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="the extra dask is not installed")
    file = tmp_path / "scheduler.json"
    words = ("-m", "dask", "scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
    with ended(subprocess.Popen([sys.executable, *words], stderr=subprocess.DEVNULL)) as scheduler:
        said = until(lambda: file.is_file() and file.read_text())  # the file is there before its words are
        with connect(json.loads(said)["address"]) as pool:

            def tasks() -> Iterator[tuple[()]]:
                yield from [(), ()]  # they wait: there is no worker
                scheduler.kill()

            with pytest.raises(InputError, match="scheduler is gone; start it again and repeat the command"):
                next(finished(pool, os.getpid, tasks()))


@pytest.mark.slow
def test_workers_of_several_threads_are_refused(tmp_path: Path) -> None:
    with (
        local_cluster(tmp_path, n_workers=1, threads_per_worker=2) as running,
        pytest.raises(InputError, match=r"has 2 threads; start it with .*--nthreads 1"),
    ):
        connect(running.scheduler_address)


def test_an_address_without_a_scheduler_ends_in_one_sentence_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="the extra dask is not installed")
    monkeypatch.setattr(executors, "ANSWER_S", 2.0)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        begin = time.monotonic()
        for address in ("nonsense", "", f"tcp://127.0.0.1:{silent.getsockname()[1]}"):
            with pytest.raises(InputError, match=r"no Dask scheduler answers at .*; start one with") as error:
                connect(address)
            assert "\n" not in str(error.value)
        assert time.monotonic() - begin < DASK_S
