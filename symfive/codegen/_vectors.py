"""Test vectors of the generated code, from the model's chain and automatic differentiation (not from the generator's own)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.codegen._subject import Subject

GOLDEN, COUNT = 0.6180339887498949, 8


@dataclass(frozen=True)
class Vectors:
    """`q` (N, axes) mm and rad, one `tool` (3) and `p` for all; the expected results per vector."""

    q: Array
    tool: Array
    p: Array
    position: Array
    direction: Array
    by_q: Array
    by_p: Array


def spread_vectors(subject: Subject) -> Vectors:
    """Positions spread over the travels (rotary axes over one turn at most), parameters of the size of their priors."""
    spread = np.modf(np.outer(np.arange(1, COUNT + 1), GOLDEN ** np.arange(1, len(subject.axes) + 1)))[0]
    spread = np.modf(spread * 7.0 + 0.5)[0]
    q = np.empty((COUNT, len(subject.axes)))
    for i, name in enumerate(subject.axes):
        axis = subject.machine.axes[name]
        low, high = (v * axis.to_internal for v in axis.travel)
        if axis.rotary:
            low, high = max(low, -np.pi), min(high, np.pi)
        q[:, i] = np.round(low + (high - low) * spread[:, i], 6)
    tool = np.array([1.5, -2.5, -120.0])
    waves = np.cos(1.0 + np.arange(len(subject.parameters)))
    sizes = np.array([parameter.sigma if np.isfinite(parameter.sigma) else 1.0 for parameter in subject.parameters])
    p = np.round(np.asarray(subject.values) + waves * sizes, 6)
    reference = subject.function()
    results = [[np.asarray(part, dtype=float) for part in reference(row, tool, p)] for row in q]
    stacked = [np.array([row[k].ravel(order="F") for row in results]) for k in range(4)]
    return Vectors(q, tool, p, *stacked)
