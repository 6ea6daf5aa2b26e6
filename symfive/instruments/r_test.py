"""R-test: displacements of the tool ball against the table's, in any frame (Oyama, Ibaraki & Otsubo 2010)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from symfive.arrays import Array
from symfive.errors import InputError
from symfive.instruments._base import ZERO_SIGMA_UM, BallInstrument, setup_parameter, setup_vector
from symfive.machine import Machine
from symfive.parameters import Parameter
from symfive.runs import Column, Run

if TYPE_CHECKING:
    from symfive.row import Row


def _in_head(run: Run) -> bool:
    """Whether the sensors are those of a head in the spindle, which reads a ball on the table."""
    return bool(run.options.get("frame", "workpiece") != "workpiece")


class RTest(BallInstrument):
    """`R·(d - table_ball)` in µm along the sensors; nuisances: the tool ball and one zero per sensor.

    `frame` names the axes of the reading: `workpiece` (default, R = 1: a nest on the table), `machine` (R = R_W, the table's
    rotation) or `tool` (R = R_T⁻¹·R_W: a head in the spindle). A head that reads where the table's ball is, seen from it, has the
    opposite sign, `sense = "table-tool"`. `directions` (three or more, not in one plane) replace the axes of the frame.
    In the workpiece's frame an error of the nest's position moves all readings by a constant: it is the zero, and not a second
    unknown. In the others it turns with the table, and in the tool's frame it is the tool ball that is the zero.
    """

    name = "r_test"
    stands = "nest"
    imported = (("dx", "um", "um"), ("dy", "um", "um"), ("dz", "um", "um"))

    def check(self, run: Run, machine: Machine) -> None:
        given = run.options.get("directions")
        if given is not None and np.linalg.matrix_rank(np.array(given, dtype=float).reshape(-1, 3), tol=1e-3) < 3:
            problem = f"run {run.id}: the R-test's directions do not span space"
            raise InputError(problem, remedy="give at least three that do not lie in one plane", keys=("directions",))

    def columns(self, run: Run, machine: Machine) -> tuple[Column, ...]:
        return tuple(Column(f"{name}_um", "um", 1e-3) for name in self._sensors(run))

    def parameters(self, run: Run, machine: Machine) -> tuple[Parameter, ...]:
        sigma, frame = run.setup_sigma_um, run.options.get("frame", "workpiece")
        zero = ZERO_SIGMA_UM if sigma.zero is None else sigma.zero
        zeros = tuple(setup_parameter(run, f"zero.{name.removeprefix('d')}", "um", zero) for name in self._sensors(run))
        table = setup_vector(run, "table_ball", sigma.table_ball) if frame != "workpiece" else ()
        tool = setup_vector(run, "tool_ball", sigma.tool) if frame != "tool" else ()
        return (*table, *tool, *zeros)

    def on_table(self, run: Run) -> str:
        return "table ball" if _in_head(run) else self.stands

    def in_spindle(self, run: Run) -> str:
        return "R-test head" if _in_head(run) else self.held

    def place_sigma(self, run: Run) -> float | None:
        sigma = run.setup_sigma_um
        return sigma.table_ball if _in_head(run) else sigma.zero

    def turns(self, run: Run, machine: Machine) -> bool:
        return any(np.ptp(run.commands[axis]) > 0.0 for axis in machine.rotary_axes)

    def designed(self, run: Run, away: Array) -> Array:
        along = np.array(list(self._sensors(run).values()))
        return np.asarray(away @ (along / np.linalg.norm(along, axis=1, keepdims=True)).T)

    def zeroed(self, run: Run) -> bool:
        return run.setup_sigma_um.zero is None

    def start(self, run: Run, machine: Machine) -> tuple[str, ...]:
        stands, held = self.on_table(run), self.in_spindle(run)
        moved = held.split()[-1]
        seat = "seat the ball" if moved == "ball" else "bring it to the ball"
        zero = " and set the readings to zero" if self.zeroed(run) else ""
        known = f"Readings are zero with the {moved} at the known position of the {stands}; do not set them to zero."
        return (
            f"Mount {stands} and {held} before you start the program of run {run.id}. It stops with "
            f"the {moved} clear of the {stands}, and again for you to {seat}{zero}.",
            *(() if self.zeroed(run) else (known,)),
            *(("Start the recording there, then let the program go on.",) if run.dynamic else ()),
            self._signs(run),
        )

    @staticmethod
    def _signs(run: Run) -> str:
        """In which direction its readings are positive."""
        frame = run.options.get("frame", "workpiece")
        moved = "table's ball" if run.options.get("sense") == "table-tool" else "tool ball"
        if "directions" in run.options:
            along = f"along its direction in campaign.toml ({frame} frame)"
            return f"Each sensor reads positive when the {moved} moves {along}."
        return f"dx, dy and dz are positive when the {moved} moves towards +x, +y and +z of the {frame} frame."

    def reading(self, row: Row, run: Run) -> list[Any]:
        import casadi as ca

        deviation, frame = row.ball - row.table_ball, run.options.get("frame", "workpiece")
        if frame != "workpiece":
            workpiece, tool = row.poses
            deviation = workpiece.rotation @ deviation
            deviation = tool.rotation.T @ deviation if frame == "tool" else deviation
        if run.options.get("sense") == "table-tool":
            deviation = -deviation
        found = []
        for name, direction in self._sensors(run).items():
            length = float(np.linalg.norm(direction))
            seen = ca.dot(ca.DM(list(direction)) / length, deviation)
            found.append(seen + row.parameter(f"setup.zero.{name.removeprefix('d')}"))
        return found

    @staticmethod
    def _sensors(run: Run) -> dict[str, tuple[float, ...]]:
        """Column, without its unit → direction."""
        given = run.options.get("directions")
        if given is None:
            return {f"d{c}": tuple(float(c == other) for other in "xyz") for c in "xyz"}
        return {f"s{k}": tuple(direction) for k, direction in enumerate(given, start=1)}
