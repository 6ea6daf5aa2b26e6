"""Models of presets with drawn errors, their generated C compiled and called, and what the tools are."""

import importlib.util
import shutil
import subprocess
from pathlib import Path
from types import ModuleType

import casadi as ca
import numpy as np
import pytest

from symfive.codegen import codegen, subject_of
from symfive.effects import Effect
from symfive.kinematics import ball_in_workpiece
from symfive.machine import Machine, preset, presets
from symfive.model import FittedModel

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Wdouble-promotion", "-Wshadow", "-Werror")
TOOL = (1.5, -2.5, -120.0)


def needs(*programs: str) -> None:
    """Skip, and say why, where a program is not installed."""
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")


def compiles(compiler: str) -> bool:
    """Whether a compiler finds the headers of its C library."""
    return (
        subprocess.run(
            [compiler, "-xc", "-E", "-include", "stdio.h", "-"], input="", text=True, capture_output=True
        ).returncode
        == 0
    )


def run(*command: object, cwd: Path) -> str:
    done = subprocess.run([str(word) for word in command], cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
    return done.stdout


def loaded(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"loader_{path.parent.name.replace('-', '_')}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def fitted(
    machine: Machine, values: dict[str, float] | None = None, seed: int = 0, effects: tuple[Effect, ...] = ()
) -> FittedModel:
    """A model as an identification leaves it, with given or drawn values."""
    bare = FittedModel(
        machine=machine, effects=effects, values={}, std={}, names=(), units={}, covariance=np.zeros((0, 0))
    )
    parameters = subject_of(bare).parameters
    drawn = np.random.default_rng(seed).normal(size=len(parameters))
    chosen = {p.name: float(round(v * p.sigma, 3)) for p, v in zip(parameters, drawn, strict=True)}
    if values is not None:
        chosen = {p.name: values.get(p.name, 0.0) for p in parameters}
    names = tuple(chosen)
    return FittedModel(
        machine=machine, effects=effects, values=chosen, std=dict.fromkeys(names, 1.0), names=names,
        units={p.name: p.unit for p in parameters}, covariance=np.eye(len(names)),
    )  # fmt: skip


def isg_error(table: Path, model: FittedModel, poses: int = 400) -> float:
    """Largest distance (µm) of the tool's point by an ISG table, read with straight lines between its rows, from the model's."""
    machine, subject = model.machine, subject_of(model)
    location: dict[str, float] = {}
    tables: list[tuple[str, list[str], np.ndarray]] = []
    for block in table.read_text().split("#\n"):
        head, *rows = (line.split() for line in block.splitlines() if line and not line.startswith("//"))
        numbers = np.array(rows, dtype=float)
        if head[0] in machine.axes:
            tables.append((head[0], head[1:], numbers))
        else:
            location |= {f"E{name}": value for name, value in zip(head, numbers[0], strict=True)}
    reference, rng, worst = subject.function(), np.random.default_rng(1), 0.0
    for _ in range(poses):
        at = {name: rng.uniform(*axis.travel) for name, axis in machine.axes.items()}
        motion = {
            name: float(np.interp(at[axis], numbers[:, 0], numbers[:, k]))
            for axis, names, numbers in tables
            for k, name in enumerate(names, start=1)
        }
        q = {name: value * machine.axes[name].to_internal for name, value in at.items()}
        found = ball_in_workpiece(machine, q, ca.DM(TOOL), location=location, motion=motion, shift=ca.DM.zeros(3))
        wanted = reference([q[name] for name in subject.axes], TOOL, subject.values)[0]
        worst = max(worst, 1e3 * float(ca.norm_2(ca.DM(ca.evalf(ca.SX(found))) - wanted)))
    return worst


class Compiled:
    """Presets as C, generated and compiled when they are first asked for."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._machines: dict[str, object] = {}

    def folder(self, name: str) -> Path:
        if not (self._root / name).exists():
            codegen(fitted(preset(name)), self._root / name)
        return self._root / name

    def machine(self, name: str):
        if name not in self._machines:
            needs("gcc")
            module = loaded(self.folder(name) / "sf.py")
            self._machines[name] = module.Machine(module.build(compiler="gcc", flags=("-O0",)))
        return self._machines[name]


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Compiled:
    return Compiled(tmp_path_factory.mktemp("c"))


LARGE = ("oyama-2010", "wang-li-2016")
EVERY = [pytest.param(name, marks=pytest.mark.slow) if name in LARGE else name for name in presets()]
