"""The paper's equations, by number, in its own signs: mm and rad, B and C are the angles by which the *table* turns.

The six errors of B are E(B) = [dx, dy, dz, alpha, beta, gamma]_BY (table 1: three shifts, B to Z squareness, orientation
about Y, B to X squareness), those of C likewise with the index CB; all refer to the intersection of the two axes. ISO 841
counts the angle of an axis that carries the workpiece the other way round: B = -(command of B). With that the paper's
[dx … gamma]_BY are EXB … ECB of ISO 230-1 (with their constants EX0B … EC0B) and those of CB are EXC … ECC.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

B_ERRORS = ("dx_BY", "dy_BY", "dz_BY", "alpha_BY", "beta_BY", "gamma_BY")
"""Names of E(B), (10)."""
LEVER_MM = 100.0
"""Angles times this length stand beside shifts where a rank or a condition number is asked for."""
RANK_TOLERANCE = 1e-9


def homogeneous(errors: ArrayLike, angle: ArrayLike, about: str) -> Array:
    """D_x D_y D_z D_a D_b D_c D_about(angle): six errors (..., 6) mm and rad, then the axis' turn; (6) and (7), exact."""
    dx, dy, dz, alpha, beta, gamma = np.moveaxis(np.asarray(errors, dtype=float), -1, 0)
    turned = _turn("x", alpha) @ _turn("y", beta) @ _turn("z", gamma) @ _turn(about, angle)
    matrix = np.zeros((*turned.shape[:-2], 4, 4))
    matrix[..., :3, :3] = turned
    matrix[..., 0, 3], matrix[..., 1, 3], matrix[..., 2, 3], matrix[..., 3, 3] = dx, dy, dz, 1.0
    return matrix


def _turn(about: str, angle: ArrayLike) -> Array:
    """D_a, D_b or D_c as rotation matrices (..., 3, 3); definition (1)."""
    angle = np.asarray(angle, dtype=float)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[about]
    matrix = np.broadcast_to(np.eye(3), (*angle.shape, 3, 3)).copy()
    matrix[..., i, i] = matrix[..., j, j] = np.cos(angle)
    matrix[..., j, i], matrix[..., i, j] = np.sin(angle), -np.sin(angle)
    return matrix


def rotation_c(c: ArrayLike) -> Array:
    """D_c(C) (..., 3, 3)."""
    return _turn("z", c)


def b_jacobian(b: ArrayLike, c: ArrayLike, nest: Sequence[float]) -> Array:
    """J(B, C) of (12): d(w_p)/d(E(B)) (..., 3, 6) at the nest w_p* (mm), from (8) and (9) with the errors of C at zero."""
    sb, cb, sc, cc = np.sin(b), np.cos(b), np.sin(c), np.cos(c)
    o = np.zeros(np.broadcast_shapes(np.shape(b), np.shape(c)))
    one = o + 1.0
    # rows DX, DY, DZ, DA, DB, DC of (9), columns E(B)
    rows = [
        [-cb * cc, -sc * one, sb * cc, o, o, o],
        [cb * sc, -cc * one, -sb * sc, o, o, o],
        [-sb * one, o, -cb * one, o, o, o],
        [o, o, o, -cb * cc, -sc * one, sb * cc],
        [o, o, o, cb * sc, -cc * one, -sb * sc],
        [o, o, o, -sb * one, o, -cb * one],
    ]
    return _displaced(np.moveaxis(np.array([[o + entry for entry in row] for row in rows]), (0, 1), (-2, -1)), nest)


def c_jacobian(c: ArrayLike, nest: Sequence[float]) -> Array:
    """d(w_p)/d(errors of C) (..., 3, 6) of (8) and (9): dx, dy, dz, alpha, beta, gamma of CB."""
    return b_jacobian(np.zeros(np.shape(c)), c, nest)


def _displaced(shifts_and_turns: Array, nest: Sequence[float]) -> Array:
    """(8): the displacement of the point `nest` by shifts DX, DY, DZ and turns DA, DB, DC, (..., 3, k)."""
    x, y, z = nest
    lever = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    return np.asarray(shifts_and_turns[..., :3, :] + lever @ shifts_and_turns[..., 3:, :])


def joint_jacobian(b: Array, c: Array, nests: Sequence[Sequence[float]]) -> Array:
    """(14) for all B_i at once: displacements from the pose B = C = 0 against the stacked E(B_i), (3·poses·nests, 6·len(b))."""
    origin = int(np.argmin(np.abs(b)))
    blocks = []
    for nest in nests:
        reference = b_jacobian(0.0, 0.0, nest)
        for i, angle in enumerate(b):
            block = np.zeros((len(c), 3, len(b), 6))
            block[:, :, i, :] += b_jacobian(angle, c, nest)
            block[:, :, origin, :] -= reference
            blocks.append(block.reshape(3 * len(c), -1))
    return np.concatenate(blocks)


