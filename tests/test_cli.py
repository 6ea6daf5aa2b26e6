"""The command line, verb by verb: what is written, exit codes, one sentence for bad input, nothing half written."""

import importlib
import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace

import cli_world
import pytest
from cli_world import BAR, CAMPAIGNS, cell, files, refused, spoil
from pages import without_figures

import symfive.cli as cli
from symfive import __version__
from symfive.campaign import read_campaign, write_campaign
from symfive.machine import preset, write_machine
from symfive.model import read_model
from symfive.nc import DIALECTS
from symfive.procedures import campaign_of, linear_positioning

COMMANDS = cli.app.commands
symfive, fitted = cli_world.symfive, cli_world.fitted  # fixtures
small_plan, broken = cli_world.small_plan, cli_world.broken


def test_version_and_help(symfive):
    assert symfive("--version").out.strip() == f"symfive {__version__}"
    answer = symfive("--help")
    assert answer.code == 0
    for verb in COMMANDS:
        assert verb in answer.out


@pytest.mark.parametrize("verb", COMMANDS)
def test_help_of_every_verb_has_an_example(symfive, verb):
    answer = symfive(verb, "--help")
    assert answer.code == 0
    assert f"Example: symfive {verb} " in " ".join(answer.out.split())


@pytest.mark.parametrize("verb", COMMANDS)
def test_every_argument_and_option_is_explained(verb):
    for parameter in COMMANDS[verb].params:
        assert getattr(parameter, "help", "") or parameter.name in ("help",), f"{verb}: {parameter.name}"


def test_an_unknown_verb_or_option_is_a_usage_error(symfive):
    assert symfive("guess").code == 2
    assert symfive("assess", str(BAR), "--points", "3").code == 2
    assert symfive("identify", str(BAR)).code == 2  # no -o


def test_as_a_program():
    done = subprocess.run([sys.executable, "-m", "symfive", "check", "absent"], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert "there is no such file or folder" in done.stderr


@pytest.mark.parametrize("verb", ["plan", "diagnose"])
def test_help_lists_the_dialects(symfive, verb):
    assert set(DIALECTS) <= set(re.findall(r"\w+", symfive(verb, "--help").out))


def loaded(code: str, depth: int = 1, **environment: str) -> tuple[set[str], subprocess.CompletedProcess[str]]:
    """What a fresh process has imported beyond the standard library once this code has run, foreign names cut to `depth` parts.

    A start stays quick only as long as nothing heavy is imported. Seconds depend on the computer, imports do not.
    """
    say = "lambda: sys.stderr.write(' '.join(['', 'loaded', *sorted(sys.modules.keys() - before)]))"
    program = f"import atexit, sys; before = set(sys.modules); atexit.register({say}); {code}"
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, capture_output=True, text=True, env={**os.environ, **environment})
    modules = done.stderr.rpartition(" loaded ")[2].split()
    foreign = {name for name in modules if name.partition(".")[0] not in sys.stdlib_module_names}
    return {".".join(name.split(".")[: None if name.startswith("symfive") else depth]) for name in foreign}, done


def test_version_help_and_completion_load_the_command_line_alone():
    allowed = re.compile(r"click|symfive(\.(cli|outputs)(\..*)?|\.(errors|files|separated|version))?")
    completion = {"_SYMFIVE_COMPLETE": "bash_complete", "COMP_WORDS": "symfive di", "COMP_CWORD": "1"}
    three = "[['--version'], ['--help'], ['plan', '--help']]"
    for code, environment in ((f"sys.exit(any([main(words) for words in {three}]))", {}), ("main()", completion)):
        modules, done = loaded(f"from symfive.cli import main; {code}", **environment)
        assert "click" in modules and done.returncode == 0 and done.stdout, done.stderr
        assert [name for name in modules if not allowed.fullmatch(name)] == [], code
    assert done.stdout.split() == ["plain,diagnose"]


def test_check_loads_no_symbolic_mathematics():
    campaigns = [
        str(CAMPAIGNS / name / "fit") for name in ("static-ball-bar-two-heights", "static-none", "planar-none")
    ]
    modules, done = loaded(f"from symfive.cli import main; [main(['check', folder]) for folder in {campaigns}]")
    assert done.returncode == 0 and done.stdout.count("no problem found") == 3, done.stderr
    assert {name for name in modules if not name.startswith("symfive")} <= {"click", "numpy"}
    assert not modules & {"symfive._api", "symfive.model", "symfive.report", "symfive.design"}


