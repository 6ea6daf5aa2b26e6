"""Physics of the second frozen stratum of the blind study (docs/blind-study.md), drawn after the first had been looked at.

Each function is one form, with the mechanism in its docstring. Frozen before anything was run on it: the digest of this file
is pinned by a test.
"""

from __future__ import annotations

import zlib

import numpy as np

from .behind import hysteresis, play
from .chain import Array, rot
from .instrument import low_pass
from .state import UM, RunState, Spec


def _unit_speed(state: RunState, name: str) -> Array:
    """Speed in mm/s or degree/s, (N,)."""
    return np.rad2deg(state.v[name]) if state.axis(name).rotary else state.v[name]


def _travelled(q: Array) -> Array:
    """Path since the beginning of the run whatever the direction, (N,), in the unit of `q`."""
    return np.cumsum(np.abs(np.diff(q, prepend=q[:1])))


def _down(state: RunState) -> Array:
    """Direction of gravity in the workpiece frame, (N, 3)."""
    down = np.tile([0.0, 0.0, -1.0], (len(state.t), 1))
    for axis in state.chain.workpiece:
        if axis.rotary:
            down = np.einsum("nji,nj->ni", rot(axis.direction, axis.side * state.x[axis.name]), down)
    return down


def _lagged(state: RunState, value: Array, time_constant_s: float) -> Array:
    """`value` behind a first-order lag at rest on its first row, (N,)."""
    return low_pass(value[:, None], state.dt, 1.0 / (2.0 * np.pi * time_constant_s))[:, 0]


def clamp_scatter(state: RunState, spec: Spec) -> None:
    """A brake closes after every move of an axis and pushes it by a chance `scatter` (1 sigma), the same until the next move."""
    name = spec["axis"]
    closed = np.cumsum(np.abs(np.diff(state.x[name], prepend=state.x[name][:1])) > 1e-9)
    chance = np.random.default_rng([int(spec["seed"]), zlib.crc32(state.run_id.encode())])
    pushed = chance.normal(0.0, float(spec["scatter"]), int(closed[-1]) + 1)[closed]
    state.x[name] = state.x[name] + state.small(name) * pushed


def drag_chain(state: RunState, spec: Spec) -> None:
    """Rubbing links of a drag chain remember where the axis has been: a sum of springs that slip after `widths` (mm or degree),
    a Prandtl-Ishlinskii hysteresis, pushes by `amplitude` at most along `direction`."""
    q, widths = state.coordinate(spec["axis"]), [float(width) for width in spec["widths"]]
    pull = sum((q - play(q, width, q[0])) / (0.5 * width) for width in widths)
    state.shift_tool(spec["direction"], float(spec["amplitude"]) * np.asarray(pull) / len(widths))


def soft_probe(state: RunState, spec: Spec) -> None:
    """One of three probes is soft and sags under its own weight: its reading += amplitude.(gravity along it)."""
    sag = np.zeros((len(state.t), 3))
    sag[:, int(spec["probe"])] = float(spec["amplitude"]) * _down(state)[:, int(spec["probe"])]
    state.sensor.append({"form": "offset", "offset": sag})


def rail_joint(state: RunState, spec: Spec) -> None:
    """A carriage climbs the joint of two rails at `at`, settles over the path `settling` (mm), and drops on its way back:
    `component` += s.amplitude.exp(-(path since the joint)/settling), s the direction in which it was passed."""
    q = state.coordinate(spec["component"][2:])
    beyond, path = q > float(spec["at"]), _travelled(q)
    passed = np.zeros(len(q), int)
    rows = np.flatnonzero(beyond[1:] != beyond[:-1]) + 1
    passed[rows] = rows
    passed = np.maximum.accumulate(passed)
    kick = np.where(beyond, 1.0, -1.0) * np.exp(-(path - path[passed]) / float(spec["settling"]))
    state.add_motion(spec["component"], float(spec["amplitude"]) * np.where(passed > 0, kick, 0.0))


def coarse_counts(state: RunState, spec: Spec) -> None:
    """An axis stops on the nearest count of a coarse encoder: q goes to a multiple of `step` (um or urad) past `zero` steps."""
    name = spec["axis"]
    step, zero = float(spec["step"]) * state.small(name), float(spec["zero"])
    state.x[name] = (np.round(state.x[name] / step - zero) + zero) * step


def valve_lag(state: RunState, spec: Spec) -> None:
    """A hydraulic drive lags by the root of its speed (turbulent flow through a valve): q -= s.amplitude.sqrt(|v|/10)."""
    name = spec["axis"]
    speed = _unit_speed(state, name) / 10.0
    lag = float(spec["amplitude"]) * np.sign(speed) * np.sqrt(np.abs(speed))
    state.x[name] = state.x[name] - state.small(name) * lag


