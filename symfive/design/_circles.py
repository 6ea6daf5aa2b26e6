"""Information of a circle about the machine and its drives, its own set-up errors marginalised, and the most informative ones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array, Indices
from symfive.campaign import Campaign, Run
from symfive.design._paths import CircleShape, circle_runs
from symfive.effects import Effect
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.model import Model
from symfive.moves import cleared
from symfive.nc import addressed
from symfive.optimal import Criterion, exchanged_options, inverse, marginal
from symfive.procedures import heights


@dataclass(frozen=True)
class Circle:
    """A circle: its `shape`; its `runs`, one per direction; the information `matrix` (k, k) that it adds about machine and
    effects at their typical size (file units), `matrices` the same at every draw from the prior; the expected 1σ of each
    parameter of the effects; and the recording time, `seconds`."""

    shape: CircleShape
    runs: tuple[Run, ...]
    matrix: Array
    matrices: tuple[Array, ...]
    sigma: Mapping[str, float]

    @property
    def seconds(self) -> float:
        """Time of the recordings, s."""
        return sum(run.duration for run in self.runs)

    @property
    def ratio(self) -> float:
        """X_T/r (0 for a planar circle)."""
        return self.shape.values.get("ratio", 0.0)

    @property
    def radius(self) -> float:
        """Radius, mm."""
        return self.shape.values["radius"]

    @property
    def feed(self) -> float:
        """Feed along the circle, mm/min."""
        return self.shape.values["feed"]


def typical_values(model: Model) -> Array:
    """The start of a model with its effects at typical size: a play of width zero has no derivative where an axis rests."""
    vector = model.start
    for effect in model.effects:
        for name, value in effect.typical(model.campaign).items():
            if model.parameters[model.index[name]].mean == 0.0:
                vector[model.index[name]] = value
    return vector


def true_values(model: Model, draws: int) -> list[Array]:
    """Typical values first, then `draws` in which the effects' parameters are drawn from their priors, within bounds."""
    typical, generator = typical_values(model), np.random.default_rng(0)
    return [typical, *(with_drawn_effects(model, typical, generator) for _ in range(draws))]


def with_drawn_effects(model: Model, vector: Array, generator: np.random.Generator) -> Array:
    """A parameter vector with those of the effects drawn from their priors, within bounds."""
    drawn = (p.drawn(generator) if p.kind == "effect" else x for p, x in zip(model.parameters, vector, strict=True))
    return np.array(list(drawn))


def measured(
    machine: Machine, effects: Iterable[Effect], shape: CircleShape, *, noise_um: float, rate_hz: float, draws: int = 0
) -> Circle:
    """The circle as it would be recorded. Raises `InputError` where an axis cannot follow."""
    runs = circle_runs(machine, shape, noise_um=noise_um, rate_hz=rate_hz)
    return circle_of_runs(machine, effects, shape, runs, draws)


def circle_of_runs(
    machine: Machine, effects: Iterable[Effect], shape: CircleShape, runs: tuple[Run, ...], draws: int = 0
) -> Circle:
    """A circle with the information that its runs give about effects and geometry."""
    model = Model(Campaign(machine=machine, runs=runs), effects)
    matrices = [_marginal(model, runs, vector) for vector in true_values(model, draws)]
    shared = [p for p in model.parameters if p.kind != "setup"]
    spread = np.sqrt(np.diag(inverse(matrices[0] + np.diag([p.sigma**-2.0 for p in shared]))))
    sigma = {p.name: float(s) for p, s in zip(shared, spread, strict=True) if p.kind == "effect"}
    return Circle(shape, runs, matrices[0], tuple(matrices), sigma)


def circle_information(
    machine: Machine, effects: Iterable[Effect], *, ratio: float, radius: float, feed: float, height: float | None = None,
    direction: str = "both", noise_um: float = 0.3, rate_hz: float = 50.0,
) -> Circle:  # fmt: skip
    """One synchronous circle (X_T = ratio·radius, mm; feed mm/min). Raises `InputError` where an axis cannot follow."""
    level = sum(heights(machine)) / 2.0 if height is None else height
    values = {"ratio": ratio, "radius": radius, "feed": feed, "height": level}
    shape = CircleShape(family="synchronous", direction=direction, values=values)
    return measured(machine, effects, shape, noise_um=noise_um, rate_hz=rate_hz)


