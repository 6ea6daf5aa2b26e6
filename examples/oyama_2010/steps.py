"""The steps of the paper, each one function: calibrate the R-test, map B, map C, look at gravity, compensate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from symfive.campaign import Campaign, SetupSigma, read_campaign
from symfive.design import Assessment, assess
from symfive.diagnose import Diagnosis, diagnose
from symfive.effects import make_effect
from symfive.identify import Identification, identify_by_position
from symfive.kinematics import ball_in_workpiece
from symfive.machine import ErrorTerm, Machine
from symfive.model import Model
from symfive.procedures import Nominal

from . import equations as paper
from .calibration import BallRunout, SensorCalibration, ball_runout, calibrate_sensors
from .machine import (
    B_DEG,
    C_DEG,
    Concealed,
    concealed,
    displacements,
    grid_of,
    nests_of_the_paper,
    paper_machine,
    record,
)

Array = NDArray[np.float64]
PLANS = Path(__file__).resolve().parents[2] / "designs" / "plans"
TO_FILE = np.array([1e3] * 3 + [1e6] * 3)
"""mm and rad to µm and µrad, for six errors."""
B_ANGLES, C_ANGLES = np.radians(B_DEG), np.radians(C_DEG)
ORIGIN = int(np.argmin(np.abs(B_DEG)))
SAG_UM = -6.0
DRIFT_UM, DRIFT_S = 8.0, 900.0
CONING_URAD = (6.0, -4.0)


# --- section 3.2: the R-test itself ------------------------------------------------------------------------
@dataclass(frozen=True)
class Calibration:
    """`sensors` as calibrated and their true `directions` (3, 3); `runout` as found with noise, `runout_clean` without, and
    the true `eccentricity` (2,) mm."""

    sensors: SensorCalibration
    directions: Array
    runout: BallRunout
    runout_clean: BallRunout
    eccentricity: Array

    @property
    def direction_error(self) -> float:
        """Largest error of a direction vector's component."""
        return float(np.abs(self.sensors.directions - self.directions).max())

    def runout_error_um(self, found: BallRunout) -> float:
        """Largest error of the eccentricity, µm."""
        return float(1e3 * np.abs(found.eccentricity - self.eccentricity).max())


