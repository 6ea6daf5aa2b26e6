"""The machine of the paper, its tests as campaigns, and readings of one or of a thousand machines by the plant's exact chain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import plant
from numpy.typing import NDArray

from symfive.campaign import Campaign, Run, SetupSigma
from symfive.kinematics import basis_of
from symfive.machine import Machine, machine_to_data, preset
from symfive.parameters import Parameter
from symfive.procedures import Nominal, campaign_of, checked, static_ball_bar

from .equations import LOCATION

Array = NDArray[np.float64]

ASSUMED = dict(zip(LOCATION, (20.0, -15.0, 100.0, -80.0, 10.0, -12.0, 60.0, 90.0), strict=True))
"""The paper's table 1 is lost; these µm and µrad stand for it."""
DZ_MM, RADIUS_MM, HEIGHTS_MM, BAR_MM = 150.0, 100.0, (60.0, 160.0), 100.0
HALF_WIDTH_UM = 2.0
"""The paper's noise: uniform, ±0.002 mm."""
NOISE_UM = HALF_WIDTH_UM / np.sqrt(3.0)
OFFSETS_MM = ((0.0, 0.0), (0.0, 100.0), (100.0, 0.0))
"""(v, w) of the three lines: the second one higher in w, or the roll is lost."""
REACH_MM = {"X": 200.0, "Y": 200.0, "Z": 150.0}
"""Half the length of a line along each axis."""
Z_TRAVEL_MM = (140.0, 490.0)
LOWEST_MM = 20.0
"""Height of the lowest plate over the workpiece frame's origin."""
BAR_SETUP = SetupSigma(table_ball=10.0, tool_ball=10.0, length=0.5)
PLATE_SETUP = SetupSigma(table_ball=1000.0, tool_ball=10.0, plate=20.0)
PERFECT = SetupSigma(table_ball=0.0, tool_ball=0.0, length=0.0)
PLANES = (("X", "Y"), ("Y", "Z"), ("Z", "X"))
TOOL_MM = (0.0, 0.0, -150.0)
ZERO_UM = 50.0
"""1σ of the unknown zeros that are drawn."""


def paper_machine(*, errors: str = "all") -> Machine:
    """The preset without error motions of B (see `b_motions`), whose test is not printed; `location`: of B and C only.

    Travels are not printed. Error motions are polynomials over the travel, so that of Z is what the tests use and no more.
    """
    machine = preset("wang-li-2016")
    if errors == "location":
        return replace(machine, errors={name: machine.errors[name] for name in LOCATION})
    axes = {**machine.axes, "Z": replace(machine.axes["Z"], travel=Z_TRAVEL_MM)}
    terms = {t.name: t for t in machine.errors.values() if t.is_location or t.axis != "B"}
    return replace(machine, axes=axes, errors=terms)


def bar_tests(
    machine: Machine, *, b_step: float = 1.0, c_step: float = 1.0, motions: bool = False, perfect: bool = False
) -> tuple[Run, ...]:
    """Section 4: B with the bar along Y, X and Z (11)-(13), C at two heights (14), (15); `motions`: also (16)-(18)."""
    b, c = np.arange(-90.0, 90.0 + 1e-9, b_step), np.arange(0.0, 360.0 - 1e-9, c_step)
    setup = PERFECT if perfect else BAR_SETUP
    runs = []

    def test(name: str, poses: Mapping[str, Array], direction: Array, ball: tuple[float, float, float]) -> None:
        [run] = static_ball_bar(
            machine, poses=poses, direction=direction.tolist(), table_balls=[ball], length=BAR_MM, tool_ball=TOOL_MM,
            noise_um=float(NOISE_UM), setup_sigma_um=setup,
        )  # fmt: skip
        runs.append(replace(run, id=name, file=f"{name}.csv"))

    for k, letter in ((1, "y"), (0, "x"), (2, "z")):
        test(f"b-{letter}", {"B": b}, np.eye(3)[k], (0.0, 0.0, DZ_MM))
    turned = -np.radians(c)
    inward = -np.stack([np.cos(turned), np.sin(turned), np.zeros_like(c)], axis=1)
    for name, height in zip(("low", "high"), HEIGHTS_MM, strict=True):
        test(f"c-{name}", {"C": c}, inward, (RADIUS_MM, 0.0, height))
    for name, height in zip(("low", "high"), HEIGHTS_MM, strict=True) if motions else ():
        for k, letter in enumerate("xyz"):
            test(f"c-{name}-{letter}", {"C": c}, np.eye(3)[k], (0.0, 0.0, height))
    return tuple(runs)


