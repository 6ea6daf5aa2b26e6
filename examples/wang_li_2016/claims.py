"""Every claim of the paper that can be computed, computed against symfive's exact chain and the plant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from examples.claims import Claim
from symfive.kinematics import chain_poses
from symfive.machine import Machine
from symfive.procedures import campaign_of

from . import equations as paper
from .b_motions import BALLS_MM, Turned, of_b_motions
from .estimators import Joint, noisy, rotary_in_sequence
from .grid_claims import SCALE_MM, nine_slopes, of_grid, of_squareness
from .machine import ASSUMED, DZ_MM, HEIGHTS_MM, RADIUS_MM, bar_tests, grid_tests, paper_machine, readings_of

Array = NDArray[np.float64]
D1_MM = 100.0
"""Height of the ball over the table top, with the top 50 mm above the intersection: D1 = Dz - D."""


# --- (2), (8), (9): the chain --------------------------------------------------------------------------------
def table_point(machine: Machine, names: tuple[str, ...]) -> Callable[..., tuple[Array, Array]]:
    """A function (point (3,), table positions by axis) → place in R (3,) and its slopes (3, k) per error, from symfive's chain.

    Points mm in the workpiece frame, positions mm and rad as the table moves, errors by ISO 230-1 name in mm and rad.
    """
    position = {name: ca.SX.sym(name) for name in machine.axis_names}
    errors, point = ca.SX.sym("errors", len(names)), ca.SX.sym("point", 3)
    by_name = {name: errors[i] for i, name in enumerate(names)}
    workpiece, _ = chain_poses(
        machine,
        position,
        {n: v for n, v in by_name.items() if "0" in n},
        {n: v for n, v in by_name.items() if "0" not in n},
    )
    place = workpiece.apply(point)
    inputs = [ca.vertcat(*position.values()), errors, point]
    function = ca.Function("place", inputs, [place, ca.jacobian(place, errors)])

    def evaluate(where: Array, **table: float) -> tuple[Array, Array]:
        command = np.array([-table.get(name, 0.0) for name in position])
        value, slopes = function(command, np.zeros(len(names)), where)
        return np.asarray(value).ravel(), np.asarray(slopes)

    return evaluate


def of_chain() -> list[Claim]:
    """(8) and (9): P1-4, P1-2."""
    a_xy = 1e-4
    printed, corrected = (paper.squareness_seen(a_xy, printed=which) / a_xy for which in (True, False))
    errors = ca.SX.sym("errors", 7)
    x, y, point = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("point", 3)
    place = paper.points_of_table(
        x, y, errors[6], [errors[i] for i in range(6)], [point[i] for i in range(3)], printed=True
    )
    printed_slopes = ca.Function("printed", [x, y, errors, point], [ca.jacobian(place, errors)])
    generator = np.random.default_rng(2)
    worst_printed, worst_symfive, dropped = 0.0, 0.0, 0.0
    symfive = table_point(paper_machine(), ("EXX", "EYX", "EZX", "EAX", "EBX", "ECX", "EC0X", "EB0Z"))
    of_a_xz = 0.0
    for _ in range(30):
        q, where = generator.uniform(-300.0, 300.0), generator.uniform(-200.0, 200.0, 3)
        in_r = where + np.array([q, 0.0, 0.0])
        theirs = np.asarray(printed_slopes(q, 0.0, np.zeros(7), where))
        difference = theirs - nine_slopes(in_r)
        dropped = max(dropped, abs(float(difference[0, 6])) / max(abs(float(in_r[1])), 1e-9))
        difference[0, 6] += in_r[1]
        worst_printed = max(worst_printed, float(np.abs(difference).max()))
        _, ours = symfive(where, X=q)
        difference = ours[:, :6] - nine_slopes(where)[:, :6]
        worst_symfive = max(
            worst_symfive, float(np.abs(difference).max()), float(np.abs(ours[:, 6] - [0.0, q, 0.0]).max())
        )
        of_a_xz = max(of_a_xz, float(np.abs(ours[2, 7])))
    return [
        Claim(
            "P1-4a", "the printed chain (8) holds the X-Y squareness: (X·Y)/a_xy", "1", printed, 0.999, 1.001, "",
            "Y_PIGE in front of Y_ideal turns both directions: a yaw of the whole table, no squareness", refuted=True,
        ),
        Claim("P1-4b", "with Y_ideal·Y_PIGE it does", "restored: 1", corrected, 0.999, 1.001),
        Claim("P1-2a", "(9) equals the printed chain, the term -a_xy·y_j aside", "restored", worst_printed, 0.0, 1e-9, "mm/rad"),
        Claim(
            "P1-2b", "share of -a_xy·y_j that (9) leaves out of Dx", "0", dropped, 0.0, 1e-9, "",
            "all of it: 20 µm for 100 µrad at 200 mm; constant on a line, so zeroing the encoder removes it", refuted=True,
        ),
        Claim(
            "P1-2c", "(9) equals symfive's chain, rotations about the carriage, x_j counted in the carriage", "-",
            worst_symfive, 0.0, 1e-9, "mm/rad",
            "in symfive a_xy tilts the travel only (term a_xy·x); the printed order turns about the fixed origin (x_j in R)",
        ),
        Claim(
            "P1-2d", "Dz_j holds a term in a_xz", "± a_xz·x_j", of_a_xz, 1.0, 300.0, "mm/rad",
            "not in R: a_xz sits in the tool's chain; the term exists in the frame of Z only, with sign +", refuted=True,
        ),
    ]  # fmt: skip


# --- (11)-(19): ball bar -------------------------------------------------------------------------------------
def of_ball_bar() -> list[Claim]:
    """(11)-(19) against symfive's exact chain: P1-3, P1-5, P1-8."""
    names = (*paper.LOCATION, "EXC", "EYC", "EZC", "EAC", "EBC", "ECC")
    place = table_point(paper_machine(), names)
    b, c = np.radians(np.arange(-90.0, 91.0, 7.0)), np.radians(np.arange(0.0, 360.0, 11.0))
    ball = np.array([0.0, 0.0, DZ_MM])
    slopes = np.stack([place(ball, B=angle)[1] for angle in b])
    printed = [f(b, DZ_MM) for f in (paper.bar_along_x, paper.axial, paper.bar_along_z)]
    three = max(float(np.abs(slopes[:, k, :8] - printed[k]).max()) for k in range(3))
    other = float(np.abs(slopes[:, 0, 7] - D1_MM * np.cos(b)).max() * 1e-6 * ASSUMED["EB0C"] * 1e3)

    radial = 0.0
    for height in HEIGHTS_MM:
        expected = paper.c_harmonics(c, height)
        for k, angle in enumerate(c):
            where, slope = place(np.array([RADIUS_MM, 0.0, height]), C=angle)
            outward = (where - [0.0, 0.0, height]) / RADIUS_MM
            radial = max(radial, float(np.abs(outward @ slope[:, :8] - expected[k]).max()))
    motions = max(
        float(np.abs(place(np.array([0.0, 0.0, h]), C=angle)[1] - paper.c_motions(h)).max())
        for h in HEIGHTS_MM
        for angle in c
    )
    det = abs(float(np.linalg.det(paper.two_heights(*HEIGHTS_MM)))) / (HEIGHTS_MM[1] - HEIGHTS_MM[0]) ** 2
    condition = {
        end: float(np.linalg.cond(paper.b_basis(np.radians(np.linspace(-end, end, 181)))))
        for end in (90.0, 60.0, 45.0, 30.0, 15.0)
    }
    return [
        Claim("P1-3a", "(11)-(13) equal the exact chain to first order, lever Dz", "restored", three, 0.0, 1e-9, "mm/rad"),
        Claim(
            "P1-3b", "with the lever D1 that (12) seems to print: error of the reading", "0", other, 0.0, 0.01, "µm",
            "D1 is right only if C's errors refer to the table top; then (16), (17), which print Dz, are wrong", refuted=True,
        ),
        Claim("P1-5a", "(15) equals the exact chain at any height", "restored", radial, 0.0, 1e-9, "mm/rad"),
        Claim("P1-5b", "(16)-(18) equal the exact chain", "restored", motions, 0.0, 1e-9, "mm/rad"),
        Claim("P1-5c", "det (19) over (Dz1 - Dz2)²", "1", det, 1.0 - 1e-9, 1.0 + 1e-9),
        Claim("P1-8a", "condition of {1, cos b, sin b}, b = ±90°", "restored: 4.6", condition[90.0], 4.5, 4.7),
        Claim("P1-8b", "the same, ±30°", "restored: 47", condition[30.0], 46.0, 48.0),
        Claim("P1-8c", "the same, ±15°", "restored: 192", condition[15.0], 188.0, 196.0, "", "B needs its whole travel"),
        Claim("P1-8d", "the same, ±60°", "restored: 11", condition[60.0], 10.8, 11.4),
        Claim("P1-8e", "the same, ±45°", "restored: 20", condition[45.0], 19.6, 20.6),
    ]  # fmt: skip


