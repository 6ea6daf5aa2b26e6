"""The paper from end to end: `python -m examples.wang_li_2016 -o RESULTS`.

A cross grid finds the squarenesses and the six error motions of each linear axis from three lines, a double ball bar the
location errors of B and C and the error motions of C and B: stage by stage, as printed. The same readings then go to one
joint estimate, on one machine and on a thousand. At the end stand a plan that needs fewer tests, a plate laid askew and a screw
whose error the paper's readings cannot show.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence as Arguments
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from examples.claims import write_claims
from examples.panels import save
from symfive.campaign import Campaign, write_campaign
from symfive.design import Assessment, Plan, assess, plan
from symfive.identify import Identification, identify
from symfive.model import Model
from symfive.outputs import write_json
from symfive.procedures import campaign_of

from . import figures
from .b_motions import COMBINED, Turned, one_turned, turned
from .claims import all_claims, repeated
from .equations import LOCATION
from .estimators import SLOPES, Sequence
from .machine import ASSUMED, BAR_SETUP, NOISE_UM, bar_tests, draw, grid_tests, measured, paper_machine, whole_campaign
from .machines import Fate, compare, raw_slopes
from .plates import YAW_URAD, Yawed, yawed
from .screw import LEAD_MM, SIZE_UM, Screw, screw

Array = NDArray[np.float64]
TITLE = "Wang & Li 2016: cross grid encoder and double ball bar"
SQUARENESS = ("EC0X", "EB0Z", "EA0Z")


@dataclass(frozen=True)
class One:
    """One machine with its readings: `truth`, what the sequence found (µm, µrad), and the joint identification."""

    campaign: Campaign
    truth: dict[str, float]
    in_sequence: dict[str, float]
    joint: Identification


def one_machine(*, pitch: float = 10.0, b_step: float = 5.0, seed: int = 7) -> One:
    """Draw a machine with the assumed location errors, measure it with everything a little askew, evaluate it both ways."""
    plan_of_all = whole_campaign(paper_machine(), pitch=pitch, b_step=b_step)
    model = Model(plan_of_all)
    values = draw(model.parameters, 1, seed, truth=ASSUMED | dict.fromkeys(SLOPES, 0.0))[0]
    truth = model.named(values)
    campaign = measured(plan_of_all, truth, seed=seed)
    readings = {run.id: np.stack(list(run.readings.values()), axis=1)[None] for run in campaign.runs}
    found = {name: float(value[0]) for name, value in Sequence(campaign).estimate(readings).items()}
    return One(campaign, truth, found, identify(campaign, fixed=dict.fromkeys(SLOPES, 0.0), noise="declared"))


@dataclass(frozen=True)
class Gain:
    """Expected 1σ with the paper's five ball-bar tests and with an optimised plan: same noise, same set-ups."""

    tests: Campaign
    of_tests: Assessment
    plan: Plan

    @property
    def ratio(self) -> dict[str, float]:
        """1σ of the paper's tests over 1σ of the plan."""
        return {n: self.of_tests.sigma[n] / self.plan.assessment.sigma[n] for n in LOCATION}


def gain_of_a_plan(*, points: int = 24, setups: int = 2) -> Gain:
    """The eight location errors, balls known to 10 µm and the bar to 0.5 µm in every set-up."""
    machine = paper_machine(errors="location")
    tests = campaign_of(machine, bar_tests(machine, b_step=5.0, c_step=15.0))
    made = plan(
        machine, instrument="ball_bar", points=points, setups=setups, starts=1, anywhere=False, returns=0,
        noise_um=float(NOISE_UM), setup_sigma=BAR_SETUP,
    )  # fmt: skip
    return Gain(tests, assess(tests), made)


def _table(one: One) -> list[str]:
    lines = [f"  {'error':<6}{'true':>9}{'sequence':>10}{'joint':>10}  ± 1σ"]
    for name in (*SQUARENESS, *LOCATION):
        unit = "µrad" if name[1] in "ABC" else "µm"
        lines.append(
            f"  {name:<6}{one.truth[name]:9.2f}{one.in_sequence[name]:10.2f}{one.joint[name]:10.2f}  "
            f"± {one.joint.uncertainty(name):.2f} {unit}"
        )
    return lines


