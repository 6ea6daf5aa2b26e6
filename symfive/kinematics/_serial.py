"""Serial chains of axes in numbers: product of exponentials, modified Denavit-Hartenberg tables, where a tracker stands."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from symfive.arrays import Array

Vector = tuple[float, float, float]


def forward(
    axes: Mapping[str, tuple[Vector, Vector]], positions: Array, linear: Collection[str] = ()
) -> tuple[Array, Array]:
    """Rotations (N, 3, 3) and translations (N, 3) mm of the tool frame for positions (N, axes) in degree, of the axes
    `linear` in mm.

    T = Π Trans(o) Rot(e, q) Trans(-o), of a linear axis Trans(q·e), over the axes from the bed outward; the tool frame is the
    machine frame at zero.
    """
    from scipy.spatial.transform import Rotation  # slow to import, and needed by robots only

    n = len(positions)
    rotation, translation = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3))
    for i, (name, (direction, origin)) in enumerate(axes.items()):
        if name in linear:
            translation = translation + rotation @ np.asarray(direction) * positions[:, i, None]
            continue
        step = Rotation.from_rotvec(np.radians(positions[:, i, None]) * np.asarray(direction)).as_matrix()
        point = np.asarray(origin)
        translation = translation + (rotation @ (point - step @ point)[:, :, None])[:, :, 0]
        rotation = rotation @ step
    return rotation, translation


def axes_of_modified_dh(
    a: Sequence[float], d: Sequence[float], alpha: Sequence[float]
) -> tuple[list[tuple[Vector, Vector]], Array, Array]:
    """Direction and origin of every axis, and rotation and position of the last frame, all axes at zero.

    Frame i follows from frame i-1 by Rx(α) Tx(a) Rz(q) Tz(d) (J. J. Craig 1986); `a`, `d` mm, `alpha` degree.
    """
    from scipy.spatial.transform import Rotation

    rotation, position = np.eye(3), np.zeros(3)
    axes = []
    for length, offset, twist in zip(a, d, alpha, strict=True):
        position = position + rotation @ np.array([length, 0.0, 0.0])
        rotation = rotation @ Rotation.from_euler("x", twist, degrees=True).as_matrix()
        position = position + rotation @ np.array([0.0, 0.0, offset])
        axes.append((rounded(rotation[:, 2]), rounded(position)))
    return axes, rotation, position


def rounded(vector: Array, digits: int = 9) -> Vector:
    """Three numbers to 1e-9, or to other `digits`, without negative zeros."""
    x, y, z = (round(float(v), digits) + 0.0 for v in vector)
    return x, y, z


def placement(poses: tuple[Array, Array], readings: Sequence[Array]) -> tuple[Array, Array, Array]:
    """Rotation (3, 3), shift (3,) of machine to tracker and the reflectors (n, 3) in the tool frame.

    `poses` of the tool frame (rotations (N, 3, 3), translations (N, 3) mm), `readings` (N, 3) mm of each reflector.
    `Rᵀp - Rᵀt = T(q)·x` is linear in Rᵀ, Rᵀt and the reflectors x. Rᵀ is then projected on the rotations (W.
    Kabsch 1976) and the rest solved again.
    """
    rotation, position = poses
    n, count = len(position), len(readings)
    free = np.zeros((count, n, 3, 12 + 3 * count))
    for k, p in enumerate(readings):
        for row in range(3):
            free[k, :, row, 3 * row : 3 * row + 3] = p
        free[k, :, range(3), range(9, 12)] = -1.0
        free[k, :, :, 12 + 3 * k : 15 + 3 * k] = -rotation
    right = np.broadcast_to(position, (count, n, 3)).reshape(-1)
    matrix = free.reshape(count * n * 3, -1)
    solution = np.linalg.lstsq(matrix, right, rcond=None)[0]
    u, _, v = np.linalg.svd(solution[:9].reshape(3, 3))
    inverse = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    rest = np.linalg.lstsq(matrix[:, 9:], right - matrix[:, :9] @ inverse.reshape(-1), rcond=None)[0]
    return inverse.T, inverse.T @ rest[:3], rest[3:].reshape(count, 3)
