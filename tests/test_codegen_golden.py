"""Generated files as they stand in tests/data/golden; `python tests/test_codegen_golden.py --update` writes them anew.

What the self-test expects is left out: its last digits belong to the mathematical library of the computer.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from symfive.codegen import TARGETS, codegen, subject_of
from symfive.machine import preset
from symfive.model import FittedModel

GOLDEN = Path(__file__).resolve().parent / "data" / "golden"
ERRORS = ("EC0X", "EX0B", "EA0B", "EX0C", "EA0C", "EXC")


def model() -> FittedModel:
    """A small machine with fixed values, whose table makes one revolution."""
    whole = preset("table-bc")
    axes = {**whole.axes, "C": replace(whole.axes["C"], travel=(-180.0, 180.0))}
    machine = replace(whole, axes=axes, errors={name: whole.errors[name] for name in ERRORS})
    parameters = subject_of(machine).parameters
    names = tuple(p.name for p in parameters)
    values = {name: float(7 * i - 20) for i, name in enumerate(names)}
    return FittedModel(
        machine=machine, effects=(), values=values, std=dict.fromkeys(names, 1.0), names=names,
        units={p.name: p.unit for p in parameters}, covariance=np.eye(len(names)),
    )  # fmt: skip


def kept(folder: Path) -> dict[str, str]:
    names = (p for p in sorted(folder.iterdir()) if not p.name.endswith("_selftest.c") and p.name != "manifest.json")
    return {p.name: p.read_text() for p in names}


@pytest.mark.parametrize("target", list(TARGETS))
def test_files_are_as_they_were(tmp_path, target) -> None:
    codegen(model(), tmp_path / target, target=target)
    found, golden = kept(tmp_path / target), kept(GOLDEN / target)
    assert list(found) == list(golden)
    for name, text in found.items():
        assert text == golden[name], f"{target}/{name} has changed; if it should: {Path(__file__).name} --update"


if __name__ == "__main__":
    if sys.argv[1:] != ["--update"]:
        sys.exit("say --update to write tests/data/golden anew")
    for name in TARGETS:
        with tempfile.TemporaryDirectory() as folder:
            codegen(model(), Path(folder) / name, target=name)
            (GOLDEN / name).mkdir(parents=True, exist_ok=True)
            for old in (GOLDEN / name).iterdir():
                old.unlink()
            for file, text in kept(Path(folder) / name).items():
                (GOLDEN / name / file).write_text(text)
