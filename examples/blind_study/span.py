"""What geometry and set-up can absorb, by finite differences of the plant: masked share, SNR of the rest, aliases.

Readings are whitened with the noise that the plant will really add (white plus AR(1): an ARMA(1,1)), the geometry's and
the set-ups' columns are weighed by their priors as any fit would, and what such a fit leaves of an effect is its
orthogonal part.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import plant
from numpy.typing import NDArray
from plant import effects as catalogue
from plant import instrument as instruments
from plant.reader import NO_SETUP
from plant.simulate import ZERO_SIGMA_UM, prepare
from plant.state import UM, URAD, RunState
from plant.structure import error_motion_value
from scipy.signal import lfilter

from .effects import Spec, name_of
from .plans import Setting

Array = NDArray[np.float64]
Name = tuple[str, str | None]
SAME = 1.0
"""An explanation that leaves less than this SNR of an effect cannot be distinguished from it."""
APART = 3.0
"""One that leaves more than this can be."""
FREE = 1e4
"""1σ of what is a convention, µm and µrad."""
PLACES, TOOL_MM = 300, (0.0, 100.0)
"""Places all over the travel at which a ball is measured with tools so much longer than the case's."""
FAR = 100.0
"""A name that needs so many times as much motion of the ball is no explanation."""
UNSEEN = 1e-2
"""A family of which 1 µm, µrad or ppm changes less than this, in σ over all readings, explains nothing (it would need
a ten-thousand times as much): what is left of it is the plant's second order."""


def readings(state: RunState, run: Mapping[str, Any]) -> Array:
    """Readings of a prepared state, (N, k) um."""
    y = instruments.true_reading(state, _instrument(run), run)
    return instruments.measured(state, y, np.zeros(y.shape[1]))


def _instrument(run: Mapping[str, Any]) -> str:
    return run["instrument"] if isinstance(run["instrument"], str) else run["instrument"][0]


def whiten(y: Array, t: Array, white: float, noise: plant.NoiseOptions) -> Array:
    """`y` (N, ...) through the filter that makes the plant's noise white with variance 1 (rows at a constant rate)."""
    if noise.coloured_um == 0.0:
        return y / white
    keep = np.exp(-float(np.median(np.diff(t))) / noise.correlation_s)
    zeroth = noise.coloured_um**2 * (1.0 - keep**2) + white**2 * (1.0 + keep**2)
    first = -keep * white**2
    # zeroth = s2 (1 + b2), first = s2 b: the invertible root
    b = (-zeroth + np.sqrt(zeroth**2 - 4.0 * first**2)) / (-2.0 * first)
    s = np.sqrt(first / b) if b else np.sqrt(zeroth)
    return lfilter([1.0, -keep], [1.0, b], y, axis=0) / s


