"""The paper from end to end: `python -m examples.oyama_2010 -o RESULTS`.

An R-test calibrates itself, maps the six errors of a tilting table B at seven angles and those of the turning table C on it
at 7 × 12 poses, and the map compensates the machine. Beside every step stands what the printed equations do not say. Then
the same readings go to symfive, whose diagnosis names what a map absorbs unnoticed.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from examples.claims import write_claims
from examples.panels import save
from symfive.diagnose import Diagnosis
from symfive.outputs import write_json

from . import figures
from .claims import all_claims
from .machine import (
    B_DEG,
    Concealed,
    between,
    concealed,
    displacements,
    grid_of,
    nests_of_the_paper,
    paper_machine,
    record,
)
from .steps import (
    CONING_URAD,
    SAG_UM,
    TO_FILE,
    ErrorMap,
    absorbed,
    calibrated,
    compare_plans,
    in_the_paper_gauge,
    look_again,
    look_at_coning,
    map_of,
    mapped_jointly,
    sagging,
    third_harmonics,
)

Array = NDArray[np.float64]
TITLE = "Oyama, Ibaraki & Otsubo 2010: R-test error map of a tilting rotary table"


@dataclass(frozen=True)
class Check:
    """Poses that the map has not seen: table angle `b_deg` (N,), deviation `before` and `after` compensation (N, 3) µm."""

    b_deg: Array
    before: Array
    after: Array

    def rms(self, which: str) -> float:
        """Root mean square of the deviation's length, µm; `which` is `before` or `after`."""
        return float(np.sqrt(np.mean(np.sum(getattr(self, which) ** 2, axis=1))))


def check_compensation(found: ErrorMap, hidden: Concealed, folder: Path) -> Check:
    """Measure half-way between the poses of the map, in another place, and take the map's prediction off."""
    [run] = record(between(paper_machine()), hidden, folder).runs
    [nest] = nests_of_the_paper([run.table_ball])
    b, c = -np.radians(run.commands["B"]), -np.radians(run.commands["C"])
    reference = int(np.argmin(np.abs(b) + np.abs(np.sin(0.5 * c))))
    readings = np.stack([run.readings[f"d{axis}_um"] for axis in "xyz"], axis=1)
    seen = np.delete(readings - readings[reference], reference, axis=0)
    others = np.delete(np.arange(run.rows), reference)
    return Check(np.degrees(b[others]), seen, seen - 1e3 * found.predicted(b[others], c[others], nest))


@dataclass(frozen=True)
class Drifting:
    """A map of B made while the machine warmed up: its worst error of a shift, and what (15) leaves (rms), µm."""

    error_um: float
    residual_um: float


def map_a_drifting_machine(folder: Path) -> Drifting:
    """The paper's procedure, once through the grid, on the sagging machine while its spindle grows."""
    hidden = sagging(drift=True)
    campaign = record(grid_of(paper_machine()), hidden, folder)
    found = map_of(campaign)
    truth = np.zeros((len(B_DEG), 6))
    truth[:, 2] = SAG_UM * (1.0 - np.cos(np.radians(B_DEG)))
    error = found.of_b * TO_FILE - in_the_paper_gauge(truth)
    [nest] = nests_of_the_paper([campaign.runs[0].table_ball])
    b, c = np.meshgrid(np.radians(B_DEG), np.radians(np.arange(0.0, 360.0, 30.0)), indexing="ij")
    rigid = ErrorMap(found.of_b, np.zeros_like(found.of_c))
    left = displacements(campaign)[0].reshape(-1, 3) - rigid.predicted(b.ravel(), c.ravel(), nest)
    return Drifting(float(np.abs(error[:, :3]).max()), float(1e3 * np.sqrt(np.mean(left**2))))


