"""One table of ratios: symfive, its peers and the limits of the computer, each pair measured in one run.

    .venv/bin/python benchmarks/table.py [--quick] [--peers PYTHON] [SECTION ...]

`--peers` names a Python with the extra `bench` (`pip install symfive[bench]`, or the peers alone in an environment of their
own); by default the one that runs this. A peer that is not there stands in the table as skipped, with the reason. The table
goes to the standard output, what the single benchmarks print to the standard error. Every section runs in a process of
its own; times are processor time, and least of several where not said otherwise.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from datetime import date
from importlib.metadata import version
from pathlib import Path

from rows import Row, design_rows, diagnosis_rows, growth_rows, identification_rows, jacobian_rows, table

OWN = ("casadi", "numpy", "scipy")
PEERS = ("pin", "jax", "figaroh", "pydex", "pysindy")
TIMEOUT_S = 1800.0


def jacobian(quick: bool, python: str) -> list[Row]:
    """Jacobian evaluation against limits and peers."""
    from codegen import compared

    with tempfile.TemporaryDirectory() as name:
        return jacobian_rows(compared(Path(name), python, quick))


def design(quick: bool, python: str) -> list[Row]:
    """Choice and refinement of poses against peers."""
    from design import chain, speed

    return design_rows(speed(quick, python), chain()[0].width)


def identification(quick: bool, python: str) -> list[Row]:
    """Identification against finite differences."""
    from identify import sensitivities
    from least_squares import ROWS, ROWS_QUICK, compare

    seconds, rows, parameters, fits = compare(ROWS_QUICK if quick else ROWS)
    exact = sensitivities(5_000 if quick else 24_000)._asdict()
    told = {method: asdict(fit) for method, fit in fits.items()}
    return identification_rows(
        {"seconds": seconds, "rows": rows, "parameters": parameters, "fits": told, "sensitivities": exact}
    )


def growth(quick: bool, python: str) -> list[Row]:
    """Growth of cost with rows, poses, parameters and catalogue."""
    import growth as measure
    from identify import FULL, QUICK
    from identify import growth as by_rows

    return growth_rows({
        "rows": by_rows(QUICK if quick else FULL)[0],
        "poses": measure.poses(measure.STEPS_DEG_QUICK if quick else measure.STEPS_DEG),
        "parameters": measure.parameters(measure.ORDERS_QUICK if quick else measure.ORDERS),
        "effects": measure.effects(measure.EVERY_QUICK if quick else measure.EVERY),
    })  # fmt: skip


def diagnosis(quick: bool, python: str) -> list[Row]:
    """Names and time against simple rivals."""
    from diagnosis import campaigns, compete

    chosen = campaigns(quick)
    return diagnosis_rows({name: asdict(tally) for name, tally in compete(chosen, python).items()}, len(chosen))


SECTIONS: dict[str, Callable[[bool, str], list[Row]]] = {
    f.__name__: f for f in (jacobian, design, identification, diagnosis, growth)
}


def measured(section: str, quick: bool, python: str) -> list[Row]:
    """A section's rows, from a process of its own; one row with the reason if that fails."""
    command = [sys.executable, str(Path(__file__).resolve()), "--one", section, "--peers", python]
    command += ["--quick"] if quick else []
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            command, stdout=subprocess.PIPE, text=True, env=environment, timeout=TIMEOUT_S, check=True
        )
    except subprocess.CalledProcessError as error:
        return [Row(section, f"failed with exit code {error.returncode}", ahead=False, why="see the standard error")]
    except subprocess.TimeoutExpired:
        return [Row(section, f"not done after {TIMEOUT_S:.0f} s", ahead=False, why="see the standard error")]
    return [Row(**row) for row in json.loads(done.stdout.splitlines()[-1])]


def about(python: str) -> str:
    """Machine, versions, date."""
    cpu = platform.processor() or platform.machine()
    with contextlib.suppress(OSError, StopIteration):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        cpu = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    load = f", load {os.getloadavg()[0]:.1f} at the start" if hasattr(os, "getloadavg") else ""
    own = ", ".join(f"{name} {version(name)}" for name in OWN)
    peers = ", ".join(f"{name} {found or 'not installed'}" for name, found in peer_versions(python).items())
    return f"{cpu}, {os.cpu_count()} cores{load}; Python {platform.python_version()}, {own}; peers: {peers}; {date.today()}."


def peer_versions(python: str) -> dict[str, str]:
    """Version of every peer that this Python has, empty for the others."""
    code = (
        "import json\nfrom importlib.metadata import version, PackageNotFoundError\nfound = {}\n"
        f"for name in {PEERS}:\n    try: found[name] = version(name)\n    except PackageNotFoundError: found[name] = ''\n"
        "print(json.dumps(found))"
    )
    done = subprocess.run([python, "-c", code], capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


def main(arguments: list[str] | None = None) -> int:
    """Parse the options, measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=f"only these: {', '.join(SECTIONS)}")
    parser.add_argument("--quick", action="store_true", help="small sizes, fewer repetitions, for a look")
    parser.add_argument("--peers", metavar="PYTHON", default=sys.executable, help="a Python that has the peers")
    parser.add_argument("--one", choices=SECTIONS, help="one section in this process, as JSON (used by the whole run)")
    options = parser.parse_args(arguments)
    if unknown := set(options.sections) - set(SECTIONS):
        parser.error(f"unknown section: {', '.join(sorted(unknown))}")
    if options.one:
        with contextlib.redirect_stdout(sys.stderr):
            rows = SECTIONS[options.one](options.quick, options.peers)
        print(json.dumps([asdict(row) for row in rows]))
        return 0
    heading = about(options.peers)  # the load before we are part of it
    rows = [row for name in options.sections or SECTIONS for row in measured(name, options.quick, options.peers)]
    print(table(rows, heading))
    return 0


if __name__ == "__main__":
    sys.exit(main())
