"""The command line as tests call it, and what they hand to it."""

import shutil
from pathlib import Path

import pytest

import symfive.cli as cli
from symfive.campaign import write_campaign
from symfive.machine import preset
from symfive.procedures import campaign_of, r_test_grid

CAMPAIGNS = Path(__file__).parent / "data" / "campaigns"
BAR = CAMPAIGNS / "static-ball-bar-two-heights" / "fit"
NESTS = CAMPAIGNS / "static-none" / "fit"


class Answer:
    """What a command said and returned."""

    def __init__(self, code: int, out: str, err: str) -> None:
        self.code, self.out, self.err = code, out, err


@pytest.fixture
def symfive(capsys):
    def run(*words: object) -> Answer:
        capsys.readouterr()
        code = cli.main([str(word) for word in words])
        said = capsys.readouterr()
        return Answer(code, said.out, said.err)

    return run


@pytest.fixture(scope="module")
def fitted(tmp_path_factory) -> Path:
    """Results of one identification with figures."""
    folder = tmp_path_factory.mktemp("cli") / "results"
    assert cli.main(["identify", str(NESTS), "-o", str(folder), "-q"]) == 0
    return folder


@pytest.fixture
def small_plan(tmp_path) -> Path:
    """A plan of few poses, without readings."""
    machine = preset("oyama-2010")
    write_campaign(campaign_of(machine, r_test_grid(machine, step_deg=90.0)), tmp_path / "plan")
    return tmp_path / "plan"


def refused(answer: Answer, *words: str) -> None:
    """Exit 2, one line on standard error that names these, nothing on standard output."""
    assert answer.code == 2
    assert answer.out == ""
    assert "Traceback" not in answer.err
    lines = answer.err.strip().splitlines()
    assert len(lines) == 1, answer.err
    assert lines[0].startswith("symfive: ")
    for word in words:
        assert word in lines[0]


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def broken(tmp_path) -> Path:
    """A small campaign to be spoilt."""
    shutil.copytree(BAR, tmp_path / "bad")
    return tmp_path / "bad"


def spoil(path: Path, old: str, new: str, count: int = 1) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, count), encoding="utf-8")


def cell(path: Path, line: int, column: int, value: str) -> None:
    """Another value in a cell, both counted from 1."""
    lines = path.read_text(encoding="utf-8").split("\n")
    cells = lines[line - 1].split(",")
    cells[column - 1] = value
    lines[line - 1] = ",".join(cells)
    path.write_text("\n".join(lines), encoding="utf-8")
