"""The documentation runs: Python and console blocks in order, page by page, in a temporary folder; data blocks parse."""

import json
import re
import shlex
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from effects_world import assert_exact

from symfive.campaign import Campaign, Run, write_campaign
from symfive.cli import app, main
from symfive.effects import EFFECTS, make_effect
from symfive.errors import InputError
from symfive.instruments import INSTRUMENTS, instruments_of
from symfive.machine import machine_from_data, preset
from symfive.model import Model
from symfive.moves import cleared
from symfive.nc import DIALECTS, Post, can_write, write_programs
from symfive.procedures import campaign_of, planar_circle, r_test_grid, rotary_circle
from symfive.simulate import simulate
from symfive.version import __version__
from tests.plan_checker import check
from tests.plan_checker.dialects import DIALECTS as WORDS

ROOT = Path(__file__).resolve().parent.parent
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    *sorted((ROOT / "benchmarks").glob("*.md")),
]
PAGES += [page for page in sorted((ROOT / "docs").rglob("*.md")) if "_build" not in page.parts]
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
COMMANDS = app
ONLY_CHECKED = ("plan", "codegen")  # their own tests run them; here only that verb and options exist
START = ROOT / "docs/start.md"
"""The page without Python: all of its commands run, one after the other."""
LINKS = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, text and first line in the page."""

    language: str
    text: str
    line: int


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    return [Block(m[1], m[2], text.count("\n", 0, m.start()) + 2) for m in FENCE.finditer(text)]


LONG = ("design", "figures", "howto/diagnosis", "howto/effect", "howto/fleet", "howto/instrument", "howto/plan")
SLOW = {ROOT / "docs" / f"{page}.md" for page in LONG}


def pages_with(language: str) -> list:
    """The pages that hold such a block; those that take long are marked so."""
    found = [page for page in PAGES if any(block.language == language for block in blocks(page))]
    return [pytest.param(page, marks=pytest.mark.slow) if page in SLOW else page for page in found]


def named(page: Path) -> str:
    return str(page.relative_to(ROOT))


def commands(block: Block) -> list[list[str]]:
    """What follows a `$`, in words, without comments."""
    lines = [line[2:] for line in block.text.splitlines() if line.startswith("$ ")]
    return [words for words in (shlex.split(line, comments=True) for line in lines) if words]


@pytest.fixture
def own_tables():
    """Pages may add instruments, effects and dialects; afterwards the tables are as they were."""
    before = [(table, dict(table)) for table in (INSTRUMENTS, EFFECTS, DIALECTS)]
    yield
    for table, entries in before:
        table.clear()
        table.update(entries)


@pytest.fixture(scope="module")
def circles() -> Campaign:
    """A small measured campaign, for pages that begin with one."""
    whole = preset("three-axis")
    machine = replace(whole, errors={t.name: t for t in whole.errors.values() if t.is_location or t.name == "EXX"})
    return simulate(campaign_of(machine, planar_circle(machine, feed=2000.0, rate_hz=6.0)), seed=1).campaign


def run_in_order(
    page: Path, capsys: pytest.CaptureFixture[str], typed: Callable[[list[str]], list[str]] = list
) -> None:
    """Run a page's blocks in the working folder; `typed`: what becomes of the words of a command."""
    space: dict[str, object] = {"__name__": "page"}
    for block in blocks(page):
        where = f"{named(page)}:{block.line}"
        if block.language == "toml" and block.text.startswith("# ") and block.text.split("\n", 1)[0].endswith(".toml"):
            Path(block.text.split("\n", 1)[0][2:].strip()).write_text(block.text, encoding="utf-8")
        if block.language == "json" and page == START:
            Path("concealed.json").write_text(block.text, encoding="utf-8")
        if block.language == "python":
            code = compile("\n" * (block.line - 1) + block.text, str(page), "exec", dont_inherit=True)
            exec(code, space)
        if block.language == "console":
            for words in commands(block):
                if words[0] == "symfive" and (page == START or words[1] not in ONLY_CHECKED):
                    said = f"{where}: {' '.join(words)}"
                    assert main(typed(words[1:])) == 0, f"{said}: {capsys.readouterr().err}"


@pytest.mark.parametrize("page", [*pages_with("python"), pytest.param(START, marks=pytest.mark.slow)], ids=named)
def test_the_blocks_of_a_page_run_in_order(page, tmp_path, monkeypatch, capsys, own_tables, circles):
    monkeypatch.chdir(tmp_path)
    if not any(word in page.read_text() for word in ("-o measured", ', "measured")')):
        write_campaign(circles, "measured")
    run_in_order(page, capsys)


