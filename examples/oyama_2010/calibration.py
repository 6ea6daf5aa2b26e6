"""Calibration of the R-test itself: directions of its sensors and run-out of its ball (Oyama et al. 2010, section 3.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.errors import InputError


@dataclass(frozen=True)
class SensorCalibration:
    """`directions` (K, 3): each sensor's sensitivity vector (its length is the gain), `offsets` (K,) mm,
    `std` (K, 3) of the directions, `rms` (K,) of the residuals, mm."""

    directions: Array
    offsets: Array
    std: Array
    rms: Array

    def displacement(self, signals: Array) -> Array:
        """Displacements (N, 3) mm of the ball from signals (N, K) mm; with K > 3 by least squares."""
        return np.asarray(np.linalg.lstsq(self.directions, (np.asarray(signals) - self.offsets).T, rcond=None)[0].T)


def calibrate_sensors(moves: Array, signals: Array) -> SensorCalibration:
    """Sensor k reads s_k = n_k · δ + const for flat-ended probes; known moves δ give n_k by least squares.

    `moves` (M, 3) mm known displacements of the ball, `signals` (M, K) mm readings. Raises `InputError` where the moves
    do not span space.
    """
    moves, signals = np.asarray(moves, dtype=float), np.asarray(signals, dtype=float)
    if moves.ndim != 2 or moves.shape[1] != 3 or len(moves) != len(signals):
        raise InputError(f"moves have shape {moves.shape}, signals {signals.shape}", remedy="give (M, 3) and (M, K)")
    design = np.column_stack([moves, np.ones(len(moves))])
    singular = np.linalg.svd(design - design.mean(axis=0) * [1, 1, 1, 0], compute_uv=False)
    if len(moves) < 5 or singular[-1] < 1e-9 * singular[0]:
        raise InputError(
            "the known moves do not span the three directions", remedy="move the ball in X, Y and Z, 5 times or more"
        )
    solution = np.asarray(np.linalg.lstsq(design, signals, rcond=None)[0], dtype=float)
    residual = signals - design @ solution
    variance = np.sum(residual**2, axis=0) / (len(moves) - 4)
    cofactor = np.diag(np.linalg.inv(design.T @ design))[:3]
    return SensorCalibration(
        solution[:3].T,
        solution[3],
        np.asarray(np.sqrt(np.outer(variance, cofactor)), dtype=float),
        np.asarray(np.sqrt(np.mean(residual**2, axis=0)), dtype=float),
    )


@dataclass(frozen=True)
class BallRunout:
    """Eccentricity of the ball in the spindle at angle zero, (x, y) mm, with 1σ."""

    eccentricity: Array
    std: Array


def ball_runout(angles: Array, displacements: Array) -> BallRunout:
    """Run-out of the ball on the spindle: δ(φ) = (Rz(φ) - I)·e while the spindle is indexed.

    `angles` (M,) rad from the first position, `displacements` (M, 2) or (M, 3) mm.
    """
    angles, displacements = np.asarray(angles, dtype=float), np.asarray(displacements, dtype=float)[:, :2]
    cos, sin = np.cos(angles) - 1.0, np.sin(angles)
    design = np.concatenate([np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)])
    if np.linalg.matrix_rank(design) < 2:
        raise InputError("the spindle was not indexed", remedy="turn it to at least two other angles")
    target = np.concatenate([displacements[:, 0], displacements[:, 1]])
    solution, *_ = np.linalg.lstsq(design, target, rcond=None)
    dof = max(len(target) - 2, 1)
    variance = float(np.sum((target - design @ solution) ** 2)) / dof
    return BallRunout(solution, np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design))))
