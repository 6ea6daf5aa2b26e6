"""The index: a mirror of the records, whatever order, however many writers; names, migrations, damage, clocks."""

import hashlib
import json
import multiprocessing
import os
import sqlite3
import time
from pathlib import Path

import pytest
from history_world import results

from symfive.errors import InputError
from symfive.history import Details, History, instant, read_record, rebuilt, taken
from symfive.history._schema import MIGRATIONS, NEWEST  # indices of older versions

DATES = ("2026-01-05", "2026-02-02", "2026-03-02")


@pytest.fixture
def world(tmp_path: Path) -> Path:
    """Three results of one machine in the history."""
    with History(tmp_path / "history", create=True) as history:
        for number, date in enumerate(DATES):
            folder = results(tmp_path / "results" / f"r{number}", number)
            history.add(folder, Details(time=instant(date), operator="Eve", temperature=21.5, instrument="R-test"))
    return tmp_path


def digest(world: Path) -> str:
    with History(world / "history") as history:
        return history.digest()


def forget(world: Path) -> None:
    for file in (world / "history").glob("index.sqlite*"):
        file.unlink()


def test_a_rebuilt_index_equals_the_lost_one(world):
    with History(world / "history") as history:
        history.event("plant", "new spindle", kind="repair", when=instant("2026-02-01"))
    before = digest(world)
    forget(world)
    found = rebuilt(world / "history", [world / "results"])
    assert (found.count, found.problems) == (3, ()) and digest(world) == before
    with History(world / "history") as history:
        visits = history.visits("plant")
        assert [v.date for v in visits] == list(DATES) and {v.operator for v in visits} == {"Eve"}
        assert [e.text for e in history.events("plant")] == ["new spindle"]


def test_who_may_not_write_may_read(world, monkeypatch):
    def files() -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in (world / "history").iterdir()}

    monkeypatch.setattr("os.access", lambda path, mode, **_: mode != os.W_OK)  # root may always write
    before = files()
    with History(world / "history") as history:
        assert [v.date for v in history.visits("plant")] == list(DATES)
        assert "plant" in history.machine_page("plant") and "plant" in history.fleet_page()
        with pytest.raises(InputError, match=r"cannot be written.*rights"):
            history.event("plant", "new spindle", kind="repair")
        assert files() == before


def test_what_is_said_is_kept_in_the_record_and_can_be_amended(world):
    folder = world / "results" / "r1"
    record = read_record(folder)
    assert (record.temperature, record.instrument, record.stage) == (21.5, "R-test", "")
    with History(world / "history") as history:
        history.add(folder, Details(stage="as-found"))
        again = history.visits("plant")
    assert (again[1].stage, again[1].operator, again[1].date) == ("as-found", "Eve", DATES[1]) and len(again) == 3


def test_adding_again_changes_nothing(world):
    before = digest(world)
    with History(world / "history") as history:
        history.add(world / "results")
    assert digest(world) == before


def test_the_same_results_in_two_folders_are_counted_once(world):
    results(world / "results" / "copy", 1)
    with History(world / "history") as history:
        added = history.add(world / "results" / "copy", Details(time=instant(DATES[1])))
        assert any("counted once" in note for note in added.notes)
        assert len(history.visits("plant")) == 3
        assert len(history.folders("plant")) == 3
    before = digest(world)
    forget(world)
    rebuilt(world / "history", [world])
    assert digest(world) == before


def test_results_that_were_replaced_are_found_out(world):
    folder = world / "results" / "r2"
    manifest = {"schema": "symfive.manifest/1", "command": "x", "inputs": {}, "outputs": {}, "to_edit": {}}
    for name in ("model.json", "identification.json"):
        manifest["outputs"][name] = hashlib.sha256((folder / name).read_bytes()).hexdigest()
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with History(world / "history") as history:
        history.add(folder)
    (folder / "manifest.json").write_text(json.dumps({**manifest, "command": "y"}))
    found = rebuilt(world / "history", [world / "results"])
    assert found.count == 2 and str(folder) in found.problems[0]
    assert "were replaced since they were added" in found.problems[0]
    with History(world / "history") as history:
        history.add(folder)
        assert len(history.visits("plant")) == 3


