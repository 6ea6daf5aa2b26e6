"""The story: the path, the simulations, symfive beside them, the concealed peak, the better plan, the table of claims."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from examples.claims import Claim, write_claims
from symfive.campaign import write_campaign
from symfive.diagnose import diagnose
from symfive.outputs import write_json

from .claims import claims_of_the_simulations
from .concealed import (
    ALONE,
    CENTRED,
    ECCENTRIC,
    SLOWER,
    claims_of_the_concealment,
    look,
    measured,
    named,
    own_trace,
    sentences,
)  # fmt: skip
from .figures import save_all
from .information import claims_of_the_plan, curve, gain
from .path import Circle
from .path_claims import claims_of_the_chain, claims_of_the_path
from .simulations import case_of, run_all
from .twin import Comparison, compare

TITLE = "Tsutsumi, Yumiza, Utsumi & Sato 2007: claims"
COMPARED = ("linear", "linear, friction", "linear, worm", "linear, play", "full")


def compared() -> list[tuple[str, Comparison]]:
    """symfive beside the paper's drives, one addition at a time and all together, at X_T/r = 0.9 and 1.1."""
    names = [(u, form) for u in (0.9, 1.1) for form in COMPARED]
    found = compare([case_of(Circle(50.0 * u), form) for u, form in names])
    return [(f"{form}, X_T/r = {u:g}", one) for (u, form), one in zip(names, found, strict=True)]


def claims_of_the_twin(found: list[tuple[str, Comparison]]) -> list[Claim]:
    """How far symfive's forms are from the paper's, µm."""
    return [
        Claim(
            id="twin", statement=f"symfive less the paper's drives: {name}", where="fig. 4", paper="0", ours=one.worst_um,
            low=0.0, high=0.15, unit="µm", note=f"at {one.where_deg:.0f}°",
        )
        for name, one in found
    ]  # fmt: skip


def main(arguments: list[str] | None = None) -> int:
    """Run the story, say what comes out; 1 where a claim is not settled."""
    parser = argparse.ArgumentParser(prog="python -m examples.tsutsumi_2007", description=__doc__)
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("tsutsumi-2007-results"), help="folder for the results"
    )
    folder: Path = parser.parse_args(arguments).output
    begin = time.perf_counter()

    claims = [*claims_of_the_path(), *claims_of_the_chain()]
    print(f"1 The path: (3) to (8) against automatic differentiation, {len(claims)} figures")

    found = run_all()
    claims += claims_of_the_simulations(found)
    for u in (0.9, 1.0, 1.1):
        loops, all_of_it = (found.trace(u, form).at(180.0) for form in ("linear", "full"))
        print(f"2 Simulated X_T/r = {u:g}: E(180°) {loops:+.1f} µm by the loops alone, {all_of_it:+.1f} µm in all")

    pairs = compared()
    claims += claims_of_the_twin(pairs)
    worst = max(pairs, key=lambda pair: pair[1].worst_um)
    turn = max(abs(one.play_um).max() for _, one in pairs)
    print(f"3 symfive beside the paper's drives: at most {worst[1].worst_um:.2f} µm apart ({worst[0]}),")
    print(f"  once C is turned by half its play ({turn:.1f} µm), since the paper's play touches on the positive flank")

    campaigns = measured()
    write_campaign(campaigns[ECCENTRIC], folder / "eccentric", overwrite=True)
    view = look(campaigns[ECCENTRIC])
    print("4 Concealed by dx = +30 µm:")
    for words, fit in (
        ("geometry alone", view.geometry),
        ("with drives", view.drives),
        ("diagnosed", view.diagnosis.after),
    ):
        print(f"  {words}: dx = {fit['EX0C']:.1f} ± {fit.uncertainty('EX0C'):.1f} µm, {fit.rms_um:.2f} µm rms left")
    print("\n".join(sentences(view.diagnosis)))
    one_way = campaigns[ECCENTRIC].runs[0].id
    others = {name: diagnose(campaigns[name].select(one_way)) for name in (ALONE, SLOWER)}
    for name, diagnosis in others.items():
        print(f"  {name}: {', '.join(named(diagnosis)) or 'no finding'}")
        print("\n".join(sentences(diagnosis)))
    true = own_trace(campaigns[CENTRED])
    claims += claims_of_the_concealment(view, true, others)
    write_json(folder / "diagnosis.json", view.diagnosis.to_data())

    information, plans = curve(), gain()
    claims += claims_of_the_plan(information, plans)
    print("5 What X_T/r tells (1σ of C's gain and play):")
    for ratio in (0.5, 0.9, 1.1, 1.45, 1.8):
        shown = information.ratio[abs(information.ratio - ratio).argmin()]
        print("  {:.2f}: {:.5f} 1/s, {:.2f} µrad".format(shown, *information.at(ratio)))

    files = save_all(folder / "figures", found, pairs[:5], view, true, information)
    write_claims(claims, folder, TITLE)
    open_ones = [claim for claim in claims if not claim.settled]
    wrong = [claim for claim in claims if claim.refuted]
    print(
        f"6 {len(claims)} figures: {len(claims) - len(open_ones) - len(wrong)} reproduced, {len(wrong)} statements wrong"
    )
    for claim in [*wrong, *open_ones]:
        print(f"  {claim.verdict}: {claim.id} {claim.statement}: {claim.ours:.4g} {claim.unit} {claim.note}")
    print(f"Done in {time.perf_counter() - begin:.0f} s. {len(files)} figures and the table: {folder.resolve()}")
    return 1 if open_ones else 0
