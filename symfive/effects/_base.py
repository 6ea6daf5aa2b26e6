"""The contract of an effect, a piece of physics that joins the model from one small file, and of the forms in which it acts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

from symfive.arrays import Array
from symfive.effects._axes import moving
from symfive.effects._quantity import Covariance, Quantity, Values, own_quantity
from symfive.effects._words import key_words, quantity_words
from symfive.errors import InputError
from symfive.machine import Axis, unknown_axis
from symfive.motion import Signal
from symfive.parameters import Parameter
from symfive.row import Row
from symfive.runs import Campaign, Run

__all__ = [  # beside what stands here, what every effect is written with
    "Campaign", "Covariance", "Effect", "Form", "Forms", "Parameter", "Quantity", "Row", "Run", "Values",
]  # fmt: skip

TOOL, AXIS, CARRIED, BALL, FORCE, READING = "tool", "axis", "carried", "ball", "force", "reading"
"""Channels by which readings answer: a shift of the tool (3), of an axis, of what it carries (3), of the table's ball (3);
a force in the recording of an axis' drive; a constant in each reading column of an instrument."""
_LISTED = (
    "backlash", "friction", "lateral_play", "transmission_error", "servo_mismatch", "scale_error", "location_error",
    "error_motion",
)  # fmt: skip
"""Effects by frequency: prior odds where readings cannot separate two names. No count of machines is published. The order in
which the makers of ball bars list what their software finds (backlash, reversal spikes, lateral play, cyclic error, servo
mismatch, scaling, squareness, straightness: Quality Magazine, "The ins and outs of ballbar calibration", article 84126) stands
for it, the n-th with a weight of 1/n (G. K. Zipf 1949); what is not in the list has the last one's."""
STAGES = ("drive", "axis", "structure", "reading", "recording")
"""In which order effects enter: inside the position loop, behind the drive, in the structure, in the
instrument's reading of a row, in what its recorder makes of all rows together."""
LINKS = DRIVE, BEHIND, STRUCTURE, INSTRUMENT = ("drive", "behind the drive", "structure", "instrument and set-up")
"""The links of the chain from the command to the reading (P. Andolfatto, S. Lavernhe & J. Mayer 2011)."""
_LINKS = dict(zip(STAGES, (*LINKS, INSTRUMENT), strict=True))


@dataclass(frozen=True, kw_only=True)
class Form:
    """One way in which an effect may act. `shapes`: the same cause in other shapes, which only an exact refit can weigh. `at`:
    the parameters, by name, about which its change of the readings is linear; where estimation begins if none are given.

    `places`: among how many equally probable places this one was picked. `channel` and `basis`, (run) → (N, m): where given,
    the readings answer to the effect as to this channel (of an `axis`) times the functions, each with its own factor of the
    prior 1σ `sigma`. `directions`: of those that the readings see, so many are kept at least. `measured`: it is just what the
    readings are deviations of, so that whether it is there is an even question and no surprise.
    """

    effect: Effect
    shapes: tuple[Effect, ...] = ()
    at: Mapping[str, float] = field(default_factory=dict)
    places: float = 1.0
    channel: str = ""
    axis: str | None = None
    basis: Callable[[Run], Array] | None = None
    sigma: float = 1.0
    directions: int = 0
    measured: bool = False
    once: bool = False
    partner: str = ""

    @property
    def sloped(self) -> bool:
        """Whether the readings answer to it by slopes of the model about where estimation begins."""
        return self.basis is None and not self.at

    @property
    def placed(self) -> bool:
        """Whether a scan picked its place; then others of its name may act at other places."""
        return self.places > 1.0 and not self.once

    def proportional(self, campaign: Campaign) -> bool:
        """Whether the readings are proportional to its amplitudes, whatever their size: it moves no drive and no play, and no
        signal depends on its parameters. Of axes at rest only the direction counts from which they came."""
        effect = self.effect
        moves = bool(effect.frees()) or any(signal.parameters for signal in effect.signals())
        return self.basis is not None or not (moves and any(run.dynamic for run in campaign.runs))


