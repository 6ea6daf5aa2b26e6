"""A line every half minute: how many tests are done, and how long it has taken."""

import time
from collections.abc import Callable

import pytest

EVERY_S = 30.0


class Progress:
    """A plugin of pytest. `say` prints a line, `now` is the clock in s."""

    def __init__(self, say: Callable[[str], None], now: Callable[[], float] = time.monotonic) -> None:
        self._say, self._now = say, now
        self._begin = self._last = now()
        self._all = self._done = self._failed = 0

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        self._all = max(self._all, len(session.items))

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, ids: list[str]) -> None:
        self._all = len(ids)  # every worker collects all of them

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._failed += report.failed
        self._done += report.when == "teardown"
        if self._now() - self._last < EVERY_S:
            return
        self._last = self._now()
        minutes, seconds = divmod(round(self._last - self._begin), 60)
        failed = f", {self._failed} failed" if self._failed else ""
        self._say(f"{self._done} of {self._all} tests done after {minutes} min {seconds:02} s{failed}")
