"""What is left of a named effect's own family: nuisance columns that keep others from mopping up a misfit of shape.

Where the true form is a little off the library's, the rest of it lies on the same channel (the axis, the tool, the
component) over the same coordinate. These columns, each with a prior of a share of the effect's own size, join the fit
before any other effect is looked for.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Run
from symfive.diagnose._catalogue import AxisOffset, MotionOffset, ToolShift
from symfive.diagnose._scores import Extra
from symfive.effects import Effect
from symfive.identify import Identification
from symfive.model import Model

__all__ = ["SHARE", "remainder"]

Array = NDArray[np.float64]
SHARE = 0.3
"""Prior 1σ of one column as a share of the effect's size on its channel."""
Functions = Callable[[Effect, Identification, Run], Array]


def remainder(result: Identification) -> Extra | None:
    """Columns of all effects that the fit holds beyond the baseline, or None."""
    columns: dict[str, list[Array]] = {run.id: [] for run in result.model.campaign.runs}
    sigma: list[float] = []
    for effect in result.model.effects:
        found = _of(effect, result)
        if found is None:
            continue
        parts, size = found
        for run, part in parts.items():
            columns[run].append(part)
        count = next(iter(parts.values())).shape[2]
        sigma += [SHARE * size] * count
    if not sigma:
        return None
    return Extra({run: np.concatenate(parts, axis=2) for run, parts in columns.items()}, np.array(sigma))


def _of(effect: Effect, result: Identification) -> tuple[dict[str, Array], float] | None:
    family = _FAMILIES.get(effect.id)
    if family is None:
        return None
    functions, probe_of = family
    probe = probe_of(effect)
    campaign = result.model.campaign
    model = Model(campaign, [*(e for e in result.model.effects if e.frees()), probe])
    values = model.vector({p.name: float(v) for p, v in zip(result.parameters, result.values, strict=True) if p.name in model.index})
    names = [p.name for p in probe.parameters(campaign)]
    parts, size = {}, 0.0
    for run in campaign.runs:
        line = model.linearise(run, values)
        place = [int(np.flatnonzero(line.columns == model.index[name])[0]) for name in names]
        channel = line.jacobian[:, :, place]
        shapes = functions(effect, result, run)
        parts[run.id] = np.concatenate([channel[:, :, [i]] * shapes[:, None, :] for i in range(len(names))], axis=2)
    for p in effect.parameters(campaign):
        if p.unit in ("um", "urad") and p.mean == 0.0:
            size = max(size, abs(result[p.name]))
    return parts, size if size > 0.0 else 5.0


def _axis(effect: Effect) -> Effect:
    return AxisOffset(axis=effect.axis)


def _component(effect: Effect) -> Effect:
    return MotionOffset(component=getattr(effect, "component"))


def _tool(effect: Effect) -> Effect:
    return ToolShift()


def _sign(run: Run, axis: str) -> tuple[Array, Array, Array]:
    """Direction of motion with memory, distance and time since the last reversal, in the command's units."""
    position = np.asarray(run.commands[axis])
    change = np.sign(np.diff(position, prepend=position[0]))
    moved = np.flatnonzero(change)
    if not moved.size:
        zero = np.zeros_like(position)
        return zero, zero, zero
    last = np.maximum.accumulate(np.where(change != 0, np.arange(len(change)), -1))
    sign = change[np.where(last < 0, moved[0], last)]
    turned = np.flatnonzero(np.diff(sign)) + 1
    since = np.full(len(sign), 0)
    since[turned] = turned
    since = np.maximum.accumulate(since)
    fresh = np.arange(len(sign)) >= (turned[0] if turned.size else len(sign))
    far = np.where(fresh, np.abs(position - position[since]), np.inf)
    late = np.where(fresh, run.time - run.time[since], np.inf)
    return sign, far, late


def _span(run: Run, axis: str) -> tuple[Array, float]:
    position = np.asarray(run.commands[axis])
    reach = max(float(np.ptp(position)), 1e-9)
    return (position - position.mean()) / (0.5 * reach), reach


def _reversal_shapes(axis: str, run: Run) -> Array:
    sign, far, late = _sign(run, axis)
    place, reach = _span(run, axis)
    shapes = [sign * np.exp(-far / (share * reach)) for share in (0.003, 0.01, 0.03, 0.1, 0.3)]
    if run.dynamic:
        shapes += [sign * np.exp(-late / tau) for tau in (0.02, 0.06, 0.2, 0.6)]
    return np.stack([*shapes, sign, sign * place, sign * place**2, place], axis=1)


