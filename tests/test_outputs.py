"""Results are one thing: inputs stay, a folder is replaced whole or not at all, its manifest binds it, two writers are told."""

import json
import multiprocessing
import os
import py_compile
import shutil
from pathlib import Path

import pytest

import symfive.cli as cli
from symfive.campaign import read_campaign, write_campaign
from symfive.errors import InputError
from symfive.files import read_text
from symfive.identify import fitted_model, identify
from symfive.machine import preset
from symfive.model import read_model, write_model
from symfive.outputs import MANIFEST, output_file, output_folder, write_json, write_text
from symfive.procedures import campaign_of, r_test_grid
from symfive.simulate import simulate

MACHINE = preset("oyama-2010")
PLAN = campaign_of(MACHINE, r_test_grid(MACHINE, step_deg=90.0))
MEASURED = simulate(PLAN, seed=1).campaign


def tree(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def fitted():
    return fitted_model(identify(MEASURED))


@pytest.fixture(scope="module")
def written(tmp_path_factory, fitted):
    """A plan, readings made by hand (no manifest), a model."""
    folder = tmp_path_factory.mktemp("written")
    write_campaign(PLAN, folder / "plan")
    write_campaign(MEASURED, folder / "byhand")
    (folder / "byhand" / MANIFEST).unlink()
    (folder / "model").mkdir()
    write_model(fitted, folder / "model" / "model.json")
    (folder / "probe.xml").write_text("<MTConnectDevices/>")
    (folder / "ccw.csv").write_text("angle,deviation\n" + "".join(f"{a},{a % 3}\n" for a in range(0, 360, 2)))
    return folder


@pytest.fixture
def here(written, tmp_path, monkeypatch):
    """A copy of one's own of what is written once, and this as the working folder."""
    shutil.copytree(written, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(capsys, *words: str) -> tuple[int, str]:
    capsys.readouterr()
    return cli.main(list(words)), capsys.readouterr().err


# --- inputs are never outputs -------------------------------------------------------------------------------------


@pytest.mark.parametrize("more", [[], ["--overwrite"]])
@pytest.mark.parametrize(
    "words",
    [
        ["predict", "model", "byhand", "-o", "byhand"],
        ["predict", "model", "byhand", "-o", "model"],
        ["simulate", "byhand", "-o", "byhand"],
        ["simulate", "plan", "-o", "plan"],
        ["simulate", "plan", "-o", "./plan/../plan/"],
        ["simulate", "plan", "-o", "byhand"],
        ["simulate", "plan", "-o", "."],
        ["simulate", "plan", "-o", "/"],
        ["simulate", "plan", "-o", "link"],
        ["identify", "byhand", "-o", "byhand"],
        ["codegen", "model", "-o", "model"],
        ["plan", "table-bc", "-o", "byhand"],
    ],
)
def test_no_verb_writes_where_readings_or_inputs_lie(here, capsys, words, more):
    os.symlink("plan", here / "link")
    before = tree(here)
    code, said = run(capsys, *words, *more)
    assert (code == 2 and len(said.splitlines()) == 1 and "remove" in said) or "name" in said
    assert tree(here) == before


@pytest.mark.parametrize(
    "words",
    [
        ["import-mtconnect", "probe.xml", "-o", "probe.xml"],
        ["import-mtconnect", "probe.xml", "-o", "byhand/campaign.toml"],
        ["import-polar", "three-axis", "ccw.csv", "-o", "byhand", "--radius", "100", "--feed", "1000"],
        ["import-polar", "three-axis", "ccw.csv", "-o", "ccw.csv", "--radius", "100", "--feed", "1000"],
    ],
)
def test_no_import_writes_over_a_file_or_readings(here, capsys, words):
    before = tree(here)
    code, said = run(capsys, *words)
    assert code == 2 and ("exists" in said or "no manifest.json lists" in said)
    assert tree(here) == before


def test_an_input_inside_the_folder_to_be_replaced_is_refused(here, capsys):
    assert run(capsys, "simulate", "plan", "-o", "out", "-q")[0] == 0
    shutil.copytree("plan", "out/plan")
    before = tree(here)
    code, said = run(capsys, "simulate", "out/plan", "-o", "out", "--overwrite")
    assert code == 2 and "this input lies where the results would go" in said
    assert tree(here) == before


# --- replacing ----------------------------------------------------------------------------------------------------


def test_results_are_replaced_on_demand_and_other_files_stay(here, capsys):
    assert run(capsys, "simulate", "plan", "-o", "out", "--seed", "1", "-q")[0] == 0
    (here / "out" / "notes.txt").write_text("mine")
    (here / "out" / "sub").mkdir()
    os.symlink("../notes.txt", here / "out" / "sub" / "link")
    before = tree(here / "out")
    code, said = run(capsys, "simulate", "plan", "-o", "out", "--seed", "2")
    assert code == 2 and "--overwrite" in said and tree(here / "out") == before
    assert run(capsys, "simulate", "plan", "-o", "out", "--seed", "2", "--overwrite", "-q") == (0, "")
    assert json.loads((here / "out" / "truth.json").read_text())["seed"] == 2
    assert (here / "out" / "notes.txt").read_text() == "mine"
    assert os.readlink(here / "out" / "sub" / "link") == "../notes.txt"
    assert not [p for p in here.iterdir() if p.name.startswith(".")]


def test_a_plan_that_was_filled_in_is_not_replaced_and_is_read(here, capsys):
    filled, table = MEASURED.runs[0], here / "plan" / PLAN.runs[0].file
    shutil.copy(here / "byhand" / filled.file, table)
    assert read_campaign(here / "plan").runs[0].measured
    with pytest.raises(InputError, match="changed since symfive wrote it"):
        write_campaign(PLAN, here / "plan", overwrite=True)
    assert table.read_bytes() == (here / "byhand" / filled.file).read_bytes()


def test_recorded_readings_need_more_than_overwriting(here):
    def record() -> None:
        with output_folder(here / "recorded", overwrite=True, recorded=True) as folder:
            write_text(folder / "a.csv", read_text(here / "ccw.csv"))

    record()
    record()  # nothing is lost: the source is there
    (here / "ccw.csv").unlink()
    with pytest.raises(InputError, match="readings lie there whose source is gone"):
        record()
    assert (here / "recorded" / "a.csv").exists()


def test_a_file_of_the_users_with_a_results_name_stays(here):
    with output_folder(here / "o") as folder:
        write_text(folder / "a.txt", "1")
    (here / "o" / "b.txt").write_text("mine")
    with pytest.raises(InputError, match="a file of yours"), output_folder(here / "o", overwrite=True) as folder:
        write_text(folder / "b.txt", "2")
    assert {k: v for k, v in tree(here / "o").items() if k != MANIFEST} == {"a.txt": b"1", "b.txt": b"mine"}


def test_pythons_caches_of_replaced_results_are_left_behind(here):
    """Same size, same second: Python takes the old byte code for that of the new file."""

    def written(text: str) -> None:
        with output_folder(here / "o", overwrite=True) as folder:
            write_text(folder / "sub" / "made.py", text)

    written("x = 1\n")
    made = here / "o" / "sub" / "made.py"
    py_compile.compile(str(made))
    (made.parent / "notes.txt").write_text("mine")
    assert list(here.glob("o/sub/__pycache__/*.pyc"))
    written("x = 2\n")
    assert set(tree(here / "o")) == {"sub/made.py", "sub/notes.txt", MANIFEST}


def test_results_of_a_version_without_manifests_are_moved_away_by_hand(here, capsys):
    words = ["identify", "byhand", "-o", "r", "--no-figures", "-q"]
    assert run(capsys, *words)[0] == 0
    (here / "r" / MANIFEST).unlink()
    before = tree(here / "r")
    for more in ([], ["--overwrite"]):
        code, said = run(capsys, *words, *more)
        assert code == 2 and tree(here / "r") == before
        assert said.endswith(
            ": the folder holds files that no manifest.json lists, as identification.json: yours, or results of an older "
            "version; move the folder away yourself, or name another.\n"
        )
    os.rename("r", "r-before")
    assert run(capsys, *words) == (0, "")


def test_the_folder_that_one_is_in_is_not_swapped_away(here, monkeypatch):
    (here / "empty").mkdir()
    monkeypatch.chdir(here / "empty")
    with pytest.raises(InputError, match="the folder that you are in"), output_folder(Path(".")):
        raise AssertionError


# --- the manifest -------------------------------------------------------------------------------------------------


def test_the_manifest_binds_inputs_outputs_version_and_command(here, capsys):
    assert run(capsys, "identify", "byhand", "-o", "r", "--no-figures", "-q")[0] == 0
    data = json.loads((here / "r" / MANIFEST).read_text())
    assert data["command"] == "symfive identify byhand -o r --no-figures -q"
    assert set(data["inputs"]) == {f"byhand/{n}" for n in tree(here / "byhand")}
    assert set(data["outputs"]) == {"identification.json", "model.json"} and data["to_edit"] == {}
    plan = json.loads((here / "plan" / MANIFEST).read_text())
    assert plan["outputs"] == {} and set(plan["to_edit"]) == set(tree(here / "plan")) - {MANIFEST}


def test_what_came_with_symfive_is_no_input(here, capsys):
    """Else readings could not be replaced after symfive moved, since their source would be gone."""
    (here / "a.csv").write_text("angle,deviation\n" + "".join(f"{a},{a % 3}\n" for a in range(0, 360, 4)))
    words = ["import-polar", "three-axis", "a.csv", "-o", "polar", "--radius", "100", "--feed", "1000"]
    for more in ((), ("--overwrite",)):  # also where the machine is read for the first time
        assert run(capsys, *words, *more)[0] == 0
        assert list(json.loads((here / "polar" / MANIFEST).read_text())["inputs"]) == ["a.csv"]


def test_a_mixture_of_two_results_is_refused_with_the_remedy(here, capsys):
    for number in (1, 2):
        assert run(capsys, "simulate", "plan", "-o", f"m{number}", "--seed", str(number), "-q")[0] == 0
        assert run(capsys, "identify", f"m{number}", "-o", f"r{number}", "--no-figures", "-q")[0] == 0
    shutil.copy("r2/model.json", "r1/model.json")
    code, said = run(capsys, "predict", "r1", "m1", "-o", "p")
    assert code == 2 and "not the file that" in said and "symfive identify m1 -o r1" in said and "delete" in said
    (here / "r1" / MANIFEST).unlink()
    read_model(here / "r1")  # a folder without a manifest is read as it is
    name = PLAN.runs[0].file
    shutil.copy(f"m2/{name}", f"m1/{name}")
    with pytest.raises(InputError, match="not the file that"):
        read_campaign("m1")
    shutil.copy("r2/model.json", "m2/model.json")
    with pytest.raises(InputError, match="not the file that"):
        read_model("m2")


def test_a_long_table_is_bound_as_a_short_one(here, monkeypatch):
    monkeypatch.setattr("symfive.campaign._csv.BLOCK_BYTES", 200)
    assert cli.main(["simulate", "plan", "-o", "m", "-q"]) == 0
    read_campaign(here / "m")
    table = here / "m" / PLAN.runs[0].file
    table.write_text(table.read_text() + "\n")
    with pytest.raises(InputError, match="not the file that"):
        read_campaign(here / "m")


@pytest.mark.parametrize(
    "text", ["{", '{"schema": "symfive.manifest/1"}', '{"schema": "symfive.manifest/1", "command": 3}']
)
def test_a_damaged_manifest_is_said_and_somebody_elses_is_not_ours(here, text):
    write_campaign(MEASURED, here / "m")
    (here / "m" / MANIFEST).write_text(text)
    with pytest.raises(InputError, match="the manifest is damaged"):
        read_campaign(here / "m")
    (here / "m" / MANIFEST).write_text('{"name": "a web page"}')
    assert read_campaign(here / "m").measured


# --- crashes, interruptions, two writers --------------------------------------------------------------------------


def test_what_a_crash_left_is_cleaned_by_the_next_call(here):
    with output_folder(here / "o") as folder:
        write_text(folder / "a", "old")
    os.rename(here / "o", here / ".o.before")  # killed between the two renames of a system that cannot exchange
    (here / ".o.writing").mkdir()
    (here / ".o.writing" / "a").write_text("half")
    (here / ".o.lock").touch()
    with pytest.raises(InputError, match="--overwrite"), output_folder(here / "o"):
        raise AssertionError
    assert tree(here / "o")["a"] == b"old"
    assert not [p for p in here.iterdir() if p.name.startswith(".")]


def test_an_interruption_says_what_is_left(here, capsys, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("symfive.results.write_model", interrupted)
    code, said = run(capsys, "identify", "byhand", "-o", "a/b/r", "--no-figures")
    assert code == 130 and said == f"\nsymfive: interrupted; nothing was written to {here / 'a/b/r'}.\n"
    assert not (here / "a").exists()
    monkeypatch.undo()
    monkeypatch.chdir(here)
    monkeypatch.setattr("shutil.rmtree", interrupted)  # after the swap
    assert run(capsys, "simulate", "plan", "-o", "o", "-q")[0] in (0, 130)
    assert read_campaign("o").measured


def hold(path: str, ready, go) -> None:
    with output_folder(Path(path)) as folder:
        write_text(folder / "a", "first")
        ready.set()
        go.wait(30)


def test_of_two_writers_one_is_told(here):
    context = multiprocessing.get_context("spawn")
    ready, go = context.Event(), context.Event()
    process = context.Process(target=hold, args=(str(here / "o"), ready, go))
    process.start()
    try:
        assert ready.wait(30)
        with pytest.raises(InputError, match="another process is writing there"), output_folder(here / "o"):
            raise AssertionError
    finally:
        go.set()
        process.join()
    assert tree(here / "o")["a"] == b"first"
    assert not (here / ".o.lock").exists()


def test_a_file_is_written_whole_and_never_over_another(here, monkeypatch):
    with output_file(here / "m.toml") as path:
        write_text(path, "x = 1\n")
    assert (here / "m.toml").read_text() == "x = 1\n"
    with pytest.raises(InputError, match="exists"), output_file(here / "m.toml"):
        raise AssertionError
    write_json(here / "j.json", {"a": 1})
    monkeypatch.setattr("os.write", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left")))
    with pytest.raises(InputError, match="No space left"):
        write_json(here / "j.json", {"a": 2})
    assert json.loads((here / "j.json").read_text()) == {"a": 1}
    assert not [p for p in here.iterdir() if p.name.startswith(".")]


def test_without_an_exchange_two_renames_do(here, monkeypatch):
    monkeypatch.setattr("symfive.outputs._place.exchanged", lambda *_: False)
    for text in ("1", "2"):
        with output_folder(here / "o", overwrite=True) as folder:
            write_text(folder / "a", text)
    assert tree(here / "o")["a"] == b"2" and not [p for p in here.iterdir() if p.name.startswith(".")]
