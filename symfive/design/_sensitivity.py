"""The sensitivity function φ = ⟨G, F(pose)⟩ of the poses of one set-up, with its derivatives and the limits of the poses.

`local_maxima` moves poses to the local maxima of φ among those in reach. Most of these lie on limits, often where two of
them meet, and a limit is curved: no step along an angle stays on it. So the ascent is Newton's on φ less a growing penalty of the
limits' violation (J. Nocedal & S. J. Wright 2006, 17.1), in a trust region, and a last step back to where the limits end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Flags
from symfive.design._space import Space
from symfive.optimal import Layout

PENALTY = 10.0
"""Least weight of the squared violation (in 100 mm) against φ over its largest value."""
WELL_OUTSIDE = 0.05
"""Violation (in 100 mm) from which on no pose may count more than the best in reach."""
STAGES = ((1.0, 6), (1.0, 8), (30.0, 6))
"""Shares of the weight and steps of the ascent, one after the other; after each stage poses that have met are one."""
MET = 1e-3
"""rad."""
SETTLED = 1e-5
"""rad. Half the square of a step, times the curvature, is what it still gains: 1e-9 of φ."""
FIRST_TRUST, LARGEST_TRUST = 0.1, 0.3
"""rad."""
LEAST_BEND = 1e-3
"""Curvature, of φ over its largest value per rad², that a step is reckoned with where there is less."""
ROUNDING = 1e-15
"""Share of the largest eigenvalue of G below which one is rounding."""
RESTORED = 8
INSIDE = 1e-9
"""How far inside the limits (in 100 mm) the last step leads."""


@dataclass(frozen=True)
class SensitivityFunction:
    """φ = |half · J|² of the poses of one set-up: `setup` its variables, `k` its constants."""

    space: Space
    half: Array
    setup: Array
    k: Array

    def decided(self, poses: Array) -> tuple[Array, Array]:
        """All that is decided for each pose, and the constants: (n, nz), (n, nk)."""
        n = len(poses)
        return np.concatenate([poses, np.tile(self.setup, (n, 1))], axis=1), np.tile(self.k, (n, 1))

    def given(self, n: int) -> Array:
        """What is not decided for n poses, as `pose_kernel` takes it."""
        return np.tile(np.concatenate([self.setup, self.k]), (n, 1))

    def _seen(self, rows: Array) -> Array:
        """half · J (…, ny, size) of sensitivities (…, width, ny), as one product of two matrices."""
        flat = np.ascontiguousarray(rows.swapaxes(-1, -2))
        return np.asarray((flat.reshape(-1, flat.shape[-1]) @ self.half.T).reshape(*flat.shape[:-1], -1))

    def values(self, poses: Array) -> Array:
        """φ (n,)."""
        seen = self._seen(self.space.kernel.rows(*self.decided(poses)))
        return np.asarray(np.einsum("nyr,nyr->n", seen, seen))

    def taylor(self, poses: Array) -> tuple[Array, Array, Array]:
        """φ (n,), its slopes (n, d) and second derivatives (n, d, d)."""
        n, d = poses.shape
        kernel, k = self.space.pose_kernel, self.given(n)
        rows, slopes = kernel.slopes(poses, k)
        seen = self._seen(rows).reshape(n, -1)
        moved = self._seen(slopes).reshape(n, d, -1)
        value = np.einsum("nr,nr->n", seen, seen)
        slope = 2.0 * (moved @ seen[:, :, None])[..., 0]
        own = (seen.reshape(-1, len(self.half)) @ self.half).reshape(n, -1, self.half.shape[1])
        bent = moved @ moved.swapaxes(-1, -2) + kernel.curvature(poses, k, own.swapaxes(1, 2))
        return value, slope, 2.0 * bent

    def limits(self, poses: Array) -> Array:
        """What must be ≥ 0 (n, ng), in 100 mm."""
        return self.space.kernel.limits(*self.decided(poses))

    def limit_slopes(self, poses: Array) -> Array:
        """Their derivatives (n, d, ng)."""
        return self.space.pose_kernel.limit_slopes(poses, self.given(len(poses)))


def sensitivity_function(
    space: Space, layout: Layout, pull: Array, setup: Array, k: Array, g: int
) -> SensitivityFunction:
    """φ in the set-up of run `g` for G = `pull`."""
    values, vectors = np.linalg.eigh(pull)
    some = values > ROUNDING * values[-1]
    half = (vectors[:, some] * np.sqrt(values[some])).T
    first = layout.shared + g * layout.own
    columns = np.concatenate([np.arange(layout.shared), np.arange(first, first + layout.own)])
    return SensitivityFunction(space, half[:, columns], setup, k)


def penalty_of(seen: Array, violated: Array) -> float:
    """The weight of the squared violation with which no pose well outside the limits counts more than the best in reach, of φ
    over its largest value in reach (n,) and the squared violation (n,) of poses everywhere: beyond a limit φ may be far larger,
    and a lighter penalty would lead the ascent there."""
    far = violated > WELL_OUTSIDE**2
    return float(np.max((seen[far] - 1.0) / violated[far], initial=PENALTY))


def local_maxima(phi: SensitivityFunction, poses: Array, top: float, penalty: float) -> Array:
    """Local maxima of φ, of which `top` is about the largest, from the poses (n, d), with a `penalty` of the squared violation;
    some may end outside the limits.

    A pose near which the chain is singular, so that φ and the limits are not finite or their products are not, stays where it is.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        for share, steps in STAGES:
            poses = _newton_steps(phi, poses, top, share * penalty, steps)
            poses = poses[np.unique(np.round(poses / MET), axis=0, return_index=True)[1]]
        return _restored(phi, poses)


