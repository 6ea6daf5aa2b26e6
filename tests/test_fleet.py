"""A fleet of recorded machines: one folder of results each, one table of all, whatever fails or is killed in between."""

import csv
import io
import json
import os
import shutil
import signal
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lean import location_only
from processes import local_cluster

from symfive import cli
from symfive.campaign import write_campaign
from symfive.diagnose import diagnose
from symfive.errors import InputError
from symfive.executors import Processes, connect
from symfive.fleet import Fleet, fleet
from symfive.fleet import Row as FleetRow
from symfive.identify import identify
from symfive.machine import preset
from symfive.numbers import plain_number, with_std
from symfive.procedures import campaign_of, planar_circle, r_test_grid
from symfive.simulate import Simulation, simulate

MACHINES = 5


@pytest.fixture(scope="module")
def measured() -> list[Simulation]:
    """One plan, measured on several simulated machines."""
    machine = preset("oyama-2010")
    plan = campaign_of(machine, r_test_grid(machine, step_deg=90.0))
    return [simulate(plan, seed=number) for number in range(MACHINES)]


@pytest.fixture(scope="module")
def machines(measured: list[Simulation], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Their recordings, a folder each."""
    folder = tmp_path_factory.mktemp("recorded")
    for number, simulation in enumerate(measured):
        write_campaign(simulation.campaign, folder / f"m{number}")
    return folder


@pytest.fixture(scope="module")
def serial(machines: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of this process alone."""
    results = tmp_path_factory.mktemp("fleet") / "results"
    fleet([machines], results, figures=False)
    return results


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


# --- the table ---------------------------------------------------------------------------------------------
def test_the_table_says_what_identify_says(serial: Path, machines: Path, measured: list[Simulation]) -> None:
    rows = list(csv.DictReader((serial / "fleet.csv").read_text().splitlines()))
    assert [row["campaign"] for row in rows] == [f"m{number}" for number in range(MACHINES)]
    result = identify(measured[3].campaign)
    locations = [p for p in result.parameters if p.kind == "location_error"]
    assert locations
    for p in locations:
        assert float(rows[3][f"{p.name}_{p.unit}"]) == result[p.name]
        assert float(rows[3][f"{p.name}_std_{p.unit}"]) == result.uncertainty(p.name)
    assert float(rows[3]["rms"]) == result.rms_um
    assert rows[3]["rms_unit"] == "um"
    assert rows[3]["verdict"] == "explained"
    text = str(fleet([machines], serial, figures=False)).splitlines()
    assert len(text) == 1 + MACHINES
    assert "EX0C µm" in text[0]
    p = locations[0]
    shown = with_std(result[p.name], result.uncertainty(p.name))
    assert shown in text[4] and f"{plain_number(result.rms_um, 'um')} µm  " in text[4]


def test_every_machine_has_a_folder_as_identify_writes_it(serial: Path, machines: Path, tmp_path: Path) -> None:
    assert cli.main(["identify", str(machines / "m1"), "-o", str(tmp_path / "m1"), "--no-figures", "-q"]) == 0
    alone, among = contents(tmp_path / "m1"), contents(serial / "m1")
    for name in ("fleet-row.json", "manifest.json"):
        among.pop(name)
    alone.pop("manifest.json")
    assert among == alone


def test_what_is_not_explained_is_said(machines: Path, measured: list[Simulation], tmp_path: Path) -> None:
    noisy = measured[0].campaign
    generator = np.random.default_rng(1)
    runs = [
        run.with_readings({name: y + generator.normal(0.0, 1.0, y.size) for name, y in run.readings.items()})
        for run in noisy.runs
    ]
    write_campaign(replace(noisy, runs=tuple(runs)), tmp_path / "noisy")
    [row] = fleet([tmp_path / "noisy"], tmp_path / "results", figures=False).rows
    assert "times the declared noise" in row.verdict


def test_machines_of_several_kinds_share_a_table(machines: Path, tmp_path: Path) -> None:
    machine = location_only("three-axis")
    write_campaign(
        simulate(campaign_of(machine, planar_circle(machine, rate_hz=4.0)), seed=1).campaign, tmp_path / "a/b"
    )
    table = fleet([tmp_path / "a" / "b" / "campaign.toml", machines / "m0"], tmp_path / "results", figures=False)
    assert {"EX0C", "EC0Y"} & set(table.errors)
    assert len(set(table.errors) - set(table.rows[0].errors)) > 0
    assert [row.campaign.rsplit("/", 1)[-1] for row in table.rows] == ["b", "m0"]
    assert all((tmp_path / "results" / row.campaign / "identification.json").is_file() for row in table.rows)


def test_a_file_that_is_no_campaign_does_not_stand_for_its_folder(machines: Path, tmp_path: Path) -> None:
    shutil.copytree(machines / "m0", tmp_path / "m0")
    shutil.copy(tmp_path / "m0" / "machine.toml", tmp_path)
    with pytest.raises(InputError, match=r"machine\.toml: this is no folder"):
        fleet([tmp_path / "machine.toml"], tmp_path / "results", figures=False)


@pytest.mark.slow
def test_a_diagnosis_of_all(measured: list[Simulation], machines: Path, tmp_path: Path) -> None:
    [row] = fleet([machines / "m0"], tmp_path / "results", diagnose=True).rows
    found = diagnose(measured[0].campaign)
    assert row.says == found.summary
    assert row.verdict == (", ".join(f"{f.name} {f.axis or ''}".rstrip() for f in found.findings) or "explained")
    assert {"diagnosis.json", "model.json", "report.html"} <= contents(tmp_path / "results" / "m0").keys()


# --- what goes wrong ---------------------------------------------------------------------------------------
def test_one_bad_campaign_stops_no_other(machines: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(machines, tmp_path / "recorded")
    (tmp_path / "recorded" / "m1" / "campaign.toml").write_text('schema = "symfive.campaign/1"\nrun = 3\n')
    readings = next((tmp_path / "recorded" / "m2").glob("*.csv"))
    readings.write_text(readings.read_text().replace("0", "x", 1))
    words = [*sorted((tmp_path / "recorded").iterdir()), tmp_path / "absent"]
    assert cli.main(["fleet", *map(str, words), "-o", str(tmp_path / "results"), "--no-figures", "--workers", "0"]) == 2
    said = capsys.readouterr().err.replace("symfive: ", "").splitlines()
    failed = [line for line in said if ": failed: " in line]
    assert [line.split(":")[0] for line in failed] == ["recorded/m1", "recorded/m2", "absent"]
    assert "campaign.toml, line 2" in failed[0]
    assert "no such file" in failed[2]
    folders = {path.parent.name for path in (tmp_path / "results").rglob("identification.json")}
    assert folders == {"m0", "m3", "m4"}
    assert not list((tmp_path / "results").rglob("*m1*"))


def test_bad_requests_are_one_sentence(machines: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="results would go into the campaign itself"):
        fleet([machines], machines)
    with pytest.raises(InputError, match="there is no campaign"):
        fleet([], tmp_path)
    assert cli.main(["fleet", str(machines), "-o", str(tmp_path), "--workers", "-1"]) == 2
    plan = simulate_plan(tmp_path)
    [row] = fleet([plan], tmp_path / "results").rows
    assert row.failed and "no readings" in row.says


def simulate_plan(folder: Path) -> Path:
    machine = preset("oyama-2010")
    write_campaign(campaign_of(machine, r_test_grid(machine, step_deg=90.0)), folder / "plan")
    return folder / "plan"


def test_what_is_complete_is_not_done_again(
    serial: Path, machines: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(serial, tmp_path / "results")
    shutil.copytree(machines, tmp_path / "recorded")
    before = contents(serial)
    done: list[str] = []

    def counted(campaign: Any) -> Any:
        done.append(campaign.path.name)
        return identify(campaign)

    monkeypatch.setattr("symfive.fleet.identify", counted)
    shutil.rmtree(tmp_path / "results" / "m2")  # interrupted
    declared = tmp_path / "recorded" / "m4" / "campaign.toml"
    declared.write_text(declared.read_text() + "\n")  # changed
    fleet([tmp_path / "recorded"], tmp_path / "results", figures=False)
    assert done == ["m2", "m4"]
    after = contents(tmp_path / "results")
    assert {name for name in before if before[name] != after[name]} == {
        "m4/fleet-row.json", *(f"m{number}/manifest.json" for number in (2, 4))
    }  # fmt: skip
    fleet([tmp_path / "recorded"], tmp_path / "results", figures=False, redo=True)
    assert len(done) == 2 + MACHINES


# --- on several workers ------------------------------------------------------------------------------------
def killing(results: Path, pid: Any) -> Any:
    """Kills a worker as soon as the first machine is done."""
    killed: list[int] = []

    def progress(message: str) -> None:
        if not killed:
            killed.append(pid())
            os.kill(killed[0], signal.SIGKILL)

    return progress


def same(machines: Path, results: Path, serial: Path, pool: Executor, pid: Any) -> None:
    with pool:
        table = fleet([machines], results, figures=False, pool=pool, progress=killing(results, pid))
    assert not any(row.failed for row in table.rows)
    assert contents(results) == contents(serial)


@pytest.mark.slow
def test_local_processes_give_the_same_with_one_killed(machines: Path, serial: Path, tmp_path: Path) -> None:
    import multiprocessing

    def victim() -> int:
        return next(p.pid for p in multiprocessing.active_children() if p.pid)

    same(machines, tmp_path / "results", serial, Processes(2), victim)


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_with_one_worker_killed(machines: Path, serial: Path, tmp_path: Path) -> None:
    with local_cluster(tmp_path / "dask", n_workers=2) as cluster:
        pool = connect(cluster.scheduler_address)
        same(machines, tmp_path / "results", serial, pool, lambda: cluster.workers[0].pid)


@pytest.mark.slow
def test_the_command_with_a_scheduler(machines: Path, serial: Path, tmp_path: Path, capsys: Any) -> None:
    with local_cluster(tmp_path / "dask", n_workers=1) as cluster:
        words = ["fleet", str(machines), "-o", str(tmp_path / "results"), "--no-figures", "--json", "-q"]
        assert cli.main([*words, "--scheduler", cluster.scheduler_address]) == 0
    data = json.loads(capsys.readouterr().out)
    assert [row["campaign"] for row in data["campaigns"]] == [f"m{number}" for number in range(MACHINES)]
    assert contents(tmp_path / "results") == contents(serial)
    assert cli.main([*words, "--scheduler", "nowhere"]) == 2
    assert capsys.readouterr().err.startswith("symfive: no Dask scheduler answers at nowhere")


def test_cells_of_the_table_are_no_formulas_and_lines_no_rows() -> None:
    """A campaign's folder may have any name; a spreadsheet must not calculate it."""
    names = ['=HYPERLINK("http://x")', " +1", "-m", "@sum", "\t=1", "plain", "two\nlines"]
    table = Fleet("identify", tuple(FleetRow(campaign=name, verdict="failed", says="=1+1") for name in names))
    rows = list(csv.DictReader(io.StringIO(table.csv(), newline="")))
    assert [row["campaign"] for row in rows] == [*(f"'{name}" for name in names[:5]), *names[5:]]
    assert {row["says"] for row in rows} == {"'=1+1"}
    assert str(table).count("\n") == len(names)
    number = FleetRow(
        campaign="m", verdict="good", rms=-1.5, rms_unit="um", chi2_dof=1.0, errors={"EX0C": (-2.0, 0.5, "um")}
    )
    (row,) = csv.DictReader(io.StringIO(Fleet("identify", (number,)).csv()))
    assert (row["rms"], row["EX0C_um"]) == ("-1.5", "-2.0")