def walking_coupling(state: RunState, spec: Spec) -> None:
    """A coupling slips a little whichever way it turns: q += amplitude um or urad per 100 mm or degree of path in the run."""
    name = spec["axis"]
    walked = _travelled(state.coordinate(name)) / 100.0
    state.x[name] = state.x[name] + float(spec["amplitude"]) * state.small(name) * walked


def motor_heat(state: RunState, spec: Spec) -> None:
    """A motor's loss warms its carriage, cold at the start of each run: amplitude.w along `direction`, w the square of the speed
    in 10 mm/s or degree/s behind a lag of `time_constant_s`."""
    loss = (_unit_speed(state, spec["axis"]) / 10.0) ** 2
    state.shift_tool(spec["direction"], float(spec["amplitude"]) * _lagged(state, loss, float(spec["time_constant_s"])))


def loose_seat(state: RunState, spec: Spec) -> None:
    """A badly clamped artefact rocks to the other of two seats, `amplitude` um either way along `direction` in the workpiece
    frame, when the table tilts beyond `limit` degree to that side, and stays there until it tilts beyond the other."""
    tilt = state.coordinate(spec["axis"])
    steep = np.abs(tilt) > float(spec["limit"])
    last = np.maximum.accumulate(np.where(steep, np.arange(len(tilt)), -1))
    seat = np.where(last >= 0, np.sign(tilt[last]), -1.0)
    way = np.asarray(spec["direction"], float)
    state.table_ball = state.table_ball + UM * float(spec["amplitude"]) * seat[:, None] * way / np.linalg.norm(way)


def soft_ground(state: RunState, spec: Spec) -> None:
    """Soft ground yields late under a moving mass: `component` (a tilt) follows amplitude urad per 100 mm of its axis behind a
    lag of `time_constant_s`."""
    late = _lagged(state, state.x[spec["component"][2:]] / 100.0, float(spec["time_constant_s"]))
    state.add_motion(spec["component"], float(spec["amplitude"]) * late)


def cubic_sensor(state: RunState, spec: Spec) -> None:
    """A bar's transducer is not linear at the ends of its range: reading + curvature (1/um^2).reading^3."""
    state.sensor.append({"form": "cubic", "curvature": float(spec["curvature"])})


def one_flank(state: RunState, spec: Spec) -> None:
    """Teeth are worn on one flank: q += amplitude.sin(2.pi.q/period + phase) while the flank on the side `flank` (-1, +1) drives,
    and nothing while the other does."""
    name = spec["axis"]
    drives = 0.5 * (1.0 + float(spec["flank"]) * hysteresis(state, name, {"form": "hard", "width": 2.0}))
    wave = np.sin(2.0 * np.pi * state.coordinate(name) / float(spec["period"]) + float(spec["phase"]))
    state.x[name] = state.x[name] + float(spec["amplitude"]) * state.small(name) * drives * wave


def cage_order(state: RunState, spec: Spec) -> None:
    """Unequal rollers go round with their cage: the table's axis is off by `amplitude` in a direction that turns `order` times
    (no whole number) a turn of the table, and at every reversal the cage slips by `slip` rad."""
    name = spec["axis"]
    reversals = np.cumsum(np.diff(state.approach(name), prepend=state.approach(name)[:1]) != 0.0)
    angle = float(spec["order"]) * state.x[name] + float(spec["phase"]) + float(spec["slip"]) * reversals
    state.add_motion(f"EX{name}", float(spec["amplitude"]) * np.cos(angle))
    state.add_motion(f"EY{name}", float(spec["amplitude"]) * np.sin(angle))


def oil_shot(state: RunState, spec: Spec) -> None:
    """Lubrication by travelled path: a shot after `first` and then every `every` mm or degree of path of the `axis` lifts the
    carriage along `direction` by `amplitude`.exp(-(path since the shot)/squeezed)."""
    path = _travelled(state.coordinate(spec["axis"])) - float(spec["first"])
    film = np.exp(-np.mod(path, float(spec["every"])) / float(spec["squeezed"]))
    state.shift_tool(spec["direction"], float(spec["amplitude"]) * np.where(path >= 0.0, film, 0.0))


def clock_rate(state: RunState, spec: Spec) -> None:
    """The recorder's clock goes wrong by `rate` (1e-3): it reads what was rate.t ago, t from the start of the run."""
    state.delay_s = state.delay_s + 1e-3 * float(spec["rate"]) * state.t
