"""Cost of the model and of an identification: time, growth with the rows, memory, exact sensitivities.

    python benchmarks/identify.py            # full: 10^3 … 10^6 rows, less than four minutes
    python benchmarks/identify.py --quick    # 10^3 … 3·10^4 rows, for a look

Everything is measured in one run on one machine, so that the ratios mean something wherever it runs. Every size runs in
a process of its own, whose greatest memory (resident set) is read at its end. Times are processor
time, which other programs on the machine do not lengthen; the wall time stands beside the first.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from symfive.campaign import Campaign
from symfive.effects import make_effect
from symfive.identify import identify
from symfive.machine import preset
from symfive.model import Model
from symfive.procedures import campaign_of, planar_circle, rotary_circle
from symfive.simulate import simulate

ROWS = 24_000
FULL = (1_000, 10_000, 100_000, 1_000_000)
QUICK = (1_000, 5_000, 30_000)
RATE_HZ = 50.0
SEED = 3


def plan(rows: int) -> Campaign:
    """Circles of the axis C and in the XY plane, both senses, at a rate that gives about so many rows."""
    machine = preset("table-bc")

    def at(rate: float) -> Campaign:
        turns = rotary_circle(machine, axis="C", rate_hz=rate)
        circles = planar_circle(machine, plane="XY", feed=2000.0, rate_hz=rate)
        return campaign_of(machine, (*turns, *circles), name="benchmark")

    return at(RATE_HZ * rows / at(RATE_HZ).rows)


def one(rows: int) -> dict[str, float]:
    """Build, predict, linearise and identify a campaign of so many rows (s), and the memory it took (MB)."""
    begin_memory = _peak_mb()
    measured = simulate(plan(rows), seed=SEED)
    begin = time.process_time()
    model = Model(measured.campaign)
    model.predict(model.start)  # compiles the functions
    for run in measured.campaign.runs:
        model.linearise(run, model.start)
    build = time.process_time() - begin
    predict = _time(lambda: model.predict(model.start))
    slopes = _time(lambda: [model.linearise(run, model.start) for run in measured.campaign.runs])
    begin, wall = time.process_time(), time.perf_counter()
    result = identify(measured.campaign)
    fit, wall = time.process_time() - begin, time.perf_counter() - wall
    return {
        "rows": measured.campaign.rows, "parameters": len(model.parameters), "build": build, "predict": predict,
        "slopes": slopes, "identify": fit, "wall": wall, "converged": float(result.converged), "chi2": result.chi2_dof,
        "memory": _peak_mb() - begin_memory,
    }  # fmt: skip


def sensitivities(rows: int) -> list[str]:
    """Exact sensitivities against central differences of the same model: time and largest error."""
    effects = [make_effect("servo_mismatch", "C"), make_effect("transmission_error", "X", period=10.0)]
    campaign = simulate(plan(rows), effects=effects, seed=SEED).campaign
    model = Model(campaign, effects)
    values = model.start.copy()
    # kept at 0.1 of the prior away from zero so that nothing vanishes
    values += 0.1 * np.array([min(p.sigma, 50.0) if p.kind != "drive" else 0.0 for p in model.parameters])
    run = campaign.runs[0]
    model.linearise(run, values)
    exact = _time(lambda: model.linearise(run, values))
    line = model.linearise(run, values)
    begin = time.process_time()
    columns = [_difference(model, run.id, values, int(i)) for i in line.columns]
    differences = time.process_time() - begin
    worst, name = 0.0, ""
    for k, (column, index) in enumerate(zip(columns, line.columns, strict=True)):
        size = float(np.abs(line.jacobian[:, :, k]).max())
        if size * model.parameters[index].sigma < 1e-3:
            continue  # it moves no reading by 1 nm: the differences would show rounding only
        error = float(np.abs(column - line.jacobian[:, :, k]).max()) / size
        if error > worst:
            worst, name = error, model.parameters[index].name
    count = len(line.columns)
    return [
        f"sensitivities of {run.rows} rows to {count} parameters",
        f"  exact {1e3 * exact:.1f} ms, central differences {1e3 * differences:.1f} ms: {differences / exact:.0f} times faster",
        f"  largest difference between the two {worst:.1e} of the largest entry ({name})",
    ]


def _difference(model: Model, run: str, values: np.ndarray, i: int) -> np.ndarray:
    step, parameter = np.zeros_like(values), model.parameters[i]
    share = 1e-2 if parameter.unit in ("um", "urad") else 1e-3  # far above rounding, far below curvature
    step[i] = share * min(parameter.sigma, 100.0)
    return (model.predict_run(run, values + step) - model.predict_run(run, values - step)) / (2.0 * step[i])


def _time(call: Callable[[], object]) -> float:
    """Shortest of a few calls (one, if it is long), s."""
    times: list[float] = []
    while len(times) < 3 and sum(times) < 1.0:
        begin = time.process_time()
        call()
        times.append(time.process_time() - begin)
    return min(times)


def _peak_mb() -> float:
    """Greatest resident set of this process so far, MB."""
    unit = 1024.0**2 if sys.platform == "darwin" else 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def _apart(rows: int) -> dict[str, float]:
    """`one` in a process of its own."""
    command = [sys.executable, str(Path(__file__).resolve()), "--one", str(rows)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


def _exponent(sizes: list[float], costs: list[float]) -> float:
    """Slope of log cost over log rows."""
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def report(sizes: tuple[int, ...], rows: int) -> None:
    """Print the table."""
    packages = ", ".join(f"{name} {_version(name)}" for name in ("casadi", "numpy", "scipy"))
    print(f"Python {platform.python_version()}, {packages}, {os.cpu_count()} cores")
    reference = _apart(rows)
    print(
        f"{reference['rows']:.0f} rows, {reference['parameters']:.0f} parameters: model built {reference['build']:.2f} s, "
        f"identified {reference['identify']:.2f} s (wall {reference['wall']:.2f} s), chi²/dof {reference['chi2']:.3f}"
    )
    print(
        f"{'rows':>9} {'build s':>8} {'predict s':>10} {'slopes s':>9} {'identify s':>11} {'µs/row':>7} {'memory MB':>10}"
    )
    table = []
    for size in sizes:
        entry = _apart(size)
        table.append(entry)
        per_row = 1e6 * entry["identify"] / entry["rows"]
        print(
            f"{entry['rows']:9.0f} {entry['build']:8.2f} {entry['predict']:10.4f} {entry['slopes']:9.4f} "
            f"{entry['identify']:11.2f} {per_row:7.1f} {entry['memory']:10.0f}",
            flush=True,
        )
    upper = table[-2:]
    for name, label in (("predict", "prediction"), ("slopes", "sensitivities"), ("identify", "identification")):
        whole = _exponent([e["rows"] for e in table], [e[name] for e in table])
        last = _exponent([e["rows"] for e in upper], [e[name] for e in upper])
        print(f"growth of {label}: rows^{whole:.2f} over all sizes, rows^{last:.2f} over the last two")
    last = _exponent([e["rows"] for e in upper], [e["memory"] for e in upper])
    print(
        f"growth of memory: rows^{last:.2f} over the last two, {1e6 * upper[-1]['memory'] / upper[-1]['rows']:.0f} B a row"
    )
    print("\n".join(sensitivities(rows)))


def _version(name: str) -> str:
    from importlib.metadata import version

    return version(name)


def main(arguments: list[str] | None = None) -> int:
    """Parse the options and measure."""
    parser = argparse.ArgumentParser(description="Time, memory and exactness of model and identification.")
    parser.add_argument("--quick", action="store_true", help="small sizes, for a look")
    parser.add_argument("--one", type=int, metavar="ROWS", help="one size only, as JSON (used by the whole run)")
    options = parser.parse_args(arguments)
    if options.one:
        print(json.dumps(one(options.one)))
    else:
        report(QUICK if options.quick else FULL, 5_000 if options.quick else ROWS)
    return 0


if __name__ == "__main__":
    sys.exit(main())
