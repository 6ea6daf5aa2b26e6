"""Touch probe on a calibration sphere: touches along straight lines, a sphere fitted to the tips, coordinates searched for."""

from collections.abc import Callable, Mapping

import numpy as np

from .chain import Array, axis_transform, ball_in_workpiece, location
from .state import UM, RunState, Spec

TOUCHES = ((0, 0, 1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))
RADIUS_MM = 12.5
"""Of sphere and tip together: what is fitted does not depend on it."""
ROUNDS = 6


def found_um(run: Spec, setup: Spec, state_beside: Callable[[Mapping[str, Array]], RunState]) -> tuple[RunState, Array]:
    """Found minus commanded linear coordinates (N, 3), um, by Newton's method with differences on the whole machine.

    `state_beside(beside)` is the machine with its linear axes `beside` (axis -> (N,) mm) their commands.
    """
    state = state_beside({})
    names = sorted(a.name for a in state.chain.axes if not a.rotary)
    beside = {name: np.zeros(len(state.t)) for name in names}
    for _ in range(ROUNDS):
        gap = _gap(state, run, setup)
        stepped = [_gap(state_beside({**beside, n: beside[n] + 1.0}), run, setup) - gap for n in names]
        step = np.linalg.solve(np.stack(stepped, axis=2), gap[:, :, None])[:, :, 0]
        beside = {name: beside[name] - step[:, i] for i, name in enumerate(names)}
        state = state_beside(beside)
    return state, 1e3 * np.stack([beside[name] for name in names], axis=1)


def _gap(state: RunState, run: Spec, setup: Spec) -> Array:
    tip = state.tool_ball - fitted_centres(run, np.asarray(setup.get("lobing", (0.0, 0.0))), tool_turn(state))
    there = ball_in_workpiece(state.chain, state.x, tip, state.location, state.motion, state.tool_shift)
    return np.asarray(there - state.table_ball)


def tool_turn(state: RunState) -> Array:
    """The tool's rotation in the machine frame, (N, 3, 3)."""
    turn = np.broadcast_to(np.eye(3), (len(state.t), 3, 3))
    for axis in state.chain.tool:
        turn = (
            turn
            @ axis_transform(axis, state.x[axis.name], location(axis, state.location), state.motion.get(axis.name))[0]
        )
    return np.asarray(turn)


def fitted_centres(run: Spec, lobes_um: Array, turn: Array) -> Array:
    """Where the sphere fitted to the tips stands from the true one, tool frame, (N, 3) mm, by Gauss-Newton on the tips."""
    directions = np.asarray(run.get("touches", TOUCHES), float)
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    if not np.any(lobes_um):
        return np.zeros((len(turn), 3))
    centres = []
    for rotation in turn:
        n = directions @ rotation if run.get("touch_frame") == "machine" else directions
        angle, flat = np.arctan2(n[:, 1], n[:, 0]), np.hypot(n[:, 0], n[:, 1])
        pretravel = UM * flat**3 * (lobes_um[0] * np.cos(3 * angle) + lobes_um[1] * np.sin(3 * angle))
        tips = (RADIUS_MM - pretravel)[:, None] * n
        centre, radius = np.zeros(3), RADIUS_MM
        for _ in range(5):
            away = tips - centre
            size = np.linalg.norm(away, axis=1)
            table = np.column_stack([-away / size[:, None], -np.ones(len(n))])
            change = np.linalg.lstsq(table, radius - size, rcond=None)[0]
            centre, radius = centre + change[:3], radius + change[3]
        centres.append(centre)
    return np.array(centres)