def test_results_of_today_need_no_priors_in_them(tmp_path):
    folder = results(tmp_path / "r", 1)
    data = json.loads((folder / "identification.json").read_text())
    for entry in data["parameters"].values():
        del entry["prior"], entry["prior_mean"]
    (folder / "identification.json").write_text(json.dumps(data))
    visit = taken(folder, Details())
    assert visit.priors[visit.names.index("EX0C")] == 50.0 and visit.priors[visit.names.index("EA0C")] == 100.0


# --- names --------------------------------------------------------------------------------------------------------


def test_two_machines_of_one_name_are_kept_apart_by_their_serials(world):
    with History(world / "history") as history:
        added = history.add(results(world / "results" / "twin", 9), Details(serial="A17", time=instant("2026-01-01")))
        assert any('another machine is called "plant"' in note and "A17" in note for note in added.notes)
        with pytest.raises(InputError, match=r"2 machines have the name 'plant'.*name it by NAME#SERIAL"):
            history.machine("plant")
        assert len(history.visits("plant#A17")) == 1
        assert len(history.visits(history.machine(next(m.key for m in history.machines() if not m.serial)))) == 3
        with pytest.raises(InputError, match="no machine 'nobody'; it knows: plant"):
            history.machine("nobody")


def test_a_visit_that_turns_out_to_be_of_another_machine_moves(world):
    with History(world / "history") as history:
        history.add(world / "results" / "r0", Details(serial="B2"))
        assert len(history.visits("plant#B2")) == 1 and len(history.machines()) == 2
        for number in (1, 2):
            history.add(world / "results" / f"r{number}", Details(serial="B2"))
        assert [m.serial for m in history.machines()] == ["B2"]  # the nameless one has no visits left


# --- clocks -------------------------------------------------------------------------------------------------------


def test_the_order_is_that_of_the_dates_whenever_they_were_added(world):
    with History(world / "history") as history:
        history.add(results(world / "results" / "older", 7), Details(time=instant("2025-06-01")))
        assert [v.date for v in history.visits("plant")] == ["2025-06-01", *DATES]


def test_a_clock_that_goes_backwards_is_of_no_consequence(world, monkeypatch):
    before = digest(world)
    monkeypatch.setattr(time, "time", lambda: 0.0)
    with History(world / "history") as history:
        added = history.add(world / "results" / "r2")
    assert digest(world) == before and any("in the future" in note for note in added.notes)


def test_of_one_day_as_found_comes_first(tmp_path):
    with History(tmp_path / "history", create=True) as history:
        for number, stage in enumerate(("as-left", "as-found")):
            history.add(results(tmp_path / f"r{number}", number), Details(time=instant("2026-01-05"), stage=stage))
        assert [v.stage for v in history.visits("plant")] == ["as-found", "as-left"]


def test_dates():
    assert instant("2026-03-04") == instant("2026-03-04T00:00:00Z") == instant("2026-03-04T01:00+01:00")
    for wrong in ("yesterday", "2026-13-01", "04.03.2026", ""):
        with pytest.raises(InputError, match="is not a date; write 2026-03-04"):
            instant(wrong)


# --- versions and damage ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", range(NEWEST))
def test_an_older_index_is_brought_up_to_date(world, version):
    """One as version `version` would have left it, filled through its own tables."""
    before = digest(world)
    with sqlite3.connect(world / "history" / "index.sqlite") as new:
        visits, machines = (new.execute(f"SELECT * FROM {table}").fetchall() for table in ("visits", "machines"))
    new.close()
    forget(world)
    old = sqlite3.connect(world / "history" / "index.sqlite", isolation_level=None)
    for number in range(version):
        old.executescript(MIGRATIONS[number])
    old.execute(f"PRAGMA user_version = {version}")
    if version:
        old.executemany("INSERT INTO visits VALUES (?, ?, ?, ?, ?, ?)", visits)
    if version > 1:
        old.executemany("INSERT INTO machines VALUES (?, ?, ?, ?, ?)", machines)
    old.close()
    with History(world / "history") as history:
        if version:
            assert [m.name for m in history.machines()] == ["plant"] and len(history.visits("plant")) == 3
        history.add(world / "results")
    assert digest(world) == before


