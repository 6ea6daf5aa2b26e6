"""`python -m examples.blind_study --cases N --seed S --workers W -o DIR`: seal all answers, judge, open, score, write.

`--scheduler ADDRESS` takes the workers of a Dask scheduler instead; they are started in the repository and see DIR, too.

Killed anywhere, the same command goes on where it was: every finished stage of a case is a file. `--only STRATUM` and
`--case ID` run a part, `--redo` judges anew with the present code, `--ablation` repeats every case of one effect with
that effect taken out of the catalogue, `--recorded` every case without one with the noise of real instruments (where their
recordings are at hand, docs/recordings.md), `--rivals` runs the simple rivals on the same recordings (`--peers PYTHON`: PySINDy,
too, from an environment that has it).
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from symfive.convert import data_folder
from symfive.executors import executor, finished

from . import stages
from .cases import STRATA, case_ids
from .controls import controls
from .frozen import FROZEN, frozen_ids
from .rivals import lines
from .score import Row, score
from .store import Store
from .write import write

REPORTS = 10
"""Interim results so many times."""
SINGLE = ("visible", "masked", "instrument")


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m examples.blind_study", description=__doc__)
    parser.add_argument("--cases", type=int, default=420, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="S")
    parser.add_argument("--workers", type=int, default=1, metavar="W", help="processes of one thread each; 0: none")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a Dask scheduler instead, as tcp://host:8786")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    for stratum in FROZEN:
        words = f"also so many cases of the frozen stratum {stratum}"
        parser.add_argument(f"--{stratum}", type=int, default=0, metavar="N", help=words)
    parser.add_argument(
        "--only", action="append", choices=tuple(STRATA), metavar="STRATUM", help="this stratum (repeat)"
    )
    parser.add_argument("--case", action="append", metavar="ID", help="this case, as visible-003 (repeat)")
    parser.add_argument("--redo", action="store_true", help="judge anew what has a verdict already")
    parser.add_argument("--ablation", action="store_true", help="also without the true effect in the catalogue")
    parser.add_argument("--recorded", action="store_true", help="also with the noise of real instruments")
    parser.add_argument("--report", action="store_true", help="only write the results of what is finished")
    parser.add_argument("--rivals", action="store_true", help="also the simple rivals")
    parser.add_argument("--peers", metavar="PYTHON", help="a Python that has pysindy, for the rivals")
    return parser.parse_args(arguments)


def chosen(options: argparse.Namespace) -> list[str]:
    """Names of the cases to run."""
    if options.case:
        return list(options.case)
    ids = case_ids(options.cases)
    kept = [i for i in ids if not options.only or i.rsplit("-", 1)[0] in options.only]
    return kept + [i for stratum in FROZEN for i in frozen_ids(stratum, getattr(options, stratum))]


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the study; 0 if every case has a verdict."""
    options = parse(arguments)
    root, ids = options.output.resolve(), chosen(options)
    if options.recorded:
        data_folder()
    root.mkdir(parents=True, exist_ok=True)
    store = Store(root)
    if options.redo:
        _forget(root, ids)
    errors: dict[str, str] = {}
    rows: dict[str, Row] = {}
    if options.report:
        report(store, ids, options.seed, errors, rows)
        return 0
    with executor(options.workers, options.scheduler, fresh=True) as pool:
        _say(f"sealing {len(ids)} cases")
        sealing = run(pool, stages.seal, [(root, options.seed, i) for i in ids if not store.has("seals", i)])
        errors |= {id: error for id, error in sealing if error}
        tasks: dict[Callable[..., None], list[tuple[Any, ...]]] = {stages.verdict: [(root, i) for i in ids]}
        if options.ablation:
            tasks[stages.control] = [(root, i) for i in ids if i.rsplit("-", 1)[0] in SINGLE]
        if options.recorded:
            tasks[stages.recorded] = [(root, options.seed, i) for i in ids if i.startswith("none-")]
        if options.rivals:
            tasks[stages.rivals] = [(root, options.peers, i) for i in ids]
        for stage, todo in tasks.items():
            for count, (id, error) in enumerate(run(pool, stage, todo), start=1):
                if error:
                    errors[id] = error
                _say(f"{stage.__name__} {count} of {len(todo)}: {id}{' ended in an error' if error else ''}")
                if count % max(3, len(todo) // REPORTS) == 0 or count == len(todo):
                    report(store, ids, options.seed, errors, rows)
    return int(bool(errors))


def run(pool: Executor, stage: Callable[..., None], tasks: Sequence[tuple[Any, ...]]) -> Iterator[tuple[str, str]]:
    """Case and error (empty if none) as the tasks end; the last argument of a task is its case."""
    for number, outcome in finished(pool, stage, tasks):
        error = "".join(traceback.format_exception(outcome)) if isinstance(outcome, Exception) else ""
        yield tasks[number][-1], error


def report(store: Store, ids: Sequence[str], seed: int, errors: dict[str, str], rows: dict[str, Row]) -> None:
    """Opens the answers of cases that have finished since, scores them into `rows` and writes the results."""
    for id in ids:
        if id not in rows and store.has("again", id):
            rows[id] = score(
                store.open(id), store.get("verdicts", id), store.get("oracles", id), store.get("again", id)
            )
    done = list(rows)
    write(store.root, list(rows.values()), seed, len(ids), errors, [*controls(store, done), *lines(store, done)])


def _forget(root: Path, ids: Iterable[str]) -> None:
    for id in ids:
        for stage in ("verdicts", "oracles", "again", "controls", "recorded"):
            (root / stage / f"{id}.json").unlink(missing_ok=True)
        for folder in ("next", "measured"):
            shutil.rmtree(root / folder / id, ignore_errors=True)


def _say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
