"""The report of a diagnosis: verdict, cards, chain, proof and observability, escaped, whole and in one file."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pages import HOSTILE, Page
from test_drive_at_rest import recorded

from symfive.campaign import read_campaign
from symfive.design import Discrimination, Separation
from symfive.diagnose import (
    Diagnosis,
    Finding,
    Fit,
    Interval,
    Location,
    Observability,
    RivalName,
    Suspect,
    detect,
    diagnose,
    facts_of,
    sentence_of,
)  # fmt: skip
from symfive.effects import Quantity, make_effect
from symfive.errors import InputError
from symfive.identify import Outlier, identify
from symfive.machine import preset
from symfive.procedures import campaign_of, planar_circle
from symfive.report import (
    _diagnosis,
    _report,
    diagnosis_report,
    diagnosis_text,
    visible_parts,
)
from symfive.report._chain import affected_link, chain_picture  # stages that no fixture finds
from symfive.simulate import simulate

CAMPAIGNS = Path(__file__).parent / "data" / "campaigns"


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    """What `diagnose` returns for the campaign with sag and drift, from two fits instead of the whole search."""
    campaign = read_campaign(CAMPAIGNS / "static-sag-and-drift" / "fit")
    effects = (make_effect("gravity_sag", "B", component="EZB"), make_effect("thermal_drift"))
    before, after = identify(campaign), identify(campaign, effects=effects)
    findings = (_finding(after, "thermal_drift", "t", 0.215), _finding(after, "gravity_sag.B.EZB", "B", 0.627))
    seen = (
        Observability("backlash", "Y", "backlash.Y", 0.98, 177.8),
        Observability("location_error", "Y", "location_error.EA0Y", 0.01, 3.2),
        Observability("location_error", "Z", "location_error.EA0Z", 0.01, 3.1),
    )
    fit = Fit(before.rms_um, after.rms_um, before.chi2_dof, after.chi2_dof, 1.67, 0.44)
    classes = (("location_error.EA0Y", "location_error.EA0Z"),)
    first, last = detect(before), detect(after)
    suspect = Suspect("structure", "B", "B", effects[0], 496.0, -490.0, campaign, after.named)
    location = Location(first, seen, classes, (suspect,))
    return Diagnosis(2e-106, 0.4, findings, fit, first, location, last, before, after)


def _finding(after, key: str, coordinate: str, share: float) -> Finding:
    campaign = after.model.campaign
    effect = next(e for e in after.model.effects if e.key == key)
    names = [p.name for p in effect.parameters(campaign)]
    without = after.values.copy()
    without[[after.model.index[n] for n in names]] = 0.0
    if key == "thermal_drift":
        name = "thermal_drift.time_constant_s"
        without[after.model.index[name]] = after[name]
    runs = campaign.runs
    part = {r.id: after.model.predict_run(r, after.values) - after.model.predict_run(r, without) for r in runs}
    values = after.named
    covariance = {(n, n): after.uncertainty(n) ** 2 for n in names}
    return Finding(
        effect=effect, name=effect.vocabulary, axis=effect.axis, confidence=0.996,
        parameters=effect.describe(campaign, values, covariance),
        rivals=(RivalName("error_motion", "B", 0.0036, "EXB"), RivalName("unknown", None, 1e-25)),
        runs=tuple(r.id for r in runs), coordinate=coordinate, intervals=(Interval("nest1", 1.0, 60.0),),
        direction=(0.0, 0.0, 1.0), says=f"{key} says so.", log_p=-238.0, visible=0.18, share=share,
        moved={"EX0C": (4.61, after["EX0C"])}, contribution=part, alias=("gravity_sag.B.EXB",),
    )  # fmt: skip


def _nothing(*_):
    raise InputError("nothing to draw", remedy="none")


@pytest.fixture
def drawn_page_of(found, tmp_path, monkeypatch):
    """The page of a diagnosis with some findings and other changes, without figures but theirs, and none as a file."""
    monkeypatch.setattr(_diagnosis, "drawn", lambda *_: "")
    monkeypatch.setattr(_diagnosis, "geometry_chart", _nothing)
    monkeypatch.setattr(_report, "write_bytes", lambda *_: None)
    return lambda *findings, **other: diagnosis_report(replace(found, findings=findings, **other), tmp_path).read_text()


@pytest.fixture
def page_of(drawn_page_of, monkeypatch):
    """The same without the figures of the findings."""
    monkeypatch.setattr(_diagnosis, "finding_figure", _nothing)
    return drawn_page_of


@pytest.fixture(scope="module")
def written(found, tmp_path_factory) -> Path:
    return diagnosis_report(found, tmp_path_factory.mktemp("out") / "diagnosis")


def test_a_rotation_is_about_its_axis_and_every_value_has_a_label(found, page_of):
    after = identify(found.after.model.campaign, effects=(make_effect("location_error", component="EC0Y"),))
    text = page_of(_finding(after, "location_error.EC0Y", "B", 0.2), after=after)
    assert "about Z of the machine: (0.00, 0.00, 1.00)" in Page(text).words
    assert re.search(r"<td[^>]*>component</td>.*<td[^>]*>value</td>", text, re.S)


def test_the_page_says_all_that_the_diagnosis_holds(found, written):
    text = written.read_text()
    page = Page(text)
    assert written.name == "report.html" and len(text.encode()) < 3_000_000
    assert "2 faults found: " in page.words
    first = ("what", "where", "how large", "how sure", "share")
    for finding in found.findings:
        facts = facts_of(finding, found.after)
        assert tuple(facts) == (*first, "hidden by", "not separated", "what to do")
        assert all(answer in page.words for answer in facts.values())
        assert "; ".join(facts[question] for question in first[1:]) in page.words, "the verdict says it in short"
        assert f"to do: {finding.effect.action}" in page.words
    assert closing(found) in page.words and text.index("<ol>") < text.index("In short: ") < text.index('class="tiles"')
    for words in (
        *found.doubts, "about 10⁻¹⁰⁶", "false-alarm rate of the general tests", "62.7 %", "21.5 %", "99.6 %", "amplitude", "EZB",
        "time constant", "the structure that axis B carries", "changing with time", "location errors of the rotary axes",
        "geometry and set-up absorbed 82 % of it", "position of axis C along X", "gravity sag of axis B (EXB)",
        "χ²/dof against the estimated noise", "held-out runs (each run in turn)", "location error of axis Z (EA0Z)", "Class 1:",
        "geometry and set-up cannot absorb", "No rows are missing", "declared 1σ", "along Z of the machine: (0.00, 0.00, 1.00)",
    ):  # fmt: skip
        assert words in page.words, words
    assert "µrad" in page.words and not re.search(r"\b(um|urad)\b", page.words.replace("dL_um", "")), "units as written"
    assert text.index('id="finding-1"') < text.index('id="finding-2"') < text.index('id="proof"')
    worth = text[text.index('id="worth"') : text.index('id="proof"')]
    for finding in found.findings:
        assert f"{finding.title} (or gravity sag of axis B (EXB))" in worth
    assert "error at the tool" in worth and "EX0C" in worth and "do not correct" in worth
    assert page.tags.count("article") == 2 and text.count('class="chain"') == 1
    assert "prefers-color-scheme: dark" in text and "@media print" in text and "data-sort=" in text
    assert not re.search(r'(src|href)="(?!data:|#)', text.replace('xlink:href="data:', "")), "loads nothing"


def test_what_is_printed_is_verdict_findings_and_next_step(found):
    text = diagnosis_text(found)
    said = " ".join(text.split())
    assert text.startswith(str(found)) and max(map(len, text.splitlines())) <= 100
    assert text.index("Gravity sag of axis B") < text.index("Thermal drift"), "the largest share first"
    for finding in found.findings:
        assert all(" ".join(answer.split()) in said for answer in facts_of(finding, found.after).values())
    worse = replace(found, fit=replace(found.fit, heldout_rms_after_um=1.9))
    assert "1.67 → 1.9 µm rms" in " ".join(str(worse).split())
    clean = diagnosis_text(replace(found, findings=(), fit=replace(found.fit, chi2_dof_after=1.0)))
    assert "Gravity sag" not in clean and "No fault found" in clean


def test_causes_that_no_test_separates_are_not_sent_to_the_control(found):
    """Generated code corrects what depends on positions; a drift, of the structure or the table, it leaves."""
    drift, sag = sorted(found.findings, key=lambda finding: finding.name == "gravity_sag")
    assert sag.alias and "symfive codegen model.json" in closing(replace(found, findings=(sag,)))
    step = closing(replace(found, findings=(sag, replace(drift, alias=("table_growth",))))).partition("Next: ")[2]
    assert "codegen" not in step and "repeat this test" in step


def test_a_residual_above_the_noise_asks_for_a_repeat_that_there_is_not_yet(found):
    after = replace(found.after, chi2_dof=6.8)
    left = replace(found, findings=(), fit=replace(found.fit, chi2_dof_after=6.8), after=after)
    assert "repeat one run" in closing(left)
    campaign = found.after.model.campaign
    again = tuple(replace(run, id=f"{run.id}-2", file=f"{run.id}-2.csv") for run in campaign.runs)
    repeats = identify(replace(campaign, runs=(*campaign.runs, *again)))
    repeated = replace(left, after=replace(repeats, chi2_dof=6.8))
    assert "repeat one run" not in closing(repeated) and "scatter of the repeated runs" in closing(repeated)


def test_readings_of_two_units_are_said_in_their_own(found):
    """A force of 103 N had been "103 mm of the readings", and its rms nowhere."""
    (run,) = recorded().runs
    run = replace(run, options={k: v for k, v in run.options.items() if k != "motion_from"})
    after = identify(replace(recorded(), runs=(run,)))
    force = np.where(np.arange(run.rows)[:, None] == 7, [0.0, 103.0], 0.0)
    cause = make_effect("unknown", over=("X velocity",), place="force")
    several = replace(
        found.findings[0], name="unknown", effect=cause, contribution={run.id: force}, further=((cause, {}),), moved={}
    )
    assert facts_of(several, after)["how large"] == "up to 103 N of the readings, by 2 terms"
    both = " ".join(str(replace(found, before=after, after=after, findings=())).split())
    assert re.search(r"rms \S+ mm, \S+ N \(all readings\)", both), both


def test_a_size_that_no_machine_has_is_spoken_of(found):
    finding, usual = found.findings[1], found.after
    factor = np.where([p.name.startswith("gravity_sag") for p in usual.parameters], 100.0, 1.0)
    for after, spoken in ((usual, False), (replace(usual, values=factor * usual.values), True)):
        for said in (facts_of(finding, after)["how large"], sentence_of(finding, after)):
            assert ("usual size" in said) == ("times its usual size" in said and "units" in said) == spoken


def test_rivals_and_the_next_test_stand_with_the_finding(found):
    table = (Separation("height 100 mm", 41.2, 3.0),)
    test = Discrimination(found.after.model.campaign, 41.2, 2.0, table)
    rivals = (
        RivalName("error_motion", "B", 0.12, "EXB"),
        RivalName("unknown", None, 0.04),
        RivalName("backlash", "B", 1e-4),
    )
    unsure = replace(found.findings[1], confidence=0.84, rivals=rivals, next_test="plans/apart", test=test)
    facts = facts_of(unsure, found.after)
    assert facts["how sure"] == (
        "confidence 84 % (component open: not separated from EXB); otherwise error motion of axis B (EXB) 12 % "
        "or none of the known effects 4 %"
    )
    assert facts["next test"] == f"record plans/apart: {test.says}"
    assert facts["what to do"].startswith("record the next test") and facts["what to do"].endswith(unsure.effect.action)
    no_test = facts_of(replace(unsure, next_test=None), found.after)
    assert no_test["what to do"] == f"if it is this cause, {unsure.effect.action}"


def test_a_title_names_the_component_unless_others_are_as_good(found):
    """Five components of one axis were five findings of the same title."""
    open_ = found.findings[1]
    assert open_.alias and open_.title == "Gravity sag of axis B"
    assert replace(open_, alias=()).title == "Gravity sag of axis B (EZB)"


def test_a_name_that_only_plausibility_holds_does_not_sound_sure(found, page_of):
    alias = ("backlash.Y", *found.findings[1].alias)
    unsure = replace(found.findings[1], confidence=0.991, by_experience=True, rivals=(), alias=alias)
    assert facts_of(unsure, found.after)["how sure"] == (
        "confidence 99.1 %, by experience: it cannot be distinguished from backlash of axis Y in this test "
        "(component open: not separated from EXB)"
    )
    assert "confidence in the name, by experience" in page_of(unsure)
    beside = replace(unsure, rivals=(RivalName("backlash", "Y", 0.009), RivalName("unknown", None, 0.02)))
    said = facts_of(beside, found.after)["how sure"]
    assert said.count("backlash of axis Y") == 1 and "backlash of axis Y (0.9 %)" in said
    assert said.endswith("; otherwise none of the known effects 2 %")


def test_every_number_of_a_finding_has_its_uncertainty(found):
    """Numbers of a matrix too; where none stands out by itself, how far all together do."""
    matrix = Quantity(((1.007, 0.008), (-0.002, 1.004)), ((0.009, 0.010), (0.005, 0.002)), "1")
    faint = {"P1": Quantity(-5.0, 15.0, "um"), "P2": Quantity(3.0, 9.0, "um")}
    finding = replace(found.findings[1], parameters={"matrix": matrix, **faint}, sigmas=7.4)
    said = facts_of(finding, found.after)["how large"]
    assert "matrix ((1.0070 ± 0.0090, 0.008 ± 0.010), (−0.0020 ± 0.0050, 1.0040 ± 0.0020))" in said
    assert "order 1 −5 ± 15 µm, together 7.4σ from zero, order 2 3.0 ± 9.0 µm" in said


def test_a_fit_that_did_not_converge_says_so_first_and_is_not_recommended(found, page_of):
    after = replace(found.after, converged=False)
    doubtful = replace(found, after=after, findings=())
    for text in (diagnosis_text(doubtful), doubtful.verdict, doubtful.to_data()["says"]):
        assert text.startswith("The fit did not converge: ")
    page = page_of(after=after)
    assert "<strong>The fit did not converge: " in page and 'class="verdict yes"' not in page
    for findings in (found.findings, ()):
        step = closing(replace(doubtful, findings=findings)).partition("Next: ")[2]
        assert "do not use model.json" in step and "record further runs" in step


def test_what_geometry_and_set_up_explain_is_a_share_of_its_own(found):
    assert found.geometry_share == pytest.approx(
        1.0 - (found.fit.rms_after_um / found.fit.rms_before_um) ** 2 - 0.842, abs=0.02
    )
    small = replace(found, findings=tuple(replace(f, share=0.1) for f in found.findings))
    assert "explained by geometry and set-up (refitted): 7" in str(small)


def test_badges_on_one_link_are_stacked(found):
    machine = found.after.model.machine
    many = [(number, finding) for number, finding in enumerate([*found.findings, *found.findings] * 3, start=1)]
    text = chain_picture(machine, many, "many")
    places = [(float(x), float(y)) for x, y in re.findall(r'class="badge" cx="(-?[\d.]+)" cy="(-?[\d.]+)"', text)]
    assert len(places) == 12
    gaps = [np.hypot(x - u, y - v) for i, (x, y) in enumerate(places) for u, v in places[:i]]
    assert min(gaps) >= 22.0
    top, height = (float(v) for v in re.search(r'viewBox="0 (-?[\d.]+) [\d.]+ ([\d.]+)"', text).groups())
    assert all(top + 11.0 <= y <= top + height - 11.0 for _, y in places)


def test_every_figure_of_the_page_is_a_file_too(written):
    drawn = set(re.findall(r'<figure id="([^"]+)"', written.read_text()))
    assert {path.stem for path in (written.parent / "figures").iterdir()} == drawn
    assert {"finding-1-residual", "finding-2-residual", "geometry", "residuals-over-time"} <= drawn
    assert sorted(p.name for p in written.parent.iterdir()) == ["figures", "report.html"]


def test_hovering_tells_the_numbers(written):
    text = written.read_text()
    assert re.search(r"<use [^>]*><title>nest1, pose \d+, B −?\d+ °: −?[\d.]+ → −?[\d.]+ µm</title></use>", text)
    assert re.search(r"<title>EX0C after: −?[\d.]+ ± [\d.]+ µm</title>", text)
    assert len(set(re.findall(r' id="([^"]+)"', text))) == len(re.findall(r' id="([^"]+)"', text)), "ids are unique"


def closing(diagnosis):
    """The last sentences of what is printed."""
    return "In short: " + " ".join(diagnosis_text(diagnosis).split()).partition("In short: ")[2]


def test_a_clean_campaign_gets_a_short_page(found, tmp_path, monkeypatch):
    monkeypatch.setattr(_diagnosis, "drawn", lambda *_: "")
    fit = replace(found.fit, heldout_rms_before_um=None, heldout_rms_after_um=None)
    clean = replace(found, findings=(), p_value=0.4, fit=fit, before=found.after)
    text = diagnosis_report(clean, tmp_path).read_text()
    page = Page(text)
    assert "No fault found" in page.words and 'class="verdict yes"' in text
    assert "backlash of axis Y" in page.words and page.tags.count("article") == 0 and "0.4" in page.words
    assert not (tmp_path / "figures" / "geometry.png").exists()


def test_what_users_wrote_is_escaped(found, drawn_page_of):
    first = found.findings[1]
    evil = replace(
        first, says=HOSTILE, next_test=f"next/{HOSTILE}", runs=(*first.runs, "<img src=x onerror=alert(1)>"),
        coordinate=HOSTILE, alias=(HOSTILE,), rivals=(RivalName(HOSTILE, HOSTILE, 0.2, HOSTILE),), axis=HOSTILE,
        intervals=(Interval(HOSTILE, 0.0, 1.0),),
    )  # fmt: skip
    after = replace(found.after, notes=(HOSTILE,), outliers=(Outlier("nest1", 3, "dx_um", 9.0, 22.0),))
    odd = Observability(HOSTILE, HOSTILE, HOSTILE, 0.1, 2.0)
    location = replace(found.location, observability=(odd,), classes=((HOSTILE, "b"),))
    page = Page(drawn_page_of(evil, after=after, location=location))
    assert page.tags.count("script") == 1 and "img" not in page.tags
    assert not any(name.startswith("on") for name, _ in page.attributes)
    assert page.words.count(HOSTILE) >= 8 and "nest1.csv" in page.words


def test_the_next_test_is_a_link_with_what_it_is_expected_to_tell(found, page_of):
    table = (Separation("height 100 mm", 41.2, 3.0), Separation("repeat", 2.1, 3.0))
    test = Discrimination(found.after.model.campaign, 41.2, 2.0, table)
    finding = replace(found.findings[0], next_test="next-test/thermal_drift", test=test)
    text = page_of(finding)
    assert '<a href="next-test/thermal_drift">' in text
    assert "Height 100 mm separates the two by 41.2σ" in text and ">repeat<" in text and ">2.1<" in text


def test_the_visible_part_is_what_the_residual_shows(found):
    """The residual before is noise and the visible parts of all findings."""
    parts = visible_parts(found.before, [f.contribution for f in found.findings])
    for run in found.before.residuals:
        left = found.before.residuals[run] - parts[0][run] - parts[1][run]
        assert np.sqrt(np.mean(left**2)) < 1.1 * found.noise_um
    assert visible_parts(found.before, []) == []


@pytest.mark.parametrize(
    ("stage", "axis", "part"),
    [
        ("servo_mismatch", "X", "drive"), ("backlash", "B", "axis"), ("thermal_drift", None, "loop"),
        ("latency", None, "instrument"), ("sensor_error", None, "instrument"),
    ],
)  # fmt: skip
def test_the_affected_link_follows_the_stage(found, stage, axis, part):
    machine = found.after.model.machine
    finding = replace(found.findings[0], effect=make_effect(stage, axis), axis=axis, coordinate="t")
    assert affected_link(finding, machine).part == part and affected_link(finding, machine).timed
    picture = chain_picture(machine, [(1, finding)], HOSTILE)
    assert "affected" in picture and 'class="badge"' in picture and "<script" not in picture
    assert "affected" not in chain_picture(machine, [], "chain")


COORDINATES = {
    "B velocity sign": ["B / °"], "X velocity": ["velocity of X / (mm/s)"], "t": ["time of the campaign / min"],
    "X acceleration": ["acceleration of X / (mm/s²)"], "pose": ["row of the campaign, in the order of the runs"],
    "B, C": ["B / °", "C over one revolution / °"],
}  # fmt: skip


@pytest.mark.parametrize(
    "coordinate",
    [c if c in ("B velocity sign", "t", "B, C") else pytest.param(c, marks=pytest.mark.slow) for c in COORDINATES],
)
def test_coordinates_are_drawn_with_their_units(found, drawn_page_of, coordinate):
    drawn = drawn_page_of(replace(found.findings[1], coordinate=coordinate)).partition(
        '<figure id="finding-1-residual"'
    )[2]
    words = Page(drawn.partition("</figure>")[0]).words.replace(" over one revolution", "")
    for label in COORDINATES[coordinate]:
        assert label.replace(" over one revolution", "") in words
    assert ("B moving in −" in words) == (coordinate == "B velocity sign")


def test_geometry_that_the_machine_file_leaves_free_is_said_without_a_fault() -> None:
    """80 µm/m of squareness are no fault to look for, and what a ball bar is asked for."""
    machine = preset("three-axis")
    kept = {"EC0X": machine.errors["EC0X"]}
    plan = campaign_of(replace(machine, errors=kept), planar_circle(machine, feed=1000.0, rate_hz=10.0))
    found = diagnose(simulate(plan, truth={"EC0X": 80.0}, seed=2).campaign)
    text = " ".join(diagnosis_text(found).split())
    assert not found.findings and re.search(r"Geometry identified beyond 2σ: EC0X (79|80)\.\d+ ± 0\.\d+ µrad", text)
    assert re.search(r"On the circles \(ISO 230-1, k = 2\): squareness Y to X = -?−?(79|80)\.\d+ µm/m", text)
