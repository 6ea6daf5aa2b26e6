"""Branch and bound over the poses of one set-up: no pose tells more than what it returns.

In a cell of half widths h about a pose φ is its Taylor polynomial of second order and a remainder below Σ sup|∂ᵅφ| hᵅ/α! over all
third derivatives, whose bounds hold everywhere (`_spectrum`). With slope g and second derivatives H, and since
|H_ij δ_i δ_j| ≤ |H_ij| (δ_i² h_j/h_i + δ_j² h_i/h_j)/2,

    φ ≤ φ(centre) + Σ_i max over 0 ≤ t ≤ h_i of (|g_i| t + D_i t²/2) + remainder,    D_i = H_ii + Σ_j |H_ij| h_j/h_i.

A cell is left out where one limit excludes all of it. The limits are sums of places (trigonometric of degree one in every angle,
no longer than the levers), so a limit is nowhere in the cell above its value, its slopes and lever · (Σ h)²/2; the distance of
tool and post, which has kinks, is nowhere above its value and lever · Σ h. The cell with the highest bound is halved, across the
angle that contributes most to it, until the highest bound is low enough or the cells run out: the bound holds in either case.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symfive.design._bodies import NOSE_LENGTH
from symfive.design._information import Layout
from symfive.design._space import PARALLEL, UNIT_MM, Space
from symfive.design._spectrum import spectrum_of

__all__ = ["Proved", "largest_told"]

Array = NDArray[np.float64]
FIRST_WIDTH = math.radians(20.0)
MOST_CELLS, TOGETHER = 2_000_000, 20_000
KINKED = "tool and post"


@dataclass(frozen=True)
class Proved:
    """`bound`: no pose of the set-up tells more; `better` (m, poses) reachable poses that tell more than was known; how many
    `cells` were looked at."""

    bound: float
    better: Array
    cells: int

    @property
    def exhausted(self) -> bool:
        """Whether the cells ran out before the bound was as sharp as wished."""
        return self.cells >= MOST_CELLS


def largest_told(
    space: Space, layout: Layout, pull: Array, z: Array, k: Array, g: int, top: float, slack: float
) -> Proved | None:  # fmt: skip
    """An upper bound of ⟨G, F⟩ over all poses of the set-up `z`, `k` of run `g`, no sharper than (1 + `slack`) of the most that
    was found, `top` or a better pose met on the way. None where φ is no polynomial of the angles."""
    if PARALLEL in space.limit_names:
        return None
    values, vectors = np.linalg.eigh(pull)
    half = (vectors * np.sqrt(np.maximum(values, 0.0))).T
    poses = space.poses
    setup = _Setup(space, half[:, _columns(layout, g)], z[poses:], k)
    spectrum = spectrum_of(setup.told, space.lower[:poses], space.upper[:poses])
    if spectrum is None:
        return None
    proved = _Cells(setup, spectrum.third()).search(top, slack)
    return Proved(proved.bound + spectrum.disagrees, proved.better, proved.cells)


def _columns(layout: Layout, g: int) -> NDArray[np.int64]:
    own = layout.shared + g * layout.own
    return np.concatenate([np.arange(layout.shared), np.arange(own, own + layout.own)])


@dataclass(frozen=True)
class _Setup:
    """One set-up: φ = |half · J|² of its poses."""

    space: Space
    half: Array
    setup: Array
    k: Array

    def decided(self, poses: Array) -> tuple[Array, Array]:
        n = len(poses)
        return np.concatenate([poses, np.tile(self.setup, (n, 1))], axis=1), np.tile(self.k, (n, 1))

    def told(self, poses: Array) -> Array:
        """φ (n,)."""
        rows = self.space.kernel.rows(*self.decided(poses))
        return np.asarray(np.sum((self.half @ rows) ** 2, axis=(1, 2)))

    def taylor(self, poses: Array) -> tuple[Array, Array, Array]:
        """φ (n,), its slopes (n, d) and second derivatives (n, d, d)."""
        z, k = self.decided(poses)
        d = self.space.poses
        rows, slopes = self.space.kernel.slopes(z, k)
        seen, moved = self.half @ rows, self.half @ slopes[:, :d]
        value = np.einsum("nry,nry->n", seen, seen)
        slope = 2.0 * np.einsum("nkry,nry->nk", moved, seen)
        flat = moved.reshape(len(z), d, -1)
        own = np.ascontiguousarray(self.half.T @ seen)
        bent = flat @ flat.transpose(0, 2, 1) + self.space.kernel.curvature(z, k, own)[:, :d, :d]
        return value, slope, 2.0 * bent

    def reachable(self, poses: Array, half: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which cells may hold a reachable pose, and which centres are reachable."""
        kernel = self.space.kernel
        if not kernel.limit_count:
            return np.full(len(poses), True), np.full(len(poses), True)
        z, k = self.decided(poses)
        limits = kernel.limits(z, k)
        across = np.einsum("nkg,nk->ng", np.abs(kernel.limit_slopes(z, k)[:, : self.space.poses]), half)
        lever, moved = self.lever() / UNIT_MM, half.sum(axis=1)[:, None]
        kinked = np.array([name == KINKED for name in self.space.limit_names])
        most = limits + np.where(kinked, lever * moved, across + 0.5 * lever * moved**2)
        return np.asarray(np.all(most >= 0.0, axis=1)), np.asarray(np.all(limits >= -1e-9, axis=1))

    def lever(self) -> float:
        """mm that no point of balls, bar, tool and spindle nose lies farther from an axis than."""
        machine, z = self.space.machine, np.concatenate([np.zeros(self.space.poses), self.setup])
        balls = (self.space.table_ball(z), self.space.tool_ball(z))
        origins = (axis.origin for axis in machine.axes.values() if axis.rotary)
        reach = [float(np.linalg.norm(ball)) for ball in balls] + [2.0 * float(np.linalg.norm(o)) for o in origins]
        linear = np.array([a.direction for a in machine.axes.values() if not a.rotary])
        oblique = max(1.0, 1.0 / float(np.linalg.svd(linear, compute_uv=False)[-1]))
        nose = sum((machine.workspace.spindle_nose or {}).values()) + NOSE_LENGTH
        return oblique * (sum(reach) + float(self.k[0]) + nose)


