"""Whatever is given ends in a result or in one sentence of at most 800 characters: no traceback, no hang."""

import json
import random
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from fuzz.verbs import Calls

import symfive.cli as cli
from symfive.campaign import read_campaign, write_campaign
from symfive.check import check
from symfive.convert.emps import emps
from symfive.errors import InputError
from symfive.executors import executor
from symfive.given import machine_given, machine_or_model_given
from symfive.identify import fitted_model, identify
from symfive.machine import preset, read_machine, write_machine
from symfive.model import read_model, write_model
from symfive.procedures import campaign_of, r_test_grid
from symfive.simulate import simulate

MACHINE = preset("oyama-2010")
PLAN = campaign_of(MACHINE, r_test_grid(MACHINE, step_deg=120.0))
MEASURED = simulate(PLAN, seed=1).campaign


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("written")
    write_campaign(PLAN, folder / "plan")
    write_campaign(MEASURED, folder / "measured")
    write_machine(MACHINE, folder / "machine.toml")
    (folder / "ccw.csv").write_text("angle,deviation\n" + "".join(f"{a},{a % 3}\n" for a in range(0, 360, 2)))
    return folder


@pytest.fixture
def here(written, tmp_path, monkeypatch) -> Path:
    """A copy of one's own of what is written once, and this as the working folder."""
    shutil.copytree(written, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(capsys, *words: str) -> str:
    assert cli.main(list(words)) == 2
    said = capsys.readouterr().err
    assert "Traceback" not in said and len(said) <= 1000
    return said


PLAN_WORDS = ["plan", "table-bc", "-o", "out"]
POLAR = ["import-polar", "three-axis", "ccw.csv", "-o", "out", "--radius", "100", "--feed", "1000"]


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e308", "1e-300", "-1", "0", "x", ""])
@pytest.mark.parametrize(
    "words",
    [
        [*PLAN_WORDS, "--minutes"],
        [*PLAN_WORDS, "--bar"],
        [*PLAN_WORDS, "--noise-um"],
        [*POLAR, "--feed"],
        [*POLAR, "--radius"],
        [*POLAR, "--noise-um"],
        ["diagnose", "measured", "-o", "out", "--false-alarms"],
    ],
)
def test_an_option_takes_no_number_that_no_machine_has(here, capsys, words, value):
    refused(capsys, *words, value)
    assert not (here / "out").exists()


@pytest.mark.parametrize("option", ["--count", "--points", "--starts", "--setups", "--repeats", "--returns"])
def test_no_count_is_endless(here, capsys, option):
    assert option in refused(capsys, *PLAN_WORDS, option, "1000000000")


def test_more_workers_than_a_computer_has_processes(here, capsys):
    refused(capsys, "fleet", "measured", "-o", "out", "--workers", "1000000000")
    with pytest.raises(InputError, match="workers are more than"):
        executor(10**9)


@pytest.mark.parametrize("value", ["1e300", "-1e13", "9" * 400])
def test_a_reading_that_nothing_measured(here, value):
    table = here / "measured" / PLAN.runs[0].file
    lines = table.read_text().split("\n")
    lines[3] = ",".join([*lines[3].split(",")[:-1], value])
    table.write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"line 4, column \d+.*(beyond|not a finite)"):
        read_campaign("measured")


@pytest.mark.parametrize("value", ["1e308", "1e13", "9" * 400])
def test_a_machine_file_with_such_a_number(here, value):
    path = here / "machine.toml"
    path.write_text(path.read_text().replace("sigma = ", f"sigma = {value} # ", 1))
    if "sigma = " not in path.read_text():
        pytest.fail("the file has no sigma")
    path.write_text(f'schema = "symfive.machine/1"\nstructure = "w b X t"\n[axes.X]\ntravel = [0.0, {value}]\n')
    with pytest.raises(InputError, match="line 4"):
        read_machine(path)


def test_a_model_with_such_a_value(here):
    write_model(fitted_model(identify(MEASURED)), here / "model.json")
    text = (here / "model.json").read_text()
    for key in ("value", "std"):
        begin = text.index(f'"{key}": ') + len(key) + 4
        end = min(text.index(mark, begin) for mark in ",\n}")
        (here / "bad.json").write_text(f"{text[:begin]}1e308{text[end:]}")
        with pytest.raises(InputError, match="not a number within"):
            read_model(here / "bad.json")


@pytest.mark.parametrize(
    "damage",
    [
        lambda matrix: matrix[0].__setitem__(0, -1.0),
        lambda matrix: matrix[0].__setitem__(1, 1e6),
        lambda matrix: [matrix[i].__setitem__(1 - i, 1e6) for i in (0, 1)],
        lambda matrix: matrix[0].pop(),
        lambda matrix: matrix[0].__setitem__(0, "x"),
    ],
    ids=["negative", "uneven", "correlated", "ragged", "text"],
)
def test_a_model_whose_covariance_is_none(here, damage):
    write_model(fitted_model(identify(MEASURED)), here / "model.json")
    data = json.loads((here / "model.json").read_text())
    damage(data["covariance"]["matrix"])
    (here / "bad.json").write_text(json.dumps(data))
    with pytest.raises(InputError, match="its covariance is not one of its parameters"):
        read_model(here / "bad.json")


