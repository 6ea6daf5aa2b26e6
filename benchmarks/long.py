"""What whole verbs take of a recording of any length: processor seconds and the greatest memory, each in a process of its own.

    python benchmarks/long.py 1e6                     # a recording of so many rows, half a minute
    python benchmarks/long.py 1e8 --folder /big       # 5.7 GB of CSV, and as much again in temporary files (TMPDIR)

Circles in XY of `table-bc` with a grid encoder at 200 Hz, both senses, forth and back again and again: eight columns, two of them
readings. Needs `symfive[history]` (PyArrow) to write the CSV in time.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from identify import ON_DISK_HZ, SEED, there_and_back

from symfive.campaign import write_campaign
from symfive.machine import preset
from symfive.procedures import campaign_of, planar_circle
from symfive.simulate import simulate

FEED = 2000.0
VERBS = (
    ("identify, figures and report", ["identify", "measured", "-o", "results", "-q"]),
    ("predict", ["predict", "results/model.json", "measured", "-o", "predicted", "-q"]),
    ("assess", ["assess", "measured", "-q"]),
)


def record(rows: int, folder: Path) -> int:
    """Write a campaign of about so many rows, pass by pass; how many it has."""
    import pyarrow as pa
    from pyarrow import csv

    machine = preset("table-bc")
    circles = planar_circle(machine, plane="XY", feed=FEED, rate_hz=ON_DISK_HZ, instrument="grid_encoder")
    plan = campaign_of(machine, circles, name="long")
    plan = replace(plan, runs=tuple(there_and_back(run) for run in plan.runs))
    exact = simulate(plan, seed=SEED, noise=False).campaign
    write_campaign(exact, folder)
    generator, passes = np.random.default_rng(SEED), max(1, round(rows / exact.rows))
    for run in exact.runs:
        names = ["t_s", *(machine.axes[axis].column for axis in machine.axis_names), *run.readings]
        commands = [run.commands[axis] for axis in machine.axis_names]
        with csv.CSVWriter(
            str(folder / run.file), pa.schema([(name, pa.float64()) for name in names]),
            write_options=csv.WriteOptions(quoting_header="none"),
        ) as stream:  # fmt: skip
            for number in range(passes):
                time = np.round(run.time + number * (run.time[-1] + 1.0 / ON_DISK_HZ), 6)
                noise = run.noise("grid_encoder")
                read = [
                    np.round(values + noise * generator.standard_normal(run.rows), 3)
                    for values in run.readings.values()
                ]
                stream.write_table(pa.table([pa.array(np.asarray(c)) for c in (time, *commands, *read)], names=names))
    return passes * exact.rows


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
    parser.add_argument("--folder", type=Path, help="where there is room, 200 bytes a row")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        rows = record(int(options.rows), folder / "measured")
        print(f"{rows} rows\n\n| verb | s | MB |\n| --- | --- | --- |")
        for what, words in VERBS:
            seconds, memory = spent(words, folder)
            print(f"| {what} | {seconds:.1f} | {memory:.0f} |", flush=True)


if __name__ == "__main__":
    main()
