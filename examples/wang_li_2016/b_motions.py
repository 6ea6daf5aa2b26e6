"""Error motions of B, of which the paper only says that they are measured like those of C: that way, and all at once.

The bar stands along X, Y and Z while B turns, with balls at two heights on the C axis and a third one beside it. Location
errors of B and C, and whatever a set-up adds to one reading, are 1, cos b and sin b in every one of the six functions; what
is left of a function is what is compared here, µm and µrad.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from examples.claims import Claim
from symfive.campaign import Campaign, Run
from symfive.identify import Identification, identify
from symfive.kinematics import basis_of
from symfive.machine import Machine, preset
from symfive.model import Model
from symfive.procedures import campaign_of, static_ball_bar

from . import equations as paper
from . import estimators
from .estimators import SLOPES, Joint, effect_of, noisy
from .machine import (
    ASSUMED,
    BAR_MM,
    BAR_SETUP,
    HEIGHTS_MM,
    NOISE_UM,
    PERFECT,
    RADIUS_MM,
    TOOL_MM,
    angle,
    bar_tests,
    draw,
    grid_tests,
    measured,
    paper_machine,
    readings_of,
)  # fmt: skip

Array = NDArray[np.float64]
Readings = Mapping[str, Array]
COMBINED = ("EXB", "EYB", "EZB", "EAB cos b - ECB sin b", "EBB", "EAB sin b + ECB cos b")
"""What is estimated. The last one turns the table about the line of the two balls, which then do not move."""
BALLS_MM = {
    "low": (0.0, 0.0, HEIGHTS_MM[0]), "high": (0.0, 0.0, HEIGHTS_MM[1]), "beside": (0.0, RADIUS_MM, HEIGHTS_MM[0]),
}  # fmt: skip
TWO_BALLS = ("b-low-x", "b-low-y", "b-low-z", "b-high-x", "b-high-y", "b-high-z")
THIRD_BALL = ("b-beside-x", "b-beside-z")
LEVER_MM = 100.0
"""Angles are weighed by what they do at this distance."""
SIZES = np.array([1.0] * 3 + [1e-3 * LEVER_MM] * 3)
"""µm at the ball per µm and per µrad, in the order of COMBINED."""
UNITS_MM = np.array([1.0] * 3 + [1.0 / LEVER_MM] * 3)
"""Displacements of 1 mm, and turns that displace by 1 mm at LEVER_MM (rad)."""


def machine_with_b(*, rotary: bool = False) -> Machine:
    """The paper's machine with error motions of B, harmonics up to 3b; `rotary`: with no errors of the linear axes and C."""
    machine, usual = paper_machine(errors="location" if rotary else "all"), preset("wang-li-2016").errors
    motions = {f"E{k}B": replace(usual[f"E{k}B"], basis=("fourier",), order=(3,)) for k in "XYZABC"}
    return replace(machine, errors={**machine.errors, **motions})


def tests_of_b(machine: Machine, *, b_step: float = 5.0, perfect: bool = False) -> tuple[Run, ...]:
    """(16)-(18) with B turning in place of C, and two more with the ball beside the axis; every one a set-up of its own."""
    b = np.arange(-90.0, 90.0 + 1e-9, b_step)
    runs = []
    for name in (*TWO_BALLS, *THIRD_BALL):
        _, ball, letter = name.split("-")
        [run] = static_ball_bar(
            machine, poses={"B": b}, direction=np.eye(3)["xyz".index(letter)].tolist(), table_balls=[BALLS_MM[ball]],
            length=BAR_MM, tool_ball=TOOL_MM, noise_um=float(NOISE_UM), setup_sigma_um=PERFECT if perfect else BAR_SETUP,
        )  # fmt: skip
        runs.append(replace(run, id=name, file=f"{name}.csv"))
    return tuple(runs)


# --- the six functions ---------------------------------------------------------------------------------------
def left_over(b: Array, values: Array) -> Array:
    """Functions of b (..., N) less their least-squares part in {1, cos b, sin b}."""
    basis = paper.b_basis(b)
    return np.asarray(values - values @ np.linalg.pinv(basis).T @ basis.T)


def curves(machine: Machine, names: Sequence[str], b: Array) -> Array:
    """COMBINED at b (N,) rad per parameter (6, N, k), what is left over of them."""
    place = {name: k for k, name in enumerate(names)}
    own = np.zeros((6, len(b), len(names)))
    for i, letter in enumerate("XYZABC"):
        basis = basis_of(machine.errors[f"E{letter}B"], machine)
        own[i][:, [place[f"E{letter}B.{n}"] for n in basis.names]] = basis.matrix(-b)
    return np.moveaxis(left_over(b, _combined(b, np.moveaxis(own, 2, 0))), 0, 2)


