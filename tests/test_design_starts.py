"""The starts of a search on workers: the same design bit for bit, whoever computes it and whoever dies."""

import json
import os
import signal
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from processes import local_cluster

from symfive.cli import main
from symfive.design import Space, make_space, optimise, task_of
from symfive.design._optimise import each  # starts that fail at will
from symfive.errors import InputError
from symfive.executors import Processes, connect
from symfive.machine import Machine, preset
from symfive.optimal import Task
from symfive.threads import one_thread

STARTS = 4


def _small() -> Machine:
    """Location errors of the rotary axes only."""
    machine = preset("table-bc")
    errors = {k: v for k, v in machine.errors.items() if v.is_location and machine.axes[v.axis].rotary}
    return replace(machine, errors=errors, text="")


def _sought(instrument: str, criterion: str) -> tuple[Space, Task]:
    space = make_space(_small(), instrument)
    return space, task_of(space, criterion, [p.name for p in space.shared], None)


def _bits(space: Space, task: Task, pool: Executor | None, told: list[str] | None = None) -> tuple[bytes, ...]:
    """Everything that a search finds."""
    progress = (lambda message: None) if told is None else told.append
    rows, values = one_thread(optimise)(space, task, 10, 2, starts=STARTS, seed=3, pool=pool, progress=progress)
    return rows.z.tobytes(), rows.k.tobytes(), rows.group.tobytes(), np.array(values).tobytes()


@pytest.fixture(scope="module")
def serial() -> tuple[Space, Task, tuple[bytes, ...], list[str]]:
    """Criterion G: its weights lie in memory in an order of their own, which sums follow."""
    (space, task), told = _sought("r_test", "G"), list[str]()
    return space, task, _bits(space, task, None, told), told


@pytest.mark.slow
def test_a_design_is_the_same_on_another_executor(serial: tuple[Space, Task, tuple[bytes, ...], list[str]]) -> None:
    space, task, expected, messages = serial
    told: list[str] = []
    with ThreadPoolExecutor(1) as pool:
        assert _bits(space, task, pool, told) == expected
    assert told == messages and "8 of 8 designs refined" in told[0]


@pytest.mark.slow
@pytest.mark.parametrize(("instrument", "criterion"), [("r_test", "D"), ("r_test", "V"), ("ball_bar", "E")])
def test_a_design_is_the_same_on_two_processes(instrument: str, criterion: str) -> None:
    space, task = _sought(instrument, criterion)
    with Processes(2) as pool:
        assert _bits(space, task, pool) == _bits(space, task, None)


def killed_once(mark: Path, function: Callable[..., Any], *arguments: Any) -> Any:
    """The call, whose process is killed at the first trial."""
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return function(*arguments)


class Deadly(Executor):
    """Processes that die under the first trial of every fifth task."""

    def __init__(self, inner: Executor, folder: Path) -> None:
        self.inner, self.folder, self.count = inner, folder, 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.count += 1
        if self.count % 5:
            return self.inner.submit(fn, *args, **kwargs)
        return self.inner.submit(killed_once, self.folder / str(self.count), fn, *args, **kwargs)


@pytest.mark.slow
def test_a_design_is_the_same_when_workers_are_killed(
    serial: tuple[Space, Task, tuple[bytes, ...], list[str]], tmp_path: Path
) -> None:
    space, task, expected, _ = serial
    with Processes(2) as pool:
        deadly = Deadly(pool, tmp_path)
        assert _bits(space, task, deadly) == expected
    assert len(list(tmp_path.iterdir())) == deadly.count // 5 > 1


@pytest.mark.slow
def test_a_design_is_the_same_on_a_cluster(
    serial: tuple[Space, Task, tuple[bytes, ...], list[str]], tmp_path: Path
) -> None:
    space, task, expected, _ = serial
    with local_cluster(tmp_path, n_workers=2) as running, connect(running.scheduler_address) as pool:
        assert _bits(space, task, pool) == expected


def refused(space: Space, task: Task, number: int) -> int:
    """What a start raises that finds no pose."""
    if number:
        raise InputError(f"start {number} fails", remedy="change the machine")
    return len(space.shared)


def test_the_first_start_that_fails_says_why() -> None:
    space, task = _sought("r_test", "G")
    with ThreadPoolExecutor(1) as pool:
        assert each(pool, refused, space, task, [(0,)]) == [len(space.shared)]
        for some in (pool, None):
            with pytest.raises(InputError, match="start 2 fails; change the machine"):
                each(some, refused, space, task, [(0,), (2,), (1,)])


@pytest.mark.slow
def test_plans_on_workers_are_the_same_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["plan", "table-bc", "--points", "10", "--starts", "3", "-q"]
    for name, more in (("serial", []), ("workers", ["--workers", "2"])):
        assert main([*words, "-o", str(tmp_path / name), *more]) == 0
    files = sorted(p.relative_to(tmp_path / "serial") for p in (tmp_path / "serial").rglob("*.csv"))
    assert files
    for file in files:
        assert (tmp_path / "serial" / file).read_bytes() == (tmp_path / "workers" / file).read_bytes()
    starts = [
        json.loads((tmp_path / n / "plan.json").read_text())["certificate"]["starts"] for n in ("serial", "workers")
    ]
    assert len(starts[0]) == 6 and starts[0] == starts[1]


def test_workers_that_cannot_be_had_are_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", "table-bc", "-o", str(tmp_path / "plan"), "--workers", "-1"]) == 2
    assert "-1 workers cannot work; write --workers 1 or more" in capsys.readouterr().err
