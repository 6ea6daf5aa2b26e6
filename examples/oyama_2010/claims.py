"""Every claim of the paper that can be computed, computed. Each function needs nothing but the equations and the plant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from examples.claims import Claim
from symfive.campaign import Campaign
from symfive.identify import identify_by_position
from symfive.machine import ErrorTerm

from . import equations as paper
from .machine import (
    B_DEG,
    C_DEG,
    INTERSECTION,
    NESTS,
    Concealed,
    Motion,
    concealed,
    grid_of,
    nests_of_the_paper,
    paper_machine,
    record,
)
from .steps import (
    B_ANGLES,
    C_ANGLES,
    ORIGIN,
    TO_FILE,
    Calibration,
    ErrorMap,
    chain_jacobian,
    in_the_paper_gauge,
    map_of,
    mapped_jointly,
)

Array = NDArray[np.float64]
SINGLE = (80.0, 0.0, 40.0)
"""w_p* for which the condition number of J(B_i) is 2.15 and the leaks are restored, mm from the intersection."""
LOW = tuple((80.0, 0.0, height + INTERSECTION[2]) for height in (40.0, 140.0))
"""The same place and one above it, in the workpiece frame."""
TILT_URAD, GAMMA_URAD = 20.0, 10.0


def sine(order: int, size: float) -> Motion:
    """`size` · sin(order · angle), the angle in degree."""
    return partial(_sine, order, size)


def _sine(order: int, size: float, degrees: Array) -> Array:
    return np.asarray(size * np.sin(np.radians(order * degrees)))


def gauge_vectors() -> Array:
    """What no R-test can see (2, 42): a shift along, and a turn about, the C axis as it stands at the reference pose."""
    shift = np.zeros((len(B_DEG), 6))
    turn = np.zeros((len(B_DEG), 6))
    shift[:, 0], shift[:, 2] = -np.sin(B_ANGLES), -np.cos(B_ANGLES)
    turn[:, 3], turn[:, 5] = -np.sin(B_ANGLES), -np.cos(B_ANGLES)
    return np.stack([shift.ravel(), turn.ravel()])


def of_calibration(found: Calibration) -> list[Claim]:
    """Section 3.2: P2-8."""
    clean, noisy = found.runout_error_um(found.runout_clean), found.runout_error_um(found.runout)
    return [
        Claim("P2-8a", "sensor directions from 27 moves with 0.1 µm of noise", "< 5e-4", found.direction_error, 0.0, 5e-4),
        Claim(
            "P2-8b", "ball run-out from indexing, without noise", "< 0.01 µm", clean, 0.0, 0.01, "µm",
            f"with 0.1 µm of noise and 8 positions {noisy:.2f} µm: noise, not method, is the limit",
        ),
    ]  # fmt: skip


def of_equations(plan: Campaign) -> list[Claim]:
    """Equations (8)-(15) against symfive's chain and by their ranks: P2-1, P2-2, P2-3."""
    generator = np.random.default_rng(1)
    b_deg, c_deg = generator.uniform(-90.0, 90.0, 40), generator.uniform(0.0, 360.0, 40)
    nest, machine = NESTS[0], paper_machine()
    [ours] = nests_of_the_paper([nest])
    b, c = np.radians(b_deg), np.radians(c_deg)
    printed = np.concatenate([paper.b_jacobian(b, c, ours), paper.c_jacobian(c, ours)], axis=2)
    residual = float(np.abs(printed - chain_jacobian(machine, b_deg, c_deg, nest)).max())
    run = plan.runs[0]
    poses = len({(float(i), float(j)) for i, j in zip(run.commands["B"], run.commands["C"], strict=True)})

    at_zero = (paper.b_jacobian(0.0, C_ANGLES, ours) - paper.b_jacobian(0.0, 0.0, ours)).reshape(-1, 6)
    rank, null = paper.null_combinations(at_zero)
    unseen = [paper.B_ERRORS[k] for k in np.flatnonzero(np.abs(null).max(axis=0) > 1e-9)]
    one, combinations = paper.null_combinations(paper.joint_jacobian(B_ANGLES, C_ANGLES, [ours]))
    two, _ = paper.null_combinations(paper.joint_jacobian(B_ANGLES, C_ANGLES, nests_of_the_paper()))
    expected = gauge_vectors()
    share = np.linalg.lstsq(combinations.T, expected.T, rcond=None)[0]
    off = float(np.abs(combinations.T @ share - expected.T).max())
    independent = paper.joint_jacobian(B_ANGLES, C_ANGLES, [ours]).reshape(-1, len(B_DEG), 6).sum(axis=1)
    constant, _ = paper.null_combinations(independent)
    weights = np.array([1.0] * 3 + [1.0 / paper.LEVER_MM] * 3)
    condition = np.linalg.cond(paper.b_jacobian(B_ANGLES[1], C_ANGLES, SINGLE).reshape(-1, 6) * weights)
    return [
        Claim("P2-1", "(8), (9) equal the exact chain of symfive to first order", "zero matrix", residual, 0.0, 1e-10, "mm/rad"),
        Claim("P2-2", "poses of the map", "7 × 12 = 84", poses, 84.0, 84.0),
        Claim(
            "P2-3a", "rank of (15) at B = 0", "6 (tacitly)", rank, 6.0, 6.0, "of 6",
            f"{' and '.join(unseen)} at B = 0 change no reading, the reference pose being one of the twelve", refuted=True,
        ),
        Claim(
            "P2-3b", "rank of (15) over all seven B", "42 (tacitly)", one, 42.0, 42.0, "of 42",
            "a shift along and a turn about the C axis of the reference pose stay unseen: "
            "dx_BY(B) = -t·sin B with dz_BY(B) = -t·cos B, and alpha_BY with gamma_BY likewise", refuted=True,
        ),
        Claim("P2-3c", "those two span the null space of (14)", "restored", off, 0.0, 1e-9),
        Claim("P2-3d", "rank with the second nest", "restored: 40", two, 40.0, 40.0, "of 42", "a second place does not help"),
        Claim("P2-3e", "combinations that symfive leaves undetermined", "restored: 2", _unseen_by_symfive(plan), 2.0, 2.0),
        Claim("P2-3f", "rank if the errors of B do not depend on B", "restored: 6", constant, 6.0, 6.0, "of 6"),
        Claim("P2-3g", "condition number of J(B_i), nest (80, 0, 40) mm", "restored: 2.15", condition, 2.14, 2.16),
    ]  # fmt: skip


