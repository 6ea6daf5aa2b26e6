"""The paper's equations, by number: mm and rad. Positions and angles are those of the *table*: x = -X, b = -B, c = -C.

Frames R, Y, X, Z and B share the intersection of the B and C axes. A table ball stands at the height Dz above it. Names:
x_b, z_b, alpha_b, gamma_b are EX0B, EZ0B, EA0B, EC0B of ISO 230-1, x_c, y_c, alpha_c, beta_c are EX0C, EY0C, EA0C, EB0C, all
referring to that intersection; a_xy, a_yz, a_xz are EC0X, EA0Z, EB0Z.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LOCATION = ("EX0B", "EZ0B", "EA0B", "EC0B", "EX0C", "EY0C", "EA0C", "EB0C")
"""x_b, z_b, alpha_b, gamma_b, x_c, y_c, alpha_c, beta_c of (4)."""


# --- (2), (3), (8): the chain as printed ---------------------------------------------------------------------
def small_motion(shift: Sequence[Any], turn: Sequence[Any]) -> Any:
    """S(d; e) of the paper, 4 × 4: a small shift (mm) and turn (rad), symbolic."""
    (x, y, z), (a, b, c) = shift, turn
    return ca.vertcat(ca.horzcat(1, -c, b, x), ca.horzcat(c, 1, -a, y), ca.horzcat(-b, a, 1, z), ca.horzcat(0, 0, 0, 1))


def points_of_table(x: Any, y: Any, a_xy: Any, of_x: Sequence[Any], point: Sequence[Any], *, printed: bool) -> Any:
    """A point of the X table in R by (8), Y without error motions: squareness a_xy before or after the motion of Y.

    `of_x` dx, dy, dz, ex, ey, ez of X; `point` mm from the intersection. As printed, Y_PIGE stands in front of Y_ideal.
    """
    zero = (0, 0, 0)
    along_y, squareness = small_motion((0, y, 0), zero), small_motion(zero, (0, 0, a_xy))
    first = squareness @ along_y if printed else along_y @ squareness
    whole = first @ small_motion(of_x[:3], of_x[3:]) @ small_motion((x, 0, 0), zero)
    return (whole @ ca.vertcat(*point, 1))[:3]


def squareness_seen(a_xy: float, *, printed: bool) -> float:
    """X direction · Y direction of the chain (8), to first order the departure from 90° (rad)."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    place = points_of_table(x, y, a_xy, (0, 0, 0, 0, 0, 0), (0, 0, 0), printed=printed)
    directions = ca.Function("directions", [x, y], [ca.jacobian(place, ca.vertcat(x, y))])
    along_x, along_y = np.asarray(directions(0.0, 0.0)).T
    return float(along_x @ along_y)


# --- (9), (10): three lines of the cross grid ----------------------------------------------------------------
def line_displacement(point: Sequence[Any], of_x: Sequence[Any], a_xy: Any) -> Any:
    """(9): Dx, Dy, Dz of a point (x_j, y_j, z_j) on a line along X; the term in a_xz does not exist in R and is left out."""
    (x, y, z), (dx, dy, dz, ex, ey, ez) = point, of_x
    return ca.vertcat(dx - ez * y + ey * z, dy - ex * z + ez * x + a_xy * x, dz - ey * x + ex * y)


def lines_matrix(lever: Any, offsets: Sequence[tuple[float, float]]) -> Array:
    """M of (10): readings Dx1, Dy1, Dz1, Dx2, Dy2, Dx3 from dx, dy, dz, ex, ey, ez; (..., 6, 6).

    `lever` (...) mm is x_j of the measured point, `offsets` (y_j, z_j) of the three lines, mm. Rotations about the fixed
    origin (PDGE · ideal, as printed) count x_j in R; about the carriage (ideal · PDGE, as in ISO 230-1 and symfive) it counts
    in the carriage's frame.
    """
    x = np.asarray(lever, dtype=float)
    matrix = np.zeros((*x.shape, 6, 6))
    (y1, z1), (y2, z2), (y3, z3) = offsets
    for row, (y, z) in zip((0, 3, 5), ((y1, z1), (y2, z2), (y3, z3)), strict=True):
        matrix[..., row, 0], matrix[..., row, 4], matrix[..., row, 5] = 1.0, z, -y
    for row, z in ((1, z1), (4, z2)):
        matrix[..., row, 1], matrix[..., row, 3], matrix[..., row, 5] = 1.0, -z, x
    matrix[..., 2, 2], matrix[..., 2, 3], matrix[..., 2, 4] = 1.0, y1, -x
    return matrix


# --- (11)-(13): the B axis, ball on C at height Dz -----------------------------------------------------------
def axial(b: Array, dz: float) -> Array:
    """(11), bar along Y: displacement of the ball (N, 8) per error of LOCATION."""
    o, one = np.zeros_like(b), np.ones_like(b)
    return np.stack([o, o, -dz * np.cos(b), dz * np.sin(b), o, one, -dz * one, o], axis=1)


