"""The blind study on a small scale: its cases are what they claim, answers stay sealed, a killed run goes on, it scores right."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import plant
import pytest
from plant import effects as plant_effects
from scipy.signal import lfilter

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from examples.blind_study import (  # noqa: E402
    cases,
    challenge,
    controls,
    effects,
    figures,
    recorded,
    rivals,
    score,
    span,
    stages,
    store,
    study,
)
from examples.blind_study.forms import honest  # noqa: E402
from examples.blind_study.frozen import FROZEN, form_of_case  # noqa: E402
from examples.blind_study.oracle import oracle, true_effect  # noqa: E402
from examples.blind_study.others import FAULTS, OUTSIDE  # noqa: E402
from examples.blind_study.plans import draw_setting  # noqa: E402
from symfive.campaign import read_campaign  # noqa: E402
from symfive.effects import EFFECTS  # noqa: E402
from symfive.errors import InputError  # noqa: E402
from symfive.executors import executor  # noqa: E402

IDS = ["none-002", "visible-002"]


# --- the cases ---------------------------------------------------------------------------------------------
def test_strata_are_in_proportion_and_interleaved() -> None:
    whole = cases.case_ids(420)
    assert {s: sum(i.startswith(s) for i in whole) for s in cases.STRATA} == cases.STRATA
    few = cases.case_ids(42)
    assert len(few) == 42 and set(few) < set(whole)
    assert {i.split("-")[0] for i in few[:14]} == set(cases.STRATA)


def test_the_generator_knows_nothing_of_symfive() -> None:
    code = "import sys, examples.blind_study.cases; assert not any(m.split('.')[0] in ('symfive', 'casadi') for m in sys.modules)"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


@pytest.mark.slow
def test_a_case_depends_on_its_name_and_the_seed_alone() -> None:
    first, again, other = (cases.make_case(seed, "visible-002") for seed in (1, 1, 2))
    assert (first.effects, first.seed) == (again.effects, again.seed)
    assert first.seed != other.seed
    fact = first.facts[0]
    assert fact["masked"] < cases.MASKED and not fact["same"] and not fact["close"]
    assert 0.9 < fact["size"] < 9.0


@cache
def _setting(kind: str, seed: int = 1) -> Any:
    return draw_setting(np.random.default_rng(seed), (kind,))


@pytest.mark.parametrize("kind", ["r_test", "planar"])
def test_geometry_is_masked_by_itself_and_noise_by_nothing(kind: str) -> None:
    setting = _setting(kind)
    whole = span.Span.of(setting)
    name = next(n for n, term in setting.machine["errors"].items() if "basis" not in term)
    share, _ = whole.masked(whole.change({"effect": "location_error", "component": name, "value": 5.0}))
    assert share > 0.99
    rng = np.random.default_rng(0)
    share, snr = whole.masked([rng.normal(0.0, setting.white_um, y.shape) for y in whole.plain])
    assert share < 0.3 and snr > 10.0


def test_whitening_makes_the_plants_noise_white() -> None:
    options = plant.NoiseOptions(coloured_um=0.3, correlation_s=0.8)
    t = np.arange(20000) * 0.05
    white = span.whiten(plant.noise.noise(t, 1, 0.2, options, np.random.default_rng(3)), t, 0.2, options)[100:, 0]
    assert white.std() == pytest.approx(1.0, rel=0.03)
    assert abs(np.corrcoef(white[:-1], white[1:])[0, 1]) < 0.03


def test_what_reads_the_same_is_found_by_the_generator() -> None:
    """On one circle a squareness of X and one of Y are one thing."""
    setting = draw_setting(np.random.default_rng(2), ("planar",), lean=True)
    setting.machine["errors"].pop("EC0X")
    setting.location.clear()
    spec = {"effect": "location_error", "component": "EC0X", "value": 40.0}
    whole = span.Span.of(setting)
    assert ("location_error", "Y") in span.aliases(whole, spec, whole.change(spec))["same"]


@pytest.mark.parametrize("form", ["hard", "presliding"])
def test_a_tilt_in_play_seen_at_one_height_reads_like_a_backlash(form: str) -> None:
    setting = draw_setting(np.random.default_rng(2), ("xc",), lean=True)
    spec = {
        "effect": "lateral_play",
        "component": "EBX",
        "width": 50.0,
        "form": form,
        "distance": 100.0,
        "takeup": 10.0,
    }
    whole = span.Span.of(setting)
    assert ("backlash", "X") in span.aliases(whole, spec, whole.change(spec))["same"]


@pytest.mark.slow
def test_a_name_that_needs_far_more_motion_is_oversized(tmp_path: Path) -> None:
    """A bar that lies across Z reads micrometres of sideways play of A as millimetres of its backlash; of Y it needs no more."""
    stages.seal(tmp_path, 21, "alias-018")
    answer = json.loads((tmp_path / "answers" / "alias-018.json").read_text())
    assert {("backlash", "Z"), ("lateral_play", "Y")} < set(score.names_of(answer["facts"][0]))
    alike = stages._alike(store.Store(tmp_path).case("alias-018"), answer)
    assert alike["oversized"] == [("backlash", "Z")]
    fact = {"name": ["lateral_play", "Z"], "same": [["backlash", "Z"]], "close": []}
    found = _finding("lateral_play", "Z")
    assert not score.class_complete(fact, found, []) and score.class_complete(fact, found, [], [["backlash", "Z"]])


def test_only_what_is_a_convention_is_inseparable() -> None:
    """Which of two axes is straight nobody can measure, a scale error that reads like a sag on one grid somebody can."""
    setting = draw_setting(np.random.default_rng(2), ("r_test",), lean=True)
    tilted = {"effect": "location_error", "component": "EC0Y", "value": 40.0}
    assert span.inseparable(setting, tilted) == [("location_error", "X")]
    assert span.inseparable(setting, {"effect": "scale_error", "axis": "Z", "ppm": 50.0}) == []
    moving = {"effect": "inertial_compliance", "axis": "X", "direction": [0.0, 1.0, 0.0], "compliance": 20.0}
    assert span.inseparable(draw_setting(np.random.default_rng(0), ("planar",), lean=True), moving) == []


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


def test_a_hum_and_a_drift_are_no_noise() -> None:
    rng, t = np.random.default_rng(0), np.arange(1000.0)
    noise = rng.normal(size=1000)
    slow = lfilter([1.0], [1.0, -0.9], rng.normal(size=1000))
    assert recorded.chance_of_the_highest(noise) > 0.01 and recorded.chance_of_the_highest(slow) > 0.01
    assert recorded.chance_of_the_highest(noise + 0.5 * np.sin(1.3 * t)) < recorded.LEVEL
    assert recorded.chance_of_the_highest(noise + 2e-3 * t) < recorded.LEVEL


@pytest.mark.parametrize("source", recorded.SOURCES)
def test_the_noise_of_a_recording_has_no_mean_and_its_own_size(source: str) -> None:
    try:
        found = recorded.recorded_noise(source)
    except InputError as error:
        pytest.skip(f"the recording is not here: {error}")
    assert found
    for series in found:
        assert len(series) >= recorded.LEAST and abs(series.mean()) < 0.2 and 0.9 < series.std() < 1.2


@pytest.mark.parametrize("drawer", [d for d, _ in (*effects.MACHINE, *FAULTS, *OUTSIDE)], ids=lambda d: d.__name__)
def test_every_drawer_gives_an_effect_the_plant_can_do(drawer: Any) -> None:
    rng = np.random.default_rng(1)
    drafts = ((s, drawer(rng, s)) for s in map(_setting, ("r_test", "xc", "planar", "static_bar")) for _ in range(10))
    setting, draft = next((s, d) for s, d in drafts if d is not None)
    small, large = (span.size(setting, cases.change_of(setting, [draft.make(a)], 1)) for a in (0.5, 1.0))
    assert 0.0 < small <= 1.2 * large < 100.0


def test_outside_means_outside() -> None:
    settings, rng = [_setting(kind) for kind in ("r_test", "planar", "xc")], np.random.default_rng(0)
    drafts = [drawer(rng, setting) for drawer, _ in OUTSIDE for setting in settings for _ in range(5)]
    names = {draft.spec["effect"] for draft in drafts if draft is not None}
    assert len(names) >= 5
    assert names.isdisjoint(EFFECTS)
    assert names < set(plant.EFFECTS)


DIGESTS = {
    "examples/blind_study/forms.py": "6ad9dfa1997d54d4c273b6f9bf1f7d41427c2dbb55397695af04fc5c19c5ea80",
    "examples/blind_study/foreign.py": "be08b692fdca12a60c10fe195b5d44035022e8bea445ce88b10e6ccb597ca024",
    "examples/blind_study/strange.py": "319d44a961a8095e7ec86de0e12bca00a4b237bb4c14e449df0fce64235ea5c3",
    "tests/plant/foreign.py": "2dd16000f6eba17ba0af7a12bcf9dad79995087ce900ad599bef490e987eae27",
    "tests/plant/strange.py": "a8454d40d4dc55ceeb315c29822913deed4cdc922148aceb31c9587a99474579",
}


@pytest.mark.parametrize("path", DIGESTS)
def test_a_frozen_stratum_is_as_it_was_before_anything_was_run_on_it(path: str) -> None:
    found = hashlib.sha256((ROOT / path).read_bytes()).hexdigest()
    assert found == DIGESTS[path], "the stratum is frozen: draw a new one instead"


@pytest.mark.parametrize("stratum", FROZEN)
def test_no_name_of_a_frozen_stratum_is_the_librarys(stratum: str) -> None:
    assert len(FROZEN[stratum]) >= 15
    assert set(FROZEN[stratum]) == set(plant_effects.FROZEN[stratum])
    assert set(FROZEN[stratum]).isdisjoint(EFFECTS)
    assert set(FROZEN[stratum]).isdisjoint(draw(1.0)["effect"] for draw in _old_drafts())


def _old_drafts() -> list[Any]:
    settings, rng = [_setting(kind) for kind in ("r_test", "planar", "xc")], np.random.default_rng(0)
    drawers = [d for d, _ in (*effects.MACHINE, *FAULTS, *OUTSIDE)]
    return [d.make for drawer in drawers for s in settings for d in [drawer(rng, s)] if d is not None]


ALL_FORMS = [(stratum, number, form) for stratum, forms in FROZEN.items() for number, form in enumerate(forms)]


@pytest.mark.slow
@pytest.mark.parametrize(("stratum", "number", "form"), ALL_FORMS, ids=lambda value: str(value))
def test_a_frozen_form_writes_finite_readings_that_show_it(stratum: str, number: int, form: str) -> None:
    """SNR of what geometry and set-up leave of it: above 10."""
    case = cases.make_case(1, f"{stratum}-{number:03d}")
    change = cases.change_of(case.setting, case.effects, case.seed)
    assert all(np.isfinite(y).all() for y in change)
    assert span.Span.of(case.setting).masked(change)[1] > 10.0
    assert case.facts[0]["name"][0] == form


def test_every_frozen_stratum_is_asked_for_by_number() -> None:
    options = study.parse(["-o", "x", "--cases", "0", "--foreign", "1", "--strange", "17"])
    ids = study.chosen(options)
    assert ids == ["foreign-000", *(f"strange-{k:03d}" for k in range(17))]
    forms = list(FROZEN["strange"].values())
    assert [form_of_case("strange", k) for k in (0, 14, 15, 16)] == [forms[0], forms[14], *forms[:2]]


def test_a_frozen_form_is_told_by_its_coordinate_or_by_what_it_predicts() -> None:
    form, spec = FROZEN["foreign"]["scale_slip"], {"effect": "scale_slip", "axis": "X"}
    finding = {"effect": "unknown", "form": "unknown.X", "where": {"coordinate": "X"}}
    name = {"effect": "scale_error", "form": "scale_error.X", "where": {"coordinate": "X"}}
    elsewhere = {**finding, "where": {"coordinate": "Y"}}
    predicts, fails = {"before": 3.0, "after": 1.1}, {"before": 3.0, "after": 2.5}
    assert honest(form, spec, finding, fails) and honest(form, spec, name, predicts)
    assert not honest(form, spec, name, fails)
    assert not honest(form, spec, elsewhere, predicts)
    assert not honest(form, spec, None, predicts)


# --- the folder --------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("study")
    for id in IDS:
        stages.seal(root, 1, id)
    return root


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


def _verdict(findings: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "diagnosis": {"mismatch": bool(findings), "findings": findings, "classes": [], "fit": {"chi2_dof_after": 1.0}},
        "seconds": 1.0, "heldout_rms_um": {"before": 1.0, "after": 0.4}, "geometry": {"before": {}, "after": {}}, "code": "x",
    }  # fmt: skip


def test_a_killed_study_goes_on_without_repeating(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    judged: list[str] = []

    def judge(folder: Path, **options: Any) -> dict[str, Any]:
        if len(judged) == 1 and judged[0] != "resumed":
            judged.append("killed")
            raise KeyboardInterrupt
        judged.append(folder.name)
        return _verdict([])

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
    monkeypatch.setattr(stages, "judge", lambda folder, **options: _verdict([]))
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


# --- the score ---------------------------------------------------------------------------------------------
FACT = {
    "name": ["backlash", "C"],
    "same": [["lateral_play", "C"]],
    "close": [],
    "size": 2.0,
    "masked": 0.2,
    "snr": 50.0,
}
SPEC = {"effect": "backlash", "axis": "C", "width": 60.0, "form": "hard"}


def _finding(effect: str, axis: str | None, **more: Any) -> dict[str, Any]:
    plain = {"form": f"{effect}.{axis}", "confidence": 0.95, "rivals": [], "alias": [], "parameters": {}}
    where = {"runs": [], "coordinate": "C", "intervals": [], "direction": None}
    tests = {"next_test": None, "next_test_separation_sigma": None}
    return {"effect": effect, "axis": axis, "where": where, **plain, **tests, **more}


def _answer(stratum: str = "visible", **more: Any) -> dict[str, Any]:
    base = {
        "id": f"{stratum}-000",
        "stratum": stratum,
        "kind": "r_test",
        "topology": "table-bc",
        "effects": [SPEC],
        "facts": [FACT],
    }
    return {**base, "heldout_noise_um": 0.4, "location_errors_um_urad": {}, **more}


def test_names_ranks_and_confidence() -> None:
    rival = {"effect": "backlash", "axis": "C", "confidence": 0.02, "component": None}
    right = score.score(_answer(), _verdict([_finding("backlash", "C")]), None)
    second = score.score(_answer(), _verdict([_finding("friction", "C", rivals=[rival])]), None)
    assert (
        right["named"]
        and right["all_named"]
        and right["invented"] == 0
        and right["heldout"]["after"] == pytest.approx(1.0)
    )
    assert not second["named"] and second["named_in_two"] and second["confident_wrong"]
    other_axis = score.score(_answer(), _verdict([_finding("backlash", "B")]), None)
    assert not other_axis["named"] and not other_axis["named_in_two"]
    unknown = score.score(_answer(), _verdict([_finding("unknown", None)]), None)
    assert unknown["unknown"] == 1 and not unknown["confident_wrong"]


def test_a_class_is_complete_only_if_all_of_it_is_listed() -> None:
    rival = {"effect": "lateral_play", "axis": "C", "confidence": 0.4, "component": "EXC"}
    for listed, alias, whole in (([], (), False), ([rival], (), True), ([], ("lateral_play.EXC",), True)):
        found = _finding("backlash", "C", rivals=listed, alias=list(alias))
        assert score.score(_answer("alias"), _verdict([found]), None)["class_complete"] is whole


def test_an_alias_that_no_test_parts_is_told_by_its_name_and_by_no_useful_test() -> None:
    other, asked = "lateral_play.EXC", "plans/apart"
    for alias, next_test, told in (
        ([other], None, False),
        (["backlash.C"], None, True),
        (["backlash.C"], asked, False),
    ):
        found = _finding("lateral_play", "C", alias=alias, next_test=next_test)
        assert score.score(_answer("alias"), _verdict([found]), None)["told_alike"] is told


def test_a_name_that_no_measurement_parts_from_the_truth_counts_as_it() -> None:
    answer, verdict = _answer("alias"), _verdict([_finding("lateral_play", "C")])
    known = {"inseparable": [["lateral_play", "C"]]}
    assert score.score(answer, verdict, known)["named_again"] is True  # no test was asked for, none could tell
    assert score.score(answer, verdict, known, _verdict([_finding("lateral_play", "X")]))["named_again"] is False
    assert score.score(answer, verdict, None)["named_again"] is None
    assert score.score(answer, verdict, None, verdict)["named_again"] is False


def test_what_stands_in_for_the_truth_is_taken_out_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = store.Store(tmp_path)
    kept.case("visible-000").mkdir(parents=True)
    kept.seal("visible-000", json.dumps({"effects": [SPEC], "facts": [FACT]}))
    kept.put("verdicts", "visible-000", _verdict([_finding("backlash", "C")]))
    kept.put("oracles", "visible-000", {"chi2_dof": 1.0})
    answers = iter(["friction.C", "table_step.C", "unknown.C"])
    asked: list[list[str]] = []

    def judged(folder: Path, exclude: list[str]) -> dict[str, Any]:
        asked.append(exclude)
        form = next(answers)
        return _verdict([_finding("unknown" if form.startswith("unknown") else "a word", "C", form=form)])

    monkeypatch.setattr(stages, "judge", judged)
    stages.control(tmp_path, "visible-000")
    assert asked[0] == ["backlash", "counterbalance"]
    assert set(asked[1]) - set(asked[0]) == {"force_friction", "friction", "reversal_spike"}
    assert set(asked[2]) - set(asked[1]) == {"eccentric_mass", "error_motion", "table_step"}
    first, last = (
        [line.value for line in controls.controls(kept, ["visible-000"]) if line.what.startswith(what)]
        for what in ("true effect excluded", "… and all names")
    )
    assert (first, last) == ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0])  # unknown, nothing, a confident name


def test_a_name_that_explains_the_readings_worse_than_the_truth_is_no_stand_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = store.Store(tmp_path)
    kept.case("visible-000").mkdir(parents=True)
    kept.seal("visible-000", json.dumps({"effects": [SPEC], "facts": [FACT]}))
    kept.put("verdicts", "visible-000", _verdict([_finding("backlash", "C")]))
    kept.put("oracles", "visible-000", {"chi2_dof": 0.9})  # the verdict's is 1.0: it had missed something, too
    wrong = _verdict([_finding("a word", "C", form="friction.C")])
    monkeypatch.setattr(stages, "judge", lambda folder, exclude: wrong)
    stages.control(tmp_path, "visible-000")
    assert len(kept.get("controls", "visible-000")) == 1


def test_magnitudes_and_places() -> None:
    said = {"width": {"value": 63.0, "std": 1.0, "unit": "urad"}}
    [entry] = score.parameters(SPEC, _finding("backlash", "C", parameters=said))
    assert entry["error"] == pytest.approx(0.05) and entry["z"] == pytest.approx(3.0) and entry["textbook"]
    assert score.parameters(SPEC, _finding("backlash", "B", parameters=said)) == []  # the width of another axis
    times = {"r": np.arange(4.0)}
    intervals = [{"run": "r", "t_s": [1.0, 2.0]}]
    assert score._overlap(times, intervals, {"r": [False, True, True, False]}) == 1.0
    assert score._overlap(times, intervals, {"r": [False, False, True, True]}) == 0.5


def test_wilson_calibration_and_power() -> None:
    assert figures.wilson(0, 100) == pytest.approx((0.0, 0.0370), abs=1e-4)
    assert all(low <= k / 7 <= high for k in range(8) for low, high in [figures.wilson(k, 7)])
    assert figures.wilson(98, 100)[0] == pytest.approx(0.930, abs=1e-3)
    rows = [score.score(_answer(), _verdict([_finding("backlash", a, confidence=0.75)]), None) for a in "CCCB"]
    assert figures.expected_calibration_error(rows) == pytest.approx(0.0)
    assert figures.oracle_power(2.326) == pytest.approx(0.5)


def test_the_oracle_holds_every_textbook_effect(tmp_path: Path) -> None:
    assert true_effect(SPEC, "r_test") is not None
    assert (
        true_effect({"effect": "gravity_sag", "axis": "B", "component": "EXB", "form": "hysteresis"}, "r_test") is None
    )
    assert true_effect({"effect": "shock"}, "r_test") is None


@pytest.mark.slow
def test_the_oracles_prior_has_room_for_what_geometry_swallows_nearly_whole(tmp_path: Path) -> None:
    """A scale error of a hundred times the usual size that static bars see in its curvature alone; and no effect at all."""
    for case in ("masked-064", "none-000"):
        stages.seal(tmp_path, 20, case)
        sealed = store.Store(tmp_path)
        answer = json.loads((tmp_path / "answers" / f"{case}.json").read_text())
        found = oracle(sealed.case(case), answer)
        assert found is not None
        for name, (value, std) in found["geometry"].items():
            assert abs(value - answer["location_errors_um_urad"][name]) < 3.5 * std, name


def test_an_error_is_the_cases_own() -> None:
    def seal(numerator: float, id: str) -> None:
        numerator / int(id)

    with executor(0) as inline:
        (good, none), (bad, error) = sorted(study.run(inline, seal, [(1.0, "2"), (1.0, "0")]), reverse=True)
    assert (good, none, bad) == ("2", "", "0")
    assert "ZeroDivisionError" in error


def test_the_rival_that_fits_all_at_once_ranks_what_is_significant_by_its_size() -> None:
    rng = np.random.default_rng(2)
    parts = [rng.normal(size=(500, 2)) for _ in range(4)]
    names = [("backlash", "X"), ("backlash", "Y"), ("scale_error", "X"), ("latency", None)]
    y = parts[2] @ [3.0, 0.0] + parts[0] @ [0.5, 0.5] + rng.normal(size=500)
    system = rivals.System(y, rng.normal(size=(500, 3)), list(zip(names, parts, strict=True)), [500])
    assert rivals.fit_all(system) == [("scale_error", "X"), ("backlash", "X")]


@pytest.mark.slow
def test_a_small_study_from_end_to_end(tmp_path: Path) -> None:
    command = [
        "--seed",
        "1",
        "--workers",
        "1",
        "-o",
        str(tmp_path),
        "--ablation",
        "--rivals",
        *(w for i in IDS for w in ("--case", i)),
    ]
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


@pytest.mark.parametrize(
    ("structure", "carriers"),
    [("w C' B' Y' b X Z t", ["Y", "B"]), ("w b X Y Z C A t", ["X", "Y", "Z"]), ("w C' Y' b X Z B t", ["Y"])],
)
def test_only_an_axis_in_front_of_it_tilts_a_table(structure, carriers):
    setting = SimpleNamespace(machine={"structure": structure})
    assert sorted(effects._carriers(setting, "C")) == sorted(carriers)


# --- the challenge -------------------------------------------------------------------------------------------
def _said(effect: str, axis: str | None, confidence: float, **more: Any) -> dict[str, Any]:
    return {"effect": effect, "axis": axis, "confidence": confidence, **more}


SAME_READINGS = {"names": [["location_error", "X"], ["scale_error", "Y"]]}
PLAY = {"names": [["backlash", "C"]]}
OVER_TIME = {"names": [["unknown", None]], "coordinates": ["t"]}


@pytest.mark.parametrize(
    ("effects", "findings", "points", "wrong"),
    [
        ([], [], 1.0, False),
        ([], [_said("backlash", "C", 0.95)], 0.0, True),
        ([PLAY], [], 0.0, False),
        ([PLAY], [_said("backlash", "C", 0.95)], 1.0, False),
        ([PLAY], [_said("backlash", "B", 0.95)], 0.0, True),
        ([PLAY], [_said("backlash", "C", 0.95), _said("friction", "C", 0.5)], 0.5, False),
        ([PLAY], [_said("backlash", "C", 0.7, rivals=[_said("friction", "C", 0.3)])], 0.5, False),
        ([PLAY], [_said("backlash", "C", 0.97, rivals=[_said("friction", "C", 0.03)])], 1.0, False),
        ([PLAY, SAME_READINGS], [_said("backlash", "C", 0.9)], 0.5, False),
        ([SAME_READINGS], [_said("scale_error", "Y", 0.9)], 0.5, False),
        ([SAME_READINGS], [_said("scale_error", "Y", 0.9, alias=["location_error.EC0X"])], 1.0, False),
        ([SAME_READINGS], [_said("scale_error", "Y", 0.9, alias=[{"effect": "location_error", "axis": "X"}])], 1.0, False),
        ([OVER_TIME], [_said("unknown", None, 0.99, coordinate="t")], 1.0, False),
        ([OVER_TIME], [_said("unknown", None, 0.99, where={"coordinate": "X, t"})], 1.0, False),
        ([OVER_TIME], [_said("unknown", None, 0.99, coordinate="X")], 0.0, False),
        ([OVER_TIME], [_said("thermal_drift", None, 0.99, coordinate="t")], 0.0, True),
    ],
)  # fmt: skip
def test_a_complete_group_without_a_false_member_scores_one(effects, findings, points, wrong) -> None:
    got = challenge.mark({"stratum": "alias", "effects": effects}, {"findings": findings})
    assert (got.points, got.wrong) == (points, wrong)


@pytest.fixture
def written(sealed: Path, tmp_path: Path) -> Path:
    words = [
        "write",
        str(tmp_path / "open"),
        "--answers",
        str(tmp_path / "answers.json"),
        "--study",
        str(sealed),
        "--cases",
        "9",
    ]
    assert challenge.main(words) == 0
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
        said = {"findings": [_said(effect, axis, 0.8) for effect, axis in names]}
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
