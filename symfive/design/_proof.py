"""Branch and bound over the poses of one set-up: an upper bound of the sensitivity function.

A cell is left out where one limit excludes all of it. The limits are sums of places (trigonometric of degree one in every angle,
no longer than the levers), so a limit is nowhere in the cell above its value, its slopes and lever · (Σ h)²/2; the distance of
tool and post, which has kinks, is nowhere above its value and lever · Σ h. The limit that cuts off most of a cell is taken to
second order, with lever · (Σ h)³/6 for the rest, and helps to bound φ in the part that is left (`_cells`). The cell with the
highest bound is halved, across the angle that contributes most to it, until the highest bound is low enough or the cells run out:
the bound holds in either case.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Flags
from symfive.design._limits import PARALLEL
from symfive.design._pose import UNIT_MM
from symfive.design._sensitivity import SensitivityFunction, sensitivity_function
from symfive.design._space import Space
from symfive.moves import NOSE_LENGTH
from symfive.optimal import TINY, Cells, Cut, FirstCells, Layout, first_cells, spectrum_of

MOST_CELLS, TOGETHER = 2_000_000, 5_000


@dataclass(frozen=True)
class Proved:
    """`bound` of φ over all poses of the set-up; `better` (m, poses) reachable poses with more than was known; number of
    `cells` examined."""

    bound: float
    better: Array
    cells: int

    @property
    def exhausted(self) -> bool:
        """Whether the cells ran out before the bound was as sharp as wished."""
        return self.cells >= MOST_CELLS


def bounded_sensitivity(
    space: Space, layout: Layout, pull: Array, z: Array, k: Array, g: int, top: float, slack: float
) -> Proved | None:  # fmt: skip
    """An upper bound of ⟨G, F⟩ over all poses of the set-up `z`, `k` of run `g`, no sharper than (1 + `slack`) of the most that
    was found, `top` or a better pose met on the way. None where φ is no polynomial of the angles."""
    if PARALLEL in space.limit_names:
        return None
    poses = space.poses
    phi = sensitivity_function(space, layout, pull, z[poses:], k, g)
    setup = _Setup(space, phi.half, phi.setup, phi.k)
    spectrum = spectrum_of(setup.values, space.lower[:poses], space.upper[:poses])
    if spectrum is None:
        return None
    first = first_cells(spectrum, space.lower[:poses], space.upper[:poses], top * (1.0 + slack))
    proved = _searched(setup, first, top, slack)
    return Proved(proved.bound + spectrum.disagrees, proved.better, proved.cells)


@dataclass(frozen=True)
class _Reached:
    """Of cells: which may hold a reachable pose (`near`), of which the centre is one (`here`), and the limit that cuts off most
    of each of those that are near."""

    near: Flags
    here: Flags
    cut: Cut


@dataclass(frozen=True)
class _Setup(SensitivityFunction):
    """φ of the poses of one set-up, and which cells of them can be reached."""

    def reachable(self, cells: Cells) -> _Reached:
        """What of the cells may hold a reachable pose."""
        n, d = cells.centres.shape
        smooth = self.space.smooth_limits
        if not smooth:
            return _Reached(np.full(n, True), np.full(n, True), Cut.nothing(n, d))
        limits = self.limits(cells.centres)
        lever, moved = self.lever() / UNIT_MM, cells.halves.sum(axis=1)[:, None]
        near = np.all(limits + lever * moved >= 0.0, axis=1)
        mixed = np.flatnonzero(near & np.any(limits < lever * moved, axis=1))  # of the others a limit settles nothing
        kernel = self.space.smooth_kernel  # of the other limit nothing but its value is used
        slopes, part = kernel.limit_slopes(cells.centres[mixed], self.given(len(mixed))), limits[mixed][:, smooth]
        across = np.einsum("nkg,nk->ng", np.abs(slopes), cells.halves[mixed])
        left = np.flatnonzero(np.all(part + across + 0.5 * lever * moved[mixed] ** 2 >= 0.0, axis=1))
        deepest = np.argmin(part[left] / np.maximum(across[left], TINY), axis=1)
        near[mixed] = False
        mixed = mixed[left]
        bent = kernel.limit_curvature(cells.centres[mixed], self.given(len(mixed)), np.eye(len(smooth))[deepest])
        third = lever * moved[mixed] ** 2 / 6.0 * cells.halves[mixed]
        cut = Cut.nothing(n, d).with_rows(mixed, Cut(part[left, deepest], slopes[left, :, deepest], bent, third))
        near[mixed] = cut.take(mixed).most(cells.halves[mixed]) >= 0.0
        return _Reached(near, np.all(limits >= -1e-9, axis=1), cut.take(near))

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


def _searched(setup: _Setup, first: FirstCells, top: float, slack: float) -> Proved:
    """Halve the cells with the highest bounds until none is above (1 + `slack`) of the most that was found."""
    cells, bound, looked = first.cells, first.settled, 0
    waiting, highest, across = cells.take(np.arange(0)), np.empty(0), np.empty(0, dtype=np.int64)
    better = [waiting.centres]
    while len(cells):
        reached = setup.reachable(cells)
        near = reached.near
        if near.any():
            cells = cells.take(near)
            value, slope, bent = setup.taylor(cells.centres)
            fresh = first.bounded(cells, value, slope, bent, reached.cut)
            ahead = reached.here[near] & (value > top)
            better.append(cells.centres[ahead])
            top = max(top, float(value[ahead].max(initial=0.0)))
            waiting = waiting.joined(cells)
            highest, across = np.concatenate([highest, fresh[0]]), np.concatenate([across, fresh[1]])
        opened = highest > top * (1.0 + slack)
        bound = max(bound, float(highest[~opened].max(initial=0.0)))
        waiting, highest, across = waiting.take(opened), highest[opened], across[opened]
        if looked >= MOST_CELLS:
            break
        order = np.argsort(highest)[::-1]
        now, later = order[:TOGETHER], order[TOGETHER:]
        cells = waiting.take(now).halved(across[now])
        looked += len(cells)
        waiting, highest, across = waiting.take(later), highest[later], across[later]
    return Proved(max(bound, float(highest.max(initial=0.0))), np.concatenate(better), looked)
