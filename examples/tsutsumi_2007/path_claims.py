"""Claims P3-1 to P3-4, the lag law of P3-5, whose lag it is (P3-14) and the rigid table of P3-13: no simulation needed."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from examples.claims import Claim
from symfive.procedures import polar_angle

from .drives import PAPER
from .path import Circle, derived_rates
from .readings import first_order_peak_um, one_axis_lags
from .twin import chain_gap_um

Array = NDArray[np.float64]
LAP = np.radians(np.linspace(0.0, 360.0, 14401))
BESIDE_180 = LAP + 1e-4
"""The same without φ = π, where (3) has its cut and X_T = r no derivative."""


def claims_of_the_path() -> list[Claim]:
    """P3-1 to P3-4, the lag law of P3-5, P3-14: no simulation, only the commands, their derivatives and their series."""
    return [*_speeds(), *_reversals(), *_speeds_of_x(), *_derivatives(), *_lag_law(), *_whose_lag()]


def _speeds() -> list[Claim]:
    found = []
    for x_t, most in ((45.0, 11459.2), (50.0, 573.0), (55.0, 11459.2)):
        circle = Circle(x_t)
        fastest = np.degrees(np.abs(derived_rates(circle, BESIDE_180)[0]).max()) * 60.0
        found.append(
            Claim(
                id="P3-1",
                statement=f"fastest C at X_T = {x_t:g} mm",
                where="(8), fig. 5",
                paper=f"{most:g}",
                ours=float(fastest),
                low=most - 0.1,
                high=most + 0.1,
                unit="deg/min",
                note=f"(8) gives {np.degrees(circle.fastest_c) * 60.0:.1f}",
            )
        )
    return found


def _speeds_of_x() -> list[Claim]:
    found = []
    for x_t, most in ((45.0, 900.0), (50.0, 1000.0), (55.0, 1000.0)):
        fastest = float(np.abs(derived_rates(Circle(x_t), BESIDE_180)[2]).max() * 60.0)
        found.append(
            Claim(
                id="P3-3",
                statement=f"fastest X at X_T = {x_t:g} mm",
                where="fig. 3(a)",
                paper="1000",
                ours=fastest,
                low=most - 1.0,
                high=most + 1.0,
                unit="mm/min",
                note="X_T/r times the feed below X_T = r: the paper rounds" if x_t < 50.0 else "",
            )
        )
    return found


def _reversals() -> list[Claim]:
    """Where the commands of C turn back, by the sign of the derived speed."""
    circle = Circle(55.0)
    speed = derived_rates(circle, LAP)[0]
    k = np.flatnonzero(speed[:-1] * speed[1:] < 0.0)
    turns = np.degrees(LAP[k] - speed[k] * (LAP[k + 1] - LAP[k]) / (speed[k + 1] - speed[k]))
    found = [
        Claim(
            id="P3-2", statement="C turns back", where="fig. 3(b), 9", paper=printed, ours=float(turn), low=place - 0.01,
            high=place + 0.01, unit="deg", note="cos φ = -r/X_T",
        )
        for turn, place, printed in zip(turns, (155.38, 204.62), ("155", "205"), strict=True)
    ]  # fmt: skip
    below = derived_rates(Circle(45.0), LAP)[0]
    found.append(
        Claim(
            id="P3-2", statement="reversals of C at X_T/r = 0.9", where="fig. 3(b)", paper="0",
            ours=float(np.count_nonzero(below[:-1] * below[1:] < 0.0)), low=0.0, high=0.0,
        )
    )  # fmt: skip
    return found


def _derivatives() -> list[Claim]:
    """(6), (7), (8) against automatic differentiation; symfive's own path against (3)."""
    phi = LAP[:-1]
    first = second = third = path = 0.0
    for x_t in (25.0, 45.0, 55.0, 90.0):
        circle = Circle(x_t)
        omega, alpha, _ = derived_rates(circle, phi)
        first = max(first, _apart(circle.theta_rate(phi), omega))
        second = max(second, _apart(circle.theta_acceleration(phi), alpha))
        third = max(third, abs(circle.fastest_c / abs(derived_rates(circle, [np.pi])[0][0]) - 1.0))
        path = max(path, float(np.abs(circle.theta(phi) - polar_angle(phi, x_t, circle.radius)).max()))
    rows = (
        ("(6) against automatic differentiation of (3)", "(6)", first),
        ("(7) against automatic differentiation of (3)", "(7)", second),
        ("(8) against automatic differentiation of (3)", "(8)", third),
        ("(3) against the path of symfive.procedures, rad", "(3)", path),
    )
    return [
        Claim(
            id="P3-4", statement=text, where=where, paper="exact", ours=gap, low=0.0, high=1e-12, note="X_T = 25, 45, 55, 90 mm"
        )
        for text, where, gap in rows
    ]  # fmt: skip