def _unseen_by_symfive(plan: Campaign) -> int:
    """How many combinations of the six errors at seven B an identification by position leaves undetermined."""
    machine = paper_machine()
    free = replace(machine, errors={f"E{k}0B": ErrorTerm(name=f"E{k}0B", sigma=100.0) for k in "XYZABC"})
    blank = tuple(run.with_readings({f"d{k}_um": np.zeros(run.rows) for k in "xyz"}) for run in plan.runs[:1])
    result = identify_by_position(replace(plan, runs=blank, machine=free), "B", sigma=100.0, noise="declared")
    return sum(not all(name.startswith("setup.") for name in c.names) for c in result.confounded)


# --- what leaks where --------------------------------------------------------------------------------------
def leak_free(hidden: Concealed) -> Concealed:
    """The same machine with dz_BY(0) = 0, which the paper's gauge presumes."""
    down = hidden.b["Z"]
    return replace(hidden, b={**hidden.b, "Z": lambda b: down(b) - down(np.zeros(1))})


@dataclass(frozen=True)
class Leak:
    """What the map and the joint estimate say of B (7, 6), µm and µrad, where only C errs; the map itself."""

    of_b: Array
    jointly: Array
    map: ErrorMap


def leak_of(motions: Mapping[str, Motion], folder: Path) -> Leak:
    """Record a machine of which only C errs, without noise, with the sensors low, and map it both ways."""
    campaign = record(grid_of(paper_machine(), nests=LOW), Concealed(c=dict(motions)), folder, noise=False)
    found = map_of(campaign)
    return Leak(found.of_b * TO_FILE, mapped_jointly(campaign)[1], found)


