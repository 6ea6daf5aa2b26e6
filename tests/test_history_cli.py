"""`symfive history` as its user meets it, and the whole way from the independent plant's files to the alarm."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from history_world import results
from plant.campaign import write_campaign
from plant.visits import Test as PlantTest
from plant.visits import life

from symfive import cli
from symfive.history import Details, History


@pytest.fixture
def said(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(*words: object) -> tuple[int, str, str]:
        capsys.readouterr()
        code = cli.main(["history", *map(str, words)])
        found = capsys.readouterr()
        return code, found.out, found.err

    return run


def test_from_results_to_pages(said, tmp_path):
    for number, date in enumerate(("2026-01-05", "2026-02-02", "2026-03-02")):
        folder = results(tmp_path / "results" / f"r{number}", number)
        code, out, err = said("add", folder, "--date", date, "--temperature", 21, "--operator", "Eve", "--as-found")
        assert (code, err) == (0, "") and date in out
    code, out, _ = said("show", "plant", "--since", "2026-02-02", "--tolerance", "EX0C=100")
    assert code == 0 and "plant: 3 visits" in out and "From 2026-02-02 to 2026-03-02" in out and "EX0C" in out
    data = json.loads(said("show", "plant", "--since", "2026-02-10", "--json")[1])
    assert data["schema"] == "symfive.trend/1" and data["change"]["from"].startswith("2026-02-02")
    assert said("event", "plant", "new spindle", "--kind", "repair", "--date", "2026-02-20")[0] == 0
    assert (
        said("show", "plant", "-o", "page")[0] == 0
        and "new spindle" in (tmp_path / "page" / "history.html").read_text()
    )
    assert said("show", "plant", "-o", "page")[0] == 2 and said("show", "plant", "-o", "page", "--overwrite")[0] == 0
    code, out, _ = said("fleet", "-o", "pages")
    assert code == 0 and "history of 1 machine" in out and (tmp_path / "pages" / "fleet.html").is_file()
    assert json.loads(said("fleet", "--json")[1])["machines"][0]["visits"] == 3
    assert said("rebuild", "results")[1] == "3 records in history\n"
    assert said("show", "plant")[0] == 0


def test_the_table_for_others(said, tmp_path):
    results(tmp_path / "r", 1, name="=1+1")
    said("add", "r", "--date", "2026-01-05", "--note", "@x")
    code, out, _ = said("export", "-o", "t.csv")
    rows = list(csv.DictReader((tmp_path / "t.csv").read_text().splitlines()))
    assert (
        code == 0
        and out == f"{len(rows)} rows in t.csv\n"
        and rows[0]["machine"] == "'=1+1"
        and rows[0]["note"] == "'@x"
    )
    assert float(rows[0]["std"]) == pytest.approx(0.3) and rows[0]["when"] == "2026-01-05T00:00:00Z"
    for name in ("t.xlsx", "t"):
        code, _, problem = said("export", "-o", name)
        assert code == 2 and f"{name}: " in problem and "writing" not in problem
    parquet = pytest.importorskip("pyarrow.parquet", reason="Skipped (optional): pyarrow is not installed.")
    assert said("export", "-o", "t.parquet")[0] == 0
    table = parquet.read_table(tmp_path / "t.parquet")
    assert table.num_rows == len(rows) and table["value"].to_pylist() == pytest.approx(
        [float(r["value"]) for r in rows]
    )
    assert table["machine"].to_pylist()[0] == "=1+1"


@pytest.mark.parametrize(
    ("words", "sentence"), [
        (["add", "nowhere"], "there are no results"),
        (["add", "r", "--date", "soon"], "'soon' is not a date"),
        (["add", "r", "--temperature", "900"], "is not a number from"),
        (["add", "r", "--corrected", "EX0C"], "is not NAME=VALUE"),
        (["add", "r", "--corrected", "EX9Q=1"], "hold no 'EX9Q'"),
        (["show", "plant"], "there is no history"),
        (["fleet"], "there is no history"),
        (["rebuild", "nowhere"], "cannot be read"),
        (["event", "plant", "x"], "there is no history"),
        (["certificate", "r", "-o", "c.xml", "--country", "Germany"], "two capital letters"),
    ],
)  # fmt: skip
def test_what_a_user_can_get_wrong_is_one_sentence(said, tmp_path, words, sentence):
    results(tmp_path / "r")
    code, out, err = said(*words)
    assert code == 2 and out == "" and err.count("\n") == 1 and sentence in err and "Traceback" not in err


def test_one_date_cannot_hold_for_several_results(said, tmp_path):
    for number in range(2):
        results(tmp_path / "all" / f"r{number}", number)
    assert "add them one by one" in said("add", "all", "--date", "2026-01-05")[2]
    code, _, err = said("add", "all")
    assert code == 0 and err.count("dated") == 2 and "give --date" in err


def test_the_plants_step_is_measured_and_named(tmp_path: Path):
    """Visits as files of the independent plant, identified and added: a step of 20 µrad before the last one."""
    test = PlantTest.of("table-bc")
    lived = life(test, 3, np.random.default_rng(3), step=(2, "EA0C", 20.0), scatter=0.0)
    history = tmp_path / "history"
    for number, (truth, day) in enumerate(zip(lived.truth, lived.day, strict=True)):
        errors = dict(zip(test.names, map(float, truth), strict=True))
        write_campaign(tmp_path / f"c{number}", test.machine, test.runs, errors, seed=number)
        out = tmp_path / f"r{number}"
        assert cli.main(["identify", str(tmp_path / f"c{number}"), "-o", str(out), "--no-figures", "-q"]) == 0
        with History(history, create=True) as opened:
            opened.add(out, Details(time=1.7e9 + 86400.0 * day, temperature=float(lived.temperature[number])))
    with History(history) as opened:
        visits, change = opened.visits("plant"), opened.change("plant", since=1.7e9 + 86400.0 * lived.day[1])
    for visit, truth in zip(visits, lived.truth, strict=True):
        found = dict(zip(visit.names, zip(visit.values, visit.std, strict=True), strict=True))
        assert all(abs(found[n][0] - t) < 5.0 * found[n][1] for n, t in zip(test.names, truth, strict=True))
    true = dict(zip(test.names, lived.truth[2] - lived.truth[1], strict=True))
    assert all(abs(d - true[name]) < 5.0 * s for name, (d, s, _) in change.errors.items()) and len(change.errors) == 8
    assert "EA0C" in [cause.names[0] for cause in change.causes]
