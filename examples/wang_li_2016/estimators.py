"""Two ways from readings to errors: the paper's sequence of small equations, and one joint estimate. Both for many machines.

`Readings` are run → (machines, N, columns) µm. Estimates are parameter name → (machines,) in µm and µrad.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign, Run
from symfive.kinematics import basis_of
from symfive.model import Model

from . import equations as paper
from .machine import DZ_MM, HALF_WIDTH_UM, HEIGHTS_MM, angle, readings_of

Array = NDArray[np.float64]
Readings = Mapping[str, Array]
Estimate = dict[str, Array]
SIX = "XYZABC"
SLOPES = ("EZX.P1", "EXY.P1", "EZY.P1")
"""Slopes of straightness that the paper's three squarenesses stand for; they are zero by its convention."""


def noisy(exact: Readings, seed: int) -> dict[str, Array]:
    """Readings with the paper's noise, uniform within ±2 µm."""
    generator = np.random.default_rng(seed)
    return {run: y + generator.uniform(-HALF_WIDTH_UM, HALF_WIDTH_UM, y.shape) for run, y in exact.items()}


def rotary_in_sequence(campaign: Campaign, readings: Readings, *, literal: bool = False) -> Estimate:
    """Eight location errors by (11)-(15) from the five ball-bar tests; `literal`: (14) as printed."""
    # what moves the table ball towards the tool ball shortens the bar; at C the tool ball stands inward of it, on the axis
    moved = {run: -1e-3 * readings[run][..., 0] for run in ("b-y", "b-x", "b-z")}
    outward = {run: 1e-3 * readings[run][..., 0] for run in ("c-low", "c-high")}
    b, c = angle(campaign.run("b-y"), "B"), angle(campaign.run("c-low"), "C")
    of_b = paper.b_location(b, DZ_MM, moved["b-y"], moved["b-x"], moved["b-z"])
    of_c = paper.c_location(c, HEIGHTS_MM, outward["c-low"], outward["c-high"], of_b, literal=literal)
    values = np.concatenate([of_b, of_c], axis=-1)
    return {name: values[..., k] * (1e6 if name[1] in "ABC" else 1e3) for k, name in enumerate(paper.LOCATION)}


def lever(run: Run, axis: str, ball: Array) -> Array:
    """The measured point in the carriage of a linear axis (N, 3) mm; `ball` (N, 3) its nominal place in the workpiece."""
    if axis == "Z":
        return np.tile(run.tool_ball, (len(ball), 1))
    if axis == "X":
        return ball
    return np.asarray(ball - np.outer(run.commands["X"], [1.0, 0.0, 0.0]))


def six_motions(campaign: Campaign, axis: str, deviations: Readings) -> Array:
    """(10) at every position: EX, EY, EZ, EA, EB, EC (machines, N, 6) mm and rad, relative to the start of the line."""
    d = "XYZ".index(axis)
    v, w = (d + 1) % 3, (d + 2) % 3
    names = [f"{axis.lower()}-line{n}-{'xyz'[d]}{'xyz'[k]}" for n, k in ((1, v), (1, w), (2, v), (3, w))]
    sign = 1e-3 if axis == "Z" else -1e-3
    seen = [sign * (deviations[name] - deviations[name][:, :1]) for name in names]
    six = np.stack(
        [seen[0][..., 0], seen[0][..., 1], seen[1][..., 1], seen[2][..., 0], seen[2][..., 1], seen[3][..., 0]], -1
    )
    places = []
    for name in (names[0], names[2], names[3]):
        run = campaign.run(name)
        from_start = run.commands[axis] - (run.table_ball[d] - run.tool_ball[d])
        ball = np.asarray(run.table_ball) + from_start[:, None] * np.eye(3)[d]
        places.append(lever(run, axis, ball))
    offsets = [(float(p[0, v]), float(p[0, w])) for p in places]
    found = np.linalg.solve(paper.lines_matrix(places[0][:, d], offsets), six[..., None])[..., 0]
    back = np.empty_like(found)
    for k, target in enumerate((d, v, w)):
        back[..., target], back[..., 3 + target] = found[..., k], found[..., 3 + k]
    return back