def of_patterns() -> list[Claim]:
    """What the tests of the rotary axes can and cannot separate: a bar that turns with B, P1-3, and B measured like C, P1-5."""
    motions = tuple(f"E{letter}{axis}" for axis in "BC" for letter in "XYZABC")
    place = table_point(paper_machine(), (*paper.LOCATION, *motions))
    b, c = np.radians(np.arange(-90.0, 91.0, 7.0)), np.radians(np.arange(0.0, 360.0, 11.0))
    slopes = np.stack([place(np.array([0.0, 0.0, DZ_MM]), B=angle)[1] for angle in b])
    along = (
        np.stack([np.cos(b), np.zeros_like(b), -np.sin(b)], 1),
        np.stack([np.sin(b), np.zeros_like(b), np.cos(b)], 1),
    )
    turning = paper.turning_bar(b, DZ_MM)
    worst = max(
        float(np.abs(np.einsum("ni,nij->nj", way, slopes)[:, :8] - printed).max())
        for way, printed in zip(along, turning, strict=True)
    )
    constant = np.linalg.lstsq(paper.b_basis(b), np.ones_like(b), rcond=None)[0]

    at_rest = np.stack([place(np.array([RADIUS_MM, 0.0, HEIGHTS_MM[1]]), C=angle)[1] for angle in c])
    outward = np.stack([np.cos(c), np.sin(c), np.zeros_like(c)], axis=1)
    radial = np.einsum("ni,nij->nj", outward, at_rest)
    of_zero = float(np.abs(radial[:, 7] - radial[:, 8 + motions.index("EBB")]).max())
    on_axis = np.stack([place(np.array([0.0, 0.0, HEIGHTS_MM[1]]), C=angle)[1] for angle in c])
    of_angle = float(np.abs(on_axis[:, :, 8 + motions.index("ECC")]).max())

    weights = np.array([1.0] * 3 + [1.0 / SCALE_MM] * 3)
    two = [np.array([0.0, 0.0, height]) for height in HEIGHTS_MM]
    ranks, own, as_for_c = [], 0.0, 0.0
    for angle in b:
        seen = [
            place(ball, B=angle)[1][:, 8:14] * weights for ball in (*two, np.array([0.0, RADIUS_MM, HEIGHTS_MM[0]]))
        ]
        alone = np.array([angle])
        restored = [[paper.b_motions(alone, ball, way)[0] * weights for way in np.eye(3)] for ball in BALLS_MM.values()]
        as_for_c = max(as_for_c, float(np.abs(np.array(seen) - restored).max()))
        pair = np.concatenate(seen[:2])
        ranks.append([np.linalg.matrix_rank(pair, tol=1e-9), np.linalg.matrix_rank(np.concatenate(seen), tol=1e-9)])
        own = max(own, abs(float(np.linalg.svd(pair)[2][-1, 4])))
    by_two, by_three = int(np.max(ranks, axis=0)[0]), int(np.min(ranks, axis=0)[1])
    return [
        Claim(
            "P1-3c", "a bar that turns with b: tangential and radial reading equal the exact chain", "restored", worst, 0.0, 1e-9,
            "mm/rad", "x_b cos b - z_b sin b + x_c + Dz β_c and x_b sin b + z_b cos b",
        ),
        Claim(
            "P1-3d", "share of a wrong bar length that (12) reads as x_b", "restored: 1", float(constant[0]), 0.999, 1.001, "",
            "(12), (13) take x_b and z_b from the constant, where bar and set-up are, too",
        ),
        Claim(
            "P1-3e", "the same with a bar that turns with b", "restored: 0", float(abs(constant[1])), 0.0, 1e-9, "",
            "there x_b and z_b are harmonics",
        ),
        Claim(
            "P1-5h", "β_c in (15) less a zero error of B", "restored: 0", of_zero, 0.0, 1e-9, "mm/rad",
            "at b = 0 the two are one: B's zero has to be known",
        ),
        Claim("P1-5i", "angle error of C in (16)-(18)", "cannot be obtained", of_angle, 0.0, 1e-9, "mm/rad", "ball on the axis"),
        Claim("P1-5j", "B measured like C, balls at two heights on the C axis: rank", "5", by_two, 5.0, 5.0, "of 6"),
        Claim(
            "P1-5k", "and what stays unseen of B is its angle: share of EBB in it", "1", own, 0.999, 1.001, "",
            "the lever sees B's angle; unseen is the turn about the line of the balls, EAB sin b + ECB cos b", refuted=True,
        ),
        Claim("P1-5l", "with a third ball beside the axis: rank", "-", by_three, 6.0, 6.0, "of 6"),
        Claim(
            "P1-5m", "d + e × R_y(b) p, (16)-(18) for B, equals the exact chain at the three balls", "restored", as_for_c, 0.0,
            1e-9, "", "turns weighed at 200 mm",
        ),
    ]  # fmt: skip


