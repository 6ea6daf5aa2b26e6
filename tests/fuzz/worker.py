"""One reader under atheris for some seconds, started by `tests.fuzz`: `-m tests.fuzz.worker READER SECONDS FOLDER ROOM`."""

import random
import sys
import traceback
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["symfive", "tomllib"]):
    from .checks import LONGEST_S, run
    from .corpus import KEPT, OPEN, inputs, name_of
    from .mutate import Mutator
    from .nested import of_values
    from .readers import READERS

MOST_BYTES = 8000


def place(error: BaseException) -> str:
    """What tells one fault from another: the exception and the last lines of symfive and of the checks that it passed."""
    frames = [
        f for f in traceback.extract_tb(error.__traceback__) if "/symfive/" in f.filename or "/fuzz/" in f.filename
    ]
    last = " < ".join(f"{Path(f.filename).name}:{f.name}:{f.lineno}" for f in reversed(frames[-2:]))
    return f"{type(error).__name__} {last}"


def main() -> None:
    """Fuzz; faults are written to FOLDER/faults under the reader's name, each kind once, and the search goes on."""
    name, seconds, folder = sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])
    reader = READERS[name]
    corpus, faults = folder / name, folder / "faults"
    corpus.mkdir(parents=True, exist_ok=True)
    faults.mkdir(exist_ok=True)
    seeds = [*reader.seeds(), *(p.read_bytes() for place in (KEPT, OPEN) for p in inputs(place / name))]
    for seed in seeds:
        (corpus / name_of(seed)).write_bytes(seed)
    mutator = Mutator(reader.words, [*seeds, *(word.encode() + b"\n" for word in reader.words)])
    known: set[str] = set()
    room = Path(sys.argv[4])

    def one(data: bytes) -> None:
        try:
            run(reader, data, room)
        except Exception as error:
            kind = place(error)
            if kind not in known:
                known.add(kind)
                stem = faults / f"{name}-{name_of(kind.encode())[:8]}"
                if not stem.with_suffix(".txt").exists():
                    stem.with_suffix(".txt").write_bytes(data)
                    stem.with_suffix(".log").write_text(f"{kind}\n{''.join(traceback.format_exception(error))}")
                    print(f"FAULT {name}: {kind}: {str(error)[:300]}", flush=True)

    def mutated(data: bytes, most: int, seed: int) -> bytes:
        if seed % 8 == 0:
            return bytes(atheris.Mutate(data, most))
        changed = of_values(data, random.Random(seed)) if seed % 8 < 4 else None
        return (mutator(data, seed) if changed is None else changed)[:most]

    options = [
        f"-max_total_time={seconds}", f"-max_len={MOST_BYTES}", f"-timeout={int(4 * LONGEST_S)}", "-rss_limit_mb=3000",
        f"-artifact_prefix={faults}/{name}-", "-print_final_stats=1", "-verbosity=1", "-reload=0",
    ]  # fmt: skip
    atheris.Setup([sys.argv[0], *options, str(corpus)], one, custom_mutator=mutated)
    atheris.Fuzz()


main()
