"""The contract of the generated C: every argument checked, nothing that is not finite called done, no jump of the commands.

`python -m tests.test_codegen_contract` makes 10⁸ calls and 10⁴ paths, in double and single precision, on the presets in turn.
"""

import subprocess
import sys
import tempfile
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

sys.path.insert(0, str(Path(__file__).parent))
from codegen_world import TOOL, Compiled, fitted, loaded, needs, run

from symfive.codegen import codegen, subject_of
from symfive.machine import preset, presets

PROGRAM = Path(__file__).parent / "fuzz" / "contract.c"
BUILDS = {"double": (), "float": ("-DSF_FLOAT",)}
TURNING = [name for name in presets() if len(preset(name).rotary_axes) == 2]
CALLS, PATHS = 10**5, 1000
"""In the quick tests; the long run has a thousand and ten times as many."""


QUICK = ("three-axis", "table-bc", "mixed-bc")
"""No rotary axes; both in the table; one in the head."""


def cases(names: list[str]) -> list[object]:
    return [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in names]


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Compiled:
    return Compiled(tmp_path_factory.mktemp("c"))


def built(folder: Path, precision: str) -> Path:
    """The fuzzer of a folder's sources."""
    program = folder / f"contract-{precision}"
    if not program.exists():
        command = ("gcc", "-std=gnu99", "-Wall", "-Wextra", "-Werror", "-O2", *BUILDS[precision], "-I.")
        run(*command, PROGRAM, "sf.c", "-lm", "-o", program, cwd=folder)
    return program


def kinds(name: str) -> str:
    machine = preset(name)
    return "".join("r" if machine.axes[axis].rotary else "l" for axis in subject_of(machine).axes)


def singular_poses(name: str, machine) -> list[str]:
    """Rotary positions at which the rotary axes turn the nominal direction in one plane only."""
    places = [i for i, kind in enumerate(kinds(name)) if kind == "r"]

    def smallest(turn: float, place: int) -> float:
        q = np.zeros(len(kinds(name)))
        q[places], q[place] = 0.3, turn
        slopes = machine.axis_jacobian(q, TOOL, 0.0 * machine.p)[1][:, places]
        return float(np.linalg.svd(slopes, compute_uv=False)[1])

    found = []
    grid = np.linspace(-3.3, 3.3, 133)
    for place in places:
        values = [smallest(turn, place) for turn in grid]
        for k in range(1, len(grid) - 1):
            if values[k] <= min(0.06, values[k - 1], values[k + 1]):
                ends, options = (grid[k - 1], grid[k + 1]), {"xatol": 1e-12}
                best = minimize_scalar(smallest, bounds=ends, args=(place,), method="bounded", options=options)
                if best.fun < 1e-6:
                    found.append(",".join(repr(float(best.x)) if i == place else "0.3" for i in places))
    return sorted(set(found))