@dataclass
class Span:
    """Prepared states of all runs and an orthonormal basis of what geometry and set-up can do to the readings."""

    setting: Setting
    states: list[RunState]
    plain: list[Array]
    basis: Array

    @classmethod
    def of(cls, setting: Setting, *, anywhere: bool = False) -> Span:
        """Finite differences about the true machine. `anywhere`: the workpiece may also lie and every axis have its zero
        anywhere."""
        states, plain = [], []
        for run in setting.fit:
            state = prepare(setting.machine, run, setting.location, setting.motions, (), NO_SETUP, 0, 1)
            states.append(state)
            plain.append(readings(state, run))
        span = cls(setting, states, plain, np.zeros((0, 0)))
        columns, sigmas = span._columns()
        if anywhere:
            free = np.stack([span._stack(change) for change in span._conventions()], axis=1)
            columns, sigmas = np.hstack([columns, free]), np.append(sigmas, np.full(free.shape[1], FREE))
        weighted = np.vstack([columns, np.diag(1.0 / sigmas)])
        span.basis = np.linalg.qr(weighted)[0]
        return span

    def _columns(self) -> tuple[Array, Array]:
        machine = self.setting.machine
        columns, sigmas = [], []
        for name, term in machine["errors"].items():
            for column in self._error(name, term):
                columns.append(self._stack(column))
                sigmas.append(float(term["sigma"]))
        for k, run in enumerate(self.setting.fit):
            for sigma, column in self._setup(k, run):
                blank = [np.zeros_like(y) for y in self.plain]
                blank[k] = column
                columns.append(self._stack(blank))
                sigmas.append(sigma)
        return np.stack(columns, axis=1), np.array(sigmas)

    def _error(self, name: str, term: Mapping[str, Any]) -> Iterable[list[Array]]:
        if "basis" not in term:
            yield self.change({"effect": "location_error", "component": name, "value": 1.0})
            return
        for k in range(1, term["order"] + 1):
            if term["basis"] == "fourier":
                shapes: list[Spec] = [{"harmonics": [[k, 1.0, 0.0]]}, {"harmonics": [[k, 0.0, 1.0]]}]
            else:
                shapes = [{"coefficients": [0.0] * (k - 1) + [1.0]}]
            for shape in shapes:
                yield self.change({"effect": "error_motion", "component": name, **shape})

    def _setup(self, k: int, run: Mapping[str, Any]) -> Iterable[tuple[float, Array]]:
        state, y, sigma = self.states[k], self.plain[k], run["setup_sigma_um"]
        for ball in ("table_ball", "tool_ball"):
            for i in range(3):
                moved = copy.copy(state)
                setattr(moved, ball, getattr(state, ball) + UM * np.eye(3)[i])
                yield float(sigma[ball]), readings(moved, run) - y
        if "length" in sigma:
            yield float(sigma["length"]), -np.ones_like(y)
        else:
            for i in range(y.shape[1]):
                yield ZERO_SIGMA_UM, np.tile(np.eye(y.shape[1])[i], (len(y), 1))

    def _conventions(self) -> Iterator[list[Array]]:
        """Changes of the readings where the workpiece is turned or an axis has another zero, by 1 µm or µrad."""
        states = self.states
        for turn in np.eye(3):
            yield [1e3 * URAD * np.cross(turn, instruments.ball(state)) for state in states]
        for axis in self.setting.machine["axes"]:
            moved = [copy.copy(state) for state in states]
            for state in moved:
                state.x = state.x | {axis: state.x[axis] + state.small(axis)}
            both = zip(moved, self.plain, self.setting.fit, strict=True)
            yield [readings(state, run) - y for state, y, run in both]

    def change(self, spec: Spec) -> list[Array]:
        """Change of the readings of all runs by one effect, drives moved anew only where it needs that."""
        changed = (self._with(k, spec) for k in range(len(self.states)))
        return [readings(s, run) - y for s, run, y in zip(changed, self.setting.fit, self.plain, strict=True)]

    def motion(self, spec: Spec) -> Array:
        """How one effect moves the ball to be measured against the tool, (N, 3) um over all runs."""
        changed = [self._with(k, spec) for k in range(len(self.states))]
        return np.concatenate([
            (instruments.ball(s) - instruments.ball(plain)) / UM for s, plain in zip(changed, self.states, strict=True)
        ])  # fmt: skip

    def _with(self, k: int, spec: Spec) -> RunState:
        """A run's state with one effect."""
        setting, stage = self.setting, catalogue.EFFECTS[spec["effect"]][0]
        if stage == "drive":
            return prepare(setting.machine, setting.fit[k], setting.location, setting.motions, [spec], NO_SETUP, 0, 1)
        state = copy.copy(self.states[k])
        state.motion = {name: rows.copy() for name, rows in state.motion.items()}
        state.location, state.x, state.sensor = dict(state.location), dict(state.x), list(state.sensor)
        catalogue.apply(state, [spec], stage)
        if stage == "axis" and setting.motions:
            state.motion = {}
            for component, shape in setting.motions.items():
                state.add_motion(component, error_motion_value(state, component, shape))
        return state

    def _stack(self, change: Sequence[Array]) -> Array:
        setting = self.setting
        parts = [
            whiten(y, run["t_s"], setting.white_um, setting.noise).ravel()
            for y, run in zip(change, setting.fit, strict=True)
        ]
        return np.concatenate(parts)

    def orthogonal(self, change: Sequence[Array]) -> Array:
        """What a fit of geometry and set-up leaves of a change of the readings, whitened, with its cost in the priors."""
        full = np.concatenate([self._stack(change), np.zeros(self.basis.shape[1])])
        return full - self.basis @ (self.basis.T @ full)

    def masked(self, change: Sequence[Array]) -> tuple[float, float]:
        """Share of an effect's energy that geometry and set-up can absorb, and the SNR of the rest."""
        centred = self._stack([y - y.mean(axis=0) for y in change])
        left = float(np.linalg.norm(self.orthogonal(change)))
        return 1.0 - min(1.0, left**2 / max(float(centred @ centred), 1e-30)), left


