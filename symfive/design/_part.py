"""What a plan is for when it is for a part: the expected error of the tool along the part's path.

The error of the tool's tip at a place of the path, in the workpiece frame, is J (3, s) times what identification and
compensation leave of the machine's errors, whose covariance S the readings give. Its 1σ there is √⟨JᵀJ, S⟩: G takes its maximum
along the path, V its mean. J comes from the model's own row function at the poses of the path.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array, Indices
from symfive.campaign import Campaign, Run
from symfive.compiled import Mapped
from symfive.design._assess import Assessment
from symfive.design._digits import six_digits
from symfive.design._pose import follow
from symfive.design._space import DIGITS, Space
from symfive.errors import InputError
from symfive.inference import windows_of
from symfive.machine import Machine
from symfive.model import Model
from symfive.numbers import plain_number
from symfive.optimal import Criterion, Trace, Worst
from symfive.toolpath import ToolPath

PLACES = 150
"""Places by which designs are compared; what is reported is over all."""
AT_ONCE = 2000


@dataclass(frozen=True)
class Expected:
    """The expected error of the tool along a path: `worst` and `mean` (root mean square) 1σ, µm, and the `row` of the worst."""

    worst: float
    mean: float
    row: int


class Part:
    """A tool path on a machine.

    `names` (s,) of the machine's parameters; `slopes` (N, 3, s) of the tip in the workpiece frame, µm per prior 1σ, less those at
    the part's datum where that is touched. Raises `InputError` with the line where an axis would leave its travel.
    """

    def __init__(self, machine: Machine, path: ToolPath) -> None:
        self.machine, self.path = machine, path
        self.commands = _commands(machine, path)
        _refuse_outside(machine, path, self.commands)
        runs = [_run("part", path, self.commands)]
        if path.datum is not None:
            touched = _touched(machine, path, path.datum)
            runs.append(_run("datum", touched, _commands(machine, touched)))
        model = Model(Campaign(machine=machine, runs=tuple(runs)))
        shared = [p for p in model.parameters if p.kind != "setup"]
        self.names, self.sigma = tuple(p.name for p in shared), np.array([p.sigma for p in shared])
        self.slopes, *datum = (_slopes(model, run, self.names) * self.sigma for run in runs)
        for touched_slopes in datum:
            self.slopes -= touched_slopes

    @cached_property
    def typical(self) -> Indices:
        """Rows that stand for all: each further one is the place whose slopes differ most from those taken before."""
        flat = self.slopes.reshape(len(self.slopes), -1)
        chosen = [int(np.argmax(np.einsum("ij,ij->i", flat, flat)))]
        apart = np.full(len(flat), np.inf)
        while len(chosen) < min(PLACES, len(flat)):
            apart = np.minimum(apart, np.square(flat - flat[chosen[-1]]).sum(axis=1))
            if apart.max() == 0.0:
                break
            chosen.append(int(np.argmax(apart)))
        return np.sort(np.array(chosen, dtype=np.int64))

    def ordered(self, names: Sequence[str]) -> Indices:
        """Where the parameters `names` stand in `names` of this part."""
        return np.array([self.names.index(name) for name in names], dtype=np.int64)

    def expected(self, covariance: Array) -> Expected:
        """The error that a covariance (s, s) leaves, per prior 1σ."""
        variance = np.concatenate([np.einsum("nya,ab,nyb->n", J, covariance, J, optimize=True) for J in self._pieces()])
        row = int(np.argmax(variance))
        return Expected(float(np.sqrt(variance[row])), float(np.sqrt(variance.mean())), row)

    def _pieces(self) -> Iterator[Array]:
        for first in range(0, len(self.slopes), AT_ONCE):
            yield self.slopes[first : first + AT_ONCE]

    def left_by(self, assessment: Assessment) -> Expected:
        """The error that the readings of a plan leave."""
        place = {p.name: i for i, p in enumerate(assessment.parameters)}
        index = np.array([place[name] for name in self.names], dtype=np.int64)
        return self.expected(assessment.covariance[np.ix_(index, index)] / np.outer(self.sigma, self.sigma))

    def data(self, expected: Expected) -> dict[str, Any]:
        """As it stands in plan.json: µm, the line and the position of the axes at the worst place."""
        row = expected.row
        return {
            "worst_um": six_digits(expected.worst),
            "mean_um": six_digits(expected.mean),
            "worst_at": {
                "line": int(self.path.line[row]),
                **{self.machine.axes[n].column: six_digits(float(q[row])) for n, q in self.commands.items()},
            },
        }

    def words(self, expected: Expected) -> str:
        """In words: worst and mean 1σ, and where."""
        worst, mean = plain_number(expected.worst), plain_number(expected.mean)
        return f"{worst} µm at worst ({self.path.at(expected.row)}), {mean} µm on average"


def part_criterion(part: Part, space: Space, name: str) -> Criterion:
    """G or V of the path for the parameters of a space. Raises `InputError` for another criterion."""
    slopes = part.slopes[:, :, part.ordered([p.name for p in space.shared])]
    if name == "G":
        chosen = slopes[part.typical]
        return Worst(np.einsum("kya,kyb->kab", chosen, chosen))
    if name in ("V", "I"):
        flat = slopes.reshape(-1, slopes.shape[2])
        return Trace("V", flat.T @ flat / len(slopes))
    raise InputError(
        f"criterion {name} does not use the part", remedy="use G (the worst point of its path) or V (the mean)"
    )


def _run(name: str, path: ToolPath, commands: dict[str, Array]) -> Run:
    """A path as rows in which the tool's tip is read in the workpiece frame."""
    return Run(
        id=name, instrument=("r_test",), sampling="static", time=np.arange(float(len(path))), commands=commands,
        tool_ball=(0.0, 0.0, -path.tool_length),
    )  # fmt: skip