def bar_along_x(b: Array, dz: float) -> Array:
    """(12), bar along X; the lever of beta_c is Dz, the printed letters being lost."""
    o, one = np.zeros_like(b), np.ones_like(b)
    return np.stack([one, o, o, o, np.cos(b), o, o, dz * np.cos(b)], axis=1)


def bar_along_z(b: Array, dz: float) -> Array:
    """(13), bar along Z."""
    o, one = np.zeros_like(b), np.ones_like(b)
    return np.stack([o, one, o, o, -np.sin(b), o, o, -dz * np.sin(b)], axis=1)


def turning_bar(b: Array, dz: float) -> tuple[Array, Array]:
    """Beside (12), (13), which keep the bar parallel to X and Z: a bar that turns with B, tangential and radial (N, 8)."""
    o, one = np.zeros_like(b), np.ones_like(b)
    cos, sin = np.cos(b), np.sin(b)
    return np.stack([cos, -sin, o, o, one, o, o, dz * one], axis=1), np.stack([sin, cos, o, o, o, o, o, o], axis=1)


def b_basis(b: Array) -> Array:
    """{1, cos b, sin b} (N, 3)."""
    return np.stack([np.ones_like(b), np.cos(b), np.sin(b)], axis=1)


def b_location(b: Array, dz: float, along_y: Array, along_x: Array, along_z: Array) -> Array:
    """x_b, z_b, alpha_b, gamma_b (..., 4) by least squares from the displacements (..., N) of (11)-(13)."""
    fit = np.linalg.pinv(b_basis(b)).T
    of_y, of_x, of_z = along_y @ fit, along_x @ fit, along_z @ fit
    return np.stack([of_x[..., 0], of_z[..., 0], -of_y[..., 1] / dz, of_y[..., 2] / dz], axis=-1)


# --- (14), (15): the C axis at two heights, ball at a radius, tool ball at rest on the axis --------------------
def c_harmonics(c: Array, height: float) -> Array:
    """(15): the radial displacement of the ball (N, 8) per error of LOCATION, b = 0."""
    cos, sin, o = np.cos(c), np.sin(c), np.zeros_like(c)
    return np.stack([cos, o, -height * sin, o, cos, sin, -height * sin, height * cos], axis=1)


def c_location(
    c: Array, heights: tuple[float, float], low: Array, high: Array, of_b: Array, *, literal: bool = False
) -> Array:
    """x_c, y_c, alpha_c, beta_c (..., 4) from the radial displacements (..., N) at two heights and x_b … gamma_b `of_b`.

    `literal`: (14) as printed, which takes the first plane for the intersection of the axes.
    """
    fit = np.linalg.pinv(b_basis(c)).T
    (c1, s1), (c2, s2) = (np.moveaxis((reading @ fit)[..., 1:], -1, 0) for reading in (low, high))
    x_b, alpha_b = of_b[..., 0], of_b[..., 2]
    beta, both = (c2 - c1) / (heights[1] - heights[0]), -(s2 - s1) / (heights[1] - heights[0])
    lever = 0.0 if literal else heights[0]
    return np.stack([c1 - x_b - lever * beta, s1 + lever * both, both - alpha_b, beta], axis=-1)


# --- (16)-(19): error motions of C, ball on the axis ---------------------------------------------------------
def c_motions(height: float) -> Array:
    """(16)-(18): displacements x, y, z of the ball (3, 14) per error of LOCATION and per EXC … ECC."""
    location = np.zeros((3, 8))
    location[0, [0, 4, 7]] = 1.0, 1.0, height
    location[1, [5, 2, 6]] = 1.0, -height, -height
    location[2, 1] = 1.0
    motion = np.zeros((3, 6))
    motion[:, :3] = np.eye(3)
    motion[0, 4], motion[1, 3] = height, -height
    return np.concatenate([location, motion], axis=1)


def two_heights(low: float, high: float) -> Array:
    """The matrix of (19): DRx1, DRy1, DRz1, DRx2, DRy2 from EXC, EYC, EZC, EAC, EBC."""
    whole = np.concatenate([c_motions(low)[:, 8:13], c_motions(high)[:2, 8:13]])
    return np.asarray(whole)


# --- the same for B, which the paper only mentions -----------------------------------------------------------
def b_motions(b: Array, ball: tuple[float, float, float], way: Array) -> Array:
    """Like (16)-(18): displacement along `way` (3,) of a ball of the table (N, 6) per EXB, EYB, EZB, EAB, EBB, ECB; c = 0.

    A motion of B shifts the ball and turns it about the axis, in directions that stand still: d + e × R_y(b) `ball` (mm).
    """
    cos, sin, (x, y, z) = np.cos(b), np.sin(b), ball
    place = np.stack([x * cos + z * sin, np.full_like(b, y), z * cos - x * sin], axis=1)
    return np.concatenate([np.broadcast_to(way, place.shape), np.cross(place, way)], axis=1)
