"""Makes the ready plans beside this file: the papers' own tests, tests in the style of ISO 10791-6, and optimised plans.

    .venv/bin/python designs/plans/make_plans.py [own|optimised]

Every folder is a campaign without readings; `assessment.json` (or `plan.json`) says what it will tell.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

from symfive.campaign import Run, write_campaign
from symfive.design import assess, assessment_data, plan
from symfive.files import write_json
from symfive.machine import Machine, preset
from symfive.procedures import campaign_of, r_test_grid, rotary_circle, static_ball_bar, synchronous_circle

HERE = Path(__file__).parent
RATE_HZ = 8.0


def bk1(machine: Machine) -> Iterable[Run]:
    """ISO 10791-6 BK1: the tilting axis turns, ball bar radial, tangential and axial to it."""
    for arrangement in ("radial", "tangential", "axial"):
        yield from rotary_circle(machine, axis="B", arrangement=arrangement, rate_hz=RATE_HZ)


def bk2(machine: Machine) -> Iterable[Run]:
    """ISO 10791-6 BK2: the turning axis turns, ball bar radial, tangential and axial to it."""
    for arrangement in ("radial", "tangential", "axial"):
        yield from rotary_circle(machine, axis="C", arrangement=arrangement, rate_hz=RATE_HZ)


def both(machine: Machine) -> Iterable[Run]:
    """BK1 and BK2 together."""
    yield from bk1(machine)
    yield from bk2(machine)


def paper_1(machine: Machine) -> Iterable[Run]:
    """Wang & Li 2016: B axis with the bar axial, radial and tangential; C axis at two heights."""
    yield from bk1(machine)
    yield from static_ball_bar(machine)


def paper_2(machine: Machine) -> Iterable[Run]:
    """Oyama et al. 2010: R-test at 7 × 12 rotary positions in two nests, once through."""
    return r_test_grid(machine, returning=False)


def paper_3(machine: Machine) -> Iterable[Run]:
    """Tsutsumi et al. 2007: X_T/r = 0.9 and 1.1, r = 50 mm, 1000 mm/min, both directions."""
    for x_t in (45.0, 55.0):
        yield from synchronous_circle(machine, x_t=x_t, radius=50.0, feed=1000.0, rate_hz=20.0)


OWN: dict[str, tuple[str, Callable[[Machine], Iterable[Run]]]] = {
    "paper-1-ball-bar": ("wang-li-2016", paper_1),
    "r-test-grid": ("oyama-2010", paper_2),
    "paper-3-synchronous-circle": ("tsutsumi-2007", paper_3),
    "iso-10791-6-bk1": ("table-bc", bk1),
    "iso-10791-6-bk2": ("table-bc", bk2),
    "iso-10791-6-bk1-bk2": ("table-bc", both),
}
OPTIMISED = (
    ("table-bc", "r_test", 40, 2),
    ("table-bc", "ball_bar", 48, 3),
    ("head-bc", "r_test", 36, 2),
    ("mixed-bc", "r_test", 36, 2),
    ("nutating-table", "r_test", 36, 2),
    ("oyama-2010", "r_test", 48, 2),
)


def own() -> None:
    """The tests as the papers and the standard describe them."""
    for name, (machine_name, runs) in OWN.items():
        machine = preset(machine_name)
        made = [
            replace(run, id=f"{i + 1}-{run.id}", file=f"{i + 1}-{run.id}.csv") for i, run in enumerate(runs(machine))
        ]
        campaign = campaign_of(machine, made, name)
        write_campaign(campaign, HERE / name)
        found = assess(campaign)
        write_json(HERE / name / "assessment.json", assessment_data(found))
        print(
            f"{name}: {campaign.rows} rows, rank {found.rank} of {len(found.parameters)}, joint value {found.value:.3f}"
        )


def optimised() -> None:
    """The designer's plans."""
    for machine_name, instrument, points, setups in OPTIMISED:
        made = plan(preset(machine_name), instrument=instrument, points=points, setups=setups, starts=3)
        name = f"{machine_name}-{instrument.replace('_', '-')}-{points}"
        made.write(HERE / name, nc=("iso", "linuxcnc"))
        print(f"{name}: {made.certificate.says}; {made.minutes:.0f} min, joint value {made.assessment.value:.3f}")


if __name__ == "__main__":
    wanted = sys.argv[1:] or ["own", "optimised"]
    for part in (own, optimised):
        if part.__name__ in wanted:
            part()