def grid_tests(machine: Machine, *, pitch: float = 5.0, plate: float = 20.0) -> tuple[Run, ...]:
    """Section 3: two axes driven on one plate for each squareness, and three lines along each linear axis.

    `plate` is the 1σ of each plate's orientation, µrad.
    """
    setup = replace(PLATE_SETUP, plate=plate)
    runs = [_corner(machine, first, second, pitch, setup) for first, second in PLANES]
    for axis in "XYZ":
        runs += _lines(machine, axis, pitch, setup)
    return tuple(runs)


def _lines(machine: Machine, axis: str, pitch: float, setup: SetupSigma) -> list[Run]:
    """(10): line 1 on the plates dv and dw, line 2 on dv, line 3 on dw, d the direction of the axis and v, w cyclic.

    The offsets must reach the carriage whose errors are sought. Under X the table's places do; X stands on Y, so moving X
    leaves Y's carriage where it is under the spindle, and an offset along x has to be one of the reading head on its holder;
    Z carries the head, and both offsets are.
    """
    d = "XYZ".index(axis)
    v, w = (d + 1) % 3, (d + 2) % 3
    unit = np.eye(3)
    held = {"X": [False, False, False], "Y": [True, False, False], "Z": [True, True, True]}[axis]
    way = _way(axis, pitch) + (REACH_MM["Z"] if axis == "Z" else 0.0)
    runs = []
    for number, (offset, seconds) in enumerate(zip(OFFSETS_MM, ((v, w), (v,), (w,)), strict=True), start=1):
        lever = offset[0] * unit[v] + offset[1] * unit[w]
        head = np.asarray(TOOL_MM) + np.where(held, lever, 0.0)
        place = np.array([0.0, 0.0, LOWEST_MM]) + lever
        commands = Nominal(machine).follow(place + way[:, None] * unit[d], head, {}, "line of the grid encoder")
        for second in seconds:
            name = f"{axis.lower()}-line{number}-{'xyz'[d]}{'xyz'[second]}"
            runs.append(_plate(machine, name, commands, place, head, unit[d], unit[second], setup))
    return runs


def _way(axis: str, pitch: float) -> Array:
    """Positions along a line about its middle (N,) mm."""
    return np.arange(-REACH_MM[axis], REACH_MM[axis] + 1e-9, pitch)


def _corner(machine: Machine, first: str, second: str, pitch: float, setup: SetupSigma) -> Run:
    """One plate set-up, `first` driven and then `second`: their squareness, whatever the plate's yaw."""
    i, j = "XYZ".index(first), "XYZ".index(second)
    unit = np.eye(3)
    middle = np.array([0.0, 0.0, LOWEST_MM + (REACH_MM["Z"] if "Z" in (first, second) else 0.0)])
    legs = [_way(axis, pitch)[:, None] * unit["XYZ".index(axis)] for axis in (first, second)]
    commands = Nominal(machine).follow(middle + np.concatenate(legs), TOOL_MM, {}, "corner of the grid encoder")
    name = f"square-{first}{second}".lower()
    return _plate(machine, name, commands, middle, np.asarray(TOOL_MM), unit[i], unit[j], setup)


def _plate(
    machine: Machine,
    name: str,
    commands: Mapping[str, Array],
    place: Array,
    head: Array,
    u: Array,
    v: Array,
    setup: SetupSigma,
) -> Run:
    """One plate set-up at rest at every position, 2 s each."""
    rows = len(next(iter(commands.values())))
    run = Run(
        id=name, instrument=("grid_encoder",), sampling="static", time=2.0 * np.arange(rows, dtype=float), commands=commands,
        table_ball=_vector3(place), tool_ball=_vector3(head), u=_vector3(u), v=_vector3(v), noise_um=float(NOISE_UM),
        setup_sigma_um=setup,
    )  # fmt: skip
    return checked(machine, run, place="the lines of the grid encoder")


