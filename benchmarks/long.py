"""What whole verbs take of a recording of any length: processor seconds and the greatest memory, each in a process of its own.

    python benchmarks/long.py 1e6                     # a recording of so many rows, half a minute
    python benchmarks/long.py 1e8 --folder /big       # 5.7 GB of CSV, and as much again in temporary files (TMPDIR)
    python benchmarks/long.py 1e6 --play 12           # X has a play of so many µm: `diagnose`, and what it says

Circles in XY of `table-bc` with a grid encoder at 200 Hz, both senses, forth and back again and again: eight columns, two of them
readings. Needs `symfive[history]` (PyArrow) to write the CSV in time.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from identify import ON_DISK_HZ, SEED, there_and_back

from symfive.campaign import Run, write_campaign
from symfive.effects import make_effect
from symfive.machine import preset
from symfive.procedures import campaign_of, planar_circle
from symfive.simulate import simulate

FEED = 2000.0
Verb = tuple[str, list[str]]
DIAGNOSIS: Verb = ("diagnose, figures and report", ["diagnose", "measured", "-o", "diagnosed", "-q"])
VERBS: tuple[Verb, ...] = (
    ("identify, figures and report", ["identify", "measured", "-o", "results", "-q"]),
    ("predict", ["predict", "results/model.json", "measured", "-o", "predicted", "-q"]),
    ("assess", ["assess", "measured", "-q"]),
)


def record(rows: int, folder: Path, play: float = 0.0) -> int:
    """Write a campaign of about so many rows, pass by pass; how many it has. X has a play of so many µm."""
    import pyarrow as pa
    from pyarrow import csv

    machine = preset("table-bc")
    circles = planar_circle(machine, plane="XY", feed=FEED, rate_hz=ON_DISK_HZ, instrument="grid_encoder")
    plan = campaign_of(machine, circles, name="long")
    plan = replace(plan, runs=tuple(_twice(there_and_back(run)) for run in plan.runs))
    effects, truth = ([make_effect("backlash", "X")], {"backlash.X.width": play}) if play else ([], {})
    exact = simulate(plan, truth=truth, effects=effects, seed=SEED, noise=False).campaign
    write_campaign(exact, folder)
    once = exact.rows // 2  # after the first pass all are like the second
    generator, passes = np.random.default_rng(SEED), max(1, round(rows / once))
    for run in exact.runs:
        count = run.rows // 2
        names = ["t_s", *(machine.axes[axis].column for axis in machine.axis_names), *run.readings]
        commands = [run.commands[axis] for axis in machine.axis_names]
        with csv.CSVWriter(
            str(folder / run.file), pa.schema([(name, pa.float64()) for name in names]),
            write_options=csv.WriteOptions(quoting_header="none"),
        ) as stream:  # fmt: skip
            for number in range(passes):
                part, noise = slice(min(number, 1) * count, (min(number, 1) + 1) * count), run.noise("grid_encoder")
                time = np.round((np.arange(count) + number * count) / ON_DISK_HZ, 6)
                read = [
                    np.round(values[part] + noise * generator.standard_normal(count), 3)
                    for values in run.readings.values()
                ]
                written = (time, *(command[part] for command in commands), *read)
                stream.write_table(pa.table([pa.array(np.asarray(c)) for c in written], names=names))
    return passes * once


def _twice(run: Run) -> Run:
    """The run's commands again without a stop."""
    commands = {axis: np.tile(way, 2) for axis, way in run.commands.items()}
    return replace(run, time=np.arange(2.0 * run.rows) / ON_DISK_HZ, commands=commands)


def spent(words: list[str], folder: Path) -> tuple[float, float]:
    """Processor seconds and greatest resident memory, MB, of a verb."""
    process = subprocess.Popen([sys.executable, "-m", "symfive", *words], cwd=folder, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"symfive {' '.join(words)} ended with {os.waitstatus_to_exitcode(status)}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e3


def main() -> None:
    """Parse the options and measure."""
    parser = argparse.ArgumentParser(description="Processor time and memory of whole verbs on a long recording.")
    parser.add_argument("rows", type=float)
    parser.add_argument("--play", type=float, default=0.0, help="of X, in µm: diagnosed as well")
    parser.add_argument("--folder", type=Path, help="where there is room, 200 bytes a row")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        rows = record(int(options.rows), folder / "measured", options.play)
        print(f"{rows} rows\n\n| verb | s | MB |\n| --- | --- | --- |")
        for what, words in (DIAGNOSIS,) if options.play else VERBS:
            seconds, memory = spent(words, folder)
            print(f"| {what} | {seconds:.1f} | {memory:.0f} |", flush=True)
        if options.play:
            print(f"\n{json.loads((folder / 'diagnosed' / 'diagnosis.json').read_text())['says']}")


if __name__ == "__main__":
    main()