def _slopes(model: Model, run: Run, names: Sequence[str]) -> Array:
    """Of the tip to the machine's parameters `names`: (N, 3, s), µm per unit of each."""
    place = {model.index[name]: i for i, name in enumerate(names)}
    found = np.zeros((run.rows, 3, len(names)))
    for window in windows_of(model, run, model.start, {}):
        assert window.jacobian is not None
        own = [(i, place[c]) for i, c in enumerate(window.columns.tolist()) if c in place]
        here, there = (np.array(column, dtype=np.int64) for column in zip(*own, strict=True))
        found[window.rows][:, :, there] = window.jacobian[window.inside][:, :, here]
    return found


def _touched(machine: Machine, path: ToolPath, datum: tuple[float, float, float]) -> ToolPath:
    """The place at which the part's datum is touched, with the rotary axes at 0."""
    words = {name: np.zeros(1) for name in machine.axis_names}
    words |= {name: np.array([value]) for name, value in zip("XYZ", datum, strict=True)}
    return ToolPath(path.path, path.line[:1], words, np.array([True]), path.tool_length)


def _commands(machine: Machine, path: ToolPath) -> dict[str, Array]:
    """Positions of every axis along the path, mm and degree; where the path gives the tip the linear axes follow."""
    found = {name: np.array(path.position[name]) for name in machine.axis_names}
    rows = np.flatnonzero(path.tip)
    if not rows.size:
        return found
    rotary, linear = machine.rotary_axes, machine.linear_axes
    if not {"X", "Y", "Z"} <= set(machine.axis_names):
        raise InputError("tool-centre words need axes X, Y and Z", path=path.path, remedy="give a table of poses")
    angles, place = ca.SX.sym("angles", len(rotary)), ca.SX.sym("place", 3)
    position = {name: angles[i] for i, name in enumerate(rotary)}
    solved = follow(machine, position, ca.DM([0.0, 0.0, -path.tool_length]), place)
    solve = Mapped(ca.Function("follow", [angles, place], [ca.densify(ca.vertcat(*(solved[n] for n in linear)))]))
    turned = np.stack([np.radians(found[n][rows]) for n in rotary], axis=1) if rotary else np.zeros((len(rows), 0))
    tips = np.stack([found[name][rows] for name in "XYZ"], axis=1)
    values = solve(turned, tips)[0]
    for i, name in enumerate(linear):
        found[name][rows] = values[:, i]
    return {name: np.round(column, DIGITS) + 0.0 for name, column in found.items()}


def _refuse_outside(machine: Machine, path: ToolPath, commands: dict[str, Array]) -> None:
    """Refuse a path on which an axis leaves its travel, naming the first place."""
    for name, column in commands.items():
        axis = machine.axes[name]
        low, high = axis.travel
        outside = np.flatnonzero(~((column >= low - 1e-6) & (column <= high + 1e-6)))
        if outside.size:
            row = int(outside[0])
            unit = "°" if axis.rotary else " mm"
            problem = f"axis {name} would be at {column[row]:.6g}{unit}, outside its travel {low:g}…{high:g}"
            moved = "correct the part's zero (--part-zero) or the tool's length (--part-tool)"
            remedy = f"correct the path or the travel of {name}" if axis.rotary else f"{moved}, or the path"
            raise InputError(problem, path=path.path, line=int(path.line[row]), remedy=remedy)
