"""Bad input, interruptions and full disks on the command line: one sentence, and nothing half written."""

from __future__ import annotations

from pathlib import Path

import cli_world
import pytest
from cli_world import BAR, CAMPAIGNS, NESTS, cell, refused, spoil

import symfive.cli as cli

symfive, small_plan, broken = cli_world.symfive, cli_world.small_plan, cli_world.broken  # fixtures


@pytest.fixture(scope="module")
def fitted(tmp_path_factory) -> Path:
    """Results of one identification, without figures."""
    folder = tmp_path_factory.mktemp("cli") / "results"
    assert cli.main(["identify", str(NESTS), "-o", str(folder), "-q", "--no-figures"]) == 0
    return folder


CELLS = [
    ("text", 5, "C_deg", "north", "is not a number"),
    ("NaN", 6, "dL_um", "nan", "not a finite number"),
    ("infinity", 7, "X_mm", "inf", "not a finite number"),
    ("time", 8, "t_s", "0.5", "time does not increase"),
    ("travel", 9, "X_mm", "5000.0", "outside its travel"),
]


@pytest.mark.parametrize(("line", "name", "value", "says"), [c[1:] for c in CELLS], ids=[c[0] for c in CELLS])
def test_a_wrong_cell_is_named_by_file_line_and_column(symfive, broken, line, name, value, says):
    path = broken / "low.csv"
    column = path.read_text().split("\n", 1)[0].split(",").index(name) + 1
    cell(path, line, column, value)
    answer = symfive("identify", broken, "-o", broken.parent / "out")
    refused(answer, "low.csv", f"line {line}", f"column {column}", says)
    assert not (broken.parent / "out").exists()


HEADERS = [
    ("missing", "dL_um", None, "is missing"),
    ("unknown", "dL_um", "dL_um,extra_um", "column"),
    ("unit", "C_deg", "C_rad", "wrong unit"),
    ("axis", "C_deg", "Q_deg", "no axis Q"),
]


@pytest.mark.parametrize(("old", "new", "says"), [h[1:] for h in HEADERS], ids=[h[0] for h in HEADERS])
def test_a_wrong_header(symfive, broken, old, new, says):
    path = broken / "low.csv"
    header, rest = path.read_text().split("\n", 1)
    names = header.split(",")
    if new is None:  # a command column goes, header and cells
        drop = names.index("C_deg")
        lines = [
            ",".join(c for i, c in enumerate(line.split(",")) if i != drop) for line in (header, *rest.splitlines())
        ]
        path.write_text("\n".join(lines))
    else:
        path.write_text(header.replace(old, new) + "\n" + rest)
    answer = symfive("assess", broken)
    refused(answer, "low.csv", "line 1", says)


@pytest.mark.parametrize(
    ("seed", "says"), [("seven", "is not a whole number"), ("1.5", "is not a whole number"), ("-1", "number from 0 to")]
)
def test_a_seed_that_is_none(symfive, tmp_path, seed, says):
    refused(symfive("simulate", NESTS, "-o", tmp_path / "out", "--seed", seed), "--seed", seed, says)


FILES = [
    ("empty", lambda p: p.write_bytes(b""), "the file is empty"),
    ("header-only", lambda p: p.write_text(p.read_text().split("\n", 1)[0] + "\n"), "no rows"),
    ("binary", lambda p: p.write_bytes(bytes(range(256)) * 20), "low.csv"),
    ("utf-16", lambda p: p.write_bytes(p.read_text().encode("utf-16")), "UTF-16"),
    ("latin-1", lambda p: p.write_bytes(p.read_bytes().replace(b"t_s", b"t_\xb5s")), "UTF-8"),
    ("truncated", lambda p: p.write_bytes(p.read_bytes()[:-25]), "truncated"),
    ("gone", lambda p: p.unlink(), "there is no such file"),
    ("folder", lambda p: (p.unlink(), p.mkdir()), "this is a folder"),
]


@pytest.mark.parametrize(("damage", "says"), [f[1:] for f in FILES], ids=[f[0] for f in FILES])
def test_a_damaged_recording(symfive, broken, damage, says):
    damage(broken / "low.csv")
    answer = symfive("identify", broken, "-o", broken.parent / "out", "--json")
    refused(answer, "low.csv", says)
    assert not (broken.parent / "out").exists()


def test_a_huge_file_is_refused_before_it_is_read(symfive, broken):
    with (broken / "low.csv").open("r+b") as stream:
        stream.truncate(200_000_000_000)  # sparse
    refused(symfive("assess", broken), "low.csv", "bytes")


TOML = [
    ("campaign.toml", 'instrument = "ball_bar"', 'instrument = "yardstick"', "yardstick"),
    ("campaign.toml", 'sampling = "static"', 'sampling = "sometimes"', "sometimes"),
    ("campaign.toml", "[[run]]", "[[run", "line"),
    ("campaign.toml", "noise_um = ", "noise_um = -", "noise_um"),
    ("machine.toml", "structure = ", "structur = ", "structural code"),
    ("machine.toml", "sigma", "sygma", "sigma"),
]


