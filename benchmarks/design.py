"""The designer against its targets and against plain ways of doing the same, in one run on one core.

    .venv/bin/python benchmarks/design.py [--quick] [--peers PYTHON]

Prints: speed and quality on a chain of five axes with 30 errors (12 combinations of them identifiable), with FIGAROH and pydex
on the same candidates where PYTHON has them; whole plans; the R-test of paper 2; the ball bar of paper 1; the synchronous
circle of paper 3. Ratios travel between machines, seconds do not.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from timing import timed

from symfive.campaign import Run, SetupSigma
from symfive.design import assess, certify, circle_information, make_space, optimise, plan
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.kinematics import ball_in_workpiece
from symfive.machine import Machine, preset
from symfive.optimal import (
    Candidates,
    Kernel,
    Rows,
    Task,
    Worst,
    choose,
    criterion_of,
    refine,
    relax,
    sensitivity,
)
from symfive.procedures import campaign_of, r_test_grid, rotary_circle, static_ball_bar
from symfive.threads import one_thread

POINTS, CANDIDATES = 20, 1000
PEERS = ("FIGAROH DETMAX", "pydex")


def chain() -> tuple[Kernel, np.ndarray, np.ndarray, Any]:
    """Five free axes, six constant errors each, reading d (3): rows projected on the identifiable combinations."""
    machine = preset("table-bc")
    z = ca.SX.sym("z", 5)
    scale = {"X": 300.0, "Y": 250.0, "Z": 250.0, "B": np.radians(110.0), "C": np.pi}
    position = {name: scale[name] * z[i] for i, name in enumerate(machine.axis_names)}
    errors = ca.SX.sym("errors", 30)
    names = [f"E{c}{axis}" for axis in machine.axis_names for c in "XYZABC"]
    unit = [1e-2 if name[1] in "XYZ" else 1e-4 for name in names]  # 10 µm, 100 µrad
    motion = {name: unit[i] * errors[i] for i, name in enumerate(names)}
    ball = ball_in_workpiece(machine, position, ca.DM([0.0, 0.0, -150.0]), motion=motion)
    jacobian = ca.substitute(ca.jacobian(ball, errors), errors, ca.DM.zeros(30)) / 1e-3
    evaluate = ca.Function("J", [z], [jacobian])
    generator = np.random.default_rng(0)
    stack = np.concatenate([np.asarray(evaluate(generator.uniform(-1, 1, 5))) for _ in range(300)])
    _, values, rows = np.linalg.svd(stack, full_matrices=False)
    seen = rows[values > 1e-8 * values[0]]
    projected = jacobian @ ca.DM(seen.T)
    kernel = Kernel(z, ca.SX.sym("k", 1), projected, ca.SX(0, 1))
    return kernel, -np.ones(5), np.ones(5), ca.Function("rows", [z], [projected])


def log_det(task: Task, value: float) -> float:
    """log det of the information from ψ of D."""
    return -len(task.interest) * value


def speed(quick: bool, peers: str | None) -> dict[str, tuple[float, float] | str]:
    """Candidates, continuous starts, bound; the same with CasADi's automatic derivatives and by the peers.

    Returns log det and CPU seconds by name; for a peer that is not there the reason why.
    """
    kernel, lower, upper, function = chain()
    p = kernel.width
    task = Task(criterion_of("D", p, np.zeros((0, 3, p))), 1e-6 * np.eye(p), np.zeros(0), np.arange(p))
    generator = np.random.default_rng(1)
    z = generator.uniform(-1.0, 1.0, (CANDIDATES, 5))
    one = np.zeros((CANDIDATES, 1))
    none = np.zeros(CANDIDATES, dtype=np.int64)
    candidates = Candidates(z, one, none, kernel.rows(z, one))

    def value(chosen: np.ndarray) -> float:
        return log_det(task, task.value(task.information(candidates.rows[chosen], none[chosen], 1)))

    def started(some: Candidates) -> tuple[Rows, float]:
        picked = some.take(choose(task, some, 1, POINTS, passes=1))
        return refine(task, kernel, Rows.of(picked.z, picked.k, picked.group, 5), lower, upper)

    print(f"\nChain of five axes, {p} identifiable parameters, N = {POINTS} poses, {CANDIDATES} candidates")
    print(f"{'method':62}{'log det':>10}{'CPU s':>9}")
    seconds, draws = timed(lambda: max(value(generator.integers(0, CANDIDATES, POINTS)) for _ in range(1000)), 1)
    told("best of 1000 random designs", draws, seconds)
    chosen, best = timed(lambda: choose(task, candidates, 1, POINTS))
    told("relaxed design rounded, Fedorov exchange", value(best), chosen)
    bounding, relaxed = timed(lambda: relax(task, candidates, 1, POINTS))
    highest = log_det(task, relaxed.bound)
    told("relaxed design: bound on the candidates", highest, bounding)
    print(f"  exchange and relaxed design together {chosen + bounding:.3f} s (target <= 0.05 s)")
    others = _peers(peers, candidates, value)
    print(f"  exchange reaches {np.exp((value(best) - highest) / p):.4f} of the bound (target 0.985)")

    rows = Rows.of(z[best], one[best], none[best], 5)
    structured, found = timed(lambda: refine(task, kernel, rows, lower, upper))
    told("IPOPT, exact structured Hessian (target <= 0.10 s)", log_det(task, found[1]), structured)
    automatic, reached = timed(lambda: _automatic(function, p, rows), 1)
    told("IPOPT, automatic Hessian (MX map)", reached, automatic)
    lazy, slower = timed(lambda: _automatic(function, p, rows, lazy=True), 1)
    told("IPOPT, L-BFGS", slower, lazy)
    print(f"  structured is {automatic / structured:.1f} times faster than automatic (target 10)")

    starts = 10 if quick else 50
    draw = [np.random.default_rng(seed).integers(0, CANDIDATES, 200) for seed in range(starts)]
    many, results = timed(lambda: [started(candidates.take(d)) for d in draw], 1)
    top = min(results, key=lambda r: r[1])
    told(f"best of {starts} continuous starts (target 6 s for 50)", log_det(task, top[1]), many)
    proving, (bound, support) = timed(lambda: _global_bound(task, kernel, top[0]), 1)
    told("Kiefer-Wolfowitz bound, column generation (target <= 5 s)", log_det(task, bound), proving)
    seconds, again = timed(lambda: started(support), 1)
    told("one more start, from the relaxed design's poses", log_det(task, again[1]), seconds)
    print(f"  certified efficiency >= {np.exp(bound - min(top[1], again[1])):.4f} (target 0.99)")
    return others | {
        "candidates": (value(best), chosen), "bound on candidates": (highest, bounding),
        "structured": (log_det(task, found[1]), structured), "automatic": (reached, automatic), "L-BFGS": (slower, lazy),
        f"best of {starts}": (log_det(task, min(top[1], again[1])), many), "bound": (log_det(task, bound), proving),
    }  # fmt: skip


def told(what: str, value: float, seconds: float) -> None:
    """One line of the table."""
    print(f"{what:62}{value:10.4f}{seconds:9.3f}")


def _peers(
    python: str | None, candidates: Candidates, value: Callable[[np.ndarray], float]
) -> dict[str, tuple[float, float] | str]:
    """The peers' choice from the same candidates: log det and CPU seconds, or why it was skipped."""
    if python is None:
        reason = "skipped: give --peers PYTHON (an environment with figaroh and pydex)"
        print(f"  FIGAROH and pydex: {reason}")
        return dict.fromkeys(PEERS, reason)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "candidates.npz"
        np.savez(path, z=candidates.z, rows=candidates.rows)
        script = Path(__file__).with_name("peers.py")
        done = subprocess.run(
            [python, str(script), str(path), str(POINTS)], capture_output=True, text=True, check=False
        )
    if done.returncode:
        reason = f"skipped: {(done.stderr.strip().splitlines() or ['no message'])[-1]}"
        print(f"  FIGAROH and pydex: {reason}")
        return dict.fromkeys(PEERS, reason)
    judged: dict[str, tuple[float, float] | str] = {}
    for name, found in json.loads(done.stdout.splitlines()[-1]).items():
        if "reason" in found:
            judged[name] = f"skipped: {found['reason']}"
            print(f"  {name}: {judged[name]}")
        else:
            log, seconds = value(np.array(found["chosen"])), found["seconds"]
            judged[name] = log, seconds
            told(name, log, seconds)
    return judged