@pytest.mark.parametrize(
    "campaign", ["static-none", pytest.param("static-ball-bar-two-heights", marks=pytest.mark.slow)]
)
def test_identify_loads_what_it_uses(tmp_path, campaign):
    """Of SciPy a small campaign needs functions and the simplex search; signal, stats and interpolate alone take a second."""
    words = ["identify", str(CAMPAIGNS / campaign / "fit"), "-o", str(tmp_path / "r"), "--no-figures", "-q"]
    modules, done = loaded(f"from symfive.cli import main; main({words!r})", depth=2)
    assert done.returncode == 0 and "rms" in done.stdout, done.stderr
    assert "scipy.special" in modules and not modules & {
        "scipy.signal",
        "scipy.stats",
        "scipy.interpolate",
        "matplotlib",
    }
    assert not modules & {"symfive._api", "symfive.design", "symfive.diagnose", "symfive.executors"}


@pytest.mark.slow
def test_plan_of_poses_loads_no_scipy(tmp_path):
    """It took 0.2 of the 4.9 s of a plan of 30 poses."""
    words = ["plan", "table-bc", "--points", "3", "--starts", "1", "--setups", "1", "-o", str(tmp_path / "p"), "-q"]
    modules, done = loaded(f"from symfive.cli import main; main({words!r})", depth=2)
    assert done.returncode == 0 and (tmp_path / "p" / "plan.json").is_file(), done.stderr
    assert not modules & {"scipy.special", "scipy.linalg", "scipy.stats", "scipy.sparse"}


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_shown_for_every_shell(symfive, shell):
    answer = symfive("--show-completion", shell)
    assert answer.code == 0 and f"_SYMFIVE_COMPLETE={shell}_complete" in answer.out


def test_check_quietly(symfive, small_plan, broken):
    answer = symfive("check", small_plan, "-q")
    assert (answer.code, answer.out, answer.err) == (0, "", "")
    cell(broken / "low.csv", 5, 1, "north")
    answer = symfive("check", broken, "--quiet")
    assert answer.code == 1 and len(answer.out.splitlines()) == 1 and "low.csv, line 5, column 1" in answer.out


