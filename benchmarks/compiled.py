"""What it brings symfive to compile its own functions: the same work interpreted, compiled on the way, and found on disk.

    .venv/bin/python benchmarks/compiled.py [--quick] [CASE ...]

Every entry is processor time (s), the compiler's included, of a process of its own, without the start of Python and the making
of the campaign; a process of each kind in turn, the least of the turns. `cold` begins with an empty cache, `second` with what
`cold` has left, `later` with all that so many runs of the same have come to compile. The last column says whether all of them
gave the same results to the last bit.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from identify import SEED, plan

import symfive as sf
from symfive.compiled import _mapped, status
from symfive.design import make_space
from symfive.design._candidates import pose_grid, setup_options
from symfive.inference import Problem
from symfive.model import Model

ROOT = Path(__file__).resolve().parent.parent
BACKLASH = ROOT / "tests" / "data" / "campaigns" / "dynamic-backlash" / "fit"
Work = Callable[[], Iterable[Any]]


def identification(rows: int) -> Work:
    """The whole identification of ball-bar circles."""
    campaign = sf.simulate(plan(rows), seed=SEED).campaign

    def work() -> Iterable[Any]:
        result = sf.identify(campaign)
        return result.values, result.covariance

    return work


def step(rows: int) -> Work:
    """One Gauss-Newton step, the building of the model included."""
    campaign = sf.simulate(plan(rows), seed=SEED).campaign

    def work() -> Iterable[Any]:
        model = Model(campaign)
        problem = Problem.of(model)
        information = problem.information(problem.blocks(model.start))
        return information.matrix, information.gradient

    return work


def candidates(instrument: str, times: int) -> Work:
    """Sensitivities and limits of 1200 candidate rows, so many times."""
    space = make_space(sf.preset("table-bc"), instrument)
    setups, lengths = setup_options(space)
    poses = pose_grid(space, 1200)
    z = np.concatenate([poses, np.resize(setups, (len(poses), setups.shape[1]))], axis=1)
    k = np.resize(lengths, (len(poses), 1))

    def work() -> Iterable[Any]:
        for _ in range(times):
            found = space.kernel.rows(z, k), space.kernel.limits(z, k)
        return found

    return work


def whole_plan(instrument: str) -> Work:
    """A whole plan of 40 poses."""

    def work() -> Iterable[Any]:
        made = sf.plan(sf.preset("table-bc"), instrument=instrument)
        return [value for run in made.campaign.runs for value in run.commands.values()]

    return work


def diagnosis() -> Work:
    """The diagnosis of a recorded ball bar with a backlash."""
    campaign = sf.read_campaign(BACKLASH)

    def work() -> Iterable[Any]:
        return [np.frombuffer(str(sf.diagnose(campaign)).encode(), dtype=np.uint8)]

    return work


CASES: dict[str, tuple[str, Callable[[], Work], int]] = {
    "identify": ("24 000 rows of a ball bar identified", lambda: identification(24_000), 3),
    "step-1e5": ("one Gauss-Newton step over 10^5 rows", lambda: step(100_000), 2),
    "step-1e6": ("one Gauss-Newton step over 10^6 rows", lambda: step(1_000_000), 1),
    "candidates": ("1200 candidates of an R-test evaluated once", lambda: candidates("r_test", 1), 3),
    "candidates-bar": ("1200 candidates of a ball bar, a hundred times", lambda: candidates("ball_bar", 100), 3),
    "plan": ("plan of an R-test, 40 poses", lambda: whole_plan("r_test"), 1),
    "plan-bar": ("plan with a ball bar, 40 poses", lambda: whole_plan("ball_bar"), 1),
    "diagnose": ("diagnosis of dynamic-backlash", diagnosis, 2),
}


def one(name: str, everything: bool) -> None:
    """A case in this process: seconds, a digest of its results, libraries compiled and loaded, as JSON. `everything` is
    compiled that is worth a look."""
    if everything:
        _mapped.COMPILED_S = _mapped.COMPILED_OPERATION_S = 0.0
    work = CASES[name][1]()
    before = _seconds()
    results = work()
    spent = _seconds() - before
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in results)).hexdigest()
    told = status()
    print(json.dumps([spent, digest, told.compiled, told.loaded]))


def _seconds() -> float:
    """Processor time of this process and of the compilers that it has called."""
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


def apart(name: str, cache: str, compiler: str | None, *more: str) -> tuple[float, str, int, int]:
    """A case in a process of its own."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "XDG_CACHE_HOME": cache}
    environment |= {"MPLCONFIGDIR": cache}
    environment.pop("SYMFIVE_COMPILER", None)
    if compiler:
        environment["SYMFIVE_COMPILER"] = compiler
    command = [sys.executable, str(Path(__file__).resolve()), "--one", name, *more]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    seconds, digest, compiled, loaded = json.loads(done.stdout.splitlines()[-1])
    return seconds, digest, compiled, loaded


def main() -> None:
    """Parse the options and measure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--quick", action="store_true", help="one turn each, without 10^6 rows")
    parser.add_argument("--one", choices=CASES, help="one case in this process, as JSON (used by the whole run)")
    parser.add_argument("--everything", action="store_true", help="compile all (used by the whole run)")
    options = parser.parse_args()
    if options.one:
        return one(options.one, options.everything)
    print(f"{'':50}{'interpreted':>12}{'cold':>9}{'second':>9}{'later':>9}  compiled, loaded, later")
    for name in options.cases or [name for name in CASES if not (options.quick and name == "step-1e6")]:
        text, _, turns = CASES[name]
        found: list[list[tuple[float, str, int, int]]] = [[], [], [], []]
        for _ in range(1 if options.quick else turns):
            with tempfile.TemporaryDirectory() as cache:
                for times, compiler in zip(found, ("none", None, None), strict=False):
                    times.append(apart(name, cache, compiler))
                apart(name, cache, None, "--everything")
                found[3].append(apart(name, cache, None))
        least = [min(entry[0] for entry in times) for times in found]
        equal = "same bits" if len({entry[1] for times in found for entry in times}) == 1 else "DIFFERENT"
        counts = f"{found[1][0][2]}, {found[2][0][3]}, {found[3][0][3]}"
        print(
            f"{text:50}{least[0]:12.4f}{least[1]:9.4f}{least[2]:9.4f}{least[3]:9.4f}  {counts:12} {equal}", flush=True
        )
    return None


if __name__ == "__main__":
    main()