def pointwise(campaign: Campaign, deviations: Readings, *, third: bool = True) -> Array:
    """Like (19) at every b: COMBINED (machines, 6, N) from eight tests, or (machines, 5, N) from six with two balls."""
    names = (*TWO_BALLS, *THIRD_BALL) if third else TWO_BALLS
    b = angle(campaign.run(names[0]), "B")
    rows = []
    for name in names:
        _, ball, letter = name.split("-")
        slopes = paper.b_motions(b, BALLS_MM[ball], np.eye(3)["xyz".index(letter)])
        rows.append(_combined(b, slopes.T).T[:, : 6 if third else 5])
    scale = UNITS_MM[: rows[0].shape[1]]
    inverse = np.linalg.pinv(np.stack(rows, axis=1) * scale)
    seen = np.stack([-1e-3 * deviations[name][..., 0] for name in names], axis=-1)
    return np.asarray(np.einsum("nkr,mnr->mkn", inverse, seen) * (1e3 / SIZES[: len(scale), None]))


def in_sequence(campaign: Campaign, readings: Readings, *, smooth: bool = True) -> Array:
    """The paper's order: linear axes first and subtracted, then B at every b; what is left over (machines, 6, N).

    Location errors need not be subtracted. `smooth`: fitted with harmonics up to 3b, as it is done for C.
    """
    nominal = readings_of(campaign, {}, 1)
    deviations = {run: y - nominal[run] for run, y in readings.items()}
    found = estimators.Sequence(campaign).estimate(readings)
    linear = {name: values for name, values in found.items() if name.split(".")[0][-1] in "XYZ"}
    model, bars = Model(campaign), [campaign.run(name) for name in (*TWO_BALLS, *THIRD_BALL)]
    b = angle(bars[0], "B")
    six = pointwise(campaign, {r.id: deviations[r.id] - effect_of(model, r, linear) for r in bars})
    return left_over(b, _smoothed(b, six) if smooth else six)


def _smoothed(b: Array, six: Array) -> Array:
    """COMBINED (..., 6, N) with the six error motions fitted by harmonics up to 3b."""
    harmonics = np.column_stack([f(k * b) for k in range(4) for f in (np.cos, np.sin)])
    return _combined(b, _combined(b, six, back=True) @ np.linalg.pinv(harmonics).T @ harmonics.T)


def _combined(b: Array, six: Array, *, back: bool = False) -> Array:
    """COMBINED from the six error motions (..., 6, N), or `back`: a turn of EAB and ECB by b."""
    cos, sin = np.cos(b), -np.sin(b) if back else np.sin(b)
    out = six.copy()
    out[..., 3, :], out[..., 5, :] = (
        six[..., 3, :] * cos - six[..., 5, :] * sin,
        six[..., 3, :] * sin + six[..., 5, :] * cos,
    )
    return out


# --- one machine, many machines ------------------------------------------------------------------------------
def whole(machine: Machine) -> Campaign:
    """The paper's tests and those of B."""
    runs = (*grid_tests(machine, pitch=20.0), *bar_tests(machine, b_step=10.0, c_step=15.0, motions=True))
    return campaign_of(machine, (*runs, *tests_of_b(machine)), "wang-li-2016, with B")


@dataclass(frozen=True)
class OneTurned:
    """One machine: b (N,) rad and what is left over of COMBINED (6, N): true, in sequence point by point, jointly with its 1σ."""

    b: Array
    true: Array
    sequence: Array
    joint: Array
    std: Array
    result: Identification


def one_turned(*, seed: int = 11) -> OneTurned:
    """Draw a machine, measure it with everything a little askew, evaluate it both ways."""
    machine = machine_with_b()
    tests = whole(machine)
    parameters = Model(tests).parameters
    drawn = draw(parameters, 1, seed, truth=ASSUMED | dict.fromkeys(SLOPES, 0.0))[0]
    truth = {p.name: float(v) for p, v in zip(parameters, drawn, strict=True)}
    campaign = measured(tests, truth, seed=seed)
    readings = {run.id: np.stack(list(run.readings.values()), axis=1)[None] for run in campaign.runs}
    result = identify(campaign, fixed=dict.fromkeys(SLOPES, 0.0), noise="declared")
    b = angle(campaign.run(TWO_BALLS[0]), "B")
    matrix = curves(machine, [p.name for p in result.model.parameters], b)
    by_points = in_sequence(campaign, readings, smooth=False)[0]
    return OneTurned(b, matrix @ drawn, by_points, matrix @ result.values, _std(matrix, result.covariance), result)


def _std(matrix: Array, covariance: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("fni,ij,fnj->fn", matrix, covariance, matrix)))