def _play(effect: Effect, result: Identification, run: Run) -> Array:
    axis = effect.axis or getattr(effect, "component", "")[2:]
    return _reversal_shapes(axis, run)


def _servo(effect: Effect, result: Identification, run: Run) -> Array:
    axis = str(effect.axis)
    position = np.asarray(run.commands[axis])
    velocity = np.gradient(position, run.time) if run.rows > 1 else np.zeros_like(position)
    acceleration = np.gradient(velocity, run.time) if run.rows > 1 else velocity
    scale = [max(float(np.abs(x).max()), 1e-12) for x in (velocity, acceleration)]
    v, a = velocity / scale[0], acceleration / scale[1]
    return np.concatenate([np.stack([v, a, v * np.abs(v), v**3], axis=1), _reversal_shapes(axis, run)], axis=1)


def _periodic(effect: Effect, result: Identification, run: Run) -> Array:
    position = np.asarray(run.commands[str(effect.axis)])
    names = result.model.index
    period = result[f"{effect.key}.period"] if f"{effect.key}.period" in names else getattr(effect, "period")
    place, _ = _span(run, str(effect.axis))
    phase = 2.0 * np.pi * position / period
    shapes = [f(k * phase) for k in (0.5, 2.0, 3.0, 4.0) for f in (np.sin, np.cos)]
    shapes += [g * f(phase) for g in (place, place**2) for f in (np.sin, np.cos)]
    return np.stack(shapes, axis=1)


def _smooth(effect: Effect, result: Identification, run: Run) -> Array:
    """Waves over the axis' own coordinate, and its direction of motion (hysteresis)."""
    axis = effect.axis or getattr(effect, "component", "")[2:]
    place, reach = _span(run, axis)
    sign, _, _ = _sign(run, axis)
    if result.model.machine.axes[axis].rotary and reach > 200.0:
        angle = np.deg2rad(np.asarray(run.commands[axis]))
        waves = [f(k * angle) for k in range(1, 7) for f in (np.cos, np.sin)]
    else:
        waves = [np.polynomial.legendre.legval(np.clip(place, -1, 1), np.eye(9)[k]) for k in range(1, 9)]
    return np.stack([*waves, sign, sign * place, sign * np.sqrt(np.maximum(1.0 - place**2, 0.0))], axis=1)


def _in_time(effect: Effect, result: Identification, run: Run) -> Array:
    runs = result.model.campaign.runs
    end = max(r.start_s + float(r.time[-1]) for r in runs)
    clock = 2.0 * (run.start_s + run.time) / max(end, 1e-9) - 1.0
    return np.stack([np.polynomial.legendre.legval(clock, np.eye(9)[k]) for k in range(1, 9)], axis=1)


def _after_shift(effect: Effect, result: Identification, run: Run) -> Array:
    shifted = getattr(effect, "run")
    late = run.time - getattr(effect, "t_s")
    active = (run.id == shifted) & (late >= 0.0)
    span = max(float(run.time[-1] - run.time[0]), 1e-9)
    return np.stack([np.where(active, np.exp(-np.maximum(late, 0.0) / (s * span)), 0.0) for s in (0.01, 0.05, 0.2)], axis=1)


_FAMILIES: dict[str, tuple[Functions, Callable[[Effect], Effect]]] = {
    "backlash": (_play, _axis),
    "counterbalance": (_play, _axis),
    "friction": (_servo, _axis),
    "reversal_spike": (_servo, _axis),
    "servo_mismatch": (_servo, _axis),
    "latency": (lambda e, r, run: np.zeros((run.rows, 1)), _tool),
    "lateral_play": (_play, _component),
    "transmission_error": (_periodic, _axis),
    "scale_error": (_smooth, _axis),
    "table_step": (_smooth, _axis),
    "gravity_sag": (_smooth, _component),
    "error_motion": (_smooth, _component),
    "eccentric_mass": (_smooth, _axis),
    "thermal_drift": (_in_time, _tool),
    "spindle_growth": (_in_time, _tool),
    "setup_shift": (_after_shift, _tool),
}
