"""Target `setp`: HAL lines for LinuxCNC's stock trunnion kinematics, and what these cannot hold.

With rot = (x-rot-point, y-rot-point, z-rot-point) and d = (x-offset, 0, z-offset) for xyzbc-trt-kins, (0, y-offset, z-offset)
for xyzac-trt-kins, the module says (src/emc/kinematics/trtfuncs.c; tool length aside)

    joint = rot + d + R_tilt(-s q)·[R_z(-s C)·(world - rot) - d]

which is linear in its four numbers when it is solved for `world`. They are fitted to the identified model over the workspace,
together with the work offset, which the operator sets anyway. Only the sum of z-rot-point and z-offset matters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from symfive.codegen._lines import table_axes
from symfive.codegen._subject import Subject
from symfive.codegen._workspace import Poses, workspace_poses
from symfive.compiled._scalar import number
from symfive.errors import InputError

__all__ = ["fit_trunnion", "setp_files"]

Array = NDArray[np.float64]


def setp_files(subject: Subject, prefix: str) -> dict[str, str]:
    """The HAL file. Raises `InputError` for machines that are not trunnions of the form XYZAC or XYZBC."""
    tilt = _tilt(subject)
    module = f"xyz{tilt.lower()}c-trt-kins"
    design, fitted, before, after = fit_trunnion(subject, workspace_poses(subject))
    lateral = "x-offset" if tilt == "B" else "y-offset"
    pins = ("x-rot-point", "y-rot-point", lateral, "z-offset")
    lines = [
        f"# {module}: values from the identified model, made by symfive. Draft: check the round trip before you cut.",
        f"# machine     {subject.machine.name}, {subject.machine.structure.code}",
        f"# model       sha256 {subject.digest}",
        f"# It holds    4 numbers: where C lies along x and y, and where {tilt} lies across itself.",
        "# It cannot   hold tilts of the rotary axes, squareness of X Y Z, error motions, gravity sag.",
        f"# Residual    {before:.2f} um rms over the workspace as designed, {after:.2f} um rms with these values",
        "#             (the work offset set anew each time); the target linuxcnc leaves none of it.",
        "# Signs       the values do not depend on conventional-directions, but the machine file does: it is ISO 841, which is",
        f"#             conventional-directions 1. Where that is 0 or missing, {tilt} and C turn the other way.",
        "# Beware      xyzbc-trt-kins of the development branch from June 2025 to September 2026 has a wrong inverse where",
        "#             conventional-directions is 0 (LinuxCNC issue 4546).",
        "# z-offset    is written for z-rot-point 0; keep another z-rot-point and subtract it from z-offset.",
        f"setp {module}.z-rot-point 0.0",
    ]
    for pin, old, new in zip(pins, design, fitted, strict=True):
        lines.append(f"# {pin}: designed {old:.6f}, changed by {1e3 * (new - old):+.2f} um")
        lines.append(f"setp {module}.{pin} {number(round(float(new), 6))}")
    return {f"{prefix}-{module}.hal": "\n".join(lines) + "\n"}


def _tilt(subject: Subject) -> str:
    """The tilting axis, A or B, of a machine that the stock modules describe."""
    first, second = table_axes(subject, "LinuxCNC's stock trunnion kinematics")
    machine = subject.machine
    letters = {"X": (1, 0, 0), "Y": (0, 1, 0), "Z": (0, 0, 1), "A": (1, 0, 0), "B": (0, 1, 0), "C": (0, 0, 1)}
    usual = all(
        np.allclose(axis.direction, letters.get(name, (0, 0, 0)), atol=1e-9) for name, axis in machine.axes.items()
    )
    if first not in ("A", "B") or second != "C" or not usual or set(machine.axes) != {*"XYZC", first}:
        raise InputError(
            "LinuxCNC's stock trunnion kinematics know X, Y, Z, a tilting A or B and a C on it, along x, y and z",
            remedy="use the target linuxcnc, which holds every structure",
        )
    return first


def fit_trunnion(subject: Subject, poses: Poses) -> tuple[Array, Array, float, float]:
    """The four numbers by design and fitted (mm), and the rms of the remaining deviation before and after (µm)."""
    tilt = _tilt(subject)
    machine = subject.machine
    place = {name: i for i, name in enumerate(subject.axes)}
    c, t = machine.axes["C"].origin, machine.axes[tilt].origin
    lateral = 0 if tilt == "B" else 1
    design = np.array([c[0], c[1], t[lateral] - c[lateral], t[2]])
    turn_c, turn_t = _about(2, poses.q[:, place["C"]]), _about(1 if tilt == "B" else 0, poses.q[:, place[tilt]])
    both = turn_c @ turn_t
    identity = np.broadcast_to(np.eye(3), both.shape)
    by_rot, by_d = identity - both, turn_c - both
    columns = np.concatenate([by_rot[:, :, :2], by_d[:, :, [lateral]], by_d[:, :, [2]], identity], axis=2)
    deviation = poses.real - poses.nominal
    matrix, right = columns.reshape(-1, 7), deviation.reshape(-1)
    change = np.linalg.lstsq(matrix, right, rcond=1e-9)[0]
    left = (right - matrix @ change).reshape(deviation.shape)
    offset = deviation - deviation.mean(axis=0)
    return design, design + change[:4], _rms(offset), _rms(left)


def _about(axis: int, angle: Array) -> Array:
    """Rotations (N, 3, 3) about x, y or z."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    found = np.zeros((len(angle), 3, 3))
    found[:, axis, axis] = 1.0
    found[:, i, i] = found[:, j, j] = np.cos(angle)
    found[:, j, i], found[:, i, j] = np.sin(angle), -np.sin(angle)
    return found


def _rms(deviation: Array) -> float:
    """Root mean square of the distances, µm."""
    return 1e3 * float(np.sqrt(np.mean(np.sum(deviation**2, axis=1))))
