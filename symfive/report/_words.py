"""An identification in words: what `symfive identify` prints, and parts of it. Plain text, escaped by the caller."""

from __future__ import annotations

from symfive.effects import form_words
from symfive.identify import UNCONVERGED, Identification
from symfive.machine import Machine
from symfive.numbers import expected_ratio, plain_number, rounded, unit_words, with_unit
from symfive.parameters import DETERMINED, Parameter
from symfive.screen import aligned, wrapped
from symfive.worth import location_worths, worth_text

_OTHERS = {"drive": "gain of a drive", "instrument": "parameter of the instrument"}


def determined(identification: Identification, parameter: Parameter) -> bool:
    """Whether the readings determine it better than its prior."""
    return identification.uncertainty(parameter.name) < DETERMINED * parameter.sigma


def verdict(identification: Identification) -> str:
    """One paragraph: does the model explain the readings, what is known now, what is not, what to do next."""
    sentences = [_fit(identification), *_noise(identification), _knowledge(identification)]
    apart = [c for c in identification.confounded if c.of_machine]
    if apart:
        count = "one combination" if len(apart) == 1 else f"{len(apart)} combinations"
        sentences.append(f"The readings do not separate {count} of the machine's parameters (listed below).")
    sentences.append(identification.excluded)
    if not identification.converged:
        sentences.insert(0, UNCONVERGED)
    return " ".join(sentence for sentence in sentences if sentence)


def _fit(identification: Identification) -> str:
    known = [(unit, value) for unit, value in identification.rms.items() if unit != "mixed"]
    rms = " and ".join(with_unit(value, unit) for unit, value in known)
    left = f"residual RMS {rms}, " if rms else ""
    ratio = identification.chi2_dof
    much = f"χ²/dof {ratio:.3g} against the declared noise ({expected_ratio(identification.dof)})"
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


def _noise(identification: Identification) -> list[str]:
    slow = [(key, n) for key, n in identification.noises.items() if n.coloured > 0.1 * n.declared]
    if not slow:
        return []
    (run, _), most = max(slow, key=lambda item: item[1].coloured / item[1].declared)
    share, tau = f"{most.coloured / most.declared:.2g}", f"{most.time_constant:.2g}"
    unit = "s" if identification.model.campaign.run(run).has_clock else "rows"
    return [f"Part of the residual is slow (up to {share} times the declared noise, over about {tau} {unit}): drift, or an "
            "effect of the axis positions. The uncertainties below treat it as noise; run “symfive diagnose” to find out "
            "whether it is."]  # fmt: skip


def _knowledge(identification: Identification) -> str:
    shared = [p for p in identification.parameters if not p.of_setup]
    known = sum(determined(identification, p) for p in shared)
    if not shared:
        return "The model has set-up parameters only."
    if known == len(shared):
        if known == 1:
            return "The one parameter of the machine is determined better than by its prior."
        count = "Both" if known == 2 else f"All {known}"
        return f"{count} parameters of the machine and its effects are determined better than by their priors."
    unknown = [p.name for p in shared if not determined(identification, p)]
    names = ", ".join(unknown[:6]) + (f" and {len(unknown) - 6} more" if len(unknown) > 6 else "")
    verb = "is" if known == 1 else "are"
    known_words = f"{known} {verb} determined better than by the prior"
    return f"Of {len(shared)} parameters of the machine and its effects {known_words}, not {names}."


def meaning(parameter: Parameter, machine: Machine) -> str:
    """What a parameter is, in a few words."""
    name, _, function = parameter.name.partition(".")
    term = machine.errors.get(name)
    if parameter.kind == "effect":
        return form_words(parameter.name, machine)
    if term is None:
        return _OTHERS.get(parameter.kind, parameter.kind)
    letter = term.component
    along = f"about {'XYZ'['ABC'.index(letter)]}" if term.angular else f"along {letter}"
    if term.is_location:
        return f"{'orientation' if term.angular else 'position'} of axis {term.axis} {along}"
    over = "" if term.over == (term.axis,) else f" over {', '.join(term.over)}"
    return f"error motion of axis {term.axis} {along}{over}, term {function}"


def identification_text(identification: Identification) -> str:
    """The verdict, value ± 1σ of the machine's parameters, fit, what the readings cannot separate, and what correcting each
    location error is worth."""
    machine, index = identification.model.machine, identification.model.index
    rows = [("parameter", "value", "1σ", "unit", "prior 1σ", "meaning")]
    rows += [
        (name, rounded(value, std, unit), rounded(std, std, unit), unit_words(unit), plain_number(prior, unit),
         meaning(identification.parameters[index[name]], machine))
        for name, value, std, unit, prior in identification.table()
    ]  # fmt: skip
    unit = identification.unit
    lines = [
        *aligned(rows, right=(1, 2, 4)),
        f"rms {plain_number(identification.rms_um, unit)} {unit}, chi²/dof {identification.chi2_dof:.3f} against the declared "
        f"noise ({expected_ratio(identification.dof)})",
        f"The readings determine {identification.rank} of {len(identification.parameters)} parameters, set-up included.",
    ]
    worth = worth_text(location_worths(identification))
    return "\n".join(
        [
            *wrapped("", verdict(identification)),
            "",
            *lines,
            *(c.words for c in identification.confounded if c.of_machine),
            *([worth] if worth else []),
        ]
    )