def _automatic(function: Any, p: int, rows: Rows, lazy: bool = False) -> float:
    n = len(rows.z)
    x = ca.MX.sym("x", 5 * n)
    stacked = function.map(n)(ca.reshape(x, 5, n))
    matrix = 1e-6 * ca.DM.eye(p)
    for part in ca.horzsplit(stacked, p):
        matrix = matrix + part.T @ part
    scale = 1e4  # keeps the determinant inside the range of doubles
    objective = -ca.log(ca.det(matrix / scale)) / p
    options: dict[str, Any] = {
        "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-6, "max_iter": 200},
        "print_time": False,
    }
    if lazy:
        options["ipopt"]["hessian_approximation"] = "limited-memory"
    solver = ca.nlpsol("s", "ipopt", {"x": x, "f": objective}, options)
    found = solver(x0=np.clip(rows.z.ravel(), -0.999, 0.999), lbx=-1.0, ubx=1.0)
    return -p * float(found["f"]) + p * np.log(scale)


def _global_bound(task: Task, kernel: Kernel, rows: Rows) -> tuple[float, Candidates]:
    """Column generation with a multi-start compass search over the five axes (numerically global)."""
    n = len(rows.z)
    generator = np.random.default_rng(0)
    columns = np.concatenate([rows.z, generator.uniform(-1.0, 1.0, (400, 5))])
    bound = -np.inf
    grid = np.concatenate([generator.uniform(-1.0, 1.0, (3000, 5)), generator.choice([-1.0, 0.0, 1.0], (1000, 5))])
    for _ in range(20):
        zeros = np.zeros((len(columns), 1))
        group = np.zeros(len(columns), dtype=np.int64)
        candidates = Candidates(columns, zeros, group, kernel.rows(columns, zeros))
        relaxed = relax(task, candidates, 1, n, tolerance=1e-3)

        def seen(z: np.ndarray, pull: np.ndarray = relaxed.pull) -> np.ndarray:
            return sensitivity(pull, kernel.rows(z, np.zeros((len(z), 1))))

        z = grid[np.argsort(seen(grid))[::-1][:100]].copy()
        value, step = seen(z), 0.2
        for _ in range(14):
            for i in range(5):
                for sign in (1.0, -1.0):
                    trial = z.copy()
                    trial[:, i] = np.clip(trial[:, i] + sign * step, -1.0, 1.0)
                    there = seen(trial)
                    better = there > value
                    z[better], value[better] = trial[better], there[better]
            step *= 0.5
        level = np.log(np.sum(relaxed.pull * task.prior) + n * value.max())
        bound = max(bound, relaxed.value - level)
        if relaxed.value - bound < 2e-3:
            break
        columns = np.concatenate([columns[relaxed.weights > 1e-5 * n], z[np.argsort(value)[::-1][:30]]])
    return bound, candidates.take(np.flatnonzero(relaxed.weights > 1e-4))