def _apart(ours: Array, other: Array) -> float:
    """Largest difference over the largest value."""
    return float(np.abs(ours - other).max() / np.abs(other).max())


def lag_by_differentiation_um(circle: Circle, gain: float) -> float:
    """E(180°) µm of two first-order loops of `gain` 1/s to second order in τ = 1/gain, by automatic differentiation.

    A first-order lag turns c(t) into c - τ ċ + τ² c̈ - …; E of (10) is differentiated twice in τ and once along φ.
    """
    phi, tau = ca.SX.sym("phi"), ca.SX.sym("tau")
    x, y = circle.x_t + circle.radius * ca.cos(phi), circle.radius * ca.sin(phi)

    def lagged(command: ca.SX) -> ca.SX:
        first = ca.jacobian(command, phi) * circle.phi_rate
        return command - tau * first + tau**2 * ca.jacobian(first, phi) * circle.phi_rate

    x_out, c_out = lagged(ca.sqrt(x**2 + y**2)), lagged(ca.atan2(y, x))
    error = ca.sqrt((x_out - circle.x_t * ca.cos(c_out)) ** 2 + (circle.x_t * ca.sin(c_out)) ** 2) - circle.radius
    first = ca.jacobian(error, tau)
    series = ca.Function("series", [phi, tau], [first / gain, ca.jacobian(first, tau) / gain**2 / 2.0])
    # a hair beside 180°, where atan2 has its cut
    slope, bend = (float(value) for value in series(np.pi - 1e-9, 0.0))
    return 1e3 * (slope + bend)


def _lag_law() -> list[Claim]:
    found = []
    for x_t, printed in ((45.0, 15.6), (55.0, -19.1)):
        circle, gain = Circle(x_t), PAPER.c.position_gain
        law = first_order_peak_um(circle, gain)
        found += [
            Claim(
                id="P3-5", statement=f"lag law at X_T/r = {circle.u:g}", where="fig. 5", paper="15" if x_t < 50.0 else "-15",
                ours=law, low=printed - 0.05, high=printed + 0.05, unit="µm",
                note="(τ²/2) X_T r/(r - X_T) (dφ/dt)², τ = 1/Gp",
            ),
            Claim(
                id="P3-5", statement=f"law against automatic differentiation at {circle.u:g}", where="(10)", paper="-",
                ours=abs(lag_by_differentiation_um(circle, gain) / law - 1.0), low=0.0, high=1e-6,
            ),
        ]  # fmt: skip
    return found


def _whose_lag() -> list[Claim]:
    """Which axis makes the peak: a first-order loop on one, the same delay and nothing else on the other. A loop on one axis and
    none on the other would measure their difference in delay, which two equal loops do not have; the rows say so."""
    found = []
    for x_t, by_x in ((45.0, 15.4), (55.0, -18.8)):
        circle, gain = Circle(x_t), PAPER.c.position_gain
        of_x, of_c = (one_axis_lags(circle, gain, axis) for axis in "XC")
        shoulder = of_c.largest(165.0, 195.0)
        at = of_c.deg[np.argmin(np.abs(of_c.um - shoulder))]
        peak, place = of_x.at(180.0), f"X_T/r = {circle.u:g}"
        found += [
            Claim(
                id="P3-14", statement=f"peak at 180° of a first-order loop of X, C delayed as long and unchanged else, {place}",
                where="section 2.2", paper=f"restored: {by_x:g}", ours=peak, low=by_x - 0.2, high=by_x + 0.2, unit="µm",
                note="a delay that both axes share leaves the path as it is; X is slow enough, the paper says, not to cause one",
            ),
            Claim(
                id="P3-14", statement=f"the same of a loop of C, X delayed as long and unchanged else, over that of X, {place}",
                where="section 4.4", paper="it is C's delay", ours=of_c.at(180.0) / peak, low=0.5, high=np.inf, refuted=True,
                note=f"wrong of what a loop does beyond its delay: C's makes shoulders, {shoulder:.1f} µm at {at:.0f}°, and "
                "nothing at 180°; a delay of C that X does not share does make a peak (last row of P3-14)",
            ),
        ]  # fmt: skip
    return found


def claims_of_the_chain() -> list[Claim]:
    """(11) to (13) in the rigid form against symfive's exact chain, and the path against its ideal reading."""
    return [
        Claim(
            id="P3-13", statement=f"(11) to (13) of a rigid table against symfive's exact chain, dx, dy = {dx:g}, {dy:g} µm",
            where="(11)-(13)", paper="exact", ours=chain_gap_um(dx, dy), low=0.0, high=1e-6, unit="µm",
        )
        for dx, dy in ((30.0, 0.0), (0.0, 30.0), (-20.0, 25.0))
    ]  # fmt: skip
