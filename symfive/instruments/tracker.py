"""Laser tracker: position of a reflector on the tool or on the workpiece side, in the instrument's own frame."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from symfive.errors import InputError
from symfive.instruments._base import Column, Instrument, Machine, Parameter, Run, setup_parameter, setup_vector

if TYPE_CHECKING:
    from symfive.row import Row

LETTERS = ("x", "y", "z", "a", "b", "c")


class Tracker(Instrument):
    """`R·d + t` in mm, R = Rx(a) Ry(b) Rz(c); the placement (t, R) is unknown.

    The run gives the rough `placement = [x, y, z, a, b, c]` (mm, degree) about which the six unknowns are estimated
    with 1σ of `placement_sigma = [mm, degree]` (default [1000, 10]). Runs that share one placement say so:
    `mounting = { placement = "first" }`.

    A reflector on the tool stands at `tool_ball`. With `reflector_on = "workpiece"` it stands at `table_ball` on the
    workpiece side (on the base of an arm) and d is that point: it watches the instrument and the base, not the axes.
    """

    name = "tracker"
    wired = False
    numbers = ("placement", "placement_sigma")
    ball_drawn = True
    vectors = ("table_ball", "tool_ball")

    def check(self, run: Run, machine: Machine) -> None:
        placement = run.options.get("placement", [0.0] * 6)
        if len(placement) != 6:
            problem = f"run {run.id}: placement has {len(placement)} numbers"
            raise InputError(problem, remedy="write [x, y, z, a, b, c]", keys=("placement",))
        if run.options.get("reflector_on", "tool") not in ("tool", "workpiece"):
            problem = f"run {run.id}: reflector_on is unknown"
            raise InputError(problem, remedy='write "tool" or "workpiece"', keys=("reflector_on",))

    def columns(self, run: Run, machine: Machine) -> tuple[Column, ...]:
        return tuple(Column(f"{c}_mm", "mm", 1.0) for c in "xyz")

    def parameters(self, run: Run, machine: Machine) -> tuple[Parameter, ...]:
        linear, angular = run.options.get("placement_sigma", (1000.0, 10.0))
        each = [("mm", linear)] * 3 + [("deg", angular)] * 3
        placement = (
            setup_parameter(run, f"placement.{letter}", unit, sigma)
            for letter, (unit, sigma) in zip(LETTERS, each, strict=True)
        )
        return (*setup_vector(run, *self._reflector(run)), *placement)

    @staticmethod
    def _reflector(run: Run) -> tuple[str, float]:
        """Where the reflector stands and the 1σ of that place, µm."""
        if run.options.get("reflector_on", "tool") == "tool":
            return "tool_ball", run.setup_sigma_um.tool_ball
        return "table_ball", run.setup_sigma_um.table_ball

    def constants(self, run: Run, machine: Machine) -> dict[str, float]:
        placement = [float(v) for v in run.options.get("placement", [0.0] * 6)]
        scale = [1.0, 1.0, 1.0, *[3.141592653589793 / 180.0] * 3]
        named = {f"placement.{c}": v * s for c, v, s in zip(LETTERS, placement, scale, strict=True)}
        return {**super().constants(run, machine), **named}

    def reading(self, row: Row, run: Run) -> list[Any]:
        import casadi as ca

        from symfive.kinematics import angles

        p = [row.constant(f"placement.{c}") + row.parameter(f"setup.placement.{c}") for c in LETTERS]
        point = row.ball if self._reflector(run)[0] == "tool_ball" else row.table_ball
        position = angles(p[3], p[4], p[5]) @ point + ca.vertcat(p[0], p[1], p[2])
        return list(ca.vertsplit(position))
