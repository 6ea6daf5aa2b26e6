"""Plans for a part against the ordinary D plan, judged by the independent plant.

    python benchmarks/parts.py               # five machines, three parts each, 40 machines drawn from the priors for each
    python benchmarks/parts.py --quick       # one machine, 10 drawn
    python benchmarks/parts.py table-bc head-bc --minutes 20

For every part (`examples/parts`) the D plan and the plan for the part take the same minutes. The plant (`tests/plant`: own chain,
no CasADi) draws machine and set-up errors from the priors and reads both plans; symfive identifies; the leftover error is that of
the plant's tool at the true errors less that at the identified ones, along the part's path. `true` is the largest rms over the
machines at any place of it, to be compared with the largest expected 1σ. `indexed`: a D plan that may index the spindle too.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.polynomial.legendre import legval
from numpy.typing import NDArray

from symfive.campaign import Campaign, Run
from symfive.design import Plan, plan
from symfive.identify import identify
from symfive.machine import Machine, preset, write_machine
from symfive.toolpath import ToolPath, read_tool_path

ROOT = Path(__file__).resolve().parent.parent
sys.path += [str(ROOT / "tests"), str(ROOT / "examples" / "parts")]

from make_parts import write_parts  # noqa: E402
from plant.chain import ball_in_workpiece, nominal_linear, parse_structure  # noqa: E402
from plant.simulate import simulate_run  # noqa: E402
from plant.state import UM, URAD  # noqa: E402

Array = NDArray[np.float64]
MACHINES = ("table-bc", "head-bc", "mixed-bc", "nutating-table", "tsutsumi-2007")
UNKNOWN_UM = 150.0
"""1σ of a nest's place that nothing is known about; the nest's place and its zero are one."""
COMPONENTS = ("EX", "EY", "EZ", "EA", "EB", "EC")


class Plant:
    """The plant's machine of a machine file, and its errors by symfive's names: location errors, Legendre and Fourier terms."""

    def __init__(self, machine: Machine) -> None:
        with tempfile.TemporaryDirectory() as folder:
            write_machine(machine, Path(folder) / "machine.toml")
            self.data = tomllib.loads((Path(folder) / "machine.toml").read_text(encoding="utf-8"))
        self.chain = parse_structure(self.data["structure"], self.data["axes"])

    def drawn(self, names: list[str], generator: np.random.Generator) -> dict[str, float]:
        """Errors drawn from the priors, µm and µrad."""
        return {
            name: self.data["errors"][name.partition(".")[0]]["sigma"] * generator.standard_normal() for name in names
        }

    def location(self, values: Mapping[str, float]) -> dict[str, float]:
        """Location errors."""
        return {name: value for name, value in values.items() if "." not in name}

    def motions(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Error motions as functions of the axis' coordinate, mm or degree."""
        found: dict[str, Any] = {}
        for component in dict.fromkeys(name.partition(".")[0] for name in values if "." in name):
            terms = {name.partition(".")[2]: v for name, v in values.items() if name.startswith(f"{component}.")}
            low, high = self.data["axes"][component[2:]]["travel"]
            found[component] = lambda q, t=terms, low=low, high=high: _motion(q, t, low, high)
        return found

    def tips(self, command: Mapping[str, Array], length: float, values: Mapping[str, float]) -> Array:
        """The tool's tip (N, 3) in the workpiece frame, mm."""
        position = {a.name: np.radians(command[a.name]) if a.rotary else command[a.name] for a in self.chain.axes}
        motions = {a.name: np.zeros((len(command[a.name]), 6)) for a in self.chain.axes}
        for component, function in self.motions(values).items():
            column = COMPONENTS.index(component[:2])
            motions[component[2:]][:, column] = function(command[component[2:]]) * (URAD if column > 2 else UM)
        location = {n: np.asarray(v * (URAD if n[1] in "ABC" else UM)) for n, v in self.location(values).items()}
        return ball_in_workpiece(self.chain, position, (0.0, 0.0, -length), location, motions)

    def touched(self, path: ToolPath, values: Mapping[str, float]) -> Array:
        """The tip (1, 3), µm, where the part's datum is touched with the rotary axes at 0."""
        assert path.datum is not None
        rotary = {a.name: np.zeros(1) for a in self.chain.axes if a.rotary}
        ball = (0.0, 0.0, -path.tool_length)
        position = nominal_linear(self.chain, rotary, path.datum, ball)
        return 1e3 * self.tips(position, path.tool_length, values)

    def measured(self, campaign: Campaign, values: Mapping[str, float], generator: np.random.Generator) -> Campaign:
        """An R-test campaign with readings."""
        runs = tuple(self._read(run, values, generator) for run in campaign.runs)
        return Campaign(machine=campaign.machine, runs=runs)

    def _read(self, run: Run, values: Mapping[str, float], generator: np.random.Generator) -> Run:
        sigma = run.setup_sigma_um
        ball = generator.standard_normal(3) * sigma.tool
        zero = generator.standard_normal(3) * (UNKNOWN_UM if sigma.zero is None else sigma.zero)
        readings = np.zeros((run.rows, 3))
        spindle = np.zeros(run.rows) if run.spindle is None else run.spindle
        for angle in np.unique(spindle):
            rows = np.flatnonzero(spindle == angle)
            c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
            spec = {
                "id": f"{run.id}-{angle:g}", "instrument": "r_test", "sampling": "static", "t_s": run.time[rows],
                "command": {name: q[rows] for name, q in run.commands.items()}, "table_ball": run.table_ball,
                "tool_ball": run.tool_ball, "noise_um": run.noise_um,
                "setup_um": {
                    "table_ball": [0.0, 0.0, 0.0], "length": 0.0, "zero": list(zero),
                    "tool_ball": [c * ball[0] - s * ball[1], s * ball[0] + c * ball[1], ball[2]],
                },
            }  # fmt: skip
            seed = int(generator.integers(2**31))
            readings[rows] = simulate_run(
                self.data, spec, self.location(values), self.motions(values), seed=seed
            ).values
        return run.with_readings(dict(zip(("dx_um", "dy_um", "dz_um"), readings.T, strict=True)))