def findings_data(
    fate: Fate, raw: dict[str, float], of_b: Turned, gain: Gain, plates: Yawed, periodic: Screw
) -> dict[str, Any]:
    """What came out beside the claims, as data: µm, µrad, minutes."""
    return {
        "machines": {
            "count": fate.count, "bias": {n: list(v) for n, v in fate.bias.items()},
            "std": {n: list(v) for n, v in fate.spread.items()}, "joint_with_wide_priors": dict(fate.flat),
            "stated": dict(fate.stated), "prior": dict(fate.prior), "worst_of_stated": fate.honest,
        },
        "squareness_as_plain_slope_rms_urad": raw,
        "motions_of_b_less_1_cos_sin_rms_over_b": {
            "machines": of_b.count,
            "std": {n: of_b.rms(of_b.spread[:, k]).tolist() for k, n in enumerate(COMBINED)},
            "in_sequence_perfect_setups": dict(zip(COMBINED, of_b.rms(of_b.perfect[1]).tolist(), strict=True)),
            "stated": dict(zip(COMBINED, of_b.rms(of_b.stated).tolist(), strict=True)),
            "stated_with_two_balls": dict(zip(COMBINED, of_b.rms(of_b.two_balls).tolist(), strict=True)),
            "prior": dict(zip(COMBINED, of_b.rms(of_b.prior).tolist(), strict=True)),
        },
        "plan": {
            "tests": {
                "readings": gain.tests.rows, "setups": len(gain.tests.runs),
                "std": {n: gain.of_tests.sigma[n] for n in LOCATION},
            },
            "plan": {
                "readings": gain.plan.campaign.rows, "setups": len(gain.plan.campaign.runs),
                "std": {n: gain.plan.assessment.sigma[n] for n in LOCATION}, "certificate": gain.plan.certificate.says,
            },
        },
        "plate": {
            "yaw_urad": YAW_URAD, "false_roll_urad": plates.false_roll, "aligned": plates.diagnosis.to_data(),
            "roll": {n: [plates.known[n], plates.known.uncertainty(n)] for n in plates.known.model.index if n.startswith("EAX.")},
            "not_told_apart": list(plates.says), "orientation_unknown": plates.clean.to_data(),
        },
        "screw": {
            "period_mm": LEAD_MM, "size_um": SIZE_UM, "every_5_mm": periodic.paper.to_data(),
            "every_2_mm": periodic.denser.to_data(),
        },
    }  # fmt: skip


