"""What a plan's folder declares: machine, limits, workspace and runs, read with tomllib and csv only.

Lengths in mm, angles in degree; axes in the order `Machine.names`. The chain is the independent plant's.
"""

import csv
import json
import re
import tomllib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..plant.chain import Chain, ball_in_workpiece, nominal_linear, parse_structure

Array = NDArray[np.float64]
Table = dict[str, Any]


@dataclass(frozen=True)
class Machine:
    """Axes with their limits and the workspace of `machine.toml`."""

    table: Table

    @cached_property
    def chain(self) -> Chain:
        """Axes from the bed outward on both sides."""
        return parse_structure(self.table["structure"], self.table["axes"])

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all axes, workpiece side first."""
        return tuple(axis.name for axis in self.chain.axes)

    @cached_property
    def rotary(self) -> Array:
        """True for each rotary axis (n,)."""
        return np.array([axis.rotary for axis in self.chain.axes])

    @cached_property
    def travel(self) -> Array:
        """(n, 2) mm or degree."""
        own = self.table["axes"]
        default = [[-360.0, 360.0] if turns else [-1000.0, 1000.0] for turns in self.rotary]
        return np.array([own[name].get("travel", d) for name, d in zip(self.names, default, strict=True)], float)

    def limit(self, key: str) -> Array:
        """`max_feed` or `max_acceleration` of each axis (n,), per minute or per s²; where not declared what docs/conventions.md
        says that programs take."""
        usual = np.where(self.rotary, *((1800.0, 5000.0) if key == "max_feed" else (100.0, 500.0)))
        own = self.table["axes"]
        return np.array([float(own[name].get(key, default)) for name, default in zip(self.names, usual, strict=True)])

    @property
    def workspace(self) -> Table:
        """[workspace] as it stands in the file."""
        return dict(self.table.get("workspace", {}))

    @cached_property
    def tool_axis(self) -> int:
        """Index of the linear axis that is most nearly along the tool with all axes at zero: it draws the tool back."""
        along = [0.0 if axis.rotary else abs(axis.direction[2]) for axis in self.chain.axes]
        return int(np.argmax(along))

    @cached_property
    def top(self) -> float:
        """The end of the tool axis' travel at which the tool is farthest from the table, mm."""
        low, high = self.travel[self.tool_axis]
        return float(high if self.chain.axes[self.tool_axis].direction[2] > 0.0 else low)

    @cached_property
    def table_centre(self) -> Array:
        """(x, y) in the workpiece frame: `table_centre` if given, else the point nearest to that frame's origin of the rotary
        axis that carries the table (the one next to the workpiece), else that origin (docs/conventions.md)."""
        if "table_centre" in self.workspace:
            return np.asarray(self.workspace["table_centre"], float)[:2]
        turning = [axis for axis in self.chain.workpiece if axis.rotary]
        if not turning:
            return np.zeros(2)
        origin, direction = np.asarray(turning[-1].origin), np.asarray(turning[-1].direction)
        return (origin - (origin @ direction) * direction)[:2]

    def points(self, q: Array, tool_points: Array) -> Array:
        """Points of the tool frame (k, 3) in the workpiece frame, (N, k, 3), at axis positions (N, n) in mm and degree."""
        command = {
            name: np.deg2rad(v) if turns else v for name, v, turns in zip(self.names, q.T, self.rotary, strict=True)
        }
        return np.stack([ball_in_workpiece(self.chain, command, p) for p in tool_points], axis=1)

    def following(self, q: Array, places: Array, tool_ball: Array) -> Array:
        """Axis positions (N, n) with the rotary axes of `q` at which the tool ball stands at `places` (N, 3)."""
        angles = {name: np.deg2rad(v) for name, v, turns in zip(self.names, q.T, self.rotary, strict=True) if turns}
        found = nominal_linear(self.chain, angles, places, tool_ball)
        return np.stack(
            [np.rad2deg(found[n]) if t else found[n] for n, t in zip(self.names, self.rotary, strict=True)], 1
        )


@dataclass(frozen=True)
class Run:
    """One run of the campaign: `table` its entry, `t` (N,) s, `rows` (N, n) mm and degree."""

    table: Table
    file: Path
    t: Array
    rows: Array

    @property
    def instruments(self) -> tuple[str, ...]:
        """Names of the instruments recorded together."""
        named = self.table["instrument"]
        return (named,) if isinstance(named, str) else tuple(named)

    @property
    def bar(self) -> bool:
        """Whether a ball bar joins table and tool."""
        return "ball_bar" in self.instruments

    @property
    def nest(self) -> bool:
        """Whether the tool ball sits in a nest."""
        return "r_test" in self.instruments

    @property
    def probe(self) -> bool:
        """Whether a touch probe finds a sphere."""
        return "touch_probe" in self.instruments

    @property
    def table_ball(self) -> Array:
        """(3,) mm, workpiece frame."""
        return np.asarray(self.table.get("table_ball", [0.0, 0.0, 0.0]), float)

    @property
    def tool_ball(self) -> Array:
        """(3,) mm, tool frame."""
        return np.asarray(self.table.get("tool_ball", [0.0, 0.0, 0.0]), float)

    @property
    def static(self) -> bool:
        """Whether readings are taken at rest."""
        return self.table.get("sampling", "static") == "static"


@dataclass(frozen=True)
class Plan:
    """A plan's folder: machine, runs, what plan.json states and the NC programs by dialect and run."""

    folder: Path
    machine: Machine
    runs: tuple[Run, ...]
    stated: Table = field(default_factory=dict)

    def programs(self) -> dict[str, dict[str, Path]]:
        """dialect → run id, or ids with + between, as the program says in its comments, else its name → file."""
        known = {_plain(run.table["id"]): run.table["id"] for run in self.runs}
        root = self.folder / "nc"
        found: dict[str, dict[str, Path]] = {}
        for path in sorted(root.glob("*/*")) if root.is_dir() else []:
            if path.is_file() and path.suffix != ".A":  # a mask of Heidenhain's FN 16
                said = re.findall(r"\brun (\S+), \d+ rows", path.read_text("ascii", "replace"), re.IGNORECASE)
                names = [known.get(_plain(name), name) for name in said or [path.stem]]
                found.setdefault(path.parent.name, {})["+".join(names)] = path
        return found


def _plain(name: str) -> str:
    """A name as the strictest control takes it."""
    return re.sub(r"[^A-Z0-9]", "_", name.upper())


def read_plan(folder: Path | str) -> Plan:
    """Reads campaign.toml, the machine file that it names, every CSV and plan.json where there is one."""
    folder = Path(folder)
    campaign = tomllib.loads((folder / "campaign.toml").read_text(encoding="utf-8"))
    machine = Machine(tomllib.loads((folder / campaign["machine"]).read_text(encoding="utf-8")))
    stated = folder / "plan.json"
    runs = tuple(_run(folder, machine, entry) for entry in campaign["run"])
    return Plan(folder, machine, runs, json.loads(stated.read_text(encoding="utf-8")) if stated.exists() else {})


def _run(folder: Path, machine: Machine, entry: Table) -> Run:
    file = folder / entry["file"]
    with file.open(newline="", encoding="utf-8") as lines:
        header, *rows = csv.reader(lines)
    columns = dict(zip(header, np.array(rows, float).T, strict=True))
    return Run(entry, file, columns["t_s"], np.stack([columns[axis.column] for axis in machine.chain.axes], axis=1))