@pytest.mark.parametrize("precision", ["double", pytest.param("float", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", cases(presets()))
def test_fuzzed_calls(compiled, name, precision) -> None:
    needs("gcc")
    count = CALLS // len(QUICK) + 1
    assert "0 failures" in run(built(compiled.folder(name), precision), "calls", count, 1, cwd=Path())


@pytest.mark.parametrize("name", cases(TURNING))
def test_commands_do_not_jump_at_singular_poses(compiled, name) -> None:
    needs("gcc")
    poses = singular_poses(name, compiled.machine(name))
    assert poses
    told = run(
        built(compiled.folder(name), "double"),
        "paths",
        PATHS // len(set(QUICK) & set(TURNING)),
        1,
        kinds(name),
        *poses,
        cwd=Path(),
    )
    assert "0 failures" in told and " 0 of them singular" not in told


def test_every_argument_is_checked(compiled) -> None:
    machine = compiled.machine("table-bc")
    q, target = np.array([1.0, 2.0, 3.0, 0.5, 0.7]), np.array([1.0, 2.0, 3.0])
    for wrong in (np.nan, np.inf, -np.inf, 1e300):
        for call in (
            lambda bad: machine.forward(q, bad), lambda bad: machine.nominal(q, bad), lambda bad: machine.error(q, bad),
            lambda bad: machine.axis_jacobian(q, bad), lambda bad: machine.parameter_jacobian(q, bad),
            lambda bad: machine.direction_jacobian(q, bad), lambda bad: machine.inverse_nominal(target, bad, q),
            lambda bad: machine.inverse(target, bad, q), lambda bad: machine.inverse_nominal(bad, TOOL, q),
            lambda bad: machine.inverse(bad, TOOL, q), lambda bad: machine.compensate(q, bad),
            lambda bad: machine.compensate_direction(q, bad), lambda bad: machine.orient(bad, q),
            lambda bad: machine.orient([0.0, 0.6, 0.8], np.append(bad, [0.0, 0.0])),
        ):  # fmt: skip
            for place in range(3):
                bad = np.array(TOOL)
                bad[place] = wrong
                with pytest.raises(ArithmeticError, match="not finite"):
                    call(bad)


def test_directions_are_unit_vectors_or_refused(compiled) -> None:
    machine = compiled.machine("table-bc")
    q = np.array([1.0, 2.0, 0.5, 0.7, 3.0])
    wanted = machine.orient([0.0, 0.6, 0.8], q)
    for length in (0.9991, 0.9999, 1.0009):
        assert machine.orient(length * np.array([0.0, 0.6, 0.8]), q) == pytest.approx(wanted, abs=1e-12)
    for direction in ([0.0, 0.0, 0.0], [0.0, 0.0, 0.5], [0.0, 0.6, 0.81], [0.0, 0.0, 1.0011]):
        with pytest.raises(ArithmeticError, match="no unit vector"):
            machine.orient(direction, q)
    with pytest.raises(ArithmeticError, match="singular") as told:
        machine.orient([0.0, 0.0, 0.9999], q)
    assert machine.nominal(told.value.q, TOOL)[1] == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)


def test_the_singular_region_has_no_edge(compiled) -> None:
    """Across the edge the commands and what is left of the tilt change smoothly; at the pose itself C stays as wanted."""
    machine = compiled.machine("table-bc")
    p = 3.0 * machine.p

    def command(turn: float) -> tuple[np.ndarray, bool, float]:
        q = np.array([40.0, -30.0, turn, 0.7, 20.0])
        try:
            found, singular = machine.compensate_direction(q, TOOL, p), False
        except ArithmeticError as error:
            assert error.status == 1
            found, singular = error.q, True
        left = machine.forward(found, TOOL, p)[1] - machine.nominal(q, TOOL)[1]
        return found - q, singular, float(np.abs(left).max())

    turns = np.linspace(-0.1, 0.1, 2001)
    changes, singular, left = (np.array(part) for part in zip(*map(command, turns), strict=True))
    assert singular.any() and not singular[[0, -1]].any()
    steps = np.abs(np.diff(changes, axis=0)).max(axis=0)  # Y X B C Z; B goes on by 1e-4 rad
    assert steps[2:4].max() < 1e-4 and steps[[0, 1, 4]].max() < 1e-4 * 300.0
    assert left[~singular].max() < 1e-11
    assert left[singular].max() < np.abs(machine.error([40.0, -30.0, 0.0, 0.7, 20.0], TOOL, p)[1]).max() * 1.1


def test_directions_through_the_pole_turn_one_axis_only(compiled) -> None:
    """A path of directions straight through the pole: the tilting axis goes through zero, the other one stays."""
    machine = compiled.machine("table-bc")
    q = np.array([0.0, 0.0, -0.05, 0.7, 0.0])
    plane = machine.nominal(q, TOOL)[1][:2] / np.sin(0.05)
    commands = []
    for turn in np.linspace(0.05, -0.05, 1001):
        direction = np.append(np.sin(turn) * plane, np.cos(turn))
        try:
            q = machine.orient(direction, q)
        except ArithmeticError as error:
            assert error.status == 1
            q = error.q
        commands.append(q[2:4])
    steps = np.abs(np.diff(commands, axis=0)).max(axis=0)
    assert steps[0] < 1.01e-4 and steps[1] < 1e-8
    assert commands[-1] == pytest.approx([0.05, 0.7], abs=1e-8)


def main() -> int:
    """The long run, on the presets in turn."""
    failed = 0
    with tempfile.TemporaryDirectory() as room:
        for name, precision in product(presets(), BUILDS):
            folder = Path(room) / name
            if not folder.exists():
                codegen(fitted(preset(name)), folder)
            calls = 1000 * CALLS // (len(presets()) * len(BUILDS)) + 1
            commands = [["calls", str(calls), "7"]]
            if name in TURNING and precision == "double":
                module = loaded(folder / "sf.py")
                poses = singular_poses(name, module.Machine(module.build(compiler="gcc")))
                commands.append(["paths", str(10 * PATHS // len(TURNING) + 1), "7", kinds(name), *poses])
            for command in commands:
                print(f"{name}, {precision}:", flush=True)
                failed |= subprocess.run([str(built(folder, precision)), *command]).returncode
    return failed


if __name__ == "__main__":
    sys.exit(main())
