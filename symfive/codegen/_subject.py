"""What code is generated for: a machine, the parameters of its static errors with their values, and what is left out.

Where its rotary axes lie, as designed and as identified, is what the parameters of a control describe.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array
from symfive.campaign import Campaign, Run
from symfive.codegen._entry import COVERAGE
from symfive.effects import Effect, baseline_effects
from symfive.errors import InputError
from symfive.given import machine_or_model_given
from symfive.kinematics import Pose, axis_pose, ball_in_workpiece, chain_poses
from symfive.machine import Machine, machine_to_data
from symfive.model import FittedModel, apply_errors, effect_to_data, machine_parameters
from symfive.motion import Position
from symfive.parameters import Parameter
from symfive.row import Row


@dataclass(frozen=True, kw_only=True)
class Subject:
    """A machine and its static errors.

    `parameters` with names and units as in `model.json`, `values` one per parameter (fitted, or the prior mean),
    `effects` those that depend on the position alone, `left_out` the others with the reason, `fitted` whether the
    values come from an identification, `covariance` (k, k) of the values in their own units (None where nothing was
    measured), `digest` a SHA-256 of all but the covariance.
    """

    machine: Machine
    parameters: tuple[Parameter, ...]
    values: tuple[float, ...]
    effects: tuple[Effect, ...]
    left_out: tuple[tuple[str, str], ...]
    fitted: bool
    covariance: Array | None
    digest: str

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes in the order of q."""
        return self.machine.axis_names

    def row(self, q: Any, p: Any, tool: Any = (0.0, 0.0, 0.0)) -> Row:
        """The model's row at the positions q (mm, rad) and the parameters p (their own units) with the tool's point (mm, tool
        frame), errors applied."""
        balls = {f"tool_ball.{c}": tool[i] for i, c in enumerate("xyz")}
        return _row(self.machine, self.effects, self.parameters, q, p, balls)

    def changed(self, effect: Effect) -> frozenset[tuple[str, str]]:
        """What the parameters of one of the `effects` change: (`location`, `EC0B`), (`motion`, `EZB`), (`axis`, `X`), or `shift`
        and `tool` of the tool as a whole, with an empty name."""
        q, p, tool = (ca.SX.sym("x", n) for n in (len(self.axes), len(self.parameters), 3))
        row = replace(self, effects=(effect,)).row(q, p, tool)
        known = {parameter.name for parameter in machine_parameters(self.machine)}
        own = ca.vertcat(*(p[i] for i, parameter in enumerate(self.parameters) if parameter.name not in known))
        parts = {"axis": row.axis, "location": row.location, "motion": row.motion, "shift": {"": row.shift},
                 "tool": {"": row.tool_ball}}  # fmt: skip
        return frozenset(
            (kind, name) for kind, table in parts.items() for name, value in table.items() if ca.depends_on(value, own)
        )

    def expanded(self, slope: Array) -> Array:
        """Expanded uncertainties (n,) of numbers with these derivatives (n, k) by the parameters, of measured ones."""
        assert self.covariance is not None
        return np.asarray(COVERAGE * np.sqrt(np.einsum("ik,kl,il->i", slope, self.covariance, slope)))

    def function(self) -> ca.Function:
        """(q, tool, p) → the tool's point and direction in the workpiece, and the point's derivatives by q and p: the model's own
        chain, differentiated automatically. Generated code is compared with it."""
        q, tool, p = (ca.SX.sym("x", n) for n in (len(self.axes), 3, len(self.parameters)))
        row = self.row(q, p, tool)
        point = ball_in_workpiece(
            self.machine, row.axis, row.tool_ball, location=row.location, motion=row.motion, shift=row.shift
        )
        workpiece, spindle = chain_poses(self.machine, row.axis, row.location, row.motion)
        direction = workpiece.rotation.T @ spindle.rotation[:, 2]
        outputs = [ca.densify(x) for x in (point, direction, ca.jacobian(point, q), ca.jacobian(point, p))]
        return ca.Function("reference", [q, tool, p], outputs)


def subject_of(source: Machine | FittedModel | Path | str) -> Subject:
    """The subject of a machine, a fitted model, the file of either, or the name of a preset. Raises `InputError`."""
    found = machine_or_model_given(source)
    machine = found if isinstance(found, Machine) else found.machine
    also = () if isinstance(found, Machine) else found.effects
    effects: list[Effect] = []
    left_out: list[tuple[str, str]] = []
    parameters = list(machine_parameters(machine))
    commands = {name: np.array(axis.travel) for name, axis in machine.axes.items()}
    run = Run(id="codegen", instrument=("r_test",), sampling="static", time=np.array([0.0, 1.0]), commands=commands)
    campaign = Campaign(machine=machine, runs=(run,))  # the least that effects can be prepared with
    for effect in (*baseline_effects(machine), *also):
        reason, ready, its_parameters = _static(machine, effect, campaign)
        if reason:
            left_out.append((effect.key, reason))
        else:
            effects.append(ready)
            parameters += its_parameters
    known = {} if isinstance(found, Machine) else dict(found.values)
    values = tuple(float(known.get(p.name, p.mean)) for p in parameters)
    content = {
        "machine": machine_to_data(machine),
        "effects": [effect_to_data(effect) for effect in effects],
        "parameters": [[p.name, p.unit, value] for p, value in zip(parameters, values, strict=True)],
    }
    text = json.dumps(
        content, sort_keys=True, default=lambda value: dict(value) if isinstance(value, Mapping) else str(value)
    )
    return Subject(
        machine=machine, parameters=tuple(parameters), values=values, effects=tuple(effects), left_out=tuple(left_out),
        fitted=not isinstance(found, Machine),
        covariance=None if isinstance(found, Machine) else _covariance(found, parameters),
        digest=hashlib.sha256(text.encode()).hexdigest(),
    )  # fmt: skip


