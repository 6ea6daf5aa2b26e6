"""The model of a campaign: predicted readings and exact sensitivities with respect to every parameter, by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from symfive.arrays import Array, Indices
from symfive.effects import Effect, baseline_effects
from symfive.errors import EvaluationError, InputError
from symfive.instruments import Column, check_mounting, has_clock_of_its_own, instruments_of, setup_parameter
from symfive.model._assembly import Given, RowFunction, Together, assembled, kind_of, machine_parameters, sensed_columns
from symfive.motion import GAINS, LAGS, Late, RunMotion, Series, Signal
from symfive.parameters import Parameter
from symfive.runs import Campaign, Run
from symfive.screen import OnScreen, plural

CLOCK, CLOCK_DRIFT = "clock", "clock_drift"
"""How late the instrument of a run is: its name among the run's own unknowns."""


@dataclass(frozen=True)
class Linearisation:
    """A run at given parameter values, in the files' units.

    `prediction` (N, ny) readings; `jacobian` (N, ny, k) with respect to the parameters whose indices are `columns` (k,).
    """

    prediction: Array
    jacobian: Array
    columns: Indices


class Model(OnScreen):
    """One symbolic model of a machine, its instruments and its effects, for all runs of a campaign.

    `effects` are added to those in `[model]` of the machine file. `linear=True` takes the errors of the chain to
    first order (derived from the exact chain by differentiation). Parameter vectors are in the files' units, in the
    order of `parameters`; `values` may also be given as a mapping of names.

        model = Model(campaign)
        model.parameters                     # names, units, priors
        model.predict(model.start)["c-circle"]   # (N, ny), µm
        model.linearise("c-circle", model.start).jacobian
    """

    def __init__(self, campaign: Campaign, effects: Iterable[Effect] = (), *, linear: bool = False) -> None:
        self.campaign = campaign
        self.machine = campaign.machine
        self.linear = linear
        self.effects: tuple[Effect, ...] = tuple(
            effect.prepare(campaign) for effect in (*baseline_effects(self.machine), *effects)
        )
        keys = [effect.key for effect in self.effects]
        for key in keys:
            if keys.count(key) > 1:
                raise InputError(f"the effect {key} is in the model twice", remedy="remove one of them")
        self.parameters = self._collect()
        self.index = {p.name: i for i, p in enumerate(self.parameters)}
        self._freed = self._collect_freed()
        self._quantities = dict.fromkeys(p.quantity for p in self.parameters if p.of_setup)
        self._kinds: dict[tuple[object, ...], RowFunction] = {}
        self._functions: WeakKeyDictionary[Run, RowFunction] = WeakKeyDictionary()
        self._together = Together(campaign.runs)
        self._inputs: WeakKeyDictionary[Run, tuple[tuple[float, ...], bool, list[_Clock]]] = WeakKeyDictionary()

    def __str__(self) -> str:
        effects = f", effects {', '.join(effect.key for effect in self.effects)}" if self.effects else ""
        head = f"model of {self.machine.name}: {plural(len(self.parameters), 'parameter')}{effects}"
        return f"{head}\n{self.campaign}"

    def _collect(self) -> tuple[Parameter, ...]:
        found = {p.name: p for p in machine_parameters(self.machine)}
        for effect in self.effects:
            found |= {p.name: p for p in effect.parameters(self.campaign)}
        for run in self.campaign.runs:
            for effect in self.effects:
                found |= {p.name: p for p in effect.starts(run) if effect.applies(run)}
            for instrument in instruments_of(run):
                instrument.check(run, self.machine)
                found |= {p.name: p for p in instrument.parameters(run, self.machine) if p.name not in found}
            check_mounting(run, self.machine)
            if run.clock_sigma_ms and has_clock_of_its_own(run):
                # when it began and when it ended are known alike
                for name, sigma in ((CLOCK, run.clock_sigma_ms), (CLOCK_DRIFT, 2.0**0.5 * run.clock_sigma_ms)):
                    clock = setup_parameter(run, name, "ms", sigma)
                    found[clock.name] = clock
        return tuple(found.values())

    def _collect_freed(self) -> dict[tuple[str, str], str]:
        freed: dict[tuple[str, str], str] = {}
        for effect in self.effects:
            frees = effect.frees()
            for place, name in frees.items():
                axis, quantity = place
                if place in freed:
                    raise InputError(f"two effects free {quantity} of axis {axis}", remedy="keep one of them")
                lagged = any((axis, lag) in frees for lag in LAGS)
                if quantity in GAINS and self.machine.axes[axis].drive is None and not lagged:
                    raise InputError(
                        f"{effect.key} needs the drive of axis {axis}",
                        remedy=f"add [axes.{axis}.drive] to the machine file",
                    )
                freed[place] = name
        return freed

    @property
    def added(self) -> tuple[Effect, ...]:
        """The effects beyond those of the machine file."""
        held = {effect.prepare(self.campaign).key for effect in baseline_effects(self.machine)}
        return tuple(effect for effect in self.effects if effect.key not in held)

    @property
    def start(self) -> Array:
        """Where estimation begins: prior means (or an effect's own start), file units."""
        return np.array([p.initial for p in self.parameters])

    @property
    def prior_mean(self) -> Array:
        """Prior means, file units."""
        return np.array([p.mean for p in self.parameters])

    @property
    def prior_sigma(self) -> Array:
        """Prior standard deviations, file units."""
        return np.array([p.sigma for p in self.parameters])

    def vector(self, values: Mapping[str, float] | Sequence[float] | Array) -> Array:
        """Parameter vector from a vector or from names; names left out stay at the start."""
        if not isinstance(values, Mapping):
            array = np.asarray(values, dtype=float)
            if array.shape != (len(self.parameters),):
                raise InputError(f"{array.size} values for {len(self.parameters)} parameters", remedy="use model.start")
            return array
        array = self.start
        for name, value in values.items():
            if name not in self.index:
                raise InputError(f'the model has no parameter "{name}"', remedy="see model.parameters")
            array[self.index[name]] = value
        return array

    def named(self, values: Array) -> dict[str, float]:
        """A parameter vector by names."""
        return {p.name: float(v) for p, v in zip(self.parameters, values, strict=True)}

    def columns(self, run: Run | str) -> tuple[Column, ...]:
        """The reading columns of a run."""
        return self._function(self._run(run)).columns

    def predict(self, values: Mapping[str, float] | Sequence[float] | Array) -> dict[str, Array]:
        """Predicted readings of every run: id → (N, ny), in the columns' units."""
        vector = self.vector(values)
        return {run.id: self.predict_run(run, vector) for run in self.campaign.runs}

    def predict_run(self, run: Run | str, values: Mapping[str, float] | Sequence[float] | Array) -> Array:
        """Predicted readings of one run (N, ny)."""
        run = self._run(run)
        vector = self.vector(values)
        with np.errstate(all="ignore"):  # what overflows is refused
            readings, _ = self._recorded(run, self._evaluated(run, vector, slopes=False), vector)
        _require_finite(run, "readings", readings)
        return readings[:, :, 0]

    def contribution(
        self,
        effect: Effect,
        values: Mapping[str, float] | Sequence[float] | Array,
        whole: Mapping[str, Array] | None = None,
    ) -> dict[str, Array]:
        """Readings with an effect of the model (`whole`, if they are known) less those without it (its parameters at their
        means): id → (N, ny)."""
        vector = self.vector(values)
        without = vector.copy()
        for p in effect.parameters(self.campaign):
            without[self.index[p.name]] = p.mean
        return {
            run.id: (self.predict_run(run, vector) if whole is None else whole[run.id]) - self.predict_run(run, without)
            if effect.applies(run)
            else np.zeros((run.rows, len(self.columns(run))))
            for run in self.campaign.runs
        }

    def linearise(
        self, run: Run | str, values: Mapping[str, float] | Sequence[float] | Array, *, ahead: bool = False
    ) -> Linearisation:
        """Predicted readings of one run and their exact derivatives; `ahead`: the campaign's next runs are asked for at the same
        values, and short ones are computed together."""
        run = self._run(run)
        with np.errstate(all="ignore"):  # what overflows is refused
            names, together = self._linearised(run, self.vector(values), ahead=ahead)
        _require_finite(run, "readings or their slopes", together)
        columns = np.array([self.index[name] for name in names], dtype=np.int64)
        return Linearisation(together[:, :, 0], together[:, :, 1:], columns)

    def _linearised(self, run: Run, vector: Array, *, ahead: bool) -> tuple[list[str], Array]:
        """The parameters that enter a run, and its readings and their slopes in these (N, ny, 1 + k)."""
        function = self._function(run)
        names = [*function.shared, *(run.full_name(name) for name in function.own)]
        together, own = self._recorded(run, self._evaluated(run, vector, slopes=True, ahead=ahead), vector)
        for name, slopes in own.items():
            together[:, :, 1 + names.index(name)] += self.parameters[self.index[name]].scale * slopes
        return names, together

    def _evaluated(self, run: Run, vector: Array, *, slopes: bool, ahead: bool = False) -> Array:
        """Readings (N, ny, 1) before their recorder, with slopes (N, ny, 1 + k), every column on its own clock."""
        function = self._function(run)
        names = (*function.shared, *function.own)
        place = {run.full_name(name): 1 + i for i, name in enumerate(names)} if slopes and function.moving else {}
        shared, parts = vector[[self.index[name] for name in function.shared]], []
        clocks = self._clocks(run, function, vector, slopes=slopes)
        tables = self._together.tables(run, vector, shared, self._function, self._given) if ahead else ()
        for number, (columns, inputs, series) in enumerate(clocks):
            table = (
                tables[number]
                if tables
                else function.evaluate(inputs, shared, *self._numbers(run, vector), slopes=slopes)
            )
            if slopes:
                table, by_input = np.split(table, [1 + len(names)], axis=2)
                for i, entry in enumerate(function.moving):
                    for name, slope in series[entry - 2].tangents.items():
                        full = run.full_name(name)
                        scale = self.parameters[self.index[full]].scale
                        table[:, :, place[full]] += by_input[:, :, i] * (scale * slope)[:, None]
            parts.append((columns, table))
        (_, whole), *others = parts
        for columns, table in others:
            whole[:, columns] = table[:, columns]
        return whole

    def _recorded(self, run: Run, readings: Array, vector: Array) -> tuple[Array, dict[str, Array]]:
        """Readings (N, ny, m) after what their recorder does to them, and its parameters' slopes (N, ny)."""
        slopes: dict[str, Array] = {}
        for effect in self.effects:
            if effect.stage == "recording" and effect.applies(run):
                values = {p.name: p.scale * float(vector[self.index[p.name]]) for p in effect.parameters(self.campaign)}
                columns = sensed_columns(run, self.machine)
                earlier = list(slopes)
                stacked = np.concatenate([readings, *(slopes[name][:, :, None] for name in earlier)], axis=2)
                filtered, own = effect.record(run, columns, stacked, values)
                readings = filtered[:, :, : readings.shape[2]]
                slopes = {name: filtered[:, :, readings.shape[2] + i] for i, name in enumerate(earlier)} | own
        return readings, slopes

    def readings(self, run: Run | str) -> Array:
        """What was read in a run (N, ny). Raises `InputError` for a run without readings."""
        run = self._run(run)
        if not run.measured:
            raise InputError(f"run {run.id} has no readings", remedy="measure or simulate the plan first")
        return np.stack([run.readings[c.name] for c in self.columns(run)], axis=1)

    def noise(self, run: Run | str) -> Array:
        """Declared 1σ of the white noise of each column (ny,)."""
        run = self._run(run)
        return np.array([
            run.noise(instrument.name) for instrument in instruments_of(run) for _ in instrument.columns(run, self.machine)
        ])  # fmt: skip

    def _run(self, run: Run | str) -> Run:
        return self.campaign.run(run) if isinstance(run, str) else run

    def _function(self, run: Run) -> RowFunction:
        found = self._functions.get(run)
        if found is None:
            acting = tuple(effect.applies(run) for effect in self.effects)
            kind = (*kind_of(run), self._own(run))
            if (kind, acting) not in self._kinds:
                effects = [effect for effect, acts in zip(self.effects, acting, strict=True) if acts]
                made = assembled(self.machine, run, effects, self.parameters, self.linear, kind)
                self._kinds[kind, acting] = made
            found = self._functions[run] = self._kinds[kind, acting]
        return found

    def _own(self, run: Run) -> tuple[tuple[str, float], ...]:
        """The quantities of a run's set-up that are parameters, with their scales, in the order of these."""
        names = ((quantity, run.full_name(f"setup.{quantity}")) for quantity in self._quantities)
        places = sorted((self.index[name], quantity) for quantity, name in names if name in self.index)
        return tuple((quantity, self.parameters[place].scale) for place, quantity in places)

    def _numbers(self, run: Run, vector: Array) -> tuple[Array, Array]:
        """A run's own parameters and its constants, as its function takes them."""
        function = self._function(run)
        constants: dict[str, float] = {}
        for instrument in instruments_of(run):
            constants |= instrument.constants(run, self.machine)
        own = vector[[self.index[run.full_name(name)] for name in function.own]]
        return own, np.array([constants[name] for name in function.constants])

    def _given(self, run: Run, vector: Array) -> Given:
        """All that a run hands to its function for slopes."""
        clocks = self._clocks(run, self._function(run), vector)
        return Given([clock.inputs for clock in clocks], *self._numbers(run, vector))

    def _clocks(self, run: Run, function: RowFunction, vector: Array, *, slopes: bool = True) -> list[_Clock]:
        """What the columns of a run see, if asked for with its `slopes` in the clock; kept until a parameter that moves it
        changes."""
        wanted = {*self._freed.values(), *(name for signal in function.inputs for name in signal.parameters)}
        wanted |= {f"setup.{CLOCK}", f"setup.{CLOCK_DRIFT}"}
        active = {name: self.index[full] for name in sorted(wanted) if (full := run.full_name(name)) in self.index}
        stamp = tuple(float(vector[i]) for i in active.values())
        cached = self._inputs.get(run)
        if cached is not None and cached[0] == stamp and cached[1] >= slopes:
            return cached[2]
        values = {name: float(vector[i]) * self.parameters[i].scale for name, i in active.items()}
        motion, sensed = RunMotion(run, self.machine, self._freed, values), sensed_columns(run, self.machine)
        delays = [name for name in (self._freed.get(("", "delay")), f"setup.{CLOCK}") if name in active]
        is_late = bool(delays and run.dynamic and sensed)
        clocks = []
        if not is_late or len(sensed) < len(function.columns):
            clocks.append(_Clock.of(motion, slice(None), _series(motion, function.inputs)))
        if is_late:
            # an instrument sees everything late; what the control records itself does not, though both may look at one signal
            drifts = [name for name in (f"setup.{CLOCK_DRIFT}",) if name in active]
            late = Late(
                sum(values[name] for name in delays), sum(values[name] for name in drifts), run.start_s + float(run.time[0]),
                run.duration, tuple(delays if slopes else ()), tuple(drifts if slopes else ()),
            )  # fmt: skip
            seen = motion.late(late)
            clocks.append(_Clock.of(motion, sensed if clocks else slice(None), _series(seen, function.inputs)))
        self._inputs[run] = (stamp, slopes, clocks)
        return clocks


class _Clock(NamedTuple):
    """What some `columns` of a run see: `inputs` (N, 2 + signals), and the signals with their slopes."""

    columns: slice | tuple[int, ...]
    inputs: Array
    series: list[Series]

    @classmethod
    def of(cls, motion: RunMotion, columns: slice | tuple[int, ...], series: list[Series]) -> _Clock:
        inputs = np.stack([motion.clock, motion.run.course, *(s.value for s in series)], axis=1)
        return cls(columns, inputs, series)


def _require_finite(run: Run, what: str, *tables: Array) -> None:
    """Raise `EvaluationError` where a table holds what cannot be squared and summed."""
    if not all(np.isfinite(np.vdot(table, table)) for table in tables):
        raise EvaluationError(
            f"run {run.id}: the {what} cannot be computed at these parameter values",
            remedy="see whether they make a drive unstable or a length zero",
        )


def _series(motion: RunMotion, signals: Sequence[Signal]) -> list[Series]:
    """Signals along a run, positions first: what is made of them gets finite ones."""
    found = []
    for signal in signals:
        found.append(motion.series(signal))
        _require_finite(motion.run, "motion", found[-1].value, *found[-1].tangents.values())
    return found
