"""An identification in words: what `symfive identify` prints, and parts of it. Plain text, escaped by the caller."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from symfive.effects import amplitude_and_phase, length_spread
from symfive.identify import UNCONVERGED, Identification
from symfive.kinematics import function_words
from symfive.machine import Machine
from symfive.numbers import expected_ratio, plain_number, rounded, unit_words, with_unit
from symfive.parameters import DETERMINED, Parameter, said_together
from symfive.screen import aligned, first_of, wrapped
from symfive.worth import location_worths, worth_text

_WAVE = re.compile(r"(.*\.(?:.*\*)?)(sin|cos)(\d*(?:\([^()]*\))?)")
"""Names of the two parameters of a wave: they differ in `sin` and `cos` alone."""
_WAVE_WORDS = re.compile(r"\b(?:co)?sine\b")
WAVES = "Periodic errors are A·sin(n·q + φ): A amplitude, φ phase, n order, q the position of the axis."
SHOWN = 6
"""Parameters that are named in a sentence, at most."""
OPEN = 2.0
"""An amplitude below so many σ has no phase."""


@dataclass(frozen=True)
class Stated:
    """One line of a table of parameters: the `symbol` of an error of the machine file, what it means, value, 1σ, 95 % interval,
    unit, prior mean and 1σ (none of a phase), and whether the readings determine it better than its prior."""

    symbol: str
    meaning: str
    value: float
    std: float
    interval: tuple[float, float]
    unit: str
    prior: tuple[float, float] | None
    known: bool

    @property
    def is_open(self) -> bool:
        """Whether it is a phase that is not determined."""
        return math.isnan(self.value)


def stated(identification: Identification) -> Iterator[Stated]:
    """The parameters of the machine and its effects as a person reads them: of a wave its amplitude and its phase."""
    machine, mine = identification.model.machine, [p for p in identification.parameters if not p.of_setup]
    waves = {p.name: found for p in mine if (found := _WAVE.fullmatch(p.name))}
    names, told = {p.name for p in mine}, set[str]()
    for p in mine:
        symbol = p.name.partition(".")[0] if p.name.partition(".")[0] in machine.errors else ""
        value, std, known = identification[p.name], identification.uncertainty(p.name), determined(identification, p)
        wave = waves.get(p.name)
        other = f"{wave[1]}{'cos' if wave[2] == 'sin' else 'sin'}{wave[3]}" if wave else ""
        if other not in names:
            interval = identification.interval(p.name)
            yield Stated(symbol, meaning(p, machine), value, std, interval, p.unit, (p.mean, p.sigma), known)
        elif p.name not in told:
            told |= {p.name, other}
            yield from _wave(identification, p, p.name if wave and wave[2] == "sin" else other, symbol)


def _wave(identification: Identification, p: Parameter, sine: str, symbol: str) -> Iterator[Stated]:
    """Amplitude and phase of the wave of which `p` is one parameter and `sine` the name of its sine."""
    head, _, tail = _WAVE.fullmatch(sine).groups()  # type: ignore[union-attr]
    names, index = (sine, f"{head}cos{tail}"), identification.model.index
    values = {name: identification[name] for name in names}
    covariance = {(a, b): float(identification.covariance[index[a], index[b]]) for a in names for b in names}
    size, phase = amplitude_and_phase(*names, p.unit, values, covariance)
    value, angle = float(size.value), math.degrees(float(phase.value))  # type: ignore[arg-type]
    std = length_spread(lambda v: math.hypot(*v), names, values, covariance)
    low, high = identification.interval(sine)
    factor = (high - low) / (2.0 * identification.uncertainty(sine)) if identification.uncertainty(sine) else 0.0
    said = meaning(p, identification.model.machine)
    known = max(map(identification.uncertainty, names)) < DETERMINED * p.sigma

    def words(what: str) -> str:
        return _WAVE_WORDS.sub(f"{what} of order" if tail else what, said)

    ends = max(value - factor * std, 0.0), value + factor * std
    yield Stated(symbol, words("amplitude"), value, std, ends, p.unit, (p.mean, p.sigma), known)
    spread = math.degrees(float(phase.std))  # type: ignore[arg-type]
    angle = angle if value > OPEN * std else math.nan
    ends = angle - factor * spread, angle + factor * spread
    yield Stated(symbol, words("phase"), angle, spread, ends, "deg", None, known)


def determined(identification: Identification, parameter: Parameter) -> bool:
    """Whether the readings determine it better than its prior."""
    return identification.uncertainty(parameter.name) < DETERMINED * parameter.sigma


def verdict(identification: Identification) -> str:
    """One paragraph: does the model explain the readings, what is known now, what is not, what to do next."""
    sentences = [_fit(identification), *_noise(identification), _knowledge(identification)]
    apart = [c for c in identification.confounded if c.of_machine]
    if apart:
        count = "one combination" if len(apart) == 1 else f"{len(apart)} combinations"
        sentences.append(f"The readings alone leave {count} of these and the set-up's parameters open (listed below).")
    sentences.append(identification.excluded)
    if not identification.converged:
        sentences.insert(0, UNCONVERGED)
    return " ".join(sentence for sentence in sentences if sentence)


def _fit(identification: Identification) -> str:
    rms = _sizes(identification.rms_kept)  # of the readings that χ² counts
    every = f" ({_sizes(identification.rms)} with the excluded outliers)" if identification.outliers else ""
    left = f"residual RMS {rms}{every}, " if rms else ""
    ratio = identification.chi2_dof
    much = f"χ²/dof {plain_number(ratio)} against the declared noise ({expected_ratio(identification.dof)})"
    return {
        "yes": f"The model explains the readings down to the declared noise: {left}{much}.",
        "better": f"The residuals are smaller than the declared noise: {left}{much}; "
                  "the declared noise is probably too large.",
        "nearly": f"The model explains the readings almost down to the declared noise: {left}{much}, a small but "
                  "significant excess.",
        "no": f"The model does not explain the readings down to the declared noise: {left}{much}. Either "
              "an effect is missing from the model, or the noise is larger than declared; “symfive diagnose” tells which.",
        "unknown": "There are too few readings to judge the fit.",
    }[identification.fits]  # fmt: skip


def _sizes(rms: Mapping[str, float]) -> str:
    return " and ".join(with_unit(value, unit) for unit, value in rms.items() if unit != "mixed")


def _noise(identification: Identification) -> list[str]:
    slow = [(key, n) for key, n in identification.noises.items() if n.coloured > 0.1 * n.declared]
    if not slow:
        return []
    (run, _), most = max(slow, key=lambda item: item[1].coloured / item[1].declared)
    share = f"{most.coloured / most.declared:.2g}"
    tau = " to ".join(f"{time:.2g}" for time in sorted({most.times[-1], most.times[0]}))
    unit = "s" if identification.model.campaign.run(run).has_clock else "rows"
    return [f"Part of the residual is slow (up to {share} times the declared noise, over about {tau} {unit}): drift, or an "
            "effect of the axis positions. The uncertainties below treat it as noise; run “symfive diagnose” to find out "
            "whether it is."]  # fmt: skip


def _knowledge(identification: Identification) -> str:
    shared = [p for p in identification.parameters if not p.of_setup]
    unknown = [p for p in shared if not determined(identification, p)]
    if not shared:
        return "The model has set-up parameters only."
    if len(unknown) == len(shared):
        every = "The one parameter" if len(shared) == 1 else f"None of the {len(shared)} parameters"
        return f"{every} of the machine and its effects is {'not ' * (len(shared) == 1)}determined better than by its prior."
    if not unknown:
        if len(shared) == 1:
            return "The one parameter of the machine is determined better than by its prior."
        count = "Both" if len(shared) == 2 else f"All {len(shared)}"
        return f"{count} parameters of the machine and its effects are determined better than by their priors."
    known = len(shared) - len(unknown)
    return (
        f"Of {len(shared)} parameters of the machine and its effects {known} {'is' if known == 1 else 'are'} determined better "
        f"than by the prior, not {first_of(said_together(unknown), SHOWN)}."
    )


def meaning(parameter: Parameter, machine: Machine) -> str:
    """What a parameter is, in a few words; of an error of the machine file without its symbol."""
    name, _, function = parameter.name.partition(".")
    term = machine.errors.get(name)
    if term is None:
        return parameter.words
    letter = term.component
    along = f"about {'XYZ'['ABC'.index(letter)]}" if term.angular else f"along {letter}"
    if term.is_location:
        return f"{'orientation' if term.angular else 'position'} of axis {term.axis} {along}"
    over = "" if term.over == (term.axis,) else f" over {', '.join(term.over)}"
    return f"error motion of axis {term.axis} {along}{over}, {function_words(function)}"


def identification_text(identification: Identification) -> str:
    """The verdict, value ± 1σ of the machine's parameters, what the readings cannot separate, and what correcting each location
    error is worth."""
    found = list(stated(identification))
    rows = [("error", "value", "1σ", "unit", "prior 1σ", "meaning"), *map(_row, found)]
    if not any(each.symbol for each in found):
        rows = [row[1:] for row in rows]
    first = len(rows[0]) - 5
    parts = [
        wrapped("", verdict(identification)),
        [
            *aligned(rows, right=(first, first + 1, first + 3)),
            *([WAVES] if any(each.prior is None for each in found) else []),
        ]
        if found
        else [],
        [
            f"The readings determine {identification.rank} of {len(identification.parameters)} parameters, set-up included."
        ],
        [line for said in identification.inseparable for line in wrapped("", f"{said}.")],
        worth_text(location_worths(identification)).splitlines(),
    ]
    return "\n\n".join("\n".join(lines) for lines in parts if lines)


def _row(each: Stated) -> tuple[str, ...]:
    value, std = ("–" if each.is_open else rounded(number, each.std, each.unit) for number in (each.value, each.std))
    prior = "–" if each.prior is None else plain_number(each.prior[1], each.unit)
    return each.symbol, value, std, unit_words(each.unit), prior, each.meaning
