"""Every mounting that several instruments share their minutes over, with what each second of reading tells.

A mounting is one instrument at one place with one tool (and bar). Its readings are poses at rest, which cost the workspace's
`seconds_per_pose`, and with a ball bar circles, read in motion at a rate. Rows are divided by the root of their cost, so that
weights are seconds; set-up errors are scaled by their prior 1σ and padded with zeros, so that all instruments share one layout.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from symfive.arrays import Array
from symfive.campaign import Run
from symfive.design._candidates import candidates_in, pose_grid, setup_options
from symfive.design._pose import UNIT_MM
from symfive.design._seated import angles_of
from symfive.design._space import Space
from symfive.errors import InputError
from symfive.optimal import marginal
from symfive.procedures import PLANES, Nominal, circle_frame, polar_angle

POSES = 150
"""Poses of the grid in every mounting."""
BAR, CIRCLES = "ball_bar", "circles"
RATIOS = (0.5, 0.9, 1.5)
"""X_T/r of synchronous circles beside those about the places of the grid."""
SAME = 1e-9
ROWS, LEAST_ROWS = 36, 18
"""Rows at which a circle is sampled, and how many of them must be reachable; the feed does not change what a second tells."""


@dataclass(frozen=True)
class Mounting:
    """One instrument mounted: `kind` (an instrument, or `circles`), `setup` as in `SETUP_VARIABLES`, bar `length` mm, and `rows`
    (n, shared + own, ny), sensitivities per second of reading."""

    kind: str
    setup: tuple[float, ...]
    length: float
    rows: Array

    def together(self, other: Mounting) -> Mounting:
        """The same mounting with the readings of both."""
        ny = max(self.rows.shape[2], other.rows.shape[2])
        return Mounting(self.kind, self.setup, self.length, np.concatenate([_wide(m.rows, ny) for m in (self, other)]))

    def added(self, seconds: Array, shared: int) -> Array:
        """The information (shared, shared) that `seconds` (n,) of its readings add, its set-up errors marginalised."""
        flat = self.rows.transpose(1, 0, 2).reshape(self.rows.shape[1], -1)
        gram = (flat * np.repeat(seconds, self.rows.shape[2])) @ flat.T
        priors = np.diag(np.where(np.arange(len(gram)) < shared, 0.0, 1.0))
        return marginal(gram + priors, np.arange(shared))


def mountings_of(space: Space, own: int, *, rate_hz: float | None = None) -> list[Mounting]:
    """All mountings of a space on the grid of its set-ups, their rows padded to `own` set-up errors; with `rate_hz` those of
    circles instead, read so many times a second."""
    setups, lengths = setup_options(space)
    if rate_hz is not None:
        return list(_circles(space, own, setups, lengths, rate_hz))
    pace = space.machine.workspace.seconds_per_pose
    found = candidates_in(space, setups, lengths, pose_grid(space, POSES))
    return [
        Mounting(
            space.instrument, tuple(np.round(setups[g], 6)), float(lengths[g, 0]),
            _scaled(space, found.rows[found.group == g], own) / math.sqrt(pace),
        )
        for g in np.unique(found.group)
    ]  # fmt: skip


def mounting_of(space: Space, own: int, run: Run) -> Mounting:
    """The mounting of a static run, with its poses and those of the grid there."""
    z, k = _of_run(space, run)
    grid = pose_grid(space, POSES)
    near = np.concatenate([grid, np.tile(z[0, space.poses :], (len(grid), 1))], axis=1)
    same = np.tile(k[:1], (len(grid), 1))
    fits = space.feasible(near, same)
    z, k = np.concatenate([z, near[fits]]), np.concatenate([k, same[fits]])
    rows = _scaled(space, space.kernel.rows(z, k), own) / math.sqrt(space.machine.workspace.seconds_per_pose)
    return Mounting(space.instrument, tuple(z[0, space.poses :]), float(k[0, 0]), rows)


def _of_run(space: Space, run: Run) -> tuple[Array, Array]:
    """The poses of a static run (n, nz) in the variables of its space, and its constants (n, 1)."""
    (x, y, height), length = run.table_ball, run.length or 0.0
    z = np.zeros((run.rows, len(space.names)))
    for i, name in enumerate(space.names[: space.poses]):
        if name in run.commands:
            z[:, i] = np.radians(run.commands[name])
    if run.length is not None:
        bar = (Nominal(space.machine).ball(run.commands, run.tool_ball) - np.array(run.table_ball)) / length
        z[:, space.poses - 2 : space.poses] = angles_of(bar)
    z[:, space.poses :] = [*space.polar(x, y), height / UNIT_MM, -run.tool_ball[2] / UNIT_MM]
    return z, np.full((run.rows, 1), length)


def with_circles(bars: Sequence[Mounting], circles: Sequence[Mounting]) -> list[Mounting]:
    """Mountings of a ball bar for poses and circles: where both are known, both; the others as they are."""
    moving = {(c.setup, c.length): c for c in circles}
    both = [
        bar.together(moving.pop((bar.setup, bar.length))) if (bar.setup, bar.length) in moving else bar for bar in bars
    ]
    return [*both, *(replace(c, kind=BAR) for c in moving.values())]


def _scaled(space: Space, rows: Array, own: int) -> Array:
    """Rows with set-up errors per prior 1σ, and `own` columns for them."""
    shared = len(space.shared)
    whole = np.zeros((len(rows), shared + own, rows.shape[2]))
    whole[:, :shared] = rows[:, :shared]
    whole[:, shared : rows.shape[1]] = rows[:, shared:] * space.own_sigma[:, None]
    return whole


def _wide(rows: Array, ny: int) -> Array:
    """Rows with so many readings, the further ones zero."""
    return np.concatenate([rows, np.zeros((*rows.shape[:2], ny - rows.shape[2]))], axis=2)


def _circles(space: Space, own: int, setups: Array, lengths: Array, rate_hz: float) -> Iterator[Mounting]:
    """Circles about the places of the grid, and synchronous ones, grouped by mounting. What a limit keeps out is missing from the
    circle, as from an arc."""
    width = len(space.shared) + own
    groups: dict[tuple[float, ...], list[Array]] = {}
    z, k = (np.concatenate(part) for part in zip(*_paths(space, setups, lengths), strict=True))
    sensitivities = space.kernel.rows(z, k)
    fits = space.feasible(z, k, sensitivities).reshape(-1, ROWS)
    rows = _scaled(space, sensitivities, own)[:, :, 0].reshape(-1, ROWS, width)
    for i in np.flatnonzero(fits.sum(axis=1) >= LEAST_ROWS):
        _, values, vectors = np.linalg.svd(rows[i, fits[i]], full_matrices=False)
        told = values > SAME * values[0]
        key = tuple(np.round(np.append(z[ROWS * i, space.poses :], k[ROWS * i]), 6))
        root = vectors[told].T * values[told] * math.sqrt(rate_hz / fits[i].sum())  # of the mean of JᵀJ, times the rate
        groups.setdefault(key, []).append(root)
    for key, roots in groups.items():
        widest = max(root.shape[1] for root in roots)
        yield Mounting(CIRCLES, key[:-1], key[-1], np.stack([_wide(root[None], widest)[0] for root in roots]))


def _paths(space: Space, setups: Array, lengths: Array) -> Iterator[tuple[Array, Array]]:
    """Poses (ROWS, nz) and lengths (ROWS, 1) of circles. Planar ones lie in every plane of the machine frame, the rotary axes at
    rest at the ends and the middle of their ranges; synchronous ones as in `synchronous_circle`."""
    machine, phi = space.machine, np.linspace(0.0, 2.0 * np.pi, ROWS, endpoint=False)
    nominal, rotary = Nominal(machine), space.names[: space.poses - 2]
    ranges = [np.linspace(space.lower[i], space.upper[i], 3) for i in range(len(rotary))]
    around = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    for angles in itertools.product(*ranges):
        held = nominal.commands(dict(zip(rotary, map(float, np.degrees(angles)), strict=True)), 1)
        frame = np.stack([nominal.seen_from_workpiece(held, row)[0] for row in np.eye(3)])
        for setup, length in zip(setups, lengths, strict=True):
            for plane in PLANES.values():
                yield _path(np.tile(angles, (ROWS, 1)), around @ frame[list(plane)], setup, length)
    try:
        circle = circle_frame(machine)
    except InputError:
        return
    for length in np.unique(lengths):
        for x_t, level, tool in itertools.product(
            sorted({0.0, UNIT_MM * setups[:, 0].max(), *(ratio * length for ratio in RATIOS)}),
            np.unique(setups[:, 2]), np.unique(setups[:, 3]),
        ):  # fmt: skip
            place = circle.foot(UNIT_MM * level) + x_t * circle.u
            theta = np.zeros((ROWS, len(rotary)))
            theta[:, rotary.index(circle.rotary)] = np.angle(np.exp(1j * polar_angle(phi, x_t, length)))
            setup = np.array([*space.polar(place[0], place[1]), place[2] / UNIT_MM, tool])
            yield _path(theta, around @ np.stack([circle.u, circle.v]), setup, np.array([length]))


def _path(rotary: Array, bar: Array, setup: Array, length: Array) -> tuple[Array, Array]:
    """Rotary axes (n, R) rad and unit vectors of the bar (n, 3), workpiece frame, in the variables of the space."""
    z = np.concatenate([rotary, angles_of(bar), np.tile(setup, (len(bar), 1))], axis=1)
    return z, np.tile(length, (len(bar), 1))
