"""What tests compile lies in a folder of the run, cold at first and shared by workers; `SYMFIVE_COMPILER=none` forbids it."""

import gc
import os
import shutil
import tempfile
from collections.abc import Generator
from pathlib import Path

import pytest
from progress import Progress

FOLDER = "SYMFIVE_TESTS_CACHE"
"""The environment variable by which the workers know it."""


def _own_cache() -> None:
    """A cache of this run alone: the user's holds what other trees compiled. Matplotlib keeps its list of fonts."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    os.environ.setdefault("MPLCONFIGDIR", str(Path(home) / "matplotlib"))
    os.environ[FOLDER] = os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp(prefix="symfive-tests-")


MADE = FOLDER not in os.environ
if MADE:
    _own_cache()
gc.disable()  # until all tests are collected: modules are not garbage


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    """Look for garbage among what tests make, seldom, and not in the half million objects of modules and test functions."""
    gc.freeze()
    gc.set_threshold(20_000, 10, 10)
    gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, bool | None, bool | None]:
    """What runs LinuxCNC's realtime, of which a computer has one, waits for the other workers' tests that do."""
    if item.get_closest_marker("linuxcnc") is None:
        return (yield)
    import fcntl  # POSIX alone has it, and LinuxCNC

    with (Path(os.environ[FOLDER]) / "realtime").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        return (yield)


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Say every half minute how far the tests are; once, not by every worker."""
    terminal = config.pluginmanager.get_plugin("terminalreporter")
    if terminal is None or hasattr(config, "workerinput") or config.getoption("verbose") < 0:
        return

    config.pluginmanager.register(Progress(lambda line: terminal.write(f"\n{line}\n")), "progress")


def pytest_unconfigure(config: pytest.Config) -> None:
    """The cache goes with the run that made it."""
    if MADE:
        shutil.rmtree(os.environ[FOLDER], ignore_errors=True)
