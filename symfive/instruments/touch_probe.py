"""Touch probe and calibration sphere: linear coordinates at which the sphere's centre is found (ISO 10791-6, ISO 230-10)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from symfive.errors import InputError
from symfive.instruments._base import BallInstrument, Column, Machine, Parameter, Run, setup_parameter, setup_vector

if TYPE_CHECKING:
    from symfive.row import Row

FIVE_TOUCHES = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0))
LEAST_TOUCHES = 5
"""The centre has three unknowns, the effective radius is a fourth; the fifth touch checks them."""


class TouchProbe(BallInstrument):
    """Found minus commanded coordinate of each linear axis, µm, the rotary axes standing as commanded.

    With δ the reading, `d(q + δ) = table_ball`: where the machine has to go for the tip's centre to be in the sphere's.
    Nuisances: the sphere's place (`table_ball`), the tip's offset and the probe's effective length (`tool_ball`) and, with
    `lobing_sigma_um`, the three lobes of a kinematic seat. The touches' directions n, from the sphere's centre, stand in
    `touches` (at least five; by default the top and ±X, ±Y) in the tool's frame or, with `touch_frame = "machine"`, in the
    machine's. Centre and effective radius are fitted to them, so that equal pre-travel in all directions is no error of the
    centre; lobes of the pre-travel `p = cos·(x³ - 3xy²) + sin·(3x²y - y³)`, with n = (x, y, z) in the tool's frame, are one:
    `(Δ, r) = -[n, -1]⁺ p`. They turn with the tool. In the tool's frame, and wherever the tool does not turn, Δ is constant and
    cannot be distinguished from the tip's offset.
    """

    name = "touch_probe"
    stands = "sphere"
    held = "centre of the tip"
    seated = "sphere"
    probes = True

    def check(self, run: Run, machine: Machine) -> None:
        if len(machine.linear_axes) != 3:
            problem = f"run {run.id}: a touch probe finds three linear coordinates, the machine has {len(machine.linear_axes)}"
            raise InputError(problem, remedy="describe the three axes that move while probing", keys=("instrument",))
        if run.dynamic:
            problem = f"run {run.id}: a touch probe finds centres at rest"
            raise InputError(problem, remedy='write sampling = "static"', keys=("sampling",))
        _centre_of_touches(run)

    def columns(self, run: Run, machine: Machine) -> tuple[Column, ...]:
        return tuple(Column(f"{name}_dev_um", "um", 1e-3) for name in sorted(machine.linear_axes))

    def parameters(self, run: Run, machine: Machine) -> tuple[Parameter, ...]:
        sigma, lobing = run.setup_sigma_um, float(run.options.get("lobing_sigma_um", 0.0))
        lobes = tuple(setup_parameter(run, f"lobing.{f}", "um", lobing) for f in ("cos", "sin")) if lobing else ()
        return (*setup_vector(run, "table_ball", sigma.table_ball), *setup_vector(run, "tool_ball", sigma.tool), *lobes)

    def start(self, run: Run, machine: Machine) -> tuple[str, ...]:
        sphere, tip = machine.workspace.sphere_radius, machine.workspace.tip_radius
        return (
            f"Sphere of radius {sphere:g} mm, tip of radius {tip:g} mm, probe switched on, spindle locked.",
            f"Start the program of run {run.id}; it stops above the sphere, then probes it. Its header names the log.",
            "Copy the log and import it: symfive import-touches PLAN LOG -o measured.",
        )

    def reading(self, row: Row, run: Run) -> list[Any]:
        import casadi as ca

        from symfive.motion import Position

        names = sorted(row.machine.linear_axes)
        q = ca.vertcat(*(row.signal(Position(name)) for name in names))
        gap = row.ball_at(row.tool_ball - self._lobing(row, run)) - row.table_ball
        slope = ca.inv_minor(ca.jacobian(gap, q))
        first = -slope @ gap  # exact for location errors, in which the ball is linear in the linear axes
        found = first - slope @ ca.substitute(gap, q, q + first)  # error motions bend it
        return [found[i] for i in range(3)]

    def _lobing(self, row: Row, run: Run) -> Any:
        """What the lobes move the found centre by, mm in the tool's frame."""
        import casadi as ca

        if not row.has("setup.lobing.cos"):
            return ca.SX(3, 1)
        turned = row.poses[1].rotation if run.options.get("touch_frame") == "machine" else ca.SX.eye(3)
        pretravel = []
        for touch in touches_of(run):
            x, y, _ = ca.vertsplit(turned.T @ ca.DM(touch))
            lobes = (x**3 - 3 * x * y**2, 3 * x**2 * y - y**3)
            pretravel.append(
                row.parameter("setup.lobing.cos") * lobes[0] + row.parameter("setup.lobing.sin") * lobes[1]
            )
        return -turned.T @ (ca.DM(_centre_of_touches(run)) @ ca.vertcat(*pretravel))


def touches_of(run: Run) -> list[list[float]]:
    """Directions of a run's touches from the sphere's centre as unit vectors. Raises `InputError` where they are too few."""
    given = run.options.get("touches", FIVE_TOUCHES)
    lengths = [sum(float(c) ** 2 for c in touch) ** 0.5 for touch in given]
    if len(given) < LEAST_TOUCHES or min(lengths, default=0.0) == 0.0:
        problem = f"run {run.id}: {len(given)} touches, of which none may be zero, do not make a centre"
        raise InputError(problem, remedy=f"give at least {LEAST_TOUCHES} directions", keys=("touches",))
    return [[float(c) / length for c in touch] for touch, length in zip(given, lengths, strict=True)]


def _centre_of_touches(run: Run) -> Any:
    """(3, N): the centre that a fit of centre and radius finds, per unit of distance along each touch."""
    import numpy as np

    table = np.array([[*touch, -1.0] for touch in touches_of(run)])
    if np.linalg.matrix_rank(table, tol=1e-3) < 4:
        problem = f"run {run.id}: the touches do not determine the sphere's centre and the effective radius"
        raise InputError(problem, remedy="touch the top and four sides", keys=("touches",))
    return np.linalg.pinv(table)[:3]