@dataclass(frozen=True)
class Sequence:
    """The paper's order: linear axes and squareness, B, C, motions of C; each stage takes the earlier ones as exact.

    Squareness is the slope that is left when the error motions are subtracted at the corner: they contain the carriage's own
    rotations, which at a lever that grows along the line look like a slope.
    """

    campaign: Campaign

    def estimate(self, readings: Readings) -> Estimate:
        """All errors that the paper's equations give."""
        nominal = readings_of(self.campaign, {}, 1)
        deviations = {run: y - nominal[run] for run, y in readings.items()}
        model = Model(self.campaign)
        found: Estimate = {}
        for axis in "XYZ":
            found |= self.motions_of(axis, deviations)
        corners = [run for run in self.campaign.runs if run.id.startswith("square-")]
        found |= self.squareness({run.id: deviations[run.id] - effect_of(model, run, found) for run in corners})
        corrected = {run.id: deviations[run.id] - effect_of(model, run, found) for run in self.campaign.runs}
        found |= rotary_in_sequence(self.campaign, corrected)
        return found | self.motions_of_c(corrected, found)

    def squareness(self, deviations: Readings) -> Estimate:
        """Slopes of both legs on one plate: their sum is the departure from 90°, the plate's yaw cancels."""
        found: Estimate = {}
        for first, second, name, sign in (("X", "Y", "EC0X", 1.0), ("Z", "X", "EB0Z", 1.0), ("Y", "Z", "EA0Z", -1.0)):
            run = self.campaign.run(f"square-{first}{second}".lower())
            half = 1 + int(np.argmax(np.abs(np.diff(run.commands[second])) > 0.0))  # it stands still on the first leg
            slopes = 0.0
            for axis, rows, column in ((first, slice(0, half), 1), (second, slice(half, None), 0)):
                along = run.commands[axis][rows]
                along = along - along.mean()
                slopes = slopes + deviations[run.id][:, rows, column] @ along / (along @ along)
            found[name] = sign * 1e3 * np.asarray(slopes)
        return found

    def motions_of(self, axis: str, deviations: Readings) -> Estimate:
        """Error motions of a linear axis by (10), fitted with the baseline's functions; a line belongs to the squareness."""
        d = "XYZ".index(axis)
        pointwise = six_motions(self.campaign, axis, deviations)
        name = f"{axis.lower()}-line1-{'xyz'[d]}{'xyz'[(d + 1) % 3]}"
        q = self.campaign.run(name).commands[axis]
        found: Estimate = {}
        for k, letter in enumerate(SIX):
            term = self.campaign.machine.errors[f"E{letter}{axis}"]
            basis = basis_of(term, self.campaign.machine)
            columns = np.column_stack([np.ones_like(q), basis.matrix(q), *([] if "P1" in basis.names else [q])])
            coefficients = pointwise[..., k] @ np.linalg.pinv(columns).T * (1e3 if k < 3 else 1e6)
            names = [f"{term.name}.{n}" for n in basis.names]
            found |= {n: coefficients[:, 1 + i] for i, n in enumerate(names) if n not in SLOPES}
        return found

    def motions_of_c(self, deviations: Readings, found: Estimate) -> Estimate:
        """(19) at every angle, fitted with harmonics of C."""
        order = ("c-low-x", "c-low-y", "c-low-z", "c-high-x", "c-high-y")
        c = angle(self.campaign.run(order[0]), "C")
        seen = np.stack([-1e-3 * deviations[name][..., 0] for name in order], axis=-1)
        pointwise = np.linalg.solve(paper.two_heights(*HEIGHTS_MM), seen[..., None])[..., 0]
        command = -c
        out: Estimate = {}
        for k, letter in enumerate(SIX[:5]):
            term = self.campaign.machine.errors[f"E{letter}C"]
            basis = basis_of(term, self.campaign.machine)
            columns = np.column_stack([np.ones_like(c), basis.matrix(command)])
            coefficients = pointwise[..., k] @ np.linalg.pinv(columns).T * (1e3 if k < 3 else 1e6)
            out |= {f"{term.name}.{n}": coefficients[:, 1 + i] for i, n in enumerate(basis.names)}
        return out


def effect_of(model: Model, run: Run, found: Estimate) -> Array:
    """What the errors found so far do to a run's readings, first order (machines, N, columns) µm."""
    line = model.linearise(run, model.start)
    count = len(next(iter(found.values())))
    total = np.zeros((count, run.rows, line.jacobian.shape[1]))
    place = {int(column): k for k, column in enumerate(line.columns)}
    for name, values in found.items():
        k = place.get(model.index[name])
        if k is not None:
            total += values[:, None, None] * line.jacobian[:, :, k]
    return total


@dataclass(frozen=True)
class Joint:
    """The joint estimate of symfive as one matrix: a Gauss-Newton step from zero, exact to second order in the errors.

    `gain` (k, readings) per µm, `covariance` (k, k) in µm and µrad, `names` of the machine's parameters and set-ups.
    """

    campaign: Campaign
    names: tuple[str, ...]
    gain: Array
    covariance: Array
    start: Array

    @classmethod
    def of(cls, campaign: Campaign, *, wide: float = 1.0) -> Joint:
        """From symfive's Jacobian, priors and declared noise; `wide` times the machine's priors, the set-ups keep theirs."""
        model = Model(campaign)
        blocks, whitening, prediction = [], [], []
        for run in campaign.runs:
            line = model.linearise(run, model.start)
            whole = np.zeros((*line.prediction.shape, len(model.parameters)))
            whole[:, :, line.columns] = line.jacobian
            blocks.append(whole.reshape(-1, len(model.parameters)))
            whitening.append(np.tile(1.0 / model.noise(run), run.rows))
            prediction.append(line.prediction.ravel())
        weights = np.concatenate(whitening)
        jacobian = np.concatenate(blocks) * weights[:, None]
        movable = np.array([i for i, p in enumerate(model.parameters) if p.sigma > 0.0 and p.name not in SLOPES])
        factor = np.array([wide if model.parameters[i].run is None else 1.0 for i in movable])
        sigma = factor * model.prior_sigma[movable]
        scaled = jacobian[:, movable] * sigma
        covariance = np.linalg.inv(scaled.T @ scaled + np.eye(len(movable)))
        gain = sigma[:, None] * (covariance @ scaled.T) * weights
        names = tuple(model.parameters[i].name for i in movable)
        return cls(campaign, names, gain, covariance * np.outer(sigma, sigma), np.concatenate(prediction))

    def estimate(self, readings: Readings) -> Estimate:
        """All parameters of all machines."""
        count = len(next(iter(readings.values())))
        stacked = np.concatenate([readings[run.id].reshape(count, -1) for run in self.campaign.runs], axis=1)
        values = (stacked - self.start) @ self.gain.T
        return {name: values[:, i] for i, name in enumerate(self.names)}

    @property
    def sigma(self) -> dict[str, float]:
        """Stated 1σ by name, µm and µrad."""
        return {name: float(s) for name, s in zip(self.names, np.sqrt(np.diag(self.covariance)), strict=True)}
