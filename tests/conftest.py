"""Nothing here compiles for the user's cache: `SYMFIVE_COMPILER=cc` in the environment lets every test do so."""

import os

import pytest
from progress import Progress

os.environ.setdefault("SYMFIVE_COMPILER", "none")


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Say every half minute how far the tests are; once, not by every worker."""
    terminal = config.pluginmanager.get_plugin("terminalreporter")
    if terminal is None or hasattr(config, "workerinput") or config.getoption("verbose") < 0:
        return

    config.pluginmanager.register(Progress(lambda line: terminal.write(f"\n{line}\n")), "progress")