def finding_data(still: Diagnosis, warm: Diagnosis, drifting: Drifting, cone: Diagnosis) -> dict[str, Any]:
    """What the plain fit believes and what the diagnosis says, as data."""
    plain = still.before
    return {
        "sag": {
            "true_um": SAG_UM, "believed": {"EZ0B": plain["EZ0B"], "std": plain.uncertainty("EZ0B"), "true": 0.0},
            "absorbed_share": absorbed(), "rms_before_um": still.fit.rms_before_um, "rms_after_um": still.fit.rms_after_um,
            "says": still.summary, "findings": [f.to_data() for f in still.findings],
        },
        "sag_and_drift": {
            "map_error_um": drifting.error_um, "map_residual_um": drifting.residual_um, "says": warm.summary,
            "findings": [f.to_data() for f in warm.findings],
        },
        "coning": {
            "true_urad": list(CONING_URAD), "found_urad": {n: list(v) for n, v in third_harmonics(cone).items()},
            "says": cone.summary,
        },
    }  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the story; 0 if every claim is reproduced, or shown wrong with its reason."""
    parser = argparse.ArgumentParser(prog="python -m examples.oyama_2010", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("oyama-2010-results"), help="folder for the results")
    folder: Path = parser.parse_args(arguments).output
    begin = time.perf_counter()
    pictures, machine, hidden = folder / "figures", paper_machine(), concealed()

    print(f"1 Machine: {machine.name}, {machine.structure.code}; the ball on the spindle, three sensors on the table")
    instrument = calibrated()
    print(f"  sensor directions from 27 moves: off by at most {instrument.direction_error:.1e}")
    print(f"  run-out of the ball from indexing: off by {instrument.runout_error_um(instrument.runout):.3f} µm")

    campaign = record(grid_of(machine), hidden, folder / "recordings" / "map")
    minutes = sum(run.duration for run in campaign.runs) / 60.0
    print(
        f"2 Recorded: {len(campaign.runs)} heights × {campaign.runs[0].rows} poses, {minutes:.0f} min, 0.3 µm of noise"
    )
    found = map_of(campaign)
    joint, jointly = mapped_jointly(campaign)
    off = found.of_b * TO_FILE - in_the_paper_gauge(hidden.values("B", B_DEG))
    better = jointly - in_the_paper_gauge(hidden.values("B", B_DEG))
    print("3 Map of B (10)-(15) and of C (16)-(22), rms error in the paper's gauge")
    print(f"  stage by stage: shifts {_rms(off[:, :3]):.2f} µm, angles {_rms(off[:, 3:]):.2f} µrad")
    print(f"  B and C at once: shifts {_rms(better[:, :3]):.2f} µm, angles {_rms(better[:, 3:]):.2f} µrad")
    print(f"  rank {joint.rank} of {len(joint.parameters)} parameters; cannot be separated:")
    print("\n".join(f"    {c.words}" for c in joint.confounded if not c.names[0].startswith("setup.")))
    save(figures.error_functions_b(found, jointly, hidden), pictures, "error-functions-b")
    save(figures.error_functions_bc(found, hidden), pictures, "error-functions-bc")
    save(figures.table_positions(found, hidden, displacements(campaign)[0]), pictures, "table-positions")

    with tempfile.TemporaryDirectory() as scratch:
        claims = all_claims(instrument, campaign, found, hidden, Path(scratch))
    write_claims(claims, folder, TITLE)
    print(f"4 Claims: {sum(c.holds for c in claims)} reproduced, {sum(not c.holds for c in claims)} shown wrong")
    print("\n".join(f"  {c.id} {c.statement}: {c.ours:.4g} {c.unit}: {c.note}" for c in claims if not c.holds))

    check = check_compensation(found, hidden, folder / "recordings" / "between")
    print(f"5 Compensation, {len(check.b_deg)} poses between those of the map, in another place")
    print(f"  {check.rms('before'):.2f} µm rms before, {check.rms('after'):.2f} µm after")
    save(figures.compensation(check.b_deg, check.before, check.after), pictures, "compensation")

    print(f"6 Gravity read as geometry: a table that sinks by {-SAG_UM:g} µm·(1 - cos B) and has no other error")
    _, still = look_again(folder / "recordings" / "sag", drift=False)
    plain = still.before
    print(f"  a plain fit believes EZ0B = {plain['EZ0B']:.2f} ± {plain.uncertainty('EZ0B'):.2f} µm; true is 0")
    for where, share in absorbed().items():
        print(f"  {where}: the baseline absorbs {100.0 * share:.1f} % of it")
    print(f"  {still.summary}")
    save(figures.gravity(still, SAG_UM), pictures, "gravity")
    drifting = map_a_drifting_machine(folder / "recordings" / "drift-once")
    print("7 The same while the spindle grows: what the map absorbs")
    print(f"  the map is off by up to {drifting.error_um:.1f} µm, and (15) leaves {drifting.residual_um:.2f} µm rms")
    _, warm = look_again(folder / "recordings" / "drift-and-back", drift=True)
    print(f"  {warm.summary}")
    cone = look_at_coning(folder / "recordings" / "coning")
    about_x, about_y = CONING_URAD
    print(f"8 C cones: it tilts by {about_x:g} and {about_y:g} µrad·sin 3C; the diagnosis, B free at its seven angles:")
    for component, (size, std) in third_harmonics(cone).items():
        print(f"  error motion {component} of C, {size:.2f} ± {std:.2f} µrad·sin 3C")
    write_json(folder / "findings.json", finding_data(still, warm, drifting, cone))

    compared = compare_plans()
    print(f"9 Another plan: {compared.plan_rows} rows instead of {compared.grid_rows},", end=" ")
    print(f"{compared.plan_minutes:.0f} min instead of {compared.grid_minutes:.0f} min")
    print(f"  1σ of the {len(compared.ratio)} errors, plan over grid: {compared.mean_ratio:.2f} in the geometric mean")
    save(figures.plans(compared), pictures, "plans")
    print(f"Done in {time.perf_counter() - begin:.0f} s: {folder.resolve()}")
    return 0 if all(claim.settled for claim in claims) else 1


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
