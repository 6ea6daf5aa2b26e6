"""Noise as a node of the model: white noise, or white and Gauss-Markov noise of one of several sizes, with one of several
correlation times or with all of them (flicker noise).

The spectrum of row k's cosine (DCT-II, ω = πk/N) in units of the declared noise is

    S(ω) = 1 + s²·mean over φ of (1 - φ²)/(1 - 2φ·cos ω + φ²),   φ = exp(-Δt/τ).

The cosines are nearly the eigenvectors of such noise (N. Ahmed, T. Natarajan & K. Rao 1974), so one Gram matrix per band of
them serves every node: Σ_bands mean(1/S)·B. Short recordings are whitened exactly (Kalman filter).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.fft import dct

from symfive.arrays import Array, Indices
from symfive.inference import Noise, whiten

__all__ = [
    "DECADE", "EXACT_ROWS", "HALF", "NEGLIGIBLE", "SIZES", "Bands", "Node", "grams", "nodes_of", "share_of", "whitened",
]  # fmt: skip

SIZES, SHARES = (0.3, 1.0, 3.0), (0.003, 0.03, 0.3)
"""Coloured noise: 1σ in units of the declared noise, correlation time as a share of the longest run; half a decade and a decade
apart. Noise that the readings know better has a node of its own (`noises_of`)."""
HALF, DECADE = 0.5 * float(np.log(10.0)), float(np.log(10.0))
"""What one node stands for, in logarithms of size and time."""
USUAL = 0.4
"""Mean size of the slow noise of instruments: 0.09 to 1.3 of the white noise, 0.38 on average, in the seven series of
docs/recordings.md that were recorded at rest and neither hum nor drift."""
NEGLIGIBLE = 0.01
"""Nats by which the log evidence may be off."""
EXACT_ROWS = 1000
"""Rows below which whitening by the filter costs less than the bands."""
SINGLE, RATIO = 8, 1.35
"""The lowest cosines are bands of their own, where 1/S changes fast; then each is so much wider than the one before."""


@dataclass(frozen=True)
class Node:
    """Coloured noise of `size` (declared noise) and `time` s beside the white noise, `log_prior` of it; of so many `decades`."""

    size: float
    time: float
    log_prior: float
    decades: int = 1

    def noise(self, declared: float) -> Noise:
        """The noise of an instrument that declares so much."""
        return Noise(declared, self.size * declared, self.time, declared, self.decades)

    def spectrum(self, rows: int, interval: float) -> Array:
        """S of the DCT's cosines (rows,)."""
        if self.size == 0.0:
            return np.ones(rows)
        phi = np.array(self.noise(1.0).correlation(interval))[:, None]
        omega = np.pi * np.arange(rows) / rows
        each = (1.0 - phi**2) / (1.0 - 2.0 * phi * np.cos(omega) + phi**2)
        return np.asarray(1.0 + self.size**2 * each.mean(axis=0))


def nodes_of(longest: float, interval: float = 0.0, readings: int = 1, flicker: bool = False) -> tuple[Node, ...]:
    """White noise with a prior of ½; coloured ones share the rest, larger ones less: exp(-size/`USUAL`), E. T. Jaynes 1957;
    `flicker` noise is among them.

    Noise that so many readings, an interval apart, cannot distinguish from white noise, whose scale is free, counts as white:
    the first harmonic of its spectrum, 2φ·cos ω, changes the log evidence of n readings by n·φ²/2 or less.
    """
    times = [
        (share * max(longest, 1e-9), decades)
        for share, decades in (*((s, 1) for s in SHARES), *[(SHARES[-1], len(SHARES))] * flicker)
    ]
    every = [(size, *time) for size in SIZES for time in times]
    share = np.array([share_of(size) for size, _, _ in every]) / len(times)
    slow = np.array([0.5 * readings * np.exp(-2.0 * interval / time) > NEGLIGIBLE for _, time, _ in every])
    coloured = [
        Node(size, time, float(np.log(p)), decades)
        for (size, time, decades), p, kept in zip(every, share, slow, strict=True) if kept
    ]  # fmt: skip
    return Node(0.0, 0.0, float(np.log(1.0 - np.sum(share[slow])))), *coloured


def share_of(size: float) -> float:
    """The prior probability of noise of such a size, within half a decade."""
    weight = np.exp(-np.array([size, *SIZES]) / USUAL)
    return float(0.5 * weight[0] / weight[1:].sum())


def grams(table: Array, interval: float, nodes: Sequence[Node]) -> tuple[Array, Array]:
    """Whitened Gram matrices (J, k, k) of a table (N, ny, k) in declared noise, and Σ log of the noise's variances (J,)."""
    if len(table) < EXACT_ROWS:
        white, logs = whitened(table, interval, nodes)
        return np.swapaxes(white, 1, 2) @ white, logs
    return Bands.of(table, interval).grams(nodes)


@dataclass(frozen=True)
class Bands:
    """A table (N, ny, k) in declared noise as its cosines: `products` (B, k, k) of those in each band, and where bands begin."""

    products: Array
    edges: Indices
    columns: int
    interval: float

    @classmethod
    def of(cls, table: Array, interval: float) -> Bands:
        rows, columns, size = table.shape
        cosines = dct(table, axis=0, norm="ortho")
        edges = _edges(rows)
        products = np.empty((len(edges) - 1, size, size))
        for product, (first, last) in zip(products, pairwise(edges), strict=True):
            part = cosines[first:last].reshape(-1, size)
            np.matmul(part.T, part, out=product)
        return cls(products, edges, columns, interval)

    def grams(self, nodes: Sequence[Node]) -> tuple[Array, Array]:
        """As those of the table."""
        spectra = np.stack([node.spectrum(int(self.edges[-1]), self.interval) for node in nodes])
        weights = np.add.reduceat(1.0 / spectra, self.edges[:-1], axis=1) / np.diff(self.edges)
        logs = self.columns * np.log(spectra).sum(axis=1)
        return np.einsum("jb,bkl->jkl", weights, self.products, optimize=True), logs


def whitened(table: Array, interval: float, nodes: Sequence[Node]) -> tuple[Array, Array]:
    """A table (N, ny, k) in declared noise, whitened under each node (J, N·ny, k), and Σ log of the noise's variances (J,)."""
    rows, columns, size = table.shape
    white, logs = np.empty((len(nodes), rows * columns, size)), np.empty(len(nodes))
    for number, node in enumerate(nodes):
        found, each = whiten(table, node.noise(1.0), interval)
        white[number], logs[number] = found.reshape(-1, size), columns * each
    return white, logs


def _edges(rows: int) -> Indices:
    """Where the bands begin, and the end of the last one."""
    edges = list(range(SINGLE + 1))
    while edges[-1] < rows:
        edges.append(min(rows, max(edges[-1] + 1, int(RATIO * edges[-1]))))
    return np.array(edges)