def size(setting: Setting, change: Sequence[Array]) -> float:
    """rms of the centred change over the declared noise."""
    square = sum(float(np.sum((y - y.mean(axis=0)) ** 2)) for y in change)
    return float(np.sqrt(square / sum(y.size for y in change))) / setting.white_um


def aliases(span: Span, spec: Spec, change: Sequence[Array]) -> dict[str, list[Name]]:
    """Names under which the readings could be explained as well: `same` (SNR of what is left below 1) and `close` (3).

    An explanation with more freedom than the effect's own family is no alias: the simpler one is to be preferred.
    """
    target, own = span.orthogonal(change), name_of(spec)
    found: dict[str, set[Name]] = {"same": set(), "close": set()}
    freedom = [(name, *_left(span, family, target)) for name, family in families(span.setting, spec)]
    least = min((rank for name, left, rank in freedom if name == own and left < APART), default=1)
    for name, left, rank in freedom:
        if name != own and rank <= least:
            found["same" if left < SAME else "close"] |= {name} if left < APART else set()
    return {k: sorted(v, key=str) for k, v in found.items()}


def oversized(setting: Setting, spec: Spec) -> list[Name]:
    """Names that give the same readings only if they move the ball `FAR` times as far as the effect does (rms about the mean): a
    bar that lies across an axis reads a micrometre of sideways play as millimetres of backlash."""
    span = Span.of(setting)
    target = span.orthogonal(span.change(spec))
    least: dict[Name, float] = {}
    for name, family in families(setting, spec):
        columns = np.stack([span.orthogonal(span.change(member)) for member in family], axis=1)
        if np.linalg.norm(columns, axis=0).max() < UNSEEN:
            continue
        factors = np.linalg.lstsq(columns, target, rcond=1e-3)[0]
        if np.linalg.norm(target - columns @ factors) < APART:
            size = _rms(np.tensordot(factors, [span.motion(member) for member in family], 1))
            least[name] = min(size, least.get(name, np.inf))
    return [name for name, size in least.items() if size > FAR * _rms(span.motion(spec))]


def _rms(motion: Array) -> float:
    return float(np.sqrt(np.mean(np.sum((motion - motion.mean(axis=0)) ** 2, axis=1))))


def inseparable(setting: Setting, spec: Spec) -> list[Name]:
    """Names that no measurement parts from an effect of the machine's structure: neither does the ball's position in the
    workpiece frame all over the travel, with two tools, where the workpiece and the zeros of the axes are nobody's to know.

    So a turn of X and of Y about Z, or of Z and of X about B, are one thing: which of them is straight is a convention.
    """
    if catalogue.EFFECTS[spec["effect"]][0] == "drive":
        return []
    rng = np.random.default_rng(0)
    axes = {name: table["travel"] for name, table in setting.machine["axes"].items()}
    common = {
        "instrument": "r_test", "sampling": "static", "t_s": 6.0 * np.arange(PLACES), "table_ball": [0.0, 0.0, 0.0],
        "noise_um": setting.white_um, "setup_sigma_um": {"table_ball": FREE, "tool_ball": FREE},
    }  # fmt: skip
    runs = [
        common | {
            "id": f"tool{k}", "start_s": 6.0 * PLACES * k,
            "tool_ball": (np.array(setting.fit[0]["tool_ball"]) - [0.0, 0.0, longer]).tolist(),
            "command": {name: rng.uniform(*travel, PLACES) for name, travel in axes.items()},
        }
        for k, longer in enumerate(TOOL_MM)
    ]  # fmt: skip
    whole = replace(setting, fit=runs, noise=plant.PLAIN)
    span = Span.of(whole, anywhere=True)
    change = span.change(spec)
    if np.linalg.norm(span._stack(change)) < APART:
        return []  # it does nothing at rest, so that nothing at rest tells of it
    return aliases(span, spec, change)["same"]