@dataclass(frozen=True, kw_only=True)
class Scan:
    """Forms of which one parameter is a place, to be found on a grid: `count` places, each a course in time of a `channel`.

    `courses` (run) → (N, count); `form` makes the exact form of one place. `axis`: of the channel `axis`.
    `run`: the only one in which it acts. `finer` (place): the places about one of them, where these are some of more.
    """

    channel: str
    count: int
    courses: Callable[[Run], Array]
    form: Callable[[int], Form]
    axis: str | None = None
    run: str | None = None
    finer: Callable[[int], Scan] | None = None


@dataclass(frozen=True, kw_only=True)
class Begin:
    """Where an effect begins whose place a scan picked: the first `row` (from 0) of a run in which it acts, the same effect
    `always`, and as it is described where that row has a 1σ, `within` so many rows."""

    row: int
    always: Effect
    within: Callable[[float], Effect]


@dataclass(frozen=True, kw_only=True)
class Tone:
    """Forms that are a sine over a coordinate, (run) → (N,): cycles per unit from `lowest` to `highest` are looked for.

    `form` (cycles per unit, their resolution, number of places) makes the exact form. `apart`: of each run with its own phase.
    """

    channel: str
    coordinate: Callable[[Run], Array]
    lowest: float
    highest: float
    form: Callable[[float, float, int], Form]
    axis: str | None = None
    runs: tuple[str, ...] = field(default=())
    apart: bool = False


