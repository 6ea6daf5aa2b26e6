"""How right the results are: chain, open campaigns, held-out runs, coverage of the intervals.

    python benchmarks/accuracy.py            # 200 simulated machines
    python benchmarks/accuracy.py --quick    # 20
    python benchmarks/accuracy.py --workers 2, or --scheduler tcp://host:8786    # the same numbers, sooner

Truth comes from outside: the vectors and the open campaigns were written by an independent plant that shares no code
with symfive. Only the coverage is over machines that symfive itself simulates.
"""

from __future__ import annotations

import argparse
import json
import sys
from concurrent.futures import Executor
from pathlib import Path

import casadi as ca
import numpy as np

from symfive.campaign import read_campaign
from symfive.executors import executor, finished
from symfive.identify import fitted_model, identify, predict
from symfive.kinematics import ball_in_workpiece
from symfive.machine import Machine, machine_from_data
from symfive.simulate import simulate

DATA = Path(__file__).resolve().parent.parent / "tests" / "data"
BATCH = 10
"""Machines of one task."""
CLEAN = ("static-none", "static-ball-bar-two-heights", "dynamic-none")


def vectors() -> None:
    """Largest distance between the exact chain and the independent plant's points, by structure."""
    print(f"{'chain against vectors':<30} {'rows':>5} {'largest difference':>20}")
    for path in sorted((DATA / "vectors").glob("*.json")):
        vector = json.loads(path.read_text())
        machine = _machine(vector)
        worst = max(_difference(machine, vector, row) for row in vector["rows"])
        print(f"{path.stem + ': ' + vector['structure']:<30} {len(vector['rows']):5d} {worst:17.1e} mm")


def _machine(vector: dict) -> Machine:
    names = [word.rstrip("'") for word in vector["structure"].split() if word not in ("w", "b", "t")]
    axes: dict[str, dict] = {name: {"travel": [-1000.0, 1000.0]} for name in names}
    for key, field in (("origins_mm", "origin"), ("directions", "direction")):
        for name, value in vector.get(key, {}).items():
            axes[name][field] = value
    return machine_from_data({"schema": "symfive.machine/1", "structure": vector["structure"], "axes": axes})


def _difference(machine: Machine, vector: dict, row: dict) -> float:
    def internal(errors: dict[str, float]) -> dict[str, ca.SX]:
        return {name: ca.SX(value * (1e-3 if name[1] in "XYZ" else 1e-6)) for name, value in errors.items()}

    position = {name: ca.SX(q * machine.axes[name].to_internal) for name, q in row["command"].items()}
    location, motion = internal(vector["location_errors_um_urad"]), internal(row["error_motions_um_urad"])
    ball = ball_in_workpiece(machine, position, ca.DM(row["tool_ball_mm"]), location=location, motion=motion)
    return float(np.abs(np.asarray(ca.evalf(ball))[:, 0] - row["ball_in_workpiece_mm"]).max())


def open_campaigns() -> None:
    """Identified against true location errors, and the held-out run predicted."""
    heads = ("rows", "worst |error|/σ", "chi²/dof", "held-out rms/noise")
    print(f"\n{'open campaign':<30} " + " ".join(f"{head:>19}" for head in heads))
    for name in CLEAN:
        result = identify(read_campaign(DATA / "campaigns" / name / "fit"))
        truth = json.loads((DATA / "campaigns" / name / "truth.json").read_text())["location_errors_um_urad"]
        pull = max(abs(result[error] - value) / result.uncertainty(error) for error, value in truth.items())
        heldout = read_campaign(DATA / "campaigns" / name / "heldout")
        rms = predict(fitted_model(result), heldout).rms
        ratio = max(rms[run.id] / run.noise(run.instrument[0]) for run in heldout.runs)
        rows = result.model.campaign.rows
        print(f"{name:<30} {rows:19d} {pull:19.2f} {result.chi2_dof:19.3f} {ratio:19.3f}")


def covered(first: int, count: int) -> tuple[int, int]:
    """How many 95 % intervals hold the truth over machines simulated from these seeds, and how many there are."""
    plan = read_campaign(DATA / "campaigns" / "static-none" / "fit")
    hits = trials = 0
    for seed in range(first, first + count):
        measured = simulate(plan, seed=seed)
        result = identify(measured.campaign)
        for parameter in (p for p in result.parameters if p.kind == "location_error"):
            low, high = result.interval(parameter.name)
            hits += low <= measured.truth[parameter.name] <= high
            trials += 1
    return hits, trials


def coverage(machines: int, pool: Executor) -> None:
    """Share of true location errors inside their 95 % intervals over simulated machines."""
    hits = trials = 0
    for _, outcome in finished(pool, covered, [(first, BATCH) for first in range(0, machines, BATCH)]):
        if isinstance(outcome, Exception):
            raise outcome
        hits, trials = hits + outcome[0], trials + outcome[1]
    share = 100.0 * hits / trials
    print(f"\n95 % intervals: {hits} of {trials} hold the truth ({share:.1f} %), {machines} machines, static-none")


def main(arguments: list[str] | None = None) -> int:
    """Parse the options and measure."""
    parser = argparse.ArgumentParser(description="Accuracy against an independent plant, and coverage.")
    parser.add_argument("--quick", action="store_true", help="20 machines instead of 200")
    parser.add_argument("--workers", type=int, default=0, help="processes for the coverage; 0: none but this one")
    parser.add_argument("--scheduler", help="a Dask scheduler instead, as tcp://host:8786")
    options = parser.parse_args(arguments)
    vectors()
    open_campaigns()
    with executor(options.workers, options.scheduler) as pool:
        coverage(20 if options.quick else 200, pool)
    return 0


if __name__ == "__main__":
    sys.exit(main())