def _left(span: Span, family: Sequence[Spec], target: Array) -> tuple[float, int]:
    """SNR that the best member of a linear family leaves of `target`, and the family's rank."""
    columns = np.stack([span.orthogonal(span.change(member)) for member in family], axis=1)
    norms = np.linalg.norm(columns, axis=0)
    columns = columns[:, norms > 1e-9 * max(float(norms.max()), 1e-30)]
    if columns.size == 0 or float(norms.max()) < UNSEEN:
        return float(np.linalg.norm(target)), 0
    left, sizes, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    rank = int(np.sum(sizes > 1e-3 * sizes[0]))
    inside = left[:, :rank]
    return float(np.linalg.norm(target - inside @ (inside.T @ target))), rank


def families(setting: Setting, spec: Spec) -> list[tuple[Name, list[Spec]]]:
    """Linear families of explanations in the plant's own forms, small enough for a tangent; the vocabulary's words.

    Plays yield before they slide where that of `spec` does, over the same way.
    """
    yields = {k: spec[k] for k in ("form", "distance")} if spec.get("form") == "presliding" else {}
    found: list[list[Spec]] = []
    errors = setting.machine["errors"]
    for axis in setting.moving():
        low, high = setting.reach(axis)
        rotary = axis in "ABC"
        found.append([{"effect": "backlash", "axis": axis, "width": 10.0, **yields}])
        if not rotary:
            found.append([{"effect": "scale_error", "axis": axis, "ppm": 10.0}])
        for letter in "XYZABC":
            component = f"E{letter}{axis}"
            if letter != axis:
                found.append([{"effect": "lateral_play", "component": component, "width": 5.0, **yields}])
            if component in errors:
                continue
            if rotary and high - low > 200.0:
                shapes = [{"harmonics": [[k, *cs]]} for k in (1, 2, 3) for cs in ((1.0, 0.0), (0.0, 1.0))]
            else:
                reach = max(abs(low), abs(high)) / setting.machine["axes"][axis]["travel"][1]
                shapes = [{"coefficients": [0.0] * k + [reach ** -(k + 1.0)]} for k in range(3)]
            found.append([{"effect": "error_motion", "component": component, **s} for s in shapes])
            if axis in "AB":
                found += [
                    [{"effect": "gravity_sag", "axis": axis, "component": component, "amplitude": 1.0, "form": form}]
                    for form in ("sin", "one_minus_cos")
                ]
    for axis in setting.machine["axes"]:
        for letter in "XYZABC" if axis in "ABC" else "ABC":
            if f"E{letter}0{axis}" not in errors:
                found.append([{"effect": "location_error", "component": f"E{letter}0{axis}", "value": 1.0}])
    end = setting.duration()
    for tau in (0.2 * end, 0.5 * end, 5.0 * end):
        found.append(
            [
                {"effect": "thermal_drift", "direction": d, "amplitude": 1.0, "time_constant_s": tau}
                for d in np.eye(3).tolist()
            ]
        )
    found.append([{"effect": "sensor_error", "gain": 1.001}])
    if setting.dynamic:
        found.append([{"effect": "latency", "delay_ms": 0.2}])
        for axis in setting.moving():
            found.append(
                [
                    {"effect": "inertial_compliance", "axis": axis, "direction": d, "compliance": 1.0}
                    for d in np.eye(3).tolist()
                ]
            )
        for axis, table in setting.machine["axes"].items():
            if "drive" in table:
                found += [
                    [
                        {
                            "effect": "servo_mismatch",
                            "axis": axis,
                            "position_gain": 1.001 * table["drive"]["position_gain"],
                        }
                    ],
                    [
                        {
                            "effect": "servo_mismatch",
                            "axis": axis,
                            "velocity_gain": 1.01 * table["drive"]["velocity_gain"],
                        }
                    ],
                    [{"effect": "servo_mismatch", "axis": axis, "feedforward": 0.001}],
                    [{"effect": "friction", "axis": axis, "coulomb": 50.0 if axis in "XYZ" else 0.5}],
                ]
    return [(name_of(family[0]), family) for family in found]
