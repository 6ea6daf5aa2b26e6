"""Claims P3-5 to P3-14: what is read off the simulated traces, with the paper's figure, ours and the limits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from examples.claims import Claim

from .drives import PAPER
from .readings import bar_um, printed_bar_um
from .simulations import ECCENTRIC_UM, FEEDS, RATIOS, Simulations

Array = NDArray[np.float64]
ANY = math.inf
NEAR = [ECCENTRIC_UM.index(-5.0), ECCENTRIC_UM.index(5.0)]


def claims_of_the_simulations(found: Simulations) -> list[Claim]:
    """P3-5 to P3-14 from the simulated traces."""
    return [
        *_peaks(found), *_ripples(found), *_steps(found), *_notches(found), *_feeds(found), *_feedforward(found),
        *_over_ratio(found), *_offset_x(found), *_offset_y(found), *_equal_servos(found),
    ]  # fmt: skip


def _peaks(found: Simulations) -> list[Claim]:
    claims = []
    for u, paper, low, high in ((0.9, "15, convex", 14.0, 15.7), (1.1, "15, concave", -19.1, -17.0)):
        claims += [
            Claim(
                id="P3-5", statement=f"peak at 180° at X_T/r = {u:g}, {form}", where="fig. 5", paper=paper,
                ours=found.trace(u, form).largest(170.0, 190.0), low=low, high=high, unit="µm",
            )
            for form in ("linear", "full")
        ]  # fmt: skip
    flat = Claim(
        id="P3-5", statement="nothing at 180° at X_T = r, linear", where="fig. 5(b)", paper="none",
        ours=abs(found.trace(1.0, "linear").at(180.0)), low=0.0, high=1.0, unit="µm",
    )  # fmt: skip
    return [*claims, flat]


def _ripples(found: Simulations) -> list[Claim]:
    claims = []
    for u in (0.9, 1.0, 1.1):
        trace, size = found.effect(u, "linear, worm"), 1e3 * 50.0 * u * PAPER.gear.fluctuation
        claims += [
            Claim(
                id="P3-6", statement=f"worm ripple at {deg:g}°, X_T/r = {u:g}", where="(9), fig. 5",
                paper=f"X_T W = {size:.2f}", ours=trace.half_range(deg - 15.0, deg + 15.0), low=0.95 * size,
                high=1.05 * size, unit="µm",
            )
            for deg in (90.0, 270.0)
        ]  # fmt: skip
        quiet = max(trace.half_range(0.0, 5.0), trace.half_range(177.0, 183.0))
        claims.append(
            Claim(
                id="P3-6", statement=f"worm ripple at 0° and 180°, X_T/r = {u:g}", where="fig. 5", paper="none", ours=quiet,
                low=0.0, high=0.3, unit="µm",
            )
        )  # fmt: skip
    return claims


def _steps(found: Simulations) -> list[Claim]:
    gear, above, below = PAPER.gear, found.effect(1.1, "linear, play"), found.effect(0.9, "linear, play")
    size = 1e3 * gear.backlash * math.sqrt(55.0**2 - 50.0**2)
    windows = ((155.0, 158.0, 1.0), (203.0, 206.0, -1.0))
    claims = [
        Claim(
            id="P3-7", statement=f"step of the play at {low:g}°…{high:g}°, X_T/r = 1.1", where="fig. 9",
            paper=f"b √(X_T² - r²) = {size:.2f}", ours=sign * above.largest(low, high), low=0.95 * size, high=1.05 * size,
            unit="µm", note="outward at the first reversal, inward at the second",
        )
        for low, high, sign in windows
    ]  # fmt: skip
    none = Claim(
        id="P3-7", statement="effect of the play at X_T/r = 0.9", where="fig. 8", paper="none",
        ours=float(np.abs(below.um).max()), low=0.0, high=0.01, unit="µm", note="C never turns back",
    )  # fmt: skip
    return [*claims, none]


def _notches(found: Simulations) -> list[Claim]:
    rows = (
        (0.9, "at 0°", (0.0, 10.0), "outward", 1.0),
        (0.9, "at 180°", (180.0, 190.0), "inward", -1.0),
        (1.1, "at 0°", (0.0, 10.0), "outward", 1.0),
        (1.1, "at 180°", (180.0, 190.0), "outward", 1.0),
    )
    claims = []
    for u, place, window, way, sign in rows:
        size = found.effect(u, "linear, friction").largest(*window)
        claims.append(
            Claim(
                id="P3-8", statement=f"notch where X reverses {place}, X_T/r = {u:g}: {way}", where="fig. 8, 9", paper=way,
                ours=size, low=1.0 if sign > 0.0 else -ANY, high=ANY if sign > 0.0 else -1.0, unit="µm",
            )
        )  # fmt: skip
    return claims


def _feeds(found: Simulations) -> list[Claim]:
    peak = {key: trace.at(180.0) for key, trace in found.stretches.items()}
    claims = [
        Claim(
            id="P3-9", statement=f"E(180°), 1500 over 500 mm/min, r = {radius:g} mm", where="fig. 6", paper="larger with feed",
            ours=peak[radius, 1500.0] / peak[radius, 500.0], low=8.4, high=9.0, note="the law says F², so 9",
        )
        for radius in (50.0, 100.0)
    ]  # fmt: skip
    claims += [
        Claim(
            id="P3-9", statement=f"E(180°), (50, 45) over (100, 90) mm at {feed:g} mm/min", where="fig. 6",
            paper="larger with C's speed", ours=peak[50.0, feed] / peak[100.0, feed], low=1.9, high=2.05,
            note="the law says 2: half the speed of C, twice the arm",
        )
        for feed in FEEDS
    ]  # fmt: skip
    return claims


def _feedforward(found: Simulations) -> list[Claim]:
    none, ahead, matched = (
        abs(found.servos[name, "linear"].trace().largest(160.0, 200.0))
        for name in ("table 1", "feed-forward", "feed-forward and matched")
    )
    notch = found.servos["feed-forward and matched", "full"].trace().roundness
    return [
        Claim(
            id="P3-10", statement="peak with feed-forward over the peak with matched loops, linear", where="fig. 7(a)",
            paper="a distortion stays", ours=ahead / matched, low=2.0, high=ANY, note=f"{ahead:.2f} against {matched:.2f} µm",
        ),
        Claim(
            id="P3-10", statement="peak with matched loops over the peak without feed-forward, linear", where="fig. 7(b)",
            paper="gone", ours=matched / none, low=0.0, high=0.1, note=f"{matched:.2f} of {none:.2f} µm",
        ),
        Claim(
            id="P3-10", statement="the distortion disappears completely", where="fig. 7(b)", paper="0", ours=notch, low=0.0,
            high=1.0, unit="µm", refuted=True,
            note="true of the servo part; the roundness with friction, whose notch at the reversal of X no feed-forward removes",
        ),
    ]  # fmt: skip


def _over_ratio(found: Simulations) -> list[Claim]:
    ratios = np.array(RATIOS)
    above = ratios > 1.0
    claims = []
    for form in ("full", "linear, play"):
        curve = found.roundness(form)[above]
        k = int(np.argmin(curve))
        single = bool(np.all(np.diff(curve[: k + 1]) < 0.0) and np.all(np.diff(curve[k:]) > 0.0))
        claims.append(
            Claim(
                id="P3-11", statement=f"smallest roundness above X_T = r with play, {form}", where="fig. 10",
                paper="one minimum", ours=float(ratios[above][k]) if single else math.nan, low=1.15, high=1.35, unit="X_T/r",
                note=f"{curve[k]:.1f} µm; the only minimum",
            )
        )  # fmt: skip
    free = found.roundness("linear")
    rising = [float(np.diff(free[ratios < 1.0]).min()), float(-np.diff(free[above]).max())]
    full = found.roundness("full")
    near = min(full[RATIOS.index(0.95)] - full[RATIOS.index(0.9)], full[RATIOS.index(1.05)] - full[RATIOS.index(1.1)])
    play = float(np.abs(full - found.roundness("without play"))[ratios < 1.0].max())
    low = free[RATIOS.index(0.5)]
    return [
        *claims,
        Claim(
            id="P3-11", statement="without play it rises towards X_T = r from both sides: least step, linear", where="fig. 10",
            paper="> 0", ours=min(rising), low=1e-6, high=ANY, unit="µm",
            note="with friction not quite: the notch where C turns back grows with X_T",
        ),
        Claim(
            id="P3-11", statement="it rises steeply from 0.9 to 0.95 and from 1.1 to 1.05, full", where="fig. 10", paper="> 0",
            ours=float(near), low=5.0, high=ANY, unit="µm",
        ),
        Claim(
            id="P3-11", statement="effect of the play below X_T = r", where="fig. 10", paper="none", ours=play, low=0.0,
            high=0.01, unit="µm",
        ),
        Claim(
            id="P3-11", statement="roundness by synchronisation at X_T/r = 0.5", where="conclusion (2)", paper="none",
            ours=float(low), low=0.0, high=3.0, unit="µm",
            note=f"of {full[RATIOS.index(0.5)]:.1f} µm in all: the rest is worm and notch",
        ),
    ]  # fmt: skip


def best_dx_um(found: Simulations, *, fitted: bool) -> float:
    """dx µm at which the trace at X_T/r = 0.9 looks roundest."""
    lap, sizes = found.laps[0.9, "full"], np.linspace(-30.0, 30.0, 121)
    traces = [lap.trace(dx_um=size) for size in sizes]
    return float(sizes[np.argmin([(t.without_circle() if fitted else t).roundness for t in traces])])


def _offset_x(found: Simulations) -> list[Claim]:
    lap = found.laps[0.9, "full"]
    centred, right = lap.trace(), lap.trace(dx_um=30.0)
    raw = dict(zip(ECCENTRIC_UM, found.eccentric(axis="x", fitted=False), strict=True))
    claims = [
        Claim(
            id="P3-12", statement="the largest reading, dx = 0", where="fig. 12", paper="180",
            ours=float(centred.deg[np.argmax(centred.um)]), low=175.0, high=185.0, unit="deg",
        ),
        Claim(
            id="P3-12", statement="the smallest reading, dx = +30 µm", where="fig. 12(a)", paper="180",
            ours=float(right.deg[np.argmin(right.um)]), low=175.0, high=185.0, unit="deg",
            note="the maximum has become a minimum: the peak is concealed",
        ),
        Claim(
            id="P3-12", statement="E(180°, dx) - E(180°, 0) + 2 dx, dx = +30 µm", where="(12)", paper="0",
            ours=abs(right.at(180.0) - centred.at(180.0) + 60.0), low=0.0, high=2.0, unit="µm",
        ),
        Claim(
            id="P3-12", statement="roundness at dx = -30 less that at +30 µm", where="fig. 14", paper="> 0",
            ours=float(raw[-30.0] - raw[30.0]), low=1.0, high=ANY, unit="µm", note=f"{raw[-30.0]:.1f} and {raw[30.0]:.1f} µm",
        ),
    ]  # fmt: skip
    five = [abs(found.eccentric(axis=axis, fitted=False)[i] - raw[0.0]) for axis in "xy" for i in NEAR]
    claims.append(
        Claim(
            id="P3-12", statement="what dx, dy of ±5 µm change of the roundness, at most", where="section 4.4",
            paper="so much that ±5 µm is needed", ours=float(max(five)), low=2.0, high=ANY, unit="µm",
            note=f"of {raw[0.0]:.1f} µm: nor is ±5 µm enough; a model that holds dx and dy needs no centring (+3)",
        )
    )  # fmt: skip
    claims += [
        Claim(
            id="P3-12", statement=f"dx that looks roundest, {words}", where="fig. 14", paper="some dx > 0",
            ours=best_dx_um(found, fitted=fitted), low=0.5, high=12.0, unit="µm",
        )
        for words, fitted in (("raw", False), ("circle taken out", True))
    ]  # fmt: skip
    return claims


def _offset_y(found: Simulations) -> list[Claim]:
    x, y = ({fitted: found.eccentric(axis=axis, fitted=fitted)[[0, -1]] for fitted in (False, True)} for axis in "xy")
    lap = found.laps[0.9, "full"]
    rigid = bar_um(lap.x, lap.c, lap.circle, dy_um=30.0)
    printed = printed_bar_um(lap.x, lap.c, lap.circle, dx_um=0.0, dy_um=30.0)
    return [
        Claim(
            id="P3-13", statement="dy = ±30 µm tells more than dx: least by y less most by x, circle taken out", where="fig. 14",
            paper="> 0", ours=float(y[True].min() - x[True].max()), low=0.0, high=ANY, unit="µm",
            note=f"dy {y[True].min():.0f}…{y[True].max():.0f}, dx {x[True].min():.0f}…{x[True].max():.0f} µm",
        ),
        Claim(
            id="P3-13", statement="the same of the raw readings", where="fig. 14", paper="> 0",
            ours=float(y[False].max() - x[False].min()), low=0.0, high=ANY, unit="µm", refuted=True,
            note=(
                f"dx {x[False].min():.0f}…{x[False].max():.0f} is more than dy {y[False].min():.0f}…{y[False].max():.0f} µm: "
                "half of what dx does is an eccentric circle, which the instrument's software takes out"
            ),
        ),
        Claim(
            id="P3-13", statement="dy = +30 µm tells more than -30 µm", where="fig. 14", paper="> 0",
            ours=float(y[True][1] - y[True][0]), low=1.0, high=ANY, unit="µm",
            note="only with the table turning by -C, as (4) wants",
        ),
        Claim(
            id="P3-13", statement="(13) as printed, (X_T - dy) sin C, against a rigid table, dy = 30 µm", where="(13)",
            paper="0", ours=float(np.abs(printed - rigid).max()), low=0.0, high=1e-6, unit="µm", refuted=True,
            note="a rigid table has (X_T - dx) sin C",
        ),
    ]  # fmt: skip


def _equal_servos(found: Simulations) -> list[Claim]:
    paper, equal, slow = (
        found.servos[name, "linear"].trace().largest(160.0, 200.0)
        for name in ("table 1", "equal servos", "C at 35 1/s")
    )
    return [
        Claim(
            id="P3-14", statement="peak with two equal servos over that of table 1, linear", where="fig. 5, section 3",
            paper="0 if C's delay made it", ours=equal / paper, low=0.9, high=1.1,
            note=f"{equal:.1f} of {paper:.1f} µm: the second-order lag of both axes, no mismatch",
        ),
        Claim(
            id="P3-14", statement="peak with C at 35 instead of 40 1/s over that of table 1, linear", where="-", paper="-",
            ours=slow / paper, low=2.5, high=3.5, note=f"{slow:.1f} µm: a true mismatch is far worse",
        ),
    ]  # fmt: skip