# --- noise ---------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Repeated:
    """The assumed machine measured `count` times with the ball bar, set-up perfect: estimates (count,) by name.

    `exact`: in sequence without noise; `literal`: with (14) as printed; `without_c`: B's errors without noise on a machine
    whose C is perfect; `nonlinear_um` what first-order theory leaves of a reading; `stated` 1σ of the joint estimate.
    """

    sequence: dict[str, Array]
    joint: dict[str, Array]
    literal: dict[str, Array]
    exact: dict[str, Array]
    without_c: dict[str, Array]
    nonlinear_um: float
    stated: dict[str, float]

    def deviation(self, name: str) -> Array:
        """Relative deviations of the sequence's estimates from the truth."""
        return np.abs(self.sequence[name] / ASSUMED[name] - 1.0)


def repeated(count: int = 5000, seed: int = 2016) -> Repeated:
    """b from -90° to 90° and c once around, by 1°, uniform noise of ±2 µm; exact chain."""
    machine = paper_machine(errors="location")
    campaign = campaign_of(machine, bar_tests(machine, perfect=True))
    truth = {name: np.array([value]) for name, value in ASSUMED.items()}
    clean = readings_of(campaign, truth, 1)
    only_b = readings_of(campaign, {n: v for n, v in truth.items() if n.endswith("B")}, 1)
    seen = noisy({run: np.repeat(y, count, axis=0) for run, y in clean.items()}, seed)
    joint = Joint.of(campaign)
    tiny = readings_of(campaign, {n: 1e-3 * v for n, v in truth.items()}, 1)
    nominal = readings_of(campaign, {}, 1)
    nonlinear = max(float(np.abs(clean[r] - nominal[r] - 1e3 * (tiny[r] - nominal[r])).max()) for r in clean)
    return Repeated(
        rotary_in_sequence(campaign, seen), joint.estimate(seen), rotary_in_sequence(campaign, seen, literal=True),
        rotary_in_sequence(campaign, clean), rotary_in_sequence(campaign, only_b), nonlinear, joint.sigma,
    )  # fmt: skip


