"""The command line of the fuzzer: `python -m tests.fuzz --minutes 60 -o build/fuzz`, and again to go on."""

import argparse
import re
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

from .corpus import inputs, keep
from .readers import READERS
from .seeds import ROOT


def fuzz(names: list[str], seconds: float, folder: Path, room: Path) -> None:
    """Give every reader its share of the time; files to be read lie in `room`.

    A hang or a lack of memory ends a worker; another goes on in its place.
    """
    for name in names:
        end, executions, starts = time.monotonic() + seconds / len(names), 0, 0
        while (left := int(end - time.monotonic())) > 0 and starts < 20:
            command = [sys.executable, "-m", "tests.fuzz.worker", name, str(left), str(folder.resolve()), str(room)]
            answer = subprocess.run(command, cwd=ROOT, text=True, capture_output=True)
            starts += 1
            executions += sum(map(int, re.findall(r"number_of_executed_units: (\d+)", answer.stderr)))
            for line in answer.stdout.splitlines():
                if line.startswith("FAULT "):  # LAPACK writes there, too
                    print(line, flush=True)
            if answer.returncode:
                print(f"{name}: the worker ended with {answer.returncode}: {answer.stderr[-500:]}", flush=True)
        line = f"{name}: {executions} executions, {len(list(inputs(folder / name)))} inputs in the corpus"
        print(line, flush=True)
        with (folder / "log.txt").open("a") as log:
            log.write(f"{time.strftime('%Y-%m-%d %H:%M')} {line}\n")


def main() -> int:
    """Run it; 1 where faults lie in CORPUS/faults."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="Coverage-guided fuzzing of the readers.")
    parser.add_argument("--minutes", type=float, default=10.0, help="of all readers together; 0: none, only --keep")
    parser.add_argument("--reader", default="all", help=f"all, or some of {','.join(READERS)}")
    parser.add_argument("-o", dest="corpus", type=Path, default=Path("build/fuzz"), help="where the inputs found go")
    parser.add_argument("--keep", action="store_true", help="then minimise it into tests/fuzz/corpus")
    arguments = parser.parse_args()
    names = list(READERS) if arguments.reader == "all" else arguments.reader.split(",")
    unknown = [name for name in names if name not in READERS]
    if unknown:
        parser.error(f"there is no reader {', '.join(unknown)}; use {', '.join(READERS)}")
    if arguments.minutes > 0.0 and find_spec("atheris") is None:
        parser.error("atheris is not installed; pip install -e .[fuzz] (docs/dependencies.md), or --minutes 0 --keep")
    arguments.corpus.mkdir(parents=True, exist_ok=True)
    shared = "/dev/shm" if Path("/dev/shm").is_dir() else None  # in memory: every input becomes files
    with tempfile.TemporaryDirectory(prefix="symfive-fuzz.", dir=shared) as temporary:
        room = Path(temporary) / "room"
        if arguments.minutes > 0.0:
            fuzz(names, 60.0 * arguments.minutes, arguments.corpus, room)
        for name in names if arguments.keep else ():
            count, lines = keep(name, READERS[name], inputs(arguments.corpus / name), room)
            print(f"{name}: {count} inputs kept, they reach {lines} lines of symfive", flush=True)
    faults = sorted((arguments.corpus / "faults").glob("*"))
    if faults:
        print(f"{len(faults)} files in {arguments.corpus / 'faults'}", flush=True)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
