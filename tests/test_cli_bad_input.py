"""Bad input, interruptions and full disks on the command line: one sentence, and nothing half written."""

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


@pytest.mark.parametrize(
    ("file", "damage", "says"),
    [
        ("low.csv", lambda path: cell(path, 5, 1, "north"), ("line 5", "column 1", "is not a number")),
        ("low.csv", lambda path: path.write_bytes(path.read_bytes()[:-25]), ("truncated",)),
        ("low.csv", lambda path: path.unlink(), ("there is no such file",)),
        ("campaign.toml", lambda path: spoil(path, "[[run]]", "[[run"), ("line",)),
        ("machine.toml", lambda path: spoil(path, "structure = ", "structur = "), ("structural code",)),
    ],
)
def test_damaged_files_are_refused_and_nothing_is_written(symfive, broken, file, damage, says):
    """What is wrong with rows and keys is looked at in test_campaign, whole files in test_bad_input."""
    damage(broken / file)
    refused(symfive("identify", broken, "-o", broken.parent / "out", "--json"), file, *says)
    assert not (broken.parent / "out").exists()


@pytest.mark.parametrize(
    ("seed", "says"), [("seven", "is not a whole number"), ("1.5", "is not a whole number"), ("-1", "number from 0 to")]
)
def test_a_seed_that_is_none(symfive, tmp_path, seed, says):
    refused(symfive("simulate", NESTS, "-o", tmp_path / "out", "--seed", seed), "--seed", seed, says)


@pytest.mark.parametrize(
    "words", [("diagnose", "x", "--hold-out"), ("history", "show", "--since"), ("plan", "x", "--frob")]
)
def test_a_usage_error_names_the_help_of_its_verb(symfive, words):
    verb = " ".join(word for word in words if word != "x" and not word.startswith("-"))
    refused(symfive(*words), words[-1], f"see `symfive {verb} --help`")


@pytest.mark.parametrize("names", ["", ","])
@pytest.mark.parametrize("option", ["--instrument", "--for"])
def test_a_list_of_a_plan_that_names_nothing(symfive, tmp_path, option, names):
    """As from a shell's variable that is not set."""
    refused(symfive("plan", "table-bc", "-o", tmp_path / "out", option, names), option, "names nothing")


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
        refused(symfive("simulate", small_plan, "-o", out, "--truth", truth), "t.json", says)
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


def test_nothing_is_half_written_when_the_figures_fail(symfive, tmp_path, monkeypatch):
    def fails(*arguments, **options):
        raise MemoryError

    monkeypatch.setattr("symfive.report.identification_report", fails)
    refused(symfive("identify", BAR, "-o", tmp_path / "o", "-q"), "memory")
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
