"""What the readings can see at all: visible share, size in σ and alias classes of every term, from the moments alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symfive.posterior._moments import Moments

__all__ = ["Seen", "alias_classes", "seen"]

Array = NDArray[np.float64]
ALIKE = 0.999
"""Cosine of two visible shapes from which on they are one class: at 22 σ of size they would differ by 1 σ."""
CLEAR = 3.0
"""σ by which a term of usual size must stand out to be compared with others."""


@dataclass(frozen=True)
class Seen:
    """Of one term: `visible` share (0…1) of its energy that geometry and set-up leave, `sigmas` of one of usual size."""

    visible: float
    sigmas: float


def seen(moments: Moments, node: int) -> list[Seen]:
    """Every term under the noise of a node; the share under white noise."""
    found = []
    for columns in moments.columns:
        at = columns.where[columns.amplitude]
        left, white, full = (
            float(np.trace(g[np.ix_(at, at)])) for g in (moments.gram[node], moments.gram[0], moments.raw)
        )
        found.append(Seen(min(max(white, 0.0) / full, 1.0) if full > 0.0 else 0.0, max(left, 0.0) ** 0.5))
    return found


def alias_classes(moments: Moments, node: int) -> tuple[tuple[str, ...], ...]:
    """Parameters of named terms whose visible shapes agree: no amount of such readings tells them apart."""
    names, at = list[str](), list[int]()
    for term, columns in zip(moments.terms, moments.columns, strict=True):
        if term.form.basis is None and not term.effect.nameless:
            parameters = term.effect.parameters(moments.fit.model.campaign)
            own = len(parameters)  # the states in which it begins come behind
            for p, where, size in zip(parameters, columns.where[:own], columns.amplitude[:own], strict=True):
                if size and moments.gram[node, where, where] > CLEAR**2:
                    names.append(p.name if np.sum(columns.amplitude) > 1 else term.effect.key)
                    at.append(int(where))
    if not at:
        return ()
    h = moments.gram[node][np.ix_(at, at)]
    size = np.sqrt(np.diag(h))
    cosine = np.abs(h) / np.outer(size, size)
    groups: list[list[int]] = []
    for i in range(len(names)):
        home = next((g for g in groups if cosine[g[0], i] > ALIKE), None)
        if home is None:
            groups.append([i])
        else:
            home.append(i)
    return tuple(tuple(names[i] for i in g) for g in groups if len(g) > 1)