def whole_plans(quick: bool) -> None:
    """`plan` as the command line calls it: two starts, certificate, order of poses."""
    print("\nWhole plans, all parameters of the machine file, 2 starts")
    print(f" {'machine, instrument, poses':32}{'ψ':>9}{'efficiency':>12}{'anywhere':>10}{'CPU s':>8}")
    for name, instrument, points in (("table-bc", "r_test", 40), ("table-bc", "ball_bar", 48))[: 1 if quick else 2]:
        seconds, made = timed(lambda: plan(preset(name), instrument=instrument, points=points), 1)  # noqa: B023
        c = made.certificate
        print(
            f" {f'{name}, {instrument}, {points}':32}{c.value:9.4f}{c.efficiency:12.4f}{c.anywhere:10.3f}{seconds:8.1f}"
        )


def locations(name: str) -> Machine:
    """The preset machine with its location errors only."""
    machine = preset(name)
    return replace(machine, errors={k: v for k, v in machine.errors.items() if v.is_location}, text="")


def paper_2(quick: bool) -> None:
    """R-test: the two-nest 30° grid of 168 poses against chosen poses."""
    machine = locations("oyama-2010")
    print(
        "\nR-test of paper 2, 8 location errors, 0.3 µm of noise; every mounting has its own tool ball and zeros, the grid's too."
    )
    for tool in (20.0,) if quick else (20.0, 0.0):
        sigma = SetupSigma(tool_ball=tool)
        grid = assess(campaign_of(machine, r_test_grid(machine, returning=False, noise_um=0.3, setup_sigma_um=sigma)))
        names = [p.name for p in machine.errors.values()]
        print(
            f" tool ball known to {tool:g} µm at each mounting. Volume of the joint uncertainty, plan / grid; the least that any"
        )
        print(
            " plan with as many poses can have in these set-ups (proved) and in as many others (searched); 1σ grid / 1σ plan"
        )
        print(f" {'poses, mountings':18}{'volume':>8}{'least':>8}{'others':>8}  {' '.join(names)}")
        for points, setups in ((48, 2), (48, 4), (48, 6), (96, 2), (168, 2), (168, 6)):
            made = plan(machine, points=points, setups=setups, starts=2, returns=0, setup_sigma=sigma)
            certificate, half = made.certificate, 0.5 * len(names)
            least = [certificate.bound, certificate.value + np.log(certificate.anywhere)]
            volumes = [np.exp(half * (psi - grid.value)) for psi in (made.assessment.value, *least)]
            ratio = " ".join(f"{grid.sigma[n] / made.assessment.sigma[n]:.2f}" for n in names)
            shown = "".join(f"{v:8.3g}" for v in volumes)
            print(f" {f'{points}, {len(made.campaign.runs)}':18}{shown}  {ratio}")
    _every_sigma(machine)