def _newton_steps(phi: SensitivityFunction, poses: Array, top: float, penalty: float, steps: int) -> Array:
    """Newton's steps on φ/top less the penalty of the limits; a pose that no longer moves is left where it is."""
    poses, d = poses.copy(), poses.shape[1]
    low, high = phi.space.lower[:d], phi.space.upper[:d]

    def less_penalty(poses: Array) -> tuple[Array, Array]:
        violated = np.minimum(phi.limits(poses), 0.0)
        return phi.values(poses) / top - penalty * np.sum(violated**2, axis=1), violated

    trust = np.full(len(poses), FIRST_TRUST)
    merit, violated = less_penalty(poses)
    live = np.arange(len(poses))
    for _ in range(steps):
        if not live.size:
            break
        here, outside = poses[live], violated[live]
        _, slope, bent = phi.taylor(here)
        slope, bent = slope / top, bent / top
        out = np.flatnonzero((outside < 0.0).any(axis=1))
        active = phi.limit_slopes(here[out]) * (outside[out] < 0.0)[:, None, :]
        slope[out] -= 2.0 * penalty * np.einsum("nkg,ng->nk", active, outside[out])
        bent[out] -= 2.0 * penalty * (active @ active.transpose(0, 2, 1))
        held = ((here <= low) & (slope < 0.0)) | ((here >= high) & (slope > 0.0))
        trial = np.clip(here + _step(np.where(held, 0.0, slope), bent, ~held, trust[live]), low, high)
        there, then = less_penalty(trial)
        better = there > merit[live]
        up = live[better]
        poses[up], violated[up], merit[up] = trial[better], then[better], there[better]
        trust[live] = np.where(better, np.minimum(2.0 * trust[live], LARGEST_TRUST), 0.25 * trust[live])
        live = live[(np.abs(trial - here) > SETTLED).any(axis=1)]
    return poses


def _step(slope: Array, bent: Array, free: Flags, trust: Array) -> Array:
    """Newton's step uphill in the angles that are free, no longer than `trust`: curvatures count by their size."""
    finite = np.isfinite(np.concatenate([slope[:, :, None], bent], axis=2)).all(axis=(1, 2), keepdims=True)
    slope, bent = np.where(finite[:, :, 0], slope, 0.0), np.where(finite, bent, 0.0)
    values, vectors = np.linalg.eigh(bent * free[:, :, None] * free[:, None, :])
    bend = np.maximum(np.abs(values), LEAST_BEND)
    step = np.einsum("nki,ni->nk", vectors, np.einsum("nki,nk->ni", vectors, slope) / bend) * free
    length = np.linalg.norm(step, axis=1)
    return np.asarray(step * np.minimum(1.0, trust / np.maximum(length, LEAST_BEND**2))[:, None])


def _restored(phi: SensitivityFunction, poses: Array) -> Array:
    """Poses just outside a limit put back onto it, by Newton's shortest steps."""
    poses, d = poses.copy(), poses.shape[1]
    low, high = phi.space.lower[:d], phi.space.upper[:d]
    for _ in range(RESTORED):
        limits = phi.limits(poses)
        left = np.flatnonzero((limits < INSIDE).any(axis=1))
        if not left.size:
            break
        outside = limits[left] < INSIDE
        slopes = phi.limit_slopes(poses[left]) * outside[:, None, :]
        gram = slopes.transpose(0, 2, 1) @ slopes
        gram += 1e-9 * (1.0 + np.einsum("nii->n", gram))[:, None, None] * np.eye(limits.shape[1])
        wanted = np.where(outside, 2.0 * INSIDE - limits[left], 0.0)
        finite = np.isfinite(gram).all(axis=(1, 2)) & np.isfinite(wanted).all(axis=1)
        left, slopes, gram, wanted = left[finite], slopes[finite], gram[finite], wanted[finite]
        step = np.einsum("nkg,ng->nk", slopes, np.linalg.solve(gram, wanted[..., None])[..., 0])
        poses[left] = np.clip(poses[left] + step, low, high)
    return poses
