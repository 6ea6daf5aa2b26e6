"""The blind study scores right: names, classes, magnitudes, rivals, groups that readings cannot separate."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from blind_study_world import SPEC, finding_of, said_of, verdict_with

from examples.blind_study import challenge, controls, effects, figures, rivals, score, stages, store
from examples.blind_study.oracle import oracle, true_effect

FACT = {
    "name": ["backlash", "C"],
    "same": [["lateral_play", "C"]],
    "close": [],
    "size": 2.0,
    "masked": 0.2,
    "snr": 50.0,
}


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
    right = score.score(_answer(), verdict_with([finding_of("backlash", "C")]), None)
    second = score.score(_answer(), verdict_with([finding_of("friction", "C", rivals=[rival])]), None)
    assert (
        right["named"]
        and right["all_named"]
        and right["invented"] == 0
        and right["heldout"]["after"] == pytest.approx(1.0)
    )
    assert not second["named"] and second["named_in_two"] and second["confident_wrong"]
    other_axis = score.score(_answer(), verdict_with([finding_of("backlash", "B")]), None)
    assert not other_axis["named"] and not other_axis["named_in_two"]
    unknown = score.score(_answer(), verdict_with([finding_of("unknown", None)]), None)
    assert unknown["unknown"] == 1 and not unknown["confident_wrong"]


def test_a_class_is_complete_only_if_all_of_it_is_listed() -> None:
    rival = {"effect": "lateral_play", "axis": "C", "confidence": 0.4, "component": "EXC"}
    for listed, alias, whole in (([], (), False), ([rival], (), True), ([], ("lateral_play.EXC",), True)):
        found = finding_of("backlash", "C", rivals=listed, alias=list(alias))
        assert score.score(_answer("alias"), verdict_with([found]), None)["class_complete"] is whole


def test_an_alias_that_no_test_parts_is_told_by_its_name_and_by_no_useful_test() -> None:
    other, asked = "lateral_play.EXC", "plans/apart"
    for alias, next_test, told in (
        ([other], None, False),
        (["backlash.C"], None, True),
        (["backlash.C"], asked, False),
    ):
        found = finding_of("lateral_play", "C", alias=alias, next_test=next_test)
        assert score.score(_answer("alias"), verdict_with([found]), None)["told_alike"] is told


def test_a_name_that_no_measurement_parts_from_the_truth_counts_as_it() -> None:
    answer, verdict = _answer("alias"), verdict_with([finding_of("lateral_play", "C")])
    known = {"inseparable": [["lateral_play", "C"]]}
    assert score.score(answer, verdict, known)["named_again"] is True  # no test was asked for, none could tell
    assert score.score(answer, verdict, known, verdict_with([finding_of("lateral_play", "X")]))["named_again"] is False
    assert score.score(answer, verdict, None)["named_again"] is None
    assert score.score(answer, verdict, None, verdict)["named_again"] is False


def test_what_stands_in_for_the_truth_is_taken_out_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = store.Store(tmp_path)
    kept.case("visible-000").mkdir(parents=True)
    kept.seal("visible-000", json.dumps({"effects": [SPEC], "facts": [FACT]}))
    kept.put("verdicts", "visible-000", verdict_with([finding_of("backlash", "C")]))
    kept.put("oracles", "visible-000", {"chi2_dof": 1.0})
    answers = iter(["friction.C", "table_step.C", "unknown.C"])
    asked: list[list[str]] = []

    def judged(folder: Path, exclude: list[str]) -> dict[str, Any]:
        asked.append(exclude)
        form = next(answers)
        return verdict_with([finding_of("unknown" if form.startswith("unknown") else "a word", "C", form=form)])

    monkeypatch.setattr(stages, "judge", judged)
    stages.control(tmp_path, "visible-000")
    assert asked[0] == ["backlash", "counterbalance"]
    assert set(asked[1]) - set(asked[0]) == {"force_friction", "friction", "held_friction", "reversal_spike"}
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
    kept.put("verdicts", "visible-000", verdict_with([finding_of("backlash", "C")]))
    kept.put("oracles", "visible-000", {"chi2_dof": 0.9})  # the verdict's is 1.0: it had missed something, too
    wrong = verdict_with([finding_of("a word", "C", form="friction.C")])
    monkeypatch.setattr(stages, "judge", lambda folder, exclude: wrong)
    stages.control(tmp_path, "visible-000")
    assert len(kept.get("controls", "visible-000")) == 1


def test_magnitudes_and_places() -> None:
    said = {"width": {"value": 63.0, "std": 1.0, "unit": "urad"}}
    [entry] = score.parameters(SPEC, finding_of("backlash", "C", parameters=said))
    assert entry["error"] == pytest.approx(0.05) and entry["z"] == pytest.approx(3.0) and entry["textbook"]
    assert score.parameters(SPEC, finding_of("backlash", "B", parameters=said)) == []  # the width of another axis
    times = {"r": np.arange(4.0)}
    intervals = [{"run": "r", "t_s": [1.0, 2.0]}]
    assert score._overlap(times, intervals, {"r": [False, True, True, False]}) == 1.0
    assert score._overlap(times, intervals, {"r": [False, False, True, True]}) == 0.5


def test_wilson_calibration_and_power() -> None:
    assert figures.wilson(0, 100) == pytest.approx((0.0, 0.0370), abs=1e-4)
    assert all(low <= k / 7 <= high for k in range(8) for low, high in [figures.wilson(k, 7)])
    assert figures.wilson(98, 100)[0] == pytest.approx(0.930, abs=1e-3)
    rows = [score.score(_answer(), verdict_with([finding_of("backlash", a, confidence=0.75)]), None) for a in "CCCB"]
    assert figures.expected_calibration_error(rows) == pytest.approx(0.0)
    assert figures.oracle_power(2.326) == pytest.approx(0.5)


def test_the_oracle_holds_every_textbook_effect(tmp_path: Path) -> None:
    assert true_effect(SPEC, "r_test") is not None
    assert (
        true_effect({"effect": "gravity_sag", "axis": "B", "component": "EXB", "form": "hysteresis"}, "r_test") is None
    )
    assert true_effect({"effect": "shock"}, "r_test") is None


@pytest.mark.slow
def test_the_oracles_prior_has_room_for_what_geometry_absorbs_nearly_whole(tmp_path: Path) -> None:
    """A scale error of a hundred times the usual size that static bars see in its curvature alone; and no effect at all."""
    for case in ("masked-064", "none-000"):
        stages.seal(tmp_path, 20, case)
        sealed = store.Store(tmp_path)
        answer = json.loads((tmp_path / "answers" / f"{case}.json").read_text())
        found = oracle(sealed.case(case), answer)
        assert found is not None
        for name, (value, std) in found["geometry"].items():
            assert abs(value - answer["location_errors_um_urad"][name]) < 3.5 * std, name


def test_the_rival_that_fits_all_at_once_ranks_what_is_significant_by_its_size() -> None:
    rng = np.random.default_rng(2)
    parts = [rng.normal(size=(500, 2)) for _ in range(4)]
    names = [("backlash", "X"), ("backlash", "Y"), ("scale_error", "X"), ("latency", None)]
    y = parts[2] @ [3.0, 0.0] + parts[0] @ [0.5, 0.5] + rng.normal(size=500)
    system = rivals.System(y, rng.normal(size=(500, 3)), list(zip(names, parts, strict=True)), [500])
    assert rivals.fit_all(system) == [("scale_error", "X"), ("backlash", "X")]


@pytest.mark.parametrize(
    ("structure", "carriers"),
    [("w C' B' Y' b X Z t", ["Y", "B"]), ("w b X Y Z C A t", ["X", "Y", "Z"]), ("w C' Y' b X Z B t", ["Y"])],
)
def test_only_an_axis_in_front_of_it_tilts_a_table(structure, carriers):
    setting = SimpleNamespace(machine={"structure": structure})
    assert sorted(effects._carriers(setting, "C")) == sorted(carriers)


SAME_READINGS = {"names": [["location_error", "X"], ["scale_error", "Y"]]}
PLAY = {"names": [["backlash", "C"]]}
OVER_TIME = {"names": [["unknown", None]], "coordinates": ["t"]}


@pytest.mark.parametrize(
    ("effects", "findings", "points", "wrong"),
    [
        ([], [], 1.0, False),
        ([], [said_of("backlash", "C", 0.95)], 0.0, True),
        ([PLAY], [], 0.0, False),
        ([PLAY], [said_of("backlash", "C", 0.95)], 1.0, False),
        ([PLAY], [said_of("backlash", "B", 0.95)], 0.0, True),
        ([PLAY], [said_of("backlash", "C", 0.95), said_of("friction", "C", 0.5)], 0.5, False),
        ([PLAY], [said_of("backlash", "C", 0.7, rivals=[said_of("friction", "C", 0.3)])], 0.5, False),
        ([PLAY], [said_of("backlash", "C", 0.97, rivals=[said_of("friction", "C", 0.03)])], 1.0, False),
        ([PLAY, SAME_READINGS], [said_of("backlash", "C", 0.9)], 0.5, False),
        ([SAME_READINGS], [said_of("scale_error", "Y", 0.9)], 0.5, False),
        ([SAME_READINGS], [said_of("scale_error", "Y", 0.9, alias=["location_error.EC0X"])], 1.0, False),
        ([SAME_READINGS], [said_of("scale_error", "Y", 0.9, alias=[{"effect": "location_error", "axis": "X"}])], 1.0, False),
        ([OVER_TIME], [said_of("unknown", None, 0.99, coordinate="t")], 1.0, False),
        ([OVER_TIME], [said_of("unknown", None, 0.99, where={"coordinate": "X, t"})], 1.0, False),
        ([OVER_TIME], [said_of("unknown", None, 0.99, coordinate="X")], 0.0, False),
        ([OVER_TIME], [said_of("thermal_drift", None, 0.99, coordinate="t")], 0.0, True),
    ],
)  # fmt: skip
def test_a_complete_group_without_a_false_member_scores_one(effects, findings, points, wrong) -> None:
    got = challenge.mark({"stratum": "alias", "effects": effects}, {"findings": findings})
    assert (got.points, got.wrong) == (points, wrong)
