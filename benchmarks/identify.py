"""Cost of the model and of an identification: time, growth with the rows, memory, exact sensitivities.

    python benchmarks/identify.py            # full: 10^3 … 10^6 rows, less than four minutes
    python benchmarks/identify.py --quick    # 10^3 … 3·10^4 rows, for a look
    python benchmarks/identify.py --long     # and a recording of 10^7 rows on disk

Everything is measured in one run on one machine, so that the ratios mean something wherever it runs. Every size runs in
a process of its own, whose greatest memory (resident set) is read at its end. Times are processor time, which other
programs on the machine hardly lengthen; the wall time stands beside the first.

The cost of an identification is that of its steps. With a ball bar, the more rows there are, the more steps it takes in
the directions that only the prior holds (the reading bends there, which Gauss-Newton leaves out), so that above 200,000
rows one step is timed, and the whole identification only with --all.

Recordings on disk are written as CSV first, in a process of their own: circles at 200 Hz, forth and back again and again. What
reads and identifies them is a process that does nothing else; its greatest memory counts.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from symfive.campaign import Campaign, Run, read_campaign, write_campaign
from symfive.effects import make_effect
from symfive.identify import identify
from symfive.inference import Problem
from symfive.machine import preset
from symfive.model import Model
from symfive.procedures import campaign_of, planar_circle, rotary_circle
from symfive.simulate import simulate
from symfive.threads import one_thread

ROWS = 24_000
FULL = (1_000, 10_000, 100_000, 1_000_000)
QUICK = (1_000, 5_000, 30_000)
MOST = 200_000
RATE_HZ = 50.0
SEED = 3
ON_DISK = (100_000, 1_000_000)
ON_DISK_QUICK = (30_000,)
VERY_LONG = 10_000_000
ON_DISK_HZ, REST_S = 200.0, 3.0


def plan_at(rate: float) -> Campaign:
    """Circles of the axis C and in the XY plane, both senses, at a rate in Hz."""
    machine = preset("table-bc")
    turns = rotary_circle(machine, axis="C", rate_hz=rate)
    circles = planar_circle(machine, plane="XY", feed=2000.0, rate_hz=rate)
    return campaign_of(machine, (*turns, *circles), name="benchmark")


def plan(rows: int) -> Campaign:
    """The same at a rate that gives about so many rows."""
    return plan_at(RATE_HZ * rows / plan_at(RATE_HZ).rows)


@one_thread
def one(rows: int, most: int = MOST) -> dict[str, float]:
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
    begin = time.process_time()
    problem = Problem.of(model)
    information = problem.information(problem.blocks(model.start))
    np.linalg.solve(information.matrix + np.diag(problem.prior_precision), information.gradient)
    entry = {
        "rows": measured.campaign.rows, "parameters": len(model.parameters), "build": build, "predict": predict,
        "slopes": slopes, "step": time.process_time() - begin,
    }  # fmt: skip
    if rows <= most:
        begin, wall = time.process_time(), time.perf_counter()
        result = identify(measured.campaign)
        entry |= {"identify": time.process_time() - begin, "wall": time.perf_counter() - wall, "chi2": result.chi2_dof}
    return entry | {"memory": _peak_mb() - begin_memory}


def record(rows: int, folder: Path) -> None:
    """Write a campaign of about so many rows, pass by pass: the axes rest between two, so that each reads like the first."""
    plan_ = plan_at(ON_DISK_HZ)
    turned = replace(plan_, runs=tuple(there_and_back(run) for run in plan_.runs))
    exact = simulate(turned, seed=SEED, noise=False).campaign
    write_campaign(exact, folder)
    generator = np.random.default_rng(SEED)
    for run in exact.runs:
        axes = [plan_.machine.axes[name] for name in plan_.machine.axis_names]
        with (folder / run.file).open("w", encoding="utf-8") as stream:
            stream.write(",".join(["t_s", *(axis.column for axis in axes), *run.readings]) + "\n")
            for number in range(max(1, round(rows / exact.rows))):
                time_ = run.time + number * (run.time[-1] + 1.0 / ON_DISK_HZ)
                read = [
                    values + run.noise("ball_bar") * generator.standard_normal(run.rows)
                    for values in run.readings.values()
                ]
                table = [time_, *(run.commands[axis.name] for axis in axes), *read]
                lines = zip(*(np.round(column, 6).tolist() for column in table), strict=True)
                stream.writelines(",".join(map(repr, line)) + "\n" for line in lines)


def there_and_back(run: Run) -> Run:
    """A run's programme and the same backwards, with rests at both ends."""
    rest = round(REST_S * ON_DISK_HZ)
    commands = {}
    for name, values in run.commands.items():
        still = np.concatenate([np.repeat(values[:1], rest), values, np.repeat(values[-1:], rest)])
        commands[name] = np.round(np.concatenate([still, still[::-1]]), 6)
    return replace(run, time=np.arange(len(commands["C"])) / ON_DISK_HZ, commands=commands)