def _every_sigma(machine: Machine) -> None:
    """How much smaller every 1σ of the grid can be made with as many poses: maximise the least ratio, with its bound."""
    grid = assess(campaign_of(machine, r_test_grid(machine, returning=False, noise_um=0.3)))
    space = make_space(machine, "r_test", noise_um=0.3)
    names = [p.name for p in space.shared]
    scale = np.array([p.sigma / grid.sigma[p.name] for p in space.shared])
    tool = space.setup_sigma.tool_ball
    print(
        " 168 poses, the least ratio of all 1σ as large as can be. A shift of the whole table (EX0B, EZ0B, EY0C) moves the"
    )
    print(" readings as the tool ball's own offset does, so only its priors tell of it: (1/30² + mountings/20²)^-½ µm.")
    for setups in (2, 6):
        floor = (30.0**-2 + setups / tool**2) ** -0.5
        seen = [i for i, n in enumerate(names) if setups > 2 or n not in ("EX0B", "EZ0B", "EY0C")]
        weights = np.stack([np.diag(np.where(np.array(seen) == i, scale[i] ** 2, 0.0)) for i in seen])
        task = Task(Worst(weights), np.eye(len(names)), space.own_sigma, np.array(seen))
        rows, _ = one_thread(optimise)(space, task, 168, setups, starts=2)
        certificate = one_thread(certify)(space, task, rows)
        matrix = task.information(space.kernel.rows(rows.z, rows.k), rows.group, rows.groups)
        covariance = np.diag(np.linalg.inv(matrix))[: len(names)]
        ratio = {n: 1.0 / (scale[i] * covariance[i] ** 0.5) for i, n in enumerate(names)}
        print(
            f" {setups} mountings, shifts at best {floor:.2f} µm: {' '.join(f'{n} {r:.2f}' for n, r in ratio.items())}"
        )
        best = min(ratio[names[i]] for i in seen)
        print(
            f"   least {best:.3f}; no plan in these set-ups has more than {np.exp(-0.5 * certificate.bound):.3f} (proved)"
        )


