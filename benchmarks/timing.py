"""The benchmarks' stopwatch: processor time, which other programs on the computer hardly lengthen."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any


def timed(work: Callable[[], Any], repeat: int = 3) -> tuple[float, Any]:
    """Least processor time of a few calls, s, and the result."""
    best, result = float("inf"), None
    for _ in range(repeat):
        start = time.process_time()
        result = work()
        best = min(best, time.process_time() - start)
    return best, result