def calibrated(*, noise_um: float = 0.1, seed: int = 2010) -> Calibration:
    """Three flat-ended sensors learn their directions from 27 moves of ±0.2 mm, then the ball's run-out from indexing.

    The sensors lean towards the ball as in the paper's figure and are mounted a degree off; the spindle is indexed by 45°.
    """
    generator = np.random.default_rng(seed)
    around = np.radians([90.0, 210.0, 330.0])
    directions = np.stack([np.cos(around), np.sin(around), np.full(3, np.tan(np.radians(35.0)))], axis=1)
    directions += np.radians(1.0) * generator.standard_normal((3, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    steps = 0.2 * np.array([-1.0, 0.0, 1.0])
    moves = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    noise = 1e-3 * noise_um
    signals = moves @ directions.T + [0.4, -0.2, 0.1] + noise * generator.standard_normal((len(moves), 3))
    sensors = calibrate_sensors(moves, signals)

    eccentricity = np.array([4e-3, -3e-3])
    angles = np.radians(np.arange(0.0, 360.0, 45.0))
    turned = paper.rotation_c(angles)[:, :2, :2] @ eccentricity - eccentricity
    seen = np.column_stack([turned, np.zeros(len(angles))]) @ directions.T
    noisy = seen + sensors.offsets + noise * generator.standard_normal(seen.shape)
    perfect = replace(sensors, directions=directions)
    clean = perfect.displacement(seen + sensors.offsets)
    return Calibration(
        sensors, directions, ball_runout(angles, sensors.displacement(noisy)), ball_runout(angles, clean), eccentricity
    )


# --- (8), (9) beside the exact chain -----------------------------------------------------------------------
def chain_jacobian(machine: Machine, b_deg: Array, c_deg: Array, nest: Sequence[float]) -> Array:
    """d(ball in the workpiece frame)/d(errors of B and C) (N, 3, 12) mm/mm and mm/rad from symfive's exact chain.

    `b_deg`, `c_deg` (N,) the *table's* angles, `nest` mm in the workpiece frame; the linear axes keep the ball in the nest.
    """
    tool_ball = np.array([0.0, 0.0, -160.0])
    position = {name: ca.SX.sym(name) for name in machine.axis_names}
    errors = ca.SX.sym("errors", 12)
    motion = {f"E{letter}{axis}": errors[6 * k + i] for k, axis in enumerate("BC") for i, letter in enumerate("XYZABC")}
    ball = ball_in_workpiece(machine, position, ca.DM(tool_ball), motion=motion)
    slopes = ca.Function("slopes", [ca.vertcat(*position.values()), errors], [ca.jacobian(ball, errors)])
    target = np.tile(np.asarray(nest, dtype=float), (len(b_deg), 1))
    commands = Nominal(machine).follow(target, tool_ball, {"B": -b_deg, "C": -c_deg}, "poses of the table")
    rows = np.stack([machine.axes[name].to_internal * commands[name] for name in position], axis=1)
    return np.stack([np.asarray(slopes(row, np.zeros(12))) for row in rows])


# --- (10)-(22): the map ------------------------------------------------------------------------------------
@dataclass(frozen=True)
class ErrorMap:
    """E(B_i) `of_b` (7, 6) and the errors of C `of_c` (7, 12, 6), mm and rad, in the paper's signs."""

    of_b: Array
    of_c: Array

    def predicted(self, b: Array, c: Array, nest: Sequence[float]) -> Array:
        """Displacements (N, 3) mm at any poses (rad) from the pose B = C = 0: cubic in B, periodic and cubic in C."""
        e_b = CubicSpline(B_ANGLES, self.of_b)(b)
        closed = np.concatenate([self.of_c, self.of_c[:, :1]], axis=1)
        on_nodes = CubicSpline(np.append(C_ANGLES, 2.0 * np.pi), closed, axis=1, bc_type="periodic")(
            np.mod(c, 2.0 * np.pi)
        )
        e_c = np.stack([CubicSpline(B_ANGLES, on_nodes[:, k])(angle) for k, angle in enumerate(b)])
        whole = np.einsum("nij,nj->ni", paper.b_jacobian(b, c, nest), e_b)
        whole += np.einsum("nij,nj->ni", paper.c_jacobian(c, nest), e_c)
        start = (
            paper.b_jacobian(0.0, 0.0, nest) @ self.of_b[ORIGIN] + paper.c_jacobian(0.0, nest) @ self.of_c[ORIGIN, 0]
        )
        return np.asarray(whole - start)


def map_of(campaign: Campaign, *, sign: float = 1.0) -> ErrorMap:
    """The paper's whole procedure: B from the first nest (10)-(15), C from both (16)-(22)."""
    nests = nests_of_the_paper([run.table_ball for run in campaign.runs])
    seen = displacements(campaign)
    of_b = paper.b_errors(B_ANGLES, C_ANGLES, seen[:1], nests[:1])
    own = [
        paper.own_influence_of_c(
            B_ANGLES[:, None], C_ANGLES, of_b[:, None], nest, paper.from_reference(one, of_b[ORIGIN], nest), sign=sign
        )
        for nest, one in zip(nests, seen, strict=True)
    ]
    return ErrorMap(of_b, paper.c_errors(C_ANGLES, nests, np.stack(own)))


def mapped_jointly(campaign: Campaign, *, order: int = 3) -> tuple[Identification, Array]:
    """The same readings in one estimate: six errors at each B_i and Fourier series of C (`order`), with symfive.

    Returns the identification and E(B_i) (7, 6) in µm and µrad, in the gauge of the paper: dz_BY(0) = gamma_BY(0) = 0.
    """
    machine = paper_machine()
    terms = [ErrorTerm(name=f"E{letter}0B", sigma=100.0) for letter in "XYZABC"]
    terms += [
        ErrorTerm(name=f"E{letter}C", sigma=20.0, basis=("fourier",), order=(order,), over=("C",)) for letter in "XYZAB"
    ]
    free = replace(machine, errors={term.name: term for term in terms})
    result = identify_by_position(campaign.with_machine(free), "B", sigma=100.0)
    # where the table stands at B_i, the command stands at -B_i
    found = np.zeros((len(B_DEG), 6))
    for k, letter in enumerate("XYZABC"):
        curve = result.error_motion(f"E{letter}B", points=len(B_DEG))
        found[:, k] = np.interp(-B_DEG, curve.at["B"], curve.value) + result[f"E{letter}0B"]
    return result, in_the_paper_gauge(found)


def in_the_paper_gauge(found: Array) -> Array:
    """E(B_i) (7, 6) with the invisible shift along and turn about the C axis chosen such that dz_BY(0) = gamma_BY(0) = 0."""
    fixed = found.copy()
    for first, third in ((0, 2), (3, 5)):
        size = found[ORIGIN, third]
        fixed[:, first] -= size * np.sin(B_ANGLES)
        fixed[:, third] -= size * np.cos(B_ANGLES)
    return fixed


# --- gravity -----------------------------------------------------------------------------------------------
def sagging(*, drift: bool) -> Concealed:
    """A table without any other error that sinks by 6 µm·(1 - cos B); with `drift` the spindle also grows by 8 µm."""
    effects: list[dict[str, object]] = [
        {"effect": "gravity_sag", "axis": "B", "component": "EZB", "form": "one_minus_cos", "amplitude": SAG_UM}
    ]
    if drift:
        growth = {"effect": "thermal_drift", "direction": [0.0, 0.0, 1.0], "amplitude": DRIFT_UM}
        effects.append({**growth, "time_constant_s": DRIFT_S})
    return Concealed(effects=effects)


def look_again(folder: Path, *, drift: bool) -> tuple[Campaign, Diagnosis]:
    """The grid there and back, on the sagging machine, with location errors as the only baseline; what symfive finds."""
    plan = grid_of(paper_machine(), returning=True)
    campaign = record(plan, sagging(drift=drift), folder)
    return campaign, diagnose(campaign)


def look_at_coning(folder: Path) -> Diagnosis:
    """The map's recordings on a machine whose C cones and does nothing else, B free at each of its seven angles as in (15).

    C tilts by `CONING_URAD`·sin 3C about the table's x and y; error motions of C are not in the baseline.
    """
    machine = paper_machine()
    knots = (tuple(B_DEG.tolist()),)
    free = [
        ErrorTerm(name=f"E{letter}B", sigma=50.0, basis=("bspline",), order=(1,), knots=knots) for letter in "XYZABC"
    ]
    about_x, about_y = CONING_URAD
    coning = {"A": partial(_third, about_x), "B": partial(_third, about_y)}
    campaign = record(grid_of(machine), replace(concealed(), c=coning), folder)
    baseline = replace(machine, errors={**machine.errors, **{term.name: term for term in free}})
    return diagnose(campaign.with_machine(baseline))


def _third(size: float, degrees: Array) -> Array:
    return np.asarray(size * np.sin(np.radians(3.0 * degrees)))


def third_harmonics(found: Diagnosis) -> dict[str, tuple[float, float]]:
    """Size and 1σ, µrad, of sin 3C in the error motions of C that a diagnosis names, counted as the table turns."""
    sizes = {}
    for finding in found.findings:
        size = finding.parameters.get("sin3")
        if size is not None and isinstance(size.value, float) and isinstance(size.std, float):
            sizes[str(finding.parameters["component"].value)] = (-size.value, size.std)
    return sizes


def absorbed() -> dict[str, float]:
    """Which share of the sag's readings (mean square) each baseline explains away; the rest is what can be seen.

    1 - H/GᵀG of the score test, G the sag's whitened tangent and H what of it is orthogonal to the baseline.
    """
    location, whole = paper_machine(), paper_machine(baseline="whole")
    one_way = B_DEG[B_DEG >= 0.0]
    cases = {
        "location errors, B from -90° to 90°": grid_of(location),
        "location errors, B from 0° to 90°": grid_of(location, b=one_way),
        "location errors, B from 0° to 90°, ball known to 20 µm": grid_of(location, b=one_way, setup=SetupSigma()),
        "location errors and error motions (order 4), B from -90° to 90°": grid_of(whole),
    }
    return {name: 1.0 - _visible(campaign) for name, campaign in cases.items()}


def _visible(campaign: Campaign) -> float:
    sag = make_effect("gravity_sag", "B", component="EZB", parts=("one_minus_cos",))
    model = Model(campaign, (sag,))
    rows = np.zeros((0, len(model.parameters)))
    for run in campaign.runs:
        line = model.linearise(run, model.start)
        whole = np.zeros((run.rows, line.jacobian.shape[1], len(model.parameters)))
        whole[:, :, line.columns] = line.jacobian / model.noise(run)[:, None]
        rows = np.concatenate([rows, whole.reshape(-1, len(model.parameters))])
    own = model.index[f"{sag.key}.one_minus_cos"]
    tangent = rows[:, own]
    others = [i for i, p in enumerate(model.parameters) if i != own and p.sigma > 0.0]
    baseline = rows[:, others]
    information = baseline.T @ baseline + np.diag(model.prior_sigma[others] ** -2.0)
    explained = tangent @ baseline @ np.linalg.solve(information, baseline.T @ tangent)
    return float(1.0 - explained / (tangent @ tangent))


# --- what another plan gains -------------------------------------------------------------------------------
@dataclass(frozen=True)
class Comparison:
    """Expected 1σ of the machine's errors with the paper's grid and with the optimised plan, same noise and set-ups."""

    grid: Assessment
    plan: Assessment
    grid_rows: int
    plan_rows: int
    grid_minutes: float
    plan_minutes: float

    @property
    def ratio(self) -> dict[str, float]:
        """1σ of the plan over 1σ of the grid by name."""
        shared = [p.name for p in self.grid.parameters if p.run is None]
        return {name: self.plan.sigma[name] / self.grid.sigma[name] for name in shared}

    @property
    def mean_ratio(self) -> float:
        """Geometric mean of `ratio`."""
        return float(np.exp(np.mean(np.log(list(self.ratio.values())))))


def compare_plans(noise_um: float = 0.3) -> Comparison:
    """The ready plans `r-test-grid` (the paper's) and `oyama-2010-r-test-48`, brought to the same noise."""
    found = []
    for name in ("r-test-grid", "oyama-2010-r-test-48"):
        campaign = read_campaign(PLANS / name)
        campaign = replace(campaign, runs=tuple(replace(run, noise_um=noise_um) for run in campaign.runs))
        found.append((assess(campaign), campaign.rows, sum(run.duration for run in campaign.runs) / 60.0))
    (grid, rows, minutes), (plan, fewer, shorter) = found
    return Comparison(grid, plan, rows, fewer, minutes, shorter)