@pytest.mark.parametrize("name", ["EX0Q", "EY0C", "EXC.cos9", "backlash.C.width", "nonsense"])
def test_a_model_with_a_parameter_that_nothing_has(here, name):
    """Predictions and corrections would leave it out without a word."""
    machine = replace(MEASURED.machine, errors={k: e for k, e in MEASURED.machine.errors.items() if k != "EY0C"})
    write_model(fitted_model(identify(replace(MEASURED, machine=machine))), here / "model.json")
    assert read_model(here / "model.json").names
    data = json.loads((here / "model.json").read_text())
    data["parameters"][name] = {"value": 1.0, "std": 0.1, "unit": "um"}
    (here / "bad.json").write_text(json.dumps(data))
    with pytest.raises(InputError, match=f"bad.json: parameter .*{name}.* belongs to no error"):
        read_model(here / "bad.json")


@pytest.mark.parametrize("content", [b"", b"x", b"MATLAB 5.0 MAT-file" + bytes(109), bytes(range(256)) * 8])
def test_a_damaged_mat_file(here, content):
    (here / "emps").mkdir()
    (here / "emps" / "DATA_EMPS.mat").write_bytes(content)
    with pytest.raises(InputError, match="MAT file"):
        emps(here / "emps")


def test_a_structure_of_three_thousand_axes(here, capsys):
    axes = " ".join(f"J{n}" for n in range(3000))
    (here / "long.toml").write_text(f'schema = "symfive.machine/1"\nstructure = "w b {axes} t"\n')
    said = refused(capsys, "plan", "long.toml", "-o", "out")
    assert "3000 axes" in said and len(said) <= 800


def test_no_sentence_is_longer_than_800_characters_and_it_keeps_its_remedy():
    error = InputError("a" * 70_000, path="p/" * 2000, line=3, remedy="write " + "b" * 9000 + " end")
    assert len(str(error)) <= 800 and str(error).startswith("p/") and str(error).endswith("bb end.")


@pytest.mark.parametrize("effect", ['"__import__"', '"backlash", axis = "Q"', '"backlash", axis = "C", width = 3', "3"])
def test_check_refuses_the_effects_that_other_verbs_refuse(here, capsys, effect):
    for path in (here / "machine.toml", here / "measured" / "machine.toml"):
        path.write_text(f"{path.read_text()}\n[model]\neffects = [{{ effect = {effect} }}]\n")
    refused(capsys, "identify", "measured", "-o", "out")
    assert not check("measured").right
    assert cli.main(["check", "measured"]) == 1
    if "Q" not in effect:
        assert not check("machine.toml").right


def test_a_folder_named_like_a_preset_hides_nothing(here, capsys):
    (here / "table-bc").mkdir()
    write_model(fitted_model(identify(MEASURED)), here / "table-bc" / "model.json")
    said = refused(capsys, "codegen", "table-bc", "-o", "out")
    assert "ready-made machine and a folder here" in said and "./table-bc" in said
    assert "ready-made machine and a folder" in refused(capsys, *PLAN_WORDS)
    assert machine_or_model_given("./table-bc").names
    shutil.rmtree(here / "table-bc")
    shutil.copy(here / "machine.toml", here / "table-bc")
    with pytest.raises(InputError, match="a file here"):
        machine_given("table-bc")
    assert machine_given("./table-bc").name == MACHINE.name
    assert machine_given("oyama-2010").name == MACHINE.name
    with pytest.raises(InputError, match="measured: this is a folder, not a file"):
        machine_given("measured")
    with pytest.raises(InputError, match="'machin' is neither a file nor a ready-made machine; name a machine file"):
        machine_given("machin")


def test_a_fleet_from_the_root_by_its_other_name(here, capsys):
    """POSIX lets // be another place than /, and pathlib keeps the two apart."""
    assert "campaign.toml" in refused(
        capsys, "fleet", "measured", "//", "-o", "out", "--workers", "0", "--no-figures", "-q"
    )


def test_what_failed_in_a_fleet_goes_to_standard_error(here, capsys):
    (here / "measured" / "campaign.toml").write_text("x")
    assert cli.main(["fleet", "measured", "-o", "out", "--workers", "0"]) == 2
    said = capsys.readouterr()
    assert "failed" not in said.out and said.err.startswith("symfive: measured: failed: ")


def test_a_name_of_5000_characters_makes_no_long_line(here, capsys):
    assert cli.main(["fleet", "measured", "a" * 5000, "-o", "out", "--workers", "0", "--no-figures"]) == 2
    assert max(map(len, capsys.readouterr().err.splitlines())) <= 1000


@pytest.mark.parametrize("words", [["check", "x", "a" * 5000], ["check", "x", "--" + "a" * 5000]])
def test_a_word_of_5000_characters_makes_no_long_line(here, capsys, words):
    said = refused(capsys, *words)
    assert len(said) <= 820 and said.endswith("see `symfive check --help`.\n")


@pytest.mark.parametrize(
    "words", [["check", "\0"], ["assess", "plan", "--given", "\0"], ["simulate", "plan", "-o", "\0"]]
)
def test_no_file_has_a_nul_in_its_name(here, capsys, words):
    assert "cannot be the name of a file" in refused(capsys, *words)


@pytest.mark.parametrize(("seed", "count"), [(7, 25), pytest.param(8, 300, marks=pytest.mark.slow)])
def test_random_calls_end_in_a_result_or_a_sentence(here, seed, count):
    """A sample; `python -m tests.fuzz.verbs 10000` makes as many as one likes."""
    calls = Calls(here, random.Random(seed))
    for _ in range(count):
        calls.one()
    assert not calls.wrong, calls.wrong
