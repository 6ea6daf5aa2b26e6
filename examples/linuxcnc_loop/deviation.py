"""How far the tool centre point is from where the programme wants it, and what the rest consists of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symfive.campaign import Campaign
from symfive.model import Model

from .truth import TrueMachine, place_of_the_tool, tool_rotation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Deviation:
    """Deviations of the tool centre point over the poses, (N, 3) µm, in the workpiece frame.

    `fitted` constants were taken out of `vectors` (0: none), so that `per_coordinate` counts that many fewer readings.
    """

    vectors: Array
    fitted: int = 0

    @property
    def distances(self) -> Array:
        """(N,) µm."""
        return np.asarray(np.linalg.norm(self.vectors, axis=1))

    @property
    def rms(self) -> float:
        """Root mean square distance, µm."""
        return size(self.vectors)

    @property
    def largest(self) -> float:
        """Largest distance, µm."""
        return float(self.distances.max())

    @property
    def per_coordinate(self) -> float:
        """Root mean square of one coordinate for the degrees of freedom left, µm: to be compared with the noise."""
        return float(np.sqrt(np.sum(self.vectors**2) / (self.vectors.size - self.fitted)))


@dataclass(frozen=True)
class Rest:
    """What the true deviation with the work offsets set anew consists of, (N, 3) µm each, adding up to it.

    `control` rounding and interpolation of the control; `beyond` what the truth has and the model has no term for;
    `values` the uncertainty of the identified values.
    """

    control: Array
    beyond: Array
    values: Array


def size(vectors: Array) -> float:
    """Root mean square of the lengths, µm."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def _offset_set(vectors: Sequence[Array]) -> Array:
    """Without the mean of each set-up: its work offset is set anew on the workpiece."""
    return np.concatenate([part - part.mean(axis=0) for part in vectors])


def measured_deviation(campaign: Campaign, table: Mapping[str, Any]) -> Deviation:
    """What R-tests read, the set-up of every run taken out."""
    names = ("dx_um", "dy_um", "dz_um")
    readings = [np.stack([run.readings[name] for name in names], axis=1) for run in campaign.runs]
    return _without_setup(readings, [tool_rotation(table, run.commands) for run in campaign.runs])


def true_deviation(machine: TrueMachine, runs: Sequence[Mapping[str, Any]]) -> Deviation:
    """Where the tool centre point truly is, the tool being as long as the programme says; nothing is taken out."""
    return Deviation(np.concatenate(_true(machine, runs)))


def true_with_offset(machine: TrueMachine, runs: Sequence[Mapping[str, Any]]) -> Deviation:
    """The same with the work offset of every run set anew (3 constants each)."""
    return Deviation(_offset_set(_true(machine, runs)), 3 * len(runs))


def true_geometry(machine: TrueMachine, runs: Sequence[Mapping[str, Any]]) -> Deviation:
    """The same with the set-up of every run taken out as from a measurement."""
    return _without_setup(_true(machine, runs), [tool_rotation(machine.table, run["command"]) for run in runs])


def _true(machine: TrueMachine, runs: Sequence[Mapping[str, Any]]) -> list[Array]:
    return [place_of_the_tool(machine, dict(run), run["command"]) for run in runs]


def _without_setup(deviations: Sequence[Array], rotations: Sequence[Array]) -> Deviation:
    """Without the best constants in the workpiece frame (the zero, or work offset) and in the tool frame (where the ball is
    on the tool), which the readings of a run do not determine: 6 a run, fewer where the tool does not turn."""
    left, fitted = [], 0
    for vectors, rotation in zip(deviations, rotations, strict=True):
        identity = np.broadcast_to(np.eye(3), rotation.shape)
        columns = np.concatenate([identity, rotation], axis=2).reshape(-1, 6)
        solution, _, rank, _ = np.linalg.lstsq(columns, vectors.ravel(), rcond=1e-9)
        left.append((vectors.ravel() - columns @ solution).reshape(vectors.shape))
        fitted += int(rank)
    return Deviation(np.concatenate(left), fitted)


def rest_of(
    machine: TrueMachine, runs: Sequence[Mapping[str, Any]], campaign: Campaign, values: Mapping[str, float]
) -> Rest:
    """The parts of the true deviation of `runs`; `campaign` holds the same joints, `values` are those of the pins."""
    model = Model(campaign)
    pins = np.array([values.get(p.name, 0.0) if p.run is None else 0.0 for p in model.parameters])
    control = _offset_set([model.predict_run(run, pins) for run in campaign.runs])
    known = true_with_offset(machine.within_the_file(), runs).vectors
    return Rest(control, true_with_offset(machine, runs).vectors - known, known - control)
