"""The noises that may be about a fit: the usual nodes and, between them, what the readings know better.

The noise of a thousand readings is known to a few percent, and then the log evidence of the nearest of a few nodes may be twenty
nats too low: the more of what noise does passes for something else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from symfive.arrays import Array
from symfive.effects import Form
from symfive.identify import Identification
from symfive.posterior._evidence import log_evidence
from symfive.posterior._explore import held_by
from symfive.posterior._moments import Known, of_electronics, usual_noises
from symfive.posterior._noise import DECADE, HALF, Node, share_of

__all__ = ["noises_of"]

LogEvidence = Callable[[Sequence[Node]], Array]
GRIDS = 30
"""At most: each moves to a neighbour or halves its steps, which takes ten."""


def noises_of(fit: Identification, held: Sequence[Form]) -> tuple[Node, ...]:
    """The usual nodes and, of instruments, the most probable noise with what the fit holds and, where it is another one,
    without."""
    usual = usual_noises(fit)
    if not of_electronics(fit):
        return usual
    known = Known.of(fit, held)

    def log(whole: bool) -> LogEvidence:
        def by_noise(nodes: Sequence[Node]) -> Array:
            moments = known.moments(nodes)
            by_node = log_evidence(moments, held_by(moments) if whole else ()).by_node
            return np.asarray(np.logaddexp.reduce(by_node.reshape(-1, len(nodes)), axis=0))

        return by_noise

    own, other = _between(log(True), usual), _between(log(False), usual) if held else ()
    if own and other and float(np.ptp(log(False)([*own, *other]))) < 1.0:
        other = ()
    return *usual, *own, *other


def _between(log: LogEvidence, usual: Sequence[Node]) -> tuple[Node, ...]:
    """The most probable noise between the usual nodes, if it is known better than these are apart."""
    found = list[tuple[float, Node]]()
    for decades in sorted({node.decades for node in usual if node.size > 0.0}):
        own = [node for node in usual if node.size > 0.0 and node.decades == decades]
        found += _most_probable(log, own)
    return (max(found, key=lambda each: each[0])[1],) if found else ()


def _most_probable(log: LogEvidence, usual: Sequence[Node]) -> Iterator[tuple[float, Node]]:
    """The most probable noise between and about nodes of as many decades, and its log evidence with the prior of its
    neighbourhood (P.-S. Laplace 1774), if that is less than half of what a node stands for."""
    start = usual[int(np.argmax(log(usual)))]
    free = 1 if start.decades > 1 else 2
    cell = np.array([HALF, DECADE])[:free]
    places = np.log([[node.size, node.time] for node in usual])[:, :free]
    low, high = places.min(axis=0) - 0.5 * cell, places.max(axis=0) + 0.5 * cell

    def node(place: Array) -> Node:
        size, time = float(np.exp(place[0])), float(np.exp(place[1])) if free == 2 else start.time
        return Node(size, time, start.log_prior + float(np.log(share_of(size) / share_of(start.size))), start.decades)

    steps = np.array(list(product((-1.0, 0.0, 1.0), repeat=free)))
    middle, axes = len(steps) // 2, [np.abs(steps).sum(axis=1) * np.abs(steps[:, k]) == 1.0 for k in range(free)]
    at, step = np.log([start.size, start.time])[:free], 0.5 * cell
    for _ in range(GRIDS):
        points = np.clip(at + steps * step, low, high)
        values = log([node(point) for point in points])
        if values.max() > values[middle]:
            at = points[int(np.argmax(values))]
            continue
        wide = np.array([values[middle] - values[own].max() > 1.0 for own in axes])
        if not wide.any():
            break
        step = np.where(wide, 0.5 * step, step)
    top, curvature = _parabola((points - at) / step, values)
    if np.linalg.eigvalsh(curvature).max() >= 0.0:
        return
    volume = float(np.sqrt((2.0 * np.pi) ** free / np.linalg.det(-curvature)) * np.prod(step / cell))
    if volume < 0.5:
        best = node(np.clip(at + np.clip(top, -1.0, 1.0) * step, low, high))
        best = replace(best, log_prior=best.log_prior + float(np.log(volume)))
        yield float(log([best])[0]), best


def _parabola(x: Array, y: Array) -> tuple[Array, Array]:
    """Where the parabola through values `y` (n,) at `x` (n, k) has its top (k,), and its second derivatives (k, k)."""
    k = x.shape[1]
    pairs = [(i, j) for i in range(k) for j in range(i, k)]
    powers = [x[:, i] * x[:, j] * (0.5 if i == j else 1.0) for i, j in pairs]
    c = np.linalg.lstsq(np.column_stack([np.ones(len(x)), x, *powers]), y, rcond=None)[0]
    second = np.empty((k, k))
    for (i, j), value in zip(pairs, c[1 + k :], strict=True):
        second[i, j] = second[j, i] = value
    return np.linalg.lstsq(-second, c[1 : 1 + k], rcond=None)[0], second