def one_on_disk(folder: Path) -> dict[str, float]:
    """Read a campaign and identify it (s), and the memory that this took (MB)."""
    begin_memory, wall = _peak_mb(), time.perf_counter()
    begin = time.process_time()
    campaign = read_campaign(folder)
    read = time.process_time() - begin
    result = identify(campaign)
    return {
        "rows": campaign.rows, "file": sum(f.stat().st_size for f in folder.glob("*.csv")) / 1e6, "read": read,
        "identify": time.process_time() - begin - read, "wall": time.perf_counter() - wall,
        "chi2": result.chi2_dof, "begin": begin_memory, "memory": _peak_mb(),
    }  # fmt: skip


def on_disk(sizes: tuple[int, ...]) -> None:
    """Print the table of recordings on disk."""
    heads = ("CSV MB", "read s", "identify s", "wall s", "chi²/dof", "peak MB")
    print("recordings on disk, read and identified\n" + f"{'rows':>9}" + "".join(f"{head:>12}" for head in heads))
    table = []
    for size in sizes:
        with tempfile.TemporaryDirectory() as folder:
            _apart("--record", str(size), folder)
            entry = _apart("--on-disk", folder)
        table.append(entry)
        print(
            f"{entry['rows']:9.0f}{entry['file']:12.0f}{entry['read']:12.2f}{entry['identify']:12.1f}"
            f"{entry['wall']:12.1f}{entry['chi2']:12.4f}{entry['memory']:12.0f}",
            flush=True,
        )
    if len(table) > 1:
        last = _exponent([e["rows"] for e in table[-2:]], [e["memory"] for e in table[-2:]])
        print(
            f"growth of peak memory: rows^{last:.2f} over the last two; {table[-1]['begin']:.0f} MB before anything is read"
        )


class Sensitivities(NamedTuple):
    """Seconds for the exact ones and for central differences, and where the two differ most."""

    rows: int
    parameters: int
    exact: float
    differences: float
    largest: float
    where: str


def sensitivities(rows: int) -> Sensitivities:
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
    return Sensitivities(run.rows, len(line.columns), exact, differences, worst, name)


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


def _apart(*options: str) -> dict[str, float]:
    """What this script prints with these options, in a process of its own."""
    command = [sys.executable, str(Path(__file__).resolve()), *options]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