def _marginal(model: Model, runs: Sequence[Run], vector: Array) -> Array:
    """Information about all that is not set-up, each run's set-up marginalised (k, k), in file units."""
    shared = [i for i, p in enumerate(model.parameters) if p.kind != "setup"]
    place = {i: j for j, i in enumerate(shared)}
    total = np.zeros((len(shared), len(shared)))
    for run in runs:
        line = model.linearise(run, vector)
        slopes = (line.jacobian / model.noise(run)[:, None]).reshape(-1, line.jacobian.shape[2])
        gram = slopes.T @ slopes
        inside = np.array([i in place for i in line.columns])
        gram += np.diag(np.where(inside, 0.0, model.prior_sigma[line.columns] ** -2.0))
        index = [place[int(i)] for i in line.columns[inside]]
        total[np.ix_(index, index)] += marginal(gram, np.flatnonzero(inside))
    return total


@dataclass(frozen=True)
class Goal:
    """What circles are chosen for: ψ of the parameters `interest` (indices) with prior 1σ `scale` (k,), at the effects'
    typical size (`nominal`), or its mean or worst value over the draws; `per_minute` adds log of the recording time, which
    for variances compares plans as if each were repeated until a given hour; `known` (k, k) information that is there already,
    file units."""

    criterion: Criterion
    interest: Indices
    scale: Array
    robust: str = "nominal"
    per_minute: bool = False
    known: Array | float = 0.0

    def covariance(self, total: Array) -> Array:
        """Posterior covariance, per prior 1σ, of an information matrix in file units (k, k)."""
        return inverse(np.eye(len(self.scale)) + (total + self.known) * np.outer(self.scale, self.scale))

    def value(self, circles: Sequence[Circle]) -> float:
        """ψ of some circles together."""
        draws = 1 if self.robust == "nominal" else len(circles[0].matrices)
        seconds = sum(circle.seconds for circle in circles)
        return self.joined(
            [self.psi(np.sum([c.matrices[d] for c in circles], axis=0)) for d in range(draws)], seconds
        )  # fmt: skip

    def psi(self, total: Array) -> float:
        """ψ of one information matrix."""
        return self.criterion.value(self.covariance(total)[np.ix_(self.interest, self.interest)])

    def pull(self, total: Array) -> Array:
        """-dψ/dM (k, k) in file units."""
        return self.psi_and_pull(total)[1]

    def psi_and_pull(self, total: Array) -> tuple[float, Array]:
        """Both, from one inverse."""
        columns = self.covariance(total)[:, self.interest]
        S = columns[self.interest]
        pull = columns @ self.criterion.slope(S) @ columns.T * np.outer(self.scale, self.scale)
        return self.criterion.value(S), np.asarray(pull)

    def joined(self, values: Sequence[float], seconds: float) -> float:
        """One number from ψ of every draw and the time."""
        whole = max(values) if self.robust == "worst" else float(np.mean(values))
        return whole + (float(np.log(seconds / 60.0)) if self.per_minute else 0.0)


def check_clear(machine: Machine, runs: Iterable[Run]) -> None:
    """Raises `InputError` where something meets along the programs of these runs; a machine whose axes have no NC address gets
    none."""
    if addressed(machine):
        cleared(machine, runs, {})


def chosen_clear(
    machine: Machine, goal: Goal, circles: Sequence[Circle], count: int
) -> tuple[list[Circle], list[Circle]]:
    """The most informative `count` circles, and those that are left to choose from: one along which bodies meet gives way
    to another. Raises `InputError` where none is left."""
    left, clear = list(circles), set[int]()
    while True:
        chosen = _most_informative(goal, left, count)
        for circle in chosen:
            if id(circle) in clear:
                continue
            try:
                check_clear(machine, circle.runs)
            except InputError as error:
                left = [other for other in left if other is not circle]
                if not left:
                    raise InputError(f"no circle can be run: {error.problem}", remedy=error.remedy) from None
                break
            clear.add(id(circle))
        else:
            return chosen, left


def _most_informative(goal: Goal, circles: Sequence[Circle], count: int) -> list[Circle]:
    """Greedy, then exchange until nothing improves."""

    def values(others: list[int], place: int) -> list[float]:
        beside = [circles[i] for i in others]
        return [goal.value([*beside, circle]) for circle in circles]

    return [circles[i] for i in exchanged_options(count, values)[1]]
