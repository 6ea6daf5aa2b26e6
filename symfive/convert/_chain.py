"""Serial chains of rotary axes in numbers: product of exponentials, modified Denavit-Hartenberg tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from symfive.convert._files import Array

__all__ = ["axes_of_modified_dh", "forward", "rounded"]

Vector = tuple[float, float, float]


def forward(axes: Mapping[str, tuple[Vector, Vector]], angles: Array) -> tuple[Array, Array]:
    """Rotations (N, 3, 3) and translations (N, 3) mm of the tool frame for angles (N, axes) in degree.

    T = Π Trans(o) Rot(e, q) Trans(-o) over the axes from the bed outward; the tool frame is the machine frame
    at zero.
    """
    n = len(angles)
    rotation, translation = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3))
    for i, (direction, origin) in enumerate(axes.values()):
        step = Rotation.from_rotvec(np.radians(angles[:, i, None]) * np.asarray(direction)).as_matrix()
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
    rotation, position = np.eye(3), np.zeros(3)
    axes = []
    for length, offset, twist in zip(a, d, alpha, strict=True):
        position = position + rotation @ np.array([length, 0.0, 0.0])
        rotation = rotation @ Rotation.from_euler("x", twist, degrees=True).as_matrix()
        position = position + rotation @ np.array([0.0, 0.0, offset])
        axes.append((rounded(rotation[:, 2]), rounded(position)))
    return axes, rotation, position


def rounded(vector: Array) -> Vector:
    """Three numbers to 1e-9, without negative zeros."""
    x, y, z = (round(float(v), 9) + 0.0 for v in vector)
    return x, y, z