def test_an_index_of_a_newer_symfive_is_refused(world):
    with sqlite3.connect(world / "history" / "index.sqlite") as index:
        index.execute(f"PRAGMA user_version = {NEWEST + 1}")
    index.close()
    with pytest.raises(InputError, match=f"version {NEWEST + 1}, this symfive knows {NEWEST}; use the newer symfive"):
        History(world / "history")


def test_a_damaged_index_is_said_put_aside_and_rebuilt(world):
    before = digest(world)
    for file in (world / "history").glob("index.sqlite*"):
        file.unlink() if file.name != "index.sqlite" else file.write_bytes(b"junk" * 2000)
    with pytest.raises(InputError, match=r"the index is damaged.*rebuild it"), History(world / "history"):
        pass
    rebuilt(world / "history", [world / "results"])
    assert digest(world) == before and (world / "history" / "index.sqlite.damaged").is_file()


@pytest.mark.parametrize("change", [("machines", "state", "{"), ("machines", "state", '{"rms": "x"}'), ("visits", "record", "[]"),
                                    ("machines", "state", '{"open": 1, "alarms": [{"kind": "odd"}]}')])  # fmt: skip
def test_what_the_index_cannot_mean_is_damage(world, change):
    table, column, text = change
    before = digest(world)
    with sqlite3.connect(world / "history" / "index.sqlite") as index:
        index.execute(f"UPDATE {table} SET {column} = ?", (text,))
    index.close()
    with pytest.raises(InputError, match=r"the index is damaged.*rebuild it"), History(world / "history") as history:
        history.fleet() if table == "machines" else history.visits(history.machines()[0])
    rebuilt(world / "history", [world / "results"])
    assert digest(world) == before


def test_damage_that_sqlite_cannot_spell_is_a_sentence(world):
    index = world / "history" / "index.sqlite"
    data = index.read_bytes()
    assert data.count(b"CREATE TABLE") >= 4
    index.write_bytes(data.replace(b"CREATE TABLE", b"CREATE \x87\x87\x87LE"))
    with pytest.raises(InputError, match=r"the index is damaged.*rebuild it"), History(world / "history") as history:
        history.fleet()
    before = [p.name for p in (world / "results").iterdir()]
    assert rebuilt(world / "history", [world / "results"]).count == len(before)


def test_a_history_that_is_not_there_is_said(tmp_path):
    with pytest.raises(InputError, match=r"there is no history; add results.* rebuild a lost index"):
        History(tmp_path / "history")


@pytest.mark.parametrize(
    "spoil", [
        lambda data: data.update(schema="other"), lambda data: data.pop("names"), lambda data: data["values"].append(1.0),
        lambda data: data.update(when="never"), lambda data: data.update(stage="later"),
        lambda data: data.update(covariance=[1.0, 2.0]),
        lambda data: data["values"].__setitem__(0, 1e300), lambda data: data.update(results="../x"),
    ],
)  # fmt: skip
def test_a_damaged_record_is_a_sentence_and_stops_no_other(world, spoil):
    path = world / "results" / "r1" / "visit.json"
    data = json.loads(path.read_text())
    spoil(data)
    path.write_text(json.dumps(data))
    found = rebuilt(world / "history", [world / "results"])
    assert found.count == 2 and len(found.problems) == 1 and str(path) in found.problems[0]
    path.write_text("{")
    assert rebuilt(world / "history", [world / "results"]).count == 2


# --- many writers -------------------------------------------------------------------------------------------------


def write(world: Path, number: int) -> None:
    with History(world / "history", create=True) as history:
        for extra in range(3):
            history.add(
                results(world / "results" / f"w{number}-{extra}", 100 + 10 * number + extra),
                Details(time=1e9 + number * 1e6 + extra),
            )


def test_many_writers_lose_nothing(world):
    context = multiprocessing.get_context("fork" if os.name == "posix" else "spawn")
    writers = [context.Process(target=write, args=(world, number)) for number in range(4)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert [writer.exitcode for writer in writers] == [0] * 4
    before = digest(world)
    with History(world / "history") as history:
        assert len(history.visits("plant")) == 15
    forget(world)
    assert rebuilt(world / "history", [world / "results"]).count == 15 and digest(world) == before