@pytest.mark.slow
def test_a_function_wins_over_the_package_of_its_name_whichever_comes_first():
    code = (
        "import sys, symfive; assert not {'casadi', 'symfive._api'} & set(sys.modules); "
        "import symfive.identify, symfive.check; from symfive import diagnose; "
        "assert all(callable(f) for f in (symfive.identify, symfive.check, diagnose)); "
        "assert set(symfive.__all__) <= set(dir(symfive)); import symfive._api as api; "
        "assert symfive.__all__ == api.__all__ and symfive.identify is api.identify"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_assess(symfive):
    answer = symfive("assess", BAR)
    assert answer.code == 0
    data = json.loads(symfive("assess", BAR, "--json").out)
    assert any("cannot be separated" in said and said in answer.out for said in data["confounded_in_words"])
    assert f"{data['rank']} of {data['parameters']}" in answer.out
    assert data["schema"] == "symfive.assessment/1"
    assert data["expected"]["EX0C"]["unit"] == "um"


def test_check_says_what_is_declared(symfive, small_plan):
    answer = symfive("check", BAR)
    assert answer.code == 0 and answer.err == ""
    lines = answer.out.splitlines()
    assert lines[0].startswith("machine plant: w ") and lines[1].startswith("axes: ") and "EX0C ±" in answer.out
    assert "run low: 24 rows, ball bar, static, noise 0.4 µm, measured" in lines and lines[-1] == "no problem found"
    assert "a plan, no readings yet" in symfive("check", small_plan).out
    data = json.loads(symfive("check", small_plan / "machine.toml", "--json").out)
    assert data["schema"] == "symfive.check/1" and data["problems"] == [] and data["runs"] == []
    assert data["machine"]["axes"]["B"]["unit"] == "deg" and data["machine"]["errors_possible"]["EX0C"] == 50.0
    refused(symfive("check", small_plan / "absent.toml"), "absent.toml", "no such file")


def test_check_finds_every_problem(symfive, broken):
    cell(broken / "low.csv", 5, 1, "north")
    spoil(broken / "campaign.toml", 'file = "high.csv"', 'file = "higher.csv"')
    spoil(broken / "machine.toml", "[errors]", "[errors]\nEXOC = { sigma = 5.0 }")
    answer = symfive("check", broken)
    assert answer.code == 1 and "3 problems:" in answer.out and "Traceback" not in answer.err
    for words in (
        "low.csv, line 5, column 1",
        "higher.csv: there is no such file",
        "did you mean EX0C?",
        "\n[errors]\n",
    ):
        assert words in answer.out
    found = json.loads(symfive("check", broken, "--json").out)
    assert len(found["problems"]) == 3 and found["problems"][0]["line"] and found["problems"][0]["remedy"]
    assert found["problems"][0]["keys"] == ["errors", "EXOC"]
    (broken / "campaign.toml").write_text("[[run")
    assert symfive("check", broken).code == 1


def test_simulate_fills_a_plan_in(symfive, small_plan, tmp_path):
    answer = symfive("simulate", small_plan, "-o", tmp_path / "measured", "--seed", 3)
    assert answer.code == 0
    assert answer.out == ""
    assert "rows" in answer.err
    measured = read_campaign(tmp_path / "measured")
    assert measured.measured
    truth = json.loads((tmp_path / "measured" / "truth.json").read_text())
    assert truth["schema"] == "symfive.truth/1"
    assert truth["seed"] == 3
    assert symfive("simulate", small_plan, "-o", tmp_path / "again", "--seed", 3, "-q").err == ""
    for run in measured.runs:
        assert (tmp_path / "again" / run.file).read_bytes() == (tmp_path / "measured" / run.file).read_bytes()


def test_simulate_takes_a_truth_with_effects(symfive, small_plan, tmp_path):
    truth = tmp_path / "truth.json"
    effects = [{"effect": "gravity_sag", "axis": "B", "component": "EXB"}]
    truth.write_text(json.dumps({"parameters": {"EX0C": 33.0, "gravity_sag.B.EXB.sin": 5.0}, "effects": effects}))
    assert symfive("simulate", small_plan, "-o", tmp_path / "m", "--truth", truth).code == 0
    made = json.loads((tmp_path / "m" / "truth.json").read_text())
    assert made["parameters"]["EX0C"] == 33.0
    assert made["effects"] == effects


def test_identify_writes_everything(fitted):
    written = files(fitted)
    assert {"identification.json", "model.json", "identification.html"} <= written
    assert any(name.startswith("figures") for name in written)
    data = json.loads((fitted / "identification.json").read_text())
    assert data["schema"] == "symfive.identification/1"
    truth = json.loads((CAMPAIGNS / "static-none" / "truth.json").read_text())["location_errors_um_urad"]
    for name, value in truth.items():
        entry = data["parameters"][name]
        assert abs(entry["value"] - value) < 3.5 * entry["std"], name
    assert read_model(fitted).names


def test_identify_without_figures_as_json_on_two_campaigns(symfive, tmp_path):
    shutil.copytree(BAR, tmp_path / "again")
    for table in (tmp_path / "again").glob("[lh]*.csv"):
        cell(table, 5, table.read_text().split("\n")[0].split(",").index("dL_um") + 1, "0.0")
    words = ("identify", BAR, "--with", tmp_path / "again", "-o", tmp_path / "r", "--noise", "declared")
    answer = symfive(*words, "--no-figures", "--json", "-q")
    assert answer.code == 0
    assert answer.err == ""
    assert json.loads(answer.out) == json.loads((tmp_path / "r" / "identification.json").read_text())
    assert files(tmp_path / "r") == {"identification.json", "manifest.json", "model.json"}
    assert "c2-low" in json.loads(answer.out)["setup"]


def test_predict(symfive, fitted, tmp_path):
    heldout = CAMPAIGNS / "static-none" / "heldout"
    answer = symfive("predict", fitted / "model.json", heldout, "-o", tmp_path / "p")
    assert answer.code == 0
    assert "check: rms of measured minus predicted" in answer.out
    data = json.loads((tmp_path / "p" / "prediction.json").read_text())
    assert data["rms"]["check"] < 0.45
    assert read_campaign(tmp_path / "p").measured
    as_json = symfive("predict", fitted, heldout, "-o", tmp_path / "p", "--overwrite", "--json", "-q")
    assert json.loads(as_json.out) == data


def test_diagnose_names_what_is_hidden(symfive, tmp_path):
    machine = replace(preset("three-axis"), errors={})
    write_campaign(campaign_of(machine, linear_positioning(machine, axis="X", cycles=2)), tmp_path / "plan")
    truth = tmp_path / "truth.json"
    hidden = [{"effect": "backlash", "axis": "X"}]
    truth.write_text(json.dumps({"parameters": {"backlash.X.width": 12.0}, "effects": hidden}))
    assert symfive("simulate", tmp_path / "plan", "-o", tmp_path / "measured", "--truth", truth).code == 0
    answer = symfive("diagnose", tmp_path / "measured", "-o", tmp_path / "d", "--json", "-q")
    assert answer.code == 0
    data = json.loads(answer.out)
    assert data == json.loads((tmp_path / "d" / "diagnosis.json").read_text())
    assert data["schema"] == "symfive.diagnosis/1"
    assert data["mismatch"] is True
    assert [finding["effect"] for finding in data["findings"]] == ["backlash"]
    assert data["fit"]["chi2_dof_after"] < 1.5 < data["fit"]["chi2_dof_before"]
    assert {"diagnosis.json", "identification.json", "model.json", "report.html"} <= files(tmp_path / "d")
    assert {effect.id for effect in read_model(tmp_path / "d").effects} == {"backlash"}


def test_diagnose_of_a_clean_campaign_is_done_and_finds_nothing(symfive, tmp_path, monkeypatch):
    without_figures(monkeypatch)
    answer = symfive("diagnose", BAR, "-o", tmp_path / "d")
    assert answer.code == 0
    data = json.loads((tmp_path / "d" / "diagnosis.json").read_text())
    assert data["findings"] == [] and not data["mismatch"]
    assert "nothing found" in answer.out


@pytest.mark.parametrize(("verb", "module", "solver"), [
    ("identify", "symfive.identify._identify", "solve"),
    pytest.param("diagnose", "symfive.posterior._fit", "gauss_newton", marks=pytest.mark.slow),
])  # fmt: skip
def test_a_fit_that_did_not_converge_is_told_on_the_terminal(symfive, tmp_path, monkeypatch, verb, module, solver):
    found = importlib.import_module(module)
    solve = getattr(found, solver)
    monkeypatch.setattr(found, solver, lambda *words, **options: (solve(*words, **options)[0], False))
    answer = symfive(verb, BAR, "-o", tmp_path / "out", *(["--no-figures"] if verb == "identify" else []))
    assert answer.code == 0 and "note: the fit did not converge" in answer.err
    assert answer.out.startswith("The fit did not converge: ")


def test_notes_go_to_standard_error_and_quiet_leaves_them_out(symfive, broken):
    spoil(broken / "campaign.toml", "[[run]]", '[[run]]\noperator = "somebody"')
    answer = symfive("assess", broken)
    assert 'note: key "operator"' in answer.err
    assert "operator" not in answer.out
    assert symfive("assess", broken, "-q").err == ""


def test_progress_is_told_from_two_seconds_on(symfive, tmp_path, monkeypatch):
    clock = iter(range(0, 100_000, 3))
    monkeypatch.setattr(cli._common.time, "monotonic", lambda: next(clock))
    answer = symfive("identify", BAR, "-o", tmp_path / "o", "--no-figures")
    assert answer.code == 0
    assert " s  " in answer.err
    assert " s  " not in answer.out


def test_plan_names_what_it_cannot_take(symfive, tmp_path):
    write_machine(preset("oyama-2010"), tmp_path / "machine.toml")
    spoil(tmp_path / "machine.toml", "[workspace]", "[workspace]\npost_diameter = 20.0")
    answer = symfive("plan", tmp_path / "machine.toml", "-o", tmp_path / "p", "--points", "1")
    assert 'note: key "workspace.post_diameter"' in answer.err and "points = 1 is too few" in answer.err
    refused(symfive("plan", tmp_path / "absent.toml", "-o", tmp_path / "p"), "absent.toml")
    refused(symfive("plan", tmp_path / "machine.toml", "-o", tmp_path / "p", "--for", "EX9Q", "-q"), "EX9Q")
    refused(symfive("plan", tmp_path / "machine.toml", "-o", tmp_path / "p", "--points", "1", "-q"), "points")
    assert not (tmp_path / "p").exists()