@dataclass(frozen=True)
class Turned:
    """Many machines: errors of estimate of COMBINED at every b (6, N), of the sequence and the joint estimate (2, 6, N).

    `stated` 1σ of the joint estimate, `prior` what was known before, `two_balls` the joint 1σ without the third ball;
    With perfect set-ups and linear axes, in sequence: `exact_five`, `exact_six` largest error without noise at two and at
    three balls, µm at 100 mm; `perfect` bias and 1σ with noise (2, 6, N).
    """

    bias: Array
    spread: Array
    stated: Array
    two_balls: Array
    prior: Array
    exact_five: float
    exact_six: float
    perfect: Array
    count: int

    def largest_bias(self, bias: Array, spread: Array) -> float:
        """Largest |bias| in 1σ of the mean."""
        return float(np.max(np.abs(bias) / spread)) * float(np.sqrt(self.count))

    def rms(self, which: Array) -> Array:
        """Root mean square over b of a 1σ (..., N)."""
        return np.asarray(np.sqrt(np.mean(which**2, axis=-1)))

    @property
    def honest(self) -> float:
        """Largest of |actual / stated 1σ - 1| of the joint estimate, each function over all b."""
        return float(np.max(np.abs(self.rms(self.spread[1]) / self.rms(self.stated) - 1.0)))


def turned(*, count: int = 300, seed: int = 51) -> Turned:
    """Machines and set-ups drawn from their priors, the plant's readings with the paper's noise, both ways."""
    machine = machine_with_b()
    campaign = whole(machine)
    parameters = Model(campaign).parameters
    values = draw(parameters, count, seed, truth=dict.fromkeys(SLOPES, 0.0))
    readings = noisy(readings_of(campaign, {p.name: values[:, i] for i, p in enumerate(parameters)}, count), seed + 1)
    b = angle(campaign.run(TWO_BALLS[0]), "B")
    joint = Joint.of(campaign)
    matrix = curves(machine, joint.names, b)
    true = np.einsum("fnk,mk->mfn", curves(machine, [p.name for p in parameters], b), values)
    at_once = np.einsum("fnk,km->mfn", matrix, np.stack([*joint.estimate(readings).values()]))
    errors = np.stack([in_sequence(campaign, readings), at_once]) - true
    fewer = Joint.of(campaign.select(*(run.id for run in campaign.runs if run.id not in THIRD_BALL)))
    prior = np.array([p.sigma for p in parameters if p.name in set(fewer.names)])
    seen = curves(machine, fewer.names, b)
    return Turned(
        errors.mean(axis=1), errors.std(axis=1), _std(matrix, joint.covariance), _std(seen, fewer.covariance),
        _std(seen, np.diag(prior**2)), *_perfect(count, seed), count,
    )  # fmt: skip


def _perfect(count: int, seed: int) -> tuple[float, float, Array]:
    """Perfect set-ups and linear axes, location errors of B and C as they come: see `Turned`."""
    machine = machine_with_b(rotary=True)
    campaign = campaign_of(machine, tests_of_b(machine, perfect=True))
    parameters = tuple(p for p in Model(campaign).parameters if p.run is None)
    values = draw(parameters, count, seed, truth=ASSUMED)
    nominal = readings_of(campaign, {}, 1)
    exact = readings_of(campaign, {p.name: values[:, i] for i, p in enumerate(parameters)}, count)
    b = angle(campaign.runs[0], "B")
    true = np.einsum("fnk,mk->mfn", curves(machine, [p.name for p in parameters], b), values)
    worst = []
    for third in (False, True):
        found = left_over(b, pointwise(campaign, {r: y - nominal[r] for r, y in exact.items()}, third=third))
        size = SIZES[: found.shape[1], None]
        worst.append(float(np.abs((found - true[:, : found.shape[1]]) * size).max()))
    seen = {r: y - nominal[r] for r, y in noisy(exact, seed + 2).items()}
    errors = left_over(b, _smoothed(b, pointwise(campaign, seen))) - true
    return worst[0], worst[1], np.stack([errors.mean(axis=0), errors.std(axis=0)])


# --- claims --------------------------------------------------------------------------------------------------
def of_b_motions(found: Turned) -> list[Claim]:
    """P1-5: what the paper's way and the joint estimate make of the error motions of B, less {1, cos b, sin b}."""
    machines = f"in 1σ of a mean of {found.count} machines"
    return [
        Claim(
            "P1-5n", "B like C, two balls: largest error of EXB, EYB, EZB, EBB, EAB cos b - ECB sin b, no noise",
            "restored: 0", found.exact_five, 0.0, 0.03, "µm", "angles at 100 mm; EAB sin b + ECB cos b moves neither ball",
        ),
        Claim("P1-5o", "the same of all six, a third ball beside the axis", "-", found.exact_six, 0.0, 0.03, "µm"),
        Claim(
            "P1-5p", f"bias of the six in sequence, noise ±2 µm, {machines}", "-", found.largest_bias(*found.perfect), 0.0, 4.0,
            "", "the largest of all b; set-ups perfect",
        ),
        Claim(
            "P1-5q", "bias of the six by the joint estimate, in the same, set-ups off", "-",
            found.largest_bias(found.bias[1], found.spread[1]), 0.0, 4.0, "", "balls known to 10 µm, plates to 20 µrad",
        ),
        Claim("P1-5r", "1σ of the joint estimate over the one it states, less 1, worst of six", "-", found.honest, 0.0, 0.1),
    ]  # fmt: skip
