"""Claims about the cross grid: equation (10), what it can and cannot separate, and squareness from one plate."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from examples.claims import Claim
from symfive.procedures import campaign_of

from . import equations as paper
from .estimators import Sequence
from .machine import grid_tests, paper_machine, readings_of

Array = NDArray[np.float64]
SCALE_MM = 200.0
"""Angles times this length where conditioning is asked for."""
LAYOUTS = {200.0: ((0.0, 0.0), (0.0, 200.0), (200.0, 0.0)), 100.0: ((0.0, 0.0), (0.0, 100.0), (100.0, 0.0)),
           10.0: ((0.0, 0.0), (200.0, 10.0), (0.0, 200.0))}  # fmt: skip
"""Places (y, z) of three lines, mm, by their distance."""


def nine_slopes(point: Array) -> Array:
    """(9) as slopes (3, 7) per dx, dy, dz, ex, ey, ez of X and a_xy, at a point mm."""
    units = np.eye(7).tolist()
    columns = [np.asarray(ca.DM(paper.line_displacement(point.tolist(), unit[:6], unit[6]))).ravel() for unit in units]
    return np.stack(columns, axis=1)


def of_grid() -> list[Claim]:
    """(10): determinant, ranks, conditioning, and what it cannot separate: P1-1."""
    generator = np.random.default_rng(3)
    worst = 0.0
    for _ in range(50):
        (y1, z1), (y2, z2), (y3, z3) = offsets = [
            tuple(pair) for pair in generator.uniform(-200.0, 200.0, (3, 2)).tolist()
        ]
        area = (y2 - y1) * (z3 - z1) - (y3 - y1) * (z2 - z1)
        det = float(np.linalg.det(paper.lines_matrix(generator.uniform(-300.0, 300.0), offsets)))
        worst = max(worst, abs(abs(det) - abs((z2 - z1) * area)) / abs((z2 - z1) * area))
    same = _rank(((0.0, 50.0), (100.0, 50.0), (0.0, 150.0)))
    collinear = _rank(((0.0, 0.0), (50.0, 100.0), (100.0, 200.0)))
    claims = [
        Claim(
            "P1-1a",
            "det (10) = ± (z2 - z1) · area form of the three lines: relative difference",
            "exact",
            worst,
            0.0,
            1e-9,
        ),
        Claim("P1-1b", "rank of (10) with z1 = z2", "5", same, 5.0, 5.0, "of 6", "the roll is lost"),
        Claim("P1-1c", "rank of (10) with three lines in one plane", "5", collinear, 5.0, 5.0, "of 6"),
    ]
    printed = {(200.0, 0.0): 3.7, (200.0, 300.0): 9.4, (100.0, 0.0): 6.3, (100.0, 300.0): 16.6, (10.0, 0.0): 55.0,
               (10.0, 300.0): 77.0}  # fmt: skip
    for letter, ((spacing, x), expected) in zip("defghi", printed.items(), strict=True):
        matrix = paper.lines_matrix(x, LAYOUTS[spacing]) * np.array([1.0] * 3 + [1.0 / SCALE_MM] * 3)
        what = f"condition of (10), {spacing:g} mm apart" if spacing > 10.0 else "condition of (10), z2 - z1 = 10 mm"
        ours = float(np.linalg.cond(matrix))
        claims.append(
            Claim(
                f"P1-1{letter}",
                f"{what}, x = {x:g} mm",
                f"restored: {expected:g}",
                ours,
                0.98 * expected,
                1.02 * expected,
            )
        )
    one = np.linalg.inv(paper.lines_matrix(300.0, LAYOUTS[200.0]))
    sd = np.sqrt((one**2).sum(axis=1))
    closer = np.sqrt((np.linalg.inv(paper.lines_matrix(300.0, LAYOUTS[100.0])) ** 2).sum(axis=1))
    whole = _nine_readings(300.0, LAYOUTS[200.0])
    better = float(np.sqrt(np.linalg.inv(whole.T @ whole)[3, 3]))
    yaw = one @ (300.0 * 1e-6 * np.array([0.0, 0.0, 0.0, 0.0, 30.0, 0.0]))
    both = one @ (300.0 * 1e-6 * np.array([0.0, 20.0, -15.0, 0.0, 20.0, 0.0]))
    return [
        *claims,
        Claim("P1-1j", "1σ of ex for 1 µm of noise, 200 mm apart", "restored: 7.1 µrad", 1e3 * sd[3], 6.9, 7.3, "µrad"),
        Claim("P1-1k", "1σ of dy at x = 300 mm", "restored: 2.35 µm", sd[1], 2.3, 2.4, "µm", "the lever of ez"),
        Claim("P1-1l", "1σ of ex with all nine readings", "restored: 4.3 µrad", 1e3 * better, 4.2, 4.4, "µrad"),
        Claim(
            "P1-1m", "false roll at x = 300 mm, two plates 30 µrad apart in yaw, 200 mm apart in z", "restored: 45 µrad",
            1e6 * abs(yaw[3]), 44.0, 46.0, "µrad", "(10) cannot tell it: one reference of alignment per pair of lines is needed",
        ),
        Claim("P1-1n", "false dy, both plates 20 µrad off in yaw", "restored: 6 µm", 1e3 * abs(both[1]), 5.9, 6.1, "µm"),
        Claim("P1-1o", "false dz, plate 15 µrad off in pitch", "restored: 4.5 µm", 1e3 * abs(both[2]), 4.4, 4.6, "µm"),
        Claim(
            "P1-1p", "false ey and ez by the same plates", "restored: 0", 1e6 * float(np.abs([yaw, both])[:, 4:].max()), 0.0,
            1e-9, "µrad", "they come from Dx alone",
        ),
        Claim("P1-1q", "1σ of dz at x = 300 mm", "restored: 2.35 µm", sd[2], 2.3, 2.4, "µm", "the lever of ey"),
        Claim("P1-1r", "1σ of ex, 100 mm apart", "restored: 14.1 µrad", 1e3 * closer[3], 13.9, 14.4, "µrad"),
        Claim("P1-1s", "1σ of dy at x = 300 mm, 100 mm apart", "restored: 4.4 µm", closer[1], 4.3, 4.5, "µm"),
        Claim(
            "P1-1t", "share of the constants of the six errors that (10) finds", "restored: 0", _constants(), 0.0, 1e-9, "",
            "every line is zeroed at its start; constant ey and ez come back as slopes of dz and dy, as squareness",
        ),
        Claim(
            "P1-1u", "a slope of dy less a_xy, in all nine readings", "restored: 0", _slope(), 0.0, 1e-9, "µm/µm",
            "a convention parts them: squareness has the least-squares slope, straightness has none",
        ),
    ]  # fmt: skip


def _rank(offsets: tuple[tuple[float, float], ...]) -> int:
    matrix = paper.lines_matrix(120.0, offsets) * np.array([1.0] * 3 + [1.0 / SCALE_MM] * 3)
    return int(np.linalg.matrix_rank(matrix, tol=1e-9))


def _nine_readings(x: float, offsets: tuple[tuple[float, float], ...]) -> Array:
    """All of Dx, Dy, Dz on each line: (9, 6)."""
    return np.concatenate([nine_slopes(np.array([x, y, z]))[:, :6] for y, z in offsets])


def _constants() -> float:
    """Largest share of a constant dx … ez that (10) returns as itself, all lines zeroed at x = -300 mm."""
    layout, six = LAYOUTS[200.0], [0, 1, 2, 3, 4, 6]  # Dx1, Dy1, Dz1, Dx2, Dy2, Dx3
    start = _nine_readings(-300.0, layout)[six]
    found = [
        np.linalg.solve(paper.lines_matrix(x, layout), _nine_readings(x, layout)[six] - start)
        for x in (-100.0, 0.0, 300.0)
    ]
    return float(np.abs(np.diagonal(found, axis1=1, axis2=2)).max())


def _slope() -> float:
    """Largest difference of a slope of dy from a_xy in the readings of three lines, over the travel from their start."""
    unlike = 0.0
    for y, z in LAYOUTS[200.0]:
        start, end = (nine_slopes(np.array([x, y, z])) for x in (-300.0, 300.0))
        sloped = 300.0 * end[:, 1] + 300.0 * start[:, 1]
        unlike = max(unlike, float(np.abs(sloped - (end - start)[:, 6]).max()) / 600.0)
    return unlike


def of_squareness() -> list[Claim]:
    """Section 3, figure 5: both legs on one plate that stands askew: P1-4."""
    machine = paper_machine()
    corners = tuple(run for run in grid_tests(machine, pitch=20.0) if run.id.startswith("square-"))
    campaign = campaign_of(machine, corners)
    true = {"EC0X": 40.0, "EB0Z": -30.0, "EA0Z": 20.0}
    askew = {f"setup.{run.id}.plate.{letter}": 100.0 for run in corners for letter in "abc"}
    readings, nominal = (
        readings_of(campaign, {name: np.array([size]) for name, size in values.items()}, 1)
        for values in (true | askew, {})
    )
    found = Sequence(campaign).squareness({run: y - nominal[run] for run, y in readings.items()})
    worst = max(abs(float(found[name][0]) - size) for name, size in true.items())
    return [
        Claim(
            "P1-4c", "squareness from both legs on a plate 100 µrad askew: largest error of the three", "restored: 0", worst, 0.0,
            0.1, "µrad", "the plate's yaw enters the two slopes with opposite signs",
        ),
    ]  # fmt: skip
