"""The information of a recorded path and its exact derivatives in what shapes the path.

With rows h apart at the recorder's rate f, M = Σ w f h JᵀJ/σ² (w = 1) is the information of any N rows of it. J depends
on the path through the motion behind the drives, their sensitivities to the gains, the state of a play, the place of the ball
and the bar's length; all of these are differentiated (`motion._moved_path`, CasADi's forward mode of the row), none by
differences. Where a direction or a flank of a play changes between two rows, the instant of the change moves with the path,
and the weights w of these two rows with it; otherwise the derivative would miss that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from symfive.arrays import Array, Indices
from symfive.campaign import Run
from symfive.compiled import Mapped
from symfive.design._paths import CirclePath
from symfive.errors import InputError
from symfive.instruments import instruments_of
from symfive.model import Model, RowFunction, assemble
from symfive.motion import GAINS, LOOP, Acceleration, Command, Direction, Play, Position, Velocity, moved_response
from symfive.optimal import inverse

STILL = 1e-12


@dataclass
class _Moved:
    """A quantity along the rows: `value` (N,), derivatives in the path `moved` (N, nv), tangents by parameter (N,) and
    theirs in the path (N, nv)."""

    value: Array
    moved: Array
    tangents: dict[str, Array]
    tangents_moved: dict[str, Array]


@dataclass(frozen=True)
class _Event:
    """A change between rows `row` and `row` + 1, at the share `at` of the way, with derivative `moved` (nv,)."""

    row: int
    at: float
    moved: Array


class MovedRun:
    """A run of a model on a path that can be changed.

    `vector` parameter values at which the readings are linearised (file units); `shared` indices of the parameters of the
    whole campaign, in whose order the information comes. Raises `InputError` for effects whose derivative is not written.
    """

    def __init__(self, model: Model, run: Run, path: CirclePath, vector: Array, rate_hz: float) -> None:
        self.model, self.run, self.path, self.rate = model, run, path, rate_hz
        self.machine, self.rows = model.machine, run.rows
        effects = tuple(effect for effect in model.effects if effect.applies(run))
        self.freed = {place: name for effect in effects for place, name in effect.frees().items()}
        self.function: RowFunction = assemble(self.machine, run, effects, model.parameters, model.linear)
        _check(self.function, self.freed, [effect.id for effect in effects if effect.stage == "recording"])
        names = [*self.function.shared, *self.function.own]
        self.index = np.array([model.index[run.full_name(name)] for name in names], dtype=np.int64)
        self.place = {name: i for i, name in enumerate(names)}
        self.values = {p.name: float(v) * p.scale for p, v in zip(model.parameters, vector, strict=True)}
        self.scale = {name: model.parameters[i].scale for name, i in zip(names, self.index, strict=True)}
        count = len(self.function.shared)
        self.parameters = [vector[self.index[:count]], vector[self.index[count:]]]
        self.inside = np.arange(len(names)) < count
        self.noise = model.noise(run)
        self.derived = Mapped(_along(self.function))
        self.sloped = Mapped(self.function.slopes)

    def information(self, values: Array) -> tuple[Array, Array]:
        """About the shared parameters, the run's own set-up errors marginalised: (k, k) and derivatives (nv, k, k)."""
        J, moved, weight, weight_moved = self.sensitivities(values)
        k = J.shape[2]
        flat = J.reshape(-1, k)
        each = np.repeat(weight, J.shape[1])
        gram = flat.T @ (flat * each[:, None])
        inside = self.inside
        rest = gram[np.ix_(~inside, ~inside)] + np.diag(self.model.prior_sigma[self.index[~inside]] ** -2.0)
        carry = np.eye(k)[:, inside]  # (I, -rest⁻¹ cross): the marginal's derivative is this around the whole's
        carry[~inside] = -inverse(rest) @ gram[np.ix_(~inside, inside)] if rest.size else 0.0
        information = gram[np.ix_(inside, inside)] + gram[np.ix_(inside, ~inside)] @ carry[~inside]
        seen = flat @ carry
        changes = []
        for j in range(moved.shape[3]):
            by = moved[:, :, :, j].reshape(-1, k) @ carry
            mixed = (seen * each[:, None]).T @ by
            changes.append(mixed + mixed.T + seen.T @ (seen * np.repeat(weight_moved[:, j], J.shape[1])[:, None]))
        return information, np.stack(changes)

    def sensitivities(self, values: Array) -> tuple[Array, Array, Array, Array]:
        """J (N, ny, k) per noise and its derivatives (N, ny, k, nv); weights of the rows (N,) and theirs (N, nv)."""
        n = self.rows
        commands, moved = self.path.at(values, n)
        setting, setting_moved = self.path.setup(values)
        dt, dt_moved = setting[4] / (n - 1.0), setting_moved[4] / (n - 1.0)
        motion = _Motion(self, commands, moved, dt, dt_moved)
        series = [motion.series(signal) for signal in self.function.inputs]
        time, zero = dt * np.arange(n), np.outer(np.arange(n), dt_moved)
        inputs = np.stack([self.run.start_s + time, time, *(s.value for s in series)], axis=1)
        inputs_moved = np.stack([zero, zero, *(s.moved for s in series)], axis=1)
        constants, constants_moved = self._constants(setting, setting_moved)
        fixed = [np.broadcast_to(a, (n, len(a))) for a in (*self.parameters, constants)]
        J, by_input = self._slopes(self.sloped(inputs, *fixed)[1:])
        changes = []
        for j in range(moved.shape[2]):
            directions = [inputs_moved[:, :, j], np.broadcast_to(constants_moved[:, j], (n, len(constants)))]
            change, by_input_moved = self._slopes(self.derived(inputs, *fixed, *directions))
            self._chain(change, by_input_moved, [s.tangents for s in series])
            self._chain(change, by_input, [{k: t[:, j] for k, t in s.tangents_moved.items()} for s in series])
            changes.append(change)
        self._chain(J, by_input, [s.tangents for s in series])
        weight, weight_moved = _weights(n, motion.events, self.rate * dt, self.rate * dt_moved)
        noise = self.noise[:, None]
        return J / noise, np.stack(changes, axis=3) / noise[:, :, None], weight, weight_moved

    def _slopes(self, parts: list[Array]) -> tuple[Array, Array]:
        """(N, ny, k) in the parameters and (N, ny, moving) in the inputs, from column-major blocks."""
        ny = len(self.function.columns)
        shaped = [part.reshape(len(part), part.shape[1] // ny, ny).transpose(0, 2, 1) for part in parts]
        return np.concatenate(shaped[:2], axis=2), shaped[2]

    def _chain(self, J: Array, by_input: Array, tangents: list[dict[str, Array]]) -> None:
        """Add what parameters do through the inputs that they move."""
        for i, entry in enumerate(self.function.moving):
            for name, slope in tangents[entry - 2].items():
                J[:, :, self.place[name]] += by_input[:, :, i] * (self.scale[name] * slope)[:, None]

    def _constants(self, setting: Array, moved: Array) -> tuple[Array, Array]:
        numbers: dict[str, float] = {}
        for instrument in instruments_of(self.run):
            numbers |= instrument.constants(self.run, self.machine)
        on_path = {**{f"table_ball.{c}": i for i, c in enumerate("xyz")}, "length": 3}
        constants = np.array([numbers[name] for name in self.function.constants])
        changes = np.zeros((len(constants), moved.shape[1]))
        for i, name in enumerate(self.function.constants):
            if name in on_path:
                constants[i], changes[i] = setting[on_path[name]], moved[on_path[name]]
        return constants, changes


class _Motion:
    """Axes and signals along the path, with derivatives, and the instants at which one changes its side."""

    def __init__(self, owner: MovedRun, commands: Array, moved: Array, dt: float, dt_moved: Array) -> None:
        self.owner, self.commands, self.moved, self.dt, self.dt_moved = owner, commands, moved, dt, dt_moved
        self.events: list[_Event] = []
        self._axes: dict[str, list[_Moved]] = {}

    def series(self, signal: Any) -> _Moved:
        order = {Position: 0, Velocity: 1, Acceleration: 2}
        if type(signal) in order:
            return self.axis(signal.axis)[order[type(signal)]]
        if isinstance(signal, Command):
            i = self.owner.machine.axis_names.index(signal.axis)
            return _Moved(self.commands[:, i], self.moved[:, i], {}, {})
        position = self.axis(signal.axis)[0]
        return self._direction(position) if isinstance(signal, Direction) else self._play(signal, position)

    def axis(self, name: str) -> list[_Moved]:
        """Position, velocity and acceleration."""
        if name not in self._axes:
            i = self.owner.machine.axis_names.index(name)
            self._axes[name] = self._move(name, self.commands[:, i], self.moved[:, i])
        return self._axes[name]

    def _move(self, name: str, command: Array, moved: Array) -> list[_Moved]:
        drive = self.owner.machine.axes[name].drive
        still = np.ptp(command) <= STILL
        if drive is None or still:
            found = [_Moved(command, moved, {}, {})]
            for _ in range(2):
                value = np.zeros_like(command) if still else np.gradient(found[-1].value, self.dt)
                change = np.zeros_like(moved) if still else np.gradient(found[-1].moved, self.dt, axis=0)
                found.append(_Moved(value, change - np.outer(value, self.dt_moved / self.dt), {}, {}))
            return found
        gains = {quantity: float(getattr(drive, quantity)) for quantity in LOOP}
        wanted = {q: self.owner.freed[name, q] for q in GAINS if (name, q) in self.owner.freed}
        gains |= {quantity: self.owner.values[parameter] for quantity, parameter in wanted.items()}
        motion, changes = moved_response(command, moved, self.dt, self.dt_moved, gains, tuple(wanted))
        return [
            _Moved(
                motion[:, k, 0], changes[:, k, 0],
                {p: motion[:, k, 1 + i] for i, p in enumerate(wanted.values())},
                {p: changes[:, k, 1 + i] for i, p in enumerate(wanted.values())},
            )
            for k in range(3)
        ]  # fmt: skip

    def _direction(self, position: _Moved) -> _Moved:
        """-1 or +1, and when it changes: the velocity between rows is zero there."""
        step, moved = np.diff(position.value), np.diff(position.moved, axis=0)
        signs = _held(
            np.where(np.abs(step) > STILL * max(1.0, float(np.abs(position.value).max())), np.sign(step), 0.0)
        )
        for row in np.flatnonzero(signs[1:] * signs[:-1] < 0.0) + 1:
            a, b = step[row - 1], step[row]
            if a != b:
                change = (a * moved[row] - b * moved[row - 1]) / (a - b) ** 2
                self.events.append(_Event(int(row), float(a / (a - b)) - 0.5, change))
        nothing = np.zeros_like(position.moved)
        return _Moved(np.concatenate([signs[:1], signs]), nothing, {}, {})

    def _play(self, signal: Play, position: _Moved) -> _Moved:
        """State of a play of constant width: ±1 at a flank c, after it s_c + (q - q_c)/half until the other one."""
        width = self.owner.values[signal.width]
        half = max(0.5 * abs(width), 1e-15)
        q = position.value
        state, contact, side = np.empty(len(q)), np.empty(len(q), dtype=np.int64), np.empty(len(q))
        last, touched = 0, 0.0
        for k, value in enumerate(q.tolist()):
            free = touched + (value - q[last]) / half
            state[k], contact[k], side[k] = min(max(free, -1.0), 1.0), last, touched
            if abs(free) >= 1.0 - 1e-9:
                last, touched = k, float(np.sign(free))
                state[k] = touched
        crossing = (np.abs(state) < 1.0)[:, None]
        self._arrivals(state, contact, side, position, half)
        held, moved = contact[crossing[:, 0]], np.zeros_like(position.moved)
        inside = crossing[:, 0]
        moved[inside] = (position.moved[inside] - position.moved[held]) / half
        tangents, tangents_moved = {}, {}
        for name in (*position.tangents, signal.width):
            value, change = np.zeros(len(q)), np.zeros_like(moved)
            if name in position.tangents:
                slope, slope_moved = position.tangents[name], position.tangents_moved[name]
                value[inside] = (slope[inside] - slope[held]) / half
                change[inside] = (slope_moved[inside] - slope_moved[held]) / half
            if name == signal.width:
                wider = 0.5 * np.sign(width) / half
                value[inside] -= wider * (q[inside] - q[held]) / half
                change[inside] -= wider * moved[inside]
            tangents[name], tangents_moved[name] = value, change
        if signal.start in self.owner.place:  # until the first flank the output stands where it began
            tangents[signal.start] = np.where(inside & (side == 0.0), 1.0, 0.0)
            tangents_moved[signal.start] = np.zeros_like(moved)
        return _Moved(state, moved, tangents, tangents_moved)

    def _arrivals(self, state: Array, contact: Indices, side: Array, position: _Moved, half: float) -> None:
        """Where the play has been crossed: the readings' slopes change sides there."""
        q, moved = position.value, position.moved
        for row in np.flatnonzero((np.abs(state[1:]) == 1.0) & (side[1:] != state[1:])):
            start, flank = contact[row + 1], state[row + 1]
            wanted = q[start] + half * (flank - side[row + 1])
            way = q[row + 1] - q[row]
            change = (moved[start] - moved[row]) / way - (wanted - q[row]) * (moved[row + 1] - moved[row]) / way**2
            self.events.append(_Event(int(row), float((wanted - q[row]) / way), change))


def _held(signs: Array) -> Array:
    """Signs with each zero replaced by the last sign before it (the first one before any)."""
    moved = np.flatnonzero(signs)
    if not moved.size:
        return signs
    last = np.maximum.accumulate(np.where(signs != 0.0, np.arange(len(signs)), -1))
    return np.asarray(signs[np.where(last < 0, moved[0], last)])


def _weights(rows: int, events: list[_Event], weight: float, moved: Array) -> tuple[Array, Array]:
    """Weights of the rows (N,) and their derivatives (N, nv): an event at the share a of the way to the next row moves
    a - ½ from that row to the one before."""
    shares, shares_moved = np.ones(rows), np.zeros((rows, len(moved)))
    for event in events:
        for row, sign in ((event.row, 1.0), (event.row + 1, -1.0)):
            shares[row] += sign * (event.at - 0.5)
            shares_moved[row] += sign * event.moved
    return weight * shares, weight * shares_moved + np.outer(shares, moved)


def _along(function: RowFunction) -> Any:
    """(inputs, shared, own, constants, their directions) → what the slopes change by along them."""
    slopes = function.slopes
    symbols = [ca.SX.sym(slopes.name_in(i), slopes.sparsity_in(i)) for i in range(4)]
    directions = [ca.SX.sym(f"d{slopes.name_in(i)}", slopes.sparsity_in(i)) for i in (0, 3)]
    moved, fixed = ca.vertcat(symbols[0], symbols[3]), slopes.call(symbols)[1:]
    changes = [ca.jtimes(ca.vec(part), moved, ca.vertcat(*directions)) for part in fixed]
    return ca.Function("along", [*symbols, *directions], [ca.densify(part) for part in changes], {"cse": True})


def _check(function: RowFunction, freed: dict[tuple[str, str], str], recording: list[str]) -> None:
    known = (Position, Velocity, Acceleration, Command, Direction, Play)
    names = [type(s).__name__ for s in function.inputs if not isinstance(s, known) or (isinstance(s, Play) and s.slope)]
    names += [quantity for _, quantity in freed if quantity not in LOOP] + recording
    if names:
        raise InputError(
            f"circles with {', '.join(dict.fromkeys(names))} are not refined", remedy="choose among the circles given"
        )
