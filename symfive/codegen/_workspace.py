"""Poses over the workspace of a machine and what the model says there, for comparing it with poorer models."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.codegen._chain import chain_of
from symfive.codegen._sources import solved_axes
from symfive.codegen._subject import Subject

RADIUS, HEIGHTS, TOOL, STEPS = 100.0, (0.0, 150.0), 150.0, 7


@dataclass(frozen=True)
class Poses:
    """`q` (N, axes) mm and rad, `tool` (3) mm, the tool's point in the workpiece by design and by the model (N, 3) mm, its
    derivatives by the parameters in their own units (N, 3, k)."""

    q: Array
    tool: Array
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
    return Poses(q, tool, nominal[:, :, 0], real[:, :, 0], by_p)


def _many(function: ca.Function, q: Array, tool: Array, subject: Subject) -> list[Array]:
    values = ca.DM(list(subject.values)) if subject.values else ca.DM(0, 1)
    parts = function.map(len(q))(ca.DM(q.T), ca.repmat(ca.DM(tool), 1, len(q)), ca.repmat(values, 1, len(q)))
    return [np.asarray(part, dtype=float).reshape(3, len(q), -1).transpose(1, 0, 2) for part in parts]
