"""Three parts as NC programs for a machine with two rotary axes: `python examples/parts/make_parts.py table-bc -o DIR`.

blade.ngc: a twisted blade finished along its length in five rows, the tool tilted by 20° to 55°, all axes moving.
pocket.ngc: a mould's rim at rest (arcs at its corners), then its pocket at one tilted orientation, 3+2.
cone.ngc: a cone frustum milled by the tool's flank, 80 mm across, half taper 15°, inclined by 10° (NAS 979; ISO 10791-7 M3).

Words are the tool's tip in the workpiece (G43.4); the angles bring the tool along its direction, each nearest to those before.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from symfive.kinematics import chain_poses
from symfive.machine import Machine, preset

Array = NDArray[np.float64]
SAFE_MM = 40.0
HALF_TAPER, INCLINED = math.radians(15.0), math.radians(10.0)


def blade() -> tuple[Array, Array]:
    """Tips and tool directions (n, 3) of a twisted blade, 60 mm long and 40 mm high, in five rows there and back."""
    tips, tools = [], []
    for row, height in enumerate(np.linspace(0.0, 1.0, 5)):
        u = np.linspace(0.0, 1.0, 40)[:: 1 if row % 2 == 0 else -1]
        x, y = 60.0 * (u - 0.5), 18.0 * np.sin(1.3 * math.pi * u) + 8.0 * height
        tips.append(np.stack([x, y, 60.0 + 40.0 * height + 0.0 * u], axis=1))
        tool = np.stack([0.35 * np.cos(2.0 * u) + 0.3 * height, 0.9 * np.sin(u + 0.5), 0.7 + 0.0 * u], axis=1)
        tools.append(tool / np.linalg.norm(tool, axis=1)[:, None])
    return np.concatenate(tips), np.concatenate(tools)


def cone() -> tuple[Array, Array]:
    """Tips and tool directions (n, 3) around the base of an inclined cone frustum beside the table's centre."""
    turn = np.linspace(0.0, 2.0 * math.pi, 145)
    tilt = np.array(
        [[math.cos(INCLINED), 0.0, math.sin(INCLINED)], [0.0, 1.0, 0.0], [-math.sin(INCLINED), 0.0, math.cos(INCLINED)]]
    )
    base = np.stack([40.0 * np.cos(turn), 40.0 * np.sin(turn), 0.0 * turn], axis=1)
    side = np.stack([-np.cos(turn), -np.sin(turn), 0.0 * turn], axis=1) * math.sin(HALF_TAPER)
    return base @ tilt.T + [0.0, 25.0, 80.0], (side + np.array([0.0, 0.0, math.cos(HALF_TAPER)])) @ tilt.T


def pocket() -> tuple[Array, Array]:
    """Tips and tool directions (n, 3) of three levels of a rounded pocket, all at one direction of the tool."""
    lean, about = math.radians(35.0), 0.6
    tool = np.array([math.sin(lean) * math.cos(about), math.sin(lean) * math.sin(about), math.cos(lean)])
    along = np.cross([0.0, 0.0, 1.0], tool) / math.sin(lean)
    across = np.cross(tool, along)
    tips = []
    for depth in (0.0, 10.0, 20.0):
        for size in (10.0, 20.0, 30.0):
            turn = np.linspace(0.0, 2.0 * math.pi, 25)
            tips.append(
                np.array([40.0, 20.0, 70.0])
                + size * (1.3 * np.cos(turn)[:, None] * along + np.sin(turn)[:, None] * across)
                - depth * tool
            )
    found = np.concatenate(tips)
    return found, np.tile(tool, (len(found), 1))


def angles(machine: Machine, tools: Array) -> dict[str, Array]:
    """Degrees of the rotary axes that bring the tool along `tools` (n, 3, workpiece frame), each nearest to those before."""
    names = [name for name in machine.axis_names if machine.axes[name].rotary]
    q = ca.SX.sym("q", len(names))
    position = {name: q[names.index(name)] if name in names else ca.SX(0.0) for name in machine.axis_names}
    workpiece, spindle = chain_poses(machine, position, {}, {})
    along = ca.Function("along", [q], [workpiece.rotation.T @ spindle.rotation[:, 2]])
    limits = np.radians([machine.axes[name].travel for name in names]).T
    limits = limits[0] + 1e-6, limits[1] - 1e-6

    def solved(tool: Array, start: Array) -> tuple[float, Array]:
        begin = np.clip(start, *limits)
        done = least_squares(lambda x: np.asarray(along(x))[:, 0] - tool, begin, bounds=limits, xtol=1e-14, gtol=1e-14)
        return done.cost, done.x

    corners = [np.array(start) for start in np.ndindex(3, 5)]
    begin = min(
        (solved(tools[0], c - [1.0, 2.0]) for c in corners), key=lambda f: (f[0] > 1e-12, float(np.abs(f[1]).sum()))
    )
    found = [begin[1]]
    for tool in tools[1:]:
        cost, reached = solved(tool, found[-1])
        if cost > 1e-12:
            raise ValueError(f"{machine.name} cannot bring its tool along {tool}")
        found.append(reached)
    return dict(zip(names, np.degrees(found).T, strict=True))


def program(machine: Machine, name: str, shape: tuple[Array, Array], first: Iterable[str] = ()) -> str:
    """The NC program of one part; `first` blocks before its tilted ones."""
    tips, tools = shape
    turned = angles(machine, tools)
    words = [
        f"X{x:.4f} Y{y:.4f} Z{z:.4f} " + " ".join(f"{n}{turned[n][i]:.5f}" for n in turned)
        for i, (x, y, z) in enumerate(tips)
    ]
    rest = " ".join(f"{n}0." for n in turned)
    lines = ["%", f"({name}, {machine.name})", "G21 G90 G17 G54", f"G0 {rest}", "T1 M6", "S12000 M3", *first]
    lines += [
        "G43.4 H1",
        f"G0 X{tips[0][0]:.4f} Y{tips[0][1]:.4f} Z{tips[0][2] + SAFE_MM:.4f} {words[0].split(' ', 3)[3]}",
    ]
    lines += [f"G1 {words[0]} F3000.", *words[1:], "G49", "G91 G28 Z0.", "G90", "M30", "%"]
    return "\n".join(lines) + "\n"


RIM = (
    "G43.4 H1", "G0 X10. Y-10. Z110.", "G1 Z80. F2000.", "X70.", "G3 X80. Y0. I0. J10.", "G1 Y40.", "G3 X70. Y50. R10.",
    "G1 X10.", "G3 X0. Y40. I0. J-10.", "G1 Y0.", "G3 X10. Y-10. R10.", "G0 Z110.",
)  # fmt: skip
PARTS: dict[str, tuple[Callable[[], tuple[Array, Array]], tuple[str, ...]]] = {
    "blade": (blade, ()), "pocket": (pocket, RIM), "cone": (cone, ()),
}  # fmt: skip


def write_parts(machine: Machine, folder: Path) -> list[Path]:
    """The three programs in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for name, (shape, first) in PARTS.items():
        found.append(folder / f"{name}.ngc")
        found[-1].write_text(program(machine, name, shape(), first), encoding="utf-8")
    return found


def main(arguments: list[str] | None = None) -> int:
    """Write the three programs."""
    parser = argparse.ArgumentParser(description="Three parts as NC programs.")
    parser.add_argument("machine", help="a preset with two rotary axes")
    parser.add_argument("-o", "--output", type=Path, required=True)
    options = parser.parse_args(arguments)
    for path in write_parts(preset(options.machine), options.output):
        print(path)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