def _exponent(sizes: list[float], costs: list[float]) -> float:
    """Slope of log cost over log rows."""
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def report(sizes: tuple[int, ...], rows: int, *options: str) -> None:
    """Print the figures of one campaign, the growth with the rows and the sensitivities."""
    packages = ", ".join(f"{name} {_version(name)}" for name in ("casadi", "numpy", "scipy"))
    print(f"Python {platform.python_version()}, {packages}, {os.cpu_count()} cores")
    first = _apart("--one", str(rows))
    print(
        f"{first['rows']:.0f} rows, {first['parameters']:.0f} parameters: model built {first['build']:.2f} s, "
        f"identified {first['identify']:.2f} s (wall {first['wall']:.2f} s), chi²/dof {first['chi2']:.3f}"
    )
    growth(sizes, *options)
    s = sensitivities(rows)
    print(f"sensitivities of {s.rows} rows to {s.parameters} parameters")
    print(
        f"  exact {1e3 * s.exact:.1f} ms, central differences {1e3 * s.differences:.1f} ms: "
        f"{s.differences / s.exact:.0f} times faster"
    )
    print(f"  largest difference between the two {s.largest:.1e} of the largest entry ({s.where})")


def growth(sizes: tuple[int, ...], *options: str) -> tuple[list[dict[str, float]], dict[str, float]]:
    """Print the cost of every size; returns it, and the exponents over the last two sizes by name."""
    heads = ("build s", "predict s", "slopes s", "step s", "identify s", "memory MB")
    print(f"{'rows':>9}" + "".join(f"{head:>12}" for head in heads))
    table = []
    for size in sizes:
        entry = _apart("--one", str(size), *options)
        table.append(entry)
        fit = f"{entry['identify']:12.2f}" if "identify" in entry else f"{'-':>12}"
        print(
            f"{entry['rows']:9.0f}{entry['build']:12.2f}{entry['predict']:12.4f}{entry['slopes']:12.4f}"
            f"{entry['step']:12.3f}{fit}{entry['memory']:12.0f}",
            flush=True,
        )
    exponents = {}
    for name, label in (("predict", "prediction"), ("slopes", "sensitivities"), ("step", "one step"),
                        ("identify", "identification"), ("memory", "memory")):  # fmt: skip
        seen = [entry for entry in table if name in entry]
        whole = _exponent([e["rows"] for e in seen], [e[name] for e in seen])
        last = exponents[name] = _exponent([e["rows"] for e in seen[-2:]], [e[name] for e in seen[-2:]])
        print(f"growth of {label + ':':16} rows^{whole:.2f} over all sizes, rows^{last:.2f} over the last two")
    print(f"memory: {1e6 * table[-1]['memory'] / table[-1]['rows']:.0f} bytes a row")
    return table, exponents


def _version(name: str) -> str:
    from importlib.metadata import version

    return version(name)


def main(arguments: list[str] | None = None) -> int:
    """Parse the options and measure."""
    parser = argparse.ArgumentParser(description="Time, memory and exactness of model and identification.")
    parser.add_argument("--quick", action="store_true", help="small sizes, for a look")
    parser.add_argument("--all", action="store_true", help="the whole identification at every size")
    parser.add_argument("--one", type=int, metavar="ROWS", help="one size only, as JSON (used by the whole run)")
    parser.add_argument("--long", action="store_true", help="a recording of 10^7 rows on disk, too")
    parser.add_argument(
        "--record", nargs=2, metavar=("ROWS", "FOLDER"), help="write a recording (used by the whole run)"
    )
    parser.add_argument("--on-disk", metavar="FOLDER", help="identify a recording, as JSON (used by the whole run)")
    options = parser.parse_args(arguments)
    if options.record:
        record(int(options.record[0]), Path(options.record[1]))
        print("{}")
    elif options.on_disk:
        print(json.dumps(one_on_disk(Path(options.on_disk))))
    elif options.one:
        print(json.dumps(one(options.one, sys.maxsize if options.all else MOST)))
    else:
        more = ("--all",) if options.all else ()
        report(QUICK if options.quick else FULL, 5_000 if options.quick else ROWS, *more)
        on_disk((*(ON_DISK_QUICK if options.quick else ON_DISK), *((VERY_LONG,) if options.long else ())))
    return 0


if __name__ == "__main__":
    sys.exit(main())
