"""Processes that tests start: they end with the test, and are waited for by what they do, not by the clock."""

import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import pytest

PATIENCE_S = 60.0
"""What a loaded computer may take; where all is well nobody waits so long."""
T = TypeVar("T")


def until(ask: Callable[[], T], seconds: float = PATIENCE_S) -> T:
    """The first true answer."""
    end = time.monotonic() + seconds
    while not (answer := ask()):
        assert time.monotonic() < end, "nothing came"
        time.sleep(0.05)
    return answer


def gone(pid: int) -> bool:
    """Whether a process has ended, be it that its parent does not ask for it."""
    try:
        return (Path("/proc") / str(pid) / "stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


@contextmanager
def ended(process: subprocess.Popen[Any]) -> Iterator[subprocess.Popen[Any]]:
    """A process that is killed where the block ends, also by a failure: no other test hears of it."""
    with process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def local_cluster(folder: Path, **options: Any) -> Iterator[Any]:
    """Worker processes of a real scheduler on this computer."""
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    own = {"threads_per_worker": 1, "dashboard_address": ":0", "local_directory": str(folder)}
    with distributed.LocalCluster(**own | options) as running:
        try:
            yield running
        finally:
            until(lambda: len(running.scheduler.workers) == len(running.workers))  # Dask cannot end what it restarts