@pytest.mark.slow
def test_the_first_page_runs_in_order_on_a_small_plan(tmp_path, monkeypatch, capsys):
    """Every command as it stands, but for the number of poses and of starts."""

    def small(words: list[str]) -> list[str]:
        poses = words.index("--points") + 1 if words[0] == "plan" else None
        return words if poses is None else [*words[:poses], "8", *words[poses + 1 :], "--starts", "1"]

    monkeypatch.chdir(tmp_path)
    run_in_order(START, capsys, small)


def test_added_instruments_and_effects_are_taken_out_again():
    assert "dial_gauge" not in INSTRUMENTS
    assert "bar_droop" not in EFFECTS


def python_of(page: Path) -> dict[str, Any]:
    """What the Python blocks of a page leave; what they diagnose is the test's of the whole page."""
    space: dict[str, Any] = {"__name__": "page"}
    for block in blocks(page):
        if block.language == "python" and "diagnose(" not in block.text:
            exec(compile(block.text, str(page), "exec", dont_inherit=True), space)
    return space


def test_effects_of_their_page_are_exact_and_named_by_component(own_tables):
    page = python_of(ROOT / "docs/howto/effect.md")
    assert_exact(Model(page["plan"], [page["droop"]]), ["bar_droop.amplitude"])
    machine = preset("table-bc")
    still = r_test_grid(machine, step_deg=60.0)
    driven = [replace(run, id=f"driven-{run.id}", file=f"driven-{run.id}.csv", sampling="dynamic") for run in still]
    plan = campaign_of(machine, [*still, *driven])
    forms = [form.effect for form in EFFECTS["clamp_shift"].candidates(plan)]
    assert {form.axis for form in forms} == {None} and {form.belongs_to for form in forms} == {"B", "C"}
    model = Model(plan, forms)
    assert {"clamp_shift.EXC.amplitude", "clamp_shift.EYC.amplitude"} <= set(model.index)
    moved = model.contribution(forms[0], model.vector({p.name: 3.0 for p in forms[0].parameters(plan)}))
    assert np.abs(moved["r-test-1"]).max() == pytest.approx(3.0) and not moved["driven-r-test-1"].any()
    assert not list(EFFECTS["clamp_shift"].candidates(campaign_of(machine, still)))
    turns = campaign_of(machine, rotary_circle(machine, axis="C", table_ball=(80.0, 30.0, 100.0), rate_hz=10.0))
    (swell,) = (form.effect for form in EFFECTS["table_swell"].candidates(turns))
    gains = make_effect("servo_mismatch", "C")
    assert_exact(Model(turns, [swell, gains]), ["table_swell.C.expansion", gains.parameters(turns)[0].name])


def test_the_effects_page_asks_its_reader_for_no_axis_or_option(own_tables):
    """What it does not draw lacks a recording, or its machine has a drive."""
    from _effects_page import campaign, drawn

    python_of(ROOT / "docs/howto/effect.md")
    plan = campaign()
    for name in EFFECTS:
        try:
            drawn(name, plan)
        except InputError as error:
            assert "no run records" in str(error) or name == "following_lag", error
    assert drawn("table_swell", plan).axis == "C" and drawn("axis_growth", plan).axis in plan.machine.linear_axes


def test_a_dialect_of_its_page_drives_what_the_others_drive(own_tables, tmp_path, monkeypatch):
    python_of(ROOT / "docs/howto/dialect.md")
    own = replace(WORDS["iso"], suffix=".cnc", comment=";", message="", stops=False, screen=r"; ([^\n]+)\nM0")
    monkeypatch.setitem(WORDS, "workshop", own)
    machine = preset("three-axis")
    runs = planar_circle(machine, radius=100.0, feed=2000.0, rate_hz=6.0)
    write_campaign(campaign_of(machine, runs), tmp_path)
    write_programs(campaign_of(machine, runs), tmp_path / "nc", ("iso", "workshop"), cleared(machine, runs, {}))
    assert not check(tmp_path)
    program = tmp_path / "nc" / "workshop" / f"{runs[0].id}.cnc"
    program.write_text(program.read_text().replace("G55", "G53.2", 1))
    assert {finding.file for finding in check(tmp_path)} == {program}


def test_a_dialect_without_words_for_a_touch_is_refused(own_tables):
    DIALECTS["silent"] = replace(DIALECTS["iso"], name="silent", cycle=None)
    with pytest.raises(InputError, match="silent: its words for a touch are not known"):
        can_write(preset("table-bc"), "silent", Post(), probing=True)


