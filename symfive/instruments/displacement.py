"""One-dimensional displacement sensors fixed to the machine, seeing a ball, a disc's rim or its face (ISO 230-7)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from symfive.errors import InputError
from symfive.instruments._base import Column, Instrument, Machine, Parameter, Run, setup_parameter, setup_vector

if TYPE_CHECKING:
    from symfive.motion import Command
    from symfive.row import Row

TARGETS = ("ball", "rim", "face")
ZERO_SIGMA_UM = 1e5


class Displacement(Instrument):
    """`s_k = gain_k · direction_k · (displacement of the table at position_k) + form + zero_k`, µm.

    `sensors = [{ direction = [1, 0, 0], position = [150, 0, 0], on = "machine", target = "rim", gain_sigma = 0.01 }]`.
    The displacement is that of the table's material at the sensor: W(real)·(W(nominal)⁻¹·p + e) - p. Of a ball e is what it
    stands off its nominal place on the table, an unknown of the set-up for every position: its eccentricity is no error motion
    (ISO 230-7). Elsewhere e is zero. On a rim or a face the
    artefact's own form is a Fourier series of order `form_order` (default 2) in the table's angle under the sensor, common to
    all sensors on the same target: the order-1 part is the eccentricity (rim) or the swash (face) of the artefact.
    `form_axis` names the axis that turns it. Gains have the prior 1 ± `gain_sigma` (default exact).
    """

    name = "displacement"
    wired = False
    ball_drawn = True

    def check(self, run: Run, machine: Machine) -> None:
        sensors = run.options.get("sensors")
        if not isinstance(sensors, (list, tuple)) or not sensors:
            remedy = "add sensors = [{ direction = …, position = … }]"
            raise InputError(f"run {run.id}: there are no sensors", remedy=remedy, keys=("sensors",))
        for number, sensor in enumerate(sensors):
            if not {"direction", "position"} <= set(sensor):
                problem = f"run {run.id}: a sensor lacks direction or position"
                raise InputError(problem, remedy="give both, in mm", keys=("sensors", number))
            if sensor.get("on", "machine") != "machine" or sensor.get("target", "ball") not in TARGETS:
                raise InputError(
                    f"run {run.id}: a sensor stands on something unknown",
                    remedy=f'use on = "machine" and target = one of {", ".join(TARGETS)}',
                    keys=("sensors", number),
                )

    def columns(self, run: Run, machine: Machine) -> tuple[Column, ...]:
        return tuple(Column(f"s{k + 1}_um", "um", 1e-3) for k in range(len(run.options["sensors"])))

    def parameters(self, run: Run, machine: Machine) -> tuple[Parameter, ...]:
        found = []
        for k, sensor in enumerate(run.options["sensors"], start=1):
            found.append(setup_parameter(run, f"zero.s{k}", "um", ZERO_SIGMA_UM))
            if sensor.get("gain_sigma"):
                found.append(setup_parameter(run, f"gain.s{k}", "1", float(sensor["gain_sigma"]), mean=1.0))
        for k in sorted(set(self._balls(run).values())):
            found += setup_vector(run, f"ball.s{k}", run.setup_sigma_um.table_ball)
        sigma = float(run.options.get("form_sigma_um", 100.0))
        seen = [sensor.get("target", "ball") for sensor in run.options["sensors"]]
        for target in (t for t in ("rim", "face") if t in seen):
            for order in range(1, self._order(run) + 1):
                found += [setup_parameter(run, f"form.{target}.{f}{order}", "um", sigma) for f in ("cos", "sin")]
        return tuple(found)

    def signals(self, run: Run, machine: Machine) -> tuple[Command, ...]:
        from symfive.motion import Command

        return tuple(Command(name) for name in machine.axis_names)

    @staticmethod
    def _balls(run: Run) -> dict[int, int]:
        """Of every sensor on a ball, by number, the first one at the same position: it names the ball."""
        sensors = run.options["sensors"]
        at = {k: tuple(s["position"]) for k, s in enumerate(sensors, start=1) if s.get("target", "ball") == "ball"}
        return {k: next(first for first, other in at.items() if other == place) for k, place in at.items()}

    @staticmethod
    def _order(run: Run) -> int:
        return int(run.options.get("form_order", 2))

    def reading(self, row: Row, run: Run) -> list[Any]:
        import casadi as ca

        from symfive.motion import Command

        commanded = {name: row.signal(Command(name)) for name in row.machine.axis_names}
        nominal, _ = row.nominal_poses(commanded)
        actual, _ = row.poses
        readings, balls = [], self._balls(run)
        slipped = row.table_ball - row.vector("table_ball") - row.setup("table_ball")
        for k, sensor in enumerate(run.options["sensors"], start=1):
            point, direction = ca.DM(list(sensor["position"])), ca.DM(list(sensor["direction"]))
            off = row.setup(f"ball.s{balls[k]}") + slipped if k in balls else ca.DM.zeros(3)
            moved = actual.apply(nominal.apply_inverse(point) + off) - row.shift - point
            value = ca.dot(direction / ca.norm_2(direction), moved) + self._form(row, run, sensor)
            gain = row.parameter(f"setup.gain.s{k}") if row.has(f"setup.gain.s{k}") else 1.0
            readings.append(gain * value + row.parameter(f"setup.zero.s{k}"))
        return readings

    def _form(self, row: Row, run: Run, sensor: Any) -> Any:
        import casadi as ca

        target = sensor.get("target", "ball")
        turning = run.options.get("form_axis") or next(iter(row.machine.rotary_axes), None)
        if target == "ball" or turning is None:
            return ca.SX(0)
        x, y = float(sensor["position"][0]), float(sensor["position"][1])
        angle = row.axis[turning] + ca.atan2(y, x)
        form = ca.SX(0)
        for order in range(1, self._order(run) + 1):
            form += row.parameter(f"setup.form.{target}.cos{order}") * ca.cos(order * angle)
            form += row.parameter(f"setup.form.{target}.sin{order}") * ca.sin(order * angle)
        return form
