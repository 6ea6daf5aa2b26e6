"""The rest of an effect's own family: functions on its channel, over its coordinate, where its form is a little off."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Self

import casadi as ca
import numpy as np

from symfive.effects._base import Effect
from symfive.effects._form import Form
from symfive.effects._series import share_of
from symfive.effects.inertial_compliance import commanded_acceleration
from symfive.motion import Acceleration, Direction, Position, ReversalDistance, ReversalTime, Velocity
from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.motion import Signal
    from symfive.row import Row
    from symfive.runs import Campaign

FAMILIES = ("reversal", "friction", "smooth", "hysteresis", "servo", "inertial", "periodic", "time")
WAVES, BENDS = 8, 4
DISTANCES = (0.003, 0.01, 0.03, 0.1, 0.3)
TIMES_S = (0.02, 0.06, 0.2, 0.6)


@dataclass(frozen=True, kw_only=True)
class FamilyShape(Effect):
    """Σ c_k·f_k on one channel: what another effect of the model leaves over because its true form differs.

    `of` is the key of that effect, `channel` what it moves: `axis` (the coordinate of `axis`), an error motion's symbol
    (`EZB`) or `tool`. `family` chooses the functions f_k:

    - `reversal`: the direction s of motion times decays over the distance since the reversal, and times P1, P2 of the place;
    - `friction`: s times decays over the distance and the time since the reversal;
    - `servo`: velocity times speed, its third power, acceleration;
    - `inertial`: powers of u/√(1 + u²), u the acceleration in units of its commanded amplitude `usual`;
    - `smooth`: Legendre polynomials (a rotary axis over more than 200°: harmonics) of the coordinate, and hysteresis s·(1 - x²);
    - `hysteresis`: `smooth` with s and s·x (a structure that yields under load comes back by another way);
    - `periodic`: harmonics of `period` (file unit), growing and fading along the axis;
    - `time`: Legendre polynomials of the campaign's clock.

    No function is another effect of the library by itself (a plain s is a play, a velocity a servo mismatch). `size` (µm
    or µrad) is the prior 1σ of each coefficient (in a series: of the first two, the others less). Its share of the
    effect says by how much the shape differs.
    """

    id = "family_shape"
    says = "deviation of an effect from its library shape"
    reported_as = "unknown"
    of: str
    channel: str
    family: str
    size: float
    period: float = 0.0
    span: tuple[float, float] = (0.0, 0.0)
    clock: tuple[float, float] = (0.0, 1.0)
    timed: bool = False
    usual: float = 0.0

    @property
    def key(self) -> str:
        """`family_shape.backlash.C`."""
        return self._key(self.of)

    @property
    def stage(self) -> str:  # type: ignore[override]
        """Where it enters."""
        return "axis" if self.channel == "axis" else "structure"

    @property
    def _turning(self) -> str:
        """The axis over whose coordinate the functions run."""
        return self.axis or ""

    @classmethod
    def candidates(cls, campaign: Campaign) -> Iterable[Form]:
        """None: it only joins another effect."""
        return ()

    @property
    def over_time(self) -> bool:  # type: ignore[override]
        """Whether its functions are of time."""
        return self.family == "time"

    def prepare(self, campaign: Campaign) -> Self:
        self.choose("family", FAMILIES)
        runs = campaign.runs
        timed_runs = [r for r in runs if r.has_clock]
        clock = (
            min((r.start_s for r in timed_runs), default=0.0),
            max((r.start_s + float(r.time[-1]) for r in timed_runs), default=1.0),
        )
        span = self.span
        if self.axis is not None and span == (0.0, 0.0):
            used = np.concatenate([run.commands[self.axis] for run in runs]) * self.its_axis(campaign).to_internal
            span = (float(used.min()), float(used.max()))
        timed = all(run.dynamic for run in runs)
        usual = self.usual
        if self.family == "inertial" and not usual:
            usual = commanded_acceleration(campaign, self.its_axis(campaign))
        clock = clock if self.clock == (0.0, 1.0) else self.clock
        return replace(super().prepare(campaign), span=span, clock=clock, timed=timed, usual=usual)

    def _names(self, campaign: Campaign) -> tuple[str, ...]:
        return tuple(name for name, _ in self._functions(campaign.machine.axes.get(self._turning)))

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        if self.channel == "axis":
            unit = "urad" if self.its_axis(campaign).rotary else "um"
        else:
            unit = "urad" if self.channel != "tool" and self.channel[1] in "ABC" else "um"
        parts = ("x.", "y.", "z.") if self.channel == "tool" else ("",)
        names = self._names(campaign)
        return tuple(self.own(part + name, unit, self.size * share_of(name)) for part in parts for name in names)

    def signals(self) -> tuple[Signal, ...]:
        if self.family == "time":
            return ()
        axis = self._turning
        if self.family == "inertial":
            return (Acceleration(axis),)
        found: list[Signal] = [Direction(axis), Position(axis)]
        if self.family in ("reversal", "friction"):
            found.append(ReversalDistance(axis))
        if self.family == "friction" and self.timed:
            found.append(ReversalTime(axis))
        if self.family == "servo":
            found += [Velocity(axis), Acceleration(axis)]
        return tuple(found)

    def apply(self, row: Row) -> None:
        functions = self._functions(row.machine.axes.get(self._turning))
        values = ca.vertcat(*(f(row) for _, f in functions))

        def total(part: str = "") -> Any:
            return ca.dot(ca.vertcat(*(self.parameter(row, part + name) for name, _ in functions)), values)

        if self.channel == "tool":
            for i, c in enumerate("xyz"):
                row.shift[i] += total(f"{c}.")
        elif self.channel == "axis":
            row.axis[self._turning] += total()
        else:
            row.add_motion(self.channel, total())

    def _functions(self, axis: Any) -> list[tuple[str, Callable[[Row], Any]]]:
        """Names and functions of a row, each of size about one."""
        make = {
            "reversal": self._reversal, "friction": self._friction, "smooth": self._smooth, "hysteresis": self._hysteresis,
            "servo": self._servo, "inertial": self._inertial, "periodic": self._periodic, "time": self._in_time,
        }  # fmt: skip
        return list(make[self.family](axis))

    def _place(self, row: Row) -> Any:
        """Where in the span the axis stands, -1…1; beyond it nothing was seen, and the shape stays as it is at its end."""
        low, high = self.span
        return _within((2.0 * row.signal(Position(self._turning)) - (low + high)) / max(high - low, 1e-12))

    def _sign(self, row: Row) -> Any:
        return row.signal(Direction(self._turning))

    def _after_distance(self) -> Iterator[tuple[str, Callable[[Row], Any]]]:
        reach = max(self.span[1] - self.span[0], 1e-12)

        def far(share: float) -> Callable[[Row], Any]:
            return lambda row: self._sign(row) * ca.exp(-row.signal(ReversalDistance(self._turning)) / (share * reach))

        yield from ((f"distance{k}", far(share)) for k, share in enumerate(DISTANCES, start=1))

    def _reversal(self, axis: Any) -> Iterator[tuple[str, Callable[[Row], Any]]]:
        yield from self._after_distance()
        yield "sign*place", lambda row: self._sign(row) * self._place(row)
        yield "sign*P2", lambda row: self._sign(row) * _legendre(2, self._place(row))  # across a plain s

    def _friction(self, axis: Any) -> Iterator[tuple[str, Callable[[Row], Any]]]:
        def late(tau: float) -> Callable[[Row], Any]:
            def fading(row: Row) -> Any:
                since = row.signal(ReversalTime(self._turning))
                return ca.sign(since) * ca.exp(-ca.fabs(since) / tau)

            return fading

        yield from self._after_distance()
        if self.timed:
            yield from ((f"time{k}", late(tau)) for k, tau in enumerate(TIMES_S, start=1))

    def _smooth(self, axis: Any) -> Iterator[tuple[str, Callable[[Row], Any]]]:
        if axis is not None and axis.rotary and self.span[1] - self.span[0] > np.deg2rad(200.0):
            for k in range(1, WAVES - 1):
                yield f"cos{k}", lambda row, k=k: ca.cos(k * row.signal(Position(self._turning)))  # type: ignore[misc]
                yield f"sin{k}", lambda row, k=k: ca.sin(k * row.signal(Position(self._turning)))  # type: ignore[misc]
        else:
            for k in range(1, WAVES + 1):
                yield f"P{k}", lambda row, k=k: _legendre(k, self._place(row))  # type: ignore[misc]
        yield "sign*bow", lambda row: self._sign(row) * (1.0 - self._place(row) ** 2)

    def _hysteresis(self, axis: Any) -> Iterator[tuple[str, Callable[[Row], Any]]]:
        yield from self._smooth(axis)
        yield "sign", self._sign
        yield "sign*place", lambda row: self._sign(row) * self._place(row)

    def _servo(self, axis: Any) -> Iterator[tuple[str, Callable[[Row], Any]]]:
        speed = (axis.max_feed or 6000.0) * axis.to_internal / 60.0 / 10.0
        rise = (axis.max_acceleration or 3000.0) * axis.to_internal / 10.0

        def velocity(row: Row) -> Any:
            return row.signal(Velocity(self._turning)) / speed

        yield "velocity*speed", lambda row: velocity(row) * ca.fabs(velocity(row))
        yield "velocity3", lambda row: velocity(row) ** 3
        yield "acceleration", lambda row: row.signal(Acceleration(self._turning)) / rise

    def _inertial(self, axis: Any) -> Iterator[tuple[str, Callable[[Row], Any]]]:
        def power(k: int) -> Callable[[Row], Any]:
            def yielding(row: Row) -> Any:
                u = row.signal(Acceleration(self._turning)) / self.usual
                return (u / ca.sqrt(1.0 + u**2)) ** k

            return yielding

        yield from ((f"acceleration{k}", power(k)) for k in range(2, 2 + BENDS))

    def _periodic(self, axis: Any) -> Iterator[tuple[str, Callable[[Row], Any]]]:
        def wave(order: float, power: int, f: Callable[[Any], Any]) -> Callable[[Row], Any]:
            angle = 2.0 * np.pi * order / (self.period * axis.to_internal)
            return lambda row: f(angle * row.signal(Position(self._turning))) * self._place(row) ** power

        for order, power in ((0.5, 0), (2.0, 0), (3.0, 0), (4.0, 0), (1.0, 1), (1.0, 2)):
            yield f"cos{order:g}^{power}", wave(order, power, ca.cos)
            yield f"sin{order:g}^{power}", wave(order, power, ca.sin)

    def _in_time(self, axis: Any) -> Iterator[tuple[str, Callable[[Row], Any]]]:
        low, high = self.clock

        def value(k: int) -> Callable[[Row], Any]:
            return lambda row: _legendre(k, _within((2.0 * row.clock - (low + high)) / max(high - low, 1e-12)))

        yield from ((f"T{k}", value(k)) for k in range(1, WAVES + 1))


def _within(x: Any) -> Any:
    return ca.fmin(ca.fmax(x, -1.0), 1.0)


def _legendre(order: int, x: Any) -> Any:
    return _legendre_function(order)(x)


@lru_cache(maxsize=32)
def _legendre_function(order: int) -> Any:
    x = ca.SX.sym("x")
    previous, current = ca.SX(1), x
    for k in range(1, order):
        previous, current = current, ((2 * k + 1) * x * current - k * previous) / (k + 1)
    return ca.Function("legendre", [x], [current])