def test_the_files_that_the_how_tos_name_exist():
    for page in (ROOT / "docs/howto").glob("*.md"):
        for path in re.findall(r"`((?:symfive|tests|docs)/[\w/.-]+\.(?:py|md))`", page.read_text(encoding="utf-8")):
            assert "NAME" in path or (ROOT / path).is_file(), f"{page.name}: {path}"
    for path, name in (("effects_world.py", "CASES"), ("test_effects.py", "FORMULAS"), ("test_predict.py", "RUNS"),
                       ("plan_checker/dialects.py", "DIALECTS")):  # fmt: skip
        assert re.search(rf"^{name}\b", (ROOT / "tests" / path).read_text(encoding="utf-8"), re.MULTILINE), path


@pytest.mark.parametrize("page", pages_with("sh"), ids=named)
def test_the_commands_of_a_job_exist(page):
    """Those that need files of an instrument, and so do not run here."""
    for block in blocks(page):
        lines = block.text.replace("\\\n", " ").splitlines() if block.language == "sh" else []
        for words in (shlex.split(line, comments=True) for line in lines):
            if words and words[0] == "symfive":
                _check_symfive(words[1:])


@pytest.mark.parametrize("page", pages_with("console"), ids=named)
def test_the_commands_exist(page):
    for block in blocks(page):
        if block.language != "console":
            continue
        for words in commands(block):
            program = words[0]
            if program == "symfive":
                _check_symfive(words[1:])
            elif words[:2] == ["python3", "go.py"]:
                assert f"def {words[2]}(" in (ROOT / "go.py").read_text(), words
            elif program.rsplit("/", 1)[-1].startswith("python"):
                assert words[1] == "-m" or (ROOT / words[1]).is_file(), words
            else:
                assert program in (".", "git", "pip", "cd"), words


def _check_symfive(words: list[str]) -> None:
    options = words
    command = COMMANDS
    if words and not words[0].startswith("-"):
        assert words[0] in COMMANDS.commands, f"there is no verb {words[0]}"
        command, options = COMMANDS.commands[words[0]], words[1:]
        if isinstance(command, click.Group) and options and not options[0].startswith("-"):
            assert options[0] in command.commands, f"{words[0]} has no verb {options[0]}"
            command, options = command.commands[options[0]], options[1:]
    known = {name for p in command.params for name in (*p.opts, *p.secondary_opts)} | {"--help", "-h"}
    for word in options:
        assert not word.startswith("-") or word in known, f"{words[0]} has no option {word}"


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_data_blocks_parse(page):
    for block in blocks(page):
        if block.language == "json":
            json.loads(block.text)
        if block.language == "toml":
            data = tomllib.loads(block.text)
            if data.get("schema") == "symfive.machine/1":
                machine_from_data(data, named(page))


def test_the_campaign_of_the_conventions_is_read():
    [block] = [
        b for b in blocks(ROOT / "docs/conventions.md") if "symfive.campaign/1" in b.text and b.language == "toml"
    ]
    [table] = tomllib.loads(block.text)["run"]
    run = Run(
        id=table["id"], instrument=(table["instrument"],), sampling=table["sampling"], time=[0.0], commands={"X": [0.0]},
        length=table["length"], table_ball=tuple(table["table_ball"]), tool_ball=tuple(table["tool_ball"]),
    )  # fmt: skip
    assert instruments_of(run)


def test_the_conventions_name_every_option_instrument_and_effect():
    from symfive.effects import VOCABULARY
    from symfive.instruments import INSTRUMENTS as TABLE
    from symfive.runs import OPTIONS

    text = (ROOT / "docs/conventions.md").read_text(encoding="utf-8")
    for name in (*OPTIONS, *TABLE, *VOCABULARY):
        assert f"| `{name}` |" in text, name


def test_every_verb_stands_in_the_conventions_and_on_its_page():
    for page in ("docs/conventions.md", "docs/commands.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        for verb in COMMANDS.commands:
            assert f"`symfive {verb} " in text, f"{page}: {verb}"


def test_the_citation_is_of_this_version():
    assert f"version: {__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_links_within_the_repository_lead_somewhere(page):
    for target in LINKS.findall(FENCE.sub("", page.read_text(encoding="utf-8"))):
        if "://" not in target and not target.startswith("mailto:"):
            assert (page.parent / target).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_no_paths_of_one_computer(page):
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"(?<![\w.])/(work|tmp|home|root)/", text)