def _motion(q: Array, terms: Mapping[str, float], low: float, high: float) -> Array:
    """Legendre polynomials on the travel and harmonics of a turn."""
    value = np.zeros(len(q))
    for name, size in terms.items():
        order = int(name.lstrip("Pcosin"))
        if name.startswith("P"):
            value += size * legval((2.0 * q - low - high) / (high - low), np.eye(order + 1)[order])
        else:
            value += size * (np.cos if name.startswith("cos") else np.sin)(order * np.radians(q))
    return value


def leftover(plant: Plant, made: Plan, part: Plan, machines: int, seed: int) -> float:
    """Largest rms over the machines of the tool's leftover error at a place of the path, µm."""
    assert part.part is not None
    route = part.part.part
    names, generator, squares = list(route.names), np.random.default_rng(seed), np.zeros(len(route.path))
    for _ in range(machines):
        truth = plant.drawn(names, generator)
        result = identify(plant.measured(made.campaign, truth, generator), noise="declared")
        found = {name: result[name] for name in names}
        tips = (plant.tips(route.commands, route.path.tool_length, values) for values in (truth, found))
        left = (next(tips) - next(tips)) * 1e3
        if route.path.datum is not None:
            left -= plant.touched(route.path, truth) - plant.touched(route.path, found)
        squares += np.square(left).sum(axis=1)
    return float(np.sqrt(squares.max() / machines))


def compare(name: str, minutes: float, machines: int, starts: int, datum: bool) -> None:
    """The rows of one machine."""
    machine = preset(name)
    plant = Plant(machine)
    options: dict[str, Any] = {
        "minutes": minutes, "points": 200, "starts": starts, "anywhere": False, "prove": False
    }  # fmt: skip
    indexed = plan(machine, index=True, setups=int(minutes // 5), **options)
    with tempfile.TemporaryDirectory() as folder:
        for path in write_parts(machine, Path(folder)):
            made = plan(machine, part=read_tool_path(path, machine, datum=datum), **options)
            both = made.part
            assert both is not None
            true = [leftover(plant, p, made, machines, seed=7) for p in (both.ordinary_plan, made)]
            expected = both.ordinary.expected.worst, both.after.expected.worst
            print(
                f"{name:15} {path.stem:7} {both.before.worst:7.1f} | {both.ordinary.poses:4d} in {both.ordinary.runs} "
                f"{expected[0]:7.2f} {true[0]:7.2f} | {both.part.left_by(indexed.assessment).worst:7.2f} | "
                f"{both.after.poses:4d} in {both.after.runs} {expected[1]:7.2f} {true[1]:7.2f} | "
                f"{both.ratio:5.2f} {true[1] / true[0]:5.2f}",
                flush=True,
            )


def main(arguments: list[str] | None = None) -> int:
    """Parse the options and measure."""
    parser = argparse.ArgumentParser(description="Plans for a part against the D plan, by the independent plant.")
    parser.add_argument("machines", nargs="*", default=list(MACHINES), help="presets with two rotary axes")
    parser.add_argument("--minutes", type=float, default=25.0)
    parser.add_argument("--drawn", type=int, default=40, help="machines drawn for each part and plan")
    parser.add_argument("--starts", type=int, default=1)
    parser.add_argument("--datum", action="store_true", help="the part's zero is touched with the rotary axes at 0")
    parser.add_argument("--quick", action="store_true", help="one machine, 10 drawn")
    options = parser.parse_args(arguments)
    drawn = 10 if options.quick else options.drawn
    print(f"worst place of the path, 1σ, µm; {options.minutes:g} min; {drawn} machines drawn")
    heads = "  D plan  expect    true | indexed |    part  expect    true | ratio  true"
    print(f"{'machine':15} {'part':7}  before |{heads}")
    for name in options.machines[: 1 if options.quick else None]:
        compare(name, options.minutes, drawn, options.starts, options.datum)
    return 0


if __name__ == "__main__":
    sys.exit(main())
