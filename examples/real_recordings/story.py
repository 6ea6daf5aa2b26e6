"""All recordings, one after the other: `python -m examples.real_recordings -o RESULTS [--only NAME]`."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from symfive.convert import convert
from symfive.errors import InputError
from symfive.outputs import write_json

from . import figures
from .recordings import RECORDINGS, Recording
from .study import Study, named, study
from .words import left_by, page, shown_unit, to_data


def write(studies: Sequence[Study], absent: Sequence[str], folder: Path) -> None:
    """`recordings.md`, `recordings.json` and `figures/*.png` in the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [figures.save(figures.drawing(s), folder / "figures", s.recording.name) for s in studies]
    (folder / "recordings.md").write_text(page(studies, files, absent), encoding="utf-8")
    write_json(folder / "recordings.json", {"recordings": [to_data(s) for s in studies], "absent": list(absent)})


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the story; 0 if at least one recording was there."""
    parser = argparse.ArgumentParser(prog="python -m examples.real_recordings", description=__doc__)
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("real-recordings-results"), help="folder for the results"
    )
    names = [recording.name for recording in RECORDINGS] + ["ess-xyz"]
    parser.add_argument("--only", action="append", choices=names, help="this recording only; may be repeated")
    asked = parser.parse_args(arguments)
    begin = time.perf_counter()
    studies: list[Study] = []
    absent: list[str] = []
    for recording in RECORDINGS:
        if asked.only and not {recording.name, recording.converter} & set(asked.only):
            continue
        try:
            whole = convert(recording.converter)
        except InputError as error:
            absent.append(f"{recording.name}: {error}")
            print(absent[-1])
            continue
        unseen = recording.unseen(whole) if recording.unseen else None
        try:
            studies.append(study(recording, recording.prepare(whole), unseen))
        except np.linalg.LinAlgError as error:
            absent.append(f"{recording.name}: the diagnosis stopped ({error}), a fault of symfive")
            print(absent[-1])
            continue
        _say(recording, studies[-1])
        write(studies, absent, asked.output)  # what is there is there, whatever comes
    print(f"Done in {time.perf_counter() - begin:.0f} s: {asked.output.resolve()}")
    return 0 if studies else 1


def _say(recording: Recording, done: Study) -> None:
    unit = shown_unit(recording.unit)
    print(f"{recording.name}: the baseline leaves {left_by(done.found.before)}; found: {named(done.found.findings)}")
    for part in done.held_out:
        gone = f"; withdrawn: {', '.join(w.words for w in part.withdrawn)}" if part.withdrawn else ""
        sizes = f"{part.before:.3g} → {part.after:.3g} {unit}, {part.rival_name} {part.rival:.3g} {unit}"
        print(f"  {part.label}: {sizes}; {named(part.findings)}{gone} ({part.seconds:.0f} s)")