def _covariance(model: FittedModel, parameters: Sequence[Parameter]) -> Array:
    """That of the parameters (k, k); what the model does not know has its prior variance."""
    places = {name: i for i, name in enumerate(model.names)}
    known = [i for i, p in enumerate(parameters) if p.name in places]
    found = np.diag([p.sigma**2 for p in parameters])
    rows = [places[parameters[i].name] for i in known]
    found[np.ix_(known, known)] = model.covariance[np.ix_(rows, rows)]
    return found


def _row(
    machine: Machine,
    effects: Sequence[Effect],
    parameters: Sequence[Parameter],
    q: Any,
    p: Any,
    balls: Mapping[str, Any],
) -> Row:
    position = {name: q[i] for i, name in enumerate(machine.axis_names)}
    values = {parameter.name: parameter.scale * p[i] for i, parameter in enumerate(parameters)}
    signals = {Position(name): value for name, value in position.items()}
    row = Row(machine, position, ca.SX.sym("clock"), ca.SX.sym("time"), signals, values, balls)  # type: ignore[arg-type]
    apply_errors(row, effects)
    return row


def _static(machine: Machine, effect: Effect, campaign: Campaign) -> tuple[str, Effect, tuple[Parameter, ...]]:
    """Why it cannot be part of static kinematics ("" if it can), the prepared effect and its parameters."""
    if effect.stage not in ("axis", "structure"):
        return f"acts on the {effect.stage}, not on the geometry", effect, ()
    if effect.dynamic_only or effect.frees():
        return "acts in motion only", effect, ()
    if not all(isinstance(signal, Position) for signal in effect.signals()):
        return "depends on the path to the position", effect, ()
    if not all(effect.applies(run) for run in campaign.runs):
        return "belongs to one run", effect, ()
    ready = effect.prepare(campaign)
    parameters = ready.parameters(campaign)
    every = (*machine_parameters(machine), *parameters)
    balls = {f"table_ball.{c}": ca.SX.sym("ball") for c in "xyz"}
    row = _row(machine, (ready,), every, ca.SX.sym("q", len(machine.axes)), ca.SX.sym("p", len(every)), balls)
    parts = [*row.axis.values(), *row.location.values(), *row.motion.values(), row.shift, row.tool_ball, row.table_ball]
    if ca.depends_on(ca.vertcat(*parts[:-1]), ca.vertcat(*balls.values())):
        return "depends on where the ball on the table stands", effect, ()
    if ca.depends_on(ca.vertcat(*parts), ca.vertcat(row.clock, row.time)):
        return "depends on time", effect, ()
    return "", ready, parameters


@dataclass(frozen=True)
class AxisLine:
    """A rotary axis in the machine frame with all axes at zero: a point on it (mm) and its unit direction."""

    axis: str
    point: Array
    direction: Array


def table_axes(subject: Subject, purpose: str) -> tuple[str, str]:
    """The two rotary axes under the workpiece, the carrying one first. Raises `InputError` for other structures."""
    machine = subject.machine
    carrying = tuple(name for name in reversed(machine.structure.workpiece) if machine.axes[name].rotary)
    if len(carrying) != 2 or carrying != machine.rotary_axes:
        raise InputError(
            f'{purpose} describe two rotary axes under the workpiece, and "{machine.structure.code}" has others',
            remedy="use the target c or linuxcnc, which hold every structure",
        )
    return carrying[0], carrying[1]


def axis_lines(subject: Subject) -> dict[str, tuple[AxisLine, AxisLine]]:
    """Every rotary axis: its line by design and by the parameters' values."""
    axes = subject.machine.axes
    real = _lines(subject, ca.SX(ca.DM(list(subject.values))))
    lines = {name: np.array(ca.evalf(line).full()[:, 0], dtype=np.float64) for name, line in real.items()}
    return {
        name: (
            AxisLine(name, np.asarray(axes[name].origin), np.asarray(axes[name].direction)),
            AxisLine(name, lines[name][:3], lines[name][3:]),
        )
        for name in subject.axes
        if name in lines
    }


def lines_by_parameters(subject: Subject, names: Sequence[str]) -> Array:
    """Derivatives of the points (mm) and directions of these axes (6 rows each) by the parameters in their own units."""
    p = ca.SX.sym("p", len(subject.parameters))
    lines = _lines(subject, p)
    slope = ca.jacobian(ca.vertcat(*(lines[name] for name in names)), p)
    return np.asarray(ca.Function("slope", [p], [ca.densify(slope)])(ca.DM(list(subject.values))).full())


def _lines(subject: Subject, p: Any) -> dict[str, Any]:
    """Point and direction (6) of every rotary axis."""
    machine = subject.machine
    row = subject.row(ca.SX.zeros(len(subject.axes)), p)
    found = {}
    for side in (tuple(reversed(machine.structure.workpiece)), machine.structure.tool):
        real = Pose.identity()
        for name in side:
            axis = machine.axes[name]
            pose = real @ axis_pose(axis, machine.structure.carries(name), row.axis[name], row.location, row.motion)
            if axis.rotary:
                found[name] = ca.vertcat(pose.apply(ca.DM(axis.origin)), pose.rotation @ ca.DM(axis.direction))
            real = pose
    return found
