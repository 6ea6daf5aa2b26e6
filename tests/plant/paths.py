"""Commanded paths as runs: planar circles, synchronous rotary-linear circles, static R-test and ball-bar
grids.

Each function returns the dictionary of one ``[[run]]`` with ``t_s`` (N,) and ``command`` {axis: (N,) mm or
degree}.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .chain import Array, ball_in_workpiece, nominal_linear, parse_structure

Run = dict[str, Any]
PLANES = {"XY": (0, 1), "YZ": (1, 2), "ZX": (2, 0)}


def circle_angle(
    sweep: float, speed: float, dt: float, ramp_s: float = 0.3, dwell_s: float = 0.5
) -> tuple[Array, Array]:
    """Row times and angle 0…sweep (rad) at `speed` (rad/s) with linear speed ramps of `ramp_s` and a rest of
    `dwell_s` at the end.
    """
    end = abs(sweep) / speed + ramp_s
    t = np.arange(int(np.floor((end + dwell_s) / dt + 1e-9)) + 1) * dt
    rate = speed / ramp_s

    def ramped(u: Array) -> Array:
        u = np.maximum(u, 0.0)
        return np.where(u < ramp_s, rate * u**2 / 2.0, speed * (u - ramp_s / 2.0))

    return t, np.sign(sweep) * np.where(t > end / 2.0, abs(sweep) - ramped(end - t), ramped(t))


def _run(machine: Mapping[str, Any], run: Run, t: Array, rotary: Mapping[str, Array], target: Array) -> Run:
    chain = parse_structure(machine["structure"], machine["axes"])
    q = nominal_linear(chain, rotary, target, run["tool_ball"])
    command = {a.name: np.rad2deg(q[a.name]) if a.rotary else q[a.name] for a in chain.axes}
    return {**run, "t_s": t, "command": command}


def _head(
    name: str,
    instrument: str | list[str],
    sampling: str,
    table_ball: Sequence[float],
    tool_ball: Sequence[float],
    noise_um: float,
    sigma: float,
    length: float | None,
    start_s: float | None,
) -> Run:
    run: Run = {"id": name, "file": f"{name}.csv", "instrument": instrument, "sampling": sampling}
    if start_s is not None:
        run["start_s"] = float(start_s)
    run |= {"table_ball": [float(v) for v in table_ball], "tool_ball": [float(v) for v in tool_ball]}
    if length is not None:
        run["length"] = float(length)
    run["noise_um"] = noise_um
    run["setup_sigma_um"] = {"table_ball": sigma, "tool_ball": sigma} | ({} if length is None else {"length": 0.5})
    return run


def planar_circle(
    machine: Mapping[str, Any],
    name: str,
    *,
    plane: str = "XY",
    centre: Sequence[float] = (0.0, 0.0, 80.0),
    radius: float = 100.0,
    feed: float = 800.0,
    direction: int = 1,
    start_deg: float = -90.0,
    sweep_deg: float = 540.0,
    dt: float = 0.02,
    tool_ball: Sequence[float] = (0.0, 0.0, -130.0),
    instrument: str | list[str] = "ball_bar",
    noise_um: float = 0.3,
    sigma_um: float = 10.0,
    start_s: float | None = None,
) -> Run:
    """Circle about the table ball in a coordinate plane; `feed` mm/min, direction +1 counter-clockwise, -1
    clockwise.

    A clockwise circle is the mirror image, it starts at -`start_deg`.  A grid encoder gets its u, v from the
    plane.  Overshoot is `sweep_deg` - 360; a partial arc is a small sweep.
    """
    t, angle = circle_angle(np.deg2rad(sweep_deg), feed / 60.0 / radius, dt)
    phi = direction * (np.deg2rad(start_deg) + angle)
    target = np.tile(np.asarray(centre, float), (len(t), 1))
    i, j = PLANES[plane]
    target[:, i] += radius * np.cos(phi)
    target[:, j] += radius * np.sin(phi)
    grid = "grid_encoder" in instrument
    run = _head(name, instrument, "dynamic", centre, tool_ball, noise_um, sigma_um, None if grid else radius, start_s)
    if grid:
        run["u"], run["v"] = np.eye(3)[i].tolist(), np.eye(3)[j].tolist()
    return _run(machine, run, t, {}, target)


def synchronous_circle(
    machine: Mapping[str, Any],
    name: str,
    *,
    x_t: float,
    radius: float = 50.0,
    feed: float = 800.0,
    direction: int = 1,
    height: float = 60.0,
    rotary: str = "C",
    start_deg: float = -60.0,
    sweep_deg: float = 480.0,
    dt: float = 0.01,
    tool_ball: Sequence[float] = (0.0, 0.0, -130.0),
    instrument: str | list[str] = "ball_bar",
    noise_um: float = 0.3,
    sigma_um: float = 10.0,
    start_s: float | None = None,
) -> Run:
    """Circle of radius r about (X_T, 0) of the table driven by X and C together (Tsutsumi et al. 2007, eqs.
    2-4).

    Workpiece point P = (X_T + r cos phi, r sin phi); C = theta = atan2(P) unwrapped, X = |P|.  At X_T = r the
    continuous branch theta = phi/2, X = 2 r cos(phi/2) is kept (X passes through zero).  `rotary` must carry
    the
    workpiece about Z.
    """
    t, angle = circle_angle(np.deg2rad(sweep_deg), feed / 60.0 / radius, dt)
    phi = direction * (np.deg2rad(start_deg) + angle)
    p = np.stack([x_t + radius * np.cos(phi), radius * np.sin(phi), np.full(len(t), float(height))], axis=1)
    theta = phi / 2.0 if np.isclose(x_t, radius) else np.unwrap(np.arctan2(p[:, 1], p[:, 0]))
    run = _head(name, instrument, "dynamic", (x_t, 0.0, height), tool_ball, noise_um, sigma_um, radius, start_s)
    return _run(machine, run, t, {rotary: theta}, p)


def grid_poses(outer: Sequence[float], inner: Sequence[float], both_ways: bool = True) -> Array:
    """Poses (M, 2) degree of two rotary axes: `inner` to and fro within `outer`, then, `both_ways`, all
    backwards.
    """
    inner = list(inner)
    poses = np.array([(a, b) for i, a in enumerate(outer) for b in (inner[::-1] if i % 2 else inner)], float)
    return np.concatenate([poses, poses[::-1]]) if both_ways else poses


def random_poses(outer: Sequence[float], inner: Sequence[float], count: int, seed: int = 0) -> Array:
    """Random poses (count, 2) degree, each coordinate drawn from its list: a held-out run unlike the grid."""
    rng = np.random.default_rng(seed)
    return np.stack([rng.choice(list(outer), count), rng.choice(list(inner), count)], axis=1).astype(float)


def r_test(
    machine: Mapping[str, Any],
    name: str,
    *,
    nest: Sequence[float],
    poses: Array,
    axes: tuple[str, str] = ("B", "C"),
    tool_ball: Sequence[float] = (0.0, 0.0, -150.0),
    seconds_per_pose: float = 6.0,
    start_s: float = 0.0,
    noise_um: float = 0.4,
    sigma_um: float = 20.0,
) -> Run:
    """Static R-test: at each of `poses` (M, 2) degree of `axes` the nominal ball stands in the nest
    (workpiece frame, mm).
    """
    poses = np.asarray(poses, float)
    run = _head(name, "r_test", "static", nest, tool_ball, noise_um, sigma_um, None, start_s)
    rotary = {axis: np.deg2rad(poses[:, i]) for i, axis in enumerate(axes)}
    return _run(
        machine,
        run,
        np.arange(len(poses)) * seconds_per_pose,
        rotary,
        np.tile(np.asarray(nest, float), (len(poses), 1)),
    )


def static_ball_bar(
    machine: Mapping[str, Any],
    name: str,
    *,
    table_ball: Sequence[float],
    poses: Array,
    length: float = 100.0,
    direction: Sequence[float] = (1.0, 0.0, 0.0),
    axes: tuple[str, str] = ("B", "C"),
    tool_ball: Sequence[float] = (0.0, 0.0, -150.0),
    seconds_per_pose: float = 6.0,
    start_s: float = 0.0,
    noise_um: float = 0.4,
    sigma_um: float = 20.0,
) -> Run:
    """Static ball bar: the nominal tool ball stands `length` from the table ball along `direction` of the
    machine frame at each pose.
    """
    poses = np.asarray(poses, float)
    chain = parse_structure(machine["structure"], machine["axes"])
    rotary = {axis: np.deg2rad(poses[:, i]) for i, axis in enumerate(axes)}
    base = {a.name: rotary.get(a.name, np.zeros(len(poses))) for a in chain.axes}
    unit = np.asarray(direction, float) / np.linalg.norm(direction)
    bar = ball_in_workpiece(chain, base, tool_ball, tool_shift=unit) - ball_in_workpiece(chain, base, tool_ball)
    run = _head(name, "ball_bar", "static", table_ball, tool_ball, noise_um, sigma_um, length, start_s)
    return _run(
        machine,
        run,
        np.arange(len(poses)) * seconds_per_pose,
        rotary,
        np.asarray(table_ball, float) + length * bar,
    )