def of_noise(found: Repeated) -> list[Claim]:
    """P1-6, P1-7 and what the dropped terms cost."""
    of_b = [n for n in paper.LOCATION if n.endswith("B")]
    coupled = max(float(np.abs(found.exact[n] - found.without_c[n])[0]) / abs(ASSUMED[n]) for n in of_b)
    claims = [
        Claim("P1-6", "errors of C bias those of B, relative, no noise", "not at all", coupled, 0.0, 1e-3, "", "second order"),
    ]  # fmt: skip
    for letter, name, expected in (
        ("a", "EA0B", 1.7), ("b", "EC0B", 0.84), ("c", "EX0B", 0.19), ("d", "EZ0B", 0.20), ("e", "EX0C", 0.24),
        ("f", "EY0C", 0.15), ("g", "EA0C", 2.0), ("h", "EB0C", 1.26),
    ):  # fmt: skip
        unit = "µrad" if name[1] in "ABC" else "µm"
        spread = float(found.sequence[name].std())
        claims.append(
            Claim(f"P1-7{letter}", f"1σ of {name}, noise ±2 µm", f"restored: {expected:g} {unit}", spread, 0.75 * expected,
                  1.25 * expected, unit, f"joint estimate: {found.joint[name].std():.2f} {unit}")
        )  # fmt: skip
    share = min(float(np.mean(found.deviation(n) < 0.1)) for n in paper.LOCATION)
    x_c, y_c = (float(np.mean(found.literal[n]) - ASSUMED[n]) for n in ("EX0C", "EY0C"))
    return [
        *claims,
        Claim("P1-7i", "share of runs with every relative deviation below 10 % (worst error)", "99 %", share, 0.99, 1.0),
        Claim(
            "P1-5d", "(14) taken literally, first ball 60 mm above the intersection: bias of x_c", "0", abs(x_c), 0.0, 0.5, "µm",
            "(14) holds only if the first plane passes through the intersection; use (15) at both heights", refuted=True,
        ),
        Claim("P1-5e", "that bias", "restored: 5.4 µm", abs(x_c), 5.3, 5.5, "µm"),
        Claim("P1-5f", "and of y_c", "restored: -9.6 µm", y_c, -9.7, -9.5, "µm"),
        Claim(
            "P1-5g", "share of a run-out EXC·cos 2c that (15) reads as x_c", "0", _leak(), 0.0, 0.01, "",
            "half of it: times cos c it is a first harmonic; the motions of C have to be found with its location", refuted=True,
        ),
        Claim(
            "P1-9b", "share of a screw's periodic error (pitch 5 mm) that lines read every 5 mm show", "-", _seen_of_pitch(), 0.5,
            1.0, "", "none: every reading falls on the same phase; another pitch of the readings shows it", refuted=True,
        ),
        Claim("P1-9a", "second-order terms dropped from a reading of the bar", "ignored", found.nonlinear_um, 0.0, 0.05, "µm"),
    ]  # fmt: skip


def _seen_of_pitch() -> float:
    """Amplitude of sin(2πx/5 mm) in the readings of a line of the paper's plan."""
    run = next(run for run in grid_tests(paper_machine()) if run.id.startswith("x-line1"))
    return float(np.ptp(np.sin(2.0 * np.pi * run.commands["X"] / 5.0)) / 2.0)


def _leak() -> float:
    """What the sequence finds of x_c on a machine of which C only runs out, per run-out."""
    machine = paper_machine()
    campaign = campaign_of(machine, bar_tests(machine, b_step=10.0, c_step=15.0, perfect=True))
    readings = readings_of(campaign, {"EXC.cos2": np.ones(1)}, 1)
    return abs(float(rotary_in_sequence(campaign, readings)["EX0C"][0]))


def all_claims(found: Repeated, of_b: Turned) -> list[Claim]:
    """The whole table."""
    claims = [
        *of_grid(),
        *of_squareness(),
        *of_chain(),
        *of_ball_bar(),
        *of_patterns(),
        *of_b_motions(of_b),
        *of_noise(found),
    ]
    return sorted(claims, key=lambda claim: claim.id)