@pytest.mark.parametrize(("file", "old", "new", "says"), TOML, ids=[t[2][:12] for t in TOML])
def test_a_wrong_toml_file(symfive, broken, file, old, new, says):
    spoil(broken / file, old, new)
    refused(symfive("assess", broken), file, says)


def test_a_plan_has_nothing_to_identify(symfive, small_plan, tmp_path):
    for verb in ("identify", "diagnose"):
        answer = symfive(verb, small_plan, "-o", tmp_path / "out", "-q")
        refused(answer, "no readings", "measure or simulate")
    assert not (tmp_path / "out").exists()


def test_a_model_that_is_none(symfive, fitted, tmp_path):
    heldout = CAMPAIGNS / "static-none" / "heldout"
    refused(symfive("predict", fitted / "identification.json", heldout, "-o", tmp_path / "o"), "this is not a model")
    (tmp_path / "m.json").write_text("{ not json")
    refused(symfive("predict", tmp_path / "m.json", heldout, "-o", tmp_path / "o"), "m.json, line 1, column 3")
    other = CAMPAIGNS / "planar-none" / "heldout"
    refused(symfive("predict", fitted, other, "-o", tmp_path / "o", "-q"), "use the model of the same machine")
    assert not (tmp_path / "o").exists()


def test_a_truth_that_is_none(symfive, small_plan, tmp_path):
    truth, out = tmp_path / "t.json", tmp_path / "o"
    wrong = {"[]": "no parameters", '{"parameters": {"EX0C": "much"}}': "EX0C", '{"parameters": {"EX9Q": 1.0}}': "EX9Q"}
    for text, says in wrong.items():
        truth.write_text(text)
        refused(symfive("simulate", small_plan, "-o", out, "--truth", truth), says)
    assert not out.exists()


def test_what_is_no_campaign_is_told_apart(symfive, tmp_path):
    refused(symfive("identify", tmp_path / "absent", "-o", tmp_path / "o"), "there is no such folder")
    refused(symfive("identify", tmp_path / "absent.toml", "-o", tmp_path / "o"), "there is no such file")
    table = next(BAR.glob("*.csv"))
    refused(symfive("identify", table, "-o", tmp_path / "o"), "not a campaign", "give the campaign's folder")


def test_a_wrong_choice(symfive, tmp_path):
    refused(symfive("identify", BAR, "-o", tmp_path / "o", "--noise", "guess", "-q"), "guess", "estimate")
    refused(symfive("identify", BAR, "-o", tmp_path / "o", "--loss", "cubic", "-q"), "cubic", "huber")
    assert not (tmp_path / "o").exists()


def test_joining_another_machine(symfive, tmp_path):
    answer = symfive("identify", BAR, "--with", CAMPAIGNS / "planar-none" / "heldout", "-o", tmp_path / "o", "-q")
    refused(answer, "join campaigns of one machine")


def test_an_output_that_is_a_file(symfive, small_plan, tmp_path):
    (tmp_path / "o").write_text("mine")
    refused(symfive("simulate", small_plan, "-o", tmp_path / "o"), "a file of that name exists")
    assert (tmp_path / "o").read_text() == "mine"


def test_nothing_is_half_written_when_the_figures_fail(symfive, tmp_path, monkeypatch):
    def fails(*arguments, **options):
        raise MemoryError

    monkeypatch.setattr("symfive.report.identification_report", fails)
    refused(symfive("identify", BAR, "-o", tmp_path / "o", "-q"), "memory")
    assert list(tmp_path.iterdir()) == []


def test_an_interruption_writes_nothing(symfive, tmp_path, monkeypatch):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("symfive.results.write_model", interrupted)
    answer = symfive("identify", BAR, "-o", tmp_path / "o", "-q", "--no-figures")
    assert answer.code == 130
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk(symfive, small_plan, tmp_path, monkeypatch):
    def full(*arguments, **options):
        raise OSError(28, "No space left on device", "measured")

    monkeypatch.setattr("symfive.campaign.write_campaign_files", full)
    answer = symfive("simulate", small_plan, "-o", tmp_path / "o")
    refused(answer, "No space left on device")
    assert not (tmp_path / "o").exists()


def test_a_campaign_that_is_named_twice_does_not_count_twice(symfive, tmp_path):
    answer = symfive("identify", BAR, "--with", BAR, "-o", tmp_path / "r", "--no-figures", "-q")
    refused(answer, "run low holds the readings of run low again", "name each recording once")


def test_a_file_of_another_kind_is_called_what_it_is(symfive, tmp_path):
    refused(symfive("identify", BAR / "machine.toml", "-o", tmp_path / "r"), "this is a machine: name a campaign")
    assert "symfive import reads tables" in symfive("check", BAR / "low.csv").out