def of_leaks(folder: Path) -> list[Claim]:
    """Noise-free machines: P2-4 to P2-7."""
    plan, usual = grid_of(paper_machine()), leak_free(concealed())
    truth_b, truth_c = usual.values("B", B_DEG), usual.values("C", C_DEG)
    only_b = map_of(record(plan, replace(usual, c={}), folder / "b-only", noise=False)).of_b * TO_FILE - truth_b
    campaign = record(plan, usual, folder / "b-and-c", noise=False)
    both = map_of(campaign).of_c * TO_FILE - truth_c
    wrong = map_of(campaign, sign=-1.0).of_c * TO_FILE - truth_c
    cone = _third(both + truth_c)
    tilt = leak_of({"A": sine(2, TILT_URAD)}, folder / "tilt")
    constant = {k: partial(_constant, size) for k, size in zip("XYA", (5.0, -3.0, TILT_URAD), strict=True)}
    absorbed = map_of(record(plan, Concealed(c=constant), folder / "constant", noise=False)).of_c * TO_FILE
    angle = leak_of({"C": sine(2, GAMMA_URAD)}, folder / "angle")
    first, others = _of_the_reference(plan)
    gamma = 1e-6 * GAMMA_URAD * np.sin(2.0 * C_ANGLES)
    radius = NESTS[0][0]
    tangential = -np.sin(C_ANGLES) * angle.map.of_c[ORIGIN, :, 0] + np.cos(C_ANGLES) * angle.map.of_c[ORIGIN, :, 1]
    lever = float(tangential @ gamma / (gamma @ gamma))
    return [
        Claim("P2-4a", "errors of B recovered without noise, C perfect", "< 0.01 µm", _worst(only_b[:, :3]), 0.0, 0.01, "µm"),
        Claim("P2-4b", "the same, angles", "< 0.01 µrad", _worst(only_b[:, 3:]), 0.0, 0.01, "µrad"),
        Claim("P2-5a", "errors of C recovered, leak-free harmonics", "< 0.05 µm", _worst(both[..., :3]), 0.0, 0.05, "µm"),
        Claim("P2-5b", "the same, angles", "< 0.05 µrad", _worst(both[..., 3:]), 0.0, 0.05, "µrad"),
        Claim(
            "P2-9f", "alpha_CB at B = 0 and ±90° (coning): amplitudes of its sin 3C apart", "the same amplitude",
            float(np.abs(cone[[0, -1]] - cone[ORIGIN]).max()), 0.0, 0.05, "µrad",
            f"all are {cone[ORIGIN]:.1f} µrad; without noise",
        ),
        Claim(
            "P2-5c", "(20) read as q = b_p - (b_p^ - b_p*) recovers C", "a sign the print lost", _worst(wrong[..., :3]), 0.0, 4.0,
            "µm", "the ball moves against the table, so the influence of B must be added back, q = b_p + (b_p^ - b_p*)",
            refuted=True,
        ),
        Claim(
            "P2-6a", "a tilt of C of 20 µrad·sin 2C leaks into beta_BY", "10 ± 1 µrad", _worst(tilt.of_b[:, 4]), 9.0, 11.0, "µrad"
        ),
        Claim("P2-6b", "and into dx_BY, dz_BY", "0.5 µm", _worst(tilt.of_b[:, [0, 2]]), 0.45, 0.55, "µm"),
        Claim(
            "P2-6c", "what leaks if B and C are identified at once", "-", _worst(tilt.jointly[:, 4]), 0.0, 0.5, "µrad",
            "symfive.identify_by_position with Fourier series of C; the leak is the price of doing B first",
        ),
        Claim(
            "P2-6d", "what the map leaves in C of errors of C that are constant: 5 µm, -3 µm, 20 µrad", "restored: nothing",
            _worst(absorbed), 0.0, 0.01, "µm, µrad", "B takes them up entirely",
        ),
        Claim(
            "P2-6e", "share of a wrong reading at the reference pose that returns as a first harmonic of dx_CB, B ≠ 0",
            "restored: a first harmonic", first, 0.49, 0.51, "", f"at every B; of other orders {others:.0e}",
        ),
        Claim(
            "P2-7", "gamma_CB, set to zero, returns as a tangential shift of radius × gamma", f"{radius:g} mm × gamma", lever,
            radius - 0.1, radius + 0.1, "mm × gamma", f"{1e-3 * radius * GAMMA_URAD:.1f} µm for 10 µrad",
        ),
    ]  # fmt: skip


def _constant(size: float, degrees: Array) -> Array:
    return np.full(np.shape(degrees), size)


def _of_the_reference(plan: Campaign) -> tuple[float, float]:
    """Least amplitude over B ≠ 0 of a first harmonic of dx_CB, and the largest of any other order, per wrong reading."""
    at = [(run.commands["B"] == 0.0) & (run.commands["C"] == 0.0) for run in plan.runs]
    wrong = [
        run.with_readings({"dx_um": 1.0 * hit, "dy_um": 0.0 * hit, "dz_um": 0.0 * hit})
        for run, hit in zip(plan.runs, at, strict=True)
    ]
    dx = np.delete(map_of(replace(plan, runs=tuple(wrong))).of_c[..., 0], ORIGIN, axis=0) * 1e3
    sizes = 2.0 * np.abs(np.fft.rfft(dx, axis=1)) / len(C_DEG)
    return float(sizes[:, 1].min()), float(np.delete(sizes, 1, axis=1).max())


