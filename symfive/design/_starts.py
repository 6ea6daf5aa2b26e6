"""The starts of a search on the workers of any executor.

What crosses is plain: machine, noise, set-up errors and task as bytes, a few numbers of the start, the design that comes back.
Every process makes the space from it once. So a start gives the same design wherever it runs.
"""

from __future__ import annotations

import functools
import io
import pickle
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from symfive.design._space import Space, make_space
from symfive.executors import Inline, results
from symfive.optimal import Task
from symfive.threads import one_thread
from symfive.validation import freeze

T = TypeVar("T")


def each(
    pool: Executor | None, function: Callable[..., T], space: Space, task: Task, calls: Sequence[tuple[Any, ...]]
) -> list[T]:
    """`function(space, task, *call)` of every call, in their order; `space` is as `make_space` makes it.

    Without a pool in this process. Raises what the first of the calls raised that failed.
    """
    if pool is None or isinstance(pool, Inline):
        return [function(space, task, *call) for call in calls]
    packed = _packed((space.machine, space.instrument, space.noise_um, space.setup_sigma), task)
    return results(pool, _there, [(packed, function, *call) for call in calls])


@one_thread
def _there(packed: bytes, function: Callable[..., T], *call: Any) -> T:
    """The same call in a worker."""
    return function(*_unpacked(packed), *call)


@functools.lru_cache(maxsize=1)
def _unpacked(packed: bytes) -> tuple[Space, Task]:
    (machine, instrument, noise_um, setup_sigma), task = pickle.loads(packed)
    return make_space(machine, instrument, noise_um=noise_um, setup_sigma=setup_sigma), task


def _packed(*parts: Any) -> bytes:
    file = io.BytesIO()
    _Pickler(file).dump(parts)
    return file.getvalue()


class _Pickler(pickle.Pickler):
    """Knows the read-only mappings of a machine, and keeps the order of an array's axes in memory: sums follow it."""

    def reducer_override(self, item: Any) -> Any:
        if isinstance(item, MappingProxyType):
            return freeze, (dict(item),)
        if isinstance(item, np.ndarray) and not item.flags.forc:
            order = np.argsort(item.strides, kind="stable")[::-1]
            return np.transpose, (np.ascontiguousarray(item.transpose(order)), np.argsort(order))
        return NotImplemented