def _vector3(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z


def whole_campaign(machine: Machine, *, pitch: float = 20.0, b_step: float = 10.0, c_step: float = 15.0) -> Campaign:
    """All tests of the paper, coarser than there so that a thousand machines fit into seconds."""
    bars = bar_tests(machine, b_step=b_step, c_step=c_step, motions=True)
    return campaign_of(machine, (*grid_tests(machine, pitch=pitch), *bars), "wang-li-2016")


def angle(run: Run, axis: str) -> Array:
    """By how much the table has turned (N,) rad: commands count the other way (ISO 841)."""
    return -np.radians(run.commands[axis])


# --- readings by the plant's chain ---------------------------------------------------------------------------
def draw(
    parameters: tuple[Parameter, ...], count: int, seed: int, *, truth: Mapping[str, float] | None = None
) -> Array:
    """Parameters of `count` machines (count, k) from their priors, µm and µrad; `truth` fixes some, zeros get 50 µm."""
    generator = np.random.default_rng(seed)
    sigma = np.array([min(p.sigma, ZERO_UM) if ".zero." in p.name else p.sigma for p in parameters])
    values = sigma * generator.standard_normal((count, len(parameters)))
    for i, p in enumerate(parameters):
        if truth is not None and p.name in truth:
            values[:, i] = truth[p.name]
    return values


def readings_of(campaign: Campaign, values: Mapping[str, Array], count: int) -> dict[str, Array]:
    """Exact readings without noise of `count` machines: run → (count, N, columns) µm.

    `values` parameter name → (count,) µm or µrad; what is missing is zero. The chain is the plant's and not symfive's.
    """
    data = machine_to_data(campaign.machine)
    chain = plant.parse_structure(data["structure"], data["axes"])
    units = {"mm": 1e-3, "rad": 1e-6}
    place = {
        term.name: units["rad" if term.angular else "mm"] * values.get(term.name, np.zeros(count))
        for term in campaign.machine.location_errors
    }
    found = {}
    for run in campaign.runs:
        command = {a.name: run.commands[a.name] * (np.pi / 180.0 if a.rotary else 1.0) for a in chain.axes}
        motion = _motions(campaign.machine, command, values, count)
        own = {
            name.removeprefix(f"setup.{run.id}."): v
            for name, v in values.items()
            if name.startswith(f"setup.{run.id}.")
        }
        tool = np.repeat(np.asarray(run.tool_ball) + 1e-3 * _vector(own, "tool_ball", count), run.rows, axis=0)
        ball = plant.ball_in_workpiece(
            chain, {name: np.tile(q, count) for name, q in command.items()}, tool,
            {name: np.repeat(v, run.rows) for name, v in place.items()}, motion,
        ).reshape(count, run.rows, 3)  # fmt: skip
        found[run.id] = 1e3 * _instrument(run, ball, own, count)
    return found


def _motions(
    machine: Machine, command: Mapping[str, Array], values: Mapping[str, Array], count: int
) -> dict[str, Array]:
    found: dict[str, Array] = {}
    rows = len(next(iter(command.values())))
    for term in machine.error_motions:
        basis = basis_of(term, machine)
        if not any(f"{term.name}.{n}" in values for n in basis.names):
            continue
        coefficients = np.stack([values.get(f"{term.name}.{n}", np.zeros(count)) for n in basis.names])
        size = (basis.matrix(*(command[axis] for axis in term.over)) @ coefficients).T.ravel()
        found.setdefault(term.axis, np.zeros((count * rows, 6)))
        found[term.axis][:, "XYZABC".index(term.component)] += size * (1e-6 if term.angular else 1e-3)
    return found


def _vector(own: Mapping[str, Array], name: str, count: int) -> Array:
    return np.stack([own.get(f"{name}.{c}", np.zeros(count)) for c in "xyz"], axis=1)


def _instrument(run: Run, ball: Array, own: Mapping[str, Array], count: int) -> Array:
    """Readings (count, N, columns) mm from the ball in the workpiece frame."""
    table = np.asarray(run.table_ball)
    if "ball_bar" in run.instrument:
        table_ball = table + 1e-3 * _vector(own, "table_ball", count)
        length = float(run.length or 0.0) + 1e-3 * own.get("length", np.zeros(count))
        return np.asarray((np.linalg.norm(ball - table_ball[:, None], axis=2) - length[:, None])[:, :, None])
    angles = 1e-6 * np.stack([own.get(f"plate.{c}", np.zeros(count)) for c in "abc"], axis=1)
    seen = ball - np.cross(angles[:, None], ball - table)
    columns = [seen @ np.asarray(vector) for vector in (run.u, run.v)]
    zeros = [1e-3 * own.get(f"zero.{name}", np.zeros(count)) for name in "uv"]
    return np.stack([column + zero[:, None] for column, zero in zip(columns, zeros, strict=True)], axis=2)


def measured(campaign: Campaign, values: Mapping[str, float], *, seed: int = 0, noise: bool = True) -> Campaign:
    """One machine's campaign with readings, uniform noise of ±2 µm in them."""
    exact = readings_of(campaign, {name: np.array([v]) for name, v in values.items()}, 1)
    generator = np.random.default_rng(seed)
    runs = []
    for run in campaign.runs:
        reading = exact[run.id][0]
        if noise:
            reading = reading + generator.uniform(-HALF_WIDTH_UM, HALF_WIDTH_UM, reading.shape)
        names = ("dL_um",) if "ball_bar" in run.instrument else ("du_um", "dv_um")
        runs.append(run.with_readings({name: reading[:, k] for k, name in enumerate(names)}))
    return replace(campaign, runs=tuple(runs))