Forms = Iterable[Form | Scan | Tone]
"""In which an effect may act in a campaign."""


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Base of all effects. A subclass is one file and one line in the table of `symfive.effects`.

    `id` is its name, `reported_as` the word of the vocabulary (docs/conventions.md, section 7) for it where
    that is another one, `state` words behind its name where that means something else in other states or of other axes,
    `stage` one of `STAGES`, `axis` the axis it belongs to (None: no axis). Further fields of a subclass say which form is meant
    (a component, a run, a shape), `choices` what they may be; `tag` distinguishes two effects of one kind and axis. A field
    `component` (`EYX`, `EA0C`) is the error to which it adds. `spread` multiplies the prior 1σ of its amplitudes.

    `terms` are words for the parts of its keys and of its parameters' names that do not say by themselves what they are; with
    `{}` in the place of the part that follows.

    `says` what it does, `hidden_by` what absorbs it and `action` what a service engineer does about it are sentences of the
    report, without a capital and a full stop.

    At the prior means of its parameters an effect does nothing; `typical` gives values at which it is of
    usual size. Its amplitudes are the parameters whose prior mean is 0; or all of them where it `departs` from what
    is set on the machine. What acts `over_time` is not seen in runs whose clock was not recorded.
    """

    id: ClassVar[str]
    stage: ClassVar[str] = "structure"
    acts_in: ClassVar[str] = ""
    says: ClassVar[str] = ""
    hidden_by: ClassVar[str] = ""
    action: ClassVar[str] = ""
    terms: ClassVar[tuple[tuple[str, str], ...]] = ()
    reported_as: ClassVar[str] = ""
    state: ClassVar[str] = ""
    choices: ClassVar[tuple[tuple[str, tuple[str, ...]], ...]] = ()
    needs_axis: ClassVar[bool] = False
    needs_drive: ClassVar[bool] = False
    dynamic_only: ClassVar[bool] = False
    departs: ClassVar[bool] = False
    unidentified: ClassVar[bool] = False
    coordinate: ClassVar[str] = "pose"
    over_time: ClassVar[bool] = False
    axis: str | None = None
    tag: str = ""
    spread: float = field(default=1.0, compare=False)

    @property
    def key(self) -> str:
        """Prefix of its parameters' names: id, axis and component, as `backlash.C`, `lateral_play.EYX`, `gravity_sag.B.EZB`."""
        return self._key(self.axis, getattr(self, "component", None))

    def _key(self, *parts: str | None) -> str:
        return ".".join(part for part in (self.id, *parts, self.tag) if part)

    @property
    def belongs_to(self) -> str | None:
        """The axis it is about: its own, or that of its component."""
        symbol = getattr(self, "component", None)
        return symbol[2:].lstrip("0") if self.axis is None and isinstance(symbol, str) else self.axis

    @property
    def words(self) -> str:
        """Its kind, axis and component, as `gravity sag of axis B (EXB)`."""
        return self.called(self.key)

    def quantity_words(self, name: str, unit: str | None) -> str:
        """What `describe` gives under this name, in words, without the unit that stands behind the number."""
        return quantity_words(name, unit, self.terms)

    def called(self, name: str) -> str:
        """The words of its parameter of this name, or of its key."""
        axis = self.belongs_to
        return key_words(name, (axis,) if axis else (), self.terms)

    @property
    def link(self) -> str:
        """The affected link of the chain, one of `LINKS`: the one it `acts_in`, else that of its stage."""
        return self.acts_in or _LINKS[self.stage]

    @property
    def in_the_drive(self) -> bool:
        """Whether it acts in the position loops, or shows in the force of a drive."""
        return self.link == DRIVE

    @property
    def rate(self) -> float:
        """How common it is beside other names."""
        word = self.vocabulary
        return 1.0 / (1 + _LISTED.index(word)) if word in _LISTED else 1.0 / len(_LISTED)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The coordinates over which it acts, with its axis in the place of `{axis}`."""
        return tuple(self.coordinate.format(axis=self.belongs_to).split(", "))

    @property
    def answers(self) -> tuple[str, str] | None:
        """The channel by which readings answer to it and the coordinate over which it acts, where a form that is a little off
        would show; None where neither is one of the machine's."""
        words = ", ".join(self.coordinates).replace(" velocity sign", " since reversal")
        channels = {"drive": AXIS, "axis": AXIS, "structure": TOOL}
        return (channels[self.stage], words) if self.stage in channels and words not in ("pose", "reading") else None

    @classmethod
    def candidates(cls, campaign: Campaign) -> Forms:
        """The forms in which it may act in this campaign. Those that cannot join (`prepare` raises) are left out by who asks.

        Default: its plain form, of an effect of axes one per axis that moves.
        """
        axes: Iterable[str | None] = moving(campaign) if cls.needs_axis else (None,)
        return [Form(effect=cls(axis=axis)) for axis in axes]

    @property
    def vocabulary(self) -> str:
        """The word of the vocabulary under which it is reported."""
        return self.reported_as or self.id

    def prepare(self, campaign: Campaign) -> Self:
        """This effect with all that it takes from the campaign written into its fields.

        Raises `InputError` where it cannot join: an axis or a drive is missing, an option is none of its `choices`, the
        baseline already holds it.
        """
        for option, allowed in self.choices:
            value = getattr(self, option)
            if value not in allowed:
                problem = f"effect {self.id}: {option} {value!r} is unknown"
                raise InputError(problem, remedy=f"use one of {', '.join(allowed)}")
        if self.needs_axis and self.axis is None:
            raise InputError(
                f"effect {self.id} belongs to an axis", remedy=f'write axis = "X" with effect = "{self.id}"'
            )
        if self.axis is not None and self.axis not in campaign.machine.axes:
            raise unknown_axis(f"effect {self.id}", self.axis, campaign.machine.axes)
        if self.needs_drive and self.its_axis(campaign).drive is None:
            raise InputError(f"{self.key} needs the drive of axis {self.axis}", remedy=f"add [axes.{self.axis}.drive]")
        return self

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        """Its parameters with priors; names begin with `key`."""
        return ()

    def typical(self, campaign: Campaign) -> dict[str, float]:
        """Parameters at which it is of usual size: 1σ of the prior of each amplitude, the prior mean of each shape."""
        return {p.name: p.sigma if p.mean == 0.0 else p.mean for p in self.parameters(campaign)}

    def steps(self, campaign: Campaign) -> Mapping[str, float]:
        """Parameters in which the readings are rough, by name, and the change from which on they are smooth (file units)."""
        return {}

    def starts(self, run: Run) -> tuple[Parameter, ...]:
        """Unknown initial states of a run, as parameters of its set-up."""
        return ()

    def begins(self, run: Run) -> Begin | None:
        """Where it begins in a run; None where it is no effect of one run, or where its begin is a parameter."""
        return None

    def signals(self) -> tuple[Signal, ...]:
        """Signals along the run that it needs beside the axis positions."""
        return ()

    def frees(self) -> Mapping[tuple[str, str], str]:
        """Drive quantities that become parameters: (axis, quantity) → name. `("", "delay")` is the clock's
        delay."""
        return {}

    def applies(self, run: Run) -> bool:
        """Whether it can act in this run."""
        return (run.dynamic or not self.dynamic_only) and (run.has_clock or not self.over_time)

    def apply(self, row: Row) -> None:
        """Change the row's symbols (the exact forward model)."""

    def record(
        self, run: Run, columns: tuple[int, ...], readings: Array, values: Values
    ) -> tuple[Array, dict[str, Array]]:
        """What the recorder makes of a run's readings, for the stage `recording`: a linear filter in time.

        `readings` (N, ny, m): the prediction and its derivatives as m series; `columns` those that are not
        the control's own; `values` its parameters in internal units. Returns them filtered and, for m = 0
        (the prediction), the slopes (N, ny) with respect to its own parameters by name.
        """
        return readings, {}

    def describe(self, campaign: Campaign, values: Values, covariance: Covariance) -> dict[str, Quantity]:
        """Its parameters in the words of the vocabulary, with standard deviations (first order) and units.

        `values` by parameter name in file units, `covariance` by pairs of names. Default: its `component`, if it has
        one, and the parameters as they are, without `key`.
        """
        component = getattr(self, "component", None)
        found = {} if component is None else {"component": Quantity(component)}
        mine = self.parameters(campaign)
        return found | {p.name.removeprefix(self.key + "."): own_quantity(p, values, covariance) for p in mine}

    def beside(self, campaign: Campaign) -> tuple[Effect, ...]:
        """Effects to which its sizes are relative: where a fit lacks one, what readings leave open of that counts in them."""
        return ()

    def advice(self, sizes: Mapping[str, Quantity]) -> tuple[str, str]:
        """What it does and what a service engineer does about it where its parameters have these `sizes`."""
        return self.says, self.action

    def amplitudes(self, campaign: Campaign) -> tuple[Parameter, ...]:
        """Those of its parameters that say how large it is, of any unit."""
        return tuple(p for p in self.parameters(campaign) if self.departs or p.mean == 0.0)

    def in_sigmas(self, campaign: Campaign, values: Values) -> float:
        """The largest of its amplitudes in units of its prior's 1σ."""
        return max((abs(values[p.name] - p.mean) / p.sigma for p in self.amplitudes(campaign)), default=0.0)

    def times_usual(self, campaign: Campaign, values: Values) -> float:
        """The same in units of the 1σ that its prior has unless it is widened."""
        return replace(self, spread=1.0).in_sigmas(campaign, values)

    def parameter(self, row: Row, name: str) -> Any:
        """Its own parameter `name` in internal units."""
        return row.parameter(f"{self.key}.{name}")

    def own(self, name: str, unit: str, sigma: float, **more: Any) -> Parameter:
        """A parameter of this effect."""
        scale = self.spread if self.departs or more.get("mean", 0.0) == 0.0 else 1.0
        return Parameter(name=f"{self.key}.{name}", unit=unit, sigma=scale * sigma, kind="effect",
                         called=self.called, **more)  # fmt: skip

    def forms_about(self, parameter: Parameter, values: Iterable[float], *shapes: Effect) -> Iterator[Form]:
        """Its form, and the same about several values of a parameter in which the readings are far from linear."""
        yield Form(effect=self, shapes=shapes)
        for value in values:
            yield Form(effect=self, shapes=shapes, at={parameter.name: value})

    def its_axis(self, campaign: Campaign) -> Axis:
        return campaign.machine.axes[str(self.axis)]