def paper_1(quick: bool) -> None:
    """Ball bar: the paper's own B and C tests against chosen heights, bars and modes."""
    machine = locations("wang-li-2016")  # its squareness errors belong to the cross grid and are left out
    machine = replace(machine, errors={k: v for k, v in machine.errors.items() if machine.axes[v.axis].rotary})
    circles = [
        run
        for arrangement in ("axial", "radial", "tangential")
        for run in rotary_circle(machine, axis="B", direction="ccw", arrangement=arrangement)
    ]
    runs = [_at_rest(run, f"p{i}", 37) for i, run in enumerate(circles)]
    runs += list(static_ball_bar(machine, noise_um=0.3))
    paper = assess(campaign_of(machine, runs))
    readings = sum(run.rows for run in runs)
    names = [p.name for p in machine.errors.values()]
    print(f"\nBall bar of paper 1, {len(names)} location errors:", end=" ")
    print(f"the paper's {len(runs)} tests ({readings} readings): ψ = {paper.value:.3f}")
    print(f" {'poses, set-ups':18}{'ψ':>8}  1σ paper / 1σ plan, per error ({', '.join(names)})")
    for points, setups in ((24, 2), (36, 3)) if quick else ((24, 1), (24, 2), (36, 3), (60, 3)):
        made = plan(machine, instrument="ball_bar", points=points, setups=setups, starts=2, returns=0)
        ratio = " ".join(f"{paper.sigma[n] / made.assessment.sigma[n]:.2f}" for n in names)
        size = f"{points}, {len(made.campaign.runs)}"
        print(f" {size:18}{made.assessment.value:8.3f}  {ratio}  >= {made.certificate.efficiency:.3f}")
        for run in made.campaign.runs:
            heights = (
                f"ball {tuple(round(v) for v in run.table_ball)}, tool {-run.tool_ball[2]:.0f}, bar {run.length:g} mm"
            )
            print(f"     {run.id}: {heights}, {run.rows} poses")


def _at_rest(run: Run, name: str, rows: int) -> Run:
    """Some rows of a recording as a static run."""
    picked = np.unique(np.linspace(0, run.rows - 1, rows).astype(int))
    commands = {axis: values[picked] for axis, values in run.commands.items()}
    return replace(
        run, id=name, file=f"{name}.csv", sampling="static", time=6.0 * np.arange(len(picked)), commands=commands
    )


def paper_3() -> None:
    """Synchronous circle: expected 1σ of the servo mismatch and of backlash over X_T/r, eccentricity marginalised."""
    machine = preset("tsutsumi-2007")
    effects = [make_effect("servo_mismatch", "C", gains=("position_gain",)), make_effect("backlash", "C")]
    print("\nSynchronous circle of paper 3, r = 50 mm, both directions: expected 1σ")
    print(f" {'X_T/r':>6}{'F mm/min':>9}{'gain of C, 1/s':>16}{'backlash, µrad':>16}")
    for ratio in (0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 1.05, 1.1, 1.2, 1.25, 1.5, 1.8):
        for feed in (500.0, 1000.0):
            try:
                found = circle_information(machine, effects, ratio=ratio, radius=50.0, feed=feed).sigma
                gain, width = found["servo_mismatch.C.position_gain"], found["backlash.C.width"]
                print(f" {ratio:6.2f}{feed:9.0f}{gain:16.5f}{width:16.3f}")
            except InputError:
                print(f" {ratio:6.2f}{feed:9.0f}   an axis cannot follow")
    print(
        " The paper's 0.9 is the best ratio below 1 that C can follow at 1000 mm/min; above 1 C reverses, which shows its play"
    )
    print(" on X_T·sin φ: the farther out, the better; its gain is seen about as well from 1.2 on.")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer starts and plans")
    parser.add_argument("--peers", metavar="PYTHON", help="a Python that has figaroh and pydex")
    options = parser.parse_args()
    start = time.process_time()
    speed(options.quick, options.peers)
    whole_plans(options.quick)
    paper_2(options.quick)
    paper_1(options.quick)
    paper_3()
    print(f"\n{time.process_time() - start:.0f} s of processor time")