class _Cells:
    """Cells (centres and half widths) by their bounds, best first."""

    def __init__(self, setup: _Setup, third: dict[tuple[int, ...], float]) -> None:
        self.setup = setup
        self.orders = np.array(list(third))
        self.third = np.array(list(third.values())) / np.prod([[math.factorial(m) for m in o] for o in third], axis=1)
        space = setup.space
        low, high = space.lower[: space.poses], space.upper[: space.poses]
        counts = np.maximum(1, np.ceil((high - low) / FIRST_WIDTH)).astype(int)
        axes = [a + (b - a) * (np.arange(n) + 0.5) / n for a, b, n in zip(low, high, counts, strict=True)]
        self.centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(low))
        self.halves = np.tile((high - low) / counts / 2.0, (len(self.centres), 1))

    def bounded(self, centres: Array, half: Array) -> tuple[Array, Array, NDArray[np.int64]]:
        """φ at the centres, its bound in the cells, and the angle across which to halve each."""
        value, slope, bent = self.setup.taylor(centres)
        slope = np.abs(slope)
        diagonal = np.einsum("nii->ni", bent).copy()
        coupled = np.abs(bent)
        np.einsum("nii->ni", coupled)[:] = 0.0
        diagonal += np.einsum("nij,nj->ni", coupled, half) / half
        turned = np.where(diagonal < 0.0, np.minimum(half, slope / np.maximum(-diagonal, 1e-300)), half)
        own = slope * turned + 0.5 * diagonal * turned**2
        each = self.third * np.prod(half[:, None, :] ** self.orders, axis=2)
        widest = own + each @ (self.orders / 3.0)
        return value, value + own.sum(axis=1) + each.sum(axis=1), np.argmax(widest, axis=1)

    def search(self, top: float, slack: float) -> Proved:
        """Halve the cells with the highest bounds until none is above (1 + `slack`) of the most that was found."""
        centres, halves = self.centres, self.halves
        empty = np.empty((0, centres.shape[1]))
        waiting: tuple[NDArray[Any], ...] = (empty, empty, np.empty(0), np.empty(0, dtype=np.int64))
        better, bound, looked = [empty], 0.0, 0
        while len(centres):
            looked += len(centres)
            near, here = self.setup.reachable(centres, halves)
            if near.any():
                centres, halves, here = centres[near], halves[near], here[near]
                value, highest, across = self.bounded(centres, halves)
                ahead = here & (value > top)
                better.append(centres[ahead])
                top = max(top, float(value[ahead].max(initial=0.0)))
                fresh = (centres, halves, highest, across)
                waiting = tuple(np.concatenate(pair) for pair in zip(waiting, fresh, strict=True))
            opened = waiting[2] > top * (1.0 + slack)
            bound = max(bound, float(waiting[2][~opened].max(initial=0.0)))
            waiting = tuple(part[opened] for part in waiting)
            if looked >= MOST_CELLS:
                break
            first = np.argsort(waiting[2])[::-1]
            now, later = first[:TOGETHER], first[TOGETHER:]
            centres, halves = _halved(waiting[0][now], waiting[1][now], waiting[3][now])
            waiting = tuple(part[later] for part in waiting)
        return Proved(max(bound, float(waiting[2].max(initial=0.0))), np.concatenate(better), looked)


def _halved(centres: Array, halves: Array, across: NDArray[np.int64]) -> tuple[Array, Array]:
    """Both halves of every cell."""
    row = np.arange(len(centres))
    halves = halves.copy()
    halves[row, across] *= 0.5
    shift = np.zeros_like(centres)
    shift[row, across] = halves[row, across]
    return np.concatenate([centres - shift, centres + shift]), np.concatenate([halves, halves])
