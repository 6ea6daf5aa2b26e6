"""Target `setp`: HAL lines for LinuxCNC's stock trunnion kinematics, and what these cannot hold.

With rot = (x-rot-point, y-rot-point, z-rot-point) and d = (x-offset, 0, z-offset) for xyzbc-trt-kins, (0, y-offset, z-offset)
for xyzac-trt-kins, the module says (src/emc/kinematics/trtfuncs.c; tool length aside)

    joint = rot + d + R_tilt(-s q)·[R_z(-s C)·(world - rot) - d]

with s = 1 where its pin conventional-directions is 1 and s = -1 where that is 0 or missing (LinuxCNC 2.9 has no such pin). In
the machine file these are rotary axes along, or against, x, y and z. Solved for `world` it is linear in its four numbers. They
are fitted to the identified model over the workspace, together with the work offset, which the operator sets anyway. Only the
sum of z-rot-point and z-offset matters.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.codegen._chain import chain_of
from symfive.codegen._entry import Change, digits_of
from symfive.codegen._sources import solved_axes
from symfive.codegen._subject import Subject, table_axes
from symfive.compiled.scalar import number
from symfive.errors import InputError

RADIUS, HEIGHTS, TOOL, STEPS = 100.0, (0.0, 150.0), 150.0, 7
RESOLUTION = 1e-4
"""mm to which the pins are written; LinuxCNC itself takes any number."""


@dataclass(frozen=True)
class Poses:
    """`q` (N, axes) mm and rad, the tool's point in the workpiece by design and by the model (N, 3) mm, its
    derivatives by the parameters in their own units (N, 3, k)."""

    q: Array
    nominal: Array
    real: Array
    real_by_p: Array


def workspace_poses(subject: Subject) -> Poses:
    """Points on the rim, between and at the centre of the table at two heights, at every combination of rotary positions."""
    machine, space = subject.machine, subject.machine.workspace
    radius = space.table_radius or RADIUS
    tool = np.array([0.0, 0.0, -float(np.mean(space.tool_length or (TOOL, TOOL)))])
    spots = [
        (0.0, 0.0),
        *((r * np.cos(a), r * np.sin(a)) for r in (radius, 0.5 * radius) for a in (0.5, 2.1, 3.7, 5.2)),
    ]
    centre = machine.table_centre
    targets = np.array([(centre[0] + x, centre[1] + y, z) for z in space.ball_height or HEIGHTS for x, y in spots])
    ranges = []
    for name in subject.axes:
        axis = machine.axes[name]
        low, high = (v * axis.to_internal for v in axis.travel)
        full = axis.rotary and high - low >= 2.0 * np.pi
        ranges.append(np.linspace(-np.pi, np.pi, 2 * STEPS, endpoint=False) if full
                      else np.linspace(low, high, STEPS) if axis.rotary else np.zeros(1))  # fmt: skip
    positions = np.array(list(itertools.product(*ranges)))
    q = np.repeat(positions, len(targets), axis=0)
    wanted = np.tile(targets, (len(positions), 1))
    chain = chain_of(subject)
    wanted_of = (chain.nominal_position, chain.nominal_position_by_q, chain.position, chain.position_by_p)
    outputs = [ca.densify(x) for x in wanted_of]
    function = ca.Function("poses", [chain.q, chain.tool, chain.p], outputs)
    places = [subject.axes.index(name) for name in solved_axes(machine)]
    ball, slope, *_ = _many(function, q, tool, subject)
    q[:, places] += np.linalg.solve(slope[:, :, places], (wanted - ball[:, :, 0])[:, :, None])[:, :, 0]
    nominal, _, real, by_p = _many(function, q, tool, subject)
    return Poses(q, nominal[:, :, 0], real[:, :, 0], by_p)


def _many(function: ca.Function, q: Array, tool: Array, subject: Subject) -> list[Array]:
    values = ca.DM(list(subject.values)) if subject.values else ca.DM(0, 1)
    parts = function.map(len(q))(ca.DM(q.T), ca.repmat(ca.DM(tool), 1, len(q)), ca.repmat(values, 1, len(q)))
    return [np.asarray(part, dtype=float).reshape(3, len(q), -1).transpose(1, 0, 2) for part in parts]


@dataclass(frozen=True)
class TrunnionFit:
    """The four numbers (x-rot-point, y-rot-point, lateral offset, z-offset) by `design` and `fitted` (4) mm; `uncertainty` (4)
    the expanded one (k = 2) of the change, None where nothing was measured; rms of the deviation over the workspace `before`
    and `after`, µm, the work offset set anew each time."""

    design: Array
    fitted: Array
    uncertainty: Array | None
    before: float
    after: float

    @property
    def changes(self) -> list[Change]:
        """Each number with its uncertainty."""
        spread = [None] * 4 if self.uncertainty is None else [float(u) for u in self.uncertainty]
        numbers = zip(self.design, self.fitted, spread, strict=True)
        return [Change(float(old), float(new), RESOLUTION, u) for old, new, u in numbers]


def setp_files(subject: Subject, prefix: str) -> dict[str, str]:
    """The HAL file. Raises `InputError` for machines that are not trunnions of the form XYZAC or XYZBC."""
    tilt, sense = _tilt(subject)
    module = f"xyz{tilt.lower()}c-trt-kins"
    fit, changes = entered_fit(subject)
    lateral = "x-offset" if tilt == "B" else "y-offset"
    pins = ("x-rot-point", "y-rot-point", lateral, "z-offset")
    known = "not known: nothing was measured, the design values stand."
    if subject.covariance is not None:
        known = "U is the expanded one (k = 2) of the change, from the fit alone. What is within it is not"
    lines = [
        f"# {module}: values from the identified model, made by symfive. Draft: check the round trip before you cut.",
        f"# machine     {subject.machine.name}, {subject.machine.structure.code}",
        f"# model       sha256 {subject.digest}",
        f"# It holds    4 numbers: where C lies along x and y, and where {tilt} lies across itself.",
        "# It cannot   hold tilts of the rotary axes, squareness of X Y Z, error motions, gravity sag.",
        f"# Residual    {fit.before:.2f} um rms over the workspace as designed, {fit.after:.2f} um rms with these values",
        "#             (the work offset set anew each time); the target linuxcnc leaves none of it.",
        f"# Uncertainty {known}",
        *(
            ["#             entered: the design value stands, and the others are fitted without it."]
            if subject.fitted
            else []
        ),
        f"# Signs       {tilt} and C of the machine file turn as the module does where its pin conventional-directions is",
        f"#             {'1, after ISO 841' if sense > 0.0 else '0 or missing, against ISO 841'}; the values hold for both.",
        "# Beware      xyzbc-trt-kins of the development branch from June 2025 to September 2026 has a wrong inverse where",
        "#             conventional-directions is 0 (LinuxCNC issue 4546).",
        "# z-offset    is written for z-rot-point 0; keep another z-rot-point and subtract it from z-offset.",
        f"setp {module}.z-rot-point 0.0",
    ]
    for pin, change in zip(pins, changes, strict=True):
        value = round(change.new, change.decimals) if change.entered else round(change.old, 6)
        lines += [f"# {pin}: {_said(change)}", f"setp {module}.{pin} {number(value + 0.0)}"]
    return {f"{prefix}-{module}.hal": "\n".join(lines) + "\n"}


def _said(change: Change) -> str:
    words = f"designed {change.old:.4f} mm"
    if change.uncertainty is None:
        return f"{words}, not measured"
    moved, digits = 1e3 * change.difference, digits_of(1e3 * change.uncertainty) if change.uncertainty else 1
    spread = f"{round(moved, digits) + 0.0:+.{digits}f} um, U {1e3 * change.uncertainty:.{digits}f} um"
    return f"{words}, changed by {spread}" if change.entered else f"{words}, change {spread}: {change.reason}"


def entered_fit(subject: Subject) -> tuple[TrunnionFit, list[Change]]:
    """The fit of the numbers that are entered, and all four changes: of those that are not, as they came out when they were
    dropped."""
    poses, free = workspace_poses(subject), tuple(range(4))
    said: dict[int, Change] = {}
    while True:
        fit = fit_trunnion(subject, poses, free)
        said |= {i: fit.changes[i] for i in free}
        kept = tuple(i for i in free if said[i].entered)
        if kept == free:
            return fit, [said[i] for i in range(4)]
        free = kept


def _tilt(subject: Subject) -> tuple[str, float]:
    """The tilting axis, A or B, of a machine that the stock modules describe, and the s of the module (1 or -1)."""
    first, second = table_axes(subject, "LinuxCNC's stock trunnion kinematics")
    machine = subject.machine
    letters = {"X": (1, 0, 0), "Y": (0, 1, 0), "Z": (0, 0, 1), "A": (1, 0, 0), "B": (0, 1, 0), "C": (0, 0, 1)}
    sense = float(np.sign(np.sum(machine.axes[second].direction)))
    usual = all(
        np.allclose((sense if axis.rotary else 1.0) * np.array(axis.direction), letters.get(name, (0, 0, 0)), atol=1e-9)
        for name, axis in machine.axes.items()
    )
    if first not in ("A", "B") or second != "C" or not usual or set(machine.axes) != {*"XYZC", first}:
        raise InputError(
            "LinuxCNC's stock trunnion kinematics know X, Y, Z along x, y and z, and a tilting A or B and a C on it, both along "
            "or both against x, y and z",
            remedy="use the target linuxcnc, which holds every structure",
        )
    return first, sense


def fit_trunnion(subject: Subject, poses: Poses, free: Sequence[int] = (0, 1, 2, 3)) -> TrunnionFit:
    """The numbers that are `free` fitted to the deviation over the poses, the others as designed."""
    tilt, sense = _tilt(subject)
    machine = subject.machine
    place = {name: i for i, name in enumerate(subject.axes)}
    c, t = machine.axes["C"].origin, machine.axes[tilt].origin
    lateral = 0 if tilt == "B" else 1
    design = np.array([c[0], c[1], t[lateral] - c[lateral], t[2]])
    q = sense * poses.q
    turn_c, turn_t = _about(2, q[:, place["C"]]), _about(1 if tilt == "B" else 0, q[:, place[tilt]])
    both = turn_c @ turn_t
    identity = np.broadcast_to(np.eye(3), both.shape)
    by_rot, by_d = identity - both, turn_c - both
    numbers = np.concatenate([by_rot[:, :, :2], by_d[:, :, [lateral]], by_d[:, :, [2]]], axis=2)
    matrix = np.concatenate([numbers[:, :, list(free)], identity], axis=2).reshape(-1, len(free) + 3)
    deviation = poses.real - poses.nominal
    solve = np.linalg.pinv(matrix, rcond=1e-9)
    found = solve @ deviation.reshape(-1)
    left = (deviation.reshape(-1) - matrix @ found).reshape(deviation.shape)
    change = np.zeros(4)
    change[list(free)] = found[: len(free)]
    offset = deviation - deviation.mean(axis=0)
    return TrunnionFit(design, design + change, _expanded(subject, poses, solve, free), _rms(offset), _rms(left))


def _expanded(subject: Subject, poses: Poses, solve: Array, free: Sequence[int]) -> Array | None:
    """Expanded uncertainty of the free numbers (4), mm; 0 of the others."""
    if subject.covariance is None:
        return None
    by_p = (solve @ poses.real_by_p.reshape(solve.shape[1], -1))[: len(free)]
    found = np.zeros(4)
    found[list(free)] = subject.expanded(by_p)
    return found


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
