"""The blind study runs: answers stay sealed, a killed run goes on, entrants take part by files alone."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import plant
import pytest
from blind_study_world import SPEC, said_of, verdict_with

from examples.blind_study import challenge, recorded, stages, store, study
from symfive.campaign import read_campaign
from symfive.errors import InputError
from symfive.executors import executor

IDS = ["none-002", "visible-002"]


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("study")
    for id in IDS:
        stages.seal(root, 1, id)
    return root


def test_recorded_noise_is_taken_once_and_keeps_its_size(sealed: Path) -> None:
    clean = read_campaign(sealed / "cases" / IDS[0] / "fit")
    count = sum(y.size for run in clean.runs for y in run.readings.values())
    pool = np.random.default_rng(0).normal(size=count)
    noisy, end = recorded._with_noise(clean, pool, 7)
    added = [
        (noisy.run(run.id).readings[name] - y) / run.noise(run.instrument[0])
        for run in clean.runs
        for name, y in run.readings.items()
    ]
    np.testing.assert_allclose(np.concatenate(added), np.roll(pool, -7), atol=1e-6)
    assert end == 7 + count


def test_recordings_hold_no_answer_and_symfive_reads_them(sealed: Path) -> None:
    for id in IDS:
        assert {p.name for p in (sealed / "cases" / id).rglob("*.json")} == set()
        assert read_campaign(sealed / "cases" / id / "fit").measured


def test_answers_open_only_after_the_verdict_and_only_if_untouched(sealed: Path) -> None:
    kept = store.Store(sealed)
    with pytest.raises(ValueError, match="stays sealed"):
        kept.open(IDS[0])
    kept.put("verdicts", IDS[0], {})
    assert kept.open(IDS[0])["effects"] == []
    path = sealed / "answers" / f"{IDS[0]}.json"
    text = path.read_text()
    path.write_text(text.replace('"stratum": "none"', '"stratum": "alias"'))
    with pytest.raises(ValueError, match="not the one that was sealed"):
        kept.open(IDS[0])
    path.write_text(text)
    (sealed / "cases" / IDS[0] / "fit" / "extra.csv").write_text("")
    with pytest.raises(ValueError, match="recordings are not those"):
        kept.open(IDS[0])
    (sealed / "cases" / IDS[0] / "fit" / "extra.csv").unlink()
    (sealed / "verdicts" / f"{IDS[0]}.json").unlink()


def test_a_killed_study_goes_on_without_repeating(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    judged: list[str] = []

    def judge(folder: Path, **options: Any) -> dict[str, Any]:
        if len(judged) == 1 and judged[0] != "resumed":
            judged.append("killed")
            raise KeyboardInterrupt
        judged.append(folder.name)
        return verdict_with([])

    monkeypatch.setattr(stages, "judge", judge)
    monkeypatch.setattr(stages, "oracle", lambda folder, answer: None)
    ids = ["none-000", "none-001", "none-003"]
    command = ["--seed", "5", "--workers", "0", "-o", str(tmp_path), *(w for i in ids for w in ("--case", i))]
    with pytest.raises(KeyboardInterrupt):
        study.main(command)
    seals = {p.name: p.read_text() for p in (tmp_path / "seals").iterdir()}
    judged[:] = ["resumed"]
    assert study.main(command) == 0
    assert judged == ["resumed", *ids[1:]]
    assert seals == {p.name: p.read_text() for p in (tmp_path / "seals").iterdir()}
    data = json.loads((tmp_path / "study.json").read_text())
    assert data["finished"] == 3
    assert "false alarms" in (tmp_path / "study.md").read_text()
    for picture in ("severity", "calibration", "confusion"):
        assert (tmp_path / f"{picture}.png").stat().st_size > 1000


def test_an_error_is_reported_and_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(folder: Path, **options: Any) -> dict[str, Any]:
        raise RuntimeError("no verdict")

    monkeypatch.setattr(stages, "judge", broken)
    command = ["--seed", "5", "--workers", "0", "-o", str(tmp_path), "--case", "none-000"]
    assert study.main(command) == 1
    assert "no verdict" in (tmp_path / "failures.md").read_text()
    monkeypatch.setattr(stages, "judge", lambda folder, **options: verdict_with([]))
    monkeypatch.setattr(stages, "oracle", lambda folder, answer: None)
    assert study.main(command) == 0


def test_the_plant_measures_the_test_that_was_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    machine, kept = plant.static_table(), store.Store(tmp_path)
    nest = plant.r_test(machine, "nest", nest=[60.0, 0.0, 50.0], poses=plant.grid_poses([0.0], [0.0, 60.0, 120.0]))
    plant.write_campaign(tmp_path / "next" / "alias-000", machine, [nest], readings=False)
    answer = {
        "stratum": "alias",
        "effects": [SPEC],
        "location_errors_um_urad": {"EX0C": 5.0},
        "error_motions_um_urad": {},
    }
    kept.seal("alias-000", json.dumps({**answer, "seed": 3, "noise": vars(plant.PLAIN)}))
    kept.put("verdicts", "alias-000", {})
    monkeypatch.setattr(stages, "judge_again", lambda folder, measured: {"rows": read_campaign(measured).rows})
    assert stages._look_again(kept, "alias-000") == {"rows": 6}
    assert {p.name for p in (tmp_path / "measured" / "alias-000").iterdir()} == {
        "campaign.toml",
        "machine.toml",
        "nest.csv",
    }


def test_an_error_is_the_cases_own() -> None:
    def seal(numerator: float, id: str) -> None:
        numerator / int(id)

    with executor(0) as inline:
        (good, none), (bad, error) = sorted(study.run(inline, seal, [(1.0, "2"), (1.0, "0")]), reverse=True)
    assert (good, none, bad) == ("2", "", "0")
    assert "ZeroDivisionError" in error


@pytest.mark.slow
def test_a_small_study_from_end_to_end(tmp_path: Path) -> None:
    command = ["--seed", "1", "--workers", "1", "-o", str(tmp_path), "--ablation", "--rivals"]
    command += [word for id in IDS for word in ("--case", id)]
    assert study.main(command) == 0
    data = json.loads((tmp_path / "study.json").read_text())
    assert data["finished"] == len(IDS) and not data["errors"]
    clean, visible = sorted(data["rows"], key=lambda r: r["id"])
    assert not clean["detected"]
    assert visible["detected"] and visible["named"]
    said = {line["what"]: line for line in data["table"]}
    assert said["BIC ARMA, clipped: visible named"]["n"] == said["fit all, rank: visible named"]["n"] == 1
    assert any("excluded" in what for what in said)
    assert study.main([*command, "--report"]) == 0


@pytest.fixture
def written(sealed: Path, tmp_path: Path) -> Path:
    words = ["--answers", str(tmp_path / "answers.json"), "--study", str(sealed), "--cases", "9"]
    assert challenge.main(["write", str(tmp_path / "open"), *words]) == 0
    return tmp_path


@pytest.fixture
def nine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(challenge, "case_ids", lambda count: IDS)


def test_an_outsider_enters_by_files_alone(nine: None, written: Path, capsys: pytest.CaptureFixture[str]) -> None:
    numbers = json.loads((written / "open" / "challenge.json").read_text())["campaigns"]
    assert numbers == ["0001", "0002"]
    told = json.loads((written / "answers.json").read_text())["answers"]
    for path in (written / "open").rglob("*"):  # nothing tells which is which
        assert "heldout" not in path.name and not (path.is_file() and any(i.encode() in path.read_bytes() for i in IDS))
    for number in numbers:
        names = [effect["names"][0] for effect in told[number]["effects"]]
        (written / "all" / number).mkdir(parents=True)
        said = {"findings": [said_of(effect, axis, 0.8) for effect, axis in names]}
        (written / "all" / number / "diagnosis.json").write_text(json.dumps(said))
    (written / "nobody").mkdir()
    entries = [str(written / name) for name in ("all", "nobody")]
    assert challenge.main(["score", str(written / "open"), str(written / "answers.json"), *entries]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "| | all | nobody |" and lines[2] == "| score, mean over the cases | 1.000 | 0.000 |"
    assert lines[-2:] == [
        "| Brier score of the names (0 is best) | 0.040 | no name |",
        "| campaigns without a diagnosis | 0 | 2 |",
    ]


def test_other_answers_and_broken_entries_are_refused(nine: None, written: Path) -> None:
    open_, answers, entry = written / "open", written / "answers.json", written / "mine"
    (entry / "0001").mkdir(parents=True)
    (entry / "0001" / "diagnosis.json").write_text('{"findings": [{"axis": "X"}]}')
    with pytest.raises(InputError, match=r"0001.*is no diagnosis.*effect"):
        challenge.marks(open_, answers, entry)
    answers.write_text(answers.read_text().replace("none", "alias"))
    with pytest.raises(InputError, match="not the answers of this challenge"):
        challenge.marks(open_, answers, entry)
    with pytest.raises(InputError, match="is there already"):
        challenge.main(["write", str(open_), "--answers", str(written / "new.json")])
    with pytest.raises(InputError, match="everybody reads it"):
        challenge.main(["write", str(written / "other"), "--answers", str(written / "other" / "answers.json")])


def test_entrants_that_are_built_in_write_a_diagnosis_each(nine: None, written: Path) -> None:
    words = ["enter", str(written / "open"), "BIC white", "-o", str(written / "bic"), "--workers", "0"]
    assert challenge.main(words) == 0
    assert len(challenge.marks(written / "open", written / "answers.json", written / "bic")) == 2
