"""Makes the ready plans beside this file: the papers' own tests, tests in the style of ISO 10791-6, and optimised plans.

    python3 go.py designs [own|optimised|NAME ...]

Every folder is a campaign without readings; `assessment.json` (or `plan.json`) says what it will tell.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from pathlib import Path

from examples.oyama_2010 import machine as oyama
from examples.wang_li_2016 import machine as wang_li
from symfive.campaign import Run, write_campaign
from symfive.design import assess, assessment_data, plan
from symfive.machine import Machine, preset
from symfive.outputs import MANIFEST, write_json
from symfive.procedures import (
    campaign_of,
    cone_circle,
    left_in_place,
    planar_circle,
    r_test_grid,
    rotary_circle,
    synchronous_circle,
)

HERE = Path(__file__).resolve().parent
RATE_HZ = 8.0


def k_test(machine: Machine, axis: str) -> Iterable[Run]:
    """The circular K-test of one rotary axis (ISO 10791-6): ball bar radial, tangential and axial while it turns.

    The letters say where the rotary axes are: AK both in the head, BK both in the table, CK one in each; number 1 is the
    tilting axis, 2 the turning one, 4 all axes around a cone. The standard's radii, feeds and angles were not at hand: bar,
    feed and range are those of `rotary_circle` and `cone_circle`; its other tests (3) are left out.
    """
    for arrangement in ("radial", "tangential", "axial"):
        yield from rotary_circle(machine, axis=axis, arrangement=arrangement, rate_hz=RATE_HZ)


def bk1(machine: Machine) -> Iterable[Run]:
    """BK1: the tilting axis turns."""
    return k_test(machine, next(name for name in machine.axis_names if name in "AB"))


def bk2(machine: Machine) -> Iterable[Run]:
    """BK2: the turning axis turns."""
    return k_test(machine, "C")


def cone(machine: Machine) -> Iterable[Run]:
    """AK4, BK4, CK4: all axes around a cone frustum, 15° inclined by 10° (turning all the way round) and by 30° (swinging)."""
    for inclination in (10.0, 30.0):
        yield from cone_circle(machine, inclination_deg=inclination, rate_hz=RATE_HZ)


def both(machine: Machine) -> Iterable[Run]:
    """The tests of both rotary axes together."""
    yield from bk1(machine)
    yield from bk2(machine)


def planes(machine: Machine) -> Iterable[Run]:
    """Circles in the three planes of the linear axes at two feeds: XY by ISO 230-4, the upright ones as arcs of 220°."""
    for plane in ("XY", "YZ", "ZX"):
        yield from planar_circle(machine, plane=plane, feed=(500.0, 2000.0), rate_hz=RATE_HZ)


def paper_1(machine: Machine) -> Iterable[Run]:
    """Wang & Li 2016: squareness and three lines along each linear axis on a cross grid; a ball bar along Y, X and Z while B
    turns, at C with the ball at two heights, and for the error motions of C."""
    yield from wang_li.grid_tests(machine)
    yield from wang_li.bar_tests(machine, motions=True)


def grid(machine: Machine) -> Iterable[Run]:
    """R-test at 7 × 12 rotary positions in two nests at two heights and two radii, once through."""
    return r_test_grid(machine, returning=False)


def paper_2(machine: Machine) -> Iterable[Run]:
    """Oyama et al. 2010: the same with the nests one above the other, which its (22) needs."""
    return oyama.grid_of(machine).runs


def paper_3(machine: Machine) -> Iterable[Run]:
    """Tsutsumi et al. 2007: X_T/r = 0.9 and 1.1, r = 50 mm, 1000 mm/min, both directions."""
    for x_t in (45.0, 55.0):
        yield from synchronous_circle(machine, x_t=x_t, radius=50.0, feed=1000.0, rate_hz=100.0)


OWN: dict[str, tuple[str | Callable[[], Machine], Callable[[Machine], Iterable[Run]]]] = {
    "paper-1-cross-grid-ball-bar": (wang_li.paper_machine, paper_1),
    "paper-2-r-test": (oyama.paper_machine, paper_2),
    "r-test-grid": ("oyama-2010", grid),
    "paper-3-synchronous-circle": ("tsutsumi-2007", paper_3),
    "iso-10791-6-bk1": ("table-bc", bk1),
    "iso-10791-6-bk2": ("table-bc", bk2),
    "iso-10791-6-bk1-bk2": ("table-bc", both),
    "iso-10791-6-ak4": ("head-bc", cone),
    "iso-10791-6-bk4": ("table-bc", cone),
    "iso-10791-6-ck4": ("mixed-bc", cone),
    "iso-10791-6-ak1-ak2": ("head-bc", both),
    "iso-10791-6-ck1-ck2": ("mixed-bc", both),
    "wang-li-2016-bk1-bk2": ("wang-li-2016", both),
    "tsutsumi-2007-bk1-bk2": ("tsutsumi-2007", both),
    "three-axis-circles": ("three-axis", planes),
}
OPTIMISED = {
    f"{machine}-{instrument.replace('_', '-')}-{points}": (machine, instrument, points, setups)
    for machine, instrument, points, setups in (
        ("table-bc", "r_test", 40, 2),
        ("table-bc", "ball_bar", 48, 2),
        ("head-bc", "r_test", 36, 2),
        ("mixed-bc", "r_test", 36, 2),
        ("nutating-table", "r_test", 36, 2),
        ("oyama-2010", "r_test", 48, 2),
        ("tsutsumi-2007", "r_test", 36, 2),
        ("wang-li-2016", "ball_bar", 72, 3),
        ("three-axis", "ball_bar", 40, 3),
    )
}


def emptied(name: str) -> Path:
    """The folder of a ready plan, which is made anew. It is there to be copied and filled in: no manifest binds it."""
    shutil.rmtree(HERE / name, ignore_errors=True)
    return HERE / name


def own(wanted: Collection[str]) -> None:
    """The tests as the papers and the standard describe them."""
    for name, (source, runs) in OWN.items():
        if not {"own", name} & set(wanted):
            continue
        machine = preset(source) if isinstance(source, str) else source()
        made = [
            replace(run, id=f"{i + 1}-{run.id}", file=f"{i + 1}-{run.id}.csv") for i, run in enumerate(runs(machine))
        ]
        campaign = campaign_of(machine, [*left_in_place(made)], name)
        write_campaign(campaign, emptied(name))
        found = assess(campaign)
        write_json(HERE / name / "assessment.json", assessment_data(found))
        (HERE / name / MANIFEST).unlink()
        print(
            f"{name}: {campaign.rows} rows, rank {found.rank} of {len(found.parameters)}, joint value {found.value:.3f}"
        )


def optimised(wanted: Collection[str]) -> None:
    """The designer's plans."""
    for name, (machine_name, instrument, points, setups) in OPTIMISED.items():
        if not {"optimised", name} & set(wanted):
            continue
        made = plan(preset(machine_name), instrument=instrument, points=points, setups=setups, starts=8)
        made.write(emptied(name), nc=("iso", "linuxcnc"))
        (HERE / name / MANIFEST).unlink()
        print(f"{name}: {made.certificate.says}; {made.minutes:.0f} min, joint value {made.assessment.value:.3f}")


if __name__ == "__main__":
    chosen = sys.argv[1:] or ["own", "optimised"]
    if unknown := sorted({*chosen} - {"own", "optimised", *OWN, *OPTIMISED}):
        sys.exit(f"{unknown[0]} is no ready plan; use own, optimised or one of {', '.join((*OWN, *OPTIMISED))}")
    own(chosen)
    optimised(chosen)