def _third(of_c: Array) -> Array:
    """Amplitude of the third harmonic of alpha_CB at every B (7,), µrad."""
    return np.asarray(np.abs(of_c[:, :, 3] @ np.exp(-3j * C_ANGLES)) * 2.0 / len(C_DEG))


def _worst(values: Array) -> float:
    return float(np.abs(values).max())


# --- section 4: the map as printed -------------------------------------------------------------------------
def of_map(found: ErrorMap, hidden: Concealed) -> list[Claim]:
    """The figures of section 4, on a machine that has them, with noise."""
    of_b, truth = found.of_b * TO_FILE, hidden.values("B", B_DEG)
    mean = of_b.mean(axis=0)
    down, true_down = of_b[ORIGIN, 2] - of_b[[0, -1], 2].mean(), truth[ORIGIN, 2] - truth[[0, -1], 2].mean()
    tilt = float(np.degrees(1e-6 * (of_b[-1, 3] - of_b[0, 3]) / 2.0))
    about_z = float(np.degrees(1e-6 * (of_b[-1, 5] - of_b[0, 5]) / 2.0))
    about_y = _worst(of_b[:, 4]) / _worst(of_b[:, 3])
    [nest] = nests_of_the_paper(NESTS[:1])
    places = [paper.table_position(e, B_ANGLES[-1], C_ANGLES, nest) for e in (found.of_b[-1], np.zeros(6))]
    lowered = float(1e3 * (places[0] - places[1])[:, 2].mean())
    amplitudes = _third(found.of_c * TO_FILE)
    # 12 readings of two nests 100 mm apart, noise 0.3 µm in each
    std = 0.3 * np.sqrt(2.0) / 0.1 * np.sqrt(2.0 / len(C_DEG))
    apart = float(np.abs(amplitudes[[0, -1]].mean() - amplitudes[ORIGIN]) / (std * np.sqrt(1.5)))
    gauge = _worst((of_b - in_the_paper_gauge(truth))[:, :3])
    return [
        Claim("P2-9a", "dx_BY on average", "4 µm", float(mean[0]), 3.7, 4.3, "µm"),
        Claim("P2-9b", "dy_BY on average", "6 µm", float(mean[1]), 5.7, 6.3, "µm"),
        Claim("P2-9c", "dz_BY at B = ±90°", "-9 µm", float(of_b[[0, -1], 2].mean()), -9.3, -8.7, "µm"),
        Claim(
            "P2-9d", "the table sinks from B = 0 to ±90° by", f"{true_down:.0f} µm", float(down), true_down - 0.5,
            true_down + 0.5, "µm",
            "by (15) dz_BY(0) is a choice, not a measurement: with 0 the map shows 9 µm, and 3 µm·sin B too much in dx_BY",
            refuted=True,
        ),
        Claim("P2-9e", "alpha_BY between the ends", "±0.003°", tilt, 2.8e-3, 3.2e-3, "°"),
        Claim("P2-9g", "largest error of the map's shifts in its gauge, 0.3 µm of noise", "-", gauge, 0.0, 0.7, "µm"),
        Claim("P2-9h", "the table at B = +90° along Z by (23), mean over C", "about 10 µm", abs(lowered), 8.5, 11.0, "µm"),
        Claim("P2-9i", "gamma_BY between the ends: half of it", "analogous to alpha_BY", abs(about_z), 2.2e-3, 2.8e-3, "°"),
        Claim("P2-9j", "largest beta_BY over the largest alpha_BY", "almost none", about_y, 0.0, 0.1),
        Claim(
            "P2-9k", "P2-9f with 0.3 µm of noise: difference in its 1σ", "similar", apart, 0.0, 3.0, "σ",
            f"{amplitudes[ORIGIN]:.1f} µrad at B = 0, {amplitudes[0]:.1f} and {amplitudes[-1]:.1f} at the ends, 1σ {std:.1f}: "
            "from single poses noise, not likeness, is what one sees",
        ),
    ]  # fmt: skip


def all_claims(
    calibration: Calibration, campaign: Campaign, found: ErrorMap, hidden: Concealed, folder: Path
) -> list[Claim]:
    """The whole table. `campaign` measured on the machine `hidden`, `found` its map; recordings go below `folder`."""
    claims = [*of_equations(campaign), *of_leaks(folder), *of_calibration(calibration), *of_map(found, hidden)]
    return sorted(claims, key=lambda claim: claim.id)
