"""Do the 95 % intervals hold the truth in 95 of 100 cases, under noise as it is?

    python benchmarks/intervals.py                     # 200 machines of each topology and noise: 4,000 identifications
    python benchmarks/intervals.py --machines 2000 --keep found.json    # more; after a break it goes on from the file
    python benchmarks/intervals.py --quick             # 10
    python benchmarks/intervals.py --workers 2, or --scheduler tcp://host:8786    # the same numbers, sooner

Each machine is drawn from the priors of its machine file and measured in simulation: one by an R-test at rest, the next by
circles with a ball bar. The noise is not what the campaign declares (`spoilt`). Counted are the machine's parameters about which
the readings say more than the prior (1σ less than half of the prior's): the intervals of the others hold the truth by the prior
alone.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign
from symfive.executors import executor, finished
from symfive.identify import identify
from symfive.machine import preset
from symfive.procedures import campaign_of, planar_circle, r_test_grid, rotary_circle
from symfive.simulate import simulate

Array = NDArray[np.float64]
TOPOLOGIES = ("table-bc", "tsutsumi-2007", "mixed-bc", "head-bc", "nutating-table")
MACHINES, QUICK, BATCH = 200, 10, 10
SHARE = 0.02
"""Of the readings are outliers."""
SLOW, ROWS = 1.5, 20.0
"""Size of the coloured part over the declared noise, and the rows over which it decays to 1/e."""
KNOWN = 0.5


def _coloured(rows: int, rng: np.random.Generator) -> Array:
    decay = np.exp(-1.0 / ROWS)
    found = SLOW * rng.standard_normal(rows)
    for row in range(1, rows):
        found[row] = decay * found[row - 1] + np.sqrt(1.0 - decay**2) * found[row]
    return found


def _ten_times(rows: int, rng: np.random.Generator) -> Array:
    return (rng.random(rows) < SHARE) * 10.0 * rng.standard_normal(rows)


def _six_sigma(rows: int, rng: np.random.Generator) -> Array:
    return (rng.random(rows) < SHARE) * 6.0 * rng.choice([-1.0, 1.0], rows)


NOISES: dict[str, tuple[str, Callable[[int, np.random.Generator], Array]]] = {
    "white": ("as declared", lambda rows, rng: np.zeros(rows)),
    "coloured": (f"and a Gauss-Markov part {SLOW:g} times as large over {ROWS:g} rows", _coloured),
    "outlying, 10 times": (f"in {SHARE:.0%} of the readings ten times as much (Tukey 1960)", _ten_times),
    "outlying, 6 sigma": (f"{SHARE:.0%} of the readings off by 6 sigma, about as much as can be seen", _six_sigma),
}
"""What comes on top of the declared white noise, in its 1σ, per reading column."""


def plan(topology: str, recorded: bool) -> Campaign:
    """An R-test grid, or circles in XY and about each rotary axis."""
    machine = preset(topology)
    if not recorded:
        return campaign_of(machine, r_test_grid(machine, step_deg=60.0))
    runs = list(planar_circle(machine, radius=100.0, feed=3000.0, rate_hz=12.5))
    for name, axis in machine.axes.items():
        if axis.rotary:
            runs += rotary_circle(machine, axis=name, direction="ccw", rate_hz=8.0)
    return campaign_of(machine, runs)


def spoilt(campaign: Campaign, noise: str, seed: int) -> Campaign:
    """The campaign with a noise of `NOISES` on top of the declared one."""
    rng, runs = np.random.default_rng([seed, 77]), []
    for run in campaign.runs:
        sigma = run.noise(run.instrument[0])
        more = {name: values + sigma * NOISES[noise][1](run.rows, rng) for name, values in run.readings.items()}
        runs.append(run.with_readings(more))
    return replace(campaign, runs=tuple(runs))


def covered(topology: str, noise: str, first: int, count: int) -> list[tuple[int, int]]:
    """Of every machine from seed `first` on: intervals that hold the truth, and intervals."""
    plans = [plan(topology, recorded) for recorded in (False, True)]
    found = []
    for seed in range(first, first + count):
        measured = simulate(plans[seed % 2], seed=seed)
        result = identify(spoilt(measured.campaign, noise, seed))
        hits = trials = 0
        for parameter in result.parameters:
            name = parameter.name
            if parameter.kind != "setup" and result.uncertainty(name) < KNOWN * parameter.sigma:
                low, high = result.interval(name)
                hits += low <= measured.truth[name] <= high
                trials += 1
        found.append((hits, trials))
    return found


def share(found: list[tuple[int, int]]) -> tuple[float, float]:
    """Share of intervals that hold the truth and its 1σ in %, from the scatter between machines (whose intervals go together)."""
    hits, trials = np.array(found, dtype=float).T
    mean = hits.sum() / trials.sum()
    return 100.0 * mean, 100.0 * float(np.sqrt(np.sum((hits - mean * trials) ** 2)) / trials.sum())


def main(arguments: list[str] | None = None) -> int:
    """Parse the options and measure."""
    parser = argparse.ArgumentParser(description="Coverage of the 95 % intervals under noise as it is.")
    parser.add_argument("--machines", type=int, default=MACHINES, help="of each topology and noise")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} machines")
    parser.add_argument("--workers", type=int, default=0, help="processes; 0: none but this one")
    parser.add_argument("--scheduler", help="a Dask scheduler instead, as tcp://host:8786")
    parser.add_argument("--keep", type=Path, help="a file of what was found, to go on from")
    options = parser.parse_args(arguments)
    machines = QUICK if options.quick else options.machines
    for noise, (words, _) in NOISES.items():
        print(f"{noise}: {words}")
    print(f"{machines} machines each; intervals that hold the truth, % ± 1σ\n")
    print("| topology |" + "".join(f" {noise} |" for noise in NOISES) + "\n" + "| --- " * (1 + len(NOISES)) + "|")
    known = Kept(options.keep)
    with executor(options.workers, options.scheduler) as pool:
        for topology in TOPOLOGIES:
            for noise in NOISES:
                spans = [(first, min(BATCH, machines - first)) for first in range(0, machines, BATCH)]
                tasks = [task for span in spans if (task := (topology, noise, *span)) not in known]
                for number, outcome in finished(pool, covered, tasks):
                    if isinstance(outcome, Exception):
                        raise outcome
                    known.add(tasks[number], outcome)
            cells = [_words(known.of(topology, noise, machines)) for noise in NOISES]
            print(f"| `{topology}` |" + "".join(f" {words} |" for words in cells), flush=True)
    every = [[pair for topology in TOPOLOGIES for pair in known.of(topology, noise, machines)] for noise in NOISES]
    print("| all |" + "".join(f" {_words(found)} |" for found in every))
    return 0


Task = tuple[str, str, int, int]


class Kept:
    """What was found of every task, in memory and, with a `path`, one line each in a file."""

    def __init__(self, path: Path | None) -> None:
        self._path, self._found = path, dict[Task, list[tuple[int, int]]]()
        for line in path.read_text().splitlines() if path is not None and path.exists() else ():
            task, found = json.loads(line)
            self._found[tuple(task)] = [tuple(pair) for pair in found]

    def __contains__(self, task: Task) -> bool:
        return task in self._found

    def add(self, task: Task, found: list[tuple[int, int]]) -> None:
        """Remember what was found of a task."""
        self._found[task] = found
        if self._path is not None:
            with self._path.open("a") as file:
                file.write(json.dumps([task, found]) + "\n")

    def of(self, topology: str, noise: str, machines: int) -> list[tuple[int, int]]:
        """Hits and trials of the machines of a cell."""
        tasks = [task for task in self._found if task[:2] == (topology, noise) and task[2] < machines]
        return [pair for task in sorted(tasks) for pair in self._found[task]]


def _words(found: list[tuple[int, int]]) -> str:
    mean, sigma = share(found)
    return f"{mean:.1f} ± {sigma:.1f}"


if __name__ == "__main__":
    sys.exit(main())
