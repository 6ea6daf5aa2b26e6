"""One BLAS thread while symfive computes.

Its matrices are tall and narrow or small: two threads gain nothing on them, and a dot product of 20,000 numbers costs
sixty times as much when a second thread has to be waited for on a busy machine.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
R = TypeVar("R")


def one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """The function with BLAS held to one thread while it runs; the caller's setting comes back afterwards."""

    @functools.wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        with _libraries(len(sys.modules)).limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


@functools.lru_cache(maxsize=1)
def _libraries(modules: int) -> Any:
    """The BLAS libraries of this process: a walk over all that it has loaded, so anew only once it has imported more."""
    return ThreadpoolController()
