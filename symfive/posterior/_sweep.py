"""Sweep: the evidence of a subset with each of many further terms, by one elimination of the subset.

One eigen-decomposition H_SS = UΛUᵀ serves all: with P = (Λ/κ² + 1)^(-½)·UᵀH_St/κ² a term's Schur complement is H_tt/κ² + I - PᵀP.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.posterior._evidence import STEPS, Blocks, Equations, Selected, Turned, equations
from symfive.posterior._moments import Alike, Moments

__all__ = ["WIDTHS", "Sweep", "nearest_width", "widths_of"]

WIDTHS = (1.0, 3.0, 10.0, 30.0, 100.0)
"""A scale-free prior of amplitudes as a mixture, half a decade apart: nothing is capped by what machine tools usually have."""


def widths_of(moments: Moments, number: int) -> tuple[float, ...]:
    """Prior widths to try for a term: only the usual one if it departs from a value that the machine file states, or varies
    another effect: neither has a size of its own."""
    term = moments.terms[number]
    return WIDTHS[:1] if term.effect.departs or term.needs else WIDTHS


def nearest_width(size: float, widths: Sequence[float] = WIDTHS) -> float:
    """The prior width nearest to an amplitude in log scale."""
    return min(widths, key=lambda width: abs(np.log(width / max(size, 1e-300))))


@dataclass(frozen=True)
class Sweep:
    """A subset with its `equations` `turned` into their eigenvectors, `cross` (J, m, n) all columns of the moments with these,
    and `slope` (J, m) all columns with what stands for the residual."""

    moments: Moments
    equations: Equations
    turned: Turned
    cross: Array
    slope: Array

    @classmethod
    def of(cls, moments: Moments, members: Sequence[Selected], blocks: Blocks = ()) -> Sweep:
        """Of a subset and its discrepancies."""
        s = equations(moments, members, blocks)
        turned = Turned.of(s)
        cross = (moments.gram[:, :, s.columns] * s.scale) @ turned.axes
        return cls(moments, s, turned, cross, moments.gram[:, :, s.aim] @ s.weights)

    def joined(self, chosen: Sequence[int], widths: Sequence[float]) -> tuple[Array, Array]:
        """Log evidence with each of the `chosen` terms (not held) added in its of the `widths`, and the rms of the amplitudes
        that each then has, in units of its usual ones: (chosen,), (chosen,)."""
        moments, place = self.moments, {number: k for k, number in enumerate(chosen)}
        found, sizes = np.zeros(len(chosen)), np.zeros(len(chosen))
        for alike in moments.alike:
            rows = [row for row, number in enumerate(alike.numbers) if number in place]
            if not rows:
                continue
            at = [place[alike.numbers[row]] for row in rows]
            own, width = alike.some(rows), np.array([widths[k] for k in at])
            total, x = self._with_each(own, np.where(own.amplitude, width[:, None], 1.0))
            by_node = total + (moments.log_prior - 0.5 * moments.const)[:, None]
            found[at] = np.logaddexp.reduce(by_node, axis=0)
            best = x[np.argmax(by_node, axis=0), np.arange(len(at))]
            count = np.maximum(own.amplitude.sum(axis=1), 1)
            sizes[at] = width * np.sqrt(np.sum(np.where(own.amplitude, best, 0.0) ** 2, axis=1) / count)
        return found, sizes

    def _with_each(self, own: Alike, scale: Array) -> tuple[Array, Array]:
        """Log evidence (J, T), up to the nodes' constants, with each of some terms of as many columns, these times `scale`
        (T, n), and their x (J, T, n)."""
        gram, turned, count = self.moments.gram, self.turned, self.moments.count
        h = own.gram * (scale[:, :, None] * scale[:, None, :])
        g = self.slope[:, own.where] * scale
        cross = np.swapaxes(self.cross[:, own.where] * scale[:, :, None], 2, 3)
        power, g_base, d_base = (part[:, None, :] for part in (turned.power, turned.g, turned.d))
        q, exact = self.equations.q[:, None], own.exact
        if exact[0] >= 0:  # the residual is that less what the term adds beyond its slopes
            q = q - 2.0 * self.slope[:, exact] + gram[:, exact, exact]
            g = g - gram[:, own.where, exact[:, None]] * scale
            g_base = g_base - self.cross[:, exact]
        kappa2 = np.broadcast_to(np.maximum(1.0, q / count), (len(q), len(exact)))
        for step in range(STEPS):
            k = kappa2[..., None]
            shrunk = 1.0 / np.sqrt(power / k + 1.0)
            e = shrunk * (g_base / k - d_base)
            p = (shrunk / k)[..., None] * cross
            a = h / k[..., None] + np.eye(h.shape[-1]) - np.swapaxes(p, -1, -2) @ p
            b = g / k - own.departure - (e[..., None, :] @ p)[..., 0, :]
            x = np.linalg.solve(a, b[..., None])[..., 0]
            y = shrunk * (e - (p @ x[..., None])[..., 0])
            moved = (h @ x[..., None])[..., 0] + 2.0 * (y[..., None, :] @ cross)[..., 0, :]
            left = q + np.sum(y * (power * y - 2.0 * g_base), axis=-1) + np.sum(x * (moved - 2.0 * g), axis=-1)
            if step == STEPS - 1:
                break
            before, kappa2 = kappa2, np.maximum(1.0, left / count)
            if np.array_equal(before, kappa2):
                break
        pull = np.sum((y + d_base) ** 2, axis=-1) + np.sum((x + own.departure) ** 2, axis=-1)
        logdet = np.linalg.slogdet(a)[1] - 2.0 * np.log(shrunk).sum(axis=-1)
        return np.asarray(-0.5 * (left / kappa2 + pull + count * np.log(kappa2) + logdet)), x