def null_combinations(jacobian: Array) -> tuple[int, Array]:
    """Rank, and the null vectors (k, n) in E's own units: angles are weighed with 100 mm."""
    weights = np.tile([1.0] * 3 + [1.0 / LEVER_MM] * 3, jacobian.shape[1] // 6)
    _, singular, vectors = np.linalg.svd(jacobian * weights, full_matrices=True)
    rank = int(np.sum(singular > RANK_TOLERANCE * singular[0]))
    return rank, np.asarray(vectors[rank:] * weights)


def b_errors(b: Array, c: Array, displacement: Array, nests: Sequence[Sequence[float]]) -> Array:
    """(10)-(15): E(B_i) (len(b), 6) from the displacements w_p (nests, len(b), len(c), 3) that vanish at B = C = 0.

    B = 0 first. It knows four of six: dz_BY(0) and gamma_BY(0) are set to zero, which the paper does not say.
    """
    found = np.zeros((len(b), 6))
    origin = int(np.argmin(np.abs(b)))
    reference = np.concatenate([np.tile(b_jacobian(0.0, 0.0, nest), (len(c), 1)) for nest in nests])
    for i in [origin, *(k for k in range(len(b)) if k != origin)]:
        jacobian = np.concatenate([b_jacobian(b[i], c, nest).reshape(-1, 6) for nest in nests])
        readings = displacement[:, i].ravel()
        if i == origin:
            seen = [0, 1, 3, 4]
            found[i, seen] = np.linalg.lstsq((jacobian - reference)[:, seen], readings, rcond=None)[0]
        else:
            found[i] = np.linalg.lstsq(jacobian, readings + reference @ found[origin], rcond=None)[0]
    return found


def from_reference(displacement: Array, e_origin: Array, nest: Sequence[float]) -> Array:
    """Displacements from the nominal nest (…, 3) mm: those from the pose B = C = 0 plus J(0, 0) E(0), as in (14)."""
    return np.asarray(displacement + b_jacobian(0.0, 0.0, nest) @ e_origin)


def absolute_ball(c: ArrayLike, nest: Sequence[float], displacement: Array) -> Array:
    """(16), (17): b_p = D_c(C)(w_p* + displacement) (..., 3) mm, in the frame that turns with B."""
    return np.asarray((rotation_c(c) @ (np.asarray(nest) + displacement)[..., None])[..., 0])


def expected_ball(e: Array, b: ArrayLike, c: ArrayLike, nest: Sequence[float]) -> Array:
    """(18), (19): where E(B) alone brings the table's point w_p*, seen from the ideal frame that turns with B (..., 3) mm."""
    carried = homogeneous(e, b, "y") @ _four(rotation_c(c) @ np.asarray(nest))[..., None]
    return np.asarray((_turn("y", -np.asarray(b)) @ carried[..., :3, :])[..., 0])


def own_influence_of_c(
    b: ArrayLike, c: ArrayLike, e: Array, nest: Sequence[float], displacement: Array, *, sign: float = 1.0
) -> Array:
    """(20): q = b_p + (b_p^ - b_p*), less b_p*: what C does by itself, (..., 3) mm.

    b_p is the ball seen from the table and moves against the table, b_p^ is a point of the table: the influence of B is
    *added* back. `sign` = -1 is the wrong reading of the print.
    """
    nominal = (rotation_c(c) @ np.asarray(nest)[:, None])[..., 0]
    seen = absolute_ball(c, nest, displacement)
    return np.asarray(seen - nominal + sign * (expected_ball(e, b, c, nest) - nominal))


def c_errors(c: ArrayLike, nests: Sequence[Sequence[float]], own: Array) -> Array:
    """(21), (22) with two nests one above the other: errors of C (..., 6) from `own` = q - b_p* (2, ..., 3) mm, gamma = 0.

    In the sense of the table, -(q - b_p*) = t + rotation × b_p*.
    """
    (low, high), height = own, nests[1][2] - nests[0][2]
    found = np.zeros((*low.shape[:-1], 6))
    found[..., 3] = (high[..., 1] - low[..., 1]) / height
    found[..., 4] = -(high[..., 0] - low[..., 0]) / height
    nominal = (rotation_c(c) @ np.asarray(nests[0])[:, None])[..., 0]
    found[..., :3] = -low - np.cross(found[..., 3:], np.broadcast_to(nominal, low.shape))
    return found


def table_position(e: Array, b: ArrayLike, c: ArrayLike, nest: Sequence[float], e_c: ArrayLike = 0.0) -> Array:
    """(23): the table's point w_p* in the machine frame, r_p = rTw w_p* (..., 3) mm, with errors of B and of C."""
    six = np.broadcast_to(np.asarray(e_c, dtype=float), (*np.broadcast_shapes(np.shape(b), np.shape(c)), 6))
    whole = homogeneous(e, b, "y") @ homogeneous(six, c, "z") @ np.array([*nest, 1.0])
    return np.asarray(whole[..., :3])


def _four(points: Array) -> Array:
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)