def main(arguments: Arguments[str] | None = None) -> int:
    """Run the story; 0 if every claim is reproduced, or shown wrong with its reason."""
    parser = argparse.ArgumentParser(prog="python -m examples.wang_li_2016", description=__doc__)
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("wang-li-2016-results"), help="folder for the results"
    )
    folder: Path = parser.parse_args(arguments).output
    begin = time.perf_counter()
    pictures, machine = folder / "figures", paper_machine()

    tests = campaign_of(machine, (*grid_tests(machine), *bar_tests(machine, motions=True)), "wang-li-2016")
    write_campaign(tests, folder / "plan", overwrite=True)
    print(f"1 Machine: {machine.name}, {machine.structure.code}; {len(machine.errors)} errors")
    print(f"  the paper's tests as a plan: {len(tests.runs)} runs, {tests.rows} readings: {folder / 'plan'}")

    one = one_machine()
    print("2 One machine, every set-up a little askew: squareness and location errors")
    print("\n".join(_table(one)))
    print(f"  joint: chi²/dof {one.joint.chi2_dof:.3f}, rank {one.joint.rank} of {len(one.joint.parameters)}")
    save(figures.cross_grid(one.campaign), pictures, "cross-grid")
    save(figures.six_error_motions(one.campaign, one.joint, one.truth), pictures, "six-error-motions")
    save(figures.ball_bar(one.campaign), pictures, "ball-bar")
    save(figures.conditioning(), pictures, "conditioning")

    again, of_b = repeated(), turned()
    claims = all_claims(again, of_b)
    write_claims(claims, folder, TITLE)
    print(f"3 Claims: {sum(c.holds for c in claims)} reproduced, {sum(not c.holds for c in claims)} shown wrong")
    print("\n".join(f"  {c.id} {c.statement}: {c.ours:.4g} {c.unit}: {c.note}" for c in claims if not c.holds))

    campaign = whole_campaign(machine)
    fate, raw = compare(campaign), raw_slopes(campaign)
    print(f"4 {fate.count} machines drawn from the priors, noise ±2 µm: bias and 1σ of the error, sequence and joint")
    for name in (*SQUARENESS, *LOCATION, "EAX.P1", "EYX.P2", "EXX.P1", "EXC.cos2"):
        both = "".join(f"{fate.bias[name][k]:8.2f} ±{fate.spread[name][k]:7.2f}" for k in (0, 1))
        unit = "µrad" if name[1] in "ABC" else "µm"
        print(f"  {name:<9}{both} {unit:<4} (stated {fate.stated[name]:.2f}, prior {fate.prior[name]:g})")
    biases = ", ".join(f"{word} {fate.largest_bias(k):.1f}" for k, word in enumerate(("sequence", "joint")))
    print(f"  largest bias of {len(fate.bias)} errors, in 1σ of a mean of {fate.count}: {biases}")
    print(
        f"  the joint 1σ is what it claims to be within {100.0 * fate.honest:.0f} % for all {len(fate.spread)} errors"
    )
    slopes = ", ".join(f"{name} {value:.0f}" for name, value in raw.items())
    print(
        f"  squareness as a plain slope, without what the axis' rotations do at their levers: off by {slopes} µrad rms"
    )
    save(figures.fates(fate), pictures, "thousand-machines")

    print(
        f"5 Error motions of B less what location errors take, {of_b.count} machines: 1σ, rms over b, sequence and joint"
    )
    for k, name in enumerate(COMBINED):
        both = "".join(f"{value:8.2f}" for value in of_b.rms(of_b.spread[:, k]))
        ideal, stated, two, known = (
            float(of_b.rms(std[k])) for std in (of_b.perfect[1], of_b.stated, of_b.two_balls, of_b.prior)
        )
        unit = "µm" if k < 3 else "µrad"
        print(f"  {name:<22}{both} {unit:<4} (stated {stated:.2f}, by two balls {two:.2f}, prior {known:.1f};")
        print(f"  {'':<22} in sequence with perfect set-ups {ideal:.2f})")
    save(figures.motions_of_b(one_turned()), pictures, "motions-of-b")

    gain = gain_of_a_plan()
    rows, fewer = gain.tests.rows, gain.plan.campaign.rows
    print(f"6 Ball bar planned: {fewer} readings in {len(gain.plan.campaign.runs)} set-ups", end=" ")
    print(f"instead of {rows} in {len(gain.tests.runs)}; 1σ of the tests over 1σ of the plan:")
    print("  " + ", ".join(f"{name} {ratio:.2f}" for name, ratio in gain.ratio.items()))
    words = (f"the paper's {len(gain.tests.runs)} tests, {rows} readings", f"plan, {fewer} readings")
    save(figures.plans(gain.of_tests, gain.plan.assessment, words), pictures, "plans")

    plates = yawed()
    print(f"7 A plate {YAW_URAD:g} µrad askew under the second line of an axis that does not roll")
    print(
        f"  (10) finds a roll of {plates.false_roll:.0f} µrad between the ends of the line, and nothing contradicts it"
    )
    print(f"  diagnosis, plates taken as aligned: {plates.diagnosis.summary}")
    print("  with the orientation as an unknown: " + "; ".join(plates.says))
    print(f"  diagnosis then: {plates.clean.summary}")
    save(figures.plate_yaw(plates.known.model.campaign, plates.known, YAW_URAD), pictures, "plate-yaw")

    periodic = screw()
    print(f"8 A screw error of X, {SIZE_UM:g} µm, period {LEAD_MM:g} mm; the diagnosis of line 1")
    print(f"  read every 5 mm: {periodic.paper.summary}")
    print(f"  read every 2 mm: {periodic.denser.summary}")
    save(figures.screws(periodic), pictures, "screw")
    write_json(folder / "findings.json", findings_data(fate, raw, of_b, gain, plates, periodic))
    print(f"Done in {time.perf_counter() - begin:.0f} s: {folder.resolve()}")
    return 0 if all(claim.settled for claim in claims) else 1
