"""The example of Wang & Li 2016: claims come out as their table says, both methods do what is said of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from claim_checks import assert_refuted, assert_reproduced

from examples.panels import save
from examples.wang_li_2016 import b_motions, claims, equations, figures, machine, machines, plates, screw, story
from examples.wang_li_2016.estimators import SLOPES, Joint, Sequence
from symfive.campaign import read_campaign, write_campaign
from symfive.model import Model
from symfive.procedures import campaign_of

ROOT = Path(__file__).resolve().parent.parent

WRONG = {"P1-2b", "P1-2d", "P1-3b", "P1-4a", "P1-5d", "P1-5g", "P1-5k", "P1-9b"}
REPRODUCED = {
    *(f"P1-1{letter}" for letter in "abcdefghijklmnopqrstu"), "P1-2a", "P1-2c", "P1-3a", "P1-3c", "P1-3d", "P1-3e", "P1-4b",
    "P1-4c", *(f"P1-5{letter}" for letter in "abcefhijlmnopqr"), "P1-6", *(f"P1-7{letter}" for letter in "abcdefghi"),
    *(f"P1-8{letter}" for letter in "abcde"), "P1-9a",
}  # fmt: skip


@pytest.fixture(scope="module")
def again():
    return claims.repeated()


@pytest.fixture(scope="module")
def of_b():
    return b_motions.turned()


@pytest.fixture(scope="module")
def found(again, of_b):
    return {claim.id: claim for claim in claims.all_claims(again, of_b)}


@pytest.fixture(scope="module")
def campaign():
    return machine.whole_campaign(machine.paper_machine())


@pytest.fixture(scope="module")
def fate(campaign):
    return machines.compare(campaign, count=300)


@pytest.fixture(scope="module")
def one():
    return story.one_machine(pitch=20.0, b_step=10.0)


@pytest.fixture(scope="module")
def askew():
    return plates.yawed(pitch=20.0)


@pytest.mark.slow
def test_every_claim_is_in_the_table_once(found):
    assert set(found) == REPRODUCED | WRONG


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(REPRODUCED))
def test_a_claim_is_reproduced_within_its_limits(found, name):
    assert_reproduced(found[name])


@pytest.mark.parametrize("name", sorted(WRONG))
def test_a_claim_is_wrong_and_the_reason_is_given(found, name):
    assert_refuted(found[name])


def test_the_page_has_every_claim_as_it_comes_out(found):
    page = (ROOT / "docs" / "papers" / "wang-li-2016.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line[1:-1].split("|")] for line in page.splitlines() if line.startswith("| P1-")]
    assert sorted(row[0] for row in rows) == sorted(found)
    for name, statement, paper, ours, _, verdict, note in rows:
        claim = found[name]
        assert [statement, paper, verdict, note] == [claim.statement, claim.paper, claim.verdict, claim.note]
        assert float(ours.split()[0]) == pytest.approx(claim.ours, rel=2e-3, abs=1e-9), name


def test_the_printed_chain_has_no_squareness_and_the_corrected_one_has(found):
    assert found["P1-4a"].ours == 0.0
    assert equations.squareness_seen(2e-4, printed=False) == pytest.approx(2e-4)


def test_the_wrong_lever_and_the_literal_equation_cost_micrometres(found):
    assert found["P1-3b"].ours > 4.0
    assert found["P1-5d"].ours > 5.0


def test_both_methods_are_unbiased_where_nothing_is_askew(again):
    for name, value in machine.ASSUMED.items():
        for estimate in (again.sequence, again.joint):
            error = estimate[name].mean() - value
            assert abs(error) < 4.0 * estimate[name].std() / np.sqrt(len(estimate[name])) + 0.06, name
        assert again.joint[name].std() <= 1.03 * again.sequence[name].std()
        assert again.joint[name].std() == pytest.approx(again.stated[name], rel=0.05)


def test_the_plant_and_symfive_give_the_same_readings(campaign):
    model = Model(campaign)
    values = machine.draw(model.parameters, 2, seed=5)
    named = {p.name: values[:, i] for i, p in enumerate(model.parameters)}
    readings, predicted = machine.readings_of(campaign, named, 2), model.predict(values[1])
    for run in campaign.runs:
        np.testing.assert_allclose(readings[run.id][1], predicted[run.id], atol=1e-7)


def test_without_noise_and_set_up_errors_the_sequence_finds_what_is_there(campaign):
    """Error motions of C leak into its location errors, which (14), (15) take to be the only ones: they are tried apart."""
    model = Model(campaign)
    values = machine.draw(model.parameters, 3, seed=6, truth=dict.fromkeys(SLOPES, 0.0))
    seen = {p.name: values[:, i] for i, p in enumerate(model.parameters) if not p.name.startswith(("setup.", "ECC"))}
    motions = {name for name in seen if name[2:].startswith("C.")}
    location = {"EX0C", "EY0C", "EA0C", "EB0C"}
    for out, judged in ((set(), set(seen) - location), (motions, location)):
        truth = {name: value for name, value in seen.items() if name not in out}
        estimate = Sequence(campaign).estimate(machine.readings_of(campaign, truth, 3))
        assert set(estimate) == set(seen) - set(SLOPES)
        for name in judged - set(SLOPES):
            np.testing.assert_allclose(estimate[name], truth[name], atol=0.5, err_msg=name)  # products of errors


def test_one_step_is_the_identification_of_symfive(one):
    """The matrix that serves a thousand machines and `identify` agree on one."""
    readings = {run.id: np.stack(list(run.readings.values()), axis=1)[None] for run in one.campaign.runs}
    joint = Joint.of(one.campaign)
    at_once = joint.estimate(readings)
    for name in ("EC0X", "EA0B", "EX0C", "EAC.cos2", "EXX.P1", "EAX.P1"):
        assert at_once[name][0] == pytest.approx(one.joint[name], abs=0.05 * one.joint.uncertainty(name))
        assert joint.sigma[name] == pytest.approx(one.joint.uncertainty(name), rel=1e-2)


def test_over_many_machines_the_joint_estimate_is_better_and_honest(fate):
    assert len(fate.spread) == 79
    assert all(fate.gain(name) > 1.0 for name in fate.spread)
    assert fate.gain("EAX.P1") > 4.0  # plate yaw read as roll
    assert fate.gain("EA0C") > 5.0  # the tool ball off the axis at two heights
    assert fate.honest < 0.15
    assert all(fate.flat[name] < 1.1 * fate.spread[name][0] for name in fate.spread)  # not for what the priors say
    for name, (sequence, joint) in fate.bias.items():
        spread = fate.spread[name]
        assert abs(sequence) < 4.0 * spread[0] / np.sqrt(fate.count), name
        assert abs(joint) < 4.0 * spread[1] / np.sqrt(fate.count), name
    assert max(fate.largest_bias(0), fate.largest_bias(1)) < 4.0


def test_the_error_motions_of_b_are_found_at_once_and_hardly_in_sequence(of_b):
    sequence, joint = of_b.rms(of_b.spread)
    assert (joint < (0.5, 0.6, 0.5, 5.0, 5.0, 7.0)).all()
    assert (sequence > 3.0 * joint).all()  # a set-up that is off looks like a motion
    assert (of_b.rms(of_b.perfect[1]) < (0.5, 0.6, 0.6, 4.5, 6.0, 6.0)).all()
    two, three, prior = (of_b.rms(std) for std in (of_b.two_balls, of_b.stated, of_b.prior))
    assert (two[:5] < 1.3 * three[:5]).all()
    assert two[5] > 1.6 * three[5]  # the turn about the line of the two balls
    assert two[5] < prior[5]  # only since all harmonics end at 3b


def test_a_turn_about_the_line_of_two_balls_moves_neither():
    b, still = np.radians(np.arange(-90.0, 91.0, 15.0)), np.zeros(13)
    about = np.stack([still, still, still, np.sin(b), still, np.cos(b)], axis=1)
    for name, ball in b_motions.BALLS_MM.items():
        moved = [np.einsum("nk,nk->n", equations.b_motions(b, ball, way), about) for way in np.eye(3)]
        size = 100.0 if name == "beside" else 0.0
        np.testing.assert_allclose(np.linalg.norm(moved, axis=0), size, atol=1e-12)


@pytest.mark.slow
def test_one_turning_machine_and_its_figure(tmp_path):
    one = b_motions.one_turned()
    inside = np.abs(one.joint - one.true) < 3.0 * one.std
    assert inside.mean() > 0.95
    assert one.result.chi2_dof == pytest.approx(1.0, abs=0.1)
    save(figures.motions_of_b(one), tmp_path, "motions-of-b")
    assert (tmp_path / "motions-of-b.png").stat().st_size > 10_000


def test_a_plain_slope_is_not_the_squareness(campaign):
    raw = machines.raw_slopes(campaign, count=50)
    assert raw["EB0Z"] > 10.0
    assert raw["EC0X"] > 8.0


@pytest.mark.slow
def test_an_askew_plate_reads_as_roll_and_is_found(askew):
    assert askew.false_roll == pytest.approx(
        plates.YAW_URAD * 400.0 / 100.0, rel=0.01
    )  # travel over distance of the lines
    assert askew.diagnosis.mismatch
    assert not askew.clean.mismatch
    assert any("EAX (order 1)" in words and "plate c of run x-line2-xy" in words for words in askew.says)
    assert abs(askew.known["EAX.P1"]) < 2.0 * askew.known.uncertainty("EAX.P1")


@pytest.mark.slow
def test_a_screw_is_missed_every_5_mm_and_named_every_2_mm(tmp_path):
    found = screw.screw()
    assert not found.paper.mismatch
    assert [f.name for f in found.denser.findings] == ["transmission_error"]
    named = found.named.parameters
    assert named["amplitude"].value == pytest.approx(screw.SIZE_UM, abs=4.0 * named["amplitude"].std)
    assert named["period"].value == pytest.approx(screw.LEAD_MM, abs=0.02)
    save(figures.screws(found), tmp_path, "screw")


def test_the_tests_of_the_paper_are_a_plan(tmp_path):
    whole = machine.paper_machine()
    plan = campaign_of(whole, (*machine.grid_tests(whole), *machine.bar_tests(whole, motions=True)))
    write_campaign(plan, tmp_path / "plan")
    assert read_campaign(tmp_path / "plan").rows == plan.rows
    assert not plan.measured


def test_moving_x_gives_y_no_lever():
    """The reason why a line for Y needs the reading head on a holder: X stands on Y."""
    whole = machine.paper_machine()
    runs = {run.id: run for run in machine.grid_tests(whole) if run.id.startswith("y-line")}
    assert runs["y-line2-yz"].tool_ball[0] == 100.0
    assert np.ptp(runs["y-line2-yz"].commands["X"]) == 0.0
    placed = replace(runs["y-line2-yz"], tool_ball=(0.0, 0.0, -150.0))
    moved = {**placed.commands, "X": np.full(placed.rows, 100.0)}
    errors = {"EBY.P1": np.array([100.0])}
    for run, lever in ((runs["y-line2-yz"], 100.0), (replace(placed, commands=moved), 0.0)):
        one = campaign_of(whole, [run])
        change = machine.readings_of(one, errors, 1)[run.id] - machine.readings_of(one, {}, 1)[run.id]
        slope = np.ptp(change[0, :, 1])
        assert slope == pytest.approx(1e-3 * lever * 100.0 * 400.0 / 250.0, abs=0.1)


@pytest.mark.slow
def test_the_plan_needs_fewer_readings():
    gain = story.gain_of_a_plan()
    assert gain.plan.campaign.rows < 0.2 * gain.tests.rows
    assert len(gain.plan.campaign.runs) == 2
    assert all(ratio > 0.6 for ratio in gain.ratio.values())
    assert min(gain.ratio[n] for n in ("EX0C", "EA0C", "EB0C")) > 10.0


@pytest.mark.slow
def test_one_machine_and_its_figures(one, fate, askew, tmp_path):
    inside = [abs(one.joint[n] - one.truth[n]) < 3.0 * one.joint.uncertainty(n) for n in fate.spread]
    assert np.mean(inside) > 0.97
    drawn = {
        "grid": figures.cross_grid(one.campaign),
        "motions": figures.six_error_motions(one.campaign, one.joint, one.truth),
        "bar": figures.ball_bar(one.campaign),
        "conditioning": figures.conditioning(),
        "machines": figures.fates(fate),
        "yaw": figures.plate_yaw(askew.known.model.campaign, askew.known, plates.YAW_URAD),
    }
    for name, figure in drawn.items():
        save(figure, tmp_path, name)
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
